# SPDX-License-Identifier: MIT
"""Laws that hold for any surfaces, positions and rules, tried on examples that hypothesis makes.

Each example is two small bodies with wavy interfaces on this rank alone, in a random state, with the
operators that a solve has. The examples are the same in each run; ranks may try different ones, since
hypothesis 6.155 also tries numbers that it finds in the modules that a rank has loaded.
CONTACT_EXAMPLES says how many there are of each law.
"""

from __future__ import annotations

import functools
import os

import numpy as np
import pytest
import ufl
from dolfinx import fem
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.system import System

EPS = np.finfo(float).eps
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
few = settings(
    max_examples=int(os.environ.get("CONTACT_EXAMPLES", 10)),
    derandomize=True,
    database=None,
    deadline=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)

unit = st.floats(-1.0, 1.0, width=32)
waves = st.lists(unit, min_size=6, max_size=6)
cells = st.sampled_from(sorted(CELLS))
rules = st.one_of(
    st.integers(0, 2).map(dc.Simpson),
    st.integers(2, 5).map(dc.Gauss),
    st.just(dc.Nodes()),
    st.just(dc.Segments()),
)
targets = st.sampled_from(
    [
        ("smooth", "interpolated"),
        ("proximity", "facet"),
        ("proximity", "interpolated"),
        ("direction", "facet"),
        ("direction", "direction"),
        ("slave", "direction"),
        ("slave", "interpolated"),
    ]
)


def wave(coefficients, x, amplitude):
    """A smooth function of points (n, dim), with values between −amplitude and amplitude."""
    a = np.asarray(coefficients)
    phase = 4.0 * x @ np.array([1.0, 0.7, 0.4])[: x.shape[1]]
    return amplitude / 3 * (
        a[0] * np.sin(phase + 3 * a[1]) + a[2] * np.sin(2.3 * phase + 3 * a[3])
    ) + (amplitude / 3 * a[4] * np.sin(3.1 * x[:, 0] + 3 * a[5]))


@functools.lru_cache(maxsize=None)
def rotation(dim, a, b, c):
    if dim == 3:
        return Rotation.from_rotvec([3 * a, 3 * b, 3 * c]).as_matrix()
    return Rotation.from_rotvec([0, 0, 3 * a]).as_matrix()[:2, :2]


