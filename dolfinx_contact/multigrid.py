# SPDX-License-Identifier: MIT
"""Multigrid for the displacements of all bodies: PETSc's smoothed aggregation of the bulk alone.

GAMG (P. Vaněk, J. Mandel and M. Brezina, Computing 56 (1996)) gathers nodes in aggregates, on each of
which the rigid motions are the coarse unknowns. Where nodes of two bodies that touch were gathered,
their sliding on each other would be on no coarse level, and linear solves take many more iterations. So
it is given the bulk's matrix, in which the bodies are apart.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
from petsc4py import PETSc


class Hierarchy:
    """Prolongations for the displacements of a system. The construction is collective.

    Args:
        system: its bulk at the present displacements
        prefix: of PETSc's options

    Attributes:
        P: prolongations, the finest first: that from the first coarse unknowns to the system's, with
            empty rows for the multipliers. None where there are few unknowns
        iterations: of linear solves with it, the first and the last one
    """

    def __init__(self, system: Any, prefix: str):
        self.P: list[Any] = []
        self.iterations: list[int] = []
        K = system.bulk_matrix()
        motions = _rigid_motions(system.u)
        K.setBlockSize(motions.getVecs()[0].getBlockSize())
        K.setNearNullSpace(motions)
        gamg = PETSc.PC().create(system.comm)
        gamg.setOptionsPrefix(prefix)
        gamg.setType("gamg")
        gamg.setOperators(K, K)
        gamg.setFromOptions()
        gamg.setUp()
        self.P = [gamg.getMGInterpolation(i) for i in range(gamg.getMGLevels() - 1, 0, -1)]
        for thing in (gamg, K, motions):
            thing.destroy()
        if self.P:
            P = self.P[0]
            self.P[0] = _lengthened(P, system.layout.owned)
            P.destroy()

    @property
    def worn(self) -> bool:
        """Whether linear solves have come to take twice their first iterations: bodies have turned."""
        return len(self.iterations) == 2 and self.iterations[1] > 2 * self.iterations[0]

    def count(self, iterations: int) -> None:
        """Keep the number of iterations of a linear solve."""
        self.iterations = [*self.iterations[:1], iterations]

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


def _rigid_motions(displacements: Sequence[Any]) -> Any:
    """Rigid motions about the origin, from present positions: a null space for PETSc."""
    positions = []
    for u in displacements:
        V = u.function_space
        n, dim = V.dofmap.index_map.size_local, V.dofmap.index_map_bs
        x = V.tabulate_dof_coordinates()[:n, :dim] + u.x.array[: n * dim].reshape(n, dim)
        positions.append(x.ravel())
    comm = displacements[0].function_space.mesh.comm
    x = PETSc.Vec().createWithArray(np.concatenate(positions), bsize=dim, comm=comm)
    motions = PETSc.NullSpace().createRigidBody(x)
    x.destroy()
    return motions


def _lengthened(P: Any, rows: int) -> Any:
    """P with empty rows for the multipliers, which are the last rows of each rank."""
    starts, columns, values = P.getValuesCSR()
    more = np.full(rows - len(starts) + 1, starts[-1], dtype=starts.dtype)
    csr = (np.concatenate([starts, more]), columns, values)
    return PETSc.Mat().createAIJ(((rows, None), P.getSizes()[1]), csr=csr, comm=P.comm)


def mended(K: Any) -> Any:
    """K with 1 on the diagonal where it was 0: a column of P is zero. Collective."""
    diagonal = K.getDiagonal()
    zero = diagonal.array_r == 0
    if K.comm.tompi4py().allreduce(int(zero.sum())) > 0:
        diagonal.array[zero] = 1.0
        K.setDiagonal(diagonal)
    diagonal.destroy()
    return K
