# SPDX-License-Identifier: MIT
"""Mixed bulk models with contact: displacement–pressure and displacement–pressure–dilatation.

The body is neo-Hookean in plane strain, ψ = μ/2 (tr C − 2 − 2 ln J) + λ/2 (J − 1)², and

    u–p    μ/2 (tr C − 2 − 2 ln J) + p (J − 1) − p²/2λ
    u–p–θ  μ/2 (tr C − 2 − 2 ln J) + λ/2 (θ − 1)² + p (J − θ)

With p and θ in DG1 and three Gauss points a triangle, p and θ interpolate at these points: all three
models are one to round-off. Taylor–Hood elements (P2/P1) take ν = 1/2, where 1/λ = 0 and the block of
p with p is empty.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import (
    BOTTOM,
    MASTER,
    SLAVE,
    TOP,
    Half,
    Material,
    Model,
    constant,
    distance,
    one_mesh,
    powers,
    two_meshes,
    values,
)

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
SHARP = dc.Newton(rtol=1e-12)  # one step more than the default
SPACES = {"u-p": ("DG", 1), "u-p-theta": ("DG", 1), "taylor-hood": ("Lagrange", 1)}


# -- models -----------------------------------------------------------------------------------


@dataclass
class Bulk:
    """Unknowns and residuals of a body, the displacement first."""

    u: list[fem.Function]
    F: list[Any]
    J: Any  # det of the deformation gradient
    dx: ufl.Measure


def bulk(model: Model, kind: str, young: float = 100.0, poisson: float = 0.3) -> Bulk:
    """A kind of SPACES, or "u", of the model's body; ν = 1/2 for mixed ones too."""
    u, mesh = model.u, model.mesh
    mu = constant(mesh, young / 2 / (1 + poisson))
    softness = constant(mesh, (1 + poisson) * (1 - 2 * poisson) / (young * poisson))  # 1/λ
    degree = 4 if kind == "taylor-hood" else 2
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": degree})
    gradient = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(gradient)
    energy = 0.5 * mu * (ufl.tr(gradient.T * gradient) - 2 - 2 * ufl.ln(J))
    unknowns = [u]
    if kind != "u":
        unknowns.append(scalar(mesh, SPACES[kind], "pressure"))
    if kind == "u":
        energy += 0.5 / softness * (J - 1) ** 2
    elif kind == "u-p-theta":
        p, dilatation = unknowns[1], scalar(mesh, SPACES[kind], "dilatation")
        dilatation.x.array[:] = 1.0
        unknowns.append(dilatation)
        energy += 0.5 / softness * (dilatation - 1) ** 2 + p * (J - dilatation)
    else:
        energy += unknowns[1] * (J - 1)
        if poisson < 0.5:
            energy -= 0.5 * softness * unknowns[1] ** 2
    tests = [ufl.TestFunction(v.function_space) for v in unknowns]
    return Bulk(
        unknowns, [ufl.derivative(energy * dx, v, w) for v, w in zip(unknowns, tests)], J, dx
    )


def scalar(mesh: Any, space: Any, name: str) -> fem.Function:
    return fem.Function(compat.function_space(mesh, space), name=name)


def no_bulk(u: fem.Function, young: float, poisson: float) -> None:
    """Placeholder of a law: ``bulk`` makes it."""


def halves(length: float = 1.0, drive: tuple[float, float] = (0.02, -0.08)) -> list[Half]:
    """A block with a round lower face on a flat block, of triangles. Sizes in `length`."""

    def bulge(x: np.ndarray) -> np.ndarray:
        y = x.copy()
        y[:, 1] += (1 - x[:, 1]) * 0.3 * (x[:, 0] - 0.47) ** 2
        return length * y

    def above(x: np.ndarray) -> np.ndarray:
        return np.abs(x[1] / length - 0.3 * (x[0] / length - 0.47) ** 2) < 1e-9

    upper = meshes.grid((7, 4), (0, 0), (1, 1), bulge, "triangle")
    lower = meshes.grid((6, 3), (-0.2, -0.8), (1.3, 0), lambda x: length * x, "triangle")
    at = lambda y: lambda x: np.isclose(x[1], length * y, atol=1e-9 * length)  # noqa: E731
    return [
        Half(upper, {SLAVE: above, TOP: at(1)}, {TOP: tuple(length * d for d in drive)}),
        Half(lower, {MASTER: at(0), BOTTOM: at(-0.8)}, {BOTTOM: (0.0, 0.0)}),
    ]


