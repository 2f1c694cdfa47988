# SPDX-License-Identifier: MIT
"""Two cubes pressed together: the same test as two_blocks.py in three dimensions.

Unit cubes with 7 × 7 and 5 × 5 facets on the interface, turned as a whole by an arbitrary rotation
so that no axis of the mesh is one of space. The lower cube's bottom is clamped, the upper one's top
moves by −U0 along the turned vertical axis and ν = 0: the pressure is E U0/2, uniform. Targets are
closest points, the seek direction is not needed.

The meshes are not nested: no node of the master inside the surface falls on the end of a
sub-element of the slave's facets, so Simpson's rules leave an oscillation, which falls with n. With
segments, the polygons in which the facets of both meshes overlap, nothing is left.

It writes demos/pictures/two_cubes.png.
"""

from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import meshes

E, U0 = 1e7, 0.02
exact = 0.5 * E * U0
turn = Rotation.from_euler("xyz", [0.3, 0.5, -0.7]).as_matrix()
up = turn[:, 2]
comm = MPI.COMM_WORLD


def solve(cell: str, rule, picture: Path | None = None) -> tuple[float, float, int]:
    """Oscillation (max − min)/mean, resultant along the axis and Newton iterations."""
    turned = dict(mapping=lambda x: x @ turn.T, cell=cell)
    upper = meshes.grid((7, 7, 3), (0, 0, 0), (1, 1, 1), **turned)
    lower = meshes.grid((5, 5, 3), (0, 0, -1), (1, 1, 0), **turned)
    mesh, body = meshes.create(comm, [upper, lower])
    at = lambda height: lambda x: np.isclose(up @ x, height)  # noqa: E731
    tags = meshes.tag_facets(mesh, {5: (at(0), 0), 6: (at(0), 1), 1: at(1), 2: at(-1)}, body)

    V = dc.vector_space(mesh, 1)
    u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    F = E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(w))) * dx
    dofs = [fem.locate_dofs_topological(V, 2, tags.find(tag)) for tag in (1, 2)]
    bcs = [fem.dirichletbc(-U0 * up, dofs[0], V), fem.dirichletbc(np.zeros(3), dofs[1], V)]

    pair = dc.ContactPair(
        dc.Surface(u, tags, 5), dc.Surface(u, tags, 6), target=dc.Proximity(), integration=rule
    )
    report = dc.ContactProblem(F, u, [pair], bcs=bcs).solve()
    p = pair.pressure.x.array
    low = comm.allreduce(p.min(initial=np.inf), op=MPI.MIN)
    high = comm.allreduce(p.max(initial=-np.inf), op=MPI.MAX)
    force = pair.resultant()
    if picture is not None:
        dc.plot.pressure(pair, picture, title="Two cubes, 7 × 7 on 5 × 5 facets, 1-Simpson")
    return (high - low) / (force @ up), force @ up, report.iterations


if comm.rank == 0:
    print("cells        rule        (max − min)/mean   resultant   Newton iterations")
folder = Path(__file__).parent / "pictures"
rules = {f"{n}-Simpson": dc.Simpson(n) for n in range(3)} | {"segments": dc.Segments()}
for cell in ("hexahedron", "tetrahedron"):
    oscillations = []
    for name, rule in rules.items():
        picture = folder / "two_cubes.png" if (cell, name) == ("hexahedron", "1-Simpson") else None
        oscillation, force, iterations = solve(cell, rule, picture)
        oscillations.append(oscillation)
        if comm.rank == 0:
            print(f"{cell:11s}  {name:9s}  {oscillation:16.2e}   {force:9.1f}   {iterations:17d}")
        assert abs(force / exact - 1) < 1e-3, "the resultant is pressure × area"
    assert oscillations[0] > oscillations[1] > oscillations[2], "it falls with n"
    assert oscillations[3] < 1e-9, "the patch test, to round-off"
