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


def excluded(pair: Any, function: Any, degree: int, nodes: int) -> npt.NDArray[np.bool_]:
    """Local multipliers on nodes of the facets that the user excludes. Collective.

    A node counts if it lies on such a facet; constants of a facet (degree 0) if all its corners do.

    Args:
        function: multipliers, on the slave's mesh
        degree: of its space
        nodes: number of nodes of a facet

    Returns:
        (local unrolled dofs, ghosts included)
    """
    if pair.exclude is None:
        return np.zeros(len(function.x.array), dtype=bool)
    facet_tags, tags = pair.exclude
    mesh = pair.slave.u.function_space.mesh
    constants, degree = degree == 0, max(1, degree)
    W = compat.function_space(mesh, ("Lagrange", degree))
    mark = fem.Function(W)
    facets = np.asarray(facet_tags.indices)[np.isin(np.asarray(facet_tags.values), tags)]
    mark.x.array[fem.locate_dofs_topological(W, mesh.topology.dim - 1, facets)] = 1.0
    mark.x.scatter_forward()

    slave = pair.slave
    closure = facet_closure(mesh.topology.cell_name(), degree)[slave.local_facets]
    on_node = mark.x.array[compat.dof_list(W)[slave.cells[:, None], closure]] > 0.5
    if constants:
        on_node = on_node.all(axis=1, keepdims=True)
    size = function.function_space.dofmap.index_map_bs
    on_node = np.repeat(on_node[:, :, None], size, axis=2)
    return agreed(function, local_dofs(pair, function, nodes), on_node, any_facet=True)


def local_dofs(pair: Any, function: Any, nodes: int) -> npt.NDArray[np.int32]:
    """Local nodes of a Function on the slave's mesh, of each slave facet in its order.

    Returns:
        (facets, nodes of the facet)
    """
    cells = pair.slave.facet_mesh_cells
    dofs = np.zeros((len(pair.slave.id), nodes), dtype=np.int32)
    dofs[cells] = compat.dof_list(function.function_space)[: len(cells)]
    return dofs


def agreed(
    function: Any,
    dofs: npt.NDArray[np.int32],
    on_facets: npt.NDArray[np.bool_],
    any_facet: bool,
) -> npt.NDArray[np.bool_]:
    """What the facets around each node say, on all ranks. Collective.

    Args:
        function: of the space, on the slave's mesh
        dofs: local nodes of each facet, (facets, nodes)
        on_facets: each own facet's word on its nodes, (facets, nodes), or (facets, nodes, block
            size) for each component
        any_facet: True if one facet's yes is enough, False if all must say it

    Returns:
        (local unrolled dofs, ghosts included)
    """
    votes = fem.Function(function.function_space)
    said = on_facets if any_facet else ~on_facets
    size = votes.function_space.dofmap.index_map_bs
    table = votes.x.array.reshape(-1, size)
    np.maximum.at(table, dofs, said.reshape(*dofs.shape, size).astype(float))
    compat.scatter_reverse_add(votes)
    votes.x.scatter_forward()
    return (votes.x.array > 0.5) == any_facet
