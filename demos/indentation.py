# SPDX-License-Identifier: MIT
"""A steel block indented by a ball that a force drives, loaded and unloaded.

The ball's way is an unknown: it starts above the block, is brought to it along its load, and then goes
as deep as the force takes it. Elastic-plastic in large strains, E = 200 GPa, ν = 0.3, σ_y = 300 MPa,
linear hardening; axisymmetric, without friction. The force is reached to 1e-9 in each step. An elastic
block would follow Hertz's law, F = 4/3 E/(1 − ν²) √R δ^(3/2) (the ball is rigid); this one yields
below the surface at 0.1 % of the load. Under the full load the mean pressure is 2.8 to 3 times the
flow stress at the contact's edge (Tabor 1951), for the strains here some 3.2 σ_y; after unloading the
imprint stays, less the elastic recovery.

Run it with `python3 demos/indentation.py`, alone or under mpirun. `--cells` sets the elements along
each side. `--mesh FILE` is a .msh file of another block by Gmsh, in r = x ≥ 0 below y = 0, with a
physical surface, and the physical curves 5 (its upper side), 1 (on the axis) and 2 (the bottom); Tabor's
pressure and the recovery are not asserted then. It writes demos/pictures/indentation.png.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes, plasticity

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--cells", type=int, default=32, help="elements along each side")
parser.add_argument("--mesh", help="a .msh file of the block; see above for its groups")
args = parser.parse_args()

comm = MPI.COMM_WORLD
E, nu, yields, R, SIZE, GAP, LOAD = 2e5, 0.3, 300.0, 5.0, 8.0, 0.2, 4000.0  # N, mm
CONTACT, AXIS, BOTTOM = 5, 1, 2


def graded(x):
    """Small elements below the ball: the sides are divided in the ratio of x^1.7."""
    return np.column_stack([SIZE * x[:, 0] ** 1.7, -SIZE * (1 - x[:, 1]) ** 1.7])


if args.mesh:
    groups = {CONTACT: "upper side", AXIS: "axis", BOTTOM: "bottom"}
    mesh, _, tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)
else:
    n = args.cells
    mesh, _ = meshes.create(comm, [meshes.grid((n, n), mapping=graded)])
    tags = meshes.tag_facets(
        mesh,
        {
            CONTACT: lambda x: np.isclose(x[1], 0),
            AXIS: lambda x: np.isclose(x[0], 0),
            BOTTOM: lambda x: np.isclose(x[1], -SIZE),
        },
    )
V = dc.vector_space(mesh, 2)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
hardening = plasticity.Linear(yields, 1000.0)
steel = plasticity.J2(u, E, nu, hardening, quadrature_degree=4, kind="axisymmetric")
bcs = []
for component, tag in ((0, AXIS), (1, BOTTOM)):
    dofs = fem.locate_dofs_topological(V.sub(component), 1, tags.find(tag))
    bcs.append(fem.dirichletbc(0.0, dofs, V.sub(component)))

ball = dc.RigidSphere((0, R + GAP), R)
ball.push((0, -1.0))
pair = dc.ContactPair(dc.Surface(u, tags, CONTACT), ball, axisymmetric=True)
problem = dc.ContactProblem(steel.work(w), u, [pair], bcs=bcs, materials=[steel])


def force(t):
    """Up to the full load at t = 1, and down to a hundredth of it at t = 2."""
    return LOAD * (t**2 if t <= 1 else 1 - 0.99 * (t - 1))


rows = [(0.0, 0.0, 0.0, 0)]
stepping = dc.LoadStepping(
    problem, lambda t: ball.push((0, -force(t)), along=(0, 1)), end=2.0, step=0.05, progress=False
)
for step in stepping:
    reached, depth = ball.force()[1], -ball.translation[1] - GAP
    assert abs(reached / force(step.time) - 1) < 1e-9, "the force is the load"
    rows.append((depth, reached, pair.contact_area(), step.report.iterations))
depth, load, area, iterations = np.array(rows).T

# -- picture and assertions ---------------------------------------------------------------------------

cells = mesh.topology.index_map(2).size_local
strain = steel.values(steel.plastic_strain).reshape(cells, -1).mean(axis=1)
imprint = dc.plot.gather_bodies(u, strain)

if comm.rank == 0:
    hertz = 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * np.maximum(depth, 0) ** 1.5
    top = np.argmax(load)
    pressure = load[top] / area[top]
    print(
        f"{len(rows) - 1} steps, {iterations[1:].mean():.1f} iterations a step; depth {depth[top]:.4f} mm"
        f" under {load[top]:.0f} N, mean pressure {pressure / yields:.2f} σ_y, imprint"
        f" {depth[-1]:.4f} mm"
    )
    figure = Figure(figsize=(10, 4.2), constrained_layout=True)
    left, right = figure.subplots(1, 2)
    title = "The imprint after unloading"
    dc.plot.bodies(imprint, title=title, label="plastic strain", axes=left)
    angle = np.linspace(0, 0.5, 50)
    left.plot(R * np.sin(angle), R - depth[-1] - R * np.cos(angle), "k")
    left.set_xlim(0, 2.2)
    left.set_ylim(-1.5, 0.5)
    curve = {"loaded and unloaded": load}
    dc.plot.history(depth, curve, xlabel="depth of the ball [mm]", ylabel="force [N]", axes=right)
    right.plot(depth[: top + 1], hertz[: top + 1], "k--", linewidth=0.8, label="Hertz, elastic")
    right.set_ylim(0, 1.1 * LOAD)
    right.legend()
    file = Path(__file__).parent / "pictures" / "indentation.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=110)
    print("picture:", file)

    # elastic recovery of a flat circular contact of the radius a: F (1 − ν²)/(2 a E)
    recovery = load[top] * (1 - nu**2) / (2 * E * np.sqrt(area[top] / np.pi))
    print(f"elastic recovery {depth[top] - depth[-1]:.4f} mm, of a flat punch {recovery:.4f} mm")
    if not args.mesh:
        assert 2.8 < pressure / yields < 3.6, "Tabor's mean pressure"
        assert 1 < (depth[top] - depth[-1]) / recovery < 2.0, "of the order of a flat punch's"
