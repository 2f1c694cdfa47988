# SPDX-License-Identifier: MIT
"""How fast errors fall when meshes are refined: a manufactured solution on a curved interface.

Two rings meet at r = 1, body 1 inside (the slave), body 2 outside. They are given displacements,
in polar coordinates (r, θ) of the reference configuration and with e(θ) = (cos θ, sin θ):

    x¹ = (r + g(θ)) e(θ),   x² = (r + g(φ)) e(φ),   φ(θ) = θ + arctan(t₀ + t₁ sin θ),
    g(φ) = 0.06 + 0.02 cos 2φ.

Both move the circle r = 1 to the same closed curve, which is no circle any more; on it body 2 has
slid along body 1, by several facets of the finer meshes, and is stretched there, too. The nominal
pressure is given as well, p(θ) = 0.1 + 0.05 cos 3θ on the slave, with E = 1.

The bulk is linear elastic: contact alone knows of large displacements. Loads that make all of this
a solution follow from the strong form. With λ = −p and n, the normal of the deformed curve that
points from body 1 to body 2, (F1) asks for body forces f = −div σ(u) and, beside contact, for
tractions on both sides of the interface,

    g¹ = σ(u¹) N¹ − λ n                  at θ on body 1,
    g² = σ(u²) N² + λ n dΓ¹/dΓ²         at φ(θ) on the deformed curve, dΓ¹/dΓ² = dφ/dθ.

The displacement is prescribed on the other circles. The interface has no ends, so that no node of
the pressure is special. Meshes have 11·2ᵏ facets on the slave against 8·2ᵏ on the master, straight
ones with displacements of degree 1 and curved ones with degree 2. Each solve starts from rest.

Best approximation allows for displacements of degree k the orders k in H¹ and k + 1 in L²; the
pressure may have the order k. Three things can spoil them.

* Straight facets: the polygons of both sides leave gaps and overlaps of up to h²/8, of a
  wavelength of about h. Such a disturbance of the interface costs h² h^(−1/2) in H¹ and h² in L²,
  and h in the pressure: just what degree 1 has anyway.
* The rule of integration: displacements of the master have kinks within the slave's facets. A rule
  that does not know where leaves errors of the nodal forces that are a fixed part of the forces,
  however fine the meshes. They alternate from node to node, with the wavelength h: hence h^(1/2)
  in H¹ and nothing at all in the pressure. Rules with more particles only have a smaller factor.
* Interpolated normals (F8): a nodal normal is the mean of the facets around, and n̄ is linear in
  between, also on curved facets. On a curve of curvature κ, with facets whose size h varies
  slowly, its angle errs by about h² (κ' + 2 κ h'/h)/4, not only here and there but in the mean
  over many facets: the pressure has a tangential part of order h². That is harmless with degree 1,
  but L² can then have no more than the order 2 with degree 2. Where neighbouring facets differ in
  size, the angle errs by κ (h₂ − h₁)/2 at their vertex, of order h. If it alternates, that costs h
  h^(1/2) in H¹. Facet normals of curved facets err by h² as well, but not in the mean over a
  facet.

    python3 benchmarks/convergence.py --output docs/convergence.md
    python3 benchmarks/convergence.py --small
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "convergence.png"
INSIDE, OUTSIDE = 0, 1  # the bodies
SLAVE, MASTER, HELD = 1, 2, 3  # facet tags
RADII = {INSIDE: (0.6, 1.0), OUTSIDE: (1.0, 1.4)}
FACETS = {INSIDE: 11, OUTSIDE: 8}  # on r = 1, times 2^level
E, NU = 1.0, 0.3
GROWTH, BULGE = 0.06, 0.02  # g(φ)
TURN, STRETCH = 0.1, 0.05  # t₀, t₁
MEAN, WAVE = 0.1, 0.05  # p(θ)
NORMS = ("displacement H1", "displacement L2", "pressure L2")

# -- the exact solution. Arithmetic only, so that it takes UFL's coordinates as well as arrays ----


def polar(x):
    """r, and the direction e(θ)."""
    r = (x[0] ** 2 + x[1] ** 2) ** 0.5
    return r, (x[0] / r, x[1] / r)


def slid(e):
    """Direction e(φ) and dφ/dθ on body 2, from e(θ)."""
    t = TURN + STRETCH * e[1]
    length = (1 + t**2) ** 0.5
    turned = (e[0] - t * e[1]) / length, (e[1] + t * e[0]) / length
    return turned, 1 + STRETCH * e[0] / (1 + t**2)


def growth(e):
    """g in the direction e."""
    return GROWTH + BULGE * (e[0] ** 2 - e[1] ** 2)


def displacement(x, body):
    """u of a body at points x."""
    r, e = polar(x)
    if body == OUTSIDE:
        e, _ = slid(e)
    radius = r + growth(e)
    return radius * e[0] - x[0], radius * e[1] - x[1]


def normal(e):
    """n of the deformed curve in the direction e: its tangent, turned outwards."""
    radius, slope = 1 + growth(e), -4 * BULGE * e[0] * e[1]  # of the curve, and d/dφ of it
    length = (radius**2 + slope**2) ** 0.5
    return (radius * e[0] + slope * e[1]) / length, (radius * e[1] - slope * e[0]) / length


def pressure(e):
    """Nominal pressure of the slave's point in the direction e, before and after."""
    return MEAN + WAVE * (4 * e[0] ** 3 - 3 * e[0])