@dataclass
class Case:
    """A problem with its pair, bodies and models."""

    problem: dc.ContactProblem
    pair: dc.ContactPair
    bodies: list[Bulk]
    models: list[Model]


def make(
    where: str,
    kind: str,
    young: float = 100.0,
    poisson: float = 0.3,
    length: float = 1.0,
    friction: float = 0.3,
    rho: tuple[float | None, float | None] = (None, None),
    strategy: Any = SHARP,
    more: Any = lambda models, bodies: [],
    **options: Any,
) -> Case:
    """A block on a plane, or two bodies in one mesh or in two.

    Args:
        rho: ρ_n and ρ_τ
        more: further Dirichlet conditions
    """
    material, both = Material(no_bulk, 0.0, 0.0), halves(length)
    if where == "plane":
        models = [one_mesh(COMM, both[:1], material, degree=2)]
    elif where == "one mesh":
        models = [one_mesh(COMM, both, material, degree=2)]
    else:
        models = two_meshes(COMM, both, material, degree=2)
    bodies = [bulk(m, kind, young, poisson) for m in models]
    master: Any = dc.RigidPlane((0.0, 0.0), (0.05, 1.0))
    if where != "plane":
        master = models[-1].surface(MASTER)
    pair = dc.ContactPair(
        models[0].surface(SLAVE), master, friction=friction, rho_n=rho[0], rho_t=rho[1]
    )
    bcs = [bc for m in models for bc in m.bcs] + more(models, bodies)
    u, F = ([v for b in bodies for v in getattr(b, name)] for name in ("u", "F"))
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs, strategy=strategy, **options)
    return Case(problem, pair, bodies, models)


def integral(form: Any) -> float:
    return compat.assemble_scalar(COMM, compat.form(form))


# -- the same solution as with displacements alone --------------------------------------------------


@pytest.mark.parametrize("kind", ("u-p", "u-p-theta"))
@pytest.mark.parametrize("where", ("plane", "one mesh", "two meshes"))
def test_eliminated_fields(where, kind):
    """Up to round-off (1e-16) times the condition number of the matrix, about 1e4, and Newton's
    tolerance. Simpson's rule sees ρ_n and ρ_τ, which follow the block of u with u: it has μ alone in
    mixed models; thus they are given."""
    mixed, plain = make(where, kind, rho=(5.0, 100.0)), make(where, "u", rho=(5.0, 100.0))
    for drive in ((0.0, -0.08), (0.07, -0.08)):
        iterations = []
        for case in (mixed, plain):
            case.models[0].move(TOP, drive)
            iterations.append(case.problem.solve().iterations)
        assert abs(iterations[0] - iterations[1]) <= 1
    for a, b in zip(mixed.models, plain.models):
        assert distance(a.u, b.u) < 1e-9
    assert distance(mixed.pair.pressure, plain.pair.pressure) < 1e-9
    np.testing.assert_allclose(mixed.pair.resultant(), plain.pair.resultant(), rtol=1e-9)
    statuses = COMM.allreduce(list(mixed.pair.particles.status))
    assert len(set(statuses)) == 3
    for body in mixed.bodies:  # and the fields are what they stand for
        law = 100 * 0.3 / 1.3 / 0.4
        p, square = body.u[1], integral(body.u[1] ** 2 * body.dx)
        assert square > 0
        assert integral((p - law * (body.J - 1)) ** 2 * body.dx) < 1e-18 * square
        if kind == "u-p-theta":
            assert integral((body.u[2] - body.J) ** 2 * body.dx) < 1e-18 * square / law**2


@pytest.mark.parametrize("where", ("plane", "two meshes"))
def test_taylor_hood_is_near(where):
    """Continuous pressures of degree 1 leave another error of discretisation, about 1 %."""
    mixed, plain = make(where, "taylor-hood"), make(where, "u")
    mixed.problem.solve()
    plain.problem.solve()
    for a, b in zip(mixed.models, plain.models):
        assert distance(a.u, b.u) < 0.02
    force = plain.pair.resultant()
    np.testing.assert_allclose(mixed.pair.resultant(), force, atol=0.02 * force[1])


