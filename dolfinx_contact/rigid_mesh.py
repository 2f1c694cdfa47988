# SPDX-License-Identifier: MIT
"""A rigid tool given by a mesh of its surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from . import _cpp
from .checks import file_name, numbers, switch
from .errors import InputError, together
from .gmsh_file import gmsh_model
from .surface import reference_facet
from .tools import RigidTool


class RigidMesh(RigidTool):
    """A rigid tool whose surface is a mesh; every rank holds all of it.

    Targets are searched as on a deformable master, by the pair's ``target`` and ``normals``: with
    Smooth(), the default, along the mesh's interpolated normals, so that a coarse mesh acts as a
    smooth surface; with Proximity() the closest point.

    Args:
        points: of the mesh in the reference position, (n, dim) [length]
        cells: numbers of their corners: lines in 2D, (m, 2); triangles, (m, 3), or quadrilaterals in
            cyclic order, (m, 4), in 3D. In the order of their corners they turn counterclockwise
            seen from outside of the material, as in STL; lines have the material on their left
        flip: they turn clockwise

    Raises:
        InputError: arrays of another shape, points that are not finite, cells with corners that are
            not there or coincide, neighbours that turn against each other, more than two at an edge
    """

    def __init__(self, points: Any, cells: Any, flip: bool = False):
        x = numbers(points)
        c = np.asarray(cells)
        fits = x.ndim == 2 and c.ndim == 2 and len(c) > 0 and np.issubdtype(c.dtype, np.integer)
        if not fits or (x.shape[1], c.shape[1]) not in ((2, 2), (3, 3), (3, 4)):
            raise InputError(
                f"RigidMesh: points of shape {x.shape} and cells of shape {c.shape}; give (n, 2) with"
                " lines (m, 2), or (n, 3) with triangles (m, 3) or quadrilaterals (m, 4)."
            )
        if not np.all(np.isfinite(x)) or c.min() < 0 or c.max() >= len(x):
            raise InputError(
                f"RigidMesh: cells have corners from {c.min()} to {c.max()} for {len(x)} points; give"
                " finite points, and corners from 0 to their number less one."
            )
        super().__init__(x.shape[1])
        self.points, self.cells = x, c.astype(np.int64)
        self.flip = switch("RigidMesh", "flip", flip)
        self._check()

    @classmethod
    def read(
        cls, path: Any, comm: MPI.Comm = MPI.COMM_WORLD, tags: Any = None, flip: bool = False
    ) -> RigidMesh:
        """Read a surface with gmsh: .msh, .stl and what else gmsh reads. Collective.

        Corners at the same place (STL repeats them) are merged; a mesh in a plane z = const is taken
        as lines in 2D.

        Args:
            path: of the file, read on rank 0
            comm: ranks that get the mesh
            tags: physical groups of the cells to take, one or several; None: all
            flip: as for the mesh

        Raises:
            InputError: on all ranks, a file that gmsh cannot read, or without such cells
        """
        found = None
        with together(comm, "RigidMesh.read"):
            if comm.rank == 0:
                found = _read(file_name("RigidMesh.read", path), tags)
        points, cells = comm.bcast(found, root=0)
        return cls(points, cells, flip)

    def _check(self) -> None:
        """Edges join two cells at most, which run along them in opposite directions."""
        c, x = self.cells, self.points
        n = c.shape[1]
        sides = np.linalg.norm(x[np.roll(c, -1, axis=1)] - x[c], axis=2)
        if np.any(sides <= 1e-14 * np.abs(x).max()):
            at = int(np.argmin(sides.min(axis=1)))
            raise InputError(
                f"RigidMesh: cell {at} has corners {c[at].tolist()} that coincide; remove cells"
                f" without area ({n} different points each)."
            )
        if self.dim == 2:
            ends, count = np.unique(c, return_counts=True)
            twice = any(len(np.unique(c[:, i])) < len(c) for i in (0, 1))
            bad = ends[count > 2]
        else:
            edges = np.stack([c, np.roll(c, -1, axis=1)], axis=2).reshape(-1, 2)
            twice = len(np.unique(edges, axis=0)) < len(edges)
            ends, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
            bad = ends[count > 2].ravel()
        if twice or len(bad):
            raise InputError(
                "RigidMesh: more than two cells meet"
                + (f" at points {bad[:4].tolist()}" if len(bad) else "")
                + " or neighbours turn against each other; make a surface that is a manifold, with"
                " all cells counterclockwise seen from outside (in gmsh: reorient the surfaces)."
            )

    def _surface(self) -> Any:
        """Its facets for the search."""
        shape = {2: "interval", 3: "triangle", 4: "quadrilateral"}[self.cells.shape[1]]
        cells = self.cells[:, [0, 1, 3, 2]] if shape == "quadrilateral" else self.cells
        r = reference_facet(shape, 1, 1)
        basis = _cpp.TraceBasis(
            self.dim - 1, r["position"]["powers"], r["position"]["coefficients"]
        )
        facets = _cpp.Surface(
            self.dim,
            getattr(_cpp.Shape, shape),
            basis,
            basis,
            r["interpolation"],
            r["hull"],
            r["area"],
            np.arange(len(cells)),
            cells,
            cells,
            self.points[cells],
            # σ = −1: τ_1 × τ_2 points out of the material
            np.full(len(cells), 1 if self.flip else -1, dtype=np.int8),
        )
        return _cpp.with_ring(MPI.COMM_SELF.py2f(), facets)  # finds its physical ends

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        tool.add_mesh(
            self._surface(),
            search["target"],
            search["normals"],
            search["radius"],
            search["end_tolerance"],
            search["crease"],
        )


def _read(path: Path, tags: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Points and cells of a file."""
    with gmsh_model(path, "RigidMesh.read") as model:
        nodes, x, _ = model.mesh.getNodes()
        blocks = {
            dim: _cells(model, dim, kind, name, tags)
            for dim, kind, name in ((2, (2, 3), "surface"), (1, (1,), "line"))
        }
    dim = 2 if len(blocks[2]) else 1
    cells = blocks[dim]
    if len(cells) == 0:
        raise InputError(
            f"RigidMesh.read: {str(path)!r} has no triangles or quadrilaterals (or lines, in 2D)"
            + ("" if tags is None else f" in the physical groups {tags!r}")
            + "; give a file with cells of first order, and tags of its groups."
        )
    position = np.zeros(int(nodes.max()) + 1, dtype=np.int64)
    position[nodes.astype(np.int64)] = np.arange(len(nodes))
    x = x.reshape(-1, 3)[:, : dim + 1]
    # corners at one place
    used = np.unique(position[cells])
    size = np.ptp(x[used], axis=0).max()
    _, first, same = np.unique(
        np.round(x[used] / (1e-9 * size)), axis=0, return_index=True, return_inverse=True
    )
    renumbered = np.zeros(len(x), dtype=np.int64)
    renumbered[used] = same.ravel()
    return x[used[first]], renumbered[position[cells]]


def _cells(
    model: Any, dim: int, kinds: tuple[int, ...], name: str, tags: Any
) -> npt.NDArray[np.int64]:
    """Corners of the cells of a dimension, by gmsh's numbers of its first-order types."""
    wanted = None if tags is None else np.atleast_1d(tags).tolist()
    parts: dict[int, list[Any]] = {kind: [] for kind in kinds}
    for _, entity in model.getEntities(dim):
        groups = model.getPhysicalGroupsForEntity(dim, entity)
        if wanted is not None and not set(groups) & set(wanted):
            continue
        for kind, nodes in zip(*model.mesh.getElements(dim, entity)[::2]):
            if kind not in parts:
                raise InputError(
                    f"the {name} {entity} has elements of gmsh's type {kind}; give first-order"
                    " triangles or quadrilaterals (lines in 2D)"
                )
            parts[kind].append(nodes.reshape(-1, {1: 2, 2: 3, 3: 4}[kind]).astype(np.int64))
    if sum(bool(p) for p in parts.values()) > 1:
        raise InputError("the surface has triangles and quadrilaterals; give one kind")
    found = [block for p in parts.values() for block in p]
    return np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)
