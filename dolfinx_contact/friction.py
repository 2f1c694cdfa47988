# SPDX-License-Identifier: MIT
"""Friction unknowns of a pair: Λ = Σ_A φ_A t_Aα Λ_Aα, in tangents of the slave's nodes (F3).

The method is Ben Dhia and Zarroug's (2002), as are the equations' numbers.

The tangents are built from the slave's interpolated normals and frozen while a step is solved.
Friction depends on TΛ alone, hence on no choice of tangents in the plane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .held import agreed, local_dofs

# A tangent whose free part is shorter than this is held: exactly 0 on a plane of symmetry, but for
# the tilt of an interpolated normal there
_FREE = 0.5


class FrictionUnknowns:
    """Tangents of the friction space's nodes, and which of its unknowns are held. Collective.

    Args:
        pair: with friction
    """

    def __init__(self, pair: Any):
        self._pair = pair
        mesh, dim = pair.slave.mesh, pair.slave.dim
        self.function = pair._semi_multiplier  # (local nodes × (dim − 1)) numbers
        self._vectors = fem.Function(compat.function_space(mesh, tuple(pair.friction_space), dim))
        self.local = local_dofs(pair, self.function, len(pair._phi[2]))
        self.tangents: npt.NDArray[np.float64] | None = None
        self._accepted: npt.NDArray[np.float64] | None = None
        self.held = np.zeros(len(self.function.x.array), dtype=bool)

    def accept(self) -> None:
        """The present tangents are those of an accepted step: the next ones follow them."""
        self._accepted = self.tangents

    @property
    def accepted(self) -> npt.NDArray[np.float64] | None:
        """Tangents of the last accepted step, (local nodes, dim − 1, dim)."""
        return self._accepted

    def resume(self, tangents: npt.NDArray[np.float64]) -> None:
        """Tangents of the last accepted step, of this rank's own nodes. Collective."""
        dim = self._pair.slave.dim
        table = self._vectors.x.array.reshape(-1, dim)
        self._accepted = np.empty((len(table), dim - 1, dim))
        for i in range(dim - 1):
            table[: len(tangents)] = tangents[:, i]
            self._vectors.x.scatter_forward()
            self._accepted[:, i] = table

    def choose(
        self, normals: npt.NDArray[np.float64], free: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """New tangents for a step, as near to the former ones as the normals allow. Collective.

        Args:
            normals: the slave's at the nodes of each own facet, (facets, nodes, dim)
            free: components in which the slave or its target may move there, same shape

        Returns:
            t_Aα, (local nodes, dim − 1, dim)
        """
        dim = self._pair.slave.dim
        n = self._mean(normals)
        moves = agreed(self._vectors, self.local, free, any_facet=True).reshape(-1, dim)

        t = np.empty((len(n), dim - 1, dim))
        if dim == 2:
            t[:, 0] = np.column_stack([-n[:, 1], n[:, 0]])
        else:
            t[:, 0] = self._first_tangent(n, moves)
            t[:, 1] = np.cross(n, t[:, 0])
        self.tangents = t
        free_part = np.linalg.norm(t * moves[:, None, :], axis=2)
        self.held = (free_part < _FREE).ravel()
        return t

    def _first_tangent(
        self, n: npt.NDArray[np.float64], moves: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """Along a held component where there is one, else the former tangent, turned with n."""
        wish = np.eye(3)[np.argmin(np.round(np.abs(n), 6), axis=1)]
        if self._accepted is not None:
            wish = self._accepted[:, 0]
        stuck = ~moves & (np.abs(n) < 0.9)
        some = stuck.any(axis=1)
        wish = np.where(some[:, None], np.eye(3)[np.argmax(stuck, axis=1)], wish)
        t, size = _project(wish, n)
        other, _ = _project(np.eye(3)[np.argmin(np.abs(n), axis=1)], n)
        return np.where(size > 0.1, t, other)

    def _mean(self, normals: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit normals at the local nodes from those of the facets around; bitwise the owner's on
        all ranks. Collective."""
        dim = self._pair.slave.dim
        sums = self._vectors.x.array.reshape(-1, dim)
        sums[:] = 0.0
        np.add.at(sums, self.local, normals)
        compat.scatter_reverse_add(self._vectors)
        self._vectors.x.scatter_forward()
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.divide(
            sums, length, out=np.tile(np.eye(dim)[-1], (len(sums), 1)), where=length > 0
        )


def _dot(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Products of rows, (n, 1)."""
    return np.sum(a * b, axis=1, keepdims=True)


def _project(
    v: npt.NDArray[np.float64], n: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Unit tangential parts of vectors, and their former lengths; (n, dim) and (n, 1)."""
    t = v - n * _dot(n, v)
    size = np.linalg.norm(t, axis=1, keepdims=True)
    return t / np.maximum(size, np.finfo(float).tiny), size
