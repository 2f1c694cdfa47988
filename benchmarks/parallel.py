# SPDX-License-Identifier: MIT
"""Contact work on several ranks: the largest CPU time of a rank, in one line.

The plates of plates.py. Both surfaces and the bulk are split evenly, in strips along x; with
``--unbalanced`` the bulk is split evenly, in slabs, and all slave facets are on rank 0. Ranks wait for
each other before each part of the work (search, residual, tangent with what PETSc sends), and CPU
time is measured in between: ranks may share cores. What waiting costs is not in it, as it would not
be if each rank had a core.

    python3 benchmarks/parallel.py
    mpirun -n 2 python3 benchmarks/parallel.py [--unbalanced]
    python3 benchmarks/parallel.py --compare 2     # both, and the ratios of 1 rank to 2
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
        partition=slabs if options.unbalanced else strips,
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
    parser.add_argument("--unbalanced", action="store_true", help="all slave facets on rank 0")
    parser.add_argument("--compare", type=int, metavar="RANKS", help="run on 1 rank and on RANKS")
    parser.add_argument("--at-least", type=float, help="with --compare: error if gained less")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.compare:
        given = list(sys.argv[1:] if arguments is None else arguments)
        for flag in ("--compare", "--at-least"):
            if flag in given:
                at = given.index(flag)
                del given[at : at + 2]
        one, several = run_on(1, given), run_on(options.compare, given)
        gain = contact(one).min() / contact(several).min()
        print(line(one), line(several), sep="\n")
        print(
            f"contact is {gain:.2f} times faster, the bulk {bulk(one).min() / bulk(several).min():.2f}"
        )
        if options.at_least is not None and gain < options.at_least:
            raise SystemExit(f"contact gains {gain:.2f} times, not {options.at_least}")
        return

    seconds = measure(options)
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(seconds) if options.json else line(seconds))


if __name__ == "__main__":
    main()
