# SPDX-License-Identifier: MIT
"""Exact integration on the common refinement: the patch test to round-off, and what follows from it
for tangents, friction and partitions (formulation, sections 3 and 6)."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import (
    BOTTOM,
    MASTER,
    ROTATION,
    SLAVE,
    TOP,
    Half,
    Material,
    apart,
    distance,
    dome,
    one_mesh,
    punch,
    small_strain,
    spread,
    striped,
    taylor_blocks,
    two_meshes,
    values,
)

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
E, STRAIN = 1e7, 0.012
TURN = {2: np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]), 3: ROTATION}
CELLS = [
    *itertools.product(("triangle", "quadrilateral"), repeat=2),
    *itertools.product(("tetrahedron", "hexahedron"), repeat=2),
]


def stacked(cells, nu, disorder=0.0, counts=None):
    """Two turned blocks of unit height, and their exact displacement under uniform stress along
    the height, sides free: plane strain in 2D, uniaxial in 3D."""
    dim = 2 if cells[0] in ("triangle", "quadrilateral") else 3
    turn, counts = TURN[dim], counts or {2: (11, 8), 3: (7, 5)}[dim]
    height = lambda x: turn[:, -1] @ x[:dim]  # noqa: E731
    halves = []
    for i, (cell, n) in enumerate(zip(cells, counts)):
        low, high = np.array([0.0] * (dim - 1) + [-i]), np.array([1.0] * (dim - 1) + [1 - i])
        random = np.random.default_rng(i)

        def mapping(x, low=low, high=high, random=random, n=n):
            y = x.copy()
            inside = np.all((x > low + 1e-9) & (x < high - 1e-9) | [False] * (dim - 1) + [True], 1)
            y[inside, :-1] += disorder / n * random.uniform(-1, 1, (inside.sum(), dim - 1))
            return y @ turn.T

        faces = (SLAVE, TOP) if i == 0 else (BOTTOM, MASTER)
        planes = {tag: lambda x, z=z - i: np.isclose(height(x), z) for z, tag in enumerate(faces)}
        body = meshes.grid((n,) * (dim - 1) + (1 + (dim == 2),), low, high, mapping, cell)
        halves.append(Half(body, planes, {}))

    def exact(x):
        X = turn.T @ x[:dim]
        u = (nu / (1 - nu) if dim == 2 else nu) * STRAIN * X
        u[-1] = -STRAIN * (X[-1] + 1)
        return turn @ u

    return halves, exact


def patch_test(cells, degree, nu, rule, disorder=0.0, counts=None, **options):
    """The pair, solved; the last two faces have the exact displacement."""
    halves, exact = stacked(cells, nu, disorder, counts)
    models = two_meshes(COMM, halves, Material(small_strain, E, nu), degree=degree)
    u, bcs = [m.u for m in models], []
    for m, tag in zip(models, (TOP, BOTTOM)):
        given = fem.Function(m.u.function_space)
        given.interpolate(exact)
        facets = m.tags.indices[m.tags.values == tag]
        dofs = fem.locate_dofs_topological(m.u.function_space, m.mesh.topology.dim - 1, facets)
        bcs.append(fem.dirichletbc(given, dofs))
    options.setdefault("pressure_space", ("Lagrange", degree))
    pair = dc.ContactPair(
        models[0].surface(SLAVE), models[1].surface(MASTER), integration=rule, **options
    )
    problem = dc.ContactProblem([m.F for m in models], u, [pair], bcs=bcs, strategy=TIGHT)
    pair.report = problem.solve()
    return pair


TIGHT = dc.Newton(rtol=1e-13)


def error(pair, nu):
    """Largest relative error of the pressure. Collective."""
    exact = E * STRAIN / (1 - nu**2 if pair.slave.dim == 2 else 1)
    return float(np.abs(values(pair.pressure)[1] / exact - 1).max())


@pytest.mark.parametrize("nu", [0.0, 0.3])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cells", CELLS, ids="-".join)
def test_patch_test(cells, degree, nu):
    """Uniform to 1e-9 on non-matching, non-nested, turned meshes of any two cells."""
    small = degree == 2 and cells[0] in ("tetrahedron", "hexahedron")
    pair = patch_test(cells, degree, nu, dc.Segments(), counts=(5, 3) if small else None)
    assert error(pair, nu) < 1e-9
    assert pair.report.iterations <= 3


@pytest.mark.parametrize(
    "target", [dc.Proximity(), dc.SlaveNormal(), dc.SeekDirection(TURN[2][:, 1])], ids=str
)
def test_patch_test_with_other_targets(target):
    assert error(patch_test(CELLS[3], 1, 0.3, dc.Segments(), target=target), 0.3) < 1e-9


@pytest.mark.parametrize("cells", [CELLS[2], CELLS[4]], ids="-".join)
def test_simpson_improves_with_its_level(cells):
    errors = [error(patch_test(cells, 1, 0.3, dc.Simpson(n)), 0.3) for n in range(3)]
    assert errors[0] > errors[1] > errors[2] > 1e-5


def test_distorted_facets():
    """Basis functions of a distorted quadrilateral are rational in the position: Gauss's rule is not
    exact there, but the error goes with its degree. Triangles need no more than on a regular mesh.
    """
    errors = [
        error(patch_test(("hexahedron",) * 2, 1, 0.3, dc.Segments(d), 0.2), 0.3)
        for d in (4, 8, 12)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < 0.1 * errors[0] and errors[2] < 0.1 * errors[1]
    assert error(patch_test(("tetrahedron",) * 2, 1, 0.3, dc.Segments(), 0.2), 0.3) < 1e-9


@pytest.mark.parametrize("pressure", [("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1)])
@pytest.mark.parametrize("friction", [("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1)])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.filterwarnings("ignore:.*not stable")
def test_every_pair_of_multiplier_spaces(pressure, friction, degree):
    """Pressure and friction in spaces of their own: a block is pressed and pushed on a finer one;
    all sticks, or all slips and friction is μ times the pressure's resultant."""
    finer = (4, 11)  # unstable choices are determined by a finer master too
    halves = stacked(("quadrilateral",) * 2, 0.0, counts=finer)[0]
    model = one_mesh(COMM, halves, Material(small_strain, 1e3, 0.0), degree=degree)
    up, along = TURN[2][:, 1], TURN[2][:, 0]
    V, bcs, push = model.u.function_space, [], fem.Function(model.u.function_space)
    for tag, value in ((TOP, push), (BOTTOM, fem.Function(V))):
        facets = model.tags.indices[model.tags.values == tag]
        bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(V, 1, facets)))
    model.bcs = bcs
    pair = model.pair(
        integration=dc.Segments(), friction=0.3, pressure_space=pressure, friction_space=friction
    )
    problem = model.problem(pair)
    for down, side in ((0.005, 0.0), (0.01, 0.0), (0.01, 0.0002)):
        push.x.array.reshape(-1, 2)[:] = side * along - down * up
        problem.solve()
    assert abs(pair.resultant() @ up / (0.5 * 1e3 * 0.01) - 1) < 1e-3
    stuck = abs(pair.friction_resultant() @ along)
    assert 0 < stuck < 0.3 * (pair.resultant() @ up) * 0.5
    for side in (0.01, 0.02, 0.03):
        push.x.array.reshape(-1, 2)[:] = side * along - 0.01 * up
        problem.solve()
    statuses = COMM.allreduce(set(pair.particles.status), op=MPI.BOR)
    assert statuses - {"open"} == {"slip"}
    assert abs(pair.friction_resultant() @ along / (0.3 * pair.resultant() @ up) + 1) < 0.02
    # the projected traction has the particles' resultant
    dx = ufl.Measure("dx", pair.slave.mesh, metadata={"quadrature_degree": 4})
    total = [compat.assemble_scalar(COMM, compat.form(pair.friction[i] * dx)) for i in range(2)]
    np.testing.assert_allclose(total, pair.friction_resultant(), rtol=1e-10)


