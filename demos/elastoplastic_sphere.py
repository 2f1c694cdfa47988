# SPDX-License-Identifier: MIT
"""An elastoplastic sphere between rigid plates: force, mesh, and what is left when they part.

A sphere, R = 50 mm, is pressed flat by a rigid plane, without friction, down to 5 mm on each side.
By symmetry half of it stands with its equator on a smooth base; all is axisymmetric. Material:
E = 2.1e5 MPa, ν = 0.3, yield stress 1000 MPa + 1000 MPa ε_p. It is the other way round than
Code_Aster's SSNV506 (where a rigid sphere is pressed into an elastoplastic block), with a demand of that
style: a mesh is fine enough if one of half the size changes the force by less than 3 %.

Plastic flow keeps the volume, and bilinear displacements alone would lock (docs/locking.md). Here the
logarithm e of the volume is a second unknown, one value a cell: the law sees
F̄ = exp(e/3) J^(−1/3) F, and e is the mean of ln J.

What is known: up to p₀ = 1.6 σ_y the sphere is elastic, and Hertz's force is 4/3 E* √R δ^(3/2). Yield
begins below the surface then, at δ_y = (π p₀/2E*)² R = 0.006 mm. From some 100 δ_y on the mean pressure
is nearly constant, and the force grows as δ. How far the edge of contact has come is known to a facet,
and to a load step: forces err by a part h/a of themselves, a the radius of contact, and so they do
where the plane advances by 1/2 mm at once (by 5 %; in steps of 1/10 mm by 0.5 %).

Run it with `python3 demos/elastoplastic_sphere.py [--small]`, alone or under mpirun. `--mesh FILE` is a .msh
file by Gmsh of half a sphere, or of another body, in r = x ≥ 0 with its pole at (0, 50), with a physical
surface, and the physical curves 5 (that the plane may touch), 1 (the base) and 2 (on the axis); what
is asserted then is that something is left when the plane is gone. It writes
demos/pictures/elastoplastic_sphere.png.
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
from dolfinx_contact.plasticity import J2, Linear

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--small", action="store_true", help="two coarse meshes")
parser.add_argument("--mesh", help="a .msh file of the half-sphere; see above for its groups")
args = parser.parse_args()

comm = MPI.COMM_WORLD
R, E, nu, yield_stress, H = 50.0, 2.1e5, 0.3, 1000.0, 1000.0
E_star = E / (1 - nu**2)
SURFACE, BASE, AXIS = 5, 1, 2
DEPTHS = (0.25, 1.0, 2.0, 3.0, 4.0, 5.0)
BACK = 0.05  # the plane goes back in steps of this, until it is free

# -- the mesh: a square at the centre, and two wings between it and the sphere --------------------


def half_sphere(n):
    """A quarter disk with its pole at (0, R); n: cells along each side of each part.

    The parts are Coons patches that share sides; along the surface by the pole there are 2n cells.
    """
    arc = lambda a: R * np.stack([np.sin(a), np.cos(a)], axis=-1)  # noqa: E731
    straight = lambda a, b: lambda s: np.outer(1 - s, a) + np.outer(s, b)  # noqa: E731
    middle = 0.22 * np.pi  # where the wings meet
    O, up, right, corner = map(np.array, ((0, 0), (0, 25.0), (25.0, 0), (16.0, 19.0)))
    rim = arc(middle)
    parts = [  # sides from s = 0 to 1: left, right (t upwards) and bottom, top (s to the right)
        (straight(O, up), straight(right, corner), straight(O, right), straight(up, corner)),
        (
            straight(up, arc(0)),
            straight(corner, rim),
            straight(up, corner),
            lambda s: arc(middle * s),
        ),
        (
            straight(right, corner),
            lambda s: arc(np.pi / 2 + (middle - np.pi / 2) * s),
            straight(right, arc(np.pi / 2)),
            straight(corner, rim),
        ),
    ]
    counts = [(2 * n, n), (2 * n, n), (n, n)]
    points, cells = [], []
    for sides, count in zip(parts, counts):

        def mapping(x, sides=sides):
            s, t = x.T
            left, right_, bottom, top = (f(v) for f, v in zip(sides, (t, t, s, s)))
            s, t = s[:, None], t[:, None]
            ends = [f(np.array([v]))[0] for f in sides[:2] for v in (0.0, 1.0)]
            bilinear = (1 - s) * ((1 - t) * ends[0] + t * ends[1])
            bilinear = bilinear + s * ((1 - t) * ends[2] + t * ends[3])
            return (1 - s) * left + s * right_ + (1 - t) * bottom + t * top - bilinear

        body = meshes.grid(count, mapping=mapping)
        cells.append(body.cells + sum(map(len, points)))
        points.append(body.points)
    points, cells = np.concatenate(points), np.concatenate(cells)
    _, first, number = np.unique(
        np.round(points, 7) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return meshes.Body(points[first], number.ravel()[cells], "quadrilateral", 1)


def tagged(n):
    """The mesh, and the tags of its facets."""
    mesh, _ = meshes.create(comm, half_sphere(n))
    return mesh, meshes.tag_facets(
        mesh,
        {
            SURFACE: lambda x: np.isclose(np.hypot(x[0], x[1]), R),
            BASE: lambda x: np.isclose(x[1], 0),
            AXIS: lambda x: np.isclose(x[0], 0),
        },
    )


# -- the model --------------------------------------------------------------------------------------


class Model:
    """The half-sphere and the plane above it."""

    def __init__(self, mesh, tags):
        V, Q = dc.vector_space(mesh, 1), dc.function_space(mesh, ("DG", 0))
        self.u, self.e = fem.Function(V, name="displacement"), fem.Function(Q, name="volume")
        u, e, r = self.u, self.e, ufl.SpatialCoordinate(mesh)[0]
        G = ufl.grad(u)
        F = ufl.as_matrix(
            [[1 + G[0, 0], G[0, 1], 0], [G[1, 0], 1 + G[1, 1], 0], [0, 0, 1 + u[0] / r]]
        )
        J = ufl.det(F)
        self.law = law = J2(
            u,
            E,
            nu,
            Linear(yield_stress, H),
            quadrature_degree=2,
            kind="axisymmetric",
            F=ufl.exp(e / 3) * J ** (-1 / 3) * F,
        )
        kappa = law.lmbda + 2 / 3 * law.mu
        constraint = kappa * (e * ufl.ln(J) - e**2)
        forms = []
        for f in (u, e):
            test = ufl.TestFunction(f.function_space)
            work = ufl.inner(law.P, law.variation(f, test)) + ufl.derivative(constraint, f, test)
            forms.append(2 * np.pi * r * work * law.dx)
        bcs = []
        for component, tag in ((0, AXIS), (1, BASE)):
            W = V.sub(component)
            dofs = fem.locate_dofs_topological(W, 1, tags.find(tag))
            bcs.append(fem.dirichletbc(0.0, dofs, W))
        self.plane = dc.RigidPlane(point=(0, R), normal=(0, -1))
        self.pair = dc.ContactPair(dc.Surface(u, tags, SURFACE), self.plane, axisymmetric=True)
        self.problem = dc.ContactProblem(forms, [u, e], [self.pair], bcs=bcs, materials=[law])
        self.depth, self.iterations, self.curve = 0.0, 0, [(0.0, 0.0)]

    def go(self, depth, step=0.1):
        """Move the plane to a depth, in steps; the force on it."""
        start = self.depth
        apply = lambda t: self.plane.move((0, -(start + t * (depth - start))))  # noqa: E731
        for done in dc.LoadStepping(self.problem, apply, step=step, progress=False):
            self.iterations += done.report.iterations
            reached = start + done.time * (depth - start)
            self.curve.append((reached, self.plane.force()[1]))
        self.depth = depth
        return self.plane.force()[1]

    def pole(self):
        """How far the pole has come down."""
        x, u = self.u.function_space.tabulate_dof_coordinates(), self.u.x.array.reshape(-1, 2)
        at = np.hypot(x[:, 0], x[:, 1] - R) < 1e-6
        return -comm.allreduce(u[at, 1].min(initial=np.inf), op=MPI.MIN)

    def picture(self):
        """The deformed body and the mean plastic strain of each cell, on rank 0."""
        law, cells = self.law, self.u.function_space.mesh.topology.index_map(2).size_local
        strain = law.values(law.plastic_strain).reshape(cells, -1).mean(axis=1)
        return dc.plot.gather_bodies(self.u, strain)


# -- loading on meshes of halved size -----------------------------------------------------------------

if args.mesh:
    groups = {SURFACE: "what the plane may touch", BASE: "base", AXIS: "axis"}
    mesh, _, tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)
    models = {"mesh": Model(mesh, tags)}
else:
    sizes = (6, 12) if args.small else (6, 12, 24)
    models = {f"{n} cells": Model(*tagged(n)) for n in sizes}
forces = {name: np.array([model.go(depth) for depth in DEPTHS]) for name, model in models.items()}
names = list(models)

delta = np.array(DEPTHS)
hertz = 4 / 3 * E_star * np.sqrt(R) * delta**1.5
if comm.rank == 0:
    print(
        "depth [mm]   Hertz [kN]"
        + "".join(f"{name + ' [kN]':>16s}" for name in names)
        + "   change"
    )
    for i, depth in enumerate(DEPTHS):
        change = forces[names[-1]][i] / forces[names[max(0, len(names) - 2)]][i] - 1
        values = "".join(f"{forces[name][i] / 1e3:16.2f}" for name in names)
        print(f"{depth:10.2f} {hertz[i] / 1e3:12.2f}{values}   {100 * change:5.2f} %")
    for name, m in models.items():
        print(f"{name}: {m.iterations} iterations in {len(m.curve) - 1} steps")
if not args.mesh:
    changes = [np.abs(forces[b] / forces[a] - 1)[-4:].max() for a, b in zip(names, names[1:])]
    # measured: 3.3 % from 6 to 12 cells, 1.0 % from 12 to 24
    assert changes[-1] < (
        0.05 if args.small else 0.03
    ), "halving the mesh size changes the force by less than 3 %"
    assert np.all(forces[names[-1]] < 1.05 * hertz), "plastic flow makes it softer than Hertz"

# -- unloading on the second mesh -------------------------------------------------------------------

finest = models[names[-1]]
pressed, finest_curve = finest.picture(), list(finest.curve)
model = models[names[min(1, len(names) - 1)]]
turn = len(model.curve) - 1
while model.curve[-1][1] > 0:
    model.go(model.depth - BACK, step=1.0)
residual = model.pole()
if comm.rank == 0:
    print(f"the plane is free at {model.depth:.2f} mm; the pole stays {residual:.3f} mm low")
# the elastic part of the approach is small
assert (0 if args.mesh else 0.8) * DEPTHS[-1] < residual < DEPTHS[-1]

# -- the picture ------------------------------------------------------------------------------------

if comm.rank == 0:
    yield_depth = (np.pi * 1.6 * yield_stress / 2 / E_star) ** 2 * R
    hertz_force = lambda d: 4 / 3 * E_star * np.sqrt(R) * d**1.5  # noqa: E731
    figure = Figure(figsize=(11, 6.4), constrained_layout=True)
    axes = figure.subplot_mosaic([["sphere", "force"], ["sphere", "log"]], width_ratios=(1.2, 1))
    left, force, log = axes["sphere"], axes["force"], axes["log"]
    label, title = "plastic strain, mean of each cell", f"Pressed by {DEPTHS[-1]:g} mm"
    dc.plot.bodies([pressed, pressed.mirrored()], title=title, label=label, axes=left)
    left.axhline(R - DEPTHS[-1], color="0.3", lw=2)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 200)
    left.plot(R * np.sin(angle), R * np.cos(angle), color="0.5", ls=":", lw=1)
    left.set(xlim=(-56, 56), ylim=(-2, 56), aspect="equal", xlabel="r [mm]", ylabel="z [mm]")
    d = np.geomspace(yield_depth / 4, DEPTHS[-1], 100)
    for ax, mute in ((force, "_"), (log, "")):  # labels that begin with _ are in no legend
        for name, style in zip(names, ("C1^", "C2s", "C0o")):
            label = f"{mute}{name}" + (" a side" if not args.mesh else "")
            ax.plot(DEPTHS, forces[name] / 1e3, style, ms=5, mfc="none", label=label)
        ax.plot(d, hertz_force(d) / 1e3, "k--", lw=1, label=f"{mute}Hertz, elastic")
        ax.set(xlabel="approach [mm]", ylabel="force [kN]")
        ax.grid(alpha=0.3)
    force.plot(*(np.array(finest_curve).T * np.array([[1], [1e-3]])), "C0-", lw=0.8)
    depths, values = np.array(model.curve[turn:]).T
    force.plot(depths, values / 1e3, "C3.-", lw=1, label="going back")
    force.axvline(residual, color="C3", ls=":", lw=1, label="pole after that")
    force.set(xlim=(0, 5.3), ylim=(0, 4500), title="Force")
    log.plot(yield_depth, hertz_force(yield_depth) / 1e3, "k*", label="first yield (Hertz)")
    log.set(xscale="log", yscale="log")
    force.legend(fontsize="small", loc="lower center")
    log.legend(fontsize="small", loc="lower right")
    file = Path(__file__).parent / "pictures" / "elastoplastic_sphere.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)
