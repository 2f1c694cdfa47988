# SPDX-License-Identifier: MIT
"""Particles as users see them: where they lie and what they weigh (formulation, section 3)."""

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
    block_halves,
    cube_halves,
    height,
    one_mesh,
    small_strain,
    turn,
    values,
)

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
MATERIAL = Material(small_strain, 1.0, 0.0)
EPS = np.finfo(float).eps

TABLE = {  # abscissae and weights on [0, 1]
    0: ([0, 1 / 2, 1], [1 / 6, 2 / 3, 1 / 6]),
    1: ([0, 1 / 4, 1 / 2, 3 / 4, 1], [1 / 12, 1 / 3, 1 / 6, 1 / 3, 1 / 12]),
    2: (
        [0, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 5 / 8, 3 / 4, 7 / 8, 1],
        [1 / 24, 1 / 6, 1 / 12, 1 / 6, 1 / 12, 1 / 6, 1 / 12, 1 / 6, 1 / 24],
    ),
}


def particles(halves, **options):
    """A pair at rest, and its particles of all ranks on all ranks: reference positions, weights and
    numbers of facets. The master is moved away, so that nothing is to be solved. Collective."""
    model = one_mesh(COMM, [halves[0], lowered(halves[1])], MATERIAL)
    for tag, components in model.driven.items():
        model.move(tag, [0.0] * len(components))
    pair = model.solve(**options)
    p = pair.particles
    rows = COMM.allgather((p.reference, p.weight, p.facet))
    return pair, *(np.concatenate(column) for column in zip(*rows))


def lowered(half):
    """The same body, 0.1 lower."""
    dim = half.body.points.shape[1]
    down = -0.1 * (ROTATION[:, 2] if dim == 3 else np.array([0.0, 1.0]))
    points = half.body.points + down
    body = meshes.Body(points, half.body.cells, half.body.cell, half.body.degree)
    back = -np.pad(down, (0, 3 - dim))[:, None]
    faces = {tag: lambda x, f=f: f(x + back) for tag, f in half.faces.items()}
    return Half(body, faces, half.held)


def by_facet(x, w, facet):
    for f in np.unique(facet):
        yield x[facet == f], w[facet == f]


def skewed_halves(cell):
    """Flat, rotated faces of [0, 1]² whose facets are no two alike (flat quadrilaterals with linear
    Jacobians, which all rules integrate exactly)."""

    def skew(x):
        y = x.copy()
        y[:, 0] += 0.3 * x[:, 0] * (1 - x[:, 0]) * (1 - x[:, 1])
        y[:, 1] -= 0.2 * x[:, 1] * (1 - x[:, 1]) * x[:, 0]
        return turn(y)

    upper, lower = cube_halves((3, 2), (cell, cell))
    upper.body = meshes.grid((3, 2, 2), (0, 0, 0), (1, 1, 1), skew, cell)
    return [upper, lower]


def disk_halves(cell="quadrilateral", count=3):
    """Axisymmetric: the slave's face is 0 ≤ r ≤ 1 at z = 0, its facets grow with r."""

    def grow(x):
        return np.stack([x[:, 0] ** 1.5, x[:, 1]], axis=1)

    upper = meshes.grid((count, 1), (0, 0), (1, 1), grow, cell)
    lower = meshes.grid((2, 1), (0, -1), (1.2, 0), cell=cell)
    faces = {SLAVE: lambda x: np.isclose(x[1], 0), TOP: lambda x: np.isclose(x[1], 1)}
    below = {MASTER: lambda x: np.isclose(x[1], 0), BOTTOM: lambda x: np.isclose(x[1], -1)}
    held = (0.0, 0.0)
    return [Half(upper, faces, {TOP: held}), Half(lower, below, {BOTTOM: held})]


