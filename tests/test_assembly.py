# SPDX-License-Identifier: MIT
"""The assembled residual and matrix of contact against an independent construction in NumPy
(reference.py), and against themselves on other partitions and as two meshes.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from operators import INTERPOLATED, case, relative
from operators import TARGETS as FIXED_NORMALS
from reference import Construction
from reference_facets import FACET, gauss, simpson
from two_bodies import CELLS, DEGREES, DIM, PARTITIONS, degree_two, model

import dolfinx_contact as dc

TARGETS = (*FIXED_NORMALS, *INTERPOLATED)
TOLERANCE = 1e-13  # relative to the largest entry

RULES = {
    "Nodes": (dc.Nodes(), lambda shape: None),
    "Simpson0": (dc.Simpson(0), lambda shape: simpson(shape, 0)),
    "Simpson1": (dc.Simpson(1), lambda shape: simpson(shape, 1)),
    "Simpson2": (dc.Simpson(2), lambda shape: simpson(shape, 2)),
    "Gauss3": (dc.Gauss(3), lambda shape: gauss(shape, 2)),
}


# -- against the construction -------------------------------------------------------------------------


def assert_constructed(c, cell, target, rule, record, **options):
    """Residual, statuses, targets and matrix of a case against the construction."""
    contact = (c.matrix(), c.contact_matrix())[1]  # of the targets that the first one finds
    residual = c.residual()[1]
    reference = Construction(c, cell, target, rule(FACET[cell]), **options)
    table = c.particles()
    closed = reference.closed
    assert closed.any() and not closed.all()
    # each target cell carries as many closed and open particles, whatever their order
    cells = [reference.master.cell[t[0]] if t else -1 for t in reference.targets]
    mine = np.where(table["target_facet"] >= 0, table["target_facet"] // 8, -1)
    assert Counter(zip(mine, table["closed"])) == Counter(zip(cells, closed))
    assert np.isclose(table["weight"].sum(), reference.weight.sum(), rtol=1e-13)
    # sums of some 100 products; targets are solved to 1e-13 of a facet, and the last step squares
    for name, value, expected in (
        ("residual", residual, reference.residual()),
        ("matrix", contact, reference.matrix()),
    ):
        error = relative(value, expected)
        record(f"worst_{name}", error)
        assert error < TOLERANCE, name
    return reference


def assert_clamped(reference):
    """Closed particles have targets that are held by a physical end."""
    held = [bool(t and t[2]) for t in reference.targets]
    assert any(kind and closed for kind, closed in zip(held, reference.closed))


@pytest.mark.parametrize("configuration", ("deformed", "sliding", "clamped", "beyond"))
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_configurations(cell, target, configuration, record_property):
    rule, points = RULES["Simpson1" if DIM[cell] == 2 else "Simpson0"]
    partition = {"deformed": "default", "clamped": "apart"}.get(configuration, "columns")
    c = case(model(cell, partition), target, rule, configuration)
    reference = assert_constructed(c, cell, target, points, record_property)
    if configuration == "clamped":
        assert_clamped(reference)
    if configuration == "beyond":
        assert any(t and t[2] for t in reference.targets)
    assert (None in reference.targets) == (configuration == "beyond")


@pytest.mark.parametrize("configuration", ("sliding", "clamped"))
@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_degree_two(cell, target, degrees, configuration, record_property):
    """Displacement, or geometry, or both of degree 2; pressures of degree 1 and 2."""
    options = degree_two(degrees, DIM[cell])
    pressure = 2 if options["degree"] == 2 and configuration == "sliding" else 1
    m = model(cell, "columns", bulk="springs", **options)
    c = case(m, target, dc.Gauss(5), configuration, pressure_space=("Lagrange", pressure))
    reference = assert_constructed(
        c,
        cell,
        target,
        lambda shape: gauss(shape, 3),
        record_property,
        pressure_degree=pressure,
        **options,
    )
    if configuration == "clamped":
        assert_clamped(reference)


@pytest.mark.parametrize("configuration", ("sliding", "clamped"))
@pytest.mark.parametrize("target", INTERPOLATED)
@pytest.mark.parametrize("cell", CELLS)
def test_creases(cell, target, configuration, record_property):
    """Some edges of the master are sharper than the crease angle, some are not."""
    rule, points = RULES["Simpson0"]
    crease = {"crease": 8.0}
    c = case(model(cell, "columns"), target, rule, configuration, **crease)
    reference = assert_constructed(c, cell, target, points, record_property, **crease)
    stars, vertices = reference.master.stars, reference.master.vertices
    around = [[(vertices == v).any(axis=1).sum() for v in row] for row in vertices]
    sizes = [(len(star), n) for row in zip(stars, around) for star, n in zip(*row) if n > 1]
    assert any(size < n for size, n in sizes) and any(size > 1 for size, _ in sizes)


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("cell", CELLS)
def test_rules(cell, name, record_property):
    rule, points = RULES[name]
    target = "proximity-facet"
    c = case(model(cell, "columns"), target, rule, "sliding")
    assert_constructed(c, cell, target, points, record_property)


@pytest.mark.parametrize("option", ("augmented", "axisymmetric"))
@pytest.mark.parametrize("target", ("direction-facet", "smooth-interpolated"))
@pytest.mark.parametrize("name", ("Nodes", "Simpson1"))
def test_variants(target, option, name, record_property):
    rule, points = RULES[name]
    options = {option: True}
    c = case(model("triangle", "columns"), target, rule, "clamped", **options)
    assert_constructed(c, "triangle", target, points, record_property, **options)


# -- against itself -----------------------------------------------------------------------------------


@pytest.mark.parametrize("partition", PARTITIONS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_any_partition(cell, target, partition, record_property):
    """The whole operator equals that of this rank alone, on every partition."""
    c = case(model(cell, partition), target, dc.Simpson(1), "clamped")
    alone = case(model(cell, alone=True), target, dc.Simpson(1), "clamped")
    assert np.allclose(c.numbering.points, alone.numbering.points, rtol=0, atol=1e-14)
    mine, expected = c.matrix(), alone.matrix()
    for value, other in ((mine, expected), *zip(c.residual(), alone.residual())):
        # the same sums in another order: round-off of some 100 terms
        error = relative(value, other)
        record_property("worst", error)
        assert error < 1e-13
    table = c.particles()
    for key, values in alone.particles().items():
        if key == "row":  # the facet's place on this rank
            continue
        atol = 0 if values.dtype.kind in "bi" else 1e-13  # bodies of size 1, forces below 1
        assert np.allclose(table[key], values, rtol=0, atol=atol, equal_nan=True)


@pytest.mark.parametrize("target", ("proximity-facet", "smooth-interpolated"))
def test_two_meshes_or_one(target):
    """Two meshes with two Functions give the operator of one mesh of two bodies."""
    one = case(model("quadrilateral", "columns"), target, dc.Simpson(1), "clamped")
    two = case(model("quadrilateral", "columns", separate=True), target, dc.Simpson(1), "clamped")
    # canonical order: one mesh sorts the nodes of both bodies together
    first = [np.lexsort(np.round(_key(c), 7).T[::-1]) for c in (one, two)]
    assert np.array_equal(_key(one)[first[0]].round(7), _key(two)[first[1]].round(7))
    operators = [c.matrix()[np.ix_(order, order)] for c, order in zip((one, two), first)]
    # the same entries summed in another order
    assert relative(*operators) < 1e-14


def _key(c):
    return np.column_stack([c.multiplier, c.master, c.numbering.points, c.numbering.component])
