# SPDX-License-Identifier: MIT
"""The assembled operators against DOLFINx's own assembly and a construction in NumPy.

The NumPy construction reads the mesh from its input arrays. It finds targets by trying every facet,
writes (F1) and (F2) for each particle, and differentiates them by complex step through the target's
own equation; it knows none of the explicit derivatives (F4'), (F5'), (F4c), (F7'), (F9)-(F13) that
the package uses. Equations: H. Ben Dhia and M. Zarroug, Hybrid frictional contact
particles-in elements, Revue européenne des éléments finis 11 (2002), as restated in the mathematics
page.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem
from petsc4py import PETSc
from operators import (
    CELLS,
    COMM,
    DIM,
    GAP,
    MASTER,
    OBLIQUE,
    PARTITIONS,
    RHO,
    SCALE,
    SLAVE,
    TARGETS,
    Numbering,
    bodies,
    case,
    curve,
    model,
    overshoot,
)

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.system import System, derivative

EPS = np.finfo(float).eps

# -- reference facets, written out ------------------------------------------------------------------

FACET = {"triangle": "interval", "quadrilateral": "interval"}
FACET |= {"tetrahedron": "triangle", "hexahedron": "quadrilateral"}
CORNERS = {
    "interval": np.array([[0.0], [1.0]]),
    "triangle": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "quadrilateral": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
}
EDGES = {"triangle": ((0, 1), (0, 2), (1, 2)), "quadrilateral": ((0, 1), (0, 2), (1, 3), (2, 3))}


def shape_functions(shape, xi):
    """Values (..., n), first (..., Q, n) and second derivatives (..., Q, Q, n) at ξ (..., Q)."""
    a, b = xi[..., 0], xi[..., -1]
    zero, one = 0 * a, 0 * a + 1
    if shape == "interval":
        N, first = [1 - a, a], [[-one, one]]
        second = [[[zero, zero]]]
    elif shape == "triangle":
        N, first = [1 - a - b, a, b], [[-one, one, zero], [-one, zero, one]]
        second = [[[zero] * 3] * 2] * 2
    else:
        N = [(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b]
        first = [[b - 1, 1 - b, -b, b], [a - 1, -a, 1 - a, a]]
        mixed = [one, -one, -one, one]
        second = [[[zero] * 4, mixed], [mixed, [zero] * 4]]
    return tuple(np.moveaxis(np.array(v), -1, 0) for v in (N, first, second))


def area_vector(tau):
    """τ_1 × τ_2; in 2D (τ_y, −τ_x). τ: (..., Q, D)."""
    if tau.shape[-1] == 2:
        return np.stack([tau[..., 0, 1], -tau[..., 0, 0]], axis=-1)
    return np.cross(tau[..., 0, :], tau[..., 1, :])


def dot(a, b):
    """a·b without conjugation, for complex steps."""
    return np.sum(a * b, axis=-1)


# -- particles ----------------------------------------------------------------------------------------

# the table of the n-Simpson rules on [0, 1]
SIMPSON = {
    0: ((0, 1 / 2, 1), (1 / 6, 2 / 3, 1 / 6)),
    1: ((0, 1 / 4, 1 / 2, 3 / 4, 1), (1 / 12, 1 / 3, 1 / 6, 1 / 3, 1 / 12)),
    2: (
        (0, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 5 / 8, 3 / 4, 7 / 8, 1),
        (1 / 24, 1 / 6, 1 / 12, 1 / 6, 1 / 12, 1 / 6, 1 / 12, 1 / 6, 1 / 24),
    ),
}


def simpson(shape, n):
    """Points and weights; points of neighbouring triangles are not merged, which changes no sum."""
    if shape != "triangle":
        return tensor(shape, *(np.array(column) for column in SIMPSON[n]))
    triangles = [CORNERS["triangle"]]
    for _ in range(n):  # the four similar triangles of each: three at the corners, one amid
        split = []
        for t in triangles:
            a, b, c = t
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            split += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        triangles = [np.array(t) for t in split]
    points, weights = [], []
    for t in triangles:
        points += [*t, *((t + np.roll(t, 1, axis=0)) / 2), t.mean(axis=0)]
        weights += [w * 0.5 / len(triangles) for w in [1 / 20] * 3 + [2 / 15] * 3 + [9 / 20]]
    return np.array(points), np.array(weights)


def tensor(shape, x, w):
    if shape == "interval":
        return x[:, None], w
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    return points, np.outer(w, w).ravel()


def gauss(shape, points):
    """Gauss points; on triangles a symmetric rule of Basix."""
    if shape == "triangle":
        return basix.make_quadrature(basix.CellType.triangle, 2 * points - 1)
    x, w = np.polynomial.legendre.leggauss(points)
    return tensor(shape, (x + 1) / 2, w / 2)


# -- the construction ---------------------------------------------------------------------------------


@dataclass
class Facets:
    """Facets of one surface: canonical unknowns, reference positions, sign, number of the cell."""

    nodes: np.ndarray  # first unknown of each node in the table of unknowns, (n, nodes)
    X: np.ndarray  # (n, nodes, D)
    sigma: np.ndarray  # +1 where the area vector points into the body, (n,)
    cell: np.ndarray  # (n,)
    vertices: np.ndarray  # numbers in the body, (n, nodes)


def facets_of(body, height, first_cell, find):
    """The facets of a body at the height of its interface."""
    kind = getattr(basix.CellType, body.cell)
    dim = body.points.shape[1]
    on = np.isclose(body.points[:, -1], height + curve(body.points) * (1 - height))
    found = []
    for number, cell in enumerate(body.cells):
        for local in basix.topology(kind)[dim - 1]:
            if on[cell[local]].all():
                found.append((first_cell + number, cell[local], body.points[cell].mean(axis=0)))
    found.sort(key=lambda facet: facet[0])  # ties go to the lowest number
    cells, vertices, middles = (np.array(column) for column in zip(*found))
    X = body.points[vertices]
    _, first, _ = shape_functions(FACET[body.cell], CORNERS[FACET[body.cell]].mean(axis=0)[None])
    inward = dot(area_vector(np.einsum("pqn,fnd->fqd", first, X)), middles - X.mean(axis=1))
    return Facets(find(X), X, np.sign(inward), cells, vertices)


class Construction:
    """Contact of a Case (degree 1 everywhere), from the arrays that the meshes were made of.

    Args:
        c: the Case; only its numbering of unknowns and its state are read
        cell, target, options: as given to it
        rule: points and weights on the reference facet, or None for Nodes
    """

    def __init__(self, c, cell, target, rule, *, augmented=False, axisymmetric=False):
        self.shape, self.dim = FACET[cell], DIM[cell]
        self.x, self.augmented, self.comm = c.x, augmented, c.system.comm
        slave, master = bodies(cell)
        points = c.numbering.points[:, : self.dim]
        find = {
            name: lambda X, which=which: nearest(X, points, which)
            for name, which in (
                ("slave", c.slave & (c.numbering.component == 0)),
                ("master", c.master & (c.numbering.component == 0)),
                ("multiplier", c.multiplier),
            )
        }
        # component k of a node is the k-th unknown after the first of it: canonical order
        self.slave = facets_of(slave, GAP, 0, find["slave"])
        self.master = facets_of(master, 0.0, len(slave.cells), find["master"])
        self.multiplier = find["multiplier"](self.slave.X)

        self.directed = target.startswith("direction")
        self.normal_is_direction = target.endswith("-direction")
        self.e = np.array(OBLIQUE[self.dim]) / np.linalg.norm(OBLIQUE[self.dim])
        self.m = self.e if self.directed else np.zeros(self.dim)
        self._particles(rule, axisymmetric)
        self._search()
        self._statuses()

    def unknowns(self, nodes):
        return nodes[..., None] + np.arange(self.dim)

    def _particles(self, rule, axisymmetric):
        points, weights = gauss(self.shape, 5) if rule is None else rule
        N, first, _ = shape_functions(self.shape, points)
        X = self.slave.X
        measure = np.linalg.norm(area_vector(np.einsum("pqn,fnd->fpqd", first, X)), axis=-1)
        weights = weights * measure  # (facets, particles)
        if axisymmetric:
            weights = weights * 2 * np.pi * np.einsum("pn,fn->fp", N, X[..., 0])
        if rule is None:  # ∫ N_a dΓ
            weights, points = weights @ N, CORNERS[self.shape]
        per_facet = len(points)
        N, self.slave_gradients, _ = shape_functions(self.shape, points)
        self.N = np.tile(N, (len(X), 1))
        self.slave_gradients = np.tile(self.slave_gradients, (len(X), 1, 1))
        self.weight, self.on = weights.ravel(), np.repeat(np.arange(len(X)), per_facet)

    # -- targets by trying everything -----------------------------------------------------------

    def _search(self):
        """For each particle facet, ξ, and the vertices that hold it: None, two or one; or None."""
        dim, shape, tol = self.dim, self.shape, 0.5
        slave_x = self.slave.X + self.x[self.unknowns(self.slave.nodes)]
        master_x = self.master.X + self.x[self.unknowns(self.master.nodes)]
        x1 = np.einsum("pn,pnd->pd", self.N, slave_x[self.on])
        tau = np.einsum("pqn,pnd->pqd", self.slave_gradients, slave_x[self.on])
        outward = -self.slave.sigma[self.on, None] * area_vector(tau)
        edges = EDGES[shape] if dim == 3 else ((0,), (1,))
        # physical ends: edges that one facet has
        names = [[tuple(sorted(v[list(e)])) for e in edges] for v in self.master.vertices]
        flat = [name for row in names for name in row]
        end_vertices = {v for name in flat if flat.count(name) == 1 for v in name}
        diameter = [
            max(np.linalg.norm(a - b) for a in X for b in X) for X in self.master.X
        ]  # of the reference configuration
        free, held = self._candidates(x1, outward, master_x, edges)
        is_end = np.array([[flat.count(name) == 1 for name in row] for row in names])
        self.targets = []
        for p in range(len(x1)):
            if self.directed:  # beside the surface: its nearest physical end, seen along e
                near = is_end & (held[p].beside <= tol * np.array(diameter)[:, None])
                ends = np.where(near, held[p].cost, np.inf)
                at = lowest(free[p].cost)
                found = (at[0], free[p].xi[at], None) if at else None
                if at is None and (at := lowest(ends)):
                    found = (at[0], held[p].xi[at], held[p].kind(at, edges))
            else:
                costs = np.column_stack([free[p].cost, held[p].cost])
                at = lowest(costs)
                if at is None:
                    found = None
                elif at[1] == 0:
                    found = (at[0], free[p].xi[at], None)
                else:
                    at = (at[0], at[1] - 1)
                    found = (at[0], held[p].xi[at], held[p].kind(at, edges))
                    vertices = {self.master.vertices[at[0]][v] for v in found[2]}
                    at_end = flat.count(tuple(sorted(vertices))) == 1 or vertices < end_vertices
                    if at_end and held[p].beside[at] > tol * diameter[at[0]]:
                        found = None
            self.targets.append(found)

    def _candidates(self, x, outward, master_x, edges):
        """For each particle its stationary point on each facet and on each edge of each facet."""
        shape, size, q = self.shape, (len(x), len(master_x)), self.dim - 1
        corners = CORNERS[shape]
        line = [np.linspace(0, 1, 9)] * q
        lattice = np.stack(np.meshgrid(*line), axis=-1).reshape(-1, q)
        if shape == "triangle":
            lattice = lattice[lattice.sum(axis=1) <= 1 + EPS]
        free = Candidates(*size, 1, q)
        held = Candidates(*size, len(edges), q)
        for f, nodes in enumerate(master_x):
            # start where a lattice on the facet is nearest: Newton has a short way then
            r = x[:, None] - shape_functions(shape, lattice)[0] @ nodes
            r = r - (r @ self.m)[..., None] * self.m
            start = lattice[np.argmin(np.linalg.norm(r, axis=2), axis=1)]
            xi = self._solve(x, np.broadcast_to(nodes, (len(x), *nodes.shape)), start, 15)
            inside = np.all((xi > -1e-8) & (xi < 1 + 1e-8), axis=1)
            if shape == "triangle":
                inside &= xi.sum(axis=1) < 1 + 1e-8
            self._judge(free, (f, 0), x, outward, nodes, xi, self.directed)
            free.cost[~inside, f, 0] = np.inf
            for number, edge in enumerate(edges):
                a, b = corners[edge[0]], corners[edge[-1]]
                eta = np.zeros(len(x))
                if len(edge) == 2:
                    t = nodes[edge[1]] - nodes[edge[0]]
                    t = t - (t @ self.m) * self.m
                    eta = np.clip((x - nodes[edge[0]]) @ t / (t @ t), 0, 1)
                held.eta[:, f, number] = eta
                xi = a + eta[:, None] * (b - a)
                self._judge(held, (f, number), x, outward, nodes, xi, False)
        return free, held

    def _judge(self, candidates, at, x, outward, nodes, xi, along):
        """Cost (along m, or else all of it but the part along m), and whether the facet faces."""
        N, first, _ = shape_functions(self.shape, xi)
        n = self.master.sigma[at[0]] * area_vector(np.einsum("pqn,nd->pqd", first, nodes))
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        r = x - N @ nodes
        m = np.broadcast_to(self.e, n.shape) if self.directed else n
        beside = np.linalg.norm(r - dot(r, m)[:, None] * m, axis=1)
        transverse = r - (r @ self.m)[:, None] * self.m
        cost = np.abs(r @ self.e) if along else np.linalg.norm(transverse, axis=1)
        refused = dot(n, outward) < 0
        if self.directed:
            refused |= np.abs(n @ self.e) < 0.1
        candidates.cost[(slice(None), *at)] = np.where(refused, np.inf, cost)
        candidates.beside[(slice(None), *at)] = beside
        candidates.xi[(slice(None), *at)] = xi

    def _solve(self, x, nodes, xi, iterations):
        """Newton on the free target's equation, (F4) or (F5); real or complex, without limits."""
        for _ in range(iterations):
            N, first, second = shape_functions(self.shape, xi)
            r = x - np.einsum("sn,snd->sd", N, nodes)
            tau = np.einsum("sqn,snd->sqd", first, nodes)
            if self.directed:
                e = np.broadcast_to(-self.e, r.shape)[:, None, :]
                A = np.swapaxes(np.concatenate([tau, e], axis=1), 1, 2)
                step = np.linalg.solve(A, r[..., None])[:, :-1, 0]
            else:
                curvature = np.einsum("sqpn,snd->sqpd", second, nodes)
                A = np.einsum("sqd,spd->sqp", tau, tau)
                exact = A - np.einsum("sqpd,sd->sqp", curvature, r)
                far = np.linalg.det(exact).real < 1e-3 * np.linalg.det(A).real
                A = np.where(far[:, None, None], A, exact)
                step = np.linalg.solve(A, np.einsum("sqd,sd->sq", tau, r)[..., None])[..., 0]
            xi = xi + step
            if np.isrealobj(xi):  # the search: far facets may have no such point
                xi = np.clip(xi, -3, 4)
                if np.abs(step).max() < EPS:
                    break
        return xi

    # -- residual and matrix --------------------------------------------------------------------

    def _statuses(self):
        """χ(g_n) of each particle."""
        gaps = np.full(len(self.on), -np.inf)
        for p, target in enumerate(self.targets):
            if target:
                gaps[p] = self._terms(p, self._local(p)[1][None])[1][0]
        multiplier = SCALE * np.sum(self.N * self.x[self.multiplier[self.on]], axis=1)
        self.closed = multiplier - RHO * gaps < 0

    def _local(self, p):
        """Unknowns of a particle and its target, and their values: slave, λ/s, master."""
        slave = self.unknowns(self.slave.nodes[self.on[p]]).ravel()
        multiplier = self.multiplier[self.on[p]]
        target = self.targets[p]
        rows = [slave, multiplier]
        if target:
            rows.append(self.unknowns(self.master.nodes[target[0]]).ravel())
        rows = np.concatenate(rows)
        return rows, self.x[rows]

    def _terms(self, p, z):
        """Position on the slave, gap, normal and ξ of a particle for samples z of its unknowns."""
        f, xi, kind = self.targets[p]
        n, D = len(CORNERS[self.shape]), self.dim
        slave = self.slave.X[self.on[p]] + z[:, : n * D].reshape(-1, n, D)
        master = self.master.X[f] + z[:, n * D + n :].reshape(-1, n, D)
        x = np.einsum("n,snd->sd", self.N[p], slave)
        xi = np.broadcast_to(xi, (len(z), D - 1)).astype(z.dtype)
        if kind is None:
            xi = self._solve(x, master, xi, 3)
        elif len(kind) == 2:  # held on a straight edge: stationary ‖T_m r‖
            a, b = kind
            t = master[:, b] - master[:, a]
            t = t - dot(t, self.m)[:, None] * self.m
            eta = dot(x - master[:, a], t) / dot(t, t)
            corners = CORNERS[self.shape]
            xi = corners[a] + eta[:, None] * (corners[b] - corners[a])
        M, first, _ = shape_functions(self.shape, xi)
        tau = np.einsum("sqn,snd->sqd", first, master)
        normal = self.master.sigma[f] * area_vector(tau)
        normal = normal / np.sqrt(dot(normal, normal))[:, None]
        if self.normal_is_direction:
            sign = np.sign(dot(normal, self.e).real)
            normal = sign[:, None] * self.e + 0 * normal
        gap = dot(x - np.einsum("sn,snd->sd", M, master), normal)
        return x, gap, normal, M

    def _particle(self, p, closed, z):
        """(F1), (F2) of one particle for samples z; rows as in _local."""
        n, D = len(CORNERS[self.shape]), self.dim
        lam = SCALE * z[:, n * D : n * D + n] @ self.N[p]
        w, N = self.weight[p], self.N[p]
        out = np.zeros_like(z)
        if not closed:
            out[:, n * D : n * D + n] = -w * SCALE / RHO * lam[:, None] * N
            return out
        _, gap, normal, M = self._terms(p, z)
        t = (lam - RHO * gap if self.augmented else lam)[:, None] * normal
        out[:, : n * D] = -w * np.einsum("n,sd->snd", N, t).reshape(len(z), -1)
        out[:, n * D : n * D + n] = -w * SCALE * gap[:, None] * N
        out[:, n * D + n :] = w * np.einsum("sn,sd->snd", M, t).reshape(len(z), -1)
        return out

    def residual(self):
        out = np.zeros(len(self.x))
        for p in self._share():
            rows, z = self._local(p)
            np.add.at(out, rows, self._particle(p, self.closed[p], z[None])[0])
        return self.comm.allreduce(out)

    def matrix(self):
        """By complex step: exact to round-off, whatever the step (1e-30)."""
        out = np.zeros((len(self.x),) * 2)
        for p in self._share():
            rows, z = self._local(p)
            steps = self._particle(p, self.closed[p], z + 1e-30j * np.eye(len(z)))
            np.add.at(out, (rows[:, None], rows[None, :]), steps.imag.T / 1e-30)
        return self.comm.allreduce(out)

    def _share(self):
        """This rank's part of the work, only to save time: all ranks know all particles."""
        return range(self.comm.rank, len(self.on), self.comm.size)


