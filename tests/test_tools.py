# SPDX-License-Identifier: MIT
"""Rigid tools that move as they are told: tangents, forces and moments, friction, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from problems import BOTTOM, SLAVE, balance
from rigid import (
    ball,
    block,
    derivative_error,
    pair_and_problem,
    punch_2d,
    punch_3d,
    sphere_mesh,
    statuses,
)
from test_errors import expect

import dolfinx_contact as dc

COMM = MPI.COMM_WORLD
MU = 0.3

#: dimension and maker; each comes down on a block, its lowest point at 0.02 or lower
TOOLS = {
    "plane 2D": (2, lambda: dc.RigidPlane((0, 0.02), (0.02, -1))),
    "circle": (2, lambda: ball(2)),
    "bowl 2D": (2, lambda: dc.RigidSphere((0.1, -5), 5.03, inside=True)),
    "polygon": (2, lambda: sphere_mesh(12, (0.13, 0.82), 0.8)),
    "punch 2D": (2, punch_2d),
    "plane 3D": (3, lambda: dc.RigidPlane((0, 0, 0.02), (0.02, 0.01, -1))),
    "sphere": (3, lambda: ball(3)),
    "bowl 3D": (3, lambda: dc.RigidSphere((0.1, 0.05, -5), 5.03, inside=True)),
    "cylinder": (3, lambda: dc.RigidCylinder((0.1, 0, 0.82), (1, 0.3, 0), 0.8)),
    "groove": (3, lambda: dc.RigidCylinder((0.1, 0, -5), (1, 0.3, 0), 5.03, inside=True)),
    "torus": (3, lambda: dc.RigidTorus((0.1, 0.05, 0.3), (0.05, 0.02, 1), 0.45, 0.28)),
    "mesh": (3, lambda: sphere_mesh(8, (0.13, 0.08, 0.82), 0.8)),
    "punch 3D": (3, punch_3d),
}


def along(dim, x, y):
    """x along the first, y along the last direction."""
    return np.array([x] + [0.0] * (dim - 2) + [y])


def rotation(dim, angle):
    """In 2D counterclockwise, in 3D about the second axis."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]] if dim == 2 else [[c, 0, s], [0, 1, 0], [-s, 0, c]])


def turn_about(tool, center, R, shift=0.0):
    """Turn a tool about a point, then shift it."""
    center = np.asarray(center, dtype=float)
    tool.move(center - R @ center + shift, R)


# -- tangent ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "target", (dc.Smooth(), dc.Proximity()), ids=lambda t: type(t).__name__.lower()
)
@pytest.mark.parametrize("name", TOOLS)
def test_tangent(name, target, record_property):
    """Of the whole system with friction, while the tool has moved and turned since the last step."""
    dim, make = TOOLS[name]
    if isinstance(target, dc.Proximity) and name not in ("polygon", "mesh"):
        pytest.skip("the closest point in closed form is the same for both")
    model, tool = block(COMM, dim), make()
    pair, problem = pair_and_problem(model, tool, friction=MU, target=target)
    for x, y in ((0.0, -0.03), (0.001, -0.05), (0.01, -0.06)):
        tool.move(along(dim, x, y))
        problem.solve()
    count = statuses(pair)
    assert count["stick"] + count["slip"] > 10
    tool.move(along(dim, 0.014, -0.065), rotation(dim, 0.004))
    error = derivative_error(problem)
    record_property("error", error)
    assert error < 1e-8  # differences leave 1e-10


