# SPDX-License-Identifier: MIT
"""Bodies that nothing holds are named before a solve returns noise; friction can hold a body."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import (
    MASTER,
    ROTATION,
    SLAVE,
    TOP,
    Half,
    Material,
    constant,
    height,
    neo_hookean,
    one_mesh,
    punch,
    small_strain,
    striped,
    turn,
)

import dolfinx_contact as dc
from dolfinx_contact import meshes

COMM = MPI.COMM_WORLD
MU, YOUNG = 0.3, 1e3
LAWS = pytest.mark.parametrize("law", (small_strain, neo_hookean), ids=lambda f: f.__name__)
STRATEGIES = pytest.mark.parametrize("strategy", (dc.Newton, dc.FixedPoint))
REMEDIES = ("initial_contact", "Dirichlet", "prescribed displacement", "Friction holds only")
ALL_2D = ["translation along x", "translation along y", "rotation"]


def push(model, tag, force):
    """A traction on a face [force/area]; its Constants."""
    u = model.u
    ds = ufl.Measure("ds", domain=model.mesh, subdomain_data=model.tags)
    load = [constant(model.mesh, f) for f in force]
    model.F -= sum(f * w for f, w in zip(load, ufl.TestFunction(u.function_space))) * ds(tag)
    return load


def flat(y, lower=-1.0, upper=1.0, faces=(SLAVE, TOP), held=None, counts=(6, 3)):
    """[lower, upper] × [y, y + 1], with tags below and above."""
    body = meshes.grid(counts, (lower, y), (upper, y + 1), cell="triangle")
    below, above = (lambda x, h=h: np.isclose(x[1], h) for h in (y, y + 1))
    return Half(body, dict(zip(faces, (below, above))), held or {})


def block(law=small_strain, force=(0.0, -1.0), gap=0.0, held=None, strategy=None, **options):
    """A block of 2 × 1 over a rigid plane, loaded on its top; its model, pair and problem."""
    half = flat(gap, held=None if held is None else {TOP: held})
    model = one_mesh(COMM, [half], Material(law, YOUNG, 0.3), striped)
    push(model, TOP, force)
    pair = dc.ContactPair(model.surface(SLAVE), dc.RigidPlane((0, 0), (0, 1)), **options)
    return model, pair, model.problem(pair, strategy=strategy)


def free_motions(problem):
    """Solve, which must find something free on all ranks and change nothing; body -> its motions."""
    before = [f.x.array.copy() for f in problem.system.functions]
    particles = problem.system.contacts[0].assembler.particles
    states = {name: particles()[name].copy() for name in ("closed", "slips", "dissipated")}
    with pytest.raises(dc.UnheldError) as caught:
        problem.solve()
    for f, values in zip(problem.system.functions, before):
        np.testing.assert_array_equal(f.x.array, values)
    for name, values in states.items():
        np.testing.assert_array_equal(particles()[name], values)
    text = str(caught.value)
    assert len(set(COMM.allgather(text))) == 1, "all ranks say the same"
    assert all(word in text for word in REMEDIES)
    sentence = text.split("begins: ")[1].split(". Friction")[0]
    parts = [part.split(" is free: ") for part in sentence.split("; ")]
    return {name.removeprefix("the body "): motions.split(", ") for name, motions in parts}


# -- a block that is driven by a force ------------------------------------------------------------


@LAWS
@STRATEGIES
@pytest.mark.parametrize("friction", (0.0, MU))
def test_a_block_that_does_not_touch(law, strategy, friction):
    """It may go anywhere; the message names its surface, its motions and the remedies."""
    _, pair, problem = block(law, gap=0.1, friction=friction, strategy=strategy())
    assert free_motions(problem) == {"(slave of pair 0, tags [5])": ALL_2D}
    with pytest.raises(dc.ContactError, match="no results yet"):
        pair.resultant()


@LAWS
@STRATEGIES
def test_a_block_that_touches_without_friction(law, strategy):
    """The plane holds it down and upright, not along x."""
    _, _, problem = block(law, strategy=strategy())
    assert free_motions(problem) == {"(slave of pair 0, tags [5])": ["translation along x"]}


@LAWS
@STRATEGIES
def test_a_block_on_rollers(law, strategy):
    """Contact and what is held along x together leave nothing free."""
    _, pair, problem = block(law, held=(0.0, None), strategy=strategy())
    problem.solve()
    # Newton leaves 1e-10 of the forces
    np.testing.assert_allclose(pair.resultant(), (0.0, 2.0), atol=2e-8)


@LAWS
@STRATEGIES
def test_friction_holds_a_block(law, strategy):
    """Below μN: at the first step nothing has pressed yet, friction still holds it. Most of it
    sticks; the trailing corner is relieved and may slip."""
    _, pair, problem = block(law, (0.1, -1.0), friction=MU, strategy=strategy())
    problem.solve()
    np.testing.assert_allclose(pair.resultant(), (-0.2, 2.0), atol=1e-8 * 2)
    np.testing.assert_allclose(pair.friction_resultant(), (-0.2, 0.0), atol=1e-8 * 2)
    counts = [COMM.allreduce(int(np.sum(pair.particles.status == s))) for s in ("stick", "slip")]
    assert counts[0] > counts[1] and sum(counts) == 6 * 5
    assert COMM.allreduce(np.abs(pair.particles.slip).max(initial=0.0), op=MPI.MAX) < 1e-3


@STRATEGIES
def test_friction_holds_a_block_in_every_step(strategy):
    """The force grows up to 0.8 μN, turns round and vanishes: equilibrium in each step."""
    model, pair, problem = block(force=(0.0, 0.0), friction=MU, strategy=strategy())
    load = push(model, TOP, (0.0, -1.0))
    problem = model.problem(pair, strategy=strategy())
    for way in (0.0, 0.5, 0.8, -0.8, 0.0):
        load[0].value = way * MU
        problem.solve()
        np.testing.assert_allclose(pair.resultant(), (-2 * way * MU, 2.0), atol=1e-8 * 2)


@LAWS
@STRATEGIES
@pytest.mark.parametrize("begun", (False, True))
def test_friction_cannot_hold_more(law, strategy, begun):
    """Above μN there is no equilibrium: an error, and everything is as before. A force that it can
    hold is solved afterwards.

    ``begun``: at the second step, when friction knows the pressures."""
    model, pair, _ = block(law, (0.0, 0.0), friction=MU)
    load = push(model, TOP, (0.1 if begun else 0.5, -1.0))
    problem = model.problem(pair, strategy=strategy())
    if begun:
        problem.solve()
    before = [f.x.array.copy() for f in problem.system.functions]
    load[0].value = 0.5
    with pytest.raises((dc.ConvergenceError, dc.UnheldError)):
        problem.solve()
    for f, values in zip(problem.system.functions, before):
        np.testing.assert_array_equal(f.x.array, values)
    load[0].value = 0.15
    problem.solve()
    np.testing.assert_allclose(pair.resultant(), (-0.3, 2.0), atol=1e-8 * 2)


# -- several bodies -------------------------------------------------------------------------------


def stack(law, friction=0.0, gap=0.0):
    """Two loose blocks, one on the other, the lower one on a plane."""
    halves = [
        flat(1.0 + gap, faces=(SLAVE, TOP)),
        flat(0.0, -1.2, 1.2, (7, MASTER), counts=(7, 3)),
    ]
    model = one_mesh(COMM, halves, Material(law, YOUNG, 0.3), striped)
    push(model, TOP, (0.02, -1.0))
    plane = dc.RigidPlane((0, 0), (0, 1))
    pairs = [
        model.pair(friction=friction),
        dc.ContactPair(model.surface(7), plane, friction=friction),
    ]
    return pairs, dc.ContactProblem(model.F, model.u, pairs, bcs=model.bcs)


@LAWS
def test_two_loose_blocks(law):
    """Without friction both slide; above a gap the upper one is free; friction holds both."""
    upper, lower = (
        "(slave of pair 0, tags [5])",
        "(master of pair 0, tags [6], slave of pair 1, tags [7])",
    )
    along = ["translation along x"]
    assert free_motions(stack(law)[1]) == {upper: along, lower: along}
    motions = free_motions(stack(law, gap=0.1)[1])
    assert motions[upper] == ALL_2D
    # nothing presses the lower one, but it touches the plane
    assert motions[lower] == along
    pairs, problem = stack(law, MU)
    problem.solve()
    for pair in pairs:
        np.testing.assert_allclose(pair.resultant(), (-0.04, 2.0), atol=1e-8 * 2)


@pytest.mark.parametrize("partition", (striped, None), ids=("striped", "default"))
def test_bodies_are_found_on_any_number_of_ranks(partition):
    """Connected bodies, cut by the partition or not: their nodes, their surfaces, and whether they
    are held. A clamped body is not checked."""
    halves = [
        flat(2.0, -0.9, 0.4),  # a loose one
        flat(2.0, 0.5, 0.9, (8, 9)),  # beside it, on rollers
        flat(0.0, -1.2, 1.2, (7, MASTER), {7: (0.0, 0.0)}),  # clamped
    ]
    halves[1].held = {9: (0.0, None)}
    model = one_mesh(COMM, halves, Material(small_strain, YOUNG, 0.3), partition)
    pair = dc.ContactPair(model.surface(SLAVE), model.surface(MASTER))
    bodies = model.problem(pair).system.bodies
    x = model.u.function_space.tabulate_dof_coordinates()
    found = {}
    for body in bodies._loose:
        points = np.concatenate(COMM.allgather(x[body.nodes, :2]))
        assert len(points) == 7 * 4 and np.all(points[:, 1] >= 2 - 1e-12)
        found[round(points[:, 0].min(), 9), round(points[:, 0].max(), 9)] = body.names
    assert found == {(-0.9, 0.4): ["slave of pair 0, tags [5]"], (0.5, 0.9): []}


def test_a_clamped_problem_has_nothing_to_check():
    model = punch(COMM)
    problem = model.problem(model.pair())
    assert problem.system.bodies._loose == []
    problem.solve()


# -- three dimensions -----------------------------------------------------------------------------


def cube(law, held=(), friction=0.0, turned=False):
    """A cube on a plane, pressed; `held`: components of the nodes on its vertical middle axis."""
    mapping, up = (turn, height) if turned else (None, lambda x: x[2])
    normal = ROTATION[:, 2] if turned else np.array([0.0, 0.0, 1.0])
    body = meshes.grid((2, 2, 2), (-1, -1, 0), (1, 1, 2), mapping, "hexahedron")
    faces = {SLAVE: lambda x: np.isclose(up(x), 0), TOP: lambda x: np.isclose(up(x), 2)}
    model = one_mesh(COMM, [Half(body, faces, {})], Material(law, YOUNG, 0.0))
    push(model, TOP, -normal)
    V = model.u.function_space
    for i in held:
        V_i = V.sub(i).collapse()[0]
        axis = lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0)  # noqa: E731
        dofs = fem.locate_dofs_geometrical((V.sub(i), V_i), axis)
        model.bcs.append(fem.dirichletbc(fem.Function(V_i), dofs, V.sub(i)))
    plane = dc.RigidPlane((0, 0, 0), tuple(normal))
    pair = dc.ContactPair(model.surface(SLAVE), plane, friction=friction)
    return model, pair, model.problem(pair)


@LAWS
def test_a_cube_may_spin(law):
    """Frictionless, on its face: it slides and spins about the vertical. Held on its middle axis it
    still spins; friction stops it."""
    name = "(slave of pair 0, tags [5])"
    sliding, spin = ["translation along x", "translation along y"], ["rotation about z"]
    assert free_motions(cube(law)[2]) == {name: sliding + spin}
    assert free_motions(cube(law, (0,))[2]) == {name: sliding[1:] + spin}
    assert free_motions(cube(law, (0, 1))[2]) == {name: spin}
    _, pair, problem = cube(law, friction=MU)
    problem.solve()
    np.testing.assert_allclose(pair.resultant(), (0.0, 0.0, 4.0), atol=4e-8)


@LAWS
def test_an_oblique_motion(law):
    """On a turned plane no motion along an axis is free, but a combination is."""
    with pytest.raises(dc.UnheldError, match="oblique") as caught:
        cube(law, turned=True)[2].solve()
    assert "(slave of pair 0, tags [5])" in str(caught.value)
