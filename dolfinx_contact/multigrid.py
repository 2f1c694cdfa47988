# SPDX-License-Identifier: MIT
"""The first coarse level of smoothed aggregation for displacements of several bodies.

P. Vaněk, J. Mandel and M. Brezina, Algebraic multigrid by smoothed aggregation for second and fourth
order elliptic problems, Computing 56 (1996): nodes are gathered in aggregates, on each of which the
rigid motions are the coarse unknowns; the prolongation P₀ is then smoothed once,

    P = (I − ω D⁻¹ A) P₀,   D = diag A,  ω = 4/(3 λ_max(D⁻¹ A))

Aggregates follow the meshes of the bodies, so that none has nodes of two bodies, whatever touches:
the rigid motions of each body are in the range of P₀. The columns of a mesh node's dofs that
Dirichlet conditions hold are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_matrix, diags

from . import compat

# neighbours farther away than so many times the nearest one are not strong
_FAR = 3.0


def aggregates(x: npt.NDArray[np.float64], cells: npt.NDArray[Any], free: Any) -> Any:
    """Aggregate of each node, −1 for those left out, and the number of aggregates.

    Roots are a maximal set of nodes with no common neighbour; each takes its neighbours, and what is
    left joins a neighbour's aggregate.

    Args:
        x: positions of the nodes, (n, dim)
        cells: nodes of each cell; those of n and above are not of this rank
        free: whether each node takes part, (n,)
    """
    n = len(x)
    G = _graph(x, cells, free)
    rng = np.random.default_rng(1)
    weight = rng.permutation(n) + 1
    state = np.where(free, 0, -1)  # 0: undecided, 1: root, −1: not
    while np.any(state == 0):
        candidate = np.where(state == 0, weight, 0)
        candidate[state == 1] = n + 1
        largest = _largest(G, _largest(G, candidate))
        new = (state == 0) & (largest == weight)
        state[(state == 0) & (largest == n + 1)] = -1
        state[new] = 1
    roots = np.flatnonzero(state == 1)
    number = np.zeros(n, dtype=np.int64)
    number[roots] = np.arange(1, len(roots) + 1)
    for _ in range(2):
        number = np.where(number == 0, _largest(G, number), number)
    return number - 1, len(roots)


def _graph(x: npt.NDArray[np.float64], cells: npt.NDArray[Any], free: Any) -> Any:
    """Which nodes are strongly connected, themselves included: by a cell, and near each other."""
    n, width = len(x), cells.shape[1]
    rows = np.repeat(np.arange(len(cells)), width)
    inside = cells.ravel() < n
    ones = np.ones(int(inside.sum()), dtype=np.int8)
    C = csr_matrix((ones, (rows[inside], cells.ravel()[inside])), shape=(len(cells), n))
    G = (C.T @ C).tocsr()
    row = np.repeat(np.arange(n, dtype=np.int32), np.diff(G.indptr))
    distance = np.linalg.norm(x[row] - x[G.indices], axis=1)
    distance[row == G.indices] = np.inf
    nearest = np.minimum.reduceat(np.append(distance, np.inf), G.indptr[:-1])
    keep = (distance <= _FAR * np.maximum(nearest[row], nearest[G.indices])) | (row == G.indices)
    keep &= (free[row] & free[G.indices]) | (row == G.indices)
    pattern = csr_matrix((np.ones(int(keep.sum()), dtype=np.int8), G.indices[keep],
                          np.concatenate([[0], np.cumsum(keep)])[G.indptr]), shape=(n, n))
    return pattern


def _largest(G: Any, values: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The largest value among each node's neighbours and itself."""
    return np.maximum.reduceat(values[G.indices], G.indptr[:-1])


