# SPDX-License-Identifier: MIT
"""A sphere pressed on a block, with straight and with curved facets.

A sphere of radius R meshed with straight facets of size h is a polyhedron: its surface lies inside
the sphere, by h²/(12 R) on average over a facet, where it touches. Pressed by a prescribed
displacement it therefore pushes too weakly, by about F'(δ) h²/(12 R), however rich the displacement
is. Facets of degree 2 remove this error: the sagitta that they leave is of order h⁴.

The test is axisymmetric (`axisymmetric=True` weighs the particles with 2πR, the bulk does so in
UFL), linear elastic, with displacements of degree 2 on both meshes, so that only the geometry
differs. The resultant is compared with that of a fine curved mesh over seven depths δ, since the
edge of contact falls anywhere within a facet: that error is of order h² too, but changes its sign
from depth to depth, and the mean over the depths brings out the bias of the geometry.

It writes demos/pictures/sphere_on_block.png.
"""

from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

comm = MPI.COMM_WORLD
R, width, height = 1.0, 0.45, 0.5  # the part of the sphere that is meshed
E, nu = 1.0, 0.3
depths = np.linspace(0.02, 0.05, 7)


def sphere(x):
    """From [0, width] × [0, 1] to the lower part of a sphere that touches z = 0 at the origin."""
    bottom = R - np.sqrt(R**2 - x[:, 0] ** 2)
    return np.stack([x[:, 0], bottom + (height - bottom) * x[:, 1]], axis=1)


def forces(n: int, curved: bool) -> np.ndarray:
    """Resultants at all depths, with n facets on the sphere."""
    degree = 2 if curved else 1
    upper = meshes.grid((n, n), (0, 0), (width, 1), mapping=sphere, degree=degree)
    lower = meshes.grid((round(1.3 * n), n), (0, -0.5), (0.6, 0), degree=degree)
    mesh, body = meshes.create(comm, [upper, lower])
    on_sphere = lambda x: np.abs((x[1] - R) ** 2 + x[0] ** 2 - R**2) < 1e-9  # noqa: E731
    at = lambda i, value: lambda x: np.isclose(x[i], value)  # noqa: E731
    tags = meshes.tag_facets(
        mesh,
        {5: (on_sphere, 0), 6: (at(1, 0), 1), 1: at(1, height), 2: at(1, -0.5), 3: at(0, 0)},
        body,
    )

    V = dc.vector_space(mesh, 2)
    u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    psi = dc.materials.small_strain(u, *dc.materials.lame(E, nu), "axisymmetric")
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 6})
    F = ufl.derivative(2 * np.pi * dc.materials.radius(u) * psi * dx, u, w)

    bcs, values = [], []
    for component, tag in ((0, 3), (1, 1), (1, 2)):  # axis, top, bottom
        W, _ = V.sub(component).collapse()
        values.append(fem.Function(W))
        dofs = fem.locate_dofs_topological((V.sub(component), W), 1, tags.find(tag))
        bcs.append(fem.dirichletbc(values[-1], dofs, V.sub(component)))

    pair = dc.ContactPair(
        dc.Surface(u, tags, 5),
        dc.Surface(u, tags, 6),
        target=dc.Proximity(),
        integration=dc.Simpson(2),
        axisymmetric=True,
    )
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    out = []
    for depth in depths:
        values[1].x.array[:] = -depth
        problem.solve()
        out.append(pair.resultant()[1])
    return np.array(out)


sizes = np.array([4, 8, 16])
finest = forces(4 * sizes[-1], curved=True)
bias = {}
for curved in (False, True):
    bias[curved] = [(forces(n, curved) / finest - 1).mean() for n in sizes]

# what the mean sagitta predicts for straight facets: −F'(δ) h²/(12 R)
slope = np.gradient(finest, depths) / finest
predicted = [-(slope * (width / n) ** 2 / (12 * R)).mean() for n in sizes]
order = {k: -np.polyfit(np.log(sizes), np.log(np.abs(bias[k])), 1)[0] for k in bias}

if comm.rank == 0:
    print("facets   straight    (sagitta)    curved      mean relative error of the resultant")
    for row in zip(sizes, bias[False], predicted, bias[True]):
        print("{:6d}  {:10.2e}  {:10.2e}  {:10.2e}".format(*row))
    print(f"orders: straight {order[False]:.2f}, curved {order[True]:.2f}")
    figure = Figure(figsize=(6.5, 4.6), constrained_layout=True)
    axes = figure.add_subplot()
    errors = {
        "straight facets": np.abs(bias[False]),
        "mean sagitta, h²/(12 R)": np.abs(predicted),
        "curved facets (degree 2)": np.abs(bias[True]),
    }
    dc.plot.history(
        sizes,
        errors,
        title="Sphere on a block, displacements of degree 2",
        xlabel="facets on the sphere",
        ylabel="|mean relative error of the contact force|",
        axes=axes,
    )
    axes.set(xscale="log", yscale="log")
    axes.set_xticks(sizes, sizes)
    axes.set_xticks([], minor=True)
    file = Path(__file__).parent / "pictures" / "sphere_on_block.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)

assert np.allclose(bias[False], predicted, rtol=0.25), "straight facets err by their sagitta"
assert 1.8 < order[False] < 2.5, "of second order"
assert order[True] > 2.5, "curved facets converge faster,"
assert np.all(np.abs(bias[True]) < 0.2 * np.abs(bias[False])), "and are far more accurate"
