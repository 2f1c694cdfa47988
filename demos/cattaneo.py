# SPDX-License-Identifier: MIT
"""Cattaneo and Mindlin: where two cylinders stick and where they slip.

Two equal half-cylinders, R = 8, E = 200, ν = 0.3, in plane strain, are pressed together by a force
P = 10 per unit length and then sheared by Q = 0.936 < μP, μ = 0.2. In Hertz's contact of half-width
b = 0.6808 the middle, |x| < c = 0.4965, sticks, and the two rims slip towards the outside: the shear
traction is there μ times the pressure and falls below it inside (Cattaneo 1938, Mindlin 1949),

    q(x) = μ p0/b (√(b² − x²) − √(c² − x²)),    c = b √(1 − Q/(μP)).

The flats move as rigid plates, so that they cannot tilt: down until the force is P, then sideways
until it is Q. Each of the two motions is found by a few secant steps, the sideways one from below,
since friction depends on the way.

The picture shows both tractions beside the theory, for a mesh with 20 facets on b. The nodes are the
particles (`Nodes()`): the meshes match, and a node either sticks or slips. (With the default,
Simpson's rule, the transition takes one facet more.) Half-cylinders
are no half-spaces: that difference is in the errors, too.

Run it with `python3 demos/cattaneo.py`, alone or under mpirun; `--facets` (of the half-width b,
default 20) refines the mesh. `--mesh FILE` is a .msh file of both cylinders by Gmsh, one above the other
with their poles in the origin, with physical surfaces, and the physical curves 5 (slave, round, of the
upper one), 6 (master, round, of the lower one), 1 (the flat of the upper one) and 2 (that of the lower
one); the theory is not asserted then, but Coulomb's law is. It writes demos/pictures/cattaneo.png.
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

comm = MPI.COMM_WORLD
R, E, nu, mu = 8.0, 200.0, 0.3, 0.2
P, Q = 0.625 * 2 * R, 0.05851 * 2 * R
b = 2 * np.sqrt(P * R * (1 - nu**2) / (np.pi * E))
c = b * np.sqrt(1 - Q / (mu * P))
p0 = 2 * P / (np.pi * b)
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--facets", type=int, default=20, help="slave facets on the half-width b")
parser.add_argument("--mesh", help="a .msh file of both cylinders; see above for its groups")
args = parser.parse_args()
facets = args.facets

# -- the meshes ---------------------------------------------------------------------------------------


def graded(h, even, length):
    """From 0 to `length`, in steps of h up to `even`, which then grow by about 15 % each."""
    n = round(even / h)
    growing = np.cumsum(h * 1.15 ** np.arange(1, 200))
    m = np.searchsorted(growing, length - n * h)
    scale = (length - n * h) / growing[m]
    return np.concatenate([h * np.arange(n + 1), n * h + scale * growing[: m + 1]])


def half_disk(h, side):
    """The half-disk above (side 1) or below (−1) y = 0, with its pole in the origin."""
    way = graded(h, 1.5 * b, 0.5 * np.pi * R) / R
    angles = np.concatenate([-way[:0:-1], way])
    radii = R - graded(h, b, 0.7 * R)[::-1]
    r, angle = np.meshgrid(radii, angles, indexing="ij")
    # the core is blended into a small flat rectangle: no fan of thin triangles
    x, y = r * np.sin(angle), R - r * np.cos(angle)
    number = np.arange(r.size).reshape(r.shape)
    quads = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]], axis=-1
    ).reshape(-1, 4)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    core = len(points) + np.arange(len(angles))  # the chord of the innermost ring, on the flat
    points = np.concatenate(
        [points, np.stack([radii[0] * np.sin(angles), np.full(len(angles), R)], axis=1)]
    )
    inner = number[0]
    last = len(angles) - 1  # the chord's ends are the ring's
    core[0], core[last] = inner[0], inner[last]
    triangles = [[core[0], core[1], inner[1]], [core[last], core[last - 1], inner[last - 1]]]
    for i in range(1, last - 1):
        triangles += [[core[i], core[i + 1], inner[i]], [core[i + 1], inner[i + 1], inner[i]]]
    split = np.concatenate([quads[:, [0, 1, 3]], quads[:, [0, 3, 2]], np.array(triangles)])
    used, split = np.unique(split, return_inverse=True)
    return meshes.Body(points[used] * (1, side), split.reshape(-1, 3), "triangle", 1)


if args.mesh:
    groups = {SLAVE: "slave", MASTER: "master", TOP: "upper flat", BOTTOM: "lower flat"}
    mesh, _, facet_tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)
else:
    mesh, body = meshes.create(comm, [half_disk(b / facets, 1), half_disk(b / facets, -1)])
    round_ = lambda x: np.abs(np.hypot(x[0], np.abs(x[1]) - R) - R) < 1e-7  # noqa: E731
    facet_tags = meshes.tag_facets(
        mesh,
        {
            SLAVE: (round_, 0),
            MASTER: (round_, 1),
            TOP: lambda x: np.isclose(x[1], R),
            BOTTOM: lambda x: np.isclose(x[1], -R),
        },
        body,
    )

# -- the bulk: linear elasticity in plane strain ------------------------------------------------------

V = dc.vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
psi = dc.materials.small_strain(u, *dc.materials.lame(E, nu))
F = ufl.derivative(psi * ufl.dx, u, w)
plate = fem.Function(V)
bcs = [
    fem.dirichletbc(plate, fem.locate_dofs_topological(V, 1, facet_tags.find(TOP))),
    fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, facet_tags.find(BOTTOM)), V),
]
pair = dc.ContactPair(
    dc.Surface(u, facet_tags, SLAVE),
    dc.Surface(u, facet_tags, MASTER),
    friction=mu,
    integration=dc.Nodes(),
)
problem = dc.ContactProblem(F, u, [pair], bcs=bcs)


def move(x, y):
    """Move the upper flat; force on the upper body."""
    plate.interpolate(lambda X: np.array([np.full_like(X[0], x), np.full_like(X[0], y)]))
    report = problem.solve()
    force = pair.resultant()
    if comm.rank == 0:
        print(f"{x:10.6f} {y:10.6f}   {-force[0]:8.5f} {force[1]:8.5f}   {report.iterations:3d}")
    return force


if comm.rank == 0:
    print("motion of the upper flat   shear and normal force   iterations")
down, force = [0.0], [0.0]
for y in (0.02, 0.06, 0.12):
    down.append(y)
    force.append(move(0, -y)[1])
while abs(force[-1] / P - 1) > 1e-4:
    down.append(down[-1] + (P - force[-1]) * (down[-1] - down[-2]) / (force[-1] - force[-2]))
    force.append(move(0, -down[-1])[1])
y = -down[-1]

aside, shear = [0.0], [0.0]
for x in (0.002, 0.004, 0.006):
    aside.append(x)
    shear.append(-move(x, y)[0])
while shear[-1] < Q * (1 - 1e-4):
    slope = (shear[-1] - shear[-2]) / (aside[-1] - aside[-2])
    aside.append(aside[-1] + 0.95 * (Q - shear[-1]) / slope)
    shear.append(-move(aside[-1], y)[0])

# -- against theory -----------------------------------------------------------------------------------

particles = pair.particles.gather()
if comm.rank == 0:
    # linear theory does not tell reference and current positions apart; the reference ones do not
    # move aside with the plate
    order = np.argsort(particles.reference[:, 0], kind="stable")
    x, weight = particles.reference[order, 0], particles.weight[order]
    p, q = particles.pressure[order], -particles.friction[order, 0]
    root = lambda a: np.sqrt(np.maximum(a**2 - x**2, 0))  # noqa: E731
    exact_p, exact_q = p0 / b * root(b), mu * p0 / b * (root(b) - root(c))
    norm = lambda f: np.sqrt(weight @ f**2)  # noqa: E731
    error_p, error_q = norm(p - exact_p) / norm(exact_p), norm(q - exact_q) / norm(exact_q)
    sticks = particles.status == "stick"
    stick = 0.5 * particles.weight[sticks].sum()
    h = 2 * particles.weight[particles.status != "open"].max()  # a facet in contact: two particles
    print(f"stick half-width {stick:.4f}, theory {c:.4f}, facet {h:.4f}")
    print(f"L2 errors: pressure {100 * error_p:.1f} %, shear {100 * error_q:.1f} %")
    print(f"largest pressure {p.max():.3f}, theory {p0:.3f}")

    figure = Figure(figsize=(8, 4.6), constrained_layout=True)
    axes = figure.add_subplot()
    line = np.linspace(-b, b, 400)
    half = lambda a: np.sqrt(np.maximum(a**2 - line**2, 0))  # noqa: E731
    axes.plot(line, mu * p0 / b * half(b), "k-", linewidth=0.8, label="μ × pressure, theory")
    axes.plot(line, mu * p0 / b * (half(b) - half(c)), "k--", linewidth=0.8, label="shear, theory")
    curves = {"μ × pressure": mu * p, "shear": q}
    dc.plot.history(x, curves, xlabel="x", ylabel="traction", axes=axes)
    axes.axvspan(-c, c, color="C2", alpha=0.12, label="sticks, theory")
    axes.set_xlim(-1.3 * b, 1.3 * b)
    axes.set_title(f"Cattaneo–Mindlin, {b / h:.0f} facets on the half-width: stick and slip")
    axes.legend(fontsize=9)
    file = Path(__file__).parent / "pictures" / "cattaneo.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)
    coulomb = np.linalg.norm(particles.friction[order], axis=1) - mu * p
    assert coulomb.max() < 1e-9 * p0, "friction is at most μ times the pressure"
    slips = (particles.status == "slip")[order]
    assert np.all(np.abs(coulomb[slips]) < 1e-9 * p0), "and is that where particles slip"
    assert np.all(q[slips] * particles.slip[order, 0][slips] >= 0), "against the slip"
    if not args.mesh:
        assert abs(stick - c) < h, "stick half-width within one facet"
        assert error_q < 0.08 * max(1, 20 / facets), "shear profile within 8 % at 20 facets"
        assert abs(p.max() / p0 - 1) < 0.03