class Bodies:
    """Two boxes that face each other, on this rank.

    Args:
        cell: shape of the cells
        shape: coefficients of the interfaces' waves
        state: those of displacements and pressures
        target: name of the target and normals
        size, turn, shift: the reference configuration is size · turn · X + shift
    """

    def __init__(
        self, cell, shape, state, target, rule, *, friction=0.0, size=1.0, turn=None, shift=0.0
    ):
        self.dim, self.cell = CELLS[cell], cell
        dim, flat = self.dim, (0,) * (self.dim - 2)
        self.size, self.turn = size, np.eye(dim) if turn is None else turn
        self.shift = shift * np.arange(1, dim + 1)
        waved = lambda x: x + np.outer(  # noqa: E731
            wave(shape, x[:, :-1], 0.06) * (1 - 2 * np.abs(x[:, -1])), np.eye(dim)[-1]
        )
        mapping = lambda x: size * waved(x) @ self.turn.T + self.shift  # noqa: E731
        low, high = (0.11, *[0.07] * (dim - 2), 0), (0.98, *[0.93] * (dim - 2), 0.5)
        upper = meshes.grid((3, *[2] * (dim - 2), 1), low, high, mapping, cell)
        ends = (0, *flat, -0.5), (1.1, *[1.05] * (dim - 2), 0)
        lower = meshes.grid((4, *[2] * (dim - 2), 1), *ends, mapping, cell)
        mesh, body = meshes.create(MPI.COMM_SELF, [upper, lower])

        def interface(x):
            y = self.straight(x[:dim].T)
            return np.isclose(y[:, -1], wave(shape, y[:, :-1], 0.06), atol=1e-9)

        tags = meshes.tag_facets(mesh, {5: (interface, 0), 6: (interface, 1)}, body)
        V = compat.vector_space(mesh, 1)
        self.u, w = fem.Function(V), ufl.TestFunction(V)
        springs = ufl.inner(self.u, w) * ufl.dx(metadata={"quadrature_degree": 2})
        kind, normals = target
        e = self.turn @ np.array([0.2, 0.1, 1.0])[-dim:]
        choice = {
            "smooth": dc.Smooth(radius=0.3 * size),
            "proximity": dc.Proximity(radius=0.3 * size),
            "direction": dc.SeekDirection(tuple(e), radius=0.3 * size),
            "slave": dc.SlaveNormal(radius=0.3 * size),
        }[kind]
        sides = (dc.Surface(self.u, tags, tag) for tag in (5, 6))
        options = {"target": choice, "normals": normals, "integration": rule, "friction": friction}
        self.pair = dc.ContactPair(*sides, **options, initial_contact=10.0)
        J = ufl.derivative(springs, self.u)
        self.system = System([springs], [self.u], [[J]], [self.pair], [])
        self.contact = self.system.contacts[0]

        # nodes of both bodies; those of the slave are nodes of its cells
        self.X = V.tabulate_dof_coordinates()[:, :dim]
        dofs = compat.dof_list(V)
        self.of_slave = np.zeros(len(self.X), dtype=bool)
        self.of_slave[dofs[body == 0]] = True
        y = self.straight(self.X)
        self.now = self._displaced(y, state)
        # a step before, the slave was elsewhere
        self.before = self.now + 0.02 * np.outer(self.of_slave, [1.0, 0.5, 0.3][:dim])
        points = self.pair._multiplier.function_space.tabulate_dof_coordinates()[:, :dim]
        self.pressure = -0.3 + wave(state[::-1], self.straight(points), 0.5)
        self.friction = friction

    def straight(self, X):
        """Points before the similarity."""
        return (X - self.shift) @ self.turn / self.size

    def _displaced(self, y, state):
        """Places of nodes y, where the bodies touch: waves and noise, different in both bodies."""
        phase = np.outer(y @ [31.0, 17.0, 23.0][: self.dim] + 5 * self.of_slave, [1.0, 1.3, 1.7])
        noise = 0.01 * np.sin(phase + 3 * state[0])[:, : self.dim]
        bump = wave(state, y + 0.3 * self.of_slave[:, None], 0.02)
        return y + noise + np.outer(bump, np.eye(self.dim)[-1])

    def evaluate(self, turn=None, shift=0.0):
        """Contact forces at the nodes (n, dim), rows of the pressures, table of the particles; after a
        rigid motion of all that is."""
        Q = np.eye(self.dim) if turn is None else turn

        def put(places):
            x = self.size * places @ self.turn.T + self.shift
            moved = x @ Q.T + shift
            self.u.x.array[:] = (moved - self.X).ravel()
            return moved

        contact, s = self.contact, self.size
        self.pair._multiplier.x.array[:] = self.pressure
        if self.friction:
            put(self.before)
            contact.remember()
            contact.begin_step()
            self.pair._semi_multiplier.x.array[:] = 0.0
        self.position = put(self.now)
        contact.update()
        contact.hold()
        if self.friction:
            parameters = 12.0 / s, 1.0, self.friction, 3.0 / s, 1.0, 0.05 * s
            contact.assembler.set_parameters(*parameters)
        else:
            contact.assembler.set_parameters(12.0 / s, 1.0)
        contact.update()
        b = self.system.b
        b.zeroEntries()
        contact.assembler.residual(b.handle)
        b.assemble()
        n, m = self.X.size, len(self.pressure)
        rows, table = b.array_r.copy(), dict(contact.assembler.particles())
        return rows[:n].reshape(-1, self.dim), rows[n : n + m], table


def sorted_table(table):
    """Rows by reference position: a rule may number its particles in another order."""
    order = np.lexsort(np.round(np.column_stack([table["X"], table["facet"]]), 6).T)
    return {key: value[order] for key, value in table.items()}


def scale(forces):
    """Size of round-off in a sum of forces."""
    return max(float(np.abs(forces).sum()), 1e-3)


def moments(x, f):
    return np.cross(x, f) if x.shape[1] == 3 else (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])[:, None]


# -- laws ---------------------------------------------------------------------------------------------