# -- forces and moments -------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", (0.0, MU))
@pytest.mark.parametrize("name", ("circle", "polygon", "punch 2D", "sphere", "torus", "mesh"))
def test_forces_and_moments(name, friction):
    """What the tool feels is what the support feels, and minus the pair's resultant."""
    dim, make = TOOLS[name]
    model, tool = block(COMM, dim), make()
    pair, problem = pair_and_problem(model, tool, friction=friction)
    for x, y in ((0.0, -0.03), (0.003, -0.05)):
        tool.move(along(dim, x, y))
        problem.solve()
    force, support = tool.force(), balance(model, BOTTOM)
    size = np.linalg.norm(force)
    assert size > 1
    np.testing.assert_allclose(force, -pair.resultant(), atol=1e-12 * size)
    np.testing.assert_allclose(force, support[:dim], atol=1e-8 * size)
    # friction acts at the particle on the slave and at its target on the tool, a gap apart
    p = pair.particles
    gap = np.where(p.status == "open", 0.0, np.abs(p.gap)).max(initial=0.0)
    margin = 1e-8 * size + MU * size * COMM.allreduce(gap, op=MPI.MAX) * (friction > 0)
    np.testing.assert_allclose(tool.moment(np.zeros(dim)), support[dim:], atol=margin)
    # about another point, and by default about the origin of the tool's frame
    about = np.arange(1.0, dim + 1)
    shifted = np.cross(about, force) if dim == 3 else about[0] * force[1] - about[1] * force[0]
    np.testing.assert_allclose(
        tool.moment(about), tool.moment(np.zeros(dim)) - shifted, atol=1e-12 * size
    )
    np.testing.assert_array_equal(tool.moment(), tool.moment(tool.translation))
    assert tool.moment().shape == ((1,) if dim == 2 else (3,))


@pytest.mark.parametrize("dim", (2, 3))
def test_turning_tool_drags(dim):
    """A turning cylinder (sphere) slips everywhere: μN in the direction its surface moves, and
    the work of friction is that over the way of the surface."""
    model, tool, radius = block(COMM, dim), ball(dim), 0.8
    pair, problem = pair_and_problem(model, tool, friction=MU)
    shift = along(dim, 0.0, -0.06)
    center = tool.center
    for part in (0.5, 1.0):
        tool.move(part * shift)
        problem.solve()
    step, energy = 0.02, []
    for i in range(1, 8):
        turn_about(tool, center, rotation(dim, step * i), shift)
        problem.solve()
        energy.append(pair.dissipated_energy())
    assert statuses(pair)["stick"] == 0 and statuses(pair)["slip"] > 8
    normal = np.sum(pair.particles.weight * pair.particles.pressure)
    normal = COMM.allreduce(normal)
    # counterclockwise in 2D: the lowest point moves to the right; about y in 3D: to the left
    sign = 1 if dim == 2 else -1
    size = MU * normal
    friction = pair.friction_resultant()
    # not all is along x: normals are up to 0.25 off the vertical
    assert sign * friction[0] == pytest.approx(size, rel=0.03)
    assert sign * pair.resultant()[0] > 0.5 * size
    # moments: a torque on the tool about its center that brakes it
    torque = tool.moment(center + shift)
    # points beside the axis of the sphere are nearer to it
    assert torque[1 if dim == 3 else 0] == pytest.approx(-size * radius, rel=0.05)
    # the last step is steady
    assert energy[-1] - energy[-2] == pytest.approx(size * radius * step, rel=0.05)