class Candidates:
    """Points of (particle, facet, place); `held[p]` gives those of one particle."""

    def __init__(self, particles, facets, places, q):
        self.cost, self.beside, self.eta = np.full((3, particles, facets, places), np.inf)
        self.xi = np.empty((particles, facets, places, q))

    def __getitem__(self, p):
        out = object.__new__(Candidates)
        for name in ("cost", "beside", "eta", "xi"):
            setattr(out, name, getattr(self, name)[p])
        return out

    def kind(self, at, edges):
        """Vertices that hold a point of an edge: the edge's two, or one of them."""
        edge, eta = edges[at[1]], self.eta[at]
        return edge if 0 < eta < 1 else (edge[int(eta)],)


def lowest(costs):
    """(facet, place) of the least cost; ties go to the lowest facet, and there to the first."""
    if not np.isfinite(costs).any():
        return None
    ties = np.argwhere(costs <= costs.min() + 1e-10)
    return tuple(ties[0])


def nearest(X, points, which):
    """Number of the unknown at each position."""
    numbers = np.flatnonzero(which)
    distance = np.linalg.norm(X[..., None, :] - points[numbers], axis=-1)
    assert distance.min(axis=-1).max() < 1e-12
    return numbers[distance.argmin(axis=-1)]


# -- tests of contact ---------------------------------------------------------------------------------

