# SPDX-License-Identifier: MIT
"""Newton's loop and the nested loops: the same solutions, by different ways; and what ρ is worth."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from problems import (
    BOTTOM,
    MASTER,
    ROTATION,
    SLAVE,
    TOP,
    Half,
    Material,
    distance,
    dome,
    neo_hookean,
    one_mesh,
    punch,
    small_strain,
    striped,
    taylor_blocks,
)

import dolfinx_contact as dc
from dolfinx_contact import meshes, newton

COMM = MPI.COMM_WORLD
NORMAL, ASIDE = ROTATION[:, 2], ROTATION @ (0.8, 0.6, 0.0)

#: of the punch: pressed, pressed and pushed aside, dragged
DRAGGED = [(0.0, -0.04), (0.01, -0.06), (0.06, -0.06)]
#: of the dome, likewise
DRAGGED_3D = [-0.02 * NORMAL, -0.04 * NORMAL + 0.004 * ASIDE, -0.04 * NORMAL + 0.02 * ASIDE]

#: model, path of its top, options of the pair
CASES = {
    "punch": (punch, DRAGGED, {"friction": 0.3}),
    "frictionless": (punch, DRAGGED, {}),
    "3D": (dome, DRAGGED_3D, {"friction": 0.3, "normals": "interpolated"}),
    "plane": (punch, DRAGGED, {"friction": 0.3, "plane": True}),
}


def set_up(case, strategy=None, comm=COMM, partition=None):
    """Model, pair and problem of a case."""
    make, _, options = CASES[case]
    model, options = make(comm, partition), dict(options)
    master = model.surface(MASTER)
    if options.pop("plane", False):
        master = dc.RigidPlane((0, 0), (0, 1))
    pair = dc.ContactPair(model.surface(SLAVE), master, **options)
    return model, pair, model.problem(pair, strategy=strategy)


def solve(case, strategy=None, comm=COMM, partition=None):
    """The same after all steps, and their reports."""
    model, pair, problem = set_up(case, strategy, comm, partition)
    reports = []
    for displacement in CASES[case][1]:
        model.move(TOP, displacement)
        reports.append(problem.solve())
    return model, pair, reports


def differences(a, b):
    """Of u, pressure and friction of two solutions, relative to the largest."""
    (model, pair), (other, again) = a[:2], b[:2]
    out = [distance(model.u, other.u), distance(pair.pressure, again.pressure)]
    if pair.friction is not None:
        out.append(distance(pair.friction, again.friction))
    return out


def count(pair, status):
    return pair.comm.allreduce(int(np.sum(pair.particles.status == status)))


# -- the nested loops -----------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES)
def test_fixed_point_finds_newtons_solution(case):
    """Partly open, with slip, over several steps. Both stop at 1e-10 of the forces; the stiffness of
    the softest mode is some 1e-2 of the stiffest, a margin of 10 for the pressures."""
    a, b = solve(case, dc.Newton()), solve(case, dc.FixedPoint())
    assert max(differences(a, b)) < 1e-7
    for status in ("open", "slip"):
        assert count(a[1], status) == count(b[1], status) > 0
    np.testing.assert_allclose(b[1].resultant(), a[1].resultant(), rtol=1e-7, atol=1e-7)
    assert all(report.converged for report in b[2])


@pytest.mark.parametrize("case", CASES)
def test_fixed_point_takes_more_solves_and_says_what_changed(case):
    """The statuses that change between its loops are in the report, as Newton's are."""
    (_, _, reports), (_, _, nested) = solve(case, dc.Newton()), solve(case, dc.FixedPoint())
    assert sum(r.iterations for r in nested) > sum(r.iterations for r in reports)
    assert sum(map(sum, (r.status_changes for r in reports))) > 0
    assert sum(map(sum, (r.status_changes for r in nested))) > 0
    if "friction" in CASES[case][2]:
        assert sum(map(sum, (r.slip_changes for r in nested))) > 0
    for report in nested:  # a line for each residual that was looked at
        columns = (report.status_changes, report.slip_changes, report.reversals)
        assert all(len(column) == len(report.norms) for column in columns)


