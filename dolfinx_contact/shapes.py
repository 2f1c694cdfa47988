# SPDX-License-Identifier: MIT
"""Deformed bodies and slave surfaces as polygons with values, on rank 0, for pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .errors import ContactError, InputError, together
from .pair import ContactPair


@dataclass
class Shapes:
    """Polygons in their present position.

    Attributes:
        corners: for each kind of polygon an array (polygons, corners, dim) [length], in order
            around
        values: one a polygon, in the same order; None without a field
    """

    corners: list[npt.NDArray[np.float64]]
    values: npt.NDArray[np.float64] | None = None

    @property
    def polygons(self) -> list[npt.NDArray[np.float64]]:
        """All polygons, (corners, dim) each."""
        return [polygon for kind in self.corners for polygon in kind]

    @classmethod
    def together(cls, shapes: Sequence[Shapes]) -> Shapes:
        """All of several, with values if each has them.

        Args:
            shapes: of one space
        """
        values = [one.values for one in shapes if one.values is not None]
        corners = [kind for one in shapes for kind in one.corners]
        return cls(corners, np.concatenate(values) if len(values) == len(shapes) else None)

    def mirrored(self, axis: int = 0) -> Shapes:
        """The polygons on the other side of the plane where coordinate ``axis`` is 0.

        Args:
            axis: number of the coordinate
        """
        corners = [kind.copy() for kind in self.corners]
        for kind in corners:
            kind[..., axis] *= -1
        return Shapes(corners, self.values)

    @property
    def bounds(self) -> npt.NDArray[np.float64]:
        """Least and largest coordinates, (2, dim) [length]."""
        points = np.concatenate([kind.reshape(-1, kind.shape[2]) for kind in self.corners])
        return np.array([points.min(axis=0), points.max(axis=0)])


def gather_bodies(u: Any, field: Any = None) -> Shapes | None:
    """Cells (3D: exterior facets) where a displacement has moved them. Collective.

    Edges of bodies with displacements of degree 2 and more are drawn curved.

    Args:
        u: a displacement, or a list of them on several meshes
        field: what colours are to show: a Function (vectors by their magnitude), or an array with
            one value for each owned cell; for several displacements a list of these; None: nothing

    Returns:
        the polygons on rank 0, None elsewhere

    Raises:
        InputError: on all ranks, if u is no displacement, or a field does not fit to it
    """
    moved = list(u) if isinstance(u, (list, tuple)) else [u]
    fields = list(field) if isinstance(field, (list, tuple)) else [field]
    if not moved or not all(isinstance(v, fem.Function) for v in moved):
        raise InputError("plot: give a displacement (a dolfinx Function), or a list of them.")
    if len(fields) != len(moved):
        raise InputError(
            f"plot: {len(fields)} fields for {len(moved)} displacements; give one for each."
        )
    kinds, values = [], []
    for v, f in zip(moved, fields):
        comm = v.function_space.mesh.comm
        found = _outlines(v)
        with together(comm, "plot"):
            dim = v.function_space.mesh.geometry.dim
            own = found[1][..., :dim] + _evaluate(v, *found), _at(f, *found)
        parts = comm.gather(own, root=0)
        if parts is not None:
            kinds.append(np.concatenate([part[0] for part in parts]))
            values.append([part[1] for part in parts])
    if not kinds:
        return None
    flat = [v for each in values for v in each if v is not None]
    return Shapes(kinds, np.concatenate(flat) if flat else None)


def _outlines(u: fem.Function) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Cells (2D: all owned ones; 3D: those of exterior facets) and points around, (n, points, 3).

    Collective.
    """
    mesh = u.function_space.mesh
    tdim = mesh.topology.dim
    if compat.value_shape(u.function_space) != (mesh.geometry.dim,) or tdim < 2:
        raise InputError(
            f"plot: {u.name} is not a displacement of a body in 2D or 3D; its values have the shape"
            f" {compat.value_shape(u.function_space)}."
        )
    kind = getattr(basix.CellType, mesh.topology.cell_name())
    topology = basix.topology(kind)
    if tdim == 2:
        cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
        ways = [list(range(len(topology[0])))]
        which = np.zeros(len(cells), dtype=int)
    else:
        facets = compat.exterior_facets(mesh)
        cells, _ = compat.facet_cells(mesh, facets)
        which = compat.local_facet_indices(mesh, cells, facets)
        ways = [list(facet) for facet in topology[2]]
    ways = [[way[0], way[1], way[3], way[2]] if len(way) == 4 else way for way in ways]
    corners = mesh.geometry.x[compat.cell_geometry_dofs(mesh)[cells]]
    if len(set(map(len, ways))) > 1:
        raise InputError("plot: cells with facets of several shapes (prisms) cannot be drawn.")
    around = corners[np.arange(len(cells))[:, None], np.array(ways)[which]]
    degree = compat.lagrange_degree(u.function_space) or 1
    parts = 1 if degree == 1 else 4
    ahead = np.roll(around, -1, axis=1)
    steps = np.arange(parts)[:, None] / parts
    points = around[:, :, None] * (1 - steps) + ahead[:, :, None] * steps
    return cells, points.reshape(len(cells), -1, 3)