def test_particles_follow_the_surfaces():
    """Cells end at the master's nodes; weights make up the area."""
    model = taylor_blocks(COMM)
    pair = model.solve(integration=dc.Segments(3), target=dc.Proximity())
    whole = pair.particles.gather()
    if whole is not None:
        cells = np.floor((whole.reference[:, 0] + 1) * 4 + 1e-9)  # of the master
        parts = set(zip(whole.facet.tolist(), cells.tolist()))
        assert len(whole) == 2 * len(parts) == 2 * 18
        assert len(parts) == 18 and abs(whole.weight.sum() - 2) < 1e-13


def tangent_error(model, pair, states, random):
    """Relative difference of the tangent and central differences of the residual, cells moving, in
    a random direction of all unknowns at given displacements and pressures."""
    system = model.problem(pair).system
    system.start()
    for function, state in zip(system.functions, states):
        function.x.array[:] = state
        function.x.scatter_forward()
    system.read()
    x, step = system.x.copy(), 1e-6
    direction = x.duplicate()
    direction.array[:] = random.uniform(-1, 1, len(direction.array))
    for function, block in ((system.u[0], 0), (pair._multiplier, 1)):
        part = direction.array[system.layout.slice(block)]
        largest = COMM.allreduce(np.abs(function.x.array).max(initial=0.0), op=MPI.MAX)
        part *= largest / system.scale[block]
    direction.array[system.layout.held_rows() - system.layout.start] = 0.0
    system.bulk.bcs = []  # Dirichlet rows are no question of contact

    def residual(size):
        y, b = x.copy(), x.duplicate()
        y.axpy(size, direction)
        system.residual(y, b)
        b.array[system.layout.held_rows() - system.layout.start] = 0.0
        return b

    difference = residual(step)
    difference.axpy(-1.0, residual(-step))
    difference.scale(0.5 / step)
    b = residual(0.0)
    system.jacobian(x, system.A)
    system.A.mult(direction, b)
    b.array[system.layout.held_rows() - system.layout.start] = 0.0
    contact = slice(system.layout.offsets[1], None)
    b.axpy(-1.0, difference)
    error = COMM.allreduce(float(np.sum(b.array[contact] ** 2)))
    return np.sqrt(error / COMM.allreduce(float(np.sum(difference.array[contact] ** 2))))


