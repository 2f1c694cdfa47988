# SPDX-License-Identifier: MIT
"""Coulomb's law in solved problems: blocks that are pressed, dragged and turned."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import (
    BOTTOM,
    SLAVE,
    TOP,
    Material,
    apart,
    block_halves,
    cube_halves,
    distance,
    neo_hookean,
    one_mesh,
    punch,
    remote,
    striped,
)
from problems import ROTATION as TURN

import dolfinx_contact as dc
from dolfinx_contact import compat
from dolfinx_contact.held import local_dofs

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from long_run import ironing  # noqa: E402

COMM = MPI.COMM_WORLD
MU, YOUNG, PRESS, DRAG = 0.3, 1e3, 0.02, 0.05
SOFT = Material(neo_hookean, YOUNG, 0.3)


def blocks(dim=2, comm=COMM, partition=None, counts=(7, 5)):
    """A small block on a large one: all its facets keep in touch while it is dragged."""
    if dim == 2:
        halves = block_halves(counts, layers=2, top=(0.0, 0.0))
        halves[0].body.points[:, 0] *= 0.5
    else:
        halves = cube_halves((3, 2))
        upper = halves[0].body.points  # of axes that are turned
        along = upper @ TURN
        along[:, :2] = 0.2 + 0.5 * along[:, :2]
        upper[:] = along @ TURN.T
    return one_mesh(comm, halves, SOFT, partition)


def place(model, displacement):
    """Displacement of the top; the bottom rests."""
    model.move(TOP, displacement)
    model.move(BOTTOM, np.zeros(len(displacement)))


def pressed(model, **options):
    """The problem and its pair after the normal load."""
    pair = model.pair(friction=options.pop("friction", MU), **options)
    problem = model.problem(pair, strategy=dc.Newton(rtol=1e-12))
    place(model, (0.0, -PRESS))
    problem.solve()
    return problem, pair


TARGETS = {
    "smooth": {},
    "proximity": {"target": dc.Proximity()},
    "direction": {"target": dc.SeekDirection((0, 1)), "normals": "direction"},
    "slave": {"target": dc.SlaveNormal()},
}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("rule", (dc.Nodes(), dc.Simpson(1)), ids=("Nodes", "Simpson"))
def test_a_dragged_block_slides(rule, target):
    """All particles slip: friction is μ times the normal force, against the motion."""
    model = blocks()
    problem, pair = pressed(model, integration=rule, **TARGETS[target])
    for way in (0.5 * DRAG, DRAG):
        place(model, (way, -PRESS))
        problem.solve()
    particles = pair.particles
    touching = particles.status != "open"
    assert COMM.allreduce(int(touching.sum())) > 10
    assert np.all(particles.status[touching] == "slip")
    friction = np.linalg.norm(particles.friction[touching], axis=1)
    # the projection on the ball: round-off
    np.testing.assert_allclose(friction, MU * particles.pressure[touching], rtol=1e-12)
    slip = particles.slip[touching]
    assert np.all(slip[:, 0] > 0.9 * (0.5 * DRAG))  # of the last step
    work = np.einsum("pi,pi->p", particles.friction[touching], slip)
    np.testing.assert_allclose(work, -friction * np.linalg.norm(slip, axis=1), rtol=1e-12)
    # the master bends a little: tangents are tilted by up to 2 %, some this way and some that way
    force = MU * COMM.allreduce(particles.weight @ particles.pressure)
    along, across = pair.friction_resultant()
    assert along == pytest.approx(-force, rel=1e-4)
    assert abs(across) < 1e-2 * force


@pytest.mark.parametrize("space", (None, ("DG", 0)), ids=str)
def test_nodal_friction_where_all_slips(space):
    """pair.friction is μ times the pressure against the motion, also in a space of its own."""
    model = blocks()
    problem, pair = pressed(model, friction_space=space)
    for way in (0.5 * DRAG, DRAG):
        place(model, (way, -PRESS))
        problem.solve()
    assert COMM.allreduce(int(np.sum(pair.particles.status == "stick"))) == 0
    integrals = [
        COMM.allreduce(fem.assemble_scalar(compat.form(f * ufl.dx(pair.slave.mesh))))
        for f in (pair.friction[0], pair.friction[1], pair.pressure)
    ]
    force = MU * integrals[2]
    # the master bends a little: tangents are tilted by up to 2 %
    assert integrals[0] == pytest.approx(-force, rel=1e-4)
    assert abs(integrals[1]) < 1e-2 * force
    drawn = dc.plot.gather_friction(pair), dc.plot.gather_pressure(pair)
    if COMM.rank == 0:
        (x, friction), (y, pressure) = drawn
        np.testing.assert_array_equal(x, y)
        lengths = np.linalg.norm(np.diff(x[:, :, 0], axis=1), axis=1)
        # over the current length, which differs by the strain of 2 %
        means = friction[:, :, 0].mean(axis=1) @ lengths, MU * pressure.mean(axis=1) @ lengths
        assert means[0] == pytest.approx(-means[1], rel=1e-3)
        assert means[1] == pytest.approx(force, rel=0.03)


@pytest.mark.parametrize("target", TARGETS)
def test_a_block_that_sticks_does_not_move(target):
    """Stick holds in the weighted mean of each multiplier node's support."""
    model = blocks()
    problem, pair = pressed(model, friction=5.0, **TARGETS[target])
    place(model, (0.2 * PRESS, -PRESS))
    problem.solve()
    particles = pair.particles
    assert np.all(particles.status == "stick")
    # (F3) with ψ_A: ∫ μ λ/ρ_τ (TΛ − P_B(g_τ)) ψ_A = −∫ μ λ T⟦Δu⟧ ψ_A
    rule, psi = pair._rule, pair._psi
    values = np.prod(rule.points[:, None, :] ** psi[0][None], axis=2) @ psi[1].T
    moment = particles.weight * particles.pressure * particles.slip[:, 0]
    moment = moment.reshape(-1, len(rule.points)) @ values
    sums, sizes = (type(pair.pressure)(pair.pressure.function_space) for _ in range(2))
    nodes = local_dofs(pair, sums, len(psi[2]))
    weight = (particles.weight * particles.pressure).reshape(-1, len(rule.points)) @ values
    for function, rows in ((sums, moment), (sizes, weight)):
        np.add.at(function.x.array, nodes, rows)
        compat.scatter_reverse_add(function)
    owned = sums.function_space.dofmap.index_map.size_local
    mean = np.abs(sums.x.array[:owned] / sizes.x.array[:owned])
    # Newton leaves 1e-12 of the forces; single particles slip by 2e-4 of the displacement
    assert COMM.allreduce(mean.max(initial=0.0), op=MPI.MAX) < 1e-8 * 0.2 * PRESS
    single = np.abs(particles.slip).max(initial=0.0)
    assert COMM.allreduce(single, op=MPI.MAX) > 1e-5 * 0.2 * PRESS
    # and friction acts
    assert abs(pair.friction_resultant()[0]) > 0.1 * PRESS * YOUNG * 0.2


