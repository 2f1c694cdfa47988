# SPDX-License-Identifier: MIT
"""The assembled matrix against central differences of the assembled residual.

Compared are the whole operator and, so that a stiff bulk hides nothing, contact's part of it, block
by block (slave, master, multiplier). Statuses and targets are the same at both ends of a
difference, which is asserted; the matrix is the exact derivative then.
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from operators import INTERPOLATED, MU, PARAMETERS, TURNING, case
from operators import TARGETS as FIXED_NORMALS
from two_bodies import CELLS, DEGREES, DIM, degree_two, model

import dolfinx_contact as dc

TARGETS = (*FIXED_NORMALS, *INTERPOLATED, *TURNING)
RULES = {"Nodes": dc.Nodes(), "Simpson": dc.Simpson(1), "Gauss": dc.Gauss(3)}

# Step of the differences, in bodies of size 1. Truncation is about (step / length)² with the
# shortest length of the geometry, a radius of curvature or a facet, of about 0.05: 4e-9; round-off
# is about 1e-16 / step × conditioning (up to 1e2): 3e-9.
STEP = 3e-6
TOLERANCE = 1e-7  # relative, an order above the two


def directions(c, seed=3):
    """One random direction in each block; canonical, thus the same on every partition."""
    values = np.random.default_rng(seed).normal(size=len(c.x)) * ~c.held
    return [values * part for part in (c.slave, c.master, c.multiplier, c.friction) if part.any()]


def snapshot(c):
    """Statuses, target facets and clamping of this rank's particles."""
    table = c.contact.assembler.particles()
    return np.stack([table[key] for key in ("closed", "target_facet", "clamped", "slips")])


def differences(c, d):
    """Derivative of whole and contact residual along d; asserts that no particle switches.

    The last residual must be that of the state, or a neighbour that nothing switched to.
    """
    before, ends, same = snapshot(c), [], True
    for sign in (1, -1):
        ends.append(c.residual(c.x + sign * STEP * d))
        same = same and np.array_equal(snapshot(c), before)
    assert c.system.comm.allreduce(same, op=MPI.LAND), "not generic: a particle switches"
    return [(plus - minus) / (2 * STEP) for plus, minus in zip(*ends)]


def assert_derivative(c):
    """Matrix against differences in random directions; the worst relative error."""
    whole = c.matrix()
    contact = c.contact_matrix()
    worst = 0.0
    for d in directions(c):
        for matrix, difference in zip((whole, contact), differences(c, d)):
            product = matrix @ d
            for rows in (c.slave, c.master, c.multiplier, c.friction):
                if not rows.any():
                    continue
                error = np.linalg.norm((product - difference)[rows])
                # blocks may vanish (λ with λ where all are closed): then relative to the others
                size = max(np.linalg.norm(product[rows]), 1e-2 * np.linalg.norm(product))
                worst = max(worst, error / size)
    assert worst < TOLERANCE
    return worst


def assert_telling(c, clamped=False):
    """The state has closed and open particles, and closed ones clamped to an end where asked."""
    table = c.particles()
    closed, has_target = table["closed"], table["target_facet"] >= 0
    assert closed.any() and (~closed & has_target).any()
    assert np.all(table["target_facet"][closed] >= 0)
    assert not clamped or (closed & table["clamped"]).any()


# every configuration on another partition: DOLFINx's, columns that cut through the interface, the
# two bodies on different ranks
CONFIGURATIONS = {"deformed": "default", "sliding": "columns", "clamped": "apart"}


@pytest.mark.parametrize("configuration", CONFIGURATIONS)
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_random_directions(cell, target, rule, configuration, record_property):
    c = case(model(cell, CONFIGURATIONS[configuration]), target, RULES[rule], configuration)
    assert_telling(c, clamped=configuration == "clamped")
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize("partition", ("apart", "columns"))
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_every_column(cell, target, partition, record_property):
    """Entry by entry, in a sliding and clamped state."""
    c = case(model(cell, partition), target, dc.Simpson(1), "clamped")
    assert_telling(c, clamped=True)
    matrices = c.matrix(), c.contact_matrix()
    columns = [differences(c, d) for d in np.eye(len(c.x))]
    for matrix, part in zip(matrices, zip(*columns)):
        error = np.abs(matrix - np.transpose(part)).max() / np.abs(matrix).max()
        record_property("worst", error)
        assert error < TOLERANCE