RULES = {
    "Nodes": (dc.Nodes(), lambda shape: None),
    "Simpson0": (dc.Simpson(0), lambda shape: simpson(shape, 0)),
    "Simpson1": (dc.Simpson(1), lambda shape: simpson(shape, 1)),
    "Simpson2": (dc.Simpson(2), lambda shape: simpson(shape, 2)),
    "Gauss3": (dc.Gauss(3), lambda shape: gauss(shape, 2)),
}


def relative(value, expected):
    return np.abs(value - expected).max() / np.abs(expected).max()


def assert_constructed(c, cell, target, rule, record, **options):
    """Residual, statuses, targets and matrix of a case against the construction."""
    matrix = c.matrix()
    contact = c.contact_matrix()
    residual = c.residual()[1]
    reference = Construction(c, cell, target, rule(FACET[cell]), **options)
    table = c.particles()
    closed = reference.closed
    assert closed.any() and not closed.all()
    # each target cell carries the same particles (merged points of triangles: as sets)
    cells = [reference.master.cell[t[0]] if t else -1 for t in reference.targets]
    mine = np.where(table["target_facet"] >= 0, table["target_facet"] // 8, -1)
    assert set(zip(mine, table["closed"])) == set(zip(cells, closed))
    assert np.isclose(table["weight"].sum(), reference.weight.sum(), rtol=1e-13)
    # sums of some 100 products; the target's equation is solved to 1e-13 of a facet
    error = relative(residual, reference.residual())
    record("worst_residual", error)
    assert error < 1e-12
    # a second derivative of the facets' shapes comes in: round-off over facets of size 0.3
    error = relative(contact, reference.matrix())
    record("worst_matrix", error)
    assert error < 1e-11
    return matrix, reference


@pytest.mark.parametrize("configuration", ("deformed", "sliding", "clamped", "beyond"))
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_configurations(cell, target, configuration, record_property):
    rule, points = RULES["Simpson1" if DIM[cell] == 2 else "Simpson0"]
    partition = {"deformed": "default", "clamped": "apart"}.get(configuration, "columns")
    c = case(model(cell, partition), target, rule, configuration)
    _, reference = assert_constructed(c, cell, target, points, record_property)
    held = [t and t[2] for t in reference.targets]
    if configuration in ("clamped", "beyond"):
        assert any(held)
    if configuration == "clamped":
        assert any(kind and closed for kind, closed in zip(held, reference.closed))
    assert (None in reference.targets) == (configuration == "beyond")


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("cell", CELLS)
def test_rules(cell, name, record_property):
    rule, points = RULES[name]
    c = case(model(cell, "columns"), "proximity-facet", rule, "sliding")
    assert_constructed(c, cell, "proximity-facet", points, record_property)


@pytest.mark.parametrize("option", ("augmented", "axisymmetric"))
@pytest.mark.parametrize("name", ("Nodes", "Simpson1"))
def test_variants(option, name, record_property):
    rule, points = RULES[name]
    target, options = "direction-facet", {option: True}
    c = case(model("triangle", "columns"), target, rule, "clamped", **options)
    assert_constructed(c, "triangle", target, points, record_property, **options)


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
        atol = 0 if values.dtype.kind in "bi" else 1e-13  # bodies of size 1, forces below 1
        assert np.allclose(table[key], values, rtol=0, atol=atol, equal_nan=True)


def test_two_meshes_or_one():
    """Two meshes with two Functions give the operator of one mesh of two bodies."""
    target = "proximity-facet"
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


# -- action and reaction ------------------------------------------------------------------------------


@pytest.mark.parametrize("configuration", ("deformed", "sliding", "clamped"))
@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("cell", CELLS)
def test_balance(cell, target, configuration):
    """Contact forces on slave and master cancel, and so do their moments where r = x¹ − x² lies
    along the traction; elsewhere (targets clamped to an end, a search that is not along the
    normal) the moment left is ∫ −r × t dΓ at any gap."""
    c = case(model(cell, "columns"), target, dc.Simpson(1), configuration)
    dim, bulk = c.pair.slave.dim, ~c.multiplier
    residual = c.residual()[1][bulk].reshape(-1, dim)
    reference = c.numbering.points[bulk][::dim, :dim]
    position = reference + c.x[bulk].reshape(-1, dim)
    table = c.particles()
    size = np.abs(residual).sum()
    assert size > 0.1
    resultant = table["weight"] @ table["traction"]
    slave = c.slave[bulk][::dim]
    # round-off of some 100 terms
    assert np.abs(residual.sum(axis=0)).max() < 100 * EPS * size
    assert np.allclose(residual[slave].sum(axis=0), -resultant, rtol=0, atol=100 * EPS * size)

    moment = _moment(position, residual).sum(axis=0)
    closed = table["closed"]
    arm = (table["x"] - table["target"])[closed]
    left = -table["weight"][closed] @ _moment(arm, table["traction"][closed])
    assert np.allclose(moment, left, rtol=0, atol=1000 * EPS * size)
    along = target != "direction-facet" and not np.any(
        overshoot(table, target, dim)[closed] > 1e-8
    )
    assert along == (target != "direction-facet" and configuration != "clamped")
    if along:
        # targets are solved to 1e-13 of a facet
        assert np.abs(moment).max() < 1e-12 * size
    else:
        assert np.abs(moment).max() > 1e-4 * size


def _moment(x, f):
    """x × f; in 2D its third component, as a column."""
    if x.shape[1] == 3:
        return np.cross(x, f)
    return (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])[:, None]


