# SPDX-License-Identifier: MIT
"""Multigrid for the displacements of all bodies: PETSc's smoothed aggregation, of the bodies apart.

GAMG (P. Vaněk, J. Mandel and M. Brezina, Computing 56 (1996)) gathers nodes in aggregates, on each of
which the rigid motions are the coarse unknowns. Where nodes of two bodies that touch were gathered,
their sliding on each other would be on no coarse level, and the linear solves take twice the
iterations. What contact adds to A_uu is small beside the bulk's entries: GAMG's threshold leaves it
out of the graph, and each body has aggregates and rigid motions of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

# Entries of A_uu below so much of their diagonals (as blocks of a node) connect no nodes.
_THRESHOLD = 0.05


class Hierarchy:
    """Prolongations for the displacements of a system. The construction is collective.

    Args:
        A: matrix of the system, for whose graph they are made
        layout: its numbering
        bulk: number of displacement functions, the first of the layout's
        prefix: of PETSc's options

    Attributes:
        P: prolongations, the finest first: that from the first coarse unknowns to the system's, with
            empty rows for the multipliers. None where there are few unknowns.
    """

    def __init__(self, A: Any, layout: Any, bulk: int, prefix: str):
        self._layout, self._bulk, self._prefix = layout, bulk, prefix
        self.P: list[Any] = []
        self._aggregate(A)

    def operators(self, K: Any) -> list[Any]:
        """Matrices of the coarse levels, the finest first. Collective.

        Args:
            K: that of the first coarse level
        """
        matrices = [K]
        for P in self.P[1:]:
            matrices.append(mended(matrices[-1].ptap(P)))
        return matrices

    def free(self) -> None:
        """Free the memory: PETSc 3.18 keeps what Python merely lets go of."""
        for P in self.P:
            P.destroy()
        self.P = []

    def _aggregate(self, A: Any) -> None:
        layout = self._layout
        bulk = int(layout.offsets[self._bulk])
        rows = layout.start + np.arange(bulk, dtype=PETSc.IntType)
        index = PETSc.IS().createGeneral(rows, comm=layout.comm)
        K = A.createSubMatrix(index, index)
        motions = self._rigid_motions()
        K.setBlockSize(motions.getVecs()[0].getBlockSize())
        K.setNearNullSpace(motions)
        gamg = PETSc.PC().create(layout.comm)
        gamg.setOptionsPrefix(self._prefix)
        database, key = PETSc.Options(), f"{self._prefix}pc_gamg_threshold"
        ours = not database.hasName(key)
        if ours:
            database[key] = _THRESHOLD
        gamg.setType("gamg")
        gamg.setOperators(K, K)
        gamg.setFromOptions()
        if ours:
            database.delValue(key)
        gamg.setUp()
        for level in range(gamg.getMGLevels() - 1, 0, -1):
            P = gamg.getMGInterpolation(level)
            self.P.append(P.copy() if self.P else self._lengthened(P))
        for thing in (gamg, K, motions, index):
            thing.destroy()

    def _rigid_motions(self) -> Any:
        """Rigid motions about the origin, from present positions: a null space for PETSc."""
        positions = []
        for u in self._layout.functions[: self._bulk]:
            V = u.function_space
            n, dim = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
            x = V.tabulate_dof_coordinates()[:n, :dim] + u.x.array[: n * dim].reshape(n, dim)
            positions.append(x.ravel())
        x = PETSc.Vec().createWithArray(
            np.concatenate(positions), bsize=dim, comm=self._layout.comm
        )
        motions = PETSc.NullSpace().createRigidBody(x)
        x.destroy()
        return motions

    def _lengthened(self, P: Any) -> Any:
        """P with empty rows for the multipliers, which are the last rows of each rank."""
        starts, columns, values = P.getValuesCSR()
        more = np.full(self._layout.owned - len(starts) + 1, starts[-1], dtype=starts.dtype)
        csr = (np.concatenate([starts, more]), columns, values)
        size = ((self._layout.owned, None), P.getSizes()[1])
        return PETSc.Mat().createAIJ(size, csr=csr, comm=self._layout.comm)


def mended(K: Any) -> Any:
    """K with 1 on the diagonal where it was 0: a column of P is zero. Collective."""
    diagonal = K.getDiagonal()
    zero = diagonal.array_r == 0
    if K.comm.tompi4py().allreduce(int(zero.sum())) > 0:
        diagonal.array[zero] = 1.0
        K.setDiagonal(diagonal)
    diagonal.destroy()
    return K
