# SPDX-License-Identifier: MIT
"""Thousands of load steps of ironing to and fro: memory must not grow.

An indenter is pressed into a slab of rubber with friction and drawn along it, back and forth, a solve a
step, with the results that a user asks for. The resident memory after 200 steps, when all is warm, is
compared with that at the end. LoadStepping keeps a record of each step, so that it grows a little.

    python3 benchmarks/long_run.py              # 2,000 steps, some minutes
    python3 benchmarks/long_run.py --steps 400
"""

from __future__ import annotations

import argparse
import resource
from pathlib import Path
from typing import Any, Sequence

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2
WARM = 200  # steps after which memory should stay


def resident() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def ironing(comm: MPI.Comm, facets: int) -> tuple[Any, Any, Any]:
    """The problem, its pair, and what moves the top of the indenter to (x, y)."""

    def indenter(x: Any) -> Any:
        """A block whose lower side is bent down by a quarter of its height."""
        return x - np.outer((1 - x[:, 1]) * 0.25 * (1 - x[:, 0] ** 2), (0, 1))

    bodies = [
        meshes.grid((max(4, facets // 4), 4), (-1, 0), (1, 1), indenter),
        meshes.grid((facets, max(2, facets // 6)), (-3, -1.25), (3, -0.25)),
    ]
    mesh, body = meshes.create(comm, bodies)
    at = lambda y: lambda x: np.isclose(x[1], y)  # noqa: E731
    lower = lambda x: (x[1] < 0.01) & (x[1] > -0.26)  # noqa: E731
    where = {SLAVE: (lower, 0), MASTER: (at(-0.25), 1), TOP: at(1), BOTTOM: at(-1.25)}
    tags = meshes.tag_facets(mesh, where, body)
    V = dc.vector_space(mesh, 1)
    u, w = fem.Function(V), ufl.TestFunction(V)
    stiffness = fem.Function(dc.function_space(mesh, ("DG", 0)))
    stiffness.x.array[:] = np.where(body == 0, 10.0, 1.0)
    F = dc.materials.deformation_gradient(u)
    psi = stiffness * dc.materials.neo_hookean(F, *dc.materials.lame(1.0, 0.3))
    form = ufl.derivative(psi * ufl.dx(mesh, metadata={"quadrature_degree": 2}), u, w)
    top = fem.Constant(mesh, np.zeros(2))  # interpolate of DOLFINx 0.5 keeps a little memory
    bcs = [
        fem.dirichletbc(top, fem.locate_dofs_topological(V, 1, tags.find(TOP)), V),
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(BOTTOM)), V),
    ]
    pair = dc.ContactPair(dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER), friction=0.3)

    def place(x: float, y: float) -> None:
        top.value[:] = x, y

    return dc.ContactProblem(form, u, [pair], bcs=bcs), pair, place


def run(comm: MPI.Comm, steps: int, facets: int) -> list[tuple[int, float, float]]:
    """Step, resident memory of all ranks in MB and horizontal force, ten times a run and when warm."""
    problem, pair, place = ironing(comm, facets)
    period = 80  # steps there and back

    def apply(t: float) -> None:
        way = 4 * abs((t / period) % 1 - 0.5) - 1  # 1 to −1 and back
        place(1.2 * (1 - way), -0.15 * min(t / 5, 1))

    rows = []
    stepping = dc.LoadStepping(problem, apply, end=float(steps), step=1.0, progress=False)
    for step in stepping:
        force = pair.resultant()
        pair.particles, pair.contact_area(), pair.dissipated_energy()
        if step.number == WARM or step.number % max(1, steps // 10) == 0:
            rows.append((step.number, comm.allreduce(resident()), float(force[0])))
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=2000, help="load steps (2000)")
    parser.add_argument("--facets", type=int, default=60, help="facets along the slab (60)")
    options = parser.parse_args(arguments)
    rows = run(MPI.COMM_WORLD, options.steps, options.facets)
    if MPI.COMM_WORLD.rank == 0:
        print("  step   resident, MB   horizontal force")
        for number, memory, force in rows:
            print(f"{number:6d} {memory:14.2f} {force:18.4f}")
        warm = next(memory for number, memory, _ in rows if number >= WARM)
        print(f"growth since step {WARM}: {100 * (rows[-1][1] / warm - 1):.2f} %")


if __name__ == "__main__":
    main()