# -- the meshes -----------------------------------------------------------------------------------


def ring(body, level, cell, degree, uneven=False):
    """A closed ring: a grid of angles and radii whose first and last columns are the same.

    Args:
        uneven: the facets are 0.7 and 1.3 times as long as their mean, in turn
    """
    facets, layers = FACETS[body] * 2**level, 2**level

    def mapping(x):
        angle, r = x.T
        if uneven:
            position = angle * facets / (2 * np.pi)  # integers at the vertices
            angle = angle + 0.15 * 2 * np.pi / facets * (1 - 2 * np.abs(position % 2 - 1))
        return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)

    inner, outer = RADII[body]
    cut = meshes.grid((facets, layers), (0, inner), (2 * np.pi, outer), mapping, cell, degree)
    around = degree * facets
    row, column = np.divmod(np.arange(len(cut.points)), around + 1)
    number = row * around + column % around
    return meshes.Body(cut.points[column < around], number[cut.cells], cell, degree)


# -- the model ------------------------------------------------------------------------------------


def stress(u):
    """Linear elastic, plane strain."""
    mu, lmbda = E / 2 / (1 + NU), E * NU / (1 + NU) / (1 - 2 * NU)
    strain = ufl.sym(ufl.grad(u))
    return 2 * mu * strain + lmbda * ufl.tr(strain) * ufl.Identity(2)


def vector(components):
    return ufl.as_vector(list(components))