@pytest.mark.parametrize("slip", ("convected", "increment"))
@pytest.mark.parametrize("target", ("smooth", "proximity", "slave"))
def test_a_rigid_rotation(target, slip):
    """Two stuck blocks turned together by θ = 40 degrees in one step. The convected slip sees
    nothing, and no traction changes; the paper's measure sees |d_n| sin θ at each particle, and
    friction changes with it, since the gap vanishes only on average."""
    model = blocks()
    problem, pair = pressed(model, friction=5.0, slip=slip, **TARGETS[target])
    place(model, (0.2 * PRESS, -PRESS))
    for _ in range(3):  # the tangents follow the last accepted step: some 1e-7 until they settle
        problem.solve()
    friction, pressure = pair.friction.x.array.copy(), pair.pressure.x.array.copy()
    before, gap = model.u.x.array.reshape(-1, 2).copy(), pair.particles.gap

    angle = np.deg2rad(40)
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x = model.u.function_space.tabulate_dof_coordinates()[:, :2]
    turned = (x + before) @ R.T - x
    model.u.x.array[:] = turned.ravel()
    contact = problem.system.contacts[0]
    contact.update()
    table = contact.assembler.particles()
    # along the normal n turned back by 90 degrees; x¹ − x² was −gap R⁻¹n
    normal, moved = table["normal"].T, table["slip"].T
    along = normal[1] * moved[0] - normal[0] * moved[1]
    measured = 0.0 if slip == "convected" else gap * np.sin(angle)
    np.testing.assert_allclose(along, measured, rtol=0, atol=1e-14)  # of positions about 1
    largest = COMM.allreduce(np.abs(gap).max(initial=0.0), op=MPI.MAX)
    assert largest > 1e-3 * PRESS

    held = fem.Function(model.u.function_space)
    held.x.array[:] = turned.ravel()
    dofs = np.concatenate(
        [
            fem.locate_dofs_topological(held.function_space, 1, model.tags.find(tag))
            for tag in (TOP, BOTTOM)
        ]
    )
    problem.system.bulk.bcs[:] = [fem.dirichletbc(held, dofs)]
    # near the solution of the convected slip, not in it
    model.u.x.array[:] += 1e-2 * PRESS * np.sin(40 * x).ravel()
    assert problem.solve().iterations > 1
    expected = friction.reshape(-1, 2) @ R.T
    size = COMM.allreduce(np.abs(friction).max(initial=0.0), op=MPI.MAX)
    change = np.abs(pair.friction.x.array.reshape(-1, 2) - expected).max(initial=0.0)
    change = COMM.allreduce(change, op=MPI.MAX) / size
    push = np.abs(pair.pressure.x.array - pressure).max(initial=0.0)
    push = COMM.allreduce(push, op=MPI.MAX) / COMM.allreduce(pressure.max(initial=0.0), op=MPI.MAX)
    assert size > 1e-2 * YOUNG * PRESS
    if slip == "convected":
        assert max(change, push) < 1e-10  # Newton leaves 1e-12 of the forces
    else:
        assert 1e-3 < change < 2e-2 and push < 1e-3  # 7e-3 and 2e-4 measured