# -- Simpson ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", TABLE)
def test_simpson_on_intervals_is_the_table(n):
    _, x, w, facet = particles(block_halves((3, 2), 1), integration=dc.Simpson(n))
    abscissae, weights = TABLE[n]
    length = 2 / 3
    assert len(np.unique(facet)) == 3
    for xf, wf in by_facet(x, w, facet):
        order = np.argsort(xf[:, 0])
        local = (xf[order, 0] - xf[:, 0].min()) / length
        # a few roundings of numbers up to 1
        np.testing.assert_allclose(local, abscissae, atol=10 * EPS)
        np.testing.assert_allclose(wf[order] / length, weights, rtol=10 * EPS)
        np.testing.assert_allclose(xf[:, 1], 0, atol=10 * EPS)


@pytest.mark.parametrize("n", TABLE)
def test_simpson_on_quadrilaterals_is_the_tensor_product(n):
    _, x, w, facet = particles(cube_halves((2, 1)), integration=dc.Simpson(n))
    abscissae, weights = TABLE[n]
    expected = {
        (round(8 * a), round(8 * b)): p * q
        for (a, p), (b, q) in itertools.product(zip(abscissae, weights), repeat=2)
    }
    assert len(np.unique(facet)) == 4
    for xf, wf in by_facet(x @ ROTATION, w, facet):
        eighths = 8 * (xf[:, :2] - xf[:, :2].min(axis=0)) / 0.5
        # round-off of the rotation, in eighths of a facet
        np.testing.assert_allclose(eighths, np.rint(eighths), atol=200 * EPS)
        found = {tuple(k): v / 0.25 for k, v in zip(np.rint(eighths).astype(int), wf)}
        assert found.keys() == expected.keys() and len(wf) == len(expected)
        for key, weight in expected.items():
            assert found[key] == pytest.approx(weight, rel=100 * EPS)


def subdivided(corners, n):
    """The 7-point rule on 4ⁿ similar triangles, by halving edges n times; coincident points merged.

    Returns:
        {position in units of 1e-9: weight}
    """
    if n > 0:
        a, b, c = corners
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        merged = {}
        for part in parts:
            for key, weight in subdivided(part, n - 1).items():
                merged[key] = merged.get(key, 0.0) + weight
        return merged
    a, b, c = corners
    area = np.linalg.norm(np.cross(b - a, c - a)) / 2
    points = [(a, 1 / 20), (b, 1 / 20), (c, 1 / 20)]
    points += [((a + b) / 2, 2 / 15), ((b + c) / 2, 2 / 15), ((c + a) / 2, 2 / 15)]
    points += [((a + b + c) / 3, 9 / 20)]
    return {tuple(np.rint(x * 1e9).astype(int)): weight * area for x, weight in points}


@pytest.mark.parametrize("n", [0, 1, 2])
def test_simpson_on_triangles_is_the_composite_rule(n):
    pair, x, w, facet = particles(skewed_halves("tetrahedron"), integration=dc.Simpson(n))
    corners = {
        int(f): corners[:3]
        for part in COMM.allgather((pair.slave.id, pair.slave.X))
        for f, corners in zip(*part)
    }
    assert len(corners) == 12 and set(facet) == set(corners)
    points = {0: 7, 1: 19, 2: 61}[n]  # 3 vertices, 3 middles and 1 centroid; then merged
    for f in corners:
        xf, wf = x[facet == f], w[facet == f]
        expected = subdivided(corners[f], n)
        assert len(wf) == len(expected) == points
        places = np.array(list(expected)) / 1e9
        near = np.linalg.norm(xf[:, None] - places[None], axis=2)
        # positions are compared on a raster of 1e-9
        assert near.min(axis=1).max() < 2e-9
        at = near.argmin(axis=1)
        assert len(set(at)) == points
        np.testing.assert_allclose(wf, np.array(list(expected.values()))[at], rtol=1e-13)


# -- exactness ----------------------------------------------------------------------------------------

EXACT = {
    "Simpson(0)": (dc.Simpson(0), 3),
    "Simpson(2)": (dc.Simpson(2), 3),
    "Gauss(3)": (dc.Gauss(3), 3),
    "Gauss(6)": (dc.Gauss(6), 6),
    "Gauss(13)": (dc.Gauss(13), 13),
}


