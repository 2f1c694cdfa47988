# SPDX-License-Identifier: MIT
"""Smoothed aggregation for the displacements of several bodies, on top of PETSc's PCMG.

P. Vaněk, J. Mandel and M. Brezina, Algebraic multigrid by smoothed aggregation for second and fourth
order elliptic problems, Computing 56 (1996): nodes are gathered in aggregates, on each of which the
rigid motions are the coarse unknowns. Their prolongation P₀ is smoothed once,

    P = (I − ω D⁻¹ A) P₀,   D = diag A,  ω = 4/(3 λ_max(D⁻¹ A))

PETSc's own GAMG would gather nodes of two bodies where they touch, and the sliding of one on the other
would be on no coarse level: with it the linear solves below take twice the iterations. Aggregates here
follow the meshes of the bodies, on all levels, and the rigid motions of each body are in the range of
the prolongations. Aggregates never leave a rank.
"""

from __future__ import annotations

from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from . import compat

# Neighbours farther away than so many times the nearest one are not strongly connected: flat cells
# are gathered across their thickness first.
_FAR = 3.0
# With fewer nodes on all ranks a level is the coarsest one.
_COARSEST = 300
# Rigid motions of an aggregate that are smaller, relative to its others, count as dependent: on three
# nodes in a line, or where conditions hold all but one component.
_DEPENDENT = 1e-6