@pytest.mark.parametrize("partition", (apart, striped, remote, None))
def test_distributed_equals_serial(partition):
    """Partly stick, partly slip."""
    results = []
    for comm, spread in ((COMM, partition), (MPI.COMM_SELF, None)):
        model = blocks(comm=comm, partition=spread)
        problem, pair = pressed(model)
        place(model, (0.22 * PRESS, -PRESS))
        problem.solve()
        status = pair.comm.allreduce(
            np.array([np.sum(pair.particles.status == s) for s in ("stick", "slip")])
        )
        results.append((model, pair, status))
    (model, pair, status), (alone, serial, expected) = results
    assert np.array_equal(status, expected) and np.all(expected > 0)
    # the same equations, solved to 1e-12: only the order of the sums differs
    for one, other in (
        (model.u, alone.u),
        (pair.pressure, serial.pressure),
        (pair.friction, serial.friction),
    ):
        assert distance(one, other) < 1e-8
    assert serial.dissipated_energy() > 0
    assert pair.dissipated_energy() == pytest.approx(serial.dissipated_energy(), rel=1e-7)


@pytest.mark.parametrize("factor", (0.1, 10.0))
@pytest.mark.parametrize("name", ("rho_n", "rho_t"))
def test_augmentation_parameters_do_not_matter(name, factor):
    """Ten times less or more, where some particles are open: the same solution with particles in
    the nodes, and up to the discretisation with others inside the facets."""

    def solve(rule, **options):
        model = punch(COMM)
        pair = model.pair(friction=MU, integration=rule, **options)
        problem = model.problem(pair, strategy=dc.Newton(rtol=1e-12))
        for displacement in ((0.0, -0.04), (0.01, -0.06)):
            model.move(TOP, displacement)
            problem.solve()
        assert COMM.allreduce(int(np.sum(pair.particles.status == "open"))) > 0
        return pair.resultant(), problem.system.parameters.chosen[0]

    changes = []
    for rule in (dc.Nodes(), dc.Simpson(1)):
        expected, automatic = solve(rule)
        found, _ = solve(rule, **{name: factor * automatic[name]})
        changes.append(np.abs(found - expected).max() / np.abs(expected).max())
    assert changes[0] < 1e-9  # Newton leaves 1e-12 of the forces
    assert 1e-6 < changes[1] < 5e-3  # the parameter is used; 1e-3 measured


