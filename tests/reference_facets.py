# SPDX-License-Identifier: MIT
"""Facets of a surface for the independent construction of contact: shape functions of degree 1 and
2 and rules, written out, positions, and normals. Nodes are in an order of this file's own.

Equations: H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements, Revue
européenne des éléments finis 11 (2002), as restated in the mathematics page.
"""

from __future__ import annotations

import basix
import numpy as np
from two_bodies import curve

FACET = {"triangle": "interval", "quadrilateral": "interval"}
FACET |= {"tetrahedron": "triangle", "hexahedron": "quadrilateral"}
CORNERS = {
    "interval": np.array([[0.0], [1.0]]),
    "triangle": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "quadrilateral": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
}
EDGES = {
    "interval": ((0,), (1,)),
    "triangle": ((0, 1), (0, 2), (1, 2)),
    "quadrilateral": ((0, 1), (0, 2), (1, 3), (2, 3)),
}

# nodes of a tensor product, as pairs of an interval's nodes 0, 1 and, between them, 2
PAIRS = {1: [(0, 0), (1, 0), (0, 1), (1, 1)]}
PAIRS[2] = PAIRS[1] + [(2, 0), (0, 2), (1, 2), (2, 1), (2, 2)]

_middles = [(CORNERS["triangle"][a] + CORNERS["triangle"][b]) / 2 for a, b in EDGES["triangle"]]
_line = np.array([0.0, 1.0, 0.5])
NODES = {(shape, 1): corners for shape, corners in CORNERS.items()}
NODES["interval", 2] = _line[:, None]
NODES["triangle", 2] = np.vstack([CORNERS["triangle"], _middles])
NODES["quadrilateral", 2] = _line[np.array(PAIRS[2])]


def shape_functions(shape, degree, xi):
    """Values (..., n) and derivatives (..., Q, n) at ξ (..., Q), real or complex."""
    if shape == "triangle":
        N, first = _triangle(degree, xi)
    elif shape == "interval":
        N, dN = _interval(degree, xi[..., 0])
        first = [dN]
    else:
        (A, dA), (B, dB) = (_interval(degree, xi[..., i]) for i in range(2))
        N = [A[i] * B[j] for i, j in PAIRS[degree]]
        first = [
            [dA[i] * B[j] for i, j in PAIRS[degree]],
            [A[i] * dB[j] for i, j in PAIRS[degree]],
        ]
    return np.moveaxis(np.array(N), 0, -1), np.moveaxis(np.array(first), (0, 1), (-2, -1))


def _interval(degree, a):
    if degree == 1:
        return [1 - a, a], [0 * a - 1, 0 * a + 1]
    return (
        [(1 - a) * (1 - 2 * a), a * (2 * a - 1), 4 * a * (1 - a)],
        [4 * a - 3, 4 * a - 1, 4 - 8 * a],
    )


def _triangle(degree, xi):
    a, b = xi[..., 0], xi[..., 1]
    zero, one = 0 * a, 0 * a + 1
    L = [1 - a - b, a, b]
    dL = [[-one, one, zero], [-one, zero, one]]
    if degree == 1:
        return L, dL
    edges = EDGES["triangle"]
    N = [v * (2 * v - 1) for v in L] + [4 * L[i] * L[j] for i, j in edges]
    first = [
        [(4 * v - 1) * dv for v, dv in zip(L, d)]
        + [4 * (L[i] * d[j] + L[j] * d[i]) for i, j in edges]
        for d in dL
    ]
    return N, first


def outside(shape, xi):
    """How far ξ (..., Q) is outside the facet, ≤ 0 inside."""
    out = np.maximum(-xi, xi - 1).max(axis=-1)
    return np.maximum(out, xi.sum(axis=-1) - 1) if shape == "triangle" else out


def lattice(shape):
    """Points all over the facet, 8 intervals in each direction."""
    line = np.linspace(0, 1, 9)
    if shape == "interval":
        return line[:, None]
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return points[outside(shape, points) <= 1e-12]


# -- vectors ------------------------------------------------------------------------------------------


def area_vector(tau):
    """τ_1 × τ_2; in 2D (τ_y, −τ_x). τ: (..., Q, D)."""
    if tau.shape[-1] == 2:
        return np.stack([tau[..., 0, 1], -tau[..., 0, 0]], axis=-1)
    return np.cross(tau[..., 0, :], tau[..., 1, :])


def dot(a, b):
    """a·b without conjugation, for complex steps."""
    return np.sum(a * b, axis=-1)


def normalised(v):
    """v/‖v‖, for complex steps."""
    return v / np.sqrt(dot(v, v))[..., None]


# -- rules --------------------------------------------------------------------------------------------

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
    """Points and weights, for n up to 2."""
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
    weight = {}
    for t in triangles:
        points = [*t, *((t + np.roll(t, 1, axis=0)) / 2), t.mean(axis=0)]
        for point, w in zip(points, [1 / 20] * 3 + [2 / 15] * 3 + [9 / 20]):
            key = tuple(np.round(48 * point))  # all are at multiples of 1/48
            weight[key] = weight.get(key, 0) + w * 0.5 / len(triangles)
    return np.array(list(weight)) / 48, np.array(list(weight.values()))


def tensor(shape, x, w):
    if shape == "interval":
        return x[:, None], w
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    return points, np.outer(w, w).ravel()