@pytest.mark.parametrize("configuration", ("sliding", "clamped"))
@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_degree_two(cell, target, degrees, configuration, record_property):
    """Displacement, or geometry, or both of degree 2; pressures of degree 1 and 2."""
    options = degree_two(degrees, DIM[cell])
    m = model(cell, "columns", bulk="springs", **options)
    space = ("Lagrange", 2 if options["degree"] == 2 and configuration == "sliding" else 1)
    c = case(m, target, dc.Gauss(4), configuration, pressure_space=space)
    assert_telling(c, clamped=configuration == "clamped")
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize(
    "options",
    (
        {"augmented": True},
        {"axisymmetric": True},
        {"pressure_space": ("DG", 0)},
        {"pressure_space": ("Lagrange", 2)},
    ),
    ids=("augmented", "axisymmetric", "DG0", "Lagrange2"),
)
@pytest.mark.parametrize("target", TARGETS)
def test_variants(target, options, record_property):
    c = case(model("quadrilateral", "columns"), target, dc.Simpson(2), "clamped", **options)
    assert_telling(c, clamped=True)
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_two_unknowns(cell, target, record_property):
    """Slave and master on meshes of their own, moved by Functions of their own."""
    c = case(model(cell, "columns", separate=True), target, dc.Simpson(1), "clamped")
    assert len(c.system.u) == 2
    assert_telling(c, clamped=True)
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize("partition", ("default", "apart", "columns"))
@pytest.mark.parametrize("cell", CELLS)
def test_held_nodes(cell, partition, record_property):
    """Dirichlet conditions on nodes of both interfaces: rows and columns of the identity."""
    target = "proximity-facet"
    c = case(model(cell, partition, held=True), target, dc.Simpson(1), "sliding")
    # the master's held nodes, and the slave's, carry particles' forces without the conditions
    free = case(model(cell, partition), target, dc.Simpson(1), "sliding")
    contact = np.abs(free.residual()[1]) > 1e-6
    assert (c.held & contact & c.slave).any() and (c.held & contact & c.master).any()
    assert_telling(c)
    matrix = c.matrix()
    identity = np.eye(len(c.x))
    assert np.array_equal(matrix[c.held], identity[c.held])
    assert np.array_equal(matrix[:, c.held], identity[:, c.held])
    whole, _ = c.residual()
    assert np.all(whole[c.held] == 0.0)
    record_property("worst", assert_derivative(c))


def matrix_of_new_system(c, m, target, rule, x):
    """The matrix of another system, made at the state x."""
    other = case(m, target, rule, "sliding")
    assert np.array_equal(other.numbering.points, c.numbering.points)
    other.system.A = None
    other.residual(x)
    other.system.create_matrix()
    other.system.scale[:] = c.system.scale
    other.contact.assembler.set_parameters(*PARAMETERS)
    return other.matrix(x)


@pytest.mark.parametrize("partition", ("default", "apart", "columns"))
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_sliding_far(cell, target, partition, record_property):
    """Targets leave the pattern of the matrix: it grows, and equals that of a new system."""
    dim, rule = DIM[cell], dc.Simpson(1)
    m = model(
        cell,
        partition,
        counts=((2, 1), (12, 1)) if dim == 2 else ((1, 1, 1), (12, 2, 1)),
        slave_box=((0.05, 0.1), (0.3, 0.3)) if dim == 2 else ((0.05, 0.2, 0.1), (0.3, 0.8, 0.3)),
    )
    c = case(m, target, rule, "sliding")
    c.matrix()
    first = set(c.particles()["target_facet"])
    c.x[c.slave & (c.numbering.component == 0)] += 0.57  # 5.7 facets of the master
    c.residual()
    table = c.particles()
    assert table["closed"].any() and first.isdisjoint(table["target_facet"][table["closed"]])
    mine = c.contact.assembler.pattern_holds()
    assert not all(c.system.comm.allgather(mine)), "the targets have not left the pattern"
    slid = c.matrix()
    assert all(c.system.comm.allgather(c.contact.assembler.pattern_holds()))
    assert_derivative(c)

    new = matrix_of_new_system(c, m, target, rule, c.x)
    # same targets, but sums in another order: a few units of round-off in each entry
    difference = np.abs(slid - new).max() / np.abs(new).max()
    assert difference < 1e-13
    record_property("worst", difference)


# -- friction ---------------------------------------------------------------------------------------


def assert_rubbing(c):
    """Particles stick, slip and are open."""
    table = c.particles()
    assert table["slips"].any() and (table["rubs"] & ~table["slips"]).any()
    assert (~table["closed"]).any()


@pytest.mark.parametrize("configuration", CONFIGURATIONS)
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_friction(cell, target, configuration, record_property):
    c = case(
        model(cell, CONFIGURATIONS[configuration]),
        target,
        dc.Simpson(1),
        configuration,
        friction=MU,
    )
    assert_telling(c, clamped=configuration == "clamped")
    assert_rubbing(c)
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize(
    "options",
    (
        {"augmented": True},
        {"slip": "increment"},
        {"friction_space": ("DG", 0)},
        {"pressure_space": ("Lagrange", 2), "friction_space": ("Lagrange", 1)},
    ),
    ids=("augmented", "increment", "DG0", "spaces"),
)
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_friction_variants(cell, options, record_property):
    target = "smooth-interpolated"
    c = case(model(cell, "columns"), target, dc.Gauss(4), "clamped", friction=MU, **options)
    assert_rubbing(c)
    record_property("worst", assert_derivative(c))


@pytest.mark.parametrize("target", ("smooth-interpolated", "proximity-facet", "slave-direction"))
@pytest.mark.parametrize("cell", CELLS)
def test_friction_degree_two(cell, target, record_property):
    m = model(cell, "columns", bulk="springs", **degree_two("P2G2", DIM[cell]))
    c = case(m, target, dc.Gauss(4), "sliding", friction=MU)
    assert_rubbing(c)
    record_property("worst", assert_derivative(c))