@pytest.mark.parametrize("dim", (2, 3))
def test_moving_tool_and_block_together(dim):
    """A rigid motion of all, the clamp too, changes nothing: no slip, the same pressures."""
    model, tool = block(COMM, dim), ball(dim)
    u, V = model.u, model.u.function_space
    x = V.tabulate_dof_coordinates()[:, :dim]
    clamp, g = np.flatnonzero(np.isclose(x[:, -1], -1)), fem.Function(V)
    bc = fem.dirichletbc(g, clamp.astype(np.int32))
    pair = dc.ContactPair(model.surface(SLAVE), tool, friction=MU)
    problem = dc.ContactProblem(model.F, u, [pair], bcs=[bc])
    shift = along(dim, 0.0, -0.06)
    # the particles' friction takes a few steps to become that of Λ, a tenth is left in each
    for part in (0.5, *(1.0,) * 8):
        tool.move(part * shift)
        problem.solve()
    pressure, force = pair.pressure.x.array.copy(), tool.force()
    R, c = rotation(dim, 0.3), along(dim, 0.2, 0.1)
    for f in (u, g):
        values = f.x.array.reshape(-1, dim)
        values[:] = (x + values) @ R.T + c - x
    tool.move(R @ shift + c, R)
    report = problem.solve()
    # in 3D Λ is turned to each particle's normal by the least rotation, which is not that of the
    # bodies where the normal is oblique
    margin = (1e-7 if dim == 2 else 1e-3) * np.linalg.norm(force)
    np.testing.assert_allclose(pair.pressure.x.array, pressure, atol=5 * margin)
    np.testing.assert_allclose(tool.force(), R @ force, atol=margin)
    assert report.iterations <= 3


# -- several tools, and composites --------------------------------------------------------------------


def two_balls(dim):
    return [dc.RigidSphere(along(dim, s * 0.5, 0.32), 0.3) for s in (-1, 1)]


@pytest.mark.parametrize("dim", (2, 3))
def test_a_list_of_tools(dim):
    """Each has its motion and its forces; particles know on which tool they are. Moved together,
    they act as one composite."""
    model, tools = block(COMM, dim), two_balls(dim)
    pair, problem = pair_and_problem(model, tools, friction=MU)
    for part in (0.5, 1.0):
        tools[0].move(along(dim, 0, -part * 0.06))
        tools[1].move(along(dim, 0, -part * 0.04))
        problem.solve()
    forces = [t.force() for t in tools]
    assert forces[0][-1] > 1.2 * forces[1][-1] > 0
    np.testing.assert_allclose(sum(forces), -pair.resultant(), atol=1e-12 * forces[0][-1])
    p = pair.particles
    closed = p.status != "open"
    assert np.array_equal(p.tool[closed], (p.position[closed, 0] > 0).astype(int))
    assert set(COMM.allreduce(list(p.tool[closed]))) == {0, 1}

    for tool in tools:
        tool.move(along(dim, 0, -0.06))
    problem.solve()
    single, whole = block(COMM, dim), dc.RigidComposite(two_balls(dim))
    other, problem = pair_and_problem(single, whole, friction=MU)
    for part in (0.5, 1.0):
        whole.move(along(dim, 0, -part * 0.06))
        problem.solve()
    assert whole.force()[-1] == pytest.approx(sum(t.force()[-1] for t in tools), rel=1e-2)
    assert np.all(other.particles.tool[other.particles.status != "open"] == 0)


def test_one_tool_moved_before_it_becomes_part_of_a_composite():
    """Its place counts; a composite of a composite is the same surface."""
    moved = dc.RigidPlane((0, 0), (0, -1))
    moved.move((0, -0.04), 0.1)
    inner = dc.RigidComposite([moved])
    inner.move((0.3, 0.01), -0.04)
    outer = dc.RigidComposite([inner])
    direct = dc.RigidPlane((0, 0), (0, -1))
    direct.move(rotation(2, -0.04) @ (0, -0.04) + (0.3, 0.01), 0.06)
    forces = []
    for tool in (outer, direct):
        _, problem = pair_and_problem(block(COMM, 2, bulge=0.1), tool)
        problem.solve()
        forces.append(np.append(tool.force(), tool.moment((0, 0))))
    np.testing.assert_allclose(forces[0], forces[1], rtol=1e-9)


def die(gap=0.0):
    """A round die: its ring, its corner and its wall; the face at z = gap, looking down."""
    down, hole, r = (0, 0, -1), 0.5, 0.2
    parts = [
        dc.RigidPlane((0, 0, gap), down, (hole + r, 3)),
        dc.RigidTorus((0, 0, gap + r), down, hole + r, r),
        dc.RigidCylinder((0, 0, gap + r), (0, 0, 1), hole, inside=True, length=2.0),
    ]
    return dc.RigidComposite(parts)


