# SPDX-License-Identifier: MIT
"""Checkpoint files: tables in HDF5 whose rows are found again by their places.

DOLFINx numbers cells and degrees of freedom differently on another number of ranks. A row is
therefore known by where it is in the reference configuration: a degree of freedom by its point and
the mean midpoint of the cells around it (those of two bodies that touch may share the point), a
quadrature point by itself and its cell's midpoint, particles by their facet's midpoint.

Rank 0 alone touches the file; it holds one rank's rows, or one block of the file, at a time (hdf5.py).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, Callable

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial import cKDTree

from . import compat
from .checks import file_name
from .errors import InputError, together
from .hdf5 import NewFile, checksum

__all__ = ["arrays"]

Array = npt.NDArray[Any]
_FORMAT = "dolfinx_contact checkpoint 3"
_BLOCK = 2**16  # rows that are read at once
_NEAR = 1e-6  # places are the same within this part of the smallest cell's size
_COINCIDE = (
    "cells of the mesh coincide, so that it is not known what belongs where; place bodies that lie in"
    " one another apart."
)


# -- places -------------------------------------------------------------------------------------


@dataclass
class Table:
    """Rows of this rank, each at a place.

    Attributes:
        label: what the rows are, for messages
        places: (rows, coordinates) [length]
        size: of the smallest cell on all ranks [length]
        columns: arrays (rows, …)
    """

    label: str
    places: Array
    size: float
    columns: dict[str, Array] = field(default_factory=dict)


def smallest(comm: MPI.Comm, nodes: Array) -> float:
    """Size of the smallest of some cells: its midpoint's distance from the farthest node.
    Collective.

    Args:
        nodes: (cells, nodes, dim)
    """
    radius = np.linalg.norm(nodes - nodes.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    return float(comm.allreduce(radius.min(initial=np.inf), op=MPI.MIN))


def cell_nodes(mesh: Any) -> Array:
    """Reference positions of the nodes of this rank's own cells; (cells, nodes, dim)."""
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    x = np.asarray(mesh.geometry.x)[:, : mesh.geometry.dim]
    return x[compat.cell_geometry_dofs(mesh)[:owned]]


def dof_tables(V: Any, label: str) -> list[tuple[Array, Table]]:
    """Places of a space's degrees of freedom: of each part of a mixed space. Collective.

    Returns:
        for each part its own local dofs, unrolled, (rows, block size), and the table

    Raises:
        InputError: on all ranks, if the degrees of freedom are not values at points
    """
    mesh, size = V.mesh, V.dofmap.index_map_bs
    if size == 1 and V.num_sub_spaces > 0:
        out = []
        for i in range(V.num_sub_spaces):
            part, dofs = compat.collapse(V.sub(i))
            for rows, table in dof_tables(part, f"{label}, part {i}"):
                out.append((dofs[rows], table))
        return out
    try:
        x = np.array(V.tabulate_dof_coordinates())[:, : mesh.geometry.dim]
    except RuntimeError:
        raise InputError(
            f"Checkpoint: {label} lives on {V.ufl_element()}, whose degrees of freedom are no values"
            " at points; such an unknown cannot be saved."
        ) from None
    nodes = cell_nodes(mesh)
    dofs = compat.dof_list(V)[: len(nodes)]
    sums = np.zeros((len(x), mesh.geometry.dim + 1))  # of midpoints, and their number
    midpoints = np.column_stack([nodes.mean(axis=1), np.ones(len(nodes))])
    np.add.at(sums, dofs, midpoints[:, None, :])
    f = fem.Function(V)
    for column in sums.T:
        f.x.array[::size] = column
        compat.scatter_reverse_add(f)
        column[:] = f.x.array[::size]
    owned = V.dofmap.index_map.size_local
    x, sums = x[:owned], sums[:owned]
    places = np.column_stack([x, sums[:, :-1] / sums[:, -1:]])
    table = Table(label, places, smallest(mesh.comm, nodes))
    with together(mesh.comm, "checkpoint"):
        if len(places) and cKDTree(places).query_pairs(_NEAR * table.size):
            raise InputError(f"Checkpoint: {label}: {_COINCIDE}")
    return [(np.arange(owned * size).reshape(-1, size), table)]


