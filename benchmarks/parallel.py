# SPDX-License-Identifier: MIT
"""Contact work on several ranks: the largest CPU time of a rank, in one line.

The plates of plates.py on one of these partitions:

* ``strips``: both surfaces and the bulk are split evenly, along x;
* ``graph``: DOLFINx's own;
* ``one body``: all slave facets are on rank 0, with the slave's plate from its contact side on; the
  bulk is split evenly;
* ``repartition``: that one, divided anew by dc.repartition.

Ranks wait for each other before each part of the work (search, residual, tangent with what PETSc
sends), and CPU time is measured in between: ranks may share cores. What waiting costs is not in it, as
it would not be if each rank had a core.

    mpirun -n 2 python3 benchmarks/parallel.py --partition repartition
    python3 benchmarks/parallel.py --compare 2     # all partitions on 2 ranks, and their gain over 1
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt


def strips(x: npt.NDArray[Any], ranks: int) -> npt.NDArray[Any]:
    """Of equal width along x, by the cells' mean points (cells, 3)."""
    return np.minimum((x[:, 0] * ranks).astype(int), ranks - 1)


def slabs(x: npt.NDArray[Any], ranks: int) -> npt.NDArray[Any]:
    """Of equally many cells: the slave's plate from its contact side on, then the other one."""
    away = np.where(x[:, 2] > 0, x[:, 2], 1 - x[:, 2])
    rank = np.empty(len(x), dtype=int)
    rank[np.argsort(away, kind="stable")] = np.arange(len(x)) * ranks // len(x)
    return rank


PARTITIONS = {"strips": strips, "graph": None, "one body": slabs, "repartition": slabs}


def slowest(comm: Any, run: Callable[[], object], before: Callable[[], object] | None) -> float:
    """CPU time of the rank that needs most. Collective."""
    if before is not None:
        before()
    comm.Barrier()
    start = time.process_time()
    run()
    spent = time.process_time() - start
    return max(comm.allgather(spent))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Seconds of each run of each part, and numbers of slave facets on the ranks. Collective."""
    from mpi4py import MPI
    from plates import VARIANTS, Plates

    comm = MPI.COMM_WORLD
    plates = Plates(
        options.facets,
        options.layers,
        VARIANTS[options.variant],
        comm=comm,
        partition=PARTITIONS[options.partition],
        repartition=options.partition == "repartition",
    )
    plates.press()
    parts: dict[str, tuple[Callable[[], object], Callable[[], object] | None]] = {
        "search": (plates.search, plates.move),
        "residual": (plates.residual, None),
        "tangent": (plates.tangent, None),
        "bulk residual": (plates.bulk_residual, None),
        "bulk Jacobian": (plates.bulk_jacobian, None),
    }
    seconds: dict[str, Any] = {name: [] for name in parts}
    for _ in range(options.runs):
        for name, (run, before) in parts.items():
            seconds[name].append(slowest(comm, run, before))
    seconds["slave facets"] = comm.allgather(plates.contact.assembler.own)
    return seconds


def contact(seconds: dict[str, Any]) -> npt.NDArray[Any]:
    return np.sum([seconds[name] for name in ("search", "residual", "tangent")], axis=0)


def bulk(seconds: dict[str, Any]) -> npt.NDArray[Any]:
    return np.sum([seconds[name] for name in ("bulk residual", "bulk Jacobian")], axis=0)


def line(seconds: dict[str, Any]) -> str:
    c, b = contact(seconds), bulk(seconds)
    parts = ", ".join(
        f"{k} {1e3 * min(seconds[k]):.1f}" for k in ("search", "residual", "tangent")
    )
    return (
        f"{len(seconds['slave facets'])} ranks, slave facets {seconds['slave facets']}:"
        f" contact {1e3 * c.min():.1f} ms ({parts}; spread {100 * (c.max() / c.min() - 1):.0f} %),"
        f" bulk {1e3 * b.min():.1f} ms"
    )


def run_on(ranks: int, arguments: Sequence[str]) -> dict[str, Any]:
    """``measure`` in processes of its own."""
    command = ["mpirun", "-n", str(ranks), sys.executable, __file__, "--json", *arguments]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(out.strip().splitlines()[-1])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=60, help="slave facets along a side (60)")
    parser.add_argument("--layers", type=int, default=2, help="layers of cells a plate (2)")
    parser.add_argument("--variant", default="smooth, friction", help="see plates.py")
    parser.add_argument("--runs", type=int, default=5, help="runs of which the least counts (5)")
    parser.add_argument("--partition", choices=PARTITIONS, default="strips")
    parser.add_argument(
        "--compare", type=int, metavar="RANKS", help="1 rank, then all partitions on RANKS"
    )
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.compare:
        given = [f"--{k}={getattr(options, k)}" for k in ("facets", "layers", "variant", "runs")]
        one = run_on(1, given)
        print(line(one))
        for partition in PARTITIONS:
            several = run_on(options.compare, [*given, "--partition", partition])
            gains = [bulk(one).min() / bulk(several).min(), contact(one).min() / contact(several)]
            print(
                line(several),
                f"{partition}: contact is {gains[1].min():.2f} to {gains[1].max():.2f} times faster"
                f" than on 1 rank, the bulk {gains[0]:.2f}",
                sep="\n",
                flush=True,
            )
        return

    seconds = measure(options)
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(seconds) if options.json else line(seconds))


if __name__ == "__main__":
    main()
