# SPDX-License-Identifier: MIT
"""Rubber: a nearly incompressible block, pressed by a rigid sphere by 40 % of its height.

With ν = 0.4999 rubber keeps its volume. Elements that know displacements only must keep it at every
quadrature point; those of degree 1 have hardly any motion left and lock: the force is several times
too large, more so the coarser the mesh. Those of degree 2 do better, but Newton's method finds its way
among the huge volumetric stresses in small steps only. A mixed model makes the pressure an unknown of
its own, which keeps volumes in the mean:

    W = μ/2 (tr C − 3 − 2 ln J) + p (J − 1) − p²/(2 λ)

Here displacements have degree 2 and the pressures are linear and discontinuous. For contact nothing
changes: F and u are lists, and the surface moves with the displacement,

    F = [ufl.derivative(W, u, w), ufl.derivative(W, p, q)]
    problem = dc.ContactProblem(F, [u, p], [pair], bcs=bcs)

A cylinder of rubber, 10 mm high and 10 mm in radius, is bonded to a rigid floor. A rigid sphere of the
same radius comes down on it by 4 mm, with a coefficient of friction of 0.3. All is axisymmetric: hoop
stretch 1 + u_r/r and weights 2πr in UFL, `axisymmetric=True` for the pair; in 2D a `RigidSphere` is a
circle.

The reference at small depth is Hertz's theory, with the factor of Dimitriadis et al. (Biophysical
Journal 82, 2002) for an incompressible layer of height H that is bonded to its ground,

    F = 16/9 E √R δ^(3/2) (1 + 1.133 χ + 1.283 χ² + 0.769 χ³ + 0.0975 χ⁴),   χ = √(R δ)/H.

It is compared with a block that is 30 mm in radius; at δ = 0.25 mm the factor is 1.21 already.

Run it with `python3 demos/rubber.py`, alone or under mpirun; `--nu 0.5` makes the block incompressible
(displacements alone then have 0.4999), `--cells` says how fine it is. `--mesh FILE` is a .msh file of
another block by Gmsh, in r = x ≥ 0 below y = 10, with a physical surface, and the physical curves 5 (its
upper side), 1 (on the floor) and 2 (on the axis); the sphere then goes into this one alone, and what is
asserted is that the block keeps its volume. (On triangles the pressure is constant in each cell.) It
writes demos/pictures/rubber.png.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_contact as dc
from dolfinx_contact import meshes

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--cells", type=int, default=12, help="cells along the height, 8 or more")
parser.add_argument("--nu", type=float, default=0.4999, help="Poisson's ratio, up to 0.5")
parser.add_argument("--mesh", help="a .msh file of the block; see above for its groups")
options = parser.parse_args()
nu, n = options.nu, options.cells

comm = MPI.COMM_WORLD
E, R, height = 2.0, 10.0, 10.0  # MPa, mm, mm
SLAVE, FLOOR, AXIS = 5, 1, 2
depth = 0.4 * height

# points of a cell at which it is drawn, off the axis, and the polygons between them
SIDE = np.linspace(1e-6, 1 - 1e-6, 4)
POINTS = np.array([(x, y) for y in SIDE for x in SIDE])
SQUARES = np.array([[a, a + 1, a + 5, a + 4] for a in (0, 1, 2, 4, 5, 6, 8, 9, 10)])
CORNERS = np.array([[1e-6, 1e-6], [1 - 2e-6, 1e-6], [1e-6, 1 - 2e-6]])
PIECES = {"quadrilateral": (POINTS, SQUARES), "triangle": (CORNERS, np.array([[0, 1, 2]]))}

# -- the block, in UFL ------------------------------------------------------------------------------


def cylinder(n, radius=10.0):
    """A mesh of n cells along the height that are smaller near the middle of the top, and tags."""

    def graded(x):
        r, s = x[:, 0], 1 - x[:, 1]
        return np.stack([radius * r * (1 + r) / 2, height * (1 - s * (3 + 2 * s) / 5)], axis=1)

    mesh, _ = meshes.create(comm, meshes.grid((3 * n // 2, n), mapping=graded))
    at = lambda i, value: lambda x: np.isclose(x[i], value)  # noqa: E731
    return mesh, meshes.tag_facets(mesh, {SLAVE: at(1, height), FLOOR: at(1, 0), AXIS: at(0, 0)})


class Block:
    """A block, and a sphere above it.

    Args:
        mesh, tags: of the block
        degree: of the displacement
        mixed: with a pressure
    """

    def __init__(self, mesh, tags, degree, mixed):
        self.cell = mesh.topology.cell_name()
        pressures = ("DPC", 1) if self.cell == "quadrilateral" else ("DG", 0)
        V, Q = dc.vector_space(mesh, degree), dc.function_space(mesh, pressures)
        u, p = fem.Function(V, name="displacement"), fem.Function(Q, name="pressure")

        stretch = dc.materials.deformation_gradient(u, "axisymmetric")
        r = dc.materials.radius(u)
        J, square = ufl.det(stretch), ufl.inner(stretch, stretch)
        ratio = nu if mixed else min(nu, 0.4999)
        mu = E / 2 / (1 + ratio)
        softness = (1 + ratio) * (1 - 2 * ratio) / (E * ratio)  # 1/λ
        mu, softness = (fem.Constant(mesh, PETSc.ScalarType(v)) for v in (mu, softness))
        dx = ufl.dx(mesh, metadata={"quadrature_degree": 2 * degree})
        W = mu / 2 * (square - 3 - 2 * ufl.ln(J))
        W += p * (J - 1) - softness * p**2 / 2 if mixed else (J - 1) ** 2 / (2 * softness)
        unknowns = [u, p] if mixed else [u]
        F = [
            ufl.derivative(2 * np.pi * r * W * dx, v, ufl.TestFunction(v.function_space))
            for v in unknowns
        ]

        floor, axis = (tags.indices[tags.values == tag] for tag in (FLOOR, AXIS))
        V0, _ = V.sub(0).collapse()
        on_axis = fem.locate_dofs_topological((V.sub(0), V0), 1, axis)
        bcs = [
            fem.dirichletbc(fem.Function(V), fem.locate_dofs_topological(V, 1, floor)),
            fem.dirichletbc(fem.Function(V0), on_axis, V.sub(0)),
        ]
        self.sphere = dc.RigidSphere((0, height + R), R)
        self.pair = dc.ContactPair(
            dc.Surface(u, tags, SLAVE),
            self.sphere,
            friction=0.3,
            integration=dc.Simpson(2),
            axisymmetric=True,
        )
        self.problem = dc.ContactProblem(F, unknowns, [self.pair], bcs=bcs)
        self.mesh, self.iterations = mesh, 0
        self._volume = [fem.form(r * v * dx) for v in (J / J, J - 1)]
        # positions and mean pressures, the trace of Cauchy's stress, to draw
        x = ufl.SpatialCoordinate(mesh) + u
        mean = -p - mu * (square / 3 - 1) / J
        self._drawn = fem.Expression(ufl.as_vector([x[0], x[1], mean]), PIECES[self.cell][0])

    def press(self, depth, steps=16):
        """Depths and forces of the sphere, from the first touch to a depth; (steps + 1, 2)."""

        def lower(t):
            self.sphere.move((0, -depth * t))

        out = [(0.0, 0.0)]
        for step in dc.LoadStepping(self.problem, lower, step=1 / steps, progress=False):
            self.iterations += step.report.iterations
            out.append((depth * step.time, -self.pair.resultant()[1]))
        return np.array(out)

    def volume_change(self):
        """Relative to the whole volume."""
        whole, change = (comm.allreduce(fem.assemble_scalar(form)) for form in self._volume)
        return change / whole

    def pieces(self):
        """Corners and mean pressures of small polygons, on rank 0; elsewhere None."""
        points, polygons = PIECES[self.cell]
        cells = np.arange(self.mesh.topology.index_map(2).size_local, dtype=np.int32)
        values = dc.evaluate(self._drawn, self.mesh, cells).reshape(-1, len(points), 3)
        parts = comm.gather(values[:, polygons].reshape(-1, polygons.shape[1], 3), root=0)
        return None if parts is None else np.concatenate(parts)


def bonded_layer(depth):
    """Hertz's force on a half-space of ν = 1/2, and that on a bonded layer (Dimitriadis et al.)."""
    hertz, chi = 16 / 9 * E * np.sqrt(R) * depth**1.5, np.sqrt(R * depth) / height
    return hertz, hertz * np.polyval([0.0975, 0.769, 1.283, 1.133, 1], chi)


