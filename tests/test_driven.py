# SPDX-License-Identifier: MIT
"""Rigid tools that forces drive: the force is reached, and all is as with the same travel prescribed."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from problems import BOTTOM, SLAVE, TOP, Half, balance, distance, one_mesh
from rigid import (
    SOFT,
    ball,
    block,
    columns,
    derivative_error,
    pair_and_problem,
    punch_3d,
    sphere_mesh,
    statuses,
)
from test_errors import expect

import dolfinx_contact as dc
from dolfinx_contact import meshes

COMM = MPI.COMM_WORLD
MU = 0.3
LOAD = {2: 40.0, 3: 15.0}
TIGHT = 1e-9  # of the load

FRICTION = pytest.mark.parametrize("friction", (0.0, MU))
DIM = pytest.mark.parametrize("dim", (2, 3))


def along(dim, x, y):
    """x along the first, y along the last direction."""
    return np.array([x] + [0.0] * (dim - 2) + [y])


def down(dim, part=1.0):
    return along(dim, 0.0, -part * LOAD[dim])


def assert_balanced(tool):
    """The forces of contact are minus the load in the free directions, to TIGHT. Collective."""
    E, load = tool.directions, tool.load
    left = E @ (tool.force() + load)
    assert np.linalg.norm(left) <= TIGHT * max(np.linalg.norm(load), np.linalg.norm(tool.force()))


def pushed(dim, friction=0.0, height=0.3, comm=COMM, part=columns, **options):
    """A block, a ball above it and its pair and problem; the full load."""
    model, tool = block(comm, dim, part), ball(dim, height)
    tool.push(down(dim))
    pair, problem = pair_and_problem(model, tool, friction=friction, **options)
    return model, tool, pair, problem


# -- the force is reached -----------------------------------------------------------------------------


@FRICTION
@DIM
@pytest.mark.parametrize("height", (0.3, 30.0, 0.0, -0.05))
def test_force_from_an_initial_gap(dim, friction, height):
    """Near, from afar, touching, and inside of the block; the support feels the load."""
    model, tool, pair, problem = pushed(dim, friction, height)
    report = problem.solve()
    assert_balanced(tool)
    np.testing.assert_allclose(pair.resultant()[-1], down(dim)[-1], rtol=TIGHT)
    np.testing.assert_allclose(balance(model, BOTTOM)[dim - 1], LOAD[dim], rtol=1e-8)
    # only along the force
    np.testing.assert_allclose(tool.translation[:-1], 0, atol=1e-15)
    assert tool.translation[-1] < 0.03 - height - 0.01
    assert report.iterations <= 14


@FRICTION
@DIM
@pytest.mark.parametrize("strategy", (dc.Newton, dc.FixedPoint))
def test_load_steps(dim, friction, strategy):
    """The force grows from zero."""
    _, tool, _, problem = pushed(dim, friction, strategy=strategy())
    for step in dc.LoadStepping(
        problem,
        lambda t: tool.push(down(dim, t), along=down(dim)),
        step=0.25,
        progress=False,
    ):
        assert tool.load[-1] == -step.time * LOAD[dim]
        assert_balanced(tool)
    assert step.failed == 0


@FRICTION
@DIM
def test_same_as_the_same_travel(dim, friction):
    """Prescribing where the force has brought the tool gives the force, step by step. (With rules
    richer than the nodes a few statuses may differ, as Newton comes from elsewhere.)"""
    driven_model, driven, _, driven_problem = pushed(dim, friction, integration=dc.Nodes())
    model, told = block(COMM, dim), ball(dim, 0.3)
    _, problem = pair_and_problem(model, told, friction=friction, integration=dc.Nodes())
    for part in (0.4, 1.0, 0.7):
        driven.push(down(dim, part))
        driven_problem.solve()
        told.move(driven.translation)
        problem.solve()
        force = driven.force()
        np.testing.assert_allclose(told.force(), force, atol=1e-8 * np.linalg.norm(force))
        assert distance(model.u, driven_model.u) < 1e-8


@FRICTION
@DIM
def test_equal_on_any_number_of_ranks(dim, friction):
    def solve(comm):
        model, tool, pair, problem = pushed(
            dim, friction, comm=comm, strategy=dc.Newton(rtol=1e-12)
        )
        iterations = problem.solve().iterations
        if friction > 0:
            tool.push(along(dim, 0.05, -1) * LOAD[dim], along=np.eye(dim))
        else:
            tool.push(1.2 * down(dim))
        return model, tool, pair, iterations + problem.solve().iterations

    model, tool, pair, iterations = solve(COMM)
    alone, other, reference, expected = solve(MPI.COMM_SELF)
    assert distance(model.u, alone.u) < 1e-8 and distance(pair.pressure, reference.pressure) < 1e-8
    np.testing.assert_allclose(tool.translation, other.translation, atol=1e-9)
    np.testing.assert_allclose(tool.force(), other.force(), atol=1e-8 * LOAD[dim])
    assert iterations == expected
    assert len(set(COMM.allgather(tool.translation.tobytes()))) == 1


@FRICTION
def test_units(friction):
    """N, mm, MPa or N, m, Pa: the same iterations."""
    results = []
    for length, young in ((1.0, 1.0), (1e-3, 1e6), (1.0, 1e6), (1e3, 1e-6)):
        model = block(COMM, 2, scale=(length, young))
        tool = dc.RigidSphere((0.13 * length, 1.1 * length), 0.8 * length)
        tool.push((0, -40 * young * length))
        _, problem = pair_and_problem(model, tool, friction=friction)
        report = problem.solve()
        assert_balanced(tool)
        results.append((report.iterations, tool.translation[1] / length))
    assert np.ptp([n for n, _ in results]) <= 1
    np.testing.assert_allclose([c for _, c in results], results[0][1], rtol=1e-8)


@pytest.mark.parametrize("tool", ("mesh", "punch"))
def test_other_tools(tool):
    tool = sphere_mesh(8, (0.13, 0.08, 0.9), 0.8) if tool == "mesh" else punch_3d()
    tool.move((0, 0, 0.1))
    tool.push((0, 0, -30))
    _, problem = pair_and_problem(block(COMM, 3), tool, friction=MU)
    problem.solve()
    assert_balanced(tool)


@pytest.mark.parametrize("initial_contact", (0.0, 1e-3, 0.1))
@pytest.mark.parametrize("force", ((0, -40), (15, -40)))
def test_initial_contact(initial_contact, force):
    """Without any the tool is brought to the slave all the same."""
    model, tool = block(COMM, 2), ball(2, 0.3)
    tool.push(force)
    _, problem = pair_and_problem(model, tool, initial_contact=initial_contact)
    problem.solve()
    assert_balanced(tool)


# -- directions ---------------------------------------------------------------------------------------


@DIM
def test_an_oblique_load(dim):
    """The tool moves along the force alone; across it is guided."""
    _, tool, _, problem = pushed(dim)
    load = along(dim, 0.3, -1.0) * LOAD[dim]
    tool.push(load)
    problem.solve()
    assert_balanced(tool)
    e = load / np.linalg.norm(load)
    assert np.linalg.norm(tool.translation - e * (e @ tool.translation)) < 1e-14
    assert np.linalg.norm(tool.force() + load) > 0.1 * LOAD[dim]  # the guide takes the rest


@DIM
def test_two_free_directions(dim):
    """Pressed first, then pushed sideways, free in all directions: friction holds it, up to μN."""
    _, tool, pair, problem = pushed(dim, MU)
    problem.solve()
    places = [tool.translation]
    for part in (0.0, 0.05, 0.1, 0.2):
        load = along(dim, part, -1.0) * LOAD[dim]
        tool.push(load, along=np.eye(dim)[::-1])
        problem.solve()
        assert_balanced(tool)
        np.testing.assert_allclose(tool.force(), -load, atol=TIGHT * LOAD[dim])
        places.append(tool.translation)
    assert np.all(np.diff([p[0] for p in places[1:]]) > 0)
    assert statuses(pair)["stick"] > 0
    # more than friction can hold: no equilibrium, and all is as before
    tool.push(along(dim, 0.6, -1.0) * LOAD[dim], along=np.eye(dim))
    force = tool.force()
    with pytest.raises((dc.ConvergenceError, dc.UnheldError)):
        problem.solve()
    np.testing.assert_array_equal(tool.translation, places[-1])
    np.testing.assert_array_equal(tool.force(), force)


@DIM
def test_moved_across_the_load(dim):
    """A pressing tool that is moved sideways: move() in the guided directions, the force in the
    other one. Friction comes near μN."""
    _, tool, pair, problem = pushed(dim, MU)
    problem.solve()
    for x in np.linspace(0.02, 0.3, 8):
        tool.move(along(dim, x, 123.0))  # the last is not listened to
        problem.solve()
        assert_balanced(tool)
        assert tool.translation[0] == pytest.approx(x, abs=1e-14)
        assert abs(tool.translation[-1]) < 1
    p = pair.particles
    normal = COMM.allreduce(np.sum(p.weight * p.pressure))
    # particles that have come in in the last step have no friction yet
    assert 2 * statuses(pair)["stick"] < statuses(pair)["slip"]
    assert 0.85 * MU * normal < pair.friction_resultant()[0] < MU * normal


# -- hold, move, push again ---------------------------------------------------------------------------


@DIM
def test_hold_then_move_then_push(dim):
    _, tool, pair, problem = pushed(dim, MU)
    for _ in range(3):  # after the slip of the first step particles settle, by a tenth each time
        problem.solve()
    place, force = tool.translation, tool.force()
    tool.hold()
    report = problem.solve()
    np.testing.assert_allclose(tool.translation, place, atol=1e-12)
    np.testing.assert_allclose(tool.force(), force, atol=1e-6 * LOAD[dim])
    assert report.iterations <= 3

    way = along(dim, 0.05, -0.01)
    for step in dc.LoadStepping(
        problem, lambda t: tool.move(place + t * way), step=0.25, progress=False
    ):
        # where it is told to be, though steps begin at extrapolated displacements
        np.testing.assert_allclose(tool.translation, place + step.time * way, atol=1e-14)
    assert tool.force()[-1] > force[-1]

    tool.push(down(dim, 0.5))
    problem.solve()
    assert_balanced(tool)
    assert tool.translation[0] == pytest.approx(0.05)


def test_load_steps_that_also_move_and_switch():
    """In one apply: pressed at first, then moved sideways under the load, then held and lifted."""
    _, tool, pair, problem = pushed(2, MU)
    seen = []

    def apply(t):
        if t <= 2:
            tool.push(down(2, min(t, 1.0)), along=(0, 1))
            tool.move((0.1 * max(0.0, t - 1), 0.0))
        else:
            tool.hold()
            tool.move((0.1, -0.33 + 0.2 * (t - 2)))

    for step in dc.LoadStepping(problem, apply, end=3, step=0.2, progress=False):
        t = step.time
        assert tool.translation[0] == pytest.approx(0.1 * min(max(0.0, t - 1), 1.0), abs=1e-14)
        if t <= 2 + 1e-12:
            assert_balanced(tool)
        else:
            assert tool.translation[1] == pytest.approx(-0.33 + 0.2 * (t - 2), abs=1e-14)
        seen.append(tool.force()[1])
    assert seen[9] == pytest.approx(LOAD[2]) and seen[-1] == 0.0


@FRICTION
def test_unloading(friction):
    """Down to nothing and on again; at zero load the tool stays where it has come off."""
    _, tool, pair, problem = pushed(2, friction)
    places = []
    for part in (1.0, 0.5, 0.1, 0.01, 0.0):
        tool.push(down(2, part), along=(0, 1))
        problem.solve()
        assert_balanced(tool)
        places.append(tool.translation[1])
    assert np.all(np.diff(places) > 0)
    assert np.linalg.norm(tool.force()) < 1e-9
    for part in (0.1, 1.0):
        tool.push(down(2, part))
        problem.solve()
        assert_balanced(tool)
    assert tool.translation[1] == pytest.approx(places[0], rel=1e-3 if friction else 1e-8)


# -- several tools ------------------------------------------------------------------------------------


@DIM
def test_several_tools(dim):
    """Two driven ones, with different forces, and a prescribed one between them."""
    model = block(COMM, dim)
    tools = [dc.RigidSphere(along(dim, x, 0.55), 0.4) for x in (-0.6, 0.0, 0.6)]
    tools[0].push(0.2 * down(dim))
    tools[2].push(0.4 * down(dim))
    tools[1].move(along(dim, 0, -0.16))
    pair, problem = pair_and_problem(model, tools, friction=MU)
    problem.solve()
    for tool in (tools[0], tools[2]):
        assert_balanced(tool)
    assert tools[1].translation[-1] == -0.16
    total = sum(t.force() for t in tools)
    np.testing.assert_allclose(total, -pair.resultant(), atol=1e-12 * LOAD[dim])
    np.testing.assert_allclose(total, balance(model, BOTTOM)[:dim], atol=1e-8 * LOAD[dim])
    tools[1].move(along(dim, 0.0, -0.165))
    assert derivative_error(problem) < 1e-8


@FRICTION
def test_a_tool_shared_by_two_pairs(friction):
    """It presses on the blocks on both its sides; its force is that of both."""
    halves = []
    for number, (x, tags) in enumerate((((-2.2, -0.2), (SLAVE, BOTTOM)), ((0.2, 2.2), (7, 8)))):
        body = meshes.grid((8, 3), (x[0], -1), (x[1], 0))
        faces = {
            tags[0]: lambda x: np.isclose(x[1], 0),
            tags[1]: lambda x: np.isclose(x[1], -1),
        }
        halves.append(Half(body, faces, {tags[1]: (0.0, 0.0)}))
    model = one_mesh(COMM, halves, SOFT, lambda x, n: columns(x, n))
    tool = dc.RigidPlane((0, 0.3), (0.01, -1))
    tool.push((0, -60))
    pairs = [dc.ContactPair(model.surface(tag), tool, friction=friction) for tag in (SLAVE, 7)]
    problem = dc.ContactProblem(model.F, model.u, pairs, bcs=model.bcs)
    problem.solve()
    assert_balanced(tool)
    forces = [pair.resultant() for pair in pairs]
    # it is tilted: the left block carries more... but both carry
    assert min(-forces[0][1], -forces[1][1]) > 1
    np.testing.assert_allclose(tool.force(), -sum(forces), atol=1e-12 * 60)
    np.testing.assert_allclose(balance(model, BOTTOM)[1] + balance(model, 8)[1], 60, rtol=1e-8)
    tool.push((0, -65))
    assert derivative_error(problem) < 1e-8


def test_a_body_between_two_tools():
    """Held only by a driven and a prescribed tool, and by friction on them."""
    body = meshes.grid((6, 4), (-1, -1), (1, 0))
    faces = {SLAVE: lambda x: np.isclose(x[1], 0), TOP: lambda x: np.isclose(x[1], -1)}
    model = one_mesh(COMM, [Half(body, faces, {})], SOFT, columns)
    upper, lower = dc.RigidPlane((0, 0.2), (0, -1)), dc.RigidPlane((0, -1), (0, 1))
    upper.push((0, -50))
    pairs = [
        dc.ContactPair(model.surface(tag), tool, friction=MU)
        for tag, tool in ((SLAVE, upper), (TOP, lower))
    ]
    problem = dc.ContactProblem(model.F, model.u, pairs, bcs=model.bcs)
    problem.solve()
    assert_balanced(upper)
    np.testing.assert_allclose(lower.force(), (0, -50), atol=50 * TIGHT)


# -- Newton -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("free", ("load", "all"))
@FRICTION
@DIM
def test_tangent(dim, friction, free):
    """Rows and columns of the tool, too: in the free and in the guided directions."""
    _, tool, pair, problem = pushed(dim, friction)
    for part in (0.6, 1.0):
        tool.push(down(dim, part))
        problem.solve()
    if free == "all":
        tool.push(along(dim, 0.1, -1.1) * LOAD[dim], along=np.eye(dim))
    else:
        tool.push(1.1 * down(dim))
        tool.move(along(dim, 0.02, 0.0))
    assert derivative_error(problem) < 1e-8


@FRICTION
@DIM
def test_newton_is_quadratic(dim, friction):
    """A small further load: no status changes, each step squares the residual."""
    _, tool, _, problem = pushed(dim, friction)
    for part in (0.8, 1.0, 1.002, 1.004):
        tool.push(down(dim, part))
        report = problem.solve()
    assert sum(report.status_changes) == 0
    norms = np.array(report.norms) / report.reference
    norms = norms[norms > 1e-13]
    assert len(norms) <= 4 and norms[-1] < 1e-5
    # e_{k+1} ≤ C e_k², the first ones tell C
    assert np.all(norms[1:] <= 3e3 * norms[:-1] ** 2 + 1e-12)


# -- failures -----------------------------------------------------------------------------------------


@FRICTION
def test_a_failed_solve_leaves_no_trace(friction):
    model, tool, pair, problem = pushed(2, friction)
    problem.solve()
    before = [f.x.array.copy() for f in problem.system.functions]
    place, force, moment = tool.translation.copy(), tool.force(), tool.moment()
    tool.push(down(2, 1e4))
    with pytest.raises(dc.ConvergenceError):
        problem.solve()
    np.testing.assert_array_equal(tool.translation, place)
    for f, values in zip(problem.system.functions, before):
        np.testing.assert_array_equal(f.x.array, values)
    np.testing.assert_array_equal(tool.force(), force)
    np.testing.assert_array_equal(tool.moment(), moment)
    tool.push(down(2, 1.1))
    problem.solve()
    assert_balanced(tool)


def test_load_steps_come_back():
    """A load that cannot be carried: the last accepted step is in place, with its load."""
    _, tool, _, problem = pushed(2)
    stepping = dc.LoadStepping(
        problem,
        lambda t: tool.push(down(2, t if t <= 0.5 else 1e5), along=(0, 1)),
        step=0.25,
        min_step=0.1,
        progress=False,
    )
    with pytest.raises(dc.ConvergenceError, match="stopped at t = 0.5"):
        for _ in stepping:
            place = tool.translation.copy()
    np.testing.assert_array_equal(tool.translation, place)
    np.testing.assert_array_equal(tool.load, down(2, 0.5))
    assert_balanced(tool)


def test_a_tool_that_meets_nothing():
    for make, parts in (
        (lambda t: t.push((0, 40)), ("[0.0, 40.0]", "turn the load")),  # away
        (lambda t: t.push((40, 0)), ("touches nothing",)),  # past the block
        (lambda t: (t.move((5, 0)), t.push((0, -40))), ("Place it nearer",)),  # beside it
    ):
        tool = ball(2, 0.3)
        make(tool)
        model = block(COMM, 2)
        _, problem = pair_and_problem(model, tool)
        place = tool.translation.copy()
        expect(dc.UnheldError, problem.solve, "RigidSphere", *parts)
        np.testing.assert_array_equal(tool.translation, place)
        assert not model.u.x.array.any()


def test_pulled_off():
    """A force that turns round takes the tool away: no equilibrium."""
    _, tool, _, problem = pushed(2)
    problem.solve()
    place = tool.translation.copy()
    tool.push(down(2, -0.1))
    with pytest.raises((dc.ConvergenceError, dc.UnheldError)):
        problem.solve()
    np.testing.assert_array_equal(tool.translation, place)


def test_pushed_too_late():
    tool = ball(2)
    _, problem = pair_and_problem(block(COMM, 2), tool)
    tool.push((0, -1))
    expect(
        dc.InputError, problem.solve, "RigidSphere", "after the ContactProblem", "push it before"
    )


def test_held_nodes_do_not_hold_the_tool():
    """Two clamped nodes under one rigid plane would be dependent: their multipliers are zero."""
    model = block(COMM, 2)
    V = model.u.function_space
    ends = fem.locate_dofs_geometrical(V, lambda x: np.isclose(np.abs(x[0]), 1))
    model.bcs.append(fem.dirichletbc(fem.Function(V), ends))
    tool = dc.RigidPlane((0, 0.1), (0, -1))
    tool.push((0, -60))
    _, problem = pair_and_problem(model, tool, integration=dc.Nodes())
    problem.solve()
    assert_balanced(tool)
    assert tool.translation[1] < -0.1
