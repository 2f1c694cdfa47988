# SPDX-License-Identifier: MIT
"""Multipliers held at zero, and several pairs in one problem."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

comm = MPI.COMM_WORLD
E = 1000.0


def near(axis: int, value: float):
    """Predicate of points with x[axis] = value."""
    return lambda x: np.isclose(x[axis], value)


def columns(mid, size):
    """A partition that cuts through the interface: strips of cells along x."""
    return (np.floor(mid[:, 0] * 3.999).astype(int) % size).astype(np.int32)


def elastic(mesh, degree=1):
    """Displacement and residual of linear elasticity with ν = 0."""
    V = compat.vector_space(mesh, degree)
    u, w = fem.Function(V), ufl.TestFunction(V)
    eps = lambda v: ufl.sym(ufl.grad(v))  # noqa: E731
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2 * degree})
    return u, E * ufl.inner(eps(u), eps(w)) * dx


def held_at(pair, contact):
    """Positions of the multipliers that are held, sorted, on every rank."""
    x = pair._multiplier.function_space.tabulate_dof_coordinates()
    parts = comm.allgather(x[: len(x)][contact.held][:, : pair.slave.dim])
    return np.unique(np.round(np.concatenate(parts), 12), axis=0)


@pytest.fixture(params=["quadrilateral", "triangle"])
def blocks(request):
    """Two unit blocks, one on the other, 6 and 4 facets on the interface; tags 5, 6 | 1, 2 | 3, 4."""
    upper = meshes.grid((6, 3), (0, 0), (1, 1), cell=request.param)
    lower = meshes.grid((4, 3), (0, -1), (1, 0), cell=request.param)
    mesh, body = meshes.create(comm, [upper, lower], columns)
    tags = meshes.tag_facets(
        mesh,
        {
            5: (near(1, 0), 0),
            6: (near(1, 0), 1),
            1: near(1, 1),
            2: near(1, -1),
            3: near(0, 0),
            4: near(0, 1),
        },
        body,
    )
    return mesh, tags


def test_fixed_by_dirichlet(blocks):
    """Both bodies clamped on the left: the multiplier of the corner has no free gap, and is held."""
    mesh, tags = blocks
    u, F = elastic(mesh)
    V = u.function_space
    left = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(3)), V)
    bottom = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(2)), V)
    top = fem.locate_dofs_topological(V.sub(1), 1, tags.find(1))
    push = fem.dirichletbc(-0.01, top, V.sub(1))
    # the clamp comes last: it wins at the corner of top and left
    pair = dc.ContactPair(dc.Surface(u, tags, 5), dc.Surface(u, tags, 6), target=dc.Proximity())
    problem = dc.ContactProblem(F, u, [pair], bcs=[push, bottom, left])
    report = problem.solve()
    assert report.converged
    held = held_at(pair, problem.system.contacts[0])
    assert held.shape == (1, 2) and np.allclose(held, 0)
    assert pair.resultant()[1] > 1.0  # about E 0.01 / 2 less what the clamp carries


def test_friction_on_a_plane_of_symmetry(blocks):
    """On the left no body moves along x: friction has nothing to decide there, and is held. What is
    excluded is held too."""
    mesh, tags = blocks
    u, F = elastic(mesh)
    V = u.function_space
    bottom = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(2)), V)
    side = fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, tags.find(3)), V.sub(0))
    push = fem.Constant(mesh, np.zeros(2))
    top = fem.dirichletbc(push, fem.locate_dofs_topological(V, 1, tags.find(1)), V)
    for exclude, held in ((None, (0.0,)), ((tags, 4), (0.0, 1.0))):
        pair = dc.ContactPair(
            dc.Surface(u, tags, 5), dc.Surface(u, tags, 6), friction=0.3, exclude=exclude
        )
        problem = dc.ContactProblem(F, u, [pair], bcs=[bottom, top, side])
        u.x.array[:] = 0.0
        for way in ((0.0, -0.01), (0.002, -0.01)):
            push.value[:] = way
            problem.solve()
        x = pair.friction.function_space.tabulate_dof_coordinates()[:, 0]
        semi = pair._semi_multiplier.x.array
        at = np.any([np.isclose(x, value) for value in held], axis=0)
        assert not semi[at].any() and np.all(semi[~at] != 0)
        pressure = pair.pressure.x.array
        assert np.all(pressure[~np.isclose(x, 1)] > 0)
        assert exclude is None or not pressure[np.isclose(x, 1)].any()


def test_nothing_fixed(blocks):
    """Without a clamp on the left no multiplier is held."""
    mesh, tags = blocks
    u, F = elastic(mesh)
    V = u.function_space
    bottom = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(2)), V)
    push = fem.dirichletbc(
        np.array([0, -0.01]), fem.locate_dofs_topological(V, 1, tags.find(1)), V
    )
    pair = dc.ContactPair(dc.Surface(u, tags, 5), dc.Surface(u, tags, 6), target=dc.Proximity())
    problem = dc.ContactProblem(F, u, [pair], bcs=[bottom, push])
    problem.solve()
    assert len(held_at(pair, problem.system.contacts[0])) == 0


@pytest.mark.parametrize(
    "space, degree",
    [(("Lagrange", 1), 1), (("Lagrange", 2), 2), (("DG", 1), 2), (("DG", 0), 1)],
)
def test_exclude(blocks, space, degree):
    """Pressures vanish on the nodes of excluded facets, and only there."""
    mesh, tags = blocks
    u, F = elastic(mesh, degree)  # rich enough for the pressures
    V = u.function_space
    bottom = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(2)), V)
    push = fem.dirichletbc(
        np.array([0, -0.01]), fem.locate_dofs_topological(V, 1, tags.find(1)), V
    )
    pair = dc.ContactPair(
        dc.Surface(u, tags, 5),
        dc.Surface(u, tags, 6),
        target=dc.Proximity(),
        integration=dc.Simpson(2),
        pressure_space=space,
        exclude=(tags, [4]),
    )
    problem = dc.ContactProblem(F, u, [pair], bcs=[bottom, push])
    problem.solve()
    held = held_at(pair, problem.system.contacts[0])
    if space == ("DG", 0):
        assert len(held) == 0  # no whole facet of the interface is excluded
    else:
        assert np.allclose(held, [[1, 0]])
        x = pair.pressure.function_space.tabulate_dof_coordinates()
        assert np.all(pair.pressure.x.array[np.isclose(x[:, 0], 1)] == 0)
    assert pair.resultant()[1] > 1.0


def test_exclude_wrong_input(blocks):
    """Unknown tags and tags of the wrong kind are refused on all ranks."""
    mesh, tags = blocks
    u, _ = elastic(mesh)
    surfaces = dc.Surface(u, tags, 5), dc.Surface(u, tags, 6)
    with pytest.raises(dc.InputError, match="77"):
        dc.ContactPair(*surfaces, target=dc.Proximity(), exclude=(tags, 77))
    with pytest.raises(dc.InputError, match="exclude"):
        dc.ContactPair(*surfaces, target=dc.Proximity(), exclude=3)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle", "hexahedron", "tetrahedron"])
@pytest.mark.parametrize("two_masters", [False, True])
def test_three_blocks(cell, two_masters):
    """Three stacked blocks on matching meshes: the exact uniform pressures, in both pairs.

    With `two_masters` the middle block is the master of both pairs; else it is slave of the lower
    and master of the upper one.
    """
    dim = 2 if cell in ("quadrilateral", "triangle") else 3
    counts = (4,) * (dim - 1) + (2,)
    corner = lambda z: (0,) * (dim - 1) + (z,)  # noqa: E731
    opposite = lambda z: (1,) * (dim - 1) + (z,)  # noqa: E731
    bodies = [meshes.grid(counts, corner(k), opposite(k + 1), cell=cell) for k in range(3)]
    mesh, body = meshes.create(comm, bodies, columns)
    z = dim - 1
    tags = meshes.tag_facets(
        mesh,
        {
            10: near(z, 0),
            11: (near(z, 1), 0),
            12: (near(z, 1), 1),
            13: (near(z, 2), 1),
            14: (near(z, 2), 2),
            15: near(z, 3),
        },
        body,
    )
    u, F = elastic(mesh)
    V = u.function_space
    move = np.zeros(dim)
    move[z] = -0.03
    bottom = fem.locate_dofs_topological(V, dim - 1, tags.find(10))
    top = fem.locate_dofs_topological(V, dim - 1, tags.find(15))
    bcs = [fem.dirichletbc(np.zeros(dim), bottom, V), fem.dirichletbc(move, top, V)]
    # nothing holds the middle block sideways
    mesh.topology.create_connectivity(dim, dim)
    cells = np.flatnonzero(body == 1).astype(np.int32)
    for axis in range(dim - 1):
        W, _ = V.sub(axis).collapse()
        dofs = fem.locate_dofs_topological((V.sub(axis), W), dim, cells)
        bcs.append(fem.dirichletbc(fem.Function(W), dofs, V.sub(axis)))
    lower = (11, 12) if two_masters else (12, 11)
    pairs = [
        dc.ContactPair(dc.Surface(u, tags, a), dc.Surface(u, tags, b), target=dc.Proximity())
        for a, b in (lower, (14, 13))
    ]
    problem = dc.ContactProblem(F, u, pairs, bcs=bcs)
    problem.solve()
    exact = E * 0.03 / 3
    for pair in pairs:
        # residuals are solved to 1e-10 of the forces
        assert np.allclose(pair.pressure.x.array, exact, rtol=1e-10, atol=0)
        sign = 1.0 if pair is pairs[1] or not two_masters else -1.0
        assert np.isclose(pair.resultant()[z], sign * exact, rtol=1e-10)


def test_nodes_without_weight_on_the_axis():
    """A nodal rule with pressures of degree 2 has a null row on the axis, and is refused."""
    upper = meshes.grid((4, 2), (0, 0), (1, 1))
    lower = meshes.grid((3, 2), (0, -1), (1, 0))
    mesh, body = meshes.create(comm, [upper, lower], columns)
    tags = meshes.tag_facets(mesh, {5: (near(1, 0), 0), 6: (near(1, 0), 1)}, body)
    u, F = elastic(mesh, 2)
    pair = dc.ContactPair(
        dc.Surface(u, tags, 5),
        dc.Surface(u, tags, 6),
        integration=dc.Nodes(),
        pressure_space=("Lagrange", 2),
        axisymmetric=True,
    )
    with pytest.raises(dc.InputError, match="axis"):
        dc.ContactProblem(F, u, [pair])