# -- force over depth -------------------------------------------------------------------------------

if options.mesh:
    groups = {SLAVE: "upper side", FLOOR: "floor", AXIS: "axis"}
    mesh, _, tags = meshes.read_msh(comm, options.mesh, 2, facets=groups)
    models = {
        "mixed": Block(mesh, tags, 2, True),
        "degree 2": Block(mesh, tags, 2, False),
        "degree 1": Block(mesh, tags, 1, False),
    }
else:
    coarse, halved = cylinder(n), cylinder(2 * n)
    models = {
        f"mixed, {n} cells": Block(*coarse, 2, True),
        f"mixed, {2 * n} cells": Block(*halved, 2, True),
        f"degree 2, {n} cells": Block(*coarse, 2, False),
        f"degree 1, {n} cells": Block(*coarse, 1, False),
        f"degree 1, {2 * n} cells": Block(*halved, 1, False),
    }
curves = {name: block.press(depth) for name, block in models.items()}
first, rubber = next(iter(models.items()))
change, pieces = rubber.volume_change(), rubber.pieces()
pressed = rubber.pair.particles.gather()
fine = [curve[-1, 1] for name, curve in curves.items() if "mixed" in name][-1]

if comm.rank == 0:
    print("                       steps  iterations  force at 4 mm   over the finest mixed one")
    for name, block in models.items():
        steps, force = len(curves[name]) - 1, curves[name][-1, 1]
        print(f"{name:22s} {steps:5d} {block.iterations:10d} {force:12.2f} N {force / fine:12.4f}")
    print(f"volume of the block: changed by {change:.1e} of it")

