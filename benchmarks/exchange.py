# SPDX-License-Identifier: MIT
"""Counts what each rank holds and receives: facets and bytes on up to 32 ranks.

Two bodies meet on a curved surface with meshes that do not match; all slave facets touch. What a rank
holds is compared to its own facets and their geometric neighbours, all facets whose boxes overlap the
box of one of its own; these are counted by brute force on the whole surface. Ranks may be more than
cores: this counts, it does not time.

    python3 exchange.py [--facets 64] [--ranks 1 2 4 8 16 32] [--lift 0]

``--lift`` raises the slave's far side [lengths of the surface], so that most slave facets are away from
the master.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--facets", type=int, default=64, help="per side of the slave surface")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32])
    parser.add_argument("--lift", type=float, default=0.0)
    parser.add_argument("--count", action="store_true", help="on these ranks, print JSON")
    parser.add_argument("--output", type=Path, help="JSON file of all counts")
    args = parser.parse_args()
    if args.count:
        return count(args.facets, args.lift)
    rows = []
    print("partition   ranks | facets held | bytes received | largest ratio of a rank to its own")
    print("                  |  (largest)  |   (largest)    |  facets and neighbours: held, bytes")
    for ranks in args.ranks:
        options = ["--count", "--facets", str(args.facets), "--lift", str(args.lift)]
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, __file__]
        out = subprocess.run(command + options, check=True, capture_output=True, text=True).stdout
        for row in json.loads(out.splitlines()[-1]):
            rows.append(row)
            print(
                f"{row['partition']:11} {ranks:5} | {row['held']:11} | {row['bytes']:14} |"
                f" {row['held_ratio']:.2f}, {row['bytes_ratio']:.2f}",
                flush=True,
            )
    if args.output:
        args.output.write_text(json.dumps(rows, indent=1))


def height(x, lift=0.0):
    """Of the interface; the slave is raised where x is far from the origin."""
    return 0.05 * np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1]) + lift * np.maximum(x[:, 0] - 0.2, 0)


def surfaces(n, partition, lift):
    """Slave and master on a partition: "graph" (DOLFINx's), "repartition" or "random"."""
    from dolfinx import fem
    from mpi4py import MPI

    import dolfinx_contact as dc

    def bent(raise_by):
        def mapping(x):
            y = x.copy()
            y[:, 2] += height(x, raise_by)
            return y

        return mapping

    thin, comm = 0.1, MPI.COMM_WORLD
    m = n * 61 // 64
    slave = dc.meshes.grid((n, n, 1), (0, 0, 0), (1, 1, thin), bent(lift), "hexahedron")
    master = dc.meshes.grid(
        (m, m, 1), (-0.01, -0.01, -thin), (1.01, 1.01, 0), bent(0.0), "hexahedron"
    )
    rng = np.random.default_rng(0)
    random = lambda x, ranks: rng.integers(0, ranks, len(x))
    mesh, body = dc.meshes.create(comm, [slave, master], random if partition == "random" else None)
    on = lambda raise_by: lambda x: np.isclose(x[2], height(x.T, raise_by), atol=1e-9)
    tags = dc.meshes.tag_facets(mesh, {5: (on(lift), 0), 6: (on(0.0), 1)}, body)
    if partition == "repartition":
        mesh, tags = dc.repartition(mesh, tags, 5, 6)
    u = fem.Function(dc.vector_space(mesh, 1))
    return dc.Surface(u, tags, 5), dc.Surface(u, tags, 6)


def neighbours(boxes, own, grow=1e-6):
    """Number of boxes that overlap one of some of them; boxes (n, 2, dim), own (n,) booleans."""
    found = np.zeros(len(boxes), dtype=bool)
    for lower, upper in boxes[own]:
        found |= np.all((boxes[:, 0] <= upper + grow) & (lower - grow <= boxes[:, 1]), axis=1)
    return int(found.sum())


def measure(n, partition, lift=0.0):
    """Counts of this rank: facets held, bytes received, bytes of a facet, facets of its own and
    neighbours. Collective."""
    import ufl

    import dolfinx_contact as dc
    from dolfinx_contact import _cpp

    slave, master = surfaces(n, partition, lift)
    u, comm = slave.u, slave.comm
    F = ufl.inner(u, ufl.TestFunction(u.function_space)) * ufl.dx
    before = _cpp.bytes_received()
    problem = dc.ContactProblem(F, u, [dc.ContactPair(slave, master)])
    contact = problem.system.contacts[0]
    contact.update()
    received = _cpp.bytes_received() - before
    held = len(contact._ringed_slave) + len(contact._ringed) + len(contact.master)

    boxes, owner = [], []
    for surface in (slave, master):
        lower, upper = surface.X.min(axis=1), surface.X.max(axis=1)
        boxes.append(np.concatenate(comm.allgather(np.stack([lower, upper], axis=1))))
        owner.append(np.repeat(np.arange(comm.size), comm.allgather(len(lower))))
    own = np.concatenate(owner) == comm.rank
    record = 8 * (4 + 4 + 4 + 4 * 3)  # four numbers, corners, nodes and their positions
    return held, received, record, neighbours(np.concatenate(boxes), own)


def count(n, lift):
    from mpi4py import MPI

    comm, rows = MPI.COMM_WORLD, []
    for partition in ("graph", "repartition", "random"):
        held, received, size, near = np.array(comm.allgather(measure(n, partition, lift))).T
        rows.append(
            {
                "partition": partition,
                "ranks": comm.size,
                "held": int(held.max()),
                "bytes": int(received.max()),
                "held_ratio": float((held / np.maximum(near, 1)).max()),
                "bytes_ratio": float((received / (size * np.maximum(near, 1))).max()),
            }
        )
    if comm.rank == 0:
        print(json.dumps(rows))


if __name__ == "__main__":
    main()
