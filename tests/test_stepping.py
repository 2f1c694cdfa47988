# SPDX-License-Identifier: MIT
"""Load steps: halved where they fail, grown where they go well, and nothing lost in between."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from problems import (
    MASTER,
    SLAVE,
    TOP,
    Material,
    block_halves,
    constant,
    distance,
    one_mesh,
    punch,
    small_strain,
)

import dolfinx_contact as dc
from dolfinx_contact.stepping import Step, Steps

COMM = MPI.COMM_WORLD


class Brittle:
    """A problem whose solve fails for steps above a limit.

    Attributes:
        continues: whether LoadStepping may extrapolate
        load: as set by ``apply``
        solved: loads that were solved
    """

    def __init__(self, limit, iterations=4):
        self.comm, self.limit, self.iterations = COMM, limit, iterations
        self.load, self.solved, self.continues = 0.0, [0.0], True

    def apply(self, t):
        self.load = t

    def state(self):
        return []

    def set_state(self, state):
        assert state == []

    def extrapolate(self, before, now, ratio):
        assert before == now == []

    def solve(self):
        if self.load - self.solved[-1] > self.limit * (1 + 1e-12):
            raise dc.ConvergenceError("too far")
        self.solved.append(self.load)
        return dc.Report(converged=True, iterations=self.iterations)


def lengths(problem):
    return np.diff(problem.solved)


def test_equal_steps_end_at_the_end():
    problem = Brittle(1.0)
    steps = list(dc.LoadStepping(problem, problem.apply, step=0.3, progress=False))
    np.testing.assert_allclose([s.time for s in steps], [0.3, 0.6, 0.9, 1.0], rtol=1e-14)
    assert steps[-1].time == 1.0 and [s.number for s in steps] == [1, 2, 3, 4]
    assert steps[-1].report.converged and not any(s.failed for s in steps)


def test_a_step_in_words():
    problem = Brittle(0.15)
    steps = list(dc.LoadStepping(problem, problem.apply, step=0.3, max_step=0.3, progress=False))
    assert str(steps[0]) == "step 1 to t = 0.15 (length 0.15): 4 iterations, 1 failed before"
    assert str(steps[1]) == "step 2 to t = 0.3 (length 0.15): 4 iterations"


def test_a_kept_step_is_equal_to_the_one_given():
    report = dc.Report(True, "CONVERGED", 3, 2.5)
    report.add(2.0, 3.0, (1, 2, 3, 4, 5), 7)
    report.took("total", 0.25)
    step, kept = Step(1, 0.5, 0.25, report, 2, 0.125), Steps()
    kept.append(step)
    report.add(1.0, 1.0, (0, 0, 0, 0, 0))  # a copy was kept
    assert kept[0] != step and kept[0].report.residuals == {"bulk": [2.0], "contact": [3.0]}
    kept.append(step)
    assert kept[-1] == step and Steps(kept)[:] == list(kept)


def test_no_sliver_is_left():
    problem = Brittle(1.0)
    list(dc.LoadStepping(problem, problem.apply, end=0.3, step=0.1, progress=False))
    assert len(problem.solved) == 4 and problem.solved[-1] == 0.3


def test_a_failed_step_is_halved_and_grows_again():
    problem = Brittle(0.06)
    steps = list(dc.LoadStepping(problem, problem.apply, step=0.2, progress=False))
    assert problem.solved[-1] == 1.0
    assert lengths(problem).max() <= 0.06 * (1 + 1e-9)
    assert steps[0].failed == 2 and steps[0].length == pytest.approx(0.05)
    # it grows by 1.5 after two easy steps, fails, is halved, and so on
    assert any(s.failed for s in steps[1:])


def test_hard_steps_grow_later():
    """Four steps that are solved, but not in six iterations, for two that are."""
    for iterations, equal in ((9, 4), (4, 2)):
        problem = Brittle(10.0, iterations)
        list(dc.LoadStepping(problem, problem.apply, step=0.02, max_step=0.5, progress=False))
        ratios = lengths(problem)[1:-1] / lengths(problem)[:-2]  # the last step ends at 1
        grown = np.arange(1, len(ratios) + 1) % equal == 0
        np.testing.assert_allclose(ratios, np.where(grown, 1.5, 1.0), rtol=1e-9)


def test_steps_grow_up_to_the_longest():
    problem = Brittle(10.0)
    list(dc.LoadStepping(problem, problem.apply, step=0.02, max_step=0.1, progress=False))
    assert lengths(problem)[:2] == pytest.approx(0.02)
    assert lengths(problem).max() == pytest.approx(0.1)


def test_it_gives_up_below_the_shortest_step():
    problem = Brittle(0.01)
    stepping = dc.LoadStepping(problem, problem.apply, step=0.2, min_step=0.03, progress=False)
    with pytest.raises(dc.ConvergenceError, match="min_step"):
        list(stepping)
    assert problem.load == 0.0, "apply is called again with the last accepted t"
    assert stepping.time == 0.0 and len(stepping.steps) == 0


def test_another_error_puts_the_loads_back():
    """Not a failed step, but for instance a displacement that is not finite."""
    problem = Brittle(1.0)

    def apply(t):
        problem.load = t

    def solve():
        if problem.load > 0.25:
            raise dc.ContactError("not finite")
        return dc.Report(converged=True, iterations=1)

    problem.solve = solve
    stepping = dc.LoadStepping(problem, apply, step=0.2, progress=False)
    with pytest.raises(dc.ContactError, match="not finite"):
        list(stepping)
    assert problem.load == stepping.time == 0.2


@pytest.mark.parametrize(
    "options", ({"step": 0}, {"step": 0.1, "min_step": 0.2}, {"end": -1}, {"max_step": 0.01})
)
def test_steps_that_make_no_sense(options):
    problem = Brittle(1.0)
    with pytest.raises(dc.InputError, match="LoadStepping"):
        dc.LoadStepping(problem, problem.apply, **options)


def test_a_failed_step_restores_everything():
    """A step that is too long for Newton's iterations: u, results and the way on are as if it had
    never been tried."""
    results = []
    for fail in (False, True):
        model = punch(COMM)
        pair = dc.ContactPair(model.surface(SLAVE), model.surface(MASTER), friction=0.2)
        problem = model.problem(pair)
        down = [value.value.copy() for value in model.driven[TOP] if value is not None]

        def apply(t):
            model.move(TOP, [0.0] * (model.mesh.geometry.dim - 1) + [t * float(down[-1])])

        apply(0.5)
        problem.solve()
        if fail:
            particles = problem.system.contacts[0].assembler.particles
            states = ("closed", "slips", "target_facet", "clamped", "dissipated")
            before = model.u.x.array.copy(), pair.pressure.x.array.copy(), pair.resultant()
            before += tuple(particles()[name].copy() for name in states)
            problem.strategy.max_it = 1
            apply(1.0)
            with pytest.raises(dc.ConvergenceError):
                problem.solve()
            after = model.u.x.array, pair.pressure.x.array, pair.resultant()
            after += tuple(particles()[name] for name in states)
            for a, b in zip(before, after):
                np.testing.assert_array_equal(a, b)
            problem.strategy.max_it = 30
        apply(0.8)
        problem.solve()
        results.append((model, pair))
    (model, pair), (other, again) = results
    # both start from bitwise the same state
    assert distance(model.u, other.u) < 1e-11
    assert distance(pair.friction, again.friction) < 1e-9


# -- where a step begins --------------------------------------------------------------------------


def watched(problem):
    """Keep the displacements and the report of each solve: a list that grows."""
    solve, solved = problem.solve, []

    def watch():
        start = problem.u[0].x.array.copy()
        report = solve()
        solved.append((start, problem.u[0].x.array.copy(), report))
        return report

    problem.solve = watch
    return solved


def test_a_linear_path_is_extrapolated():
    """Linear bodies on a linear path, in steps that grow: from the second on each begins at its
    solution. Only the pressures are left to find."""
    halves = block_halves((6, 3), 2, top=(0.0, 0.0))
    model = one_mesh(COMM, halves, Material(small_strain, 1e7, 0.0))
    problem = model.problem(model.pair())
    solved = watched(problem)

    def apply(t):
        model.move(TOP, (0.0, -0.024 * t))

    steps = list(dc.LoadStepping(problem, apply, step=0.05, max_step=0.5, progress=False))
    assert len(steps) > 4 and steps[-2].length > 2 * steps[0].length
    for start, end, report in solved[1:]:
        # each solution has an error of 1e-10 of the forces or less, and steps grow by 1.5
        distance = COMM.allreduce(np.abs(end - start).max(initial=0.0), op=MPI.MAX)
        assert distance < 1e-9 * 0.024
        assert report.residuals["contact"][0] < 1e-9 * report.reference  # no gaps
        assert report.iterations <= solved[0][2].iterations


def test_without_contact_nothing_is_left_to_solve():
    """Bodies apart: the second step's first residual is round-off, and no solve is needed."""
    model = one_mesh(
        COMM, block_halves((4, 3), 2, top=(0.0, 0.0), gap=0.5), Material(small_strain, 1e3, 0.3)
    )
    w = ufl.TestFunction(model.u.function_space)
    load = constant(model.mesh, 0.0)
    ds = ufl.Measure("ds", domain=model.mesh, subdomain_data=model.tags)
    model.F -= load * w[0] * ds(SLAVE)
    problem = model.problem(model.pair())

    def apply(t):
        load.value = t

    steps = list(dc.LoadStepping(problem, apply, step=0.25, progress=False))
    assert [s.report.iterations for s in steps] == [1, 0, 0, 0]
    for step in steps[1:]:
        # round-off of sums of the reactions, some 1e2 entries
        assert step.report.norms[0] < 1e-12 * step.report.reference
    assert [s.smallest for s in steps] == [0.25] * 4