def test_blocks_by_hand():
    """Two meshes and a J with None, and the residuals in another order."""
    reference = make("two meshes", "taylor-hood")
    reference.problem.solve()
    given = make("two meshes", "taylor-hood")
    (u1, p1), (u2, p2) = (body.u for body in given.bodies)
    F = dict(zip((u1, p1, u2, p2), given.bodies[0].F + given.bodies[1].F))
    order = (p2, u1, p1, u2)
    coupled = ({u1, p1}, {u2, p2})
    J = [
        [ufl.derivative(F[a], b) if any({a, b} <= c for c in coupled) else None for b in order]
        for a in order
    ]
    bcs = given.models[0].bcs + given.models[1].bcs
    F = [F[v] for v in order]
    problem = dc.ContactProblem(F, order, [given.pair], bcs=bcs, J=J, strategy=SHARP)
    problem.solve()
    assert distance(u1, reference.models[0].u) < 1e-9
    assert distance(p2, reference.bodies[1].u[1]) < 1e-9


def test_uncoupled_blocks_are_none():
    """UFL's derivative of what is linear in p is an empty form, not one without entries."""
    case = make("two meshes", "taylor-hood", poisson=0.5)
    known = [[a is not None for a in row] for row in case.problem.system.bulk.J]
    body = [[True, True], [True, False]]
    np.testing.assert_array_equal(known, np.kron(np.eye(2, dtype=bool), body))


# -- incompressible ---------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ("plane", "one mesh", "two meshes"))
@pytest.mark.parametrize("poisson", (0.4999, 0.5))
def test_volume(where, poisson):
    case = make(where, "taylor-hood", poisson=poisson)
    report = case.problem.solve()
    assert report.iterations <= 15
    for body in case.bodies:
        p, work = body.u[1], fem.Function(body.u[1].function_space)
        q = ufl.TestFunction(work.function_space)
        softness = (1 + poisson) * (1 - 2 * poisson) / (100 * poisson)
        form = compat.form((body.J - 1 - softness * p) * q * body.dx)
        left = compat.assemble_vector_local(form, work)
        total = integral(abs(body.J - 1) * body.dx)
        assert np.abs(left).max(initial=0) < 1e-12  # of areas of about 1e-2
        # pointwise J − 1 is an error of discretisation; ∫ (J − 1) is none but for 1/λ
        assert total < 0.03
        assert abs(integral((body.J - 1) * body.dx)) < 1e-12 + 2 * softness * 50
    assert np.abs(case.pair.resultant()[1]) > 5


def test_newton_is_quadratic():
    case = make("two meshes", "taylor-hood", poisson=0.5, friction=0.0)
    case.problem.solve()
    u = case.models[0].u
    x = u.function_space.tabulate_dof_coordinates()
    wave = 1e-3 * np.stack([np.sin(5 * x[:, 1]), np.cos(4 * x[:, 0])], axis=1)
    case.problem.strategy = dc.Newton(rtol=1e-12)
    grown = powers(case.problem, u, wave, most=5)
    assert np.all(np.abs(grown / (1, 2, 4) - 1) < 0.1)


@pytest.mark.parametrize("kind, poisson", [("taylor-hood", 0.5), ("u-p-theta", 0.45)])
@pytest.mark.parametrize("where", ("plane", "one mesh", "two meshes"))
def test_tangent(where, kind, poisson):
    """The matrix of the whole system against central differences, block by block. Truncation is
    about (step/length)² = 1e-9, round-off 1e-16/step times the stiffest entries over the product.
    """
    case = make(where, kind, poisson=poisson)
    case.problem.solve()
    system, rng = case.problem.system, np.random.default_rng(5 + COMM.rank)
    system.start()
    x = system.x.copy()
    ends = [x.duplicate(), x.duplicate()]
    system.residual(x, system.b)
    system.freeze("status")
    system.jacobian(x, system.A)
    count = len(system.functions)
    for column in range(count):
        d = x.duplicate()
        d.set(0.0)
        part = system.layout.slice(column)
        d.array[part] = rng.normal(size=part.stop - part.start)
        d.array[system.layout.held_rows() - system.layout.start] = 0.0
        for contact in system.contacts:
            d.array[contact.held_rows() - system.layout.start] = 0.0
        product = x.duplicate()
        system.A.mult(d, product)
        step = 1e-6
        for sign, b in zip((1, -1), ends):
            y = x.copy()
            y.axpy(sign * step, d)
            system.residual(y, b)
        difference = (ends[0] - ends[1]) * (1 / (2 * step))
        for row in range(count):
            rows = system.layout.slice(row)
            error = difference.array_r[rows] - product.array_r[rows]
            sums = COMM.allreduce(
                np.array([error @ error, product.array_r[rows] @ product.array_r[rows]])
            )
            largest = product.norm()
            assert np.sqrt(sums[0]) < 1e-6 * max(np.sqrt(sums[1]), 1e-2 * largest), (row, column)