if not options.mesh:
    wide, small = Block(*cylinder(2 * n, radius=30.0), 2, True), 0.025 * height
    near = wide.press(small, steps=5)[-1, 1]
    hertz, layer = bonded_layer(small)
if comm.rank == 0 and not options.mesh:
    print(
        f"at {small:.2f} mm, block of 30 mm in radius: {near:.4f} N; Hertz {hertz:.4f} N, with the"
        f" factor for a layer {layer:.4f} N: {near / layer - 1:+.1%}"
    )

# -- picture ----------------------------------------------------------------------------------------

if comm.rank == 0:
    figure = Figure(figsize=(13, 5), constrained_layout=True)
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1])
    # both halves; colours end where the singular edge of the floor would rule them
    p = pieces[:, :, 2].mean(axis=1)
    half = dc.plot.Shapes([pieces[:, :, :2]], p)
    dc.plot.bodies(
        [half, half.mirrored()],
        title=f"{first}, ν = {nu}; particles that touch in red".capitalize(),
        label="mean pressure [MPa]",
        clim=tuple(np.percentile(p, (2, 99.5))),
        edges=False,
        axes=left,
    )
    left.add_patch(Circle((0, height + R - depth), R, facecolor="0.85", edgecolor="0.4"))
    touching = pressed.position[pressed.status != "open"]
    for side in (-1, 1):
        left.plot(side * touching[:, 0], touching[:, 1], ".", color="tab:red", markersize=2)
    left.set_xlim(-14, 14)
    left.set_ylim(-0.5, 14)
    left.set(xlabel="r [mm]", ylabel="z [mm]")
    marks = ("o", "-", "x", "--", "-.")
    for mark, (name, curve) in zip(marks, curves.items()):
        right.plot(*curve.T, mark, label=name, markersize=4, fillstyle="none")
    right.set_ylim(0, 2.5 * fine)
    right.set_xlabel("depth [mm]")
    right.set_ylabel("force [N]")
    right.set_title("Displacements alone lock")
    right.grid(alpha=0.3)
    right.legend()
    file = Path(__file__).parent / "pictures" / "rubber.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)

# -- what is to be seen -------------------------------------------------------------------------------

assert abs(change) < 2e-4, "the block keeps its volume"
if not options.mesh:
    mixed, fine, second, *locked = (curve[-1, 1] for curve in curves.values())
    assert abs(mixed / fine - 1) < 0.01, "the force of the mixed model depends little on the mesh"
    assert abs(second / fine - 1) < 0.1, "displacements of degree 2 are not far off,"
    assert models[f"degree 2, {n} cells"].iterations > 2 * rubber.iterations, "but take more work;"
    locked = np.divide(locked, fine)
    assert locked[0] > 2 and 1.3 < locked[1] < locked[0], "those of degree 1 lock"
    assert abs(near / layer - 1) < 0.03, "at small depth Hertz's theory for a bonded layer holds"