def errors(x, w, degree):
    """Relative errors of ∫ of all monomials of x over [0, 1]^d of a total degree."""
    d = x.shape[1]
    powers = [p for p in itertools.product(range(degree + 1), repeat=d) if sum(p) == degree]
    exact = [np.prod([1 / (k + 1) for k in p]) for p in powers]
    found = [w @ np.prod(x**p, axis=1) for p in map(np.array, powers)]
    return np.abs(np.array(found) / exact - 1)


@pytest.mark.parametrize("rule, degree", EXACT.values(), ids=EXACT.keys())
@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron", "hexahedron"])
def test_polynomials_are_integrated_exactly(cell, rule, degree):
    """Up to the rule's degree, and not beyond: facets are large enough to tell."""
    if cell == "quadrilateral":
        halves = block_halves((2, 2), 1)
        _, x, w, _ = particles(halves, integration=rule)
        x, w = (x[:, :1] + 1) / 2, w / 2
    else:
        _, x, w, _ = particles(cube_halves((1, 1), (cell, cell)), integration=rule)
        x = (x @ ROTATION)[:, :2]
    for k in range(degree + 1):
        # round-off of sums of some 1e3 terms, and of positions with rotation
        assert errors(x, w, k).max() < 1e-12, k
    # the next odd and even degrees are both missed (Gauss rules may be exact for one more)
    assert max(errors(x, w, k).max() for k in (degree + 1, degree + 2, degree + 3)) > 1e-12


@pytest.mark.parametrize("points", [2, 3, 5])
def test_lobatto_has_the_ends_and_its_degree(points):
    rule = dc.Lobatto(points)
    _, x, w, facet = particles(block_halves((3, 2), 1), integration=rule)
    for xf, _ in by_facet(x, w, facet):
        assert len(xf) == points
        assert np.ptp(xf[:, 0]) == pytest.approx(2 / 3, rel=10 * EPS)
    x, w, degree = (x[:, :1] + 1) / 2, w / 2, 2 * points - 3
    assert max(errors(x, w, k).max() for k in range(degree + 1)) < 1e-13  # round-off
    # the next even degree is missed, by about a third (a facet) to that power over its factorial
    assert errors(x, w, degree + 1).max() > 1e-11


# -- measures -----------------------------------------------------------------------------------------

RULES = [dc.Nodes(), dc.Simpson(0), dc.Simpson(1), dc.Simpson(3), dc.Gauss(2), dc.Gauss(5)]


def area(pair, axisymmetric=False):
    """Measure of the slave surface by UFL."""
    mesh = pair.slave.mesh
    density = 2 * np.pi * ufl.SpatialCoordinate(mesh)[0] if axisymmetric else 1.0
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 4})
    return compat.assemble_scalar(COMM, compat.form(density * dx))


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_weights_sum_to_the_measure_in_3d(cell, rule):
    pair, _, w, _ = particles(skewed_halves(cell), integration=rule)
    assert w.min() > 0
    # linear Jacobians: all rules are exact up to round-off of the sum
    assert w.sum() == pytest.approx(area(pair), rel=1e-13)
    assert w.sum() == pytest.approx(1.0, rel=1e-13)


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_weights_sum_to_the_axisymmetric_measure(cell, rule):
    """∫ 2πr dr = π on the disk of radius 1, whatever the rule."""
    pair, x, w, _ = particles(disk_halves(cell), integration=rule, axisymmetric=True)
    assert area(pair, True) == pytest.approx(np.pi, rel=1e-13)
    assert w.sum() == pytest.approx(np.pi, rel=1e-13)
    if rule == dc.Nodes():
        assert w.min() > 0  # on the axis too
    else:
        assert np.all((w > 0) == (x[:, 0] > EPS))