@few
@given(cells, waves, waves, targets, rules, st.sampled_from([0.0, 0.4]))
def test_forces_on_slave_and_master_are_opposite(cell, shape, state, target, rule, friction):
    """Virtual work of contact in a rigid motion is zero: in translations at once, in rotations where
    traction and gap are parallel; else it is the work of the couples −(x¹ − x²) × t, and of nothing else.
    """
    b = Bodies(cell, shape, state, target, rule, friction=friction)
    forces, _, table = b.evaluate()
    size = scale(forces)
    assert table["closed"].any() and size > 0.01
    slave, master = forces[b.of_slave].sum(axis=0), forces[~b.of_slave].sum(axis=0)
    assert np.abs(slave + master).max() < 100 * EPS * size
    resultant = table["weight"] @ table["traction"]
    assert np.abs(slave + resultant).max() < 100 * EPS * size
    closed = table["closed"]
    arm = (table["x"] - table["target"])[closed]
    couples = moments(arm, table["weight"][closed, None] * table["traction"][closed]).sum(axis=0)
    left = moments(b.position, forces).sum(axis=0)
    assert np.abs(left + couples).max() < 1e-11 * size


@few
@given(cells, waves, waves, targets, rules, st.sampled_from([0.0, 0.4]), unit, unit, unit)
def test_rigid_motions_of_the_whole_turn_the_forces(
    cell, shape, state, target, rule, friction, p, q, r
):
    """x → Q x + c of both bodies, now and a step before: gaps, statuses, tractions along normals and the
    rows of the pressures stay, forces turn. (A seek direction stays in space: it moves only.)"""
    b = Bodies(cell, shape, state, target, rule, friction=friction)
    forces, rows, table = b.evaluate()
    Q = np.eye(b.dim) if target[0] == "direction" else rotation(b.dim, p, q, r)
    shift = 2 * np.array([q, r, p])[: b.dim]
    turned, same, after = b.evaluate(Q, shift)
    table, after = sorted_table(table), sorted_table(after)
    assert np.array_equal(table["closed"], after["closed"])
    near = table["closed"]
    assert np.abs(after["gap"] - table["gap"])[near].max(initial=0) < 1e-10
    assert np.abs(after["normal"] - table["normal"] @ Q.T)[near].max(initial=0) < 1e-9
    assert np.abs(turned - forces @ Q.T).max() < 1e-9 * scale(forces)
    assert np.abs(same - rows).max() < 1e-9 * max(np.abs(rows).max(), 1e-3)


@few
@given(
    cells, waves, waves, targets, rules, st.sampled_from([1e-6, 1e-3, 25.4, 1e4]), unit, unit, unit
)
def test_units_and_places_do_not_matter(cell, shape, state, target, rule, size, p, q, r):
    """The same bodies in other units of length, turned and placed elsewhere in the reference: gaps are
    lengths, forces are pressures times areas."""
    first = Bodies(cell, shape, state, target, rule)
    turn = rotation(first.dim, p, q, r)
    second = Bodies(cell, shape, state, target, rule, size=size, turn=turn, shift=0.5 * size * p)
    assert np.allclose(second.straight(second.X), first.straight(first.X), atol=1e-12)
    (forces, _, table), (other, _, after) = first.evaluate(), second.evaluate()
    table["X"], after["X"] = first.straight(table["X"]), second.straight(after["X"])
    table, after = sorted_table(table), sorted_table(after)
    assert np.array_equal(table["closed"], after["closed"])
    near = table["closed"]
    assert np.abs(after["gap"] / size - table["gap"])[near].max(initial=0) < 1e-9
    area = size ** (first.dim - 1)
    assert np.allclose(after["weight"], area * table["weight"], rtol=1e-9, atol=1e-12 * area)
    assert np.abs(other / area - forces @ turn.T).max() < 1e-8 * scale(forces)


def area(X):
    """Sum of the areas of facets given by their corners, (n, corners, dim); Gauss's rule on bilinear
    ones."""
    if X.shape[2] == 2:
        return np.linalg.norm(X[:, 1] - X[:, 0], axis=1).sum()
    if X.shape[1] == 3:
        return 0.5 * np.linalg.norm(np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]), axis=1).sum()
    points, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for s, a in zip(0.5 + 0.5 * points, 0.5 * weights):
        for t, c in zip(0.5 + 0.5 * points, 0.5 * weights):
            along = (1 - t) * (X[:, 1] - X[:, 0]) + t * (X[:, 3] - X[:, 2])
            across = (1 - s) * (X[:, 2] - X[:, 0]) + s * (X[:, 3] - X[:, 1])
            total += a * c * np.linalg.norm(np.cross(along, across), axis=1).sum()
    return total