def gauss(shape, points):
    """Gauss points, exact for degree 2 points − 1; on triangles a symmetric rule of Basix."""
    if shape == "triangle":
        return basix.make_quadrature(basix.CellType.triangle, 2 * points - 1)
    x, w = np.polynomial.legendre.leggauss(points)
    return tensor(shape, (x + 1) / 2, w / 2)


# -- surfaces ----------------------------------------------------------------------------------------


class Facets:
    """Facets of a body at the height of its interface, in the order of their cells' numbers.

    Args:
        body: as the mesh was made of
        height: of the interface before the mapping
        first_cell: number of the body's first cell in the mesh
        degree: of the displacement
        straight: whether the body is not mapped

    Attributes:
        X: geometry nodes, (n, nodes, D)
        places: reference positions of the displacement's nodes, (n, nodes, D)
        sigma: +1 where the area vector points into the body, (n,)
        cell: number of the cell, (n,)
        vertices: numbers of the corners in the body, (n, corners)
    """

    def __init__(self, body, height, first_cell, degree, straight):
        kind, points = getattr(basix.CellType, body.cell), body.points
        self.shape, self.degree, self.geometry_degree = FACET[body.cell], degree, body.degree
        self.dim = points.shape[1]
        corners = basix.geometry(kind)
        element = basix.create_element(basix.ElementFamily.P, kind, body.degree)
        on = np.isclose(points[:, -1], height + (0 if straight else curve(points) * (1 - height)))
        found = []
        for number, cell in enumerate(body.cells):
            for local in basix.topology(kind)[self.dim - 1]:
                if not on[cell[local]].all():
                    continue
                edges = corners[local[1 : self.dim]] - corners[local[0]]
                wanted = corners[local[0]] + NODES[self.shape, body.degree] @ edges
                at = [np.abs(element.points - w).sum(axis=1).argmin() for w in wanted]
                middle = points[cell].mean(axis=0)
                found.append((first_cell + number, cell[local], points[cell[at]], middle))
        found.sort(key=lambda facet: facet[0])
        self.cell, self.vertices, self.X, middles = (np.array(column) for column in zip(*found))
        self.places = self.reference(NODES[self.shape, degree])[0]
        x, tau = self.reference(CORNERS[self.shape].mean(axis=0)[None])
        self.sigma = np.sign(dot(area_vector(tau[:, 0]), middles - x[:, 0]))

    def __len__(self):
        return len(self.X)

    def reference(self, xi):
        """Reference positions and tangents at ξ (points, Q) on all facets."""
        N, first = shape_functions(self.shape, self.geometry_degree, xi)
        return np.einsum("pn,fnd->fpd", N, self.X), np.einsum("pqn,fnd->fpqd", first, self.X)

    def number(self, unknowns):
        """Give each displacement node its first unknown, (n, nodes)."""
        self.nodes = unknowns
        self.table, local = np.unique(unknowns, return_inverse=True)
        self.local = local.reshape(unknowns.shape)

    def at(self, f, xi, u):
        """Current positions (S, D) and tangents (S, Q, D) of facet f, or facets (S,), at ξ (S, Q).

        Args:
            u: displacement of its nodes, (S or 1, nodes, D)
        """
        M, second = N, first = shape_functions(self.shape, self.geometry_degree, xi)
        if self.degree != self.geometry_degree:
            M, second = shape_functions(self.shape, self.degree, xi)
        return (N[:, None] @ self.X[f] + M[:, None] @ u)[:, 0], first @ self.X[f] + second @ u

    # -- normals --------------------------------------------------------------------------------

    def gather_stars(self, crease):
        """The facets that are averaged at each corner of each facet: those around the vertex whose
        area vector makes no more than the crease angle with the facet's, in the reference."""
        n = normalised(self.area_vectors(np.zeros((1, len(self.table), self.dim)))[0])
        smooth = n @ n.T >= np.cos(np.deg2rad(crease)) - 1e-12
        self.stars = [
            [np.flatnonzero((self.vertices == v).any(axis=1) & smooth[f]) for v in row]
            for f, row in enumerate(self.vertices)
        ]

    def area_vectors(self, u):
        """S_f = σ_f ∫ τ_1 × τ_2 dξ of all facets, (S, n, D), for nodal values u (S, table, D)."""
        points, weights = gauss(self.shape, 4)  # the integrand has degree 3 in each ξ
        first = shape_functions(self.shape, self.geometry_degree, points)[1]
        second = shape_functions(self.shape, self.degree, points)[1]
        tau = np.einsum("pqn,fnd->fpqd", first, self.X)
        tau = tau + np.einsum("pqn,sfnd->sfpqd", second, u[:, self.local])
        return self.sigma[:, None] * np.einsum("p,sfpd->sfd", weights, area_vector(tau))

    def nodal_normals(self, f, areas):
        """n_A at the corners of facet f, (S, corners, D), from the area vectors (S, n, D) (F8)."""
        nodal = [areas[:, star].sum(axis=1) for star in self.stars[f]]
        return normalised(np.stack(nodal, axis=1))

    def interpolated(self, xi, nodal):
        """n̄ at ξ (S, Q), (F8), from the n_A (S or 1, corners, D)."""
        N = shape_functions(self.shape, 1, xi)[0]
        return normalised((N[:, None] @ nodal)[:, 0])

    def inward(self, f, tau):
        """Unit normal into the body of facet f, or facets (S,), with tangents τ (S, Q, D) (F7)."""
        return np.reshape(self.sigma[f], (-1, 1)) * normalised(area_vector(tau))
