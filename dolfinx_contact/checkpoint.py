# SPDX-License-Identifier: MIT
"""Checkpoint files: tables in HDF5 whose rows are found again by their places.

DOLFINx numbers cells and degrees of freedom differently on another number of ranks. A row is
therefore known by where it is in the reference configuration: a degree of freedom by its point and
the mean midpoint of the cells around it (those of two bodies that touch may share the point), a
quadrature point by itself and its cell's midpoint, particles by their facet's midpoint.

Rank 0 alone touches the file; it holds one rank's rows, or one block of the file, at a time.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable

import h5py
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial import cKDTree

from . import compat
from .errors import ContactError, InputError, together

__all__ = ["arrays"]

Array = npt.NDArray[Any]
_FORMAT = "dolfinx_contact checkpoint 1"
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
            part, dofs = V.sub(i).collapse()
            for rows, table in dof_tables(part, f"{label}, part {i}"):
                out.append((np.asarray(dofs)[rows], table))
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


class _Disk:
    """A file for HDF5 to write to, which keeps errors to itself: HDF5 would crash if a disk were
    full (seen in 1.10). After one it takes everything, and writes nothing more."""

    def __init__(self, path: str):
        self._file = open(path, "w+b", buffering=0)
        self.seek, self.tell, self.close = self._file.seek, self._file.tell, self._file.close
        self.failure: OSError | None = None

    def _try(self, action: Callable[..., Any], argument: Any, otherwise: Any) -> Any:
        if self.failure is None:
            try:
                return action(argument)
            except OSError as error:
                self.failure = error
        return otherwise

    def read(self, size: int = -1) -> bytes:
        return self._try(self._file.read, size, b"")

    def readinto(self, buffer: Any) -> int:
        return self._try(self._file.readinto, buffer, 0)

    def write(self, data: Any) -> int:
        return self._try(self._file.write, data, len(data))

    def truncate(self, size: int) -> int:
        return self._try(self._file.truncate, size, size)

    def flush(self) -> None:
        """Nothing is buffered."""

    def finish(self) -> None:
        """Close it when all is on the disk; raises what has failed before."""
        if self.failure is not None:
            raise self.failure
        os.fsync(self._file.fileno())
        self.close()


class _Part:
    """The new file, beside the one that it is to replace. After a failure nothing more is written:
    other ranks may go on sending."""

    def __init__(self, path: str):
        self._path, self._part = path, path + ".part"
        self._disk: _Disk | None = None
        self._file: Any = None
        self._failure: Exception | None = None
        self._attempt(self._open)

    def _attempt(self, action: Callable[[], Any]) -> None:
        if self._failure is None:
            try:
                action()
            except Exception as error:
                self._failure = error

    def _open(self) -> None:
        self._disk = _Disk(self._part)
        self._file = h5py.File(self._disk, "w")

    def create(self, name: str, shape: tuple[int, ...], dtype: Any) -> None:
        self._attempt(lambda: self._file.create_dataset(name, shape, dtype))

    def fill(self, name: str, first: int, rows: Array) -> None:
        part = slice(first, first + len(rows))
        self._attempt(lambda: self._file[name].__setitem__(part, rows))

    def finish(self, figures: dict[str, Any], arrays: dict[str, Array]) -> None:
        """Write what is left, and take the former file's place. Nothing is lost before that."""

        def write() -> None:
            for name, array in arrays.items():
                self._file.create_dataset(f"arrays/{name}", data=array)
            self._file.create_dataset("figures", data=json.dumps(figures, default=_plain))
            self._file.attrs["format"] = _FORMAT

        def replace() -> None:
            self._disk.finish()
            os.replace(self._part, self._path)
            _sync(os.path.dirname(os.path.abspath(self._path)))

        self._attempt(write)
        if self._file is not None:
            self._file.close()
        self._attempt(replace)
        if self._failure is not None:
            if self._disk is not None:
                self._disk.close()
                Path(self._part).unlink(missing_ok=True)
            raise ContactError(
                f"The checkpoint {self._path} could not be written ({self._failure}); a former one"
                " is as it was. Make room, or give another path."
            ) from self._failure


def _sync(folder: str) -> None:
    """Wait until the disk knows the folder's names."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


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
    file = _Part(os.fspath(path)) if comm.rank == 0 else None
    for name, table in tables.items():
        for column, rows in {"places": table.places, **table.columns}.items():
            _put(comm, file, f"tables/{name}/{column}", np.ascontiguousarray(rows))
    with together(comm, "LoadStepping.save"):
        if file is not None:
            file.finish(figures, arrays)


def _put(comm: MPI.Comm, file: _Part | None, name: str, rows: Array) -> None:
    """Write one column of all ranks. Collective."""
    counts = comm.gather(len(rows), root=0)
    if file is None:
        if len(rows):
            comm.Send([rows.view(np.uint8), MPI.BYTE], dest=0)
        return
    file.create(name, (sum(counts), *rows.shape[1:]), rows.dtype)
    file.fill(name, 0, rows)
    first = len(rows)
    for rank, count in enumerate(counts):
        if rank > 0 and count > 0:
            piece = np.empty((count, *rows.shape[1:]), dtype=rows.dtype)
            comm.Recv([piece.view(np.uint8), MPI.BYTE], source=rank)
            file.fill(name, first, piece)
            first += count


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
        self._comm, self._path, self._file = comm, os.fspath(path), None
        self.figures, self.arrays = self._read(self._open)

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._file is not None:
            self._file.close()

    def _open(self) -> Any:
        self._file = h5py.File(self._path, "r")
        if self._file.attrs.get("format") != _FORMAT:
            raise ValueError(f"its format is not {_FORMAT!r}")
        arrays = self._file["arrays"].items() if "arrays" in self._file else ()
        figures = json.loads(self._file["figures"].asstr()[()])
        return figures, {name: array[()] for name, array in arrays}

    def _read(self, action: Callable[[], Any]) -> Any:
        """What an action on rank 0 returns."""
        found = None
        with together(self._comm, "LoadStepping.load"):
            if self._comm.rank == 0:
                try:
                    found = action()
                except FileNotFoundError:
                    raise InputError(f"There is no checkpoint {self._path}.") from None
                except Exception as error:
                    self.__exit__()
                    raise InputError(
                        f"{self._path} is no whole checkpoint of dolfinx_contact ({error}); give a"
                        " file that LoadStepping.save has written."
                    ) from error
        return self._comm.bcast(found, root=0)

    def rows(self, name: str, table: Table) -> tuple[Array, dict[str, Array]]:
        """The file's rows at the places of a table, in the order of the file.

        Returns:
            for each the number of its place here, and the columns

        Raises:
            InputError: on all ranks, if the places of all ranks and of the file are not the same
        """
        total = self._read(lambda: len(self._file[f"tables/{name}/places"]))
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
