# SPDX-License-Identifier: MIT
"""Residual and matrix of contact, constructed independently of the package.

The construction reads the mesh from its input arrays. It finds targets by trying every facet,
writes (F1) and (F2) for each particle as they stand, and differentiates them by complex step:
through the equation that the target solves, the nodal normals and the area vectors of all facets
around them. It knows none of the explicit derivatives (F4')-(F8'), (F4c), (F9)-(F13) that the
package uses.

Equations: H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements, Revue
européenne des éléments finis 11 (2002), as restated in the mathematics page.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from operators import OBLIQUE, RHO, SCALE
from reference_facets import (
    CORNERS,
    EDGES,
    FACET,
    NODES,
    Facets,
    area_vector,
    dot,
    gauss,
    lattice,
    outside,
    shape_functions,
)
from two_bodies import DIM, GAP, bodies

STEP = 1e-30  # of the complex steps: its square is nothing, so that the derivatives are exact
SETTLED = 1e-13  # last step of ξ, in facets; it squares, so that the next one is round-off
INSIDE = 1e-8  # ξ counts as inside its facet up to this
END = 0.5  # overshoot of a physical end that is still clamped, in diameters
GRAZING = 0.1  # least |e·n_f| of a facet met along e


@dataclass
class Sample:
    """Points and master facets, in S samples.

    Attributes:
        f: number of the facet, or of each facet (S,)
        x: the points, (S, D)
        u: displacement of the facet's nodes, (S, nodes, D)
        nodal: normals n_A at its corners, (S, corners, D), where they are needed
    """

    f: int | np.ndarray
    x: np.ndarray
    u: np.ndarray
    nodal: np.ndarray | None

    def real(self):
        """The real part of the first sample."""
        nodal = None if self.nodal is None else self.nodal[:1].real
        return Sample(self.f, self.x[:1].real, self.u[:1].real, nodal)


class Construction:
    """Contact of a Case, from the arrays that the meshes were made of.

    Args:
        c: the Case; only its numbering of unknowns and its state are read
        cell, target: as given to it
        rule: points and weights on the reference facet, or None for Nodes
        crease, augmented, axisymmetric: options of the pair
        degree, geometry_degree, straight, counts: options of the model
        pressure_degree: of continuous pressures
    """

    def __init__(
        self,
        c,
        cell,
        target,
        rule,
        *,
        crease=60.0,
        augmented=False,
        axisymmetric=False,
        degree=1,
        geometry_degree=1,
        straight=False,
        counts=None,
        pressure_degree=1,
    ):
        self.shape, self.dim = FACET[cell], DIM[cell]
        self.x, self.augmented, self.comm = c.x, augmented, c.system.comm
        self.kind, self.normals = target.split("-")
        self.e = np.array(OBLIQUE[self.dim]) / np.linalg.norm(OBLIQUE[self.dim])
        slave, master = bodies(cell, geometry_degree, straight, counts)
        self.slave = Facets(slave, GAP, 0, degree, straight)
        self.master = Facets(master, 0.0, len(slave.cells), degree, straight)
        # component k of a node is the k-th unknown after the first of it: canonical order
        points, first = c.numbering.points[:, : self.dim], c.numbering.component == 0
        self.slave.number(nearest(self.slave.places, points, c.slave & first))
        self.master.number(nearest(self.master.places, points, c.master & first))
        at = self.slave.reference(NODES[self.shape, pressure_degree])[0]
        self.multiplier = nearest(at, points, c.multiplier)
        self.master.gather_stars(crease)
        self._particles(rule, axisymmetric, pressure_degree)
        self._search()
        self._statuses()

    def _values(self, nodes):
        """Values of nodes' unknowns, with the components last."""
        return self.x[nodes[..., None] + np.arange(self.dim)]

    def _particles(self, rule, axisymmetric, pressure_degree):
        points, weights = gauss(self.shape, 5) if rule is None else rule
        x, tau = self.slave.reference(points)
        weights = weights * np.linalg.norm(area_vector(tau), axis=-1)  # (facets, particles)
        if axisymmetric:
            weights = weights * 2 * np.pi * x[..., 0]
        if rule is None:  # ∫ N_a dΓ
            weights = weights @ shape_functions(self.shape, 1, points)[0]
            points = CORNERS[self.shape]
        self.weight, self.on = weights.ravel(), np.repeat(np.arange(len(x)), len(points))
        self.place = np.tile(points, (len(x), 1))
        self.N = shape_functions(self.shape, self.slave.degree, self.place)[0]
        self.psi = shape_functions(self.shape, pressure_degree, self.place)[0]

    # -- what a target solves -------------------------------------------------------------------

    def _pole(self, xi, nodal):
        """Direction m of the rule, (S or 1, D): none for (F4), e for (F5), n̄ for (F6)."""
        if self.kind == "smooth":
            return self.master.interpolated(xi, nodal)
        return (self.e if self.kind == "direction" else 0 * self.e)[None]

    def _equation(self, s, kind=None):
        """F with F(y) = 0 at the target of each Sample, and y's way to ξ.

        A free target: y = ξ and (F4), or y = (ξ, s) and (F5), (F6). A target on an edge: y = η
        and r·T_m τ_E = 0.

        Args:
            kind: the corners of the edge, or None where the target is free
        """
        q = self.dim - 1
        if kind is None:
            a, E = np.zeros(q), np.eye(q)
        else:
            a, E = CORNERS[self.shape][kind[0]], np.diff(CORNERS[self.shape][list(kind)], axis=0)
        free = kind is None and self.kind != "proximity"

        def to_xi(y):
            return a + y[:, : len(E)] @ E

        def equation(y):
            xi = to_xi(y)
            x2, tau = self.master.at(s.f, xi, s.u)
            m, r = self._pole(xi, s.nodal), s.x - x2
            if free:
                return r - y[:, -1:] * m
            tau = E @ tau
            tau = tau - dot(tau, m[:, None])[..., None] * m[:, None]
            return dot(r[:, None], tau)

        return equation, to_xi

    # -- targets by trying everything -----------------------------------------------------------

    def _search(self):
        """For each particle its facet, y, and the corners that hold it (None, two, one); or None."""
        master, edges, share = self.master, EDGES[self.shape], self._share()
        # every particle with every facet
        p, f = (v.ravel() for v in np.meshgrid(share, np.arange(len(master)), indexing="ij"))
        x, tau = self.slave.at(
            self.on[p], self.place[p], self._values(self.slave.nodes[self.on[p]])
        )
        areas = master.area_vectors(self._values(master.table)[None])
        nodal = np.concatenate([master.nodal_normals(g, areas) for g in range(len(master))])
        s = Sample(f, x, self._values(master.nodes)[f], nodal[f])
        outward = -self.slave.inward(self.on[p], tau)
        free = self._free(s, outward)
        held = [self._held(s, outward, edge) for edge in edges]
        # physical ends: edges that one facet has
        names = [[tuple(sorted(v[list(e)])) for e in edges] for v in master.vertices]
        flat = [name for row in names for name in row]
        end_vertices = {v for name in flat if flat.count(name) == 1 for v in name}
        corners = master.reference(CORNERS[self.shape])[0]
        reach = END * np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1).max((1, 2))

        def at_end(g, kind):
            vertices = {master.vertices[g][v] for v in kind}
            return flat.count(tuple(sorted(vertices))) == 1 or (
                len(vertices) == 1 and vertices < end_vertices
            )

        targets = []
        for first in range(0, len(f), len(master)):
            rows = range(first, first + len(master))
            choices = [(free[0][i], f[i], free[1][i], None) for i in rows]
            clamped = [
                (cost[i], f[i], y[i], kind[i], beside[i])
                for i in rows
                for cost, y, kind, beside in held
            ]
            if self.kind == "proximity":
                found = lowest(choices + clamped)
                if found and found[3] and at_end(*found[1::2]) and found[4] > reach[found[1]]:
                    found = None
            else:  # beside the surface: its nearest physical end, seen along m
                near = [
                    c for c, n in zip(clamped, flat) if flat.count(n) == 1 and c[4] <= reach[c[1]]
                ]
                found = lowest(choices) or lowest(near)
            targets.append(found and found[1:4])
        self.targets = [None] * len(self.on)
        for rank, part in enumerate(self.comm.allgather(targets)):
            self.targets[rank :: self.comm.size] = part

    def _nearest(self, s, points):
        """For each Sample that of some points (L, Q) on its facet which is nearest, seen along m:
        Newton has a short way from there. And the distance along m, (S, 1)."""
        count = len(points)
        f = np.repeat(np.arange(len(self.master)), count)
        u, xi = self._values(self.master.nodes)[f], np.tile(points, (len(self.master), 1))
        r = s.x[:, None] - self.master.at(f, xi, u)[0].reshape(-1, count, self.dim)[s.f]
        m = np.stack([self._pole(np.tile(p, (len(r), 1)), s.nodal) for p in points], axis=1)
        along = dot(r, m)
        best = np.linalg.norm(r - along[..., None] * m, axis=2).argmin(axis=1)
        return points[best], along[np.arange(len(r)), best][:, None]

    def _free(self, s, outward):
        """The free target of each Sample: cost (inf: none) and y."""
        q = self.dim - 1
        equation, _ = self._equation(s)
        xi, along = self._nearest(s, lattice(self.shape))
        y = xi if self.kind == "proximity" else np.column_stack([xi, along])
        for _ in range(15):
            F, J = equation(y), jacobian(equation, y)
            if self.kind == "proximity":  # convex part only, far from the surface
                tau = self.master.at(s.f, y, s.u)[1]
                metric, sign = -tau @ np.swapaxes(tau, 1, 2), (-1) ** q
                bad = sign * np.linalg.det(J) < 1e-3 * sign * np.linalg.det(metric)
                J = np.where(bad[:, None, None], metric, J)
            # far facets may have no such point
            step = np.clip(np.linalg.solve(J, F[..., None])[..., 0], -1, 1)
            y = y - step
            y[:, :q] = np.clip(y[:, :q], -2, 3)
            if np.abs(step).max() < SETTLED:
                break
        solved = np.abs(step).max(axis=1) < SETTLED
        xi = y[:, :q]
        x2, tau = self.master.at(s.f, xi, s.u)
        good = solved & (outside(self.shape, xi) < INSIDE) & self._faces(s, xi, tau, outward)
        if self.kind == "smooth":  # not beyond a focal point: det[τ_α + d ∂_α n̄, n̄] > 0
            sign = self.master.sigma[s.f] * (1 if q == 2 else -1)
            good &= sign * np.linalg.det(-jacobian(equation, y)) > 0
        distance = s.x - x2 if self.kind == "proximity" else y[:, -1:]
        return np.where(good, np.linalg.norm(distance, axis=1), np.inf), y

    def _held(self, s, outward, edge):
        """The target of each Sample on an edge of its facet: cost ‖T_m r‖ (inf: refused), y, the
        corners that hold it, and how far beside the target the particle is."""
        a, b = CORNERS[self.shape][edge[0]], CORNERS[self.shape][edge[-1]]
        eta = np.zeros((len(s.x), 1))
        if len(edge) == 2:
            equation, _ = self._equation(s, edge)
            xi, _ = self._nearest(s, a + np.linspace(0, 1, 9)[:, None] * (b - a))
            eta = ((xi - a) @ (b - a) / ((b - a) @ (b - a)))[:, None]
            for _ in range(15):
                step = np.clip(equation(eta) / jacobian(equation, eta)[:, 0], -0.5, 0.5)
                eta = np.clip(eta - step, -0.5, 1.5)
                if np.abs(step).max() < SETTLED:
                    break
            eta = np.clip(eta, 0, 1)
        xi = a + eta * (b - a)
        x2, tau = self.master.at(s.f, xi, s.u)
        r, m = s.x - x2, self._pole(xi, s.nodal)
        cost = np.linalg.norm(r - dot(r, m)[:, None] * m, axis=1)
        if self.kind == "proximity":
            m = self.master.inward(s.f, tau)
        beside = np.linalg.norm(r - dot(r, m)[:, None] * m, axis=1)
        kinds = [edge if 0 < t < 1 else (edge[int(t)],) for t in eta[:, 0]]
        return np.where(self._faces(s, xi, tau, outward), cost, np.inf), eta, kinds, beside

    def _faces(self, s, xi, tau, outward):
        """Whether the master faces the slave at ξ, and is not grazed by the direction."""
        if self.kind == "smooth":
            return dot(self.master.interpolated(xi, s.nodal), outward) >= 0
        n = self.master.inward(s.f, tau)
        grazed = self.kind == "direction" and np.abs(n @ self.e) < GRAZING
        return (dot(n, outward) >= 0) & ~np.asarray(grazed)

    # -- residual and matrix --------------------------------------------------------------------

    def _statuses(self):
        """χ(g_n) of each particle."""
        gaps = np.full(len(self.on), -np.inf)
        for p, target in enumerate(self.targets):
            if target:
                gaps[p] = self._terms(p, self._local(p)[1][None])[0][0]
        multiplier = SCALE * np.sum(self.psi * self.x[self.multiplier[self.on]], axis=1)
        self.closed = multiplier - RHO * gaps < 0

    def _local(self, p):
        """Unknowns of a particle and of the whole master, and their values: slave, λ/s, master."""
        nodes = [self.slave.nodes[self.on[p]], self.master.table]
        slave, master = ((n[:, None] + np.arange(self.dim)).ravel() for n in nodes)
        rows = np.concatenate([slave, self.multiplier[self.on[p]], master])
        return rows, self.x[rows]

    def _split(self, z):
        """Displacements of the slave's nodes, λ/s, displacements of the master's nodes."""
        n, k = self.slave.nodes.shape[1] * self.dim, self.multiplier.shape[1]
        shape = len(z), -1, self.dim
        return z[:, :n].reshape(shape), z[:, n : n + k], z[:, n + k :].reshape(shape)

    def _terms(self, p, z):
        """Gap, normal, and the values of the master's facet at the target, for samples z."""
        f, y, kind = self.targets[p]
        slave, _, master = self._split(z)
        x = self.slave.at(self.on[p], np.repeat(self.place[p][None], len(z), axis=0), slave)[0]
        nodal = None
        if self.normals == "interpolated":
            nodal = self.master.nodal_normals(f, self.master.area_vectors(master))
        s = Sample(f, x, master[:, self.master.local[f]], nodal)
        if kind is not None and len(kind) == 1:
            xi = np.repeat(CORNERS[self.shape][kind[0]][None], len(z), axis=0).astype(z.dtype)
        else:
            equation, to_xi = self._equation(s, kind)
            at, _ = self._equation(s.real(), kind)
            # samples differ by steps whose squares are nothing: one matrix serves them all
            J = np.linalg.inv(jacobian(at, y[None])[0])
            y = np.repeat(y[None], len(z), axis=0).astype(z.dtype)
            for _ in range(3):
                y = y - equation(y) @ J.T
            xi = to_xi(y)
        x2, tau = self.master.at(f, xi, s.u)
        n = self.master.inward(f, tau)
        if self.normals == "direction":
            n = np.sign(dot(n, self.e).real)[:, None] * self.e + 0 * n
        elif self.normals == "interpolated":
            n = self.master.interpolated(xi, nodal)
        return dot(x - x2, n), n, shape_functions(self.shape, self.master.degree, xi)[0]

    def _particle(self, p, z):
        """(F1), (F2) of one particle for samples z; rows as in _local."""
        w, N, psi = self.weight[p], self.N[p], self.psi[p]
        lam = SCALE * self._split(z)[1] @ psi
        out = np.zeros_like(z)
        slave, multiplier, master = self._split(out)  # views
        if not self.closed[p]:
            multiplier[:] = -w * SCALE / RHO * lam[:, None] * psi
            return out
        gap, n, M = self._terms(p, z)
        t = (lam - RHO * gap if self.augmented else lam)[:, None] * n
        slave[:] = -w * N[:, None] * t[:, None]
        multiplier[:] = -w * SCALE * gap[:, None] * psi
        master[:, self.master.local[self.targets[p][0]]] = w * M[..., None] * t[:, None]
        return out

    def residual(self):
        out = np.zeros(len(self.x))
        for p in self._share():
            rows, z = self._local(p)
            np.add.at(out, rows, self._particle(p, z[None])[0])
        return self.comm.allreduce(out)

    def matrix(self):
        """By complex step: exact to round-off."""
        out = np.zeros((len(self.x),) * 2)
        for p in self._share():
            rows, z = self._local(p)
            steps = self._particle(p, z + 1j * STEP * np.eye(len(z)))
            np.add.at(out, (rows[:, None], rows[None, :]), steps.imag.T / STEP)
        return self.comm.allreduce(out)

    def _share(self):
        """This rank's part of the work, only to save time: all ranks know all particles."""
        return range(self.comm.rank, len(self.on), self.comm.size)


def jacobian(equation, y):
    """∂F_i/∂y_j at real y (S, m), by complex step; (S, m, m)."""
    columns = [equation(y + 1j * STEP * e).imag / STEP for e in np.eye(y.shape[1])]
    return np.stack(columns, axis=-1)


def lowest(choices):
    """The choice of least cost; ties go to the lowest facet, and there to the first."""
    least = min((choice[0] for choice in choices), default=np.inf)
    if not np.isfinite(least):
        return None
    return min((c for c in choices if c[0] <= least + 1e-10), key=lambda c: c[1])


def nearest(X, points, which):
    """Number of the unknown at each position."""
    numbers = np.flatnonzero(which)
    distance = np.linalg.norm(X[..., None, :] - points[numbers], axis=-1)
    assert distance.min(axis=-1).max() < 1e-12
    return numbers[distance.argmin(axis=-1)]