@few
@given(cells, waves, waves, rules)
def test_weights_are_positive_and_sum_up_to_the_area(cell, shape, state, rule):
    """Whatever the rule and the shape, of the surfaces and of what the master covers."""
    b = Bodies(cell, shape, state, ("smooth", "interpolated"), rule)
    table = b.evaluate()[2]
    assert table["weight"].min() > 0
    # bilinear facets have an area element that is no polynomial: low rules integrate it roughly
    rough = cell == "hexahedron" and not isinstance(rule, dc.Segments)
    assert table["weight"].sum() == pytest.approx(
        area(b.pair.slave.X), rel=1e-2 if rough else 1e-3
    )
    if cell != "hexahedron":
        assert table["weight"].sum() == pytest.approx(area(b.pair.slave.X), rel=1e-12)


@few
@given(st.sampled_from(["triangle", "quadrilateral"]), waves, waves, targets, rules)
def test_the_sign_of_the_gap(cell, shape, state, target, rule):
    """Positive where a particle is above the master's polygon, negative where it is below."""
    b = Bodies(cell, shape, state, target, rule)
    table = b.evaluate()[2]
    facets = b.pair.master.nodes  # numbers of both ends of each facet
    nodes = np.unique(facets)
    corners = b.position[nodes][np.argsort(b.position[nodes, 0])]
    assert np.all(np.diff(corners[:, 0]) > 0.1)  # the polygon is a graph
    height = table["x"][:, 1] - np.interp(table["x"][:, 0], *corners.T)
    inside = (table["x"][:, 0] > corners[0, 0]) & (table["x"][:, 0] < corners[-1, 0])
    sure = np.isfinite(table["gap"]) & inside & (np.abs(height) > 1e-9)
    assert sure.sum() >= 4
    assert np.array_equal(table["gap"][sure] > 0, height[sure] > 0)


@few
@given(
    st.sampled_from(["plane", "ball", "bowl", "cylinder", "torus"]),
    st.sampled_from(["tetrahedron", "hexahedron"]),
    waves,
    waves,
    unit,
    unit,
    unit,
)
def test_gaps_to_rigid_tools_are_distances(kind, cell, shape, state, p, q, r):
    """To tools that are placed anywhere: the signed distance from the surface, by its formula."""
    b = Bodies(cell, shape, state, ("proximity", "facet"), dc.Simpson(1))
    R, c = rotation(3, p, q, r), np.array([0.5 + 0.2 * p, 0.5 + 0.2 * q, -0.1])
    e, zero = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    tool = {
        "plane": dc.RigidPlane(zero, e),
        "ball": dc.RigidSphere(zero, 0.3),
        "bowl": dc.RigidSphere(zero, 3.0, inside=True),
        "cylinder": dc.RigidCylinder(zero, e, 0.25),
        "torus": dc.RigidTorus(zero, e, 2.0, 0.5),
    }[kind]
    tool.move(c, R)
    pair = dc.ContactPair(
        b.pair.slave, tool, target=dc.Proximity(radius=10.0), integration=dc.Simpson(1)
    )
    w = ufl.TestFunction(b.u.function_space)
    F = ufl.inner(b.u, w) * ufl.dx(metadata={"quadrature_degree": 2})
    system = System([F], [b.u], [[ufl.derivative(F, b.u)]], [pair], [])
    b.u.x.array[:] = (b.now - b.X).ravel()
    system.contacts[0].update()
    table = system.contacts[0].assembler.particles()
    y = (table["x"] - c) @ R  # in the tool's frame
    around = np.hypot(y[:, 0], y[:, 1])
    distance = {
        "plane": y[:, 2],
        "ball": np.linalg.norm(y, axis=1) - 0.3,
        "bowl": 3.0 - np.linalg.norm(y, axis=1),
        "cylinder": around - 0.25,
        "torus": np.hypot(around - 2.0, y[:, 2]) - 0.5,
    }[kind]
    met = np.isfinite(table["gap"])  # tools that a facet does not face are no targets
    assume(met.any())
    assert np.abs(table["gap"] - distance)[met].max() < 1e-12