def rotations(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Displacements of points (n, dim) by unit rotations about the origin; (n, dim, 1 or 3)."""
    n, dim = x.shape
    planes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((n, dim, len(planes)))
    for k, (i, j) in enumerate(planes):
        modes[:, i, k] = -x[:, j]
        modes[:, j, k] = x[:, i]
    return modes


class Level:
    """Nodes of a level on this rank.

    Args:
        x: their positions, (n, dim)
        basis: rigid motions about each node's own position in its unknowns, (n, unknowns, modes)
        graph: strong connections, each node with itself; a CSR matrix of which the pattern counts
    """

    def __init__(self, x: Any, basis: Any, graph: Any):
        self.x, self.basis, self.graph = x, basis, graph
        self.free = np.any(basis != 0, axis=(1, 2))

    def coarser(self) -> tuple[npt.NDArray[Any], npt.NDArray[Any], Level]:
        """The next level, with the tentative prolongation P₀.

        Returns:
            aggregate of each node, −1 where P₀ is zero; its values, (n, unknowns, modes); the level
        """
        number, count = aggregates(self.graph, self.free)
        inside = np.flatnonzero(number >= 0)
        of, dim = number[inside], self.x.shape[1]
        weight = np.bincount(of, minlength=count)[:, None]
        centre = np.column_stack(
            [np.bincount(of, self.x[inside, i], minlength=count) for i in range(dim)]
        )
        centre /= weight
        arm = self.x[inside] - centre[of]
        size = np.sqrt(np.bincount(of, np.sum(arm**2, axis=1), minlength=count) / weight[:, 0])
        size = np.where(size > 0, size, 1.0)
        # motions about the aggregate's centre, rotations by the angle 1/size
        modes = self.basis[inside].copy()
        modes[:, :, dim:] += np.einsum("nki,nij->nkj", modes[:, :, :dim], rotations(arm))
        modes[:, :, dim:] /= size[of, None, None]
        # orthonormal on each aggregate
        gram = _sums(np.einsum("nki,nkj->nij", modes, modes), of, count)
        values, vectors = np.linalg.eigh(gram)
        present = values > _DEPENDENT * values[:, -1:]
        root = np.sqrt(np.where(present, values, 1.0))
        turn = np.where(present, 1 / root, 0.0)[:, None, :] * vectors
        tentative = np.zeros_like(self.basis)
        tentative[inside] = np.einsum("nki,nij->nkj", modes, turn[of])
        basis = np.where(present, root, 0.0)[:, :, None] * vectors.transpose(0, 2, 1)
        basis[:, :, dim:] *= size[:, None, None]
        ones = np.ones(len(inside), dtype=np.int8)
        gather = csr_matrix((ones, (inside, of)), shape=(len(number), count))
        graph = (gather.T @ self.graph @ gather).tocsr()
        return number, tentative, Level(centre, basis, _strong(centre, graph))


def finest(u: Any, held: npt.NDArray[np.bool_]) -> Level:
    """The nodes of a displacement that this rank owns, in their present positions.

    Args:
        u: displacement
        held: dofs that Dirichlet conditions hold, (local dofs)
    """
    V = u.function_space
    dim = V.mesh.geometry.dim
    n, cells = V.dofmap.index_map.size_local, compat.dof_list(V)
    x = V.tabulate_dof_coordinates()[:n, :dim] + u.x.array[: n * dim].reshape(n, dim)
    basis = np.zeros((n, dim, 3 if dim == 2 else 6))
    basis[:, range(dim), range(dim)] = ~held[: n * dim].reshape(n, dim)

    starts = np.concatenate([[0], np.cumsum((cells < n).sum(axis=1))])
    nodes = cells[cells < n]
    ones = np.ones(len(nodes), dtype=np.int8)
    on_cell = csr_matrix((ones, nodes, starts), shape=(len(cells), n))
    return Level(x, basis, _strong(x, on_cell.T.tocsr() @ on_cell))


def _strong(x: npt.NDArray[np.float64], graph: Any) -> Any:
    """A graph without the connections of nodes that are far from each other. Each row has its
    diagonal."""
    x = (x - x.mean(axis=0) if len(x) else x).astype(np.float32)
    rows = np.repeat(np.arange(len(x), dtype=np.int32), np.diff(graph.indptr))
    diagonal = rows == graph.indices
    distance = np.zeros(len(rows), dtype=np.float32)
    for i in range(x.shape[1]):
        distance += (x[rows, i] - x[graph.indices, i]) ** 2
    distance[diagonal] = np.inf
    nearest = np.minimum.reduceat(distance, graph.indptr[:-1]) if len(x) else distance
    distance[diagonal] = 0.0
    keep = distance <= _FAR**2 * np.maximum(nearest[rows], nearest[graph.indices])
    starts = np.zeros(len(keep) + 1, dtype=np.int32)
    np.cumsum(keep, out=starts[1:])
    starts = starts[graph.indptr]
    ones = np.ones(int(starts[-1]), dtype=np.int8)
    return csr_matrix((ones, graph.indices[keep], starts), shape=graph.shape)


def aggregates(graph: Any, free: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int64], int]:
    """Aggregate of each node, −1 for those that are not free, and the number of aggregates.

    The roots are a maximal set of nodes more than three connections apart (by random priorities); all
    others join an aggregate beside them. On hexahedra aggregates have about 80 nodes: with roots two
    connections apart coarse matrices have three times the entries, for a fifth fewer iterations.
    """
    n = len(free)
    priority = np.random.default_rng(1).permutation(n) + 1
    undecided, root = free.copy(), np.zeros(n, dtype=bool)

    def largest(values: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        return np.where(free, np.maximum.reduceat(values[graph.indices], graph.indptr[:-1]), 0)

    while undecided.any():
        value = np.where(undecided, priority, 0)
        value[root] = n + 1
        value = largest(largest(largest(value)))
        root |= undecided & (value == priority)
        undecided &= (value < n + 1) & ~root
    number = np.zeros(n, dtype=np.int64)
    number[root] = np.arange(1, root.sum() + 1)
    while np.any(free & (number == 0)):
        number = np.where(number == 0, largest(number), number)
    return number - 1, int(root.sum())


def _sums(values: npt.NDArray[Any], of: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    """Sums of rows with the same number."""
    flat = values.reshape(len(values), -1)
    gather = csr_matrix((np.ones(len(of)), (of, np.arange(len(of)))), shape=(count, len(of)))
    return (gather @ flat).reshape(count, *values.shape[1:])


class Hierarchy:
    """Prolongations for the displacements of a system, made for the first matrix.

    Args:
        layout: numbering of the system
        blocks: displacements; rows of the other blocks have no part

    Attributes:
        P: prolongations, the finest first: that from the first coarse unknowns to the system's
    """

    def __init__(self, layout: Any, blocks: Sequence[int]):
        self._comm, self._layout, self._blocks = layout.comm, layout, list(blocks)
        self.P: list[Any] = []

    def operators(self, A: Any, first: Callable[[Any], Any]) -> list[Any]:
        """Matrices of the coarse levels, the finest first. Collective.

        Args:
            A: matrix of the system
            first: takes the first prolongation, and returns the matrix of the first coarse level
        """
        if self.P:
            matrices = [first(self.P[0])]
            for P in self.P[1:]:
                matrices.append(coarse(matrices[-1], P))
            return matrices
        matrices, layout = [], self._layout
        levels = [finest(layout.functions[b], layout.held_mask(b)) for b in self._blocks]
        starts = np.array([layout.offsets[b] for b in self._blocks])
        rows = layout.owned
        while self._comm.allreduce(sum(len(level.x) for level in levels)) > _COARSEST:
            steps = [level.coarser() for level in levels]
            P0, rows, starts = self._tentative(rows, starts, steps)
            levels = [level for _, _, level in steps]
            del steps  # they are as large as P
            before, after = P0.getSize()
            if after < 0.7 * before:  # not so on many ranks with few nodes each
                self.P.append(_smoothed(matrices[-1] if matrices else A, P0))
                matrices.append(coarse(matrices[-1], self.P[-1]) if matrices else first(self.P[0]))
            P0.destroy()
            if after >= 0.7 * before:
                break
        return matrices

    def free(self) -> None:
        """Free the memory: PETSc 3.18 keeps what Python merely lets go of."""
        for P in self.P:
            P.destroy()
        self.P = []

    def _tentative(self, rows: int, starts: Any, steps: Any) -> tuple[Any, int, Any]:
        """P₀ of all blocks, its owned columns, and where each block starts among them."""
        counts = [level.basis.shape[:2] for _, _, level in steps]
        sizes = np.array([nodes * modes for nodes, modes in counts])
        owned = int(sizes.sum())
        next_starts = np.concatenate([[0], np.cumsum(sizes)])[:-1]
        first = (self._comm.exscan(owned) or 0) + next_starts
        lengths, columns, values = np.zeros(rows, dtype=np.int64), [], []
        for start, column, (number, tentative, level) in zip(starts, first, steps):
            n, width, modes = tentative.shape
            lengths[start : start + n * width] = np.repeat(modes * (number >= 0), width)
            inside = number >= 0
            at = column + number[inside, None, None] * modes + np.arange(modes)
            columns.append(np.broadcast_to(at, (len(at), width, modes)).ravel())
            values.append(tentative[inside].ravel())
        csr = (
            np.concatenate([[0], np.cumsum(lengths)]).astype(PETSc.IntType),
            np.concatenate(columns).astype(PETSc.IntType),
            np.concatenate(values),
        )
        P0 = PETSc.Mat().createAIJ(((rows, None), (owned, None)), csr=csr, comm=self._comm)
        return P0, owned, next_starts


def coarse(A: Any, P: Any) -> Any:
    """PᵀAP, with 1 on the diagonal where a column of P is zero. Collective."""
    return mended(A.ptap(P))


def mended(K: Any) -> Any:
    """K with 1 on the diagonal where it was 0. Collective."""
    diagonal = K.getDiagonal()
    zero = diagonal.array_r == 0
    if K.comm.tompi4py().allreduce(int(zero.sum())) > 0:
        diagonal.array[zero] = 1.0
        K.setDiagonal(diagonal)
    diagonal.destroy()
    return K


def inverse_diagonal(A: Any) -> Any:
    """1/|diagonal|, and 1 where it is zero; a vector."""
    inverse = A.getDiagonal()
    d = np.abs(inverse.array_r)
    inverse.array[:] = 1 / np.where(d > 0, d, 1.0)
    return inverse


def largest_eigenvalue(A: Any, part: Any = None) -> float:
    """About the largest one of D⁻¹A, D = diag A, a little below it. Collective.

    Args:
        part: a vector of ones and zeros: rows and columns that count; None: all
    """
    inverse, (x, y) = inverse_diagonal(A), A.createVecs()
    if part is not None:
        inverse.pointwiseMult(inverse, part)
    random = PETSc.Random().create(A.comm)
    random.setSeed(1)
    random.seed()
    x.setRandom(random)
    bound = 1.0
    for _ in range(10):
        A.mult(x, y)
        x.pointwiseMult(y, inverse)
        bound = x.norm()
        x.scale(1 / bound if bound > 0 else 0.0)
    for thing in (inverse, x, y, random):
        thing.destroy()
    return bound


def _smoothed(A: Any, P0: Any) -> Any:
    """(I − ω D⁻¹ A) P₀. Collective."""
    part, ones = P0.createVecLeft(), P0.createVecRight()
    ones.set(1.0)
    P0.mult(ones, part)
    part.array[:] = part.array_r != 0  # displacements that are not held
    scale = inverse_diagonal(A)
    scale.pointwiseMult(scale, part)
    scale.scale(-4 / (3 * 1.1 * largest_eigenvalue(A, part)))
    P = A.matMult(P0)
    P.diagonalScale(scale, None)
    P.axpy(1.0, P0, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    for vector in (part, ones, scale):
        vector.destroy()
    return P