# -- writing ------------------------------------------------------------------------------------


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays for JSON, which keeps every digit of a float."""
    return value.tolist()


def write(
    comm: MPI.Comm,
    path: Any,
    figures: dict[str, Any],
    tables: dict[str, Table],
    arrays: dict[str, Array],
) -> None:
    """Write a checkpoint; a former one stays until the new one is whole. Collective.

    Args:
        path: of the file, on rank 0
        figures: what JSON can hold, those of rank 0
        tables: each rank's rows
        arrays: the user's, those of rank 0

    Raises:
        ContactError: on all ranks, if the file cannot be written; the former one is as it was
    """
    with NewFile(comm, path, "LoadStepping.save") as file:
        for name, table in tables.items():
            for column, rows in {"places": table.places, **table.columns}.items():
                file.put(f"tables/{name}/{column}", rows, checked=True)
        if comm.rank == 0:
            for name, array in arrays.items():
                file.add(f"arrays/{name}", array)
            kept = {name: sorted(table.columns) for name, table in tables.items()}
            file.add("figures", json.dumps({**figures, "columns": kept}, default=_plain))
            file.add("format", _FORMAT)


# -- reading ------------------------------------------------------------------------------------


class Checkpoint:
    """A checkpoint to read from. All methods are collective; use it in a ``with`` statement.

    Args:
        comm: communicator
        path: of the file, on rank 0

    Raises:
        InputError: on all ranks, if there is no such file, or it is no whole checkpoint

    Attributes:
        figures, arrays: as written
    """

    def __init__(self, comm: MPI.Comm, path: Any):
        self._comm, self._file = comm, None
        with together(comm, "LoadStepping.load"):
            self._path = str(file_name("LoadStepping.load", path))
        self.figures, self.arrays = self._read(self._open)

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._file is not None:
            self._file.close()

    def _open(self) -> Any:
        import h5py

        self._file = h5py.File(self._path, "r")
        if "format" not in self._file or self._file["format"].asstr()[()] != _FORMAT:
            raise ValueError(f"its format is not {_FORMAT!r}")
        arrays = self._file["arrays"].items() if "arrays" in self._file else ()
        figures = json.loads(_whole(self._file["figures"]))
        return figures, {name: _whole(array) for name, array in arrays}

    def _read(self, action: Callable[[], Any]) -> Any:
        """What an action on rank 0 returns."""
        found = None
        with together(self._comm, "LoadStepping.load"):
            if self._comm.rank == 0:
                try:
                    found = action()
                except FileNotFoundError:
                    raise InputError(
                        f"There is no checkpoint {self._path}; give a file that LoadStepping.save has"
                        " written."
                    ) from None
                except Exception as error:
                    self.__exit__()
                    raise InputError(
                        f"{self._path} is no whole checkpoint of dolfinx_contact ({error}); give a"
                        " file that LoadStepping.save has written."
                    ) from error
        return self._comm.bcast(found, root=0)

    def _rows_of(self, name: str) -> int:
        """On rank 0: the number of rows of a table, all of whose columns are there."""
        columns = self._file[f"tables/{name}"]
        missing = set(self.figures["columns"][name]) - set(columns)
        lengths = {len(column) for column in columns.values()}
        if (
            missing
            or len(lengths) > 1
            or any(c.dtype.kind not in "biuf" for c in columns.values())
        ):
            raise ValueError(
                f"{name} lacks {sorted(missing)}, and has columns of lengths {sorted(lengths)}"
            )
        return lengths.pop()

    def rows(self, name: str, table: Table) -> tuple[Array, dict[str, Array]]:
        """The file's rows at the places of a table, in the order of the file.

        Returns:
            for each the number of its place here, and the columns

        Raises:
            InputError: on all ranks, if the places of all ranks and of the file are not the same
        """
        total = self._read(lambda: self._rows_of(name))
        tree = cKDTree(table.places) if len(table.places) else None
        kept: list[tuple[Array, dict[str, Array]]] = []
        for first in range(0, max(total, 1), _BLOCK):
            part = slice(first, first + _BLOCK)
            block = self._read(
                lambda: {k: v[part] for k, v in self._file[f"tables/{name}"].items()}
            )
            places = block.pop("places")
            at = np.full(len(places), len(table.places))
            if tree is not None and places.shape[1:] == table.places.shape[1:]:
                at = tree.query(places, distance_upper_bound=_NEAR * table.size)[1]
            here = at < len(table.places)
            kept.append((at[here], {k: v[here] for k, v in block.items()}))
        at = np.concatenate([rows for rows, _ in kept])
        found = np.bincount(at, minlength=len(table.places))
        missing, taken = self._comm.allreduce(np.array([np.sum(found == 0), len(at)]))
        if missing > 0 or taken != total:
            raise InputError(
                f"{self._path}: {table.label}: {missing} places of the problem are not in the file,"
                f" and {total - taken} of its {total} rows are nowhere in the problem; resume with"
                " the mesh and tags that the checkpoint is of (on any number of ranks)."
            )
        return at, {k: np.concatenate([c[k] for _, c in kept]) for k in kept[0][1]}

    def columns(self, name: str, table: Table) -> dict[str, Array]:
        """The columns in the order of the table's places, of which each has one row.

        Raises:
            InputError: as ``rows``, and if places coincide
        """
        at, columns = self.rows(name, table)
        if self._comm.allreduce(bool(np.any(np.bincount(at) > 1)), op=MPI.LOR):
            raise InputError(f"{self._path}: {table.label}: {_COINCIDE}")
        order = np.argsort(at)
        return {k: v[order] for k, v in columns.items()}


def _whole(dataset: Any) -> Any:
    """A text or an array that is as it was written."""
    data = dataset.asstr()[()] if dataset.dtype.kind == "O" else dataset[()]
    if dataset.attrs["crc32"] != checksum(data):
        raise ValueError(f"{dataset.name} has been changed since it was written")
    return data


def arrays(path: Any, comm: MPI.Comm = MPI.COMM_WORLD) -> dict[str, Array]:
    """The user's arrays in a checkpoint, without loading it. Collective.

    Args:
        path: of a file that LoadStepping.save has written, on rank 0
        comm: communicator

    Raises:
        InputError: on all ranks, if there is no such file, or it is no whole checkpoint
    """
    with Checkpoint(comm, path) as file:
        return file.arrays