def rigid_modes(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rigid motions at points; (n, dim, modes), modes 3 in 2D and 6 in 3D."""
    n, dim = x.shape
    planes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((n, dim, dim + len(planes)))
    modes[:, np.arange(dim), np.arange(dim)] = 1
    for k, (i, j) in enumerate(planes):
        modes[:, i, dim + k] = -x[:, j]
        modes[:, j, dim + k] = x[:, i]
    return modes


class Coarsening:
    """The prolongation from rigid motions of aggregates. The construction is collective.

    Args:
        layout: numbering of the system; rows of other blocks are zero
        blocks: those of displacements

    Attributes:
        P: not smoothed yet
        modes: the rigid motions of space in the coarse unknowns, (owned, modes)
    """

    def __init__(self, layout: Any, blocks: Any):
        comm = layout.comm
        dim = layout.functions[blocks[0]].function_space.mesh.geometry.dim
        self.size = size = 3 if dim == 2 else 6
        parts = [self._block(layout, block, dim) for block in blocks]
        owned = size * sum(len(modes) for _, _, modes in parts)
        first = comm.exscan(owned) or 0
        n = layout.owned
        indptr, columns, values = np.zeros(n + 1, dtype=np.int64), [], []
        for block, (number, basis, modes) in zip(blocks, parts):
            rows = np.repeat(number, dim)  # aggregate of each row
            part = layout.slice(block)
            indptr[part.start + 1 : part.stop + 1] = size * (rows >= 0)
            at = rows[rows >= 0, None] * size + np.arange(size)
            columns.append((first + at).ravel())
            values.append(basis[rows >= 0].ravel())
            first += size * len(modes)
        self.modes = np.concatenate([m.reshape(-1, size) for _, _, m in parts])
        self.P = PETSc.Mat().createAIJ(
            ((n, None), (owned, None)),
            csr=(
                np.cumsum(indptr).astype(PETSc.IntType),
                np.concatenate(columns).astype(PETSc.IntType),
                np.concatenate(values),
            ),
            comm=comm,
        )

    @staticmethod
    def _block(layout: Any, block: int, dim: int) -> tuple[Any, Any, Any]:
        """Of a displacement's owned nodes: their aggregates, an orthonormal basis of the
        aggregates' rigid motions (dofs, modes), and space's in that basis (aggregates, modes, modes).
        """
        u = layout.functions[block]
        V = u.function_space
        n = V.dofmap.index_map.size_local
        x = V.tabulate_dof_coordinates()[:n, :dim]
        held = layout.held_mask(block)[: n * dim].reshape(n, dim)
        number, count = aggregates(x, compat.dof_list(V), ~held.all(axis=1))
        inside = number >= 0
        members = number[inside]
        weight = np.maximum(np.bincount(members, minlength=count), 1)
        centre = np.stack(
            [np.bincount(members, x[inside, i], minlength=count) for i in range(dim)], axis=1
        )
        centre /= weight[:, None]
        local = np.zeros_like(x)
        local[inside] = x[inside] - centre[members]
        width = np.sqrt(np.bincount(members, (local[inside] ** 2).sum(axis=1), minlength=count))
        width = np.where(width > 0, width / np.sqrt(weight), 1.0)
        local[inside] /= width[members, None]
        basis = rigid_modes(local) * (~held)[:, :, None]
        size = basis.shape[2]
        gram = np.zeros((count, size, size))
        np.add.at(gram, members, np.einsum("nki,nkj->nij", basis[inside], basis[inside]))
        values, vectors = np.linalg.eigh(gram)
        present = values > 1e-6 * values[:, -1:]
        root = np.sqrt(np.where(present, values, 1.0))
        turn = np.where(present[:, None, :], vectors / root[:, None, :], 0.0)
        basis[inside] = np.einsum("nki,nij->nkj", basis[inside], turn[members])
        # space's rigid motions are the local ones, and translations of the centre with rotations
        whole = np.zeros((count, size, size))
        whole[:] = np.eye(size)
        whole[:, range(dim, size), range(dim, size)] = width[:, None]
        whole[:, :dim, dim:] = rigid_modes(centre)[:, :, dim:]
        back = np.where(present[:, None, :], vectors * root[:, None, :], 0.0)
        modes = np.einsum("aij,aik->ajk", back, whole)
        return number, basis.reshape(n * dim, size), modes