def solve(level, cell, degree, pressure_degree, integration, normals, uneven):
    """Relative errors in the norms of NORMS, Newton iterations, and number of open particles."""
    rings = [
        ring(INSIDE, level, cell, degree),
        ring(OUTSIDE, level, cell, degree, uneven),
    ]
    mesh, body = meshes.create(COMM, rings)
    circle = lambda r: lambda x: np.isclose(x[0] ** 2 + x[1] ** 2, r**2)  # noqa: E731
    held = lambda x: circle(RADII[INSIDE][0])(x) | circle(RADII[OUTSIDE][1])(x)  # noqa: E731
    tags = meshes.tag_facets(
        mesh, {SLAVE: (circle(1), INSIDE), MASTER: (circle(1), OUTSIDE), HELD: held}, body
    )
    bodies = meshtags(mesh, 2, np.arange(len(body), dtype=np.int32), body)
    V = dc.vector_space(mesh, degree)
    u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)

    # bulk, and the loads of the exact solution
    def measure(kind, where, domain, quadrature_degree):
        metadata = {"quadrature_degree": quadrature_degree}
        return ufl.Measure(kind, domain, subdomain_data=where, metadata=metadata)

    dx = measure("dx", bodies, mesh, 2 * degree + 2)
    ds = measure("ds", tags, mesh, 2 * degree + 2)
    x, N = ufl.SpatialCoordinate(mesh), ufl.FacetNormal(mesh)
    exact = {i: vector(displacement(x, i)) for i in (INSIDE, OUTSIDE)}
    _, e = polar(x)
    turned, rate = slid(e)
    g1 = stress(exact[INSIDE]) * N + pressure(e) * vector(normal(e))
    g2 = stress(exact[OUTSIDE]) * N - pressure(turned) * rate * vector(normal(turned))
    F = ufl.inner(stress(u), ufl.grad(w)) * dx
    F += sum(ufl.inner(ufl.div(stress(exact[i])), w) * dx(i) for i in exact)
    F -= ufl.inner(g1, w) * ds(SLAVE) + ufl.inner(g2, w) * ds(MASTER)

    given = fem.Function(V)
    nodes, at = compat.dof_list(V), V.tabulate_dof_coordinates()
    for i in exact:
        own = np.unique(nodes[body == i])
        given.x.array.reshape(-1, 2)[own] = np.stack(displacement(at[own].T, i), axis=1)
    bc = fem.dirichletbc(given, fem.locate_dofs_topological(V, 1, tags.find(HELD)))

    # contact. Straight facets leave gaps from which a step must not begin open.
    pair = dc.ContactPair(
        dc.Surface(u, tags, SLAVE),
        dc.Surface(u, tags, MASTER),
        target=dc.Smooth() if normals == "interpolated" else dc.Proximity(),
        normals=normals,
        integration=integration,
        pressure_space=("Lagrange", pressure_degree),
        initial_contact=0.5,
    )
    report = dc.ContactProblem(F, u, [pair], bcs=[bc]).solve()

    # errors; the pressure's at the angles of points on the slave's facets
    dX = measure("dx", bodies, mesh, 2 * degree + 4)
    surface = pair.slave.mesh
    dS = measure("dx", None, surface, 10)
    p = pressure(polar(ufl.SpatialCoordinate(surface))[1])

    def norm(f):
        return sum(ufl.inner(f(i), f(i)) * dX(i) for i in exact)

    squares = {
        "displacement H1": (
            norm(lambda i: ufl.grad(u - exact[i])),
            norm(lambda i: ufl.grad(exact[i])),
        ),
        "displacement L2": (norm(lambda i: u - exact[i]), norm(lambda i: exact[i])),
        "pressure L2": ((pair.pressure - p) ** 2 * dS, p**2 * dS),
    }
    errors = {}
    for name, forms in squares.items():
        error, size = (compat.assemble_scalar(COMM, compat.form(form)) for form in forms)
        errors[name] = float(np.sqrt(error / size))
    opened = COMM.allreduce(int((pair.particles.status == "open").sum()))
    return errors, report.iterations, opened


# -- refinement -----------------------------------------------------------------------------------


def run(
    levels,
    cell="quadrilateral",
    degree=1,
    pressure_degree=1,
    integration=None,
    normals="interpolated",
    uneven=False,
):
    """Refine uniformly.

    Args:
        levels: the slave has 11·2^level facets; one after the other, since orders are taken from
            each to the next
        cell: shape of the cells
        degree: of the displacement and of the geometry
        pressure_degree: of the pressure, continuous
        integration: rule; None: Segments()
        normals: "interpolated" with Smooth(), or "facet" with Proximity()
        uneven: the master's facets are 0.7 and 1.3 times as long as their mean, in turn

    Returns:
        "errors" and "orders", for each norm of NORMS an array; relative errors; "iterations" and
        "open", the open particles, a list each
    """
    if integration is None:
        integration = dc.Segments()
    found = [
        solve(level, cell, degree, pressure_degree, integration, normals, uneven)
        for level in levels
    ]
    errors = {name: np.array([f[0][name] for f in found]) for name in NORMS}
    orders = {name: np.log2(values[:-1] / values[1:]) for name, values in errors.items()}
    return {
        "levels": list(levels),
        "errors": errors,
        "orders": orders,
        "iterations": [f[1] for f in found],
        "open": [f[2] for f in found],
    }


@dataclass(frozen=True)
class Case:
    """What run() takes, and the least orders at the last refinement, in the order of NORMS."""

    least: tuple[float, float, float]
    cell: str = "quadrilateral"
    degree: int = 1
    pressure_degree: int = 1
    integration: object = None
    normals: str = "interpolated"
    uneven: bool = False

    def run(self, levels):
        choice = {k: v for k, v in vars(self).items() if k != "least"}
        return run(levels, **choice)

    def name(self):
        """The first columns of the table."""
        return (
            f"{self.cell}s, {'un' if self.uneven else ''}even",
            f"{self.degree} / {self.pressure_degree}",
            f"`{self.integration or dc.Segments()}`".replace("degree=None", "").replace("n=", ""),
            self.normals,
        )