# -- units and scales -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind, poisson", [("taylor-hood", 0.5), ("u-p-theta", 0.4999)])
def test_units_do_not_matter(kind, poisson):
    """The same iterations and the same norms, but for the unit, but for round-off that a larger
    condition number amplifies."""
    reports, reference = {}, None
    for young, length in ((100.0, 1.0), (1e-3, 1.0), (1e9, 1.0), (100.0, 1e3), (100.0, 1e-3)):
        case = make("one mesh", kind, young, poisson, length, strategy=dc.Newton())
        report, force = case.problem.solve(), young * length
        # the first norm has Dirichlet rows as well, in which lengths stand beside forces
        norms = np.array(report.norms[1:]) / report.reference
        reports[young, length] = report.iterations, norms
        reference = reference or report.reference / force
        iterations, norms = reports[100.0, 1.0]
        assert report.iterations == iterations
        np.testing.assert_allclose(reports[young, length][1], norms, rtol=1e-3, atol=1e-10)
        assert reference == pytest.approx(report.reference / force, rel=1e-9)


def test_factors_of_rows_do_not_matter():
    """A volumetric row given in pressures, and with the other sign."""
    reports = []
    for factor in (1.0, -1e5):
        case = make("plane", "taylor-hood", poisson=0.5)
        F = [case.bodies[0].F[0], factor * case.bodies[0].F[1]]
        pair = dc.ContactPair(case.models[0].surface(SLAVE), case.pair.master, friction=0.3)
        problem = dc.ContactProblem(F, case.bodies[0].u, [pair], bcs=case.models[0].bcs)
        reports.append(problem.solve())
    a, b = (np.array(report.norms) for report in reports)
    np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-12 * reports[0].reference)


def test_scales():
    """Of the pressure about E/h [pressure/length] and of the dilatation 1/h, with the units given
    by the couplings; displacements have none."""
    case = make("one mesh", "u-p-theta", young=1e4, poisson=0.4999)
    system = case.problem.system
    system.start()
    h = 0.2
    assert system.scale[0] == 1.0 and system.bulk.displacements == [0]
    assert 0.1 < system.scale[1] / (1e4 / h) < 10
    assert 0.1 < system.scale[2] * h < 10
    np.testing.assert_allclose(system.bulk.row_scale, system.scale[:3], rtol=1e-10)


# -- Dirichlet conditions on other unknowns ----------------------------------------------------------


def test_held_pressure():
    """Pressures held at their values in the solution change nothing, whether they are met at first
    or not; there is no block of p with p that could carry them."""
    reference = make("plane", "taylor-hood", poisson=0.5)
    reference.problem.solve()
    held = {}

    def hold(models: list[Model], bodies: list[Bulk]) -> list[Any]:
        V = bodies[0].u[1].function_space
        held["p"] = fem.Function(V)
        dofs = fem.locate_dofs_geometrical(V, lambda x: x[0] < 0.3)
        return [fem.dirichletbc(held["p"], dofs)]

    case = make("plane", "taylor-hood", poisson=0.5, more=hold)
    held["p"].x.array[:] = reference.bodies[0].u[1].x.array  # the same mesh and partition
    report = case.problem.solve()
    assert report.converged and report.iterations <= 15
    assert distance(case.models[0].u, reference.models[0].u) < 1e-8
    assert distance(case.bodies[0].u[1], reference.bodies[0].u[1]) < 1e-8


# -- steps ------------------------------------------------------------------------------------------