def _at(
    field: Any, cells: npt.NDArray[np.int32], points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64] | None:
    """Mean of a field over the points of each polygon."""
    if field is None:
        return None
    if isinstance(field, fem.Function):
        values = _evaluate(field, cells, points)
        size = values[..., 0] if values.shape[2] == 1 else np.linalg.norm(values, axis=2)
        return size.mean(axis=1)
    values = np.asarray(field, dtype=float)
    if values.ndim != 1 or len(values) <= cells.max(initial=-1):
        raise InputError(
            f"plot: the field has the shape {values.shape}; give a Function, or one value for each"
            " cell of this rank."
        )
    return values[cells]


def _evaluate(
    f: fem.Function, cells: npt.NDArray[np.int32], points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Values at points of cells, (n, points, components)."""
    n, m = points.shape[:2]
    if n == 0:
        return np.zeros((0, m, int(np.prod(compat.value_shape(f.function_space)))))
    values = f.eval(points.reshape(-1, 3), np.repeat(cells, m))
    return np.asarray(values).reshape(n, m, -1)


def gather_pressure(pair: ContactPair, parts: int = 1) -> tuple[Any, Any] | None:
    """Slave facets and their pressures on rank 0, None elsewhere. Collective.

    Args:
        pair: a pair that has been solved
        parts: cut each facet into this many parts per direction (quadrilaterals and intervals)

    Returns:
        current positions of the corners (pieces, corners, dim) [length] and pressures there
        (pieces, corners) [force/reference area]; corners in Basix's order

    Raises:
        InputError: pair is no ContactPair
        ContactError: the pair has not been solved
    """
    _check_pair(pair)
    gathered = gather_slave(pair, pair.pressure, pair._psi, parts)
    return None if gathered is None else (gathered[0], gathered[1][..., 0])


def gather_friction(pair: ContactPair, parts: int = 1) -> tuple[Any, Any] | None:
    """Slave facets and their friction tractions on rank 0, None elsewhere. Collective.

    Args:
        pair: a pair with friction that has been solved
        parts: as for gather_pressure

    Returns:
        current positions of the corners [length] and nominal friction tractions there
        [force/reference area], both (pieces, corners, dim)

    Raises:
        InputError: pair is no ContactPair
        ContactError: the pair has no friction, or has not been solved
    """
    _check_pair(pair)
    if pair.friction is None:
        raise ContactError("This pair has no friction; make it with friction=μ.")
    return gather_slave(pair, pair.friction, pair._phi, parts)


def _check_pair(pair: Any) -> None:
    if not isinstance(pair, ContactPair):
        raise InputError(f"plot: pair is a {type(pair).__name__}; give a ContactPair.")


def gather_slave(
    pair: ContactPair, function: Any, basis: Any, parts: int
) -> tuple[Any, Any] | None:
    """Corners of pieces of the slave's facets, and a Function of its mesh there; on rank 0."""
    moved = pair._solved()["slave"]
    slave = pair.slave
    points = _pieces(slave.shape, parts)  # (pieces, corners, facet dimension)
    flat = points.reshape(-1, points.shape[2])

    def tabulated(powers: Any, coefficients: Any) -> Any:
        return np.prod(flat[:, None, :] ** powers[None], axis=2) @ coefficients.T

    position = slave.reference["position"]
    size = function.function_space.dofmap.index_map_bs
    cells = compat.dof_list(function.function_space)[: len(slave.id)]
    at_nodes = function.x.array.reshape(-1, size)[cells]
    values = tabulated(*basis[:2]) @ at_nodes
    x = tabulated(position["powers"], position["coefficients"]) @ moved[slave.facet_mesh_cells]
    gathered = pair.comm.gather((x, values), root=0)
    if gathered is None:
        return None
    corners = points.shape[1]
    return (
        np.concatenate([part[0].reshape(-1, corners, slave.dim) for part in gathered]),
        np.concatenate([part[1].reshape(-1, corners, size) for part in gathered]),
    )


def _pieces(shape: str, parts: int) -> Any:
    """Corners of the pieces of a reference facet; (pieces, corners, facet dimension)."""
    if shape == "triangle":
        return np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    ends = np.stack([np.arange(parts), np.arange(1, parts + 1)], axis=1) / parts
    if shape == "interval":
        return ends[:, :, None]
    corner = [(i, j) for j in range(2) for i in range(2)]
    pairs = [(a, b) for b in range(parts) for a in range(parts)]
    return np.array([[[ends[a, i], ends[b, j]] for i, j in corner] for a, b in pairs])