# -- the bulk -----------------------------------------------------------------------------------------


def bulk_blocks(system, J, bcs):
    """DOLFINx's own matrices of the bulk's blocks, in the canonical order of the system."""
    comm = system.comm
    numbering = Numbering(system)
    out = np.zeros((len(numbering), len(numbering)))
    for i, row in enumerate(J):
        for j, a in enumerate(row):
            if a is None:
                continue
            A = fem.petsc.assemble_matrix(a, bcs=bcs, diagonal=float(i == j))
            A.assemble()
            offsets, columns, values = A.getValuesCSR()
            first, _ = A.getOwnershipRange()
            rows = first + np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
            parts = comm.allgather((rows, columns, values))
            rows, columns, values = (np.concatenate(part) for part in zip(*parts))
            at = [
                numbering.position[system.layout.system_dofs(block, dofs.astype(np.int64))]
                for block, dofs in ((i, rows), (j, columns))
            ]
            out[tuple(at)] = values
    return out


@pytest.mark.parametrize("held", (False, True), ids=("free", "held"))
@pytest.mark.parametrize("separate", (False, True), ids=("one", "two"))
@pytest.mark.parametrize("partition", ("default", "columns"))
@pytest.mark.parametrize("cell", CELLS)
def test_bulk(cell, partition, separate, held):
    """The bulk's rows and columns are DOLFINx's, with contact open and, less contact, closed."""
    m = model(cell, partition, separate=separate, held=held)
    target = "proximity-facet"
    for configuration in ("open", "sliding"):
        c = case(m, target, dc.Simpson(1), configuration)
        closed = c.particles()["closed"]
        matrix = c.matrix()
        expected = bulk_blocks(c.system, m.J, m.bcs)
        bulk = np.ix_(~c.multiplier, ~c.multiplier)
        if configuration == "open":
            assert not closed.any()
            assert not np.any(matrix[np.ix_(~c.multiplier, c.multiplier)])
            # the same insertions of the same numbers; ranks' sums may come in another order
            assert relative(matrix[bulk], expected[bulk]) < 4 * EPS
        else:
            assert closed.any()
            contact = c.contact_matrix()
            assert np.abs(contact[bulk]).max() > 1e-2
            # an addition and a subtraction more
            assert relative((matrix - contact)[bulk], expected[bulk]) < 16 * EPS