def test_a_failed_step_restores_all_fields():
    case = make("one mesh", "u-p-theta", poisson=0.49)
    case.problem.solve()
    before = [f.x.array.copy() for f in case.problem.system.functions]
    case.models[0].move(TOP, (0.1, -0.15))
    case.problem.strategy.max_it = 1
    try:
        with pytest.raises(dc.ConvergenceError):
            case.problem.solve()
    finally:
        case.problem.strategy.max_it = 30
    for f, values_before in zip(case.problem.system.functions, before):
        np.testing.assert_array_equal(f.x.array, values_before)


def test_load_steps():
    """Pressures are extrapolated like displacements, and put back with them; the way does not matter
    without friction."""
    once = make("plane", "taylor-hood", poisson=0.5, friction=0.0)
    once.problem.solve()
    case = make("plane", "taylor-hood", poisson=0.5, friction=0.0, strategy=dc.Newton(rtol=1e-12))

    def press(t: float) -> None:
        case.models[0].move(TOP, (0.02 * t, -0.08 * t))

    steps = dc.LoadStepping(case.problem, press, step=0.25, progress=False)
    iterations, fields = [], []
    for step in steps:
        iterations.append(step.report.iterations)
        fields.append(case.bodies[0].u[1].x.array.copy())
        if step.number == 2:  # one that fails
            case.problem.strategy.max_it = 1
            with pytest.raises(dc.ConvergenceError):
                next(
                    iter(
                        dc.LoadStepping(
                            case.problem, press, step=0.25, min_step=0.25, progress=False
                        )
                    )
                )
            case.problem.strategy.max_it = 30
            np.testing.assert_array_equal(case.bodies[0].u[1].x.array, fields[-1])
            press(steps.time)
    assert max(iterations) <= 10
    assert distance(case.models[0].u, once.models[0].u) < 1e-8
    assert distance(case.bodies[0].u[1], once.bodies[0].u[1]) < 1e-8


def test_fixed_point():
    """The nested loops, to the same solution."""
    a = make("plane", "taylor-hood", poisson=0.5)
    b = make("plane", "taylor-hood", poisson=0.5, strategy=dc.FixedPoint(rtol=1e-12))
    a.problem.solve()
    b.problem.solve()
    assert distance(a.models[0].u, b.models[0].u) < 1e-8
    assert distance(a.bodies[0].u[1], b.bodies[0].u[1]) < 1e-8


# -- bodies that nothing holds ----------------------------------------------------------------------


def loose(gap: float) -> tuple[Model, Bulk, dc.ContactProblem]:
    """An incompressible block pushed down by a pressure of 1, above a plane."""
    block = meshes.grid((4, 3), (0, gap), (1, 1 + gap), cell="triangle")
    faces = {
        SLAVE: lambda x: np.isclose(x[1], gap),
        TOP: lambda x: np.isclose(x[1], 1 + gap),
        BOTTOM: lambda x: np.isclose(x[0], 0),
    }
    half = Half(block, faces, {BOTTOM: (0.0, None)})
    model = one_mesh(COMM, [half], Material(no_bulk, 0.0, 0.0), degree=2)
    body = bulk(model, "taylor-hood", poisson=0.5)
    ds = ufl.Measure("ds", domain=model.mesh, subdomain_data=model.tags)
    w = ufl.TestFunction(model.u.function_space)
    body.F[0] += constant(model.mesh, 1.0) * w[1] * ds(TOP)
    pair = dc.ContactPair(model.surface(SLAVE), dc.RigidPlane((0.0, 0.0), (0.0, 1.0)))
    return model, body, dc.ContactProblem(body.F, body.u, [pair], bcs=model.bcs)


def test_a_block_held_by_contact_alone():
    model, body, problem = loose(0.0)
    assert problem.solve().iterations <= 6
    # E = 100, ν = 1/2, one side free to slide, the other free: homogeneous
    np.testing.assert_allclose(values(problem.pairs[0].pressure)[1], 1.0, rtol=1e-9)
    assert np.ptp(values(body.u[1])[1]) < 1e-9


def test_a_loose_block_is_reported():
    model, body, problem = loose(0.1)
    with pytest.raises(dc.UnheldError, match="slave of pair 0.* is free: translation along y"):
        problem.solve()
    assert not model.u.x.array.any() and not body.u[1].x.array.any()


