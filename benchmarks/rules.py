# SPDX-License-Identifier: MIT
"""Which rule to choose: the error of the contact integrals against their cost.

Three problems on non-matching meshes: the two blocks of demos/two_blocks.py, a pair of turned cubes,
whose exact pressure is uniform, and a sphere pressed on a block in 3D (a quarter of both). There
each rule's pressure is compared with that of the same meshes integrated with 6-Simpson: what differs
is the integration alone. The cost is the time of one search, residual and tangent of the whole pair,
without the bulk, and the number of Newton's iterations.

    python3 benchmarks/rules.py [--small] [--output docs/rules.md]
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import meshes
from dolfinx_contact.compat import assemble_scalar, form, vector_space

comm = MPI.COMM_WORLD
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2
RULES = [dc.Nodes(), dc.Simpson(0), dc.Simpson(1), dc.Simpson(2), dc.Simpson(3), dc.Segments()]


def model(bodies, predicates, E, nu):
    """Linear elasticity of two bodies: displacement, residual, tags."""
    mesh, body = meshes.create(comm, bodies)
    tags = meshes.tag_facets(mesh, predicates, body)
    V = vector_space(mesh, 1)
    u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
    e = lambda v: ufl.sym(ufl.grad(v))  # noqa: E731
    G, lmbda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
    stress = 2 * G * e(u) + lmbda * ufl.tr(e(u)) * ufl.Identity(len(u))
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    return u, ufl.inner(stress, e(w)) * dx, tags


def block(dim, counts, cell, turn):
    """Two blocks of unit height, turned, pressed by 0.01 of it: uniform pressure with ν = 0."""
    up = turn[:, -1]
    at = lambda z: lambda x: np.isclose(up @ x[:dim], z)  # noqa: E731
    grids = [
        meshes.grid(
            (n,) * (dim - 1) + (3,),
            [0.0] * (dim - 1) + [-i],
            [1.0] * (dim - 1) + [1 - i],
            mapping=lambda x: x @ turn.T,
            cell=cell,
        )
        for i, n in enumerate(counts)
    ]
    faces = {SLAVE: (at(0), 0), MASTER: (at(0), 1), TOP: at(1), BOTTOM: at(-1)}
    u, F, tags = model(grids, faces, 1.0, 0.0)
    V, bcs = u.function_space, []
    for tag, value in ((TOP, -0.01 * up), (BOTTOM, np.zeros(dim))):
        dofs = fem.locate_dofs_topological(V, dim - 1, tags.find(tag))
        bcs.append(fem.dirichletbc(value, dofs, V))
    return u, F, tags, bcs


def sphere(n):
    """A quarter of a sphere (R = 1) on a block; 0.03 deep, at once."""
    R, width, depth = 1.0, 0.45, 0.03

    def round_bottom(x):
        low = R - np.sqrt(R**2 - x[:, 0] ** 2 - x[:, 1] ** 2)
        return np.column_stack([x[:, :2], low + (0.6 - low) * x[:, 2]])

    upper = meshes.grid((n, n, n), (0, 0, 0), (width, width, 1), round_bottom, "hexahedron")
    m = round(1.3 * n)
    lower = meshes.grid((m, m, n), (0, 0, -0.6), (0.6, 0.6, 0), cell="hexahedron")
    on_sphere = lambda x: np.abs(x[0] ** 2 + x[1] ** 2 + (x[2] - R) ** 2 - R**2) < 1e-9
    at = lambda i, z: lambda x: np.isclose(x[i], z)  # noqa: E731
    planes = {3: at(0, 0), 4: at(1, 0), TOP: at(2, 0.6), BOTTOM: at(2, -0.6)}
    u, F, tags = model([upper, lower], {SLAVE: (on_sphere, 0), MASTER: (at(2, 0), 1)}, 1.0, 0.3)
    _, where = u.function_space.mesh, u.function_space
    bcs = []
    for tag, component, value in ((3, 0, 0.0), (4, 1, 0.0), (TOP, 2, -depth), (BOTTOM, 2, 0.0)):
        W, _ = where.sub(component).collapse()
        given = fem.Function(W)
        given.x.array[:] = value
        # by position: an edge belongs to two of the planes
        dofs = fem.locate_dofs_geometrical((where.sub(component), W), planes[tag])
        bcs.append(fem.dirichletbc(given, dofs, where.sub(component)))
    return u, F, tags, bcs


def run(case, rule):
    """The solved pair, its report and the time of one contact evaluation [s]."""
    u, F, tags, bcs = case
    u.x.array[:] = 0
    pair = dc.ContactPair(
        dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER), integration=rule
    )
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    report = problem.solve()
    system = problem.system
    contact, times = system.contacts[0], []
    for _ in range(3):
        start = time.perf_counter()
        contact.update()
        contact.assembler.residual(system.b.handle)
        contact.assembler.tangent(system.A.handle)
        times.append(time.perf_counter() - start)
        system.b.assemble()
        system.A.assemble()
    return pair, report, comm.allreduce(min(times), op=MPI.MAX)


def norm(f):
    dx = ufl.Measure("dx", f.function_space.mesh, metadata={"quadrature_degree": 4})
    return np.sqrt(assemble_scalar(comm, form(ufl.inner(f, f) * dx)))


def measure(cases):
    """Rows (problem, rule, particles a facet, error, iterations, µs a facet)."""
    rows = []
    for name, case, reference in cases:
        if reference is not None:
            reference = run(case, reference)[0].pressure.copy()
        for rule in RULES:
            pair, report, seconds = run(case, rule)
            p = pair.pressure
            expected = p.copy()
            if reference is None:
                expected.x.array[:] = 0.005
            else:
                expected.x.array[:] = reference.x.array
            wrong = p.copy()
            wrong.x.array[:] = p.x.array - expected.x.array
            error = norm(wrong) / norm(expected)
            facets = comm.allreduce(len(pair.slave.id))
            particles = comm.allreduce(len(pair.particles)) / facets
            row = (name, rule, particles, error, report.iterations, 1e6 * seconds / facets)
            rows.append(row)
            if comm.rank == 0:
                print("{}, {}: {:.1f} particles, {:.2e}, {} iterations, {:.0f} µs".format(*row))
    return rows


def main(arguments):
    parser = argparse.ArgumentParser()
    parser.add_argument("--small", action="store_true", help="coarse meshes")
    parser.add_argument("--output", type=Path, help="page to write")
    options = parser.parse_args(arguments)
    angle = 0.4
    turn2 = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn3 = Rotation.from_euler("xyz", [0.3, 0.5, -0.7]).as_matrix()
    n = 4 if options.small else 12
    rows = measure(
        [
            ("blocks, 11 on 8", block(2, (11, 8), "quadrilateral", turn2), None),
            ("cubes, 7² on 5² hexahedra", block(3, (7, 5), "hexahedron", turn3), None),
            ("cubes, 7² on 5² tetrahedra", block(3, (7, 5), "tetrahedron", turn3), None),
            (f"sphere, {n}² facets", sphere(n), dc.Simpson(4 if options.small else 6)),
        ]
    )
    by = {(name, str(rule)): row for name, rule, *row in rows}
    for name in dict.fromkeys(name for name, *_ in rows):
        exact, simpson = by[name, str(RULES[-1])], by[name, str(dc.Simpson(2))]
        assert exact[1] < 1.05 * simpson[1], "segments are at least as accurate as 2-Simpson"
        assert exact[2] <= simpson[2] + 2, "and converge as well"
    if options.output is not None and comm.rank == 0:
        options.output.write_text(page(rows))


def page(rows):
    lines = [
        "# Which rule to choose",
        "",
        "Error of the contact pressure (relative, in L²) against cost, by `benchmarks/rules.py`. Blocks",
        "and cubes have a uniform exact pressure; the sphere is compared with 6-Simpson on the same",
        "mesh, so that the error is the integration's alone. The time is that of one search, residual",
        "and tangent of the contact, on one core.",
        "",
        "| problem | rule | particles a facet | error | Newton iterations | µs a facet |",
        "|---|---|---|---|---|---|",
    ]
    for name, rule, particles, error, iterations, cost in rows:
        rule = "Segments()" if isinstance(rule, dc.Segments) else str(rule).replace("n=", "")
        lines.append(
            f"| {name} | `{rule}` | {particles:.1f} | {error:.1e} | {iterations} | {cost:.0f} |"
        )
    return "\n".join(lines) + (
        "\n\n"
        "* `Simpson(1)`, the default, is right to a few percent of the pressure and is the cheapest\n"
        "  rule that decides statuses inside of facets.\n"
        "* `Segments()` passes the patch test to round-off. Take it where the pressure itself counts,\n"
        "  with fine meshes or with degree 2: there the error of Simpson's rules does not fall with\n"
        "  the mesh (docs/convergence.md).\n"
        "  The cells move with both surfaces, and Newton's tangent knows how: it converges as with\n"
        "  Simpson's rules.\n"
        "* Simpson's rules are exact by chance where the master's nodes fall on ends of sub-elements,\n"
        "  as 3-Simpson does with 11 on 8 facets.\n"
        "* `Nodes()` decides statuses at nodes: results do not depend on ρ_n, and Signorini's and\n"
        "  Coulomb's laws hold pointwise there. Its pressures oscillate most.\n"
        "* Where the edge of contact lies inside of a facet, no rule is exact: statuses are decided at\n"
        "  particles, and more of them count for more than their places.\n"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