# in axisymmetry a pressure of degree 2 has no weight on the axis: test_held.py
@pytest.mark.parametrize("axisymmetric, degree", [(False, 1), (False, 2), (True, 1)])
def test_nodes_carry_the_integral_of_their_basis_function(axisymmetric, degree):
    """Summed over the facets of a node: ∫ N_a dΓ, with 2πr inside the integral, by UFL."""
    options = dict(pressure_space=("Lagrange", degree), integration=dc.Nodes())
    pair, x, w, _ = particles(disk_halves(), axisymmetric=axisymmetric, **options)
    V = pair.pressure.function_space
    factor = 2 * np.pi * ufl.SpatialCoordinate(V.mesh)[0] if axisymmetric else 1.0
    dx = ufl.Measure("dx", domain=V.mesh, metadata={"quadrature_degree": 5})
    lumped = fem.Function(V)
    form = compat.form(factor * ufl.TestFunction(V) * dx)
    owned = compat.assemble_vector_local(form, fem.Function(V))
    lumped.x.array[: len(owned)] = owned
    nodes, expected = values(lumped)
    assert len(nodes) == 3 * degree + 1
    for node, weight in zip(nodes, expected[:, 0]):
        here = np.linalg.norm(x - node[:2], axis=1) < 1e-12
        assert 1 <= here.sum() <= 2
        assert w[here].sum() == pytest.approx(weight, rel=1e-13)
    on_axis = w[x[:, 0] < EPS]
    h = 3**-1.5  # the first facet
    if axisymmetric:
        np.testing.assert_allclose(on_axis, [2 * np.pi * h**2 / 6], rtol=1e-13)


def test_nodes_in_3d_are_lumped_too():
    for cell, degree in (("tetrahedron", 1), ("hexahedron", 1), ("hexahedron", 2)):
        halves, options = skewed_halves(cell), dict(pressure_space=("Lagrange", degree))
        pair, x, w, _ = particles(halves, integration=dc.Nodes(), **options)
        V = pair.pressure.function_space
        dx = ufl.Measure("dx", domain=V.mesh, metadata={"quadrature_degree": 5})
        lumped = fem.Function(V)
        form = compat.form(ufl.TestFunction(V) * dx)
        owned = compat.assemble_vector_local(form, fem.Function(V))
        lumped.x.array[: len(owned)] = owned
        nodes, expected = values(lumped)
        assert len(nodes) == (3 * degree + 1) * (2 * degree + 1)
        at = np.linalg.norm(x[:, None] - nodes[None], axis=2).argmin(axis=1)
        found = np.bincount(at, w, len(nodes))
        np.testing.assert_allclose(found, expected[:, 0], rtol=1e-12)
        np.testing.assert_allclose(x @ ROTATION[:, 2], 0, atol=1e-14)
        assert np.all(np.isclose(height(nodes.T), 0))


# -- rules that do not fit ----------------------------------------------------------------------------


def rejected(halves, **options):
    model = one_mesh(COMM, halves, MATERIAL)
    with pytest.raises(dc.InputError) as caught:
        model.pair(**options)
    assert set(COMM.allgather(type(caught.value).__name__)) == {"InputError"}
    return str(caught.value)


def test_rules_too_poor_for_the_pressure():
    """One particle a facet cannot hold two pressures: the system would be singular."""
    text = rejected(block_halves((3, 2), 1), integration=dc.Gauss(1))
    assert "Gauss(degree=1)" in text and "1 particles" in text and "richer rule" in text
    text = rejected(cube_halves((1, 1)), integration=dc.Gauss(2), pressure_space=("DG", 2))
    assert "of the 9" in text and "lower degree" in text
    # it is enough for constants
    _, _, w, _ = particles(
        block_halves((3, 2), 1), integration=dc.Gauss(1), pressure_space=("DG", 0)
    )
    np.testing.assert_allclose(w, 2 / 3, rtol=10 * EPS)


def test_lobatto_on_triangles():
    text = rejected(cube_halves((1, 1), ("tetrahedron",) * 2), integration=dc.Lobatto(3))
    assert "triangles" in text and "Simpson(n)" in text