def test_no_pairs():
    """The bulk alone."""
    model = one_mesh(COMM, halves()[:1], Material(no_bulk, 0.0, 0.0), degree=2)
    body = bulk(model, "taylor-hood", poisson=0.5)
    facets = model.tags.indices[model.tags.values == SLAVE]
    V = model.u.function_space
    clamp = fem.dirichletbc(fem.Function(V), fem.locate_dofs_topological(V, 1, facets))
    problem = dc.ContactProblem(body.F, body.u, [], bcs=[*model.bcs, clamp])
    assert problem.solve().iterations <= 8
    assert values(body.u[1])[1].min() < -1


# -- the how-to -------------------------------------------------------------------------------------


def test_recipes():
    """Those of docs/mixed.md run one after the other, to the same solution."""
    text = (Path(__file__).parent.parent / "docs" / "mixed.md").read_text()
    recipes = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {}
    resultants = []
    for recipe in recipes:
        exec(compile(textwrap.dedent(recipe), "mixed.md", "exec"), names)
        resultants.append(names["pair"].resultant())
    assert len(resultants) == 2 and resultants[0][1] > 0.1
    # p and θ = 1 + p/λ are of one space: the same equations
    np.testing.assert_allclose(resultants[1], resultants[0], atol=1e-6 * resultants[0][1])
    assert values(names["theta"])[1].min() > 0.99


# -- bad input --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def block():
    case = make("plane", "taylor-hood")
    return case.models[0], case.bodies[0], case.pair


def test_missing_residual(block):
    model, body, pair = block
    with pytest.raises(dc.InputError, match="1 residuals F for 2 unknowns"):
        dc.ContactProblem(body.F[0], body.u, [pair], bcs=model.bcs)


def test_missing_displacement(block):
    model, body, pair = block
    with pytest.raises(dc.InputError, match="not among the unknowns u"):
        dc.ContactProblem(body.F[1], body.u[1], [pair])


def test_wrong_order(block):
    model, body, pair = block
    with pytest.raises(dc.InputError, match=r"F\[0\] is not of the space of u\[0\]"):
        dc.ContactProblem(body.F[::-1], body.u, [pair], bcs=model.bcs)


def test_energy_instead_of_residual(block):
    model, body, pair = block
    energy = body.u[1] ** 2 * body.dx
    with pytest.raises(dc.InputError, match=r"F\[1\] has 0 test functions"):
        dc.ContactProblem([body.F[0], energy], body.u, [pair], bcs=model.bcs)


def test_one_function_twice(block):
    model, body, pair = block
    with pytest.raises(dc.InputError, match="a Function twice"):
        dc.ContactProblem([body.F[0]] * 2, [model.u] * 2, [pair], bcs=model.bcs)


def test_wrong_shape_of_jacobian(block):
    model, body, pair = block
    J = [[ufl.derivative(body.F[0], model.u)]]
    with pytest.raises(dc.InputError, match="2 rows of 2 forms"):
        dc.ContactProblem(body.F, body.u, [pair], bcs=model.bcs, J=J)


def test_condition_on_another_space(block):
    model, body, pair = block
    W = compat.vector_space(model.mesh, 2)
    stray = fem.dirichletbc(fem.Function(W), np.arange(1, dtype=np.int32))
    with pytest.raises(dc.InputError, match="is that of 0 unknowns"):
        dc.ContactProblem(body.F, body.u, [pair], bcs=[*model.bcs, stray])


def test_condition_on_a_space_of_two_unknowns():
    model = one_mesh(COMM, halves()[:1], Material(no_bulk, 0.0, 0.0), degree=2)
    body = bulk(model, "u-p-theta")
    Q = body.u[1].function_space
    q, theta = ufl.TestFunction(Q), fem.Function(Q)
    F = [*body.F[:2], (theta - 1) * q * body.dx]
    pair = dc.ContactPair(model.surface(SLAVE), dc.RigidPlane((0.0, 0.0), (0.0, 1.0)))
    held = fem.dirichletbc(fem.Function(Q), np.arange(1, dtype=np.int32))
    with pytest.raises(dc.InputError, match="that of 2 unknowns.* space of its own"):
        dc.ContactProblem(F, [*body.u[:2], theta], [pair], bcs=[*model.bcs, held])
