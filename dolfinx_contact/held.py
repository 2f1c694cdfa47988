# SPDX-License-Identifier: MIT
"""Multipliers that are held at zero: those the user excludes, and those without a free gap.

A multiplier whose gap no free displacement can change would make the system singular: its column in
(F1) and its row (F2) in contact are null.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .surface import facet_closure


def excluded(pair: Any) -> npt.NDArray[np.bool_]:
    """Local multipliers on nodes of the facets that the user excludes. Collective.

    A node counts if it lies on such a facet; constants of a facet (degree 0) if all its corners do.

    Returns:
        (local multipliers, ghosts included)
    """
    if pair.exclude is None:
        return np.zeros(len(pair._multiplier.x.array), dtype=bool)
    facet_tags, tags = pair.exclude
    mesh = pair.slave.u.function_space.mesh
    degree = max(1, int(pair.pressure_space[1]))
    W = compat.function_space(mesh, ("Lagrange", degree))
    mark = fem.Function(W)
    facets = np.asarray(facet_tags.indices)[np.isin(np.asarray(facet_tags.values), tags)]
    mark.x.array[fem.locate_dofs_topological(W, mesh.topology.dim - 1, facets)] = 1.0
    mark.x.scatter_forward()

    slave = pair.slave
    closure = facet_closure(mesh.topology.cell_name(), degree)[slave.local_facets]
    on_node = mark.x.array[compat.dof_list(W)[slave.cells[:, None], closure]] > 0.5
    if int(pair.pressure_space[1]) == 0:
        on_node = on_node.all(axis=1, keepdims=True)
    return agreed(pair, on_node, any_facet=True)


def multiplier_dofs(pair: Any) -> npt.NDArray[np.int32]:
    """Local multipliers of each slave facet, in the facet's order; (facets, nodes of ψ)."""
    cells = pair.slave.facet_mesh_cells
    dofs = np.zeros((len(pair.slave.id), len(pair._psi[2])), dtype=np.int32)
    dofs[cells] = compat.dof_list(pair._multiplier.function_space)[: len(cells)]
    return dofs


def agreed(pair: Any, on_facets: npt.NDArray[np.bool_], any_facet: bool) -> npt.NDArray[np.bool_]:
    """What the facets around each multiplier say, on all ranks. Collective.

    Args:
        on_facets: each own facet's word on its multipliers, (facets, nodes of ψ)
        any_facet: True if one facet's yes is enough, False if all must say it

    Returns:
        (local multipliers, ghosts included)
    """
    votes = fem.Function(pair._multiplier.function_space)
    said = on_facets if any_facet else ~on_facets
    np.maximum.at(votes.x.array, multiplier_dofs(pair), said.astype(float))
    compat.scatter_reverse_add(votes)
    votes.x.scatter_forward()
    return (votes.x.array > 0.5) == any_facet
