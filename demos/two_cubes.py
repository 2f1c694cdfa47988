# SPDX-License-Identifier: MIT
"""Two cubes pressed together: the same test as two_blocks.py in three dimensions.

Unit cubes with 7 × 7 and 5 × 5 facets on the interface, turned as a whole by an arbitrary rotation
so that no axis of the mesh is one of space. The lower cube's bottom is clamped, the upper one's top
moves by −U0 along the turned vertical axis and ν = 0: the pressure is E U0/2, uniform. Targets are
closest points, the seek direction is not needed.

The meshes are not nested: no node of the master inside the surface falls on the end of a
sub-element of the slave's facets, so Simpson's rules leave an oscillation, which falls with n. With
segments, the polygons in which the facets of both meshes overlap, nothing is left.

Run it with `python3 demos/two_cubes.py`, alone or under mpirun. `--mesh FILE` is a .msh file of two other
bodies by Gmsh, one above the other along z, with physical volumes, and the physical surfaces 5 (slave,
the lower side of the upper body), 6 (master, the upper side of the lower body), 1 (top) and 2 (bottom);
what is asserted then is that contact carries the force. It writes demos/pictures/two_cubes.png.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import meshes

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--mesh", help="a .msh file of both bodies; see above for its groups")
args = parser.parse_args()

E, U0 = 1e7, 0.02
exact = 0.5 * E * U0
turn = np.eye(3) if args.mesh else Rotation.from_euler("xyz", [0.3, 0.5, -0.7]).as_matrix()
up = turn[:, 2]
comm = MPI.COMM_WORLD
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2


def cubes(cell: str):
    """Both cubes, and tags of their facets."""
    turned = dict(mapping=lambda x: x @ turn.T, cell=cell)
    upper = meshes.grid((7, 7, 3), (0, 0, 0), (1, 1, 1), **turned)
    lower = meshes.grid((5, 5, 3), (0, 0, -1), (1, 1, 0), **turned)
    mesh, body = meshes.create(comm, [upper, lower])
    at = lambda height: lambda x: np.isclose(up @ x, height)  # noqa: E731
    places = {SLAVE: (at(0), 0), MASTER: (at(0), 1), TOP: at(1), BOTTOM: at(-1)}
    return mesh, meshes.tag_facets(mesh, places, body)


def solve(mesh, tags, rule, picture: Path | None = None) -> tuple[float, float, int]:
    """Oscillation (max − min)/mean, resultant along the axis and Newton iterations."""
    V = dc.vector_space(mesh, 1)
    u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    F = E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(w))) * dx
    dofs = [fem.locate_dofs_topological(V, 2, tags.find(tag)) for tag in (TOP, BOTTOM)]
    bcs = [fem.dirichletbc(-U0 * up, dofs[0], V), fem.dirichletbc(np.zeros(3), dofs[1], V)]

    pair = dc.ContactPair(
        dc.Surface(u, tags, SLAVE),
        dc.Surface(u, tags, MASTER),
        target=dc.Proximity(),
        integration=rule,
    )
    report = dc.ContactProblem(F, u, [pair], bcs=bcs).solve()
    p = pair.pressure.x.array
    low = comm.allreduce(p.min(initial=np.inf), op=MPI.MIN)
    high = comm.allreduce(p.max(initial=-np.inf), op=MPI.MAX)
    force = pair.resultant()
    # the force on the top is the work of F in a displacement that is 1 there, 0 at all other nodes
    lifted = fem.Function(V)
    lifted.x.array.reshape(-1, 3)[dofs[0]] = up
    load = -comm.allreduce(fem.assemble_scalar(fem.form(ufl.replace(F, {w: lifted}))))
    assert abs(force @ up / load - 1) < 1e-8, "contact carries what the top is pushed with"
    if picture is not None:
        title = (
            "Two cubes, 1-Simpson" if args.mesh else "Two cubes, 7 × 7 on 5 × 5 facets, 1-Simpson"
        )
        dc.plot.pressure(pair, picture, title=title)
    return (high - low) / ((force @ up) / pair.contact_area()), force @ up, report.iterations


groups = {SLAVE: "slave", MASTER: "master", TOP: "top", BOTTOM: "bottom"}
if args.mesh:
    mesh, _, tags = meshes.read_msh(comm, args.mesh, 3, facets=groups)
    bodies = {mesh.topology.cell_name(): (mesh, tags)}
else:
    bodies = {cell: cubes(cell) for cell in ("hexahedron", "tetrahedron")}


if comm.rank == 0:
    print("cells        rule        (max − min)/mean   resultant   Newton iterations")
folder = Path(__file__).parent / "pictures"
rules = {f"{n}-Simpson": dc.Simpson(n) for n in range(3)} | {"segments": dc.Segments()}
for cell, (mesh, tags) in bodies.items():
    oscillations = []
    for name, rule in rules.items():
        shown = name == "1-Simpson" and cell == list(bodies)[0]
        picture = folder / "two_cubes.png" if shown else None
        oscillation, force, iterations = solve(mesh, tags, rule, picture)
        oscillations.append(oscillation)
        if comm.rank == 0:
            print(f"{cell:11s}  {name:9s}  {oscillation:16.2e}   {force:9.1f}   {iterations:17d}")
        assert args.mesh or abs(force / exact - 1) < 1e-3, "the resultant is pressure × area"
    if args.mesh:
        break
    assert oscillations[0] > oscillations[1] > oscillations[2], "it falls with n"
    assert oscillations[3] < 1e-9, "the patch test, to round-off"