SLACK = 0.1  # how far orders may be below their limit: meshes are not infinitely fine
NONE = -1.0  # no order is asked for
# Triangles and quadrilaterals of both degrees, with exact integration
OPTIMAL = [
    *(Case((1, 2, 1), cell=cell) for cell in ("quadrilateral", "triangle")),
    *(
        Case((2, 2 if normals == "interpolated" else 3, 2), cell, 2, degree, normals=normals)
        for normals in ("interpolated", "facet")
        for cell in ("quadrilateral", "triangle")
        for degree in (1, 2)
    ),
]
# Degree 2 on an uneven master
UNEVEN = [
    Case((1.5, 2, NONE), degree=2, normals="interpolated", uneven=True),
    Case((2, 3, 2), degree=2, normals="facet", uneven=True),
]
# Rules that do not know where the master's facets end
RULES = [
    Case((NONE, NONE, NONE), degree=degree, pressure_degree=degree, integration=rule)
    for degree in (1, 2)
    for rule in (dc.Nodes(), dc.Simpson(1), dc.Simpson(2))
]
SMALL = [
    Case((1, 2, 1)),
    Case((2, 2, 2), degree=2),
    Case((2, 3, 2), degree=2, normals="facet"),
]
# Beside these the picture shows the orders that they should have
SLOPES = [Case((1, 2, 1)), Case((2, 3, 2), degree=2, pressure_degree=2, normals="facet")]
LEVELS = range(1, 6)


def check(case, result):
    """The orders at the last refinement are at least what they should be."""
    for name, least in zip(NORMS, case.least):
        order = result["orders"][name][-1]
        assert order >= least - SLACK, f"{case.name()}: {name} has order {order:.2f}, not {least}"
    assert result["open"][-1] == 0, f"{case.name()}: {result['open'][-1]} particles are open"


def compare(results):
    """What the page says about rules and normals, on the results of the full run."""

    def last(what, name, **choice):
        (found,) = (r for case, r in results.items() if case == Case(case.least, **choice))
        return found[what][name][-1]

    for degree in (1, 2):
        chosen = dict(degree=degree, pressure_degree=degree)
        by_rule = [
            last("errors", "pressure L2", integration=rule, **chosen)
            for rule in (dc.Nodes(), dc.Simpson(1), dc.Simpson(2), None)
        ]
        assert by_rule == sorted(by_rule, reverse=True), "richer rules have smaller errors"
        poor = {1: dc.Nodes(), 2: dc.Simpson(1)}[degree]
        order = last("orders", "pressure L2", integration=poor, **chosen)
        assert order < 0.5, "the pressure stagnates unless the integration is exact"
    for uneven, name, most in ((False, "displacement L2", 2.2), (True, "displacement H1", 1.7)):
        order = last("orders", name, degree=2, uneven=uneven)
        assert order < most, f"interpolated normals limit the order of {name}; if not, tell so"


# -- table, picture, page -------------------------------------------------------------------------

HEAD = (
    "| meshes | degrees of u / p | integration | normals | H¹ of u | orders | L² of u | orders |"
    " L² of p | orders |\n" + "|---" * 10 + "|"
)


def row(case, result):
    columns = list(case.name())
    for name in NORMS:
        columns.append(f"{result['errors'][name][-1]:.1e}")
        columns.append(" ".join(f"{order:.2f}" for order in result["orders"][name]))
    return "| " + " | ".join(columns) + " |"


def draw(results, file):
    """Errors over the number of the slave's facets, of quadrilaterals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 5.4))
    styles = {"Nodes": ":", "Simpson(n=1)": "-.", "Simpson(n=2)": "--"}
    drawn = {
        case: result
        for case, result in results.items()
        if case.cell == "quadrilateral" and not case.uneven and case.pressure_degree == case.degree
    }
    for axes, name in zip(figure.subplots(1, 3), NORMS):
        for case, result in drawn.items():
            facets = FACETS[INSIDE] * 2 ** np.array(result["levels"])
            rule = str(case.integration or dc.Segments()).replace("()", "")
            facet = case.normals == "facet"
            label = f"degree {case.degree}, {case.name()[2].strip('`')}"
            axes.loglog(
                facets,
                result["errors"][name],
                styles.get(rule, "-"),
                color="C2" if facet else f"C{case.degree - 1}",
                marker="s" if case.degree == 2 else "o",
                markersize=4,
                label=label + (", facet normals" if facet else ""),
            )
        for case in SLOPES:
            order, facets = case.least[NORMS.index(name)], FACETS[INSIDE] * 2.0 ** np.array([3, 5])
            values = 0.6 * results[case]["errors"][name][2] * (facets / facets[0]) ** -order
            axes.loglog(facets, values, color="0.5", lw=1)
            axes.annotate(
                f"{order} ", (facets[0], values[0]), color="0.4", ha="right", va="center"
            )
        ticks = FACETS[INSIDE] * 2 ** np.array(LEVELS)
        axes.set_xticks(ticks, ticks)
        axes.minorticks_off()
        axes.set(title=name.replace("H1", "H¹").replace("L2", "L²"), xlabel="slave facets")
        axes.grid(alpha=0.3, which="both")
    figure.axes[0].set_ylabel("relative error")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, fontsize=9)
    figure.subplots_adjust(left=0.06, right=0.98, top=0.94, bottom=0.29)
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


PAGE = """# Orders of convergence

    python3 benchmarks/convergence.py --output docs/convergence.md