def test_after_a_failed_step_u_is_that_of_the_last_accepted():
    """Not the extrapolated start; bitwise. And the smaller step is extrapolated from there."""
    model = punch(COMM)
    pair = model.pair(friction=0.2)
    problem = model.problem(pair)
    accepted, checked = [model.u.x.array.copy()], []
    solved = watched(problem)

    def apply(t):
        model.move(TOP, (0.05 * t, -0.08 * t))
        if t == stepping.time and t > 0:  # called again after a failure
            np.testing.assert_array_equal(model.u.x.array, accepted[-1])
            checked.append(t)
        # more than a third from where it is: no chance
        problem.strategy.max_it = 1 if t > stepping.time + 0.3 else 30

    stepping = dc.LoadStepping(problem, apply, step=0.2, max_step=0.45, progress=False)
    steps = []
    for step in stepping:
        accepted.append(model.u.x.array.copy())
        steps.append(step)
        stepping._next = 0.4 if step.number == 2 else stepping._next
    assert checked == [pytest.approx(0.4)]
    third = steps[2]
    assert third.failed == 1 and third.length == pytest.approx(0.2)
    assert [s.smallest for s in steps] == [min(t.length for t in steps[: s.number]) for s in steps]
    # the start of the third step: the second's end plus as much again as in the second
    start = solved[2][0]
    np.testing.assert_allclose(start, 2 * accepted[2] - accepted[1], rtol=0, atol=1e-15)


def test_the_smallest_step_is_remembered():
    problem = Brittle(0.06)
    steps = list(dc.LoadStepping(problem, problem.apply, step=0.2, progress=False))
    made = lengths(problem)
    np.testing.assert_allclose(
        [s.smallest for s in steps], np.minimum.accumulate(made), rtol=1e-12
    )
    assert steps[-1].smallest < made.max()
