# SPDX-License-Identifier: MIT
"""Bodies that nothing holds: found in the matrix, before a solve returns noise.

A body that is driven by forces and touches nothing can move rigidly. The matrix is singular then, and
a direct solver may not notice (formulation, section 7). Rigid motions r of bodies whose Dirichlet
conditions leave some of them free are multiplied with the matrix A of the whole system, contact
included: ‖D⁻¹ A r‖, D the largest entries of A's rows, is 0 but for round-off if nothing resists.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from . import _cpp, compat
from .errors import UnheldError
from .layout import Layout

# Round-off leaves about 1e-15, a body held at one of a million nodes 1e-3.
_FREE = 1e-10


@dataclass
class _Body:
    block: int
    nodes: npt.NDArray[np.int64]  # owned local nodes
    names: list[str]
    tool: npt.NDArray[np.int64] | None = None  # a rigid tool: its translation in the block


class Bodies:
    """Connected bodies of some displacements. The construction is collective.

    Args:
        layout: numbering of the system
        surfaces: name, surface and block of its displacement, of all pairs
        driven: tools that forces drive

    Attributes:
        blocks: those of the displacements that move surfaces
    """

    def __init__(self, layout: Layout, surfaces: Sequence[tuple[str, Any, int]], driven: Any):
        self._layout, self._comm = layout, layout.comm
        self._loose: list[_Body] = []
        self.blocks = sorted({block for _, _, block in surfaces})
        for block in self.blocks:
            V = layout.functions[block].function_space
            number, count = _components(self._comm, V)
            owned = V.dofmap.index_map.size_local
            names: list[set[str]] = [set() for _ in range(count)]
            for name, surface, other in surfaces:
                if other == block:
                    for body in self._bodies_of(surface, V, number, count):
                        names[body].add(name)
            for body in range(count):
                found = _Body(block, np.flatnonzero(number[:owned] == body), sorted(names[body]))
                if not self._clamped(found):
                    self._loose.append(found)
        for i, tool in enumerate(driven.tools):
            at = 2 * tool.dim * i + np.arange(tool.dim)
            name = f"{type(tool).__name__} driven by a force"
            self._loose.append(_Body(driven.block, np.zeros(0, dtype=np.int64), [name], at))

    def _bodies_of(self, surface: Any, V: Any, number: npt.NDArray[Any], count: int) -> Any:
        nodes = compat.global_indices(V.dofmap.index_map)
        local = np.isin(nodes, np.unique(surface.nodes))
        present = np.bincount(number[local], minlength=count) > 0
        return np.flatnonzero(self._comm.allreduce(present.astype(int)))

    def _clamped(self, body: _Body) -> bool:
        """Whether Dirichlet conditions leave it no rigid motion."""
        modes, _ = self._modes(body, moved=False)
        held = self._layout.held_mask(body.block)[: len(modes), None]
        return self._least(modes * held, self._comm.allreduce(modes.T @ modes)) > 1e-8

    def _modes(self, body: _Body, moved: bool) -> tuple[npt.NDArray[np.float64], list[str]]:
        """Rigid motions as columns over the owned dofs of the body's block, and their names."""
        if body.tool is not None:
            part, dim = self._layout.slice(body.block), len(body.tool)
            modes = np.zeros((part.stop - part.start, dim))
            if len(modes):
                modes[body.tool, np.arange(dim)] = 1
            return modes, [f"translation along {axis}" for axis in "xyz"[:dim]]
        u = self._layout.functions[body.block]
        dim = u.function_space.mesh.geometry.dim
        x = u.function_space.tabulate_dof_coordinates()[body.nodes, :dim]
        if moved:
            x = x + u.x.array.reshape(-1, dim)[body.nodes]
        total = self._comm.allreduce(np.concatenate([x.sum(axis=0), [len(x)]]))
        x = x - total[:-1] / total[-1]
        size = np.sqrt(self._comm.allreduce(np.sum(x**2)) / total[-1])
        planes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
        at = body.nodes[:, None] * dim + np.arange(dim)
        owned = u.function_space.dofmap.index_map.size_local * dim
        modes = np.zeros((owned, dim + len(planes)))
        for i in range(dim):
            modes[at[:, i], i] = 1
        for k, (i, j) in enumerate(planes):
            modes[at[:, i], dim + k] = -x[:, j] / size
            modes[at[:, j], dim + k] = x[:, i] / size
        about = [""] if dim == 2 else [" about x", " about y", " about z"]
        names = [f"translation along {axis}" for axis in "xyz"[:dim]]
        return modes, names + [f"rotation{axis}" for axis in about]

    def _least(self, Y: npt.NDArray[np.float64], gram: npt.NDArray[np.float64]) -> float:
        """Smallest ‖Y c‖/‖R c‖ over all c, with gram = RᵀR. Collective.

        The singular values of Y, not the eigenvalues of YᵀY: these end at the root of round-off.
        """
        normal = np.linalg.inv(np.linalg.cholesky(gram)).T
        parts = self._comm.allgather(np.linalg.qr(Y @ normal, mode="r"))
        return float(np.linalg.svd(np.concatenate(parts), compute_uv=False)[-1])

    def unheld(self, A: Any) -> str | None:
        """What can move without any resistance of A; None if nothing can. Collective."""
        if not self._loose:
            return None
        largest = _cpp.largest_in_rows(A.handle)
        scale = np.where(largest > 0, largest, 1.0)
        for moved in (False, True):  # rigid motions of linear and of nonlinear models
            columns, names, grams = [], [], []
            for body in self._loose:
                modes, labels = self._modes(body, moved)
                grams.append(self._comm.allreduce(modes.T @ modes))
                columns += [self._product(A, body.block, r) / scale for r in modes.T]
                names.append(labels)
            Y = np.column_stack(columns)
            gram = np.zeros((Y.shape[1], Y.shape[1]))
            first = 0
            for g in grams:
                last = first + len(g)
                gram[first:last, first:last] = g
                first = last
            if self._least(Y, gram) < _FREE:
                return self._describe(Y, gram, names)
        return None

    def _product(self, A: Any, block: int, mode: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
        x, y = A.createVecs()
        x.array[self._layout.slice(block)] = mode
        A.mult(x, y)
        product = np.array(y.array_r)
        x.destroy()
        y.destroy()
        return product

    def _describe(self, Y: Any, gram: Any, names: list[list[str]]) -> str:
        resisted = np.sqrt(self._comm.allreduce(np.sum(Y**2, axis=0)) / np.diag(gram))
        lines, first = [], 0
        for body, labels in zip(self._loose, names):
            free = [s for s, r in zip(labels, resisted[first:]) if r < _FREE]
            first += len(labels)
            if free:
                what = ", ".join(body.names) or "without contact surfaces"
                lines.append(f"the body ({what}) is free: {', '.join(free)}")
        if not lines:  # only together, or along another direction than the axes
            bodies = "; ".join(
                ", ".join(b.names) or "without contact surfaces" for b in self._loose
            )
            lines.append(
                f"the bodies ({bodies}) have a common or oblique rigid motion that is free"
            )
        return "; ".join(lines)

    def check(self, A: Any) -> None:
        """Raise if the matrix of the system lets a body move freely. Collective.

        Raises:
            UnheldError: on all ranks
        """
        free = self.unheld(A)
        if free is not None:
            raise UnheldError(
                f"Nothing holds a body as the step begins: {free}. Friction holds only what is"
                " pressed. Let the body touch at the start (move it, or give the pair a larger"
                " initial_contact), hold the motion by a Dirichlet condition, or drive the body"
                " through a prescribed displacement or a rigid tool instead of a force."
            )


def _components(comm: Any, V: Any) -> tuple[npt.NDArray[np.int64], int]:
    """Body of each local node of a space, ghosts included, and the number of bodies. Collective."""
    cells = compat.dof_list(V).astype(np.int64)
    index_map = V.dofmap.index_map
    owned, n = index_map.size_local, index_map.size_local + index_map.num_ghosts
    edges = np.repeat(cells[:, 0], cells.shape[1] - 1), cells[:, 1:].ravel()
    graph = coo_matrix((np.ones(len(edges[0])), edges), shape=(n, n))
    count, local = connected_components(graph, directed=False)
    # join the components of all ranks where nodes are shared
    counts = comm.allgather(count)
    label = local + sum(counts[: comm.rank])
    owner = compat.from_owners(V, label)
    links = np.unique(np.column_stack([label[owned:], owner[owned:]]), axis=0)
    links = np.concatenate(comm.allgather(links)).astype(np.int64)
    total = sum(counts)
    whole = coo_matrix((np.ones(len(links)), links.T), shape=(total, total))
    count, body = connected_components(whole, directed=False)
    return body[label], int(count)