def test_die():
    """Pressed on a block: the middle bulges into the hole, the corner's normals are the torus'."""
    model, tool = block(COMM, 3, bulge=0.0, counts=(8, 8, 2)), die()
    pair, problem = pair_and_problem(model, tool, friction=0.1)
    for y in (-0.03, -0.06, -0.1):
        tool.move((0, 0, y))
        problem.solve()
    p = pair.particles
    closed, r = p.status != "open", np.hypot(*p.position[:, :2].T)
    # the middle is open, and facets across the corner are pressed in part
    assert COMM.allreduce(r[~closed].max(initial=0), op=MPI.MAX) < 0.72
    assert 0.4 < COMM.allreduce(r[closed].min(initial=9), op=MPI.MIN) < 0.7
    on_ring = closed & (r > 0.701)
    np.testing.assert_allclose(p.normal[on_ring], [[0, 0, 1]] * on_ring.sum(), atol=1e-12)
    corner = closed & (r < 0.699)
    assert COMM.allreduce(int(corner.sum())) > 4
    # towards the middle of the tube, at r = 0.7, z = 0.1
    circle = np.zeros((corner.sum(), 3))
    circle[:, :2] = 0.7 * p.position[corner, :2] / r[corner, None]
    circle[:, 2] = 0.1
    inward = circle - p.position[corner]
    length = np.linalg.norm(inward, axis=1, keepdims=True)
    np.testing.assert_allclose(p.normal[corner], inward / length, atol=1e-12)
    np.testing.assert_allclose(p.gap[corner], length[:, 0] - 0.2, atol=1e-12)
    np.testing.assert_allclose(tool.force(), -pair.resultant(), rtol=1e-12, atol=1e-9)


