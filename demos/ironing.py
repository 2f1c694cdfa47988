# SPDX-License-Identifier: MIT
"""Shallow ironing: a stiff indenter is pressed into a soft slab and drawn along it, with friction.

The problem is Fischer and Wriggers' (2006), in the dimensions that Yastrebov gives (2011): a slab of
12 × 4, E = 6.896e8 Pa, and an indenter of 1.2 × 0.9 mm with a round bottom of radius 0.75, ten times
as stiff, 0.2 above its left end; plane strain, neo-Hookean, ν = 0.32, μ = 0.3. Its top moves down by
1 and then to the right by 10 mm. The literature has 268 to 332 N (for 1 mm of thickness) for the
vertical force at the end of the descent, and about 0.30 to 0.38 for horizontal over vertical force
in the middle of the way: codes do not agree better.

So energy is the judge: what the moving top has put in is the energy stored in both bodies, and what
friction has dissipated. Both sides are known to the error of the steps alone, which falls with them.

Run it with `python3 demos/ironing.py`, alone or under mpirun. `--slab` sets the facets along the
slab, `--down` and `--across` the increments of the two motions: those of the benchmark are 0.1 and
0.02; with 1.0 and more the steps are cut where Newton fails. It writes demos/pictures/ironing.png.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes
from dolfinx_contact.compat import vector_space

parser = argparse.ArgumentParser()
parser.add_argument("--slab", type=int, default=60, help="facets along the slab")
parser.add_argument("--down", type=float, default=0.1, help="increment of the descent [mm]")
parser.add_argument("--across", type=float, default=0.1, help="increment of the slide [mm]")
parser.add_argument("--way", type=float, default=10.0, help="length of the slide [mm]")
args = parser.parse_args()

comm = MPI.COMM_WORLD
E, nu, mu = 689.6, 0.32, 0.3  # MPa: forces are in N, for 1 mm of thickness
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2

# -- the meshes ---------------------------------------------------------------------------------------


def indenter(x):
    """Its lower side is an arc of radius 0.75, from (0.2, 4.5) by (0.8, 4.2) to (1.4, 4.5)."""
    s, height = x[:, 0], x[:, 1]
    angle = np.arcsin(0.6 / 0.75) * s
    arc = np.column_stack([0.8 + 0.75 * np.sin(angle), 4.95 - 0.75 * np.cos(angle)])
    top = np.column_stack([0.8 + 0.6 * s, np.full_like(s, 5.4)])
    return arc + height[:, None] * (top - arc)


n = args.slab
mesh, body = meshes.create(
    comm,
    [
        meshes.grid((max(6, n // 8), max(4, n // 12)), (-1, 0), (1, 1), indenter),
        meshes.grid((n, n // 4), (0, 0), (12, 4)),
    ],
)
facet_tags = meshes.tag_facets(
    mesh,
    {
        SLAVE: (lambda x: np.abs(np.hypot(x[0] - 0.8, x[1] - 4.95) - 0.75) < 1e-6, 0),
        MASTER: (lambda x: np.isclose(x[1], 4), 1),
        TOP: (lambda x: np.isclose(x[1], 5.4), 0),
        BOTTOM: (lambda x: np.isclose(x[1], 0), 1),
    },
    body,
)

# -- the bulk, in UFL: compressible neo-Hookean, plane strain -----------------------------------------

V = vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
stiffness = fem.Function(fem.FunctionSpace(mesh, ("DG", 0)))
stiffness.x.array[:] = np.where(body == 0, 10.0, 1.0)
G, lmbda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
gradient = ufl.Identity(2) + ufl.grad(u)
J = ufl.det(gradient)
psi = G / 2 * (ufl.tr(gradient.T * gradient) - 2 - 2 * ufl.ln(J)) + lmbda / 2 * ufl.ln(J) ** 2
stored = stiffness * psi * ufl.dx(mesh, metadata={"quadrature_degree": 2})
F = ufl.derivative(stored, u, w)
plate = fem.Function(V)
bcs = [
    fem.dirichletbc(plate, fem.locate_dofs_topological(V, 1, facet_tags.find(TOP))),
    fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, facet_tags.find(BOTTOM)), V),
]

# -- contact, and the two motions in steps ------------------------------------------------------------

pair = dc.ContactPair(
    dc.Surface(u, facet_tags, SLAVE), dc.Surface(u, facet_tags, MASTER), friction=mu
)
problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
energy_form = fem.form(stored)


def place(x, y):
    """Move the top of the indenter."""
    plate.interpolate(lambda X: np.array([np.full_like(X[0], x), np.full_like(X[0], y)]))


rows, work = [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)], 0.0
legs = [
    (lambda t: place(0, -t), 1.0, args.down),
    (lambda t: place(t, -1), args.way, args.across),
]
for number, (apply, end, increment) in enumerate(legs):
    for step in dc.LoadStepping(
        problem, apply, end=end, step=min(increment, end), min_step=1e-3, progress=False
    ):
        # the tool pushes with −resultant: work by the trapezoidal rule
        force = -pair.resultant()
        x, y = (step.time, -1.0) if number == 1 else (0.0, -step.time)
        before = rows[-1]
        work += 0.5 * (force + before[2:4]) @ (x - before[0], y - before[1])
        energy = comm.allreduce(fem.assemble_scalar(energy_form))
        rows.append((x, y, *force, work, energy + pair.dissipated_energy(), step.report.iterations))
        if comm.rank == 0:
            print(
                f"{x:8.4f} {y:8.4f}  V {-force[1]:8.3f} H {force[0]:8.3f} work {work:9.4f}"
                f" stored {energy:9.4f} dissipated {rows[-1][5] - energy:9.4f}"
                f"  {step.report.iterations:3d} iterations, {step.failed} failed",
                flush=True,
            )
