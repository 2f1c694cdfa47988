# SPDX-License-Identifier: MIT
"""Hertz: two equal half-spheres, and what the choice of targets does to their symmetry.

The problem is Ben Dhia and Zarroug's (2002, section 4.1, Table 1): two half-spheres, R = 50 mm,
E = 2e4 MPa, ν = 0.3, whose flats approach each other by 4 mm. The meshes are mirror images of each
other, so the solution should be, too: the pole A must not move, DY(A) = 0. The upper sphere is the
slave and its nodes are the particles (`Nodes()`); contact and bulk are weighed with 2πr.

Contact treats the two bodies differently, though: particles lie on the slave, normals on the
master. At the edge of contact the master's facets are tilted, so that the contact force has a
radial part there, and the pole moves, by some 1e-4 mm. It is not the search that matters: a search
along e_y that keeps the facets' normals finds the same targets and errs as much. Interpolated
normals (`Smooth()`) halve the error. Where e_y also serves as the normal, the solution is
symmetric to round-off. With friction a tilted normal rubs as well, where by symmetry nothing does.

The sign and size of DY(A) depend on the mesh: 24 sectors with 6, 8, 10 or 12 rings give 1.2e-3,
3.3e-4, −5.3e-4 and −1.2e-3 mm with facet normals. And they depend on the way: the last node in
contact lies on the ridge between a flat and a tilted facet, and either will do. On some meshes (32
sectors and a search along e_y, say) Newton's method ends with the flat one, and symmetry survives
by luck.

The second half of the demo is about the size of pressures and forces. Hertz's theory takes each
sphere for a half-space. At the paper's approach, 8 % of the radius, converged solutions are 4 %
above its pressure and radius and 13 % above its force; at a hundredth of it, both agree. Here the
meshes are graded and displacements have degree 2. So the rule is Simpson's: a nodal one would load
the vertices only and leave the nodes between them free.

Run it with `python3 demos/hertz.py`, alone or under mpirun. `--mesh FILE` is a .msh file of two other
bodies by Gmsh, in r = x ≥ 0 with their poles in the origin, with physical surfaces, and the physical
curves 5 (slave, the round side of the upper one), 6 (master, that of the lower one), 1 (the flat of the
upper one), 2 (that of the lower one) and 3 (both on the axis). It takes the place of the graded meshes;
symmetry, which needs mirror images, is left out then, and what is asserted is that contact carries the
force. It writes demos/pictures/hertz.png.
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
parser.add_argument("--mesh", help="a .msh file of both bodies; see above for its groups")
args = parser.parse_args()

comm = MPI.COMM_WORLD
R, E, nu, U0 = 50.0, 2e4, 0.3, 2.0
SLAVE, MASTER, TOP, BOTTOM, AXIS = 5, 6, 1, 2, 3

# -- the meshes: a fan of triangles around the centre of each sphere, and rings around the fan -----


def half_sphere(angles, radii, side):
    """The half-sphere above (side 1) or below (−1) y = 0, with its pole in the origin.

    Args:
        angles: of the rays, from 0 (the axis) to π/2 (the flat)
        radii: of the rings, up to R
        side: 1 or −1; their meshes are mirror images, node by node
    """
    r, angle = np.meshgrid(radii, angles, indexing="ij")
    x, y = r * np.sin(angle), R - r * np.cos(angle)
    points = np.concatenate([[[0, R]], np.stack([x.ravel(), y.ravel()], axis=1)])
    number = 1 + np.arange(r.size).reshape(r.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    halves = [np.stack([a, c, d], axis=-1), np.stack([a, d, b], axis=-1)]
    inner = number[0]
    fan = np.stack([np.zeros_like(inner[1:]), inner[:-1], inner[1:]], axis=1)
    cells = np.concatenate([fan, *(half.reshape(-1, 3) for half in halves)])
    return meshes.Body(points * (1, side), cells, "triangle", 1)


def graded(h, even, length):
    """From 0 to `length`, in steps of h up to `even`, which then grow by about 12 % each."""
    n = round(even / h)
    growing = np.cumsum(h * 1.12 ** np.arange(1, 200))
    m = np.searchsorted(growing, length - n * h)
    scale = (length - n * h) / growing[m]
    return np.concatenate([h * np.arange(n + 1), n * h + scale * growing[: m + 1]])


def half_spheres(angles, radii):
    """Mesh, tags of its facets, and the body of each cell."""
    mesh, body = meshes.create(comm, [half_sphere(angles, radii, s) for s in (1, -1)])
    sphere = lambda x: np.abs(x[0] ** 2 + (np.abs(x[1]) - R) ** 2 - R**2) < 1e-7  # noqa: E731
    at = lambda i, value: lambda x: np.isclose(x[i], value)  # noqa: E731
    places = {
        SLAVE: (sphere, 0),
        MASTER: (sphere, 1),
        TOP: at(1, R),
        BOTTOM: at(1, -R),
        AXIS: at(0, 0),
    }
    return mesh, meshes.tag_facets(mesh, places, body), body


if args.mesh:
    groups = {
        SLAVE: "slave",
        MASTER: "master",
        TOP: "upper flat",
        BOTTOM: "lower flat",
        AXIS: "axis",
    }
    mesh, _, tags = meshes.read_msh(comm, args.mesh, 2, facets=groups)

# -- the model: linear elasticity in UFL, with the factor 2πr ---------------------------------------


class Model:
    """The two half-spheres, with displacements of a given degree."""

    def __init__(self, mesh, tags, degree):
        self.tags = tags
        V = dc.vector_space(mesh, degree)
        self.u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
        psi = dc.materials.small_strain(self.u, *dc.materials.lame(E, nu), "axisymmetric")
        r = dc.materials.radius(self.u)
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2 * degree})
        self.F = ufl.derivative(2 * np.pi * r * psi * dx, self.u, w)

        self.bcs, self.values = [], {}
        for component, tag in ((0, AXIS), (1, TOP), (1, BOTTOM)):
            W, _ = V.sub(component).collapse()
            value = self.values[tag] = fem.Function(W)
            dofs = fem.locate_dofs_topological((V.sub(component), W), 1, self.tags.find(tag))
            self.bcs.append(fem.dirichletbc(value, dofs, V.sub(component)))
        # the force on the top is the work of F in a displacement that is 1 there, 0 at other nodes
        lifted = fem.Function(V)
        lifted.x.array[fem.locate_dofs_topological(V.sub(1), 1, tags.find(TOP))] = 1
        self.on_top = fem.form(ufl.replace(self.F, {w: lifted}))

    def press(self, each, steps=1, **choice):
        """Move each flat by `each`, from rest; the pair and the number of iterations."""
        self.u.x.array[:] = 0
        pair = dc.ContactPair(
            dc.Surface(self.u, self.tags, SLAVE),
            dc.Surface(self.u, self.tags, MASTER),
            axisymmetric=True,
            **choice,
        )
        problem = dc.ContactProblem(self.F, self.u, [pair], bcs=self.bcs)
        iterations = 0
        for part in np.linspace(0, 1, steps + 1)[1:]:
            self.values[TOP].x.array[:] = -part * each
            self.values[BOTTOM].x.array[:] = part * each
            iterations += problem.solve().iterations
        load = -comm.allreduce(fem.assemble_scalar(self.on_top))
        assert abs(pair.resultant()[1] / load - 1) < 1e-8, "contact carries the force"
        return pair, iterations

    def corners(self, body):
        """Body, and positions and displacements of the corners, of each cell, on rank 0; None
        elsewhere. (For displacements of degree 1, whose nodes are the corners.)"""
        V = self.u.function_space
        local = V.mesh.topology.index_map(2).size_local  # without ghosts
        nodes = np.array([V.dofmap.cell_dofs(c) for c in range(local)]).reshape(-1, 3)
        x, u = V.tabulate_dof_coordinates()[:, :2], self.u.x.array.reshape(-1, 2)
        parts = comm.gather((body[:local], x[nodes], u[nodes]), root=0)
        return None if parts is None else [np.concatenate(part) for part in zip(*parts)]


def mirror_images(body, x, u):
    """Displacements of the corners of both bodies, in the same order; the pole comes first."""
    out = []
    for number, side in ((0, 1), (1, -1)):
        xb, ub = x[body == number].reshape(-1, 2) * (1, side), u[body == number].reshape(-1, 2)
        order = np.lexsort((np.round(xb[:, 0], 6), np.round(xb[:, 1], 6)))
        out.append((xb[order], ub[order] * (1, side)))
    (x1, u1), (x2, u2) = out
    assert np.allclose(x1, x2, rtol=0, atol=1e-9) and np.allclose(x1[0], 0, atol=1e-9)
    return u1, u2


# -- symmetry: the paper's Table 1 -----------------------------------------------------------------

if not args.mesh:
    mesh, tags, body = half_spheres(np.linspace(0, np.pi / 2, 25), np.linspace(0, R, 11)[1:])
    coarse = Model(mesh, tags, degree=1)
    e_y = dc.SeekDirection((0, 1))
    methods = {
        "proximity, facet normals": dict(target=dc.Proximity()),
        "along e_y, facet normals": dict(target=e_y),
        "smooth (interpolated normals)": dict(target=dc.Smooth()),
        "along e_y, e_y as normal": dict(target=e_y, normals="direction"),
    }
    facet, seek, smooth, symmetric = methods
    paper = {facet: "−5.05e-04", symmetric: "3.88e-16"}
    DY, error, radial = {}, {}, {}
    if comm.rank == 0:
        print("targets                           DY(A)   in the paper  mirror error  radial force")
    for name, choice in methods.items():
        # With facet normals the particle at the edge of contact is at a vertex, where two facets tie;
        # which one it keeps, and whether the pole moves, is up to the way that Newton takes. With this
        # ρ_n it ends on the outer one with both searches (other solutions do not depend on it).
        pair, _ = coarse.press(U0, integration=dc.Nodes(), rho_n=E, **choice)
        radial[name] = pair.resultant()[0]
        drawn = coarse.corners(body)
        if drawn is not None:
            upper, lower = mirror_images(*drawn)
            DY[name], error[name] = upper[0, 1], np.abs(upper - lower).max()
            print(
                f"{name:30s} {DY[name]:9.2e}  {paper.get(name, ''):>12s}  {error[name]:12.2e}"
                f"  {radial[name]:12.2e}"
            )

    if comm.rank == 0:
        assert 1e-5 < abs(DY[facet]) < 2e-3, "facet normals move the pole, by some 1e-4"
        assert abs(DY[seek] / DY[facet] - 1) < 1e-6, "a search along e_y alone changes nothing"
        assert 1e-5 < abs(DY[smooth]) < abs(DY[facet]), "interpolated normals are tilted as well"
        assert error[smooth] < 0.7 * error[facet], "but less"
        assert (
            abs(DY[symmetric]) < 1e-12 and error[symmetric] < 1e-12
        ), "e_y as normal is symmetric"
        assert abs(radial[symmetric]) < 1e-6

    # With friction the tilt is felt as well: two mirror images do not slide on each other. Friction acts
    # on particles that touched at the end of the last step, hence two steps.
    rubbing = {}
    for name in (facet, symmetric):
        pair, _ = coarse.press(U0, steps=2, integration=dc.Nodes(), friction=0.3, **methods[name])
        particles = pair.particles
        load = comm.allreduce(particles.weight @ np.linalg.norm(particles.friction, axis=1))
        rubbing[name] = load / pair.resultant()[1]
        if comm.rank == 0:
            print(f"{name:30s} friction load/normal force with μ = 0.3: {rubbing[name]:9.2e}")
    assert rubbing[facet] > 1e-4 and rubbing[symmetric] < 1e-12

# -- theory: pressure, radius and force ------------------------------------------------------------


def hertz(each):
    """Radius, pressure and force of two spheres whose centres approach by 2 `each`."""
    E_star, R_star = E / 2 / (1 - nu**2), R / 2
    a = np.sqrt(2 * each * R_star)
    p0 = 2 * E_star * a / (np.pi * R_star)
    return a, p0, 2 / 3 * np.pi * a**2 * p0


def computed(each, h, steps):
    """Radius, pressure and force with facets of size h, or on the user's mesh; the profile; and the
    deformed cells. None but on rank 0.

    Pressures and radii are nominal: they refer to the undeformed spheres. The radius is that of
    the ellipse p² = c² (1 − r²/a²) through the pressures, the pressure that at the pole.
    """
    if args.mesh:
        model = Model(mesh, tags, degree=2)
    else:
        angles = graded(h, 1.3 * hertz(each)[0], np.pi / 2 * R) / R
        radii = R - graded(h, 0, R)[-2::-1]
        model = Model(*half_spheres(angles, radii)[:2], degree=2)
    pair, _ = model.press(each, steps, target=dc.Smooth(), integration=dc.Simpson(1))
    force, particles = pair.resultant()[1], pair.particles.gather()
    cells = dc.plot.gather_bodies(model.u)
    if particles is None:
        return None
    r, p = particles.reference[:, 0], particles.pressure
    inside = p > 0.02 * p.max()
    slope, square = np.polyfit(r[inside] ** 2, p[inside] ** 2, 1)
    order = np.argsort(r)
    return (np.sqrt(-square / slope), p[np.argmin(r)], force), (r[order], p[order]), cells


large, small = computed(U0, 0.25, 2), computed(U0 / 100, 0.05, 1)

if comm.rank == 0:
    converged = (10.36, 2912.0, 6.61e5)
    print("\n                            radius   pressure       force")
    print("4 mm, Hertz               {:8.3f}   {:8.1f}   {:9.3e}".format(*hertz(U0)))
    print("4 mm, converged           {:8.3f}   {:8.1f}   {:9.3e}".format(*converged))
    print("4 mm, computed            {:8.3f}   {:8.1f}   {:9.3e}".format(*large[0]))
    print("0.04 mm, Hertz            {:8.3f}   {:8.1f}   {:9.3e}".format(*hertz(U0 / 100)))
    print("0.04 mm, computed         {:8.3f}   {:8.1f}   {:9.3e}".format(*small[0]))
    if not args.mesh:
        assert np.allclose(large[0], converged, rtol=0.01)
        assert abs(small[0][1] / hertz(U0 / 100)[1] - 1) < 0.005

    figure = Figure(figsize=(10, 5.6), constrained_layout=True)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
    if args.mesh:
        dc.plot.bodies(large[2], axes=left)
    else:
        body, x, u = drawn
        for number, colour in ((0, "lightsteelblue"), (1, "wheat")):
            cells = dc.plot.Shapes([(x + u)[body == number]])
            dc.plot.bodies(cells, color=colour, axes=left)
    left.plot(0, 0, "k.")
    left.annotate("A", (0, 0), (-4.5, -1.5))
    left.set(xlim=(-6, 54), ylim=(-51, 51), aspect="equal", xlabel="r", ylabel="y")
    left.set_title("Deformed meshes" + ("" if args.mesh else " (Table 1)"))
    for (_, (r, p), _), each, style in ((large, U0, "C0-"), (small, U0 / 100, "C1-")):
        a, p0, _ = hertz(each)
        right.plot(r / a, p / p0, style, label=f"computed, approach {2 * each:g} mm")
    s = np.linspace(0, 1, 400)
    right.plot(s, np.sqrt(1 - s**2), "k--", linewidth=1, label="Hertz")
    right.set(xlim=(0, 1.3), ylim=(0, 1.12))
    right.set(xlabel="r / a, a Hertz's radius", ylabel="p / p₀, p₀ Hertz's pressure")
    right.set_title("Contact pressure (Smooth, Simpson(1), degree 2)")
    right.grid(alpha=0.3)
    right.legend()
    file = Path(__file__).parent / "pictures" / "hertz.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=130)
    print("picture:", file)
