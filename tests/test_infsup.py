# SPDX-License-Identifier: MIT
"""The numerical inf-sup constant against a dense construction on tensor grids, by NumPy alone.

On two rectangles (or boxes) with a flat interface only the displacement along the normal counts. All
matrices are then Kronecker products of those of lines.
"""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from problems import MASTER, ROTATION, SLAVE, Material, apart, block_halves, one_mesh, remote
from problems import small_strain, striped, turn, two_meshes
from scipy.linalg import eigh

import dolfinx_contact as dc
from dolfinx_contact import compat, infsup, meshes

COMM = MPI.COMM_WORLD
MATERIAL = Material(small_strain, 1.0, 0.0)
SPACES = (("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1))
SIMPSON = np.array([0, 1, 2, 3, 4]) / 4, np.array([1, 4, 2, 4, 1]) / 12  # Simpson(1)

# -- the dense construction -------------------------------------------------------------------------


def basis(space, nodes):
    """Of a space on a line with the given nodes: a function that takes a cell and ξ in [0, 1] to the
    numbers of its functions and to their values and derivatives by ξ; and how many there are."""
    cells, (family, degree) = len(nodes) - 1, space
    own = degree + 1 if family == "DG" else degree  # functions that each cell adds

    def at(cell, xi):
        one = np.ones_like(xi)
        if degree == 0:
            values, slopes = [one], [0 * one]
        elif degree == 1:
            values, slopes = [1 - xi, xi], [-one, one]
        else:
            values = [(1 - xi) * (1 - 2 * xi), 4 * xi * (1 - xi), xi * (2 * xi - 1)]
            slopes = [4 * xi - 3, 4 - 8 * xi, 4 * xi - 1]
        return cell * own + np.arange(degree + 1), np.array(values), np.array(slopes)

    return at, cells * own + (family != "DG")


def product(first, second, nodes, rule=None, radial=False, slopes=False):
    """∫ of products of functions on a line (or of their slopes), by a rule on each cell of `nodes`.
    `second` may live on other nodes. Without a rule exactly: by Gauss's between all the nodes. With
    `radial` the measure is 2πx dx."""
    (space, others), pieces, exact = second, nodes, rule is None
    if exact:
        x, w = np.polynomial.legendre.leggauss(6)
        rule, pieces = ((x + 1) / 2, w / 2), np.unique(np.round([*nodes, *others], 12))
    at, rows = basis(first, nodes)
    other, columns = basis(space, others)
    out = np.zeros((rows, columns))

    def locate(line, near, x):
        """Cell of a line that holds the point `near`, ξ of x in it, and its size."""
        cell = np.clip(np.searchsorted(line, near, side="right"), 1, len(line) - 1) - 1
        size = line[cell + 1] - line[cell]
        return cell, np.clip((x - line[cell]) / size, 0, 1), size

    for begin, end in zip(pieces, pieces[1:]):
        for point, weight in zip(*rule):
            x = begin + (end - begin) * point
            middle = (begin + end) / 2
            cell, xi, h = locate(nodes, middle, x)
            far, eta, size = locate(others, middle if exact else x, x)
            a, N, dN = at(cell, xi)
            b, M, dM = other(far, eta)
            if slopes:
                N, M = dN / h, dM / size
            scale = weight * (end - begin) * (2 * np.pi * x if radial else 1)
            out[np.ix_(a, b)] += scale * np.outer(N, M)
    return out


def kron(*matrices):
    out = np.ones((1, 1))
    for matrix in matrices:
        out = np.kron(out, matrix)
    return out


def dense(slave, master, space, degree=1, rule=SIMPSON, radial=False, keep=None):
    """β by a dense Schur complement: B A⁻¹ Bᵀ q = β² h M q.

    Args:
        slave, master: nodes of the lines along each axis, the last one from the interface into the
            body; no master: a rigid plane
        keep: multipliers of the test; None: all
    """
    u = ("Lagrange", degree)
    extents = [line[-1] - line[0] for line in slave[:-1]]
    area = np.prod(extents) * (np.pi * (slave[0][0] + slave[0][-1]) * 1.0 if radial else 1.0)
    length = area if len(extents) == 1 and not radial else np.sqrt(area)
    S = 0
    for lines in (slave,) if master is None else (slave, master):
        weigh = [radial] + [False] * (len(lines) - 1)  # R is the first coordinate
        mass = [product(u, (u, n), n, radial=r) for n, r in zip(lines, weigh)]
        slope = [product(u, (u, n), n, radial=r, slopes=True) for n, r in zip(lines, weigh)]
        A = kron(*mass) / length**2
        for axis in range(len(lines)):
            A = A + kron(*mass[:axis], slope[axis], *mass[axis + 1 :])
        pairs = zip(slave[:-1], lines[:-1], weigh)
        B = kron(*[product(space, (u, n), line, rule, r) for line, n, r in pairs])
        face = np.zeros((1, len(mass[-1])))
        face[0, 0] = 1.0  # the first node of the last line lies on the interface
        B = kron(B, face)
        S = S + B @ np.linalg.solve(A, B.T)
    M = kron(*[product(space, (space, n), n, radial=r) for n, r in zip(slave[:-1], weigh)])
    size = np.linalg.norm([line[1] - line[0] for line in slave[:-1]])  # a facet's diameter
    if keep is not None:
        S, M = S[np.ix_(keep, keep)], M[np.ix_(keep, keep)]
    return np.sqrt(max(0.0, eigh(S, size * M, eigvals_only=True)[0]))


# -- the same by the library ------------------------------------------------------------------------


def surfaces(slave, master, degree=1, cell="quadrilateral", scale=1.0, turned=False, comm=COMM):
    """Of two boxes on a flat interface; lines as for dense(), evenly spaced."""
    dim = len(slave)

    def body(lines, sign):
        counts = [len(line) - 1 for line in lines]

        def place(x):
            y = x.copy()
            y[:, -1] *= sign
            return scale * (turn(y) if turned else y)

        return meshes.grid(counts, [l[0] for l in lines], [l[-1] for l in lines], place, cell)

    normal = np.eye(dim)[-1] if not turned else ROTATION[:, 2]
    mesh, number = meshes.create(
        comm, [body(slave, 1)] + ([] if master is None else [body(master, -1)])
    )
    flat = lambda x: np.abs(normal @ x[:dim]) < 1e-9 * scale  # noqa: E731
    sides = {SLAVE: (flat, 0)} if master is None else {SLAVE: (flat, 0), MASTER: (flat, 1)}
    tags = meshes.tag_facets(mesh, sides, number)
    u = fem.Function(compat.vector_space(mesh, degree))
    other = dc.RigidPlane(0 * normal, normal) if master is None else dc.Surface(u, tags, MASTER)
    return dc.Surface(u, tags, SLAVE), other


def lines(*counts, start=0.0, end=1.0, height=0.5):
    """Evenly spaced along each axis; the last one is that into the body."""
    along = [np.linspace(start, end, n + 1) for n in counts[:-1]]
    return [*along, np.linspace(0, height, counts[-1] + 1)]


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("degree", (1, 2))
def test_equals_a_dense_construction(space, degree):
    slave, master = lines(5, 2), lines(4, 2)
    pair = dc.ContactPair(*surfaces(slave, master, degree), pressure_space=space)
    expected = dense(slave, master, space, degree)
    if (degree, space) in ((1, ("Lagrange", 2)), (1, ("DG", 1))):
        assert expected < 1e-6 and infsup.constant(pair) < 1e-6  # more pressures than nodes
    else:
        assert expected > 0.05
        assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


def test_equals_a_dense_construction_with_nodes():
    slave, master = lines(5, 2), lines(7, 2)
    pair = dc.ContactPair(*surfaces(slave, master), integration=dc.Nodes())
    ends = np.array([0.0, 1.0]), np.array([0.5, 0.5])
    expected = dense(slave, master, SPACES[0], rule=ends)
    assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("degree", (1, 2))
def test_equals_a_dense_construction_with_segments(degree):
    slave, master = lines(5, 2), lines(7, 2)
    for space in (("DG", 0), ("Lagrange", degree)):
        one = surfaces(slave, master, degree)
        pair = dc.ContactPair(*one, pressure_space=space, integration=dc.Segments())
        expected = dense(slave, master, space, degree, rule=None)
        assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


def test_axisymmetric():
    slave, master = (lines(n, 2, start=0.2, end=1.4) for n in (5, 4))
    pair = dc.ContactPair(*surfaces(slave, master), axisymmetric=True)
    expected = dense(slave, master, SPACES[0], radial=True)
    assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


def test_turned_boxes():
    slave, master = lines(3, 3, 2), lines(2, 2, 1)
    for space in (SPACES[0], SPACES[2]):
        turned = surfaces(slave, master, cell="hexahedron", turned=True)
        pair = dc.ContactPair(*turned, pressure_space=space)
        expected = dense(slave, master, space)
        assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("facets", (1, 6))
def test_rigid_plane(facets):
    slave = lines(facets, 3)
    pair = dc.ContactPair(*surfaces(slave, None), pressure_space=("DG", 0))
    expected = dense(slave, None, ("DG", 0))
    assert infsup.constant(pair) == pytest.approx(expected, rel=1e-9)


def test_left_out():
    """Pressures that the user excludes, and those of facets that stand out beyond the master."""
    slave, master = lines(6, 2), lines(4, 2, start=0.3)
    options = {"target": dc.Proximity(end_tolerance=0.0)}
    one, two = surfaces(slave, master)
    pair = dc.ContactPair(one, two, **options)  # two facets stand out: up to x = 1/3
    seen = dense(slave, master, SPACES[0], keep=np.arange(7) > 2)
    assert infsup.constant(pair) == pytest.approx(seen, rel=1e-9)

    slave, master = lines(6, 2), lines(4, 2)
    one, two = surfaces(slave, master)
    mesh = one.u.function_space.mesh
    ends = meshes.tag_facets(mesh, {7: lambda x: np.isclose(x[1], 0) & (x[0] < 0.17)})
    pair = dc.ContactPair(one, two, exclude=(ends, 7))
    free = dense(slave, master, SPACES[0], keep=np.arange(7) > 1)
    assert infsup.constant(pair) == pytest.approx(free, rel=1e-9)


# -- zero, stable, falling --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "cell, space",
    [("quadrilateral", ("DG", 1)), ("triangle", ("Lagrange", 2)), ("tetrahedron", ("DG", 0))],
)
def test_zero(cell, space):
    """More pressures than nodes of the slave, on a rigid plane: some have no effect."""
    slave = lines(4, 2) if cell in ("triangle", "quadrilateral") else lines(3, 3, 1)
    pair = dc.ContactPair(*surfaces(slave, None, cell=cell), pressure_space=space)
    assert 0 <= infsup.constant(pair) < 1e-6


def test_refinement():
    """Continuous pressures of degree 1 are stable; constant ones on matching meshes see a
    checkerboard: their constant halves with the mesh size."""
    found = {space: [] for space in (SPACES[0], SPACES[2])}
    for n in (1, 2, 4):
        one = surfaces(lines(11 * n, 4 * n), lines(8 * n, 3 * n))
        found[SPACES[0]].append(infsup.constant(dc.ContactPair(*one)))
        same = surfaces(lines(8 * n, 3 * n), lines(8 * n, 3 * n))
        pair = dc.ContactPair(*same, pressure_space=("DG", 0))
        found[SPACES[2]].append(infsup.constant(pair))
    p1, p0 = (np.array(v) for v in found.values())
    assert np.all(p1[1:] >= 0.9 * p1[:-1])
    assert np.all(np.abs(p0[1:] / p0[:-1] - 0.5) < 0.05)


# -- units, ranks, h --------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_units(cell):
    slave, master = (
        (lines(5, 2), lines(4, 2)) if cell == "quadrilateral" else (lines(3, 3, 1), lines(2, 2, 1))
    )
    found = [
        infsup.constant(dc.ContactPair(*surfaces(slave, master, cell=cell, scale=scale)))
        for scale in (1.0, 1000.0)
    ]
    assert found[0] > 0.05
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_size_and_friction():
    pair = dc.ContactPair(*surfaces(lines(5, 2), lines(4, 2)))
    beta = infsup.constant(pair)  # with h = 0.2
    assert infsup.constant(pair, 0.2) == pytest.approx(beta, rel=1e-12)
    assert infsup.constant(pair, h=0.8) == pytest.approx(beta / 2, rel=1e-12)
    rough = dc.ContactPair(pair.slave, pair.master, friction=0.5)
    assert infsup.constant(rough) == pytest.approx(beta, rel=1e-12)


@pytest.mark.parametrize("partition", (None, apart, striped, remote))
def test_ranks(partition):
    """One mesh or two, on all ranks and on one."""
    halves = block_halves((11, 8))
    alone = infsup.constant(one_mesh(MPI.COMM_SELF, halves, MATERIAL).pair())
    together = one_mesh(COMM, halves, MATERIAL, partition)
    assert infsup.constant(together.pair()) == pytest.approx(alone, rel=1e-10)
    upper, lower = two_meshes(COMM, halves, MATERIAL, partition)
    pair = dc.ContactPair(upper.surface(SLAVE), lower.surface(MASTER))
    assert infsup.constant(pair) == pytest.approx(alone, rel=1e-10)


def test_nothing_is_changed():
    """Fields and results of a solved pair stay, and so does the constant."""
    model = one_mesh(COMM, block_halves((5, 4), 2), MATERIAL)
    pair = model.solve(friction=0.2)
    fields = [pair._multiplier, pair._semi_multiplier, pair.pressure, pair.friction, model.u]
    before, force = [f.x.array.copy() for f in fields], pair.resultant()
    first = infsup.constant(pair)
    assert first > 0.05 and force[1] > 0
    assert all(np.array_equal(a, f.x.array) for a, f in zip(before, fields))
    assert np.array_equal(force, pair.resultant())
    assert infsup.constant(pair) == pytest.approx(first, rel=1e-10)


# -- errors -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", (0, -1.0, np.nan, np.inf, "1", [0.1]))
def test_wrong_size(h):
    pair = dc.ContactPair(*surfaces(lines(2, 1), lines(2, 1)))
    with pytest.raises(dc.InputError, match="positive, finite length"):
        infsup.constant(pair, h)


def test_wrong_size_on_one_rank():
    pair = dc.ContactPair(*surfaces(lines(2, 1), lines(2, 1)))
    with pytest.raises(dc.InputError, match="positive, finite length"):
        infsup.constant(pair, -1.0 if COMM.rank == COMM.size - 1 else 1.0)


def test_wrong_pair():
    with pytest.raises(dc.InputError, match="give a ContactPair"):
        infsup.constant(surfaces(lines(2, 1), lines(2, 1))[0])


def test_out_of_reach():
    slave, _ = surfaces(lines(2, 1), None)
    plane = dc.RigidPlane((0, -1.0), (0, 1.0))
    pair = dc.ContactPair(slave, plane, target=dc.Smooth(radius=0.5))
    with pytest.raises(dc.InputError, match="larger radius"):
        infsup.constant(pair)


# -- doubtful choices -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "degree, space, shape, rule, sound",
    [
        (1, ("Lagrange", 1), "interval", dc.Simpson(1), True),
        (2, ("Lagrange", 2), "triangle", dc.Simpson(1), True),
        (2, ("DG", 0), "quadrilateral", dc.Simpson(1), True),
        (2, ("DG", 0), "interval", dc.Nodes(), True),
        (2, ("DG", 0), "triangle", dc.Simpson(1), False),
        (1, ("Lagrange", 2), "interval", dc.Nodes(), False),
        (1, ("DG", 0), "interval", dc.Simpson(0), False),
        (2, ("DG", 1), "quadrilateral", dc.Simpson(2), False),
        (2, ("DG", 2), "interval", dc.Gauss(6), False),
    ],
)
def test_doubt(degree, space, shape, rule, sound):
    """The benchmark compares it with constants on many meshes."""
    doubt = infsup.doubt(degree, space, shape, rule)
    assert (doubt is None) == sound
    if not sound:
        assert f"displacements of degree {degree}" in doubt and '("Lagrange", 1)' in doubt
        assert ("coincide" in doubt) == (space[0] == "DG" and space[1] > 0 and rule == dc.Nodes())