def test_energy_of_a_closed_path():
    """There and back: the work of the plates is what friction has dissipated; as much is stored at
    the end as at the beginning, where all slips as well."""
    model = blocks()
    problem, pair = pressed(model)
    place(model, (DRAG, -PRESS))
    problem.solve()  # slides: from here the state repeats
    start, work, steps = pair.dissipated_energy(), 0.0, 20
    at, force = DRAG, pair.resultant()[0]
    for x in np.concatenate(
        [np.linspace(DRAG, -DRAG, steps + 1)[1:], np.linspace(-DRAG, DRAG, steps + 1)[1:]]
    ):
        place(model, (x, -PRESS))
        problem.solve()
        new = pair.resultant()[0]
        work -= 0.5 * (force + new) * (x - at)
        at, force = x, new
    dissipated = pair.dissipated_energy() - start
    assert dissipated > 0
    # the trapezoidal rule where the force reverses: 1.2e-3, and half of it with twice the steps
    assert work == pytest.approx(dissipated, rel=3e-3)


def test_a_block_on_a_rigid_plane():
    """A plane that is dragged below the block acts as a block that is dragged on it, and a plane
    that is turned into its place as one that was there."""
    results = []
    for dragged, angle in (("block", 0.0), ("plane", 0.0), ("plane", 0.4)):
        model = blocks()
        plane = dc.RigidPlane((0, 0), (2 * np.sin(angle), 2 * np.cos(angle)))
        pair = dc.ContactPair(model.surface(SLAVE), plane, friction=MU)
        plane.move(rotation=angle)
        problem = model.problem(pair, strategy=dc.Newton(rtol=1e-12))
        place(model, (0.0, -PRESS))
        problem.solve()
        for way in (0.02, 0.04):
            if dragged == "block":
                place(model, (way, -PRESS))
            else:
                plane.move((-way, 0.0), angle)
            problem.solve()
        results.append(pair.resultant())
        n, t = pair.resultant()[1], pair.friction_resultant()
        assert -t[0] == pytest.approx(MU * n, rel=1e-12) and n > 0  # all slip: round-off
    # the same problem, solved to 1e-12
    np.testing.assert_allclose(results[1], results[0], rtol=1e-9)
    np.testing.assert_allclose(results[2], results[0], rtol=1e-9)


def test_a_dragged_cube():
    """3D: friction is μ times the pressure everywhere, and against the motion on the whole."""
    model = blocks(3)
    pair = model.pair(friction=MU, integration=dc.Nodes())
    problem = model.problem(pair, strategy=dc.Newton(rtol=1e-12))
    normal, aside = TURN[:, 2], TURN @ (0.8, 0.6, 0.0)
    for way in (0.0, 0.02, 0.04):
        model.move(TOP, -0.005 * normal + way * aside)
        problem.solve()
    particles = pair.particles
    touching = particles.status != "open"
    assert np.all(particles.status[touching] == "slip")
    lengths = np.linalg.norm(particles.friction[touching], axis=1)
    # the projection on the ball: round-off
    np.testing.assert_allclose(lengths, MU * particles.pressure[touching], rtol=1e-12)
    # the master bends a little, and the particles at the edges slip aside: 7e-4 and 3e-6 measured
    force = MU * COMM.allreduce(particles.weight @ particles.pressure)
    assert abs(pair.friction_resultant() @ normal) < 1e-2 * force
    assert pair.friction_resultant() @ aside == pytest.approx(-force, rel=1e-4)


def test_a_particle_opposite_a_node_of_the_master():
    """By symmetry a particle lies where two facets of the master meet, with a gap: its slip has one
    value there, and Newton needs no smaller steps. (With tangential parts of the gap in either facet
    it went to and fro until it was stopped.)"""
    problem, pair, place = ironing(COMM, 24)
    for depth in (0.05, 0.1, 0.15):
        place(0, -depth)
        assert problem.solve().iterations <= 8
    across, along = pair.resultant()
    assert abs(across) < 1e-8 * abs(along)
