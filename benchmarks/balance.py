# SPDX-License-Identifier: MIT
"""What balance gains: contact work of an iteration on 1 and 2 ranks, by partition.

Two blocks of hexahedra, meshes that do not match, everything in contact, 25 particles a facet. Contact
work is search, residual, tangent and insertion into the matrix, with all communication. Each part is
timed by the CPU time of the slowest rank, the least of several runs; what is quoted is the sum.

    python3 balance.py [--facets 48] [--runs 7] [--ranks 1 2]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

PARTITIONS = ("graph", "one rank has the slave", "repartition")
PARTS = ("search", "residual", "tangent")
LAYERS, HEIGHT = 4, 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--facets", type=int, default=48, help="per side of the slave")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--friction", type=float, default=0.0)
    parser.add_argument("--count", action="store_true", help="on these ranks, print JSON")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    if args.count:
        return measure(args)
    alone, rows = None, []
    print(
        "partition              | ranks | slave facets      | search residual tangent [ms] | gain"
    )
    for ranks in args.ranks:
        given = [f"--{k}={getattr(args, k)}" for k in ("facets", "runs", "friction")]
        command = ["mpirun", "-n", str(ranks), sys.executable, __file__, "--count", *given]
        out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        for row in json.loads(out.splitlines()[-1]):
            total = sum(row["seconds"])
            alone = alone or total
            rows.append({**row, "gain": alone / total})
            times = " ".join(f"{1e3 * t:8.2f}" for t in row["seconds"])
            print(
                f"{row['partition']:22} | {ranks:5} | {str(row['slave']):17} | {times} |"
                f" {alone / total:.2f}",
                flush=True,
            )
    if args.output:
        args.output.write_text(json.dumps(rows, indent=1))


def make(n, friction, partition):
    """The problem, with displacements and pressures given; ready to assemble. Collective."""
    import ufl
    from dolfinx import fem
    from mpi4py import MPI

    import dolfinx_contact as dc
    from dolfinx_contact import compat

    comm, m = MPI.COMM_WORLD, int(0.77 * n)
    upper = dc.meshes.grid((n, n, LAYERS), (0, 0, 0), (1, 1, HEIGHT), cell="hexahedron")
    lower = dc.meshes.grid((m, m, LAYERS), (0, 0, -HEIGHT), (1, 1, 0), cell="hexahedron")
    of_body = lambda x, ranks: np.where(x[:, 2] > 0, 0, ranks - 1)
    mesh, body = dc.meshes.create(comm, [upper, lower], of_body if partition != "graph" else None)
    at = lambda z: lambda x: np.isclose(x[2], z)
    where = {1: (at(0), 0), 2: (at(0), 1), 3: at(HEIGHT), 4: at(-HEIGHT)}
    tags = dc.meshes.tag_facets(mesh, where, body)
    if partition == "repartition":
        mesh, tags = dc.repartition(mesh, tags, 1, 2)
    V = compat.vector_space(mesh, 1)
    u, w = fem.Function(V), ufl.TestFunction(V)
    strain = lambda v: ufl.sym(ufl.grad(v))
    F = 800 * ufl.inner(strain(u), strain(w)) * ufl.dx
    dofs = fem.locate_dofs_topological(V, 2, np.sort(np.concatenate([tags.find(3), tags.find(4)])))
    pair = dc.ContactPair(
        dc.Surface(u, tags, 1), dc.Surface(u, tags, 2), friction=friction, target=dc.Smooth()
    )
    problem = dc.ContactProblem(F, u, [pair], bcs=[fem.dirichletbc(np.zeros(3), dofs, V)])
    system = problem.system
    system.start()
    # warped, pressed into one another by 2 % of a facet
    dx, h = np.asarray(V.tabulate_dof_coordinates()), 1 / n
    inside = np.cos(0.5 * np.pi * np.clip(dx[:, 2] / HEIGHT, -1, 1))
    move = np.stack([1e-3 * np.sin(3 * dx[:, 0]), 1e-3 * dx[:, 1], 2e-3 * np.sin(2 * dx[:, 0])], 1)
    u.x.array[:] = (inside[:, None] * move).ravel()
    above = dofs_of(mesh, V, lambda z: z > 0)
    u.x.array[3 * above + 2] -= 0.02 * h
    pair._multiplier.x.array[:] = -1.0
    system.read()
    system.residual(system.x, system.b)
    system.jacobian(system.x, system.A)
    open_ = int(np.sum(~system.contacts[0].assembler.particles()["closed"]))
    if comm.allreduce(open_):
        raise RuntimeError("some particles are open")
    return system, pair


def dofs_of(mesh, V, side):
    """Local block dofs of the cells on one side of the interface."""
    from dolfinx_contact import compat

    nodes = compat.cell_geometry_dofs(mesh)
    cells = side(np.asarray(mesh.geometry.x)[nodes][:, :, 2].mean(axis=1))
    return np.unique(compat.dof_list(V)[cells])


def measure(args) -> None:
    from mpi4py import MPI

    comm, rows = MPI.COMM_WORLD, []
    for partition in PARTITIONS if comm.size > 1 else ("graph",):
        system, pair = make(args.facets, args.friction, partition)
        contact, A, b = system.contacts[0], system.A, system.b

        def residual():
            contact.assembler.residual(b.handle)
            b.assemble()

        def tangent():
            contact.assembler.tangent(A.handle)
            A.assemble()

        work, seconds = (contact.update, residual, tangent), []
        for run in work:
            times = []
            for _ in range(args.runs):
                comm.Barrier()
                start = time.process_time()
                run()
                times.append(comm.allreduce(time.process_time() - start, op=MPI.MAX))
            seconds.append(min(times))
        slave = comm.allgather(len(pair.slave.id))
        rows.append({"partition": partition, "seconds": seconds, "slave": slave})
    if comm.rank == 0:
        print(json.dumps(rows))


if __name__ == "__main__":
    main()