@pytest.mark.parametrize("case", ("punch", "3D"))
def test_fixed_point_on_any_number_of_ranks(case):
    """Both partitions end the loops at the same tolerances, since norms agree but for round-off."""
    shared = solve(case, dc.FixedPoint(rtol=1e-12), COMM, striped)
    alone = solve(case, dc.FixedPoint(rtol=1e-12), MPI.COMM_SELF)
    assert max(differences(shared, alone)) < 1e-8  # solved to 1e-12 of the forces
    assert [r.iterations for r in shared[2]] == [r.iterations for r in alone[2]]


def table(problem):
    """Everything the assembler tells about its particles."""
    return problem.system.contacts[0].assembler.particles()


#: too few loops of one kind, or too few iterations for a bold step
FAILURES = {
    "loops": ({"max_loops": 1}, (0.01, -0.06)),
    "threshold": ({"max_loops": 3}, (0.1, -0.1)),
    "iterations": ({"max_it": 1}, (0.8, -0.7)),
}


@pytest.mark.parametrize("accepted", (0, 1))
@pytest.mark.parametrize("failure", FAILURES)
def test_a_fixed_point_that_fails_leaves_no_trace(failure, accepted):
    """Everything is as before, nothing stays frozen: Newton goes on as if it had not been tried.

    ``accepted``: steps before the one that fails."""
    options, bold = FAILURES[failure]
    results = []
    for fail in (True, False):
        model, pair, problem = set_up("punch", dc.Newton(rtol=1e-12))
        for displacement in DRAGGED[:accepted]:
            model.move(TOP, displacement)
            problem.solve()
        if fail:
            functions, before = problem.system.functions, table(problem)
            arrays = [f.x.array.copy() for f in functions]
            model.move(TOP, bold)
            problem.strategy = dc.FixedPoint(**options)
            with pytest.raises(dc.ConvergenceError, match="settled|DIVERGED") as caught:
                problem.solve()
            assert not caught.value.report.converged
            for f, values in zip(functions, arrays):
                np.testing.assert_array_equal(f.x.array, values)
            after = table(problem)
            for name in ("closed", "slips", "target_facet", "clamped", "dissipated"):
                np.testing.assert_array_equal(after[name], before[name], err_msg=name)
            problem.strategy = dc.Newton(rtol=1e-12)
        model.move(TOP, DRAGGED[accepted])
        problem.solve()
        results.append((model, pair))
    assert max(differences(*results)) < 1e-11  # bitwise the same start


# -- shortened steps ------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", (0.3, 0.5, 0.8))
def test_shortened_steps_end_cycles(friction, monkeypatch):
    """A stiff block with sharp edges on a slab on a plane, in bold steps. With whole steps at least
    one of Newton's loops cycles until its iterations are used up; none does with shortened ones.
    """
    file = Path(__file__).parent.parent / "benchmarks" / "robustness.py"
    stack = runpy.run_path(str(file))["stack"]
    run, lost = newton.NewtonLoop.run, []

    def counted(self, *args):
        converged = run(self, *args)
        lost[-1] += not converged
        return converged

    monkeypatch.setattr(newton.NewtonLoop, "run", counted)
    for whole in (False, True):
        if whole:
            monkeypatch.setattr(newton.NewtonLoop, "_shorten", lambda self, x, step: None)
        problem, _, (down, along) = stack((6, 3), (20, 3), friction)
        lost.append(0)
        try:
            for apply, t in ((down[0], 0.05), (down[0], 0.1), (along[0], 0.4), (along[0], 0.8)):
                apply(t)
                problem.solve()
        except dc.ConvergenceError:
            assert whole
    assert lost[0] == 0 and lost[1] > 0


def test_trial_points_leave_no_trace():
    """Residuals between mark and recall, where particles open and close and slip, change nothing
    that a later residual would show: statuses, targets, nor how often a particle has changed."""
    model, pair, problem = set_up("punch")
    for displacement in DRAGGED:
        model.move(TOP, displacement)
        problem.solve()
    system = problem.system
    x, b = system.x.duplicate(), system.b.duplicate()
    system.x.copy(x)
    system.residual(x, b)
    before, norm, force = table(problem), b.norm(), b.array.copy()
    trial, other = x.duplicate(), b.duplicate()
    for i in range(8):  # more than the patience with a particle
        trial.array[:] = x.array * (0.5 if i % 2 else -1.0)
        system.mark()
        system.residual(trial, other)
        assert system.changes[0] > 0 and other.norm() > norm
        system.recall()
    system.residual(x, b)
    assert not system.changes.any()
    for name, values in table(problem).items():
        np.testing.assert_array_equal(values, before[name], err_msg=name)
    # shares of other ranks are added in the order in which they arrive: round-off of a few terms
    np.testing.assert_allclose(b.array, force, rtol=0, atol=1e-14 * norm)