# -- input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "call, parts",
    (
        (lambda: dc.RigidPlane((0, 0), (0, 0)), ("normal is (0, 0)", "not 0")),
        (lambda: dc.RigidPlane((0, 0), (0, 0, 1)), ("(0, 0, 1)", "2 or 3 finite numbers")),
        (lambda: dc.RigidPlane((0, np.nan), (0, 1)), ("nan", "finite")),
        (lambda: dc.RigidPlane((0, 0), (0, 1), extent=(2, 1)), ("(2, 1)", "inner < outer")),
        (lambda: dc.RigidPlane((0, 0), (0, 1), extent=(-1, 1)), ("(-1, 1)", "0 ≤ inner")),
        (lambda: dc.RigidPlane((0, 0), (0, 1), extent=3.0), ("3.0", "two distances")),
        (lambda: dc.RigidSphere((0, 0), 0.0), ("radius is 0.0", "positive")),
        (lambda: dc.RigidSphere((0, 0), np.inf), ("radius is inf", "positive")),
        (lambda: dc.RigidSphere((0,), 1.0), ("(0,)", "2 or 3")),
        (lambda: dc.RigidSphere("ab", 1.0), ("'ab'", "2 or 3")),
        (lambda: dc.RigidCylinder((0, 0), (0, 1), 1.0), ("3 finite numbers",)),
        (lambda: dc.RigidCylinder((0, 0, 0), (0, 0, 0), 1.0), ("axis is (0, 0, 0)",)),
        (lambda: dc.RigidCylinder((0, 0, 0), (0, 0, 1), -1.0), ("radius is -1.0", "positive")),
        (lambda: dc.RigidCylinder((0, 0, 0), (0, 0, 1), 1.0, length=0), ("length is 0",)),
        (lambda: dc.RigidTorus((0, 0, 0), (0, 0, 0), 1.0, 0.1), ("axis is (0, 0, 0)",)),
        (lambda: dc.RigidTorus((0, 0, 0), (0, 0, 1), -1.0, 0.1), ("ring is -1.0",)),
        (lambda: dc.RigidTorus((0, 0, 0), (0, 0, 1), 1.0, "a"), ("radius is 'a'",)),
        (lambda: dc.RigidComposite([]), ("tools is []", "at least one")),
        (lambda: dc.RigidComposite([ball(2), ball(3)]), ("one dimension",)),
        (lambda: dc.RigidComposite([ball(2), 3]), ("rigid tools",)),
        (lambda: dc.RigidComposite(ball(2)), ("list of rigid tools",)),
        (lambda: ball(2).move((0, 0, 1)), ("(0, 0, 1)", "2 finite numbers")),
        (lambda: ball(2).move("x"), ("'x'", "2 finite numbers")),
        (lambda: ball(3).move(rotation=0.3), ("0.3", "3 × 3")),
        (lambda: ball(2).move(rotation=2 * np.eye(2)), ("rotation matrix", "angle")),
        (lambda: ball(2).move(rotation=np.diag([1, -1])), ("rotation matrix",)),  # a mirror
        (lambda: ball(2).move(rotation=np.nan), ("nan", "rotation matrix")),
        (lambda: ball(2).push((0, 0)), ("directions that are not zero", "say along which")),
        (lambda: ball(2).push((0, 0, 1)), ("(0, 0, 1)", "2 finite numbers")),
        (lambda: ball(2).push((0, np.inf)), ("inf", "finite")),
        (lambda: ball(2).push((0, 1), along=(1, 0)), ("free along", "in these directions")),
        (lambda: ball(2).push((0, 1), along=[(0, 1), (0, 2)]), ("not dependent",)),
        (lambda: ball(2).push((0, 1), along=np.eye(3)), ("one direction, or up to 2",)),
        (lambda: ball(2).push((0, 1), along="y"), ("'y'",)),
        (lambda: ball(2).force(), ("no forces yet", "solve")),
        (lambda: ball(2).moment(), ("no forces yet",)),
        (lambda: ball(2).moment((0, 0, 0)), ("(0, 0, 0)", "2 numbers")),
    ),
)
def test_bad_input(call, parts):
    expect(dc.InputError, call, *parts)


def test_a_composite_of_driven_tools():
    driven = ball(2)
    driven.push((0, -1))
    expect(dc.InputError, lambda: dc.RigidComposite([driven]), "drive the composite")


def test_pairs_with_wrong_tools():
    slave = block(COMM, 2).surface(SLAVE)
    tool = ball(2)
    for master, parts in (
        (ball(3), ("slave is in 2", "RigidSphere in 3")),
        ([], ("list", "rigid tool")),
        ([tool, tool], ("twice",)),
        ([tool, "x"], ("list of rigid tools",)),
        (3.0, ("float", "give a Surface, a rigid tool")),
    ):
        expect(dc.InputError, lambda m=master: dc.ContactPair(slave, m), *parts)
    for target in (dc.SeekDirection((0, 1)), dc.SlaveNormal()):
        expect(
            dc.InputError, lambda t=target: dc.ContactPair(slave, tool, target=t), "leave target"
        )


def test_bad_input_leaves_the_tool_as_it_was():
    tool = ball(2)
    tool.move((0.1, 0.2), 0.3)
    tool.push((0, -1))
    before = tool.motion(), tool.load.copy(), tool.directions.copy()
    for call in (
        lambda: tool.move((0, 0), np.diag([1, -1])),
        lambda: tool.push((1, 0), along=(0, 1)),
        lambda: tool.push((0, 0, 0)),
    ):
        expect(dc.InputError, call)
    for a, b in zip(before, (tool.motion(), tool.load, tool.directions)):
        np.testing.assert_array_equal(a, b)


def test_forces_before_the_first_solve():
    tool = ball(2)
    pair_and_problem(block(COMM, 2), tool)
    expect(dc.ContactError, tool.force, "no results yet")
