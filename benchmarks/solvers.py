# SPDX-License-Identifier: MIT
"""solvers.iterative() against MUMPS: iterations, time and memory as a problem grows.

A neo-Hookean block on a wider one, hexahedra of degree 1, non-matching, pressed and sheared with
friction: parts stick, parts slip. Each run is a process of its own, which tells its largest resident
memory. Linear time is the wall time of a solve less that of residuals and Jacobians.

    python3 benchmarks/solvers.py                       # 2e4 to 4e5 displacement dofs; an hour
    python3 benchmarks/solvers.py --sizes 18 28         # minutes
    python3 benchmarks/solvers.py --small               # what CI runs, in one process: peaks add up

MUMPS is stopped after two of Newton's iterations above 1e5 dofs, unless --all is given.
"""

from __future__ import annotations

import argparse
import json
import logging
import subprocess
import sys
from typing import Any, Sequence

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from memory import peak
from plates import neo_hookean
from scaling import table

import dolfinx_contact as dc
from dolfinx_contact import meshes

SIZES = (18, 28, 50)  # cells along the side of a block
PRESS, SHEAR = 0.01, 0.001  # displacement of the top
KINDS = ("direct", "iterative")


def blocks(n: int, friction: float | None, options: dict[str, Any], **strategy: Any) -> Any:
    """The problem and its pair; no pair with friction None.

    Args:
        n: cells along a side of each block; half as many along its height
        options: of PETSc
        strategy: arguments of Newton
    """
    bodies = [
        meshes.grid((n, n, n // 2), (0.1, 0.1, 0), (0.9, 0.9, 0.5), cell="hexahedron"),
        meshes.grid((n, n, n // 2), (0, 0, -0.5), (1, 1, 0), cell="hexahedron"),
    ]
    mesh, body = meshes.create(MPI.COMM_WORLD, bodies)
    at = lambda z: lambda x: np.isclose(x[2], z)  # noqa: E731
    where = {1: (at(0), 0), 2: (at(0), 1), 3: at(0.5), 4: at(-0.5)}
    tags = meshes.tag_facets(mesh, where, body)
    V = dc.vector_space(mesh, 1)
    u, w = fem.Function(V), ufl.TestFunction(V)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    form = ufl.derivative(neo_hookean(u) * dx, u, w)
    bcs = [
        fem.dirichletbc(np.array(value), fem.locate_dofs_topological(V, 2, tags.find(tag)), V)
        for tag, value in ((3, (SHEAR, 0.0, -PRESS)), (4, (0.0, 0.0, 0.0)))
    ]
    pairs = []
    if friction is not None:
        surfaces = dc.Surface(u, tags, 1), dc.Surface(u, tags, 2)
        pairs = [dc.ContactPair(*surfaces, friction=friction)]
    newton = dc.Newton(**strategy)
    return (
        dc.ContactProblem(form, u, pairs, bcs=bcs, strategy=newton, petsc_options=options),
        pairs,
    )


def run(n: int, kind: str, friction: float, max_it: int) -> dict[str, Any]:
    """One solve in this process; on several ranks memory is that of all."""
    comm = MPI.COMM_WORLD
    options = getattr(dc.solvers, kind)()
    problem, pairs = blocks(n, friction if friction >= 0 else None, options, max_it=max_it)
    try:
        report = problem.solve()
    except dc.ConvergenceError as error:  # of runs that are cut short
        report = error.report
        if report.iterations < max_it:
            raise
    time = report.time
    force = pairs[0].resultant() if pairs and report.converged else np.zeros(3)
    return {
        "dofs": problem.u[0].function_space.dofmap.index_map.size_global * 3,
        "converged": report.converged,
        "newton": report.iterations,
        "linear": report.linear_iterations,
        "seconds": time["total"],
        "linear_seconds": time["total"] - time["residual"] - time["jacobian"],
        "peak": comm.allreduce(peak()),
        "force": list(force),
    }


def in_a_process_of_its_own(*arguments: Any) -> dict[str, Any]:
    command = [sys.executable, __file__, "--child", *map(str, arguments)]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(out.splitlines()[-1])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="cells along a side")
    parser.add_argument("--friction", type=float, nargs="+", default=(0.0, 0.3))
    parser.add_argument("--small", action="store_true", help="what CI runs, in one process")
    parser.add_argument("--all", action="store_true", help="let MUMPS run to the end")
    parser.add_argument("--output", help="a file for the tables, in Markdown")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.small:
        options.sizes, options.friction = (6, 10), (0.3,)
    measure = run if options.small else in_a_process_of_its_own
    if options.child:
        n, kind, friction, max_it = options.child
        result = run(int(n), kind, float(friction), int(max_it))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(result))
        return
    head = ["dofs", "friction", "solver", "Newton", "iterations, mean", "largest"]
    head += ["s a linear solve", "s in all", "peak, MB"]
    rows: list[list[str]] = []
    means: dict[float, list[float]] = {}
    for n in options.sizes:
        for friction in options.friction:
            found = {}
            for kind in KINDS:
                short = kind == "direct" and n > 32 and not options.all
                one = measure(n, kind, friction, 2 if short else 50)
                found[kind] = one
                linear = np.array(one["linear"])
                rows.append(
                    [
                        f"{one['dofs']}",
                        f"{friction:g}",
                        kind,
                        f"{one['newton']}" if one["converged"] else f"{one['newton']}, cut short",
                        f"{linear.mean():.1f}",
                        f"{linear.max()}",
                        f"{one['linear_seconds'] / one['newton']:.2f}",
                        f"{one['seconds']:.1f}",
                        f"{one['peak']:.0f}",
                    ]
                )
                print("  ".join(rows[-1]), file=sys.stderr, flush=True)
            means.setdefault(friction, []).append(np.mean(found["iterative"]["linear"]))
            if found["direct"]["converged"]:
                forces = np.array([found[kind]["force"] for kind in KINDS])
                # Newton ends at 1e-10 of the forces: that leaves four digits to soft bodies
                if np.abs(forces[0] - forces[1]).max() > 1e-6 * np.abs(forces).max():
                    raise RuntimeError(f"The solvers disagree: {forces}")
    alone = measure(options.sizes[-1], "iterative", -1, 50)
    lines = ["# Linear solvers", "", "By `benchmarks/solvers.py`; see docs/solvers.md.", ""]
    lines += [table(head, rows), ""]
    for friction, mean in means.items():
        lines.append(
            f"Friction {friction:g}: from the smallest to the largest the mean number of iterations"
            f" grows {mean[-1] / mean[0]:.2f} times.  "
        )
    contact = float(rows[-1][-1])
    lines.append(
        f"The bulk alone, without contact, by the iterative preset: {alone['peak']:.0f} MB at"
        f" {alone['dofs']} dofs, {np.mean(alone['linear']):.1f} iterations; with contact"
        f" {contact / alone['peak']:.2f} times the memory."
    )
    text = "\n".join(lines) + "\n"
    print(text)
    if options.output:
        with open(options.output, "w") as file:
            file.write(text)


if __name__ == "__main__":
    logging.disable(logging.WARNING)  # of FFCx, that it compiles
    main()
