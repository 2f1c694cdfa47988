# SPDX-License-Identifier: MIT
"""Cells and facets on which nothing can be computed: nodes that are not finite, cells without volume,
twisted or folded over, facets without area.

DOLFINx takes |det J| of simplices, so that a mesh that is folded over gives results, which mean nothing.
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import numpy.typing as npt

from . import compat
from .errors import InputError
from .surface import _element, facet_closure

_TINY = 1e-12  # a measure below this part of the cell's size to its power is none


def check_cells(mesh: Any) -> None:
    """Look at all of this rank's cells.

    Raises:
        InputError: with the place of the worst cell
    """
    cell, degree, dim = (
        mesh.topology.cell_name(),
        compat.coordinate_degree(mesh),
        mesh.geometry.dim,
    )
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
    if cell in ("triangle", "tetrahedron"):
        _check_folds(mesh, cell, points, size)


def _places(cell: str, degree: int) -> npt.NDArray[np.float64]:
    """Where the Jacobian is looked at: at the nodes, where it takes its extremes or nearly so."""
    if cell in ("triangle", "tetrahedron") and degree == 1:
        return basix.geometry(getattr(basix.CellType, cell))[:1]  # it is constant
    return np.array(_element(cell, degree).points)


def _check_folds(mesh: Any, cell: str, points: Any, size: Any) -> None:
    """Two simplices with a common facet lie on both sides of it."""
    links, offsets = compat._connectivity(mesh, mesh.topology.dim - 1, mesh.topology.dim)
    facets = np.flatnonzero(np.diff(offsets) == 2).astype(np.int32)
    first, second = links[offsets[facets]], links[offsets[facets] + 1]
    local = [compat.local_facet_indices(mesh, cells, facets) for cells in (first, second)]
    corners = points[:, : points.shape[2] + 1]
    on_facet = corners[first[:, None], facet_closure(cell, 1)[local[0]]]
    edges = on_facet[:, 1:] - on_facet[:, :1]
    sides = []
    for cells, opposite in zip((first, second), local):  # facet i is opposite to corner i
        to = corners[cells, opposite] - on_facet[:, 0]
        sides.append(np.linalg.det(np.concatenate([edges, to[:, None]], axis=1)))
    bound = _TINY * np.minimum(size[first], size[second]) ** points.shape[2]
    folded = np.sign(sides[0]) * np.minimum(*np.abs(sides)) * np.sign(sides[1]) > bound
    _refuse(
        folded,
        points[first],
        "lie on the same side of a neighbour's facet",
        "make the mesh anew, or move their nodes",
    )


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
