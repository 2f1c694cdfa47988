# SPDX-License-Identifier: MIT
"""Peak memory of a whole run with contact, against the bulk alone.

The plates of plates.py, pressed by a prescribed displacement and solved by Newton's method. The bulk
alone is the same mesh, model and solver, with a pressure on both sides of the interface instead of
contact. Each runs in a process of its own, which tells its largest resident memory (ru_maxrss): that
of the interpreter with DOLFINx is in both, and given beside.

    python3 benchmarks/memory.py --solver iterative
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from typing import Sequence

import dolfinx_contact as dc

MOVE = (0.0, 0.0, -0.002)
PRESSURE = 3.5  # about that of MOVE


def peak() -> float:
    """Largest resident memory of this process so far, in MB (Linux counts in kB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def solve(options: argparse.Namespace) -> str:
    """One run in this process: peaks before and after in MB, CPU seconds, dofs, iterations."""
    from plates import VARIANTS, Plates

    before, start = peak(), time.process_time()
    contact = None if options.alone else VARIANTS[options.variant]
    solver = getattr(dc.solvers, options.solver)()
    plates = Plates(
        options.facets, options.layers, contact, move=MOVE, load=PRESSURE, options=solver
    )
    report = plates.problem.solve()
    spent = time.process_time() - start
    return f"{before} {peak()} {spent} {plates.dofs} {report.iterations}"


def in_a_process_of_its_own(arguments: Sequence[str]) -> list[float]:
    command = [sys.executable, __file__, "--child", *arguments]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return [float(word) for word in out.split()[-5:]]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=32, help="slave facets along a side (32)")
    parser.add_argument("--layers", type=int, default=8, help="layers of cells a plate (8)")
    parser.add_argument("--variant", default="smooth, friction", help="see plates.py")
    parser.add_argument("--solver", choices=("direct", "iterative"), default="direct")
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        print(solve(options))
        return
    given = list(sys.argv[1:] if arguments is None else arguments)
    contact = in_a_process_of_its_own(given)
    alone = in_a_process_of_its_own([*given, "--alone"])
    for name, (before, after, seconds, dofs, iterations) in (
        ("bulk alone", alone),
        (f"contact, {options.variant}", contact),
    ):
        print(
            f"{name:26} {after:8.0f} MB, {before:.0f} of it before anything is made;"
            f" {dofs:.0f} displacement dofs, {iterations:.0f} iterations, {seconds:.1f} s of CPU"
        )
    ratio = contact[1] / alone[1]
    above = (contact[1] - contact[0]) / (alone[1] - alone[0])
    print(f"ratio of peaks: {ratio:.3f}; of what is above the start {above:.3f}")


if __name__ == "__main__":
    main()