TARGETS = {
    "smooth": dc.Smooth(),
    "proximity": dc.Proximity(),
    "turning": dc.SlaveNormal(),
    "direction": dc.SeekDirection((0.3, 0.2, 1.0)),
}


@pytest.mark.parametrize("degree", [2, 6])
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("make", [punch, dome])
def test_tangent_of_moving_particles(make, target, degree):
    """Places and weights vary with the corners of both surfaces: curved, partly open, past the ends
    of the master, and the low degree leaves an error that depends on where the cells are."""
    model, choice = make(COMM), TARGETS[target]
    if target == "direction":
        choice = dc.SeekDirection(choice.direction[-model.mesh.geometry.dim :])
    solution = model.solve(integration=dc.Segments(), target=choice)
    states = model.u.x.array.copy(), solution._multiplier.x.array.copy()
    pair = model.pair(integration=dc.Segments(degree), target=choice)
    assert tangent_error(model, pair, states, np.random.default_rng(COMM.rank)) < 1e-8


def newton_iterations(make, rule, **options):
    return make(COMM).solve(integration=rule, **options).report.iterations


@pytest.mark.parametrize("make", [punch, dome])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("target", ["smooth", "proximity", "turning"])
def test_convergence_is_that_of_simpson(make, target, friction):
    options = dict(target=TARGETS[target], friction=friction)
    simpson = newton_iterations(make, dc.Simpson(2), **options)
    assert newton_iterations(make, dc.Segments(), **options) <= simpson + 2


@pytest.mark.parametrize("make", [punch, dome])
def test_partitions_agree(make):
    serial = make(MPI.COMM_SELF)
    alone = serial.solve(integration=dc.Segments())
    for partition in (apart, striped):
        model = make(COMM, partition)
        pair = model.solve(integration=dc.Segments())
        assert distance(model.u, serial.u) < 1e-9
        assert distance(pair.pressure, alone.pressure) < 1e-8
        assert len(pair.particles.gather() or alone.particles) == len(alone.particles)


def test_rigid_plane_and_degrees():
    """A plane has no nodes: each facet is one cell."""
    halves = stacked(("hexahedron",) * 2, 0.0)[0]
    model = one_mesh(COMM, halves[:1], Material(small_strain, E, 0.0))
    plane = dc.RigidPlane((0, 0, 0), ROTATION[:, 2])
    pair = dc.ContactPair(model.surface(SLAVE), plane, integration=dc.Segments(4))
    dc.ContactProblem(model.F, model.u, [pair], bcs=_held(model)).solve()
    assert COMM.allreduce(len(pair.particles)) == 49 * 12
    for wrong in (0, 21, 1.5):
        with pytest.raises(dc.InputError, match="from 1 to 20"):
            dc.Segments(wrong)


def _held(model):
    """The upper face pushed down by 0.01."""
    V = model.u.function_space
    down = fem.Function(V)
    down.x.array.reshape(-1, 3)[:] = -0.01 * ROTATION[:, 2]
    facets = model.tags.indices[model.tags.values == TOP]
    return [fem.dirichletbc(down, fem.locate_dofs_topological(V, 2, facets))]


def test_a_failed_solve_leaves_the_particles():
    model = punch(COMM)
    pair = model.pair(integration=dc.Segments(), friction=0.3)
    problem = model.problem(pair)
    model.move(TOP, (0.0, -0.03))
    problem.solve()
    before, state = pair.particles, model.u.x.array.copy()
    model.move(TOP, (0.0, -5.0))
    with pytest.raises(dc.ContactError):
        problem.solve()
    assert np.array_equal(model.u.x.array, state)
    assert np.array_equal(pair.particles.position, before.position)
    model.move(TOP, (0.0, -0.035))
    problem.solve()
    assert spread(pair.pressure) > 0
