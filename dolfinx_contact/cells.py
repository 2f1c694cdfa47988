# SPDX-License-Identifier: MIT
"""Cells and facets on which nothing can be computed: nodes that are not finite, cells without volume,
twisted or folded over, facets without area.

DOLFINx takes |det J|, so that a mesh that is folded over gives results, which mean nothing.
"""

from __future__ import annotations

import zlib
from typing import Any

import basix
import numpy as np
import numpy.typing as npt

from . import compat
from .errors import InputError
from .surface import _element, _facet_corners

_TINY = 1e-12  # a measure below this part of the cell's size to its power is none


def check_cells(mesh: Any) -> None:
    """Look at all of this rank's cells, once for each place of the nodes. The facets of the cells, and the
    cells of the facets, are known already.

    Raises:
        InputError: with the place of the worst cell
    """
    places = zlib.crc32(np.ascontiguousarray(mesh.geometry.x))
    if getattr(mesh, "_contact_places", None) != places:
        _check(mesh)
        mesh._contact_places = places


def _check(mesh: Any) -> None:
    cell, dim = mesh.topology.cell_name(), mesh.geometry.dim
    degree = compat.coordinate_degree(mesh)
    dofs = compat.cell_geometry_dofs(mesh)
    x = np.asarray(mesh.geometry.x)[:, :dim]
    used = np.unique(dofs)
    with np.errstate(over="ignore"):
        finite = np.isfinite(np.sum(x[used] ** 2, axis=1))
    if not finite.all():
        raise InputError(
            f"{np.sum(~finite)} nodes of the mesh have coordinates that are not finite, or too large to be"
            f" squared, one of them {x[used][~finite][0].tolist()}; make the mesh anew, or move the nodes."
        )
    if len(dofs) == 0 or mesh.topology.dim != dim:
        return
    points = x[dofs]
    size = np.linalg.norm(np.ptp(points, axis=1), axis=1)
    gradients = np.array(_element(cell, degree).tabulate(1, _places(cell, degree))[1:, :, :, 0])
    low, high = np.full(len(dofs), np.inf), np.full(len(dofs), -np.inf)
    for at in range(gradients.shape[1]):
        det = np.linalg.det(np.einsum("cai,ja->cij", points, gradients[:, at]))
        low, high = np.minimum(low, det), np.maximum(high, det)
    tiny = _TINY * size**dim
    flat = np.maximum(-low, high) <= tiny
    _refuse(flat, points, "have no volume", "remove them, or move their nodes apart")
    turned = (low < -tiny) & (high > tiny)
    _refuse(
        turned,
        points,
        "are turned inside out in a part of them",
        "make the mesh anew, or move their nodes",
    )
    _check_folds(mesh, cell, degree, points, size)


def _places(cell: str, degree: int) -> npt.NDArray[np.float64]:
    """Where the Jacobian is looked at: at the nodes, where it takes its extremes or nearly so."""
    if cell in ("triangle", "tetrahedron") and degree == 1:
        return basix.geometry(getattr(basix.CellType, cell))[:1]  # it is constant
    return np.array(_element(cell, degree).points)


def _check_folds(mesh: Any, cell: str, degree: int, points: Any, size: Any) -> None:
    """Two cells with a common facet lie on both sides of it. Those of two ranks are not compared.

    At the facet's midpoint, with its tangents τ_k and the ways J(−N_ref) into both cells, the
    determinants of (τ_1, τ_2, way) have different signs.
    """
    links, offsets = compat._connectivity(mesh, mesh.topology.dim - 1, mesh.topology.dim)
    facets = np.flatnonzero(np.diff(offsets) == 2).astype(np.int32)
    if len(facets) == 0:
        return
    pair = links[offsets[facets]], links[offsets[facets] + 1]
    local = [compat.local_facet_indices(mesh, cells, facets) for cells in pair]
    corners = _facet_corners(cell)
    middles = corners.mean(axis=1)
    gradients = np.array(_element(cell, degree).tabulate(1, middles)[1:, :, :, 0])
    edges = corners[:, 1 : points.shape[2]] - corners[:, :1]
    inward = -np.asarray(basix.cell.facet_outward_normals(getattr(basix.CellType, cell)))
    J = [
        np.einsum("fai,jfa->fij", points[cells], gradients[:, at])
        for cells, at in zip(pair, local)
    ]
    tangents = np.einsum("fij,fkj->fki", J[0], edges[local[0]])
    sides = []
    for matrix, at in zip(J, local):
        way = np.einsum("fij,fj->fi", matrix, inward[at])
        sides.append(np.linalg.det(np.concatenate([tangents, way[:, None]], axis=1)))
    tiny = _TINY * np.minimum(size[pair[0]], size[pair[1]]) ** points.shape[2]
    folded = (np.sign(sides[0]) == np.sign(sides[1])) & (np.minimum(*np.abs(sides)) > tiny)
    fault = "lie on the same side of a neighbour's facet"
    _refuse(folded, points[pair[0]], fault, "make the mesh anew, or move their nodes")


def check_facets(
    X: npt.NDArray[np.float64], corners: int, size: npt.NDArray[np.float64], tags: Any
) -> None:
    """Look at a surface's own facets.

    Args:
        X: nodes of the facets, corners first, (n, nodes, dim)
        corners: number of corners of a facet
        size: of the facets' cells [length], (n,)
        tags: of the surface, for the message

    Raises:
        InputError: a facet whose tangents are dependent at a corner
    """
    what = f"facets with tags {tags}"
    bad = ~np.isfinite(X).all(axis=(1, 2))
    if bad.any():
        raise InputError(
            f"Surface: {bad.sum()} {what} have nodes that are not finite; make the mesh anew, or move"
            " the nodes."
        )
    x = X[:, :corners]
    if X.shape[2] == 2:
        measures = np.linalg.norm(x[:, 1:] - x[:, :1], axis=2)
    else:
        # neighbours of each corner, in Basix's order
        near = {3: ((1, 2), (0, 2), (0, 1)), 4: ((1, 2), (0, 3), (0, 3), (1, 2))}[x.shape[1]]
        sides = [x[:, list(pair)] - x[:, i : i + 1] for i, pair in enumerate(near)]
        measures = np.stack([np.linalg.norm(np.cross(s[:, 0], s[:, 1]), axis=1) for s in sides], 1)
    bad = measures.min(axis=1, initial=np.inf) <= _TINY * size ** (X.shape[2] - 1)
    _refuse(
        bad,
        x,
        "have no area",
        "take them out of the surface, or move their nodes",
        f"Surface: {{}} {what}",
    )


def _refuse(
    bad: npt.NDArray[np.bool_],
    points: Any,
    fault: str,
    mend: str,
    what: str = "{} cells of the mesh",
) -> None:
    if bad.any():
        place = np.array2string(points[np.argmax(bad)].mean(axis=0), precision=4)
        raise InputError(f"{what.format(bad.sum())} {fault}, one around {place}; {mend}.")