Two rings meet at r = 1. They are given smooth displacements that move both sides of the interface
to the same closed curve, which is not a circle, while one slides along the other, and a smooth
pressure. Loads are chosen so that this is the exact solution; the script derives them. Contact
follows the large displacements and the sliding, the bulk is linear elastic. The slave has 11
facets where the master has 8, and all are halved from mesh to mesh: {first} to {last} slave
facets, straight with displacements of degree 1, curved with degree 2. *Interpolated* normals go
with `Smooth()` targets, the default, and *facet* normals with `Proximity()`. On *uneven* meshes
the master's facets are 0.7 and 1.3 times as long as their mean, in turn.

Relative errors on the finest mesh, and the orders from each mesh to the next:

{table}

![Errors over the number of facets](pictures/{picture})

What it shows:

* With exact integration and degree 1 orders are optimal: 1 in H¹, 2 in L², and 1 for the pressure,
  although the polygons of the two sides leave gaps and overlaps of order h² between them.
* With degree 2 the displacement in H¹ and the pressure have the order 2, on quadrilaterals and
  triangles, with pressures of degree 1 and 2. In L² the displacement has the optimal order 3 with
  facet normals, but 2 with interpolated ones: their angle errs by order h² in the mean over many
  facets, since they are linear within a facet, even a curved one, and a nodal normal is a mean
  over the facets around. So the pressure has a small tangential part that should not be there.
* Interpolated normals of curved facets want a master with facets of even size. Where neighbours
  differ, the normal at their vertex errs by order h. With degree 2 there remain the orders 1.5 in
  H¹ and 1 for the pressure.
* Rules that do not know where the master's facets end leave an error that refinement does not
  lower: the pressure oscillates from node to node by a part that depends on the rule alone, and H¹
  falls to the order 1/2 in the end. Degree 1 hides it under its other errors with `Simpson(1)`, on
  all but the finest meshes; degree 2 does not. Never use `Nodes()` with degree 2.
* Each solve begins at rest and takes {least} to {most} Newton iterations.
"""


def main(argv=None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--small", action="store_true", help="three levels and choices, no picture"
    )
    parser.add_argument("--picture", default=PICTURE, help=f"file to draw to ({PICTURE})")
    parser.add_argument("--output", help="file to write the page to")
    options = parser.parse_args(argv)
    begin, lines, results = time.time(), [HEAD], {}
    if COMM.rank == 0:
        print(HEAD)
    for case in SMALL if options.small else OPTIMAL + UNEVEN + RULES:
        results[case] = case.run(range(1, 4) if options.small else LEVELS)
        lines.append(row(case, results[case]))
        if COMM.rank == 0:
            print(lines[-1], flush=True)
    if COMM.rank == 0:
        print(f"{time.time() - begin:.0f} s")
    if not options.small and COMM.rank == 0:
        draw(results, options.picture)
        print("picture:", options.picture)
    for case, result in results.items():
        check(case, result)
    if not options.small:
        compare(results)
    if not options.small and options.output and COMM.rank == 0:
        iterations = sum((result["iterations"] for result in results.values()), [])
        text = PAGE.format(
            first=FACETS[INSIDE] * 2 ** LEVELS[0],
            last=FACETS[INSIDE] * 2 ** LEVELS[-1],
            table="\n".join(lines),
            picture=Path(options.picture).name,
            least=min(iterations),
            most=max(iterations),
        )
        Path(options.output).write_text(text, encoding="utf-8")
        print("page:", options.output)


if __name__ == "__main__":
    main()
