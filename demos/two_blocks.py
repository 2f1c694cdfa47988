# SPDX-License-Identifier: MIT
"""Two blocks pressed together: the integration of contact on non-matching meshes.

The problem is Taylor and Papadopoulos's patch test as used by Ben Dhia and Zarroug (2002, section
4.2, Figure 9). One block, [−1, 1] × [0, 1], is pressed on another, [−1, 1] × [−1, 0], by a vertical
displacement U0 of its top; the bottom is clamped, ν = 0 and there is no friction. The exact
solution is a uniform state: the contact pressure is E U0/2 = 1.2e5 everywhere.

The interface has 11 facets on the slave side (the upper block) and 8 on the master side. The
contact terms of the weak form multiply functions of both meshes, which are smooth on the pieces
between the nodes of *both*. A rule that only knows the slave's facets integrates across the
master's nodes, hence the pressure oscillates. The more particles a facet carries, the less:
n-Simpson divides each facet into 2ⁿ parts. Segments divide it where the master has its nodes: the
integrals are exact, and the pressure is uniform to round-off.

Run it with `make demo`, or `python3 demos/two_blocks.py` once the package is installed, alone or
under mpirun. `--mesh FILE` is a .msh file of two other blocks by Gmsh, with physical surfaces, and the
physical curves 5 (slave, the lower side of the upper block), 6 (master, the upper side of the lower
block), 1 (top) and 2 (bottom); what is asserted then is that contact carries the force. It writes demos/pictures/two_blocks.png, and in demos/output/two_blocks a table of
the rules, rules.csv, and for each of them a folder of .xdmf files for ParaView.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--mesh", help="a .msh file of both blocks; see above for its groups")
args = parser.parse_args()

E, U0 = 1e7, 0.024
exact = 0.5 * E * U0
comm = MPI.COMM_WORLD
here = Path(__file__).parent

# -- the two bodies: one mesh, whose blocks share no nodes -------------------------------------------

SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2
if args.mesh:
    groups = {SLAVE: "slave", MASTER: "master", TOP: "top", BOTTOM: "bottom"}
    mesh, _, facet_tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)
else:
    upper = meshes.grid((11, 4), (-1, 0), (1, 1))
    lower = meshes.grid((8, 4), (-1, -1), (1, 0))
    mesh, body = meshes.create(comm, [upper, lower])
    facet_tags = meshes.tag_facets(
        mesh,
        {
            SLAVE: (lambda x: np.isclose(x[1], 0), 0),
            MASTER: (lambda x: np.isclose(x[1], 0), 1),
            TOP: lambda x: np.isclose(x[1], 1),
            BOTTOM: lambda x: np.isclose(x[1], -1),
        },
        body,
    )

# -- the bulk, in UFL: linear elasticity with ν = 0 ---------------------------------------------------

V = dc.vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
strain = lambda v: ufl.sym(ufl.grad(v))  # noqa: E731
dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
F = E * ufl.inner(strain(u), strain(w)) * dx

# The bottom is clamped, the top moves down and is free to slide sideways but for its leftmost node.
bottom = fem.locate_dofs_topological(V, 1, facet_tags.find(BOTTOM))
top = fem.locate_dofs_topological(V.sub(1), 1, facet_tags.find(TOP))
x = V.tabulate_dof_coordinates()[top // 2]
left = min(comm.allgather(min(x[:, :2].tolist(), default=[np.inf, np.inf])))
V_x, _ = V.sub(0).collapse()
still = fem.Function(V_x)
one_node = fem.locate_dofs_geometrical(
    (V.sub(0), V_x), lambda x: np.isclose(x[0], left[0]) & np.isclose(x[1], left[1])
)
bcs = [
    fem.dirichletbc(np.zeros(2), bottom, V),
    fem.dirichletbc(-U0, top, V.sub(1)),
    fem.dirichletbc(still, one_node, V.sub(0)),
]
# The force on the top is the work of F in a displacement that is 1 there, 0 at all other nodes.
lifted = fem.Function(V)
lifted.x.array[top] = 1
on_top = fem.form(ufl.replace(F, {w: lifted}))

# -- contact, with five rules ----------------------------------------------------------------------

rules = {
    "nodes": dc.Nodes(),
    "0-Simpson": dc.Simpson(0),
    "1-Simpson": dc.Simpson(1),
    "2-Simpson": dc.Simpson(2),
    "segments": dc.Segments(),
}
expected = {"nodes": 0.118, "0-Simpson": 0.0835, "1-Simpson": 0.0328, "2-Simpson": 0.0099}
curves = {}
table = dc.Table(here / "output" / "two_blocks" / "rules.csv")
if comm.rank == 0:
    print("rule        (max − min)/mean   mean pressure    Newton iterations")
for name, rule in rules.items():
    u.x.array[:] = 0
    pair = dc.ContactPair(
        dc.Surface(u, facet_tags, SLAVE),
        dc.Surface(u, facet_tags, MASTER),
        target=dc.SeekDirection((0, 1)),
        integration=rule,
    )
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    report = problem.solve()

    force = pair.resultant()
    load = -comm.allreduce(fem.assemble_scalar(on_top))
    assert abs(force[1] / load - 1) < 1e-8, "contact carries what the top is pushed with"
    dc.Writer(here / "output" / "two_blocks" / name, u, pair).write(U0)
    area = pair.contact_area()
    table.write(rule=name, force=force, area=area, iterations=report.iterations)
    curve = dc.plot.gather_pressure(pair)  # on rank 0
    if curve is not None:
        x, p = curve[0][:, :, 0].ravel(), curve[1].ravel()
        order = np.argsort(x)
        curves[name] = x[order], p[order]
        mean = force[1] / area
        oscillation = np.ptp(p) / mean
        print(f"{name:10s}  {oscillation:16.2e}   {mean:13.1f}    {report.iterations:17d}")
        if args.mesh:
            continue
        if name == "segments":
            assert np.abs(p / exact - 1).max() < 1e-9, "the patch test, to round-off"
        else:
            assert abs(oscillation / expected[name] - 1) < 0.04, "the oscillation of benchmarks.md"
        assert abs(mean / exact - 1) < 0.02

# -- the paper's Figure 9 --------------------------------------------------------------------------

if comm.rank == 0:
    figure = Figure(figsize=(8, 4.6), constrained_layout=True)
    axes = figure.add_subplot()
    for (name, (x, p)), style in zip(curves.items(), ("^:", "s--", "o-.", "D-", "k.-")):
        labels = dict(xlabel="position along the interface", ylabel="contact pressure")
        dc.plot.history(x, {name: p}, style=style, axes=axes, **labels)
    if args.mesh:
        axes.set_title("Two blocks: pressure by integration rule")
    else:
        axes.axhline(exact, color="k", linewidth=0.8, label="exact")
        axes.set_title("Two blocks, 11 slave and 8 master facets: pressure by integration rule")
    axes.legend(ncol=3, fontsize=9)
    file = here / "pictures" / "two_blocks.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)
