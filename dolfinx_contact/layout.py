# SPDX-License-Identifier: MIT
"""Numbering of the monolithic system: per rank the owned dofs of each block, one after the other.

Blocks are the bulk unknowns (displacements first of all) and the multipliers of the pairs. Block
sizes are unrolled: the system has block size 1.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from . import compat


class Layout:
    """Numbering of a system of several Functions. The construction is collective.

    Args:
        comm: communicator of the system
        functions: the unknowns
        bcs: Dirichlet conditions on them
        scalars: number of further unknowns, owned by rank 0: the last block

    Attributes:
        offsets: where each block starts among this rank's owned dofs; (blocks + 1,)
        owned: number of this rank's owned dofs
        start: first of them in the system
    """

    def __init__(self, comm: Any, functions: Sequence[Any], bcs: Sequence[Any], scalars: int = 0):
        self.comm, self.functions = comm, list(functions)
        maps = [f.function_space.dofmap for f in functions]
        self.block_sizes = [m.index_map_bs for m in maps]
        sizes = [m.index_map.size_local * m.index_map_bs for m in maps]
        sizes.append(scalars if comm.rank == 0 else 0)
        self.offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.owned = int(self.offsets[-1])

        table = np.array(comm.allgather(sizes), dtype=np.int64).reshape(comm.size, -1)
        zeros = np.zeros((1, table.shape[1]), dtype=np.int64)
        # first dof of each rank within each block, and of each rank's part in the system
        self._block_starts = np.concatenate([zeros, np.cumsum(table, axis=0)])[:-1]
        rank_starts = np.concatenate([[0], np.cumsum(table.sum(axis=1))])
        self._system_starts = rank_starts[:-1, None] + np.concatenate(
            [np.zeros((comm.size, 1), dtype=np.int64), np.cumsum(table, axis=1)[:, :-1]], axis=1
        )
        self.start = int(rank_starts[comm.rank])

        self._held = [np.zeros(len(f.x.array), dtype=bool) for f in functions]
        for f, mask in zip(functions, self._held):
            for bc in bcs:
                if compat.contains(f.function_space, bc):
                    mask[compat.bc_dofs(bc)[0]] = True

    def slice(self, block: int) -> slice:
        """Owned dofs of a block among this rank's owned dofs."""
        return slice(int(self.offsets[block]), int(self.offsets[block + 1]))

    def system_dofs(self, block: int, dofs: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Global, unrolled dofs of a block, numbered in the system."""
        starts = self._block_starts[:, block]
        rank = np.searchsorted(starts, dofs, side="right") - 1
        return self._system_starts[rank, block] + dofs - starts[rank]

    def local_dofs(self, block: int) -> npt.NDArray[Any]:
        """System dofs of a block's local unrolled dofs, ghosts included."""
        dofmap = self.functions[block].function_space.dofmap
        size = self.block_sizes[block]
        blocks = compat.global_indices(dofmap.index_map)
        unrolled = (blocks[:, None] * size + np.arange(size)).ravel()
        return self.system_dofs(block, unrolled).astype(PETSc.IntType)

    def held_mask(self, block: int) -> npt.NDArray[np.bool_]:
        """Whether a Dirichlet condition holds each local unrolled dof of a block."""
        return self._held[block]

    def held_rows(self) -> npt.NDArray[Any]:
        """System dofs owned by this rank that Dirichlet conditions hold."""
        rows = []
        for block in range(len(self.functions)):
            size = int(self.offsets[block + 1] - self.offsets[block])
            first = self.start + int(self.offsets[block])
            rows.append(first + np.flatnonzero(self._held[block][:size]))
        return np.concatenate(rows).astype(PETSc.IntType)

    def held_vector(self, block: int) -> Any:
        """A PETSc vector like the block's own: 1 where Dirichlet conditions hold, else 0."""
        vector = compat.petsc_vec(self.functions[block]).duplicate()
        size = int(self.offsets[block + 1] - self.offsets[block])
        vector.array[:] = self._held[block][:size]
        return vector

    def node_dofs(
        self, block: int, nodes: npt.NDArray[np.int64], held: npt.NDArray[np.float64]
    ) -> npt.NDArray[Any]:
        """System dofs of nodes that any rank may own; (n × block size,), −1 where held.

        Args:
            nodes: global block dofs, (n,)
            held: 1 where a dof is held, else 0; (n × block size,)
        """
        size = self.block_sizes[block]
        dofs = self.system_dofs(block, (nodes[:, None] * size + np.arange(size)).ravel())
        return np.where(held > 0.5, -1, dofs).astype(PETSc.IntType)