# -- the augmentation parameters ------------------------------------------------------------------


def hertz():
    """Two spherical caps, mirror images, axisymmetric in the weights of contact only: the bulk is in
    plane strain, which makes no difference to what is tested."""

    def cap(side):
        def mapping(x):
            angle = np.pi / 3 * (0.4 * x[:, 0] + 0.6 * x[:, 0] ** 3)
            low = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
            top = np.stack([0.9 * x[:, 0], np.ones(len(x))], axis=1)
            return (low + x[:, 1:] * (top - low)) * (1, side)

        return meshes.grid((14, 5), mapping=mapping)

    sphere = lambda x: np.isclose(np.hypot(x[0], np.abs(x[1]) - 1), 1)  # noqa: E731
    at = lambda i, value: lambda x: np.isclose(x[i], value)  # noqa: E731
    halves = [
        Half(cap(1), {SLAVE: sphere, TOP: at(1, 1), 3: at(0, 0)}, {TOP: (None, 0), 3: (0, None)}),
        Half(
            cap(-1),
            {MASTER: sphere, BOTTOM: at(1, -1), 4: at(0, 0)},
            {BOTTOM: (0, 0), 4: (0, None)},
        ),
    ]
    return one_mesh(COMM, halves, Material(small_strain, 2e4, 0.3))


def cord():
    """Upper half of a ring on a cylinder, whose lower quarter is left out."""

    def ring(radii, angles, counts):
        (a, b), (first, last) = radii, np.deg2rad(angles)

        def mapping(x):
            r, angle = a + (b - a) * x[:, 1], last + (first - last) * x[:, 0]
            return r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)

        return meshes.grid(counts, mapping=mapping)

    circle = lambda r: lambda x: np.isclose(np.hypot(x[0], x[1]), r)  # noqa: E731
    ends = lambda x: np.isclose(x[1], 0)  # noqa: E731
    halves = [
        Half(ring((10, 11), (0, 180), (32, 3)), {SLAVE: circle(10), TOP: ends}, {TOP: (None, 0)}),
        Half(
            ring((5, 10), (-45, 225), (72, 4)),
            {MASTER: circle(10), BOTTOM: circle(5)},
            {BOTTOM: (0.0, 0.0)},
        ),
    ]
    return one_mesh(COMM, halves, Material(neo_hookean, 68.96e8, 0.32))


#: the paper's problems, smaller and with friction; in place of the sheet a punch that is dragged
PAPER = {
    "Hertz": (hertz, [(None, -0.02), (None, -0.04)], {"axisymmetric": True}),
    "two blocks": (lambda: taylor_blocks(COMM), [(None, -0.012), (None, -0.024)], {}),
    "cord": (cord, [(None, -0.2 * i) for i in range(1, 6)], {}),
    "punch": (lambda: punch(COMM), DRAGGED, {}),
}


def press(name, **options):
    """Resultant, highest pressure and the parameters."""
    make, path, more = PAPER[name]
    model = make()
    pair = model.pair(friction=0.2, **more, **options)
    problem = model.problem(pair)
    for displacement in path:
        model.move(TOP, displacement)
        problem.solve()
    highest = COMM.allreduce(pair.pressure.x.array.max(initial=0.0), op=MPI.MAX)
    return pair.resultant(), highest, problem.system.parameters.chosen[0]


@pytest.mark.parametrize("name", PAPER)
def test_parameters_need_no_tuning(name):
    """Ten times less and more than the automatic values: Newton converges, to the same answer but
    for particles inside facets near the edge of contact, where d_n ≠ 0 (formulation, section 7): up
    to 4e-3 of the resultant (punch) and 1.4e-2 of the highest pressure (cord, where a mesh of twice
    the facets changes it by 19 %)."""
    force, highest, automatic = press(name)
    for parameter in ("rho_n", "rho_t"):
        for factor in (0.1, 10.0):
            found, top, used = press(name, **{parameter: factor * automatic[parameter]})
            assert used[parameter] == pytest.approx(factor * automatic[parameter])
            assert np.abs(found - force).max() < 5e-3 * np.abs(force).max()
            assert top == pytest.approx(highest, rel=2e-2)
