# SPDX-License-Identifier: MIT
"""A block pushed up a rigid wedge: Coulomb friction against the angle of the slope.

A block, 2 × 1, E = 200, ν = 0.3, in plane strain, rests on a rigid plane of slope tan α = 0.1. Its
top is pressed down by 0.04, then pushed uphill. Once every particle that touches slips, the
resultant of contact makes the angle of friction with the normal of the slope, thus

    R_x/R_y = (μ + tan α)/(1 − μ tan α) = 0.631579,    μ = 0.5,

whatever the pressures are. The block starts at rest and sticks; as it is pushed, slip spreads from
the rear until all of it slides. The plane is a `RigidPlane`: a tool without unknowns.

Run it with `python3 demos/wedge.py`, alone or under mpirun. `--mesh FILE` is a .msh file of another block
by Gmsh whose lower side lies on the slope, y = x/10, with a physical surface, and the physical curves 5
(the lower side) and 1 (the top). It writes demos/pictures/wedge.png.
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
parser.add_argument("--mesh", help="a .msh file of the block; see above for its groups")
args = parser.parse_args()

comm = MPI.COMM_WORLD
E, nu, mu, slope = 200.0, 0.3, 0.5, 0.1
exact = (mu + slope) / (1 - mu * slope)
SLAVE, TOP = 5, 1

# -- the block, whose lower side follows the slope ---------------------------------------------------


def sheared(x):
    return np.column_stack([x[:, 0], x[:, 1] + slope * x[:, 0] * (1 - x[:, 1])])


if args.mesh:
    groups = {SLAVE: "lower side", TOP: "top"}
    mesh, _, facet_tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)
else:
    mesh, _ = meshes.create(comm, [meshes.grid((24, 12), (0, 0), (2, 1), sheared)])
    facet_tags = meshes.tag_facets(
        mesh, {SLAVE: lambda x: np.isclose(x[1], slope * x[0]), TOP: lambda x: np.isclose(x[1], 1)}
    )
V = dc.vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
psi = dc.materials.small_strain(u, *dc.materials.lame(E, nu))
F = ufl.derivative(psi * ufl.dx, u, w)
push = fem.Function(V)
bcs = [fem.dirichletbc(push, fem.locate_dofs_topological(V, 1, facet_tags.find(TOP)))]

# -- contact with the plane, and the push in steps ----------------------------------------------------

plane = dc.RigidPlane(point=(0, 0), normal=(-slope, 1))
pair = dc.ContactPair(dc.Surface(u, facet_tags, SLAVE), plane, friction=mu, integration=dc.Nodes())
problem = dc.ContactProblem(F, u, [pair], bcs=bcs)


def apply(t):
    """Down along the normal of the slope up to t = 0.2, then uphill along it."""
    down, along = 0.04 * min(t / 0.2, 1), 0.2 * max(t - 0.2, 0)
    x, y = along + slope * down, slope * along - down
    push.interpolate(lambda X: np.array([np.full_like(X[0], x), np.full_like(X[0], y)]))


rows = []
for step in dc.LoadStepping(problem, apply, step=0.04, progress=False):
    force, status = pair.resultant(), pair.particles.status
    counts = [int(comm.allreduce(np.sum(status == s))) for s in ("stick", "slip", "open")]
    rows.append((step.time, -force[0] / force[1], *counts, step.report.iterations))
    if comm.rank == 0:
        print(
            "t = {:.2f}: R_x/R_y = {:9.6f}, {} stick, {} slip, {} open, {} iterations".format(
                *rows[-1]
            )
        )
energy = pair.dissipated_energy()

# -- picture and assertions ---------------------------------------------------------------------------

pressure, friction = (f(pair) for f in (dc.plot.gather_pressure, dc.plot.gather_friction))
if comm.rank == 0:
    t, ratio, sticks, slips = (np.array(c) for c in list(zip(*rows))[:4])
    print(f"exact {exact:.6f}; dissipated energy {energy:.5f}")
    figure = Figure(figsize=(9, 4.2), constrained_layout=True)
    left, right = figure.subplots(1, 2)
    left.axhline(exact, color="k", linewidth=0.8, label="all slip: exact")
    curves = {"R_x / R_y": ratio, "part that slips": slips / (sticks + slips)}
    label = "t (pressed until 0.2, then pushed)"
    dc.plot.history(t, curves, xlabel=label, ylabel="", axes=left)
    left.axvline(0.2, color="0.7", linewidth=0.8)
    order = np.argsort(pressure[0][:, 0, 0])
    x, p = pressure[0][order][:, :, 0].ravel(), pressure[1][order].ravel()
    q = np.linalg.norm(friction[1][order], axis=2).ravel()
    label = "position on the wedge, at the end"
    for style, curve in (("-", {"pressure": p}), ("--", {"friction / μ": q / mu})):
        dc.plot.history(x, curve, xlabel=label, ylabel="traction", style=style, axes=right)
    figure.suptitle("A block pushed up a rigid wedge")
    file = Path(__file__).parent / "pictures" / "wedge.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)
    if not args.mesh:
        assert sticks[-1] == 0 and slips[-1] > 20
    if sticks[-1] == 0:
        assert abs(ratio[-1] - exact) < 1e-6, "the angle of friction"