@pytest.mark.parametrize("partition", ("default", "columns"))
def test_coupled_unknowns(partition):
    """A scalar beside the displacement, coupled both ways, with conditions on either."""
    mesh, body = meshes.create(COMM, list(bodies("quadrilateral")), PARTITIONS[partition])
    at = (lambda x: np.isclose(x[1], GAP + 0.9 * curve(x[:2].T)), 0)
    other = (lambda x: np.isclose(x[1], curve(x[:2].T)), 1)
    tags = meshes.tag_facets(mesh, {SLAVE: at, MASTER: other}, body)
    V, Q = compat.vector_space(mesh, 1), compat.function_space(mesh, ("Lagrange", 1))
    u, q, w, v = fem.Function(V), fem.Function(Q), ufl.TestFunction(V), ufl.TestFunction(Q)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    F = [
        (ufl.inner(u, w) + q**2 * ufl.div(w)) * dx,
        (q * v + 3 * ufl.inner(u, u) * v) * dx,
    ]
    J = [[compat.form(a) for a in row] for row in derivative(F, [u, q])]
    bcs = []
    for space, value in ((V, np.full(2, 0.1)), (Q, 0.3)):
        left = fem.locate_dofs_geometrical(space, lambda x: x[0] < 0.1 + 1e-9)
        bcs.append(fem.dirichletbc(value, left, space))
    u.interpolate(lambda x: np.stack([0.1 * x[1], -0.9 * GAP + 0.2 * x[0] * x[1]]))
    q.interpolate(lambda x: 1 + x[0] * x[1])
    fem.set_bc(u.x.array, bcs[:1])
    fem.set_bc(q.x.array, bcs[1:])
    pair = dc.ContactPair(dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER))
    system = System([compat.form(f) for f in F], [u, q], J, [pair], bcs)
    pair._multiplier.x.array[:] = -1.0
    system.read()
    system.residual(system.x, system.b)
    system.create_matrix()
    pair._multiplier.x.array[:] = -1.0  # the scale of λ is known now
    system.read()
    system.residual(system.x, system.b)
    system.jacobian(system.x, system.A)
    numbering = Numbering(system)
    matrix = numbering.dense(system.A)
    expected = bulk_blocks(system, J, bcs)
    blocks = [numbering.block == i for i in range(3)]
    for i, j in ((0, 1), (1, 0), (1, 1)):
        part = np.ix_(blocks[i], blocks[j])
        assert np.abs(expected[part]).max() > 1e-3
        # the same numbers; ranks' sums may come in another order
        assert relative(matrix[part], expected[part]) < 4 * EPS
    assert not np.any(matrix[np.ix_(blocks[1], blocks[2])])
    assert np.any(matrix[np.ix_(blocks[0], blocks[2])])
    whole = numbering.gather(system.b)
    for i, f in enumerate(F):
        vector = fem.petsc.assemble_vector(compat.form(f))
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD_VALUES, mode=PETSc.ScatterMode.REVERSE)
        fem.petsc.set_bc(vector, [bcs[i]], scale=0.0)
        parts = np.concatenate(COMM.allgather(vector.array_r.copy()))
        dofs = system.layout.system_dofs(i, np.arange(len(parts), dtype=np.int64))
        value = whole[numbering.position[dofs]]
        if i == 1:  # contact adds nothing to it
            assert relative(value, parts) < 4 * EPS
        else:  # nodes away from the interfaces
            far = np.abs(numbering.points[numbering.position[dofs], 1]) > 0.3
            assert far.any() and relative(value[far], parts[far]) < 4 * EPS
