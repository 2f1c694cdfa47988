# SPDX-License-Identifier: MIT
"""How the slave's area has changed: nominal pressures refer to the reference area, true ones to the
current one."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .rules import basis_values


def area_stretch(pair: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Current over reference area at points of the reference facet, of the last accepted solution.

    Args:
        pair: that has been solved; of an axisymmetric one areas have a factor 2πr
        points: (points, dim − 1)

    Returns:
        (own cells of slave.mesh, points)
    """
    slave = pair.slave
    rows = slave.facet_mesh_cells
    places = slave.X[rows], pair._solved()["slave"][rows]
    N, gradient = _position_basis(slave.reference["position"], points)
    old, new = (_area(np.einsum("pak,fai->fpki", gradient, x)) for x in places)
    if not pair.axisymmetric:
        return new / old
    R, r = (x[:, :, 0] @ N.T for x in places)
    # at the axis the ring is stretched as the meridian is
    ring = np.divide(r, R, out=new / old, where=R > 1e-12 * np.abs(slave.X).max(initial=1e-300))
    return ring * new / old


def _position_basis(basis: Any, points: npt.NDArray[np.float64]) -> tuple[Any, Any]:
    """Values (points, nodes) and derivatives (points, nodes, dim − 1) of the position's basis."""
    powers, coefficients = np.asarray(basis["powers"]), np.asarray(basis["coefficients"])
    gradient = []
    for k in range(points.shape[1]):
        lower = powers.copy()
        lower[:, k] = np.maximum(lower[:, k] - 1, 0)
        monomials = np.prod(points[:, None, :] ** lower[None], axis=2) * powers[:, k]
        gradient.append(monomials @ coefficients.T)
    return basis_values((powers, coefficients, None), points), np.stack(gradient, axis=2)


def _area(tangents: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Area of an element of the reference facet with tangents (…, dim − 1, dim)."""
    if tangents.shape[-2] == 1:
        return np.linalg.norm(tangents[..., 0, :], axis=-1)
    return np.linalg.norm(np.cross(tangents[..., 0, :], tangents[..., 1, :]), axis=-1)
