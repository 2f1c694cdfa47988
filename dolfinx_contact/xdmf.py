# SPDX-License-Identifier: MIT
"""Files that ParaView reads: numbers in HDF5, and XDMF that says what is where.

Rank 0 writes; the other ranks send it their rows in turn, so that it never holds more than one of them.
A file is written under another name, and takes its place when it is whole and on the disk: a run that
is killed leaves no half-written file under its own name.
"""

from __future__ import annotations

import contextlib
import os
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any, Callable, Sequence
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from .errors import ContactError, InputError, together

TEMPORARY = ".tmp"  # ends the names of files that are being written

#: names of XDMF for cells of degree 1 and 2; those of VTK's order of nodes
_TOPOLOGY = {
    ("point", 1): "Polyvertex",
    ("interval", 1): "Polyline",
    ("interval", 2): "Edge_3",
    ("triangle", 1): "Triangle",
    ("triangle", 2): "Triangle_6",
    ("quadrilateral", 1): "Quadrilateral",
    ("quadrilateral", 2): "Quadrilateral_9",
    ("tetrahedron", 1): "Tetrahedron",
    ("tetrahedron", 2): "Tetrahedron_10",
    ("hexahedron", 1): "Hexahedron",
    ("hexahedron", 2): "Hexahedron_27",
}

#: VTK's corners in the coordinates of Basix, and between which corners the nodes of degree 2 are
_CORNERS = {
    "interval": ([0], [1]),
    "triangle": ([0, 0], [1, 0], [0, 1]),
    "quadrilateral": ([0, 0], [1, 0], [1, 1], [0, 1]),
    "tetrahedron": ([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]),
    "hexahedron": tuple([x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))),
}
_MIDDLES = {
    "interval": ["01"],
    "triangle": ["01", "12", "20"],
    "quadrilateral": ["01", "12", "23", "30", "0123"],
    "tetrahedron": ["01", "12", "20", "03", "13", "23"],
    "hexahedron": (
        ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"]
        + ["0347", "1256", "0145", "2367", "0123", "4567", "01234567"]
    ),
}


def vtk_order(shape: str, points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Which of an element's nodes, at points of the reference cell (nodes, dim), VTK has at each place."""
    corners = np.array(_CORNERS[shape], dtype=float)
    middles = [corners[[int(c) for c in name]].mean(axis=0) for name in _MIDDLES[shape]]
    wanted = np.concatenate([corners, middles])[: len(points)]
    distance = np.linalg.norm(wanted[:, None] - points[None], axis=2)
    order = distance.argmin(axis=1)
    assert distance.min(axis=1).max() < 1e-12 and len(set(order)) == len(points)
    return order


# -- HDF5 -----------------------------------------------------------------------------------------


class File:
    """A new HDF5 file, as a context that all ranks enter together.

    An error of rank 0 waits for the end of the context, since other ranks are sending to it, and is
    then raised on all ranks; the file is not there then.

    Args:
        comm: communicator of those who write
        path: of the file; one of this name is replaced

    Raises:
        ContactError: at the end, on all ranks, if it cannot be written
    """

    def __init__(self, comm: MPI.Comm, path: Path):
        self.comm, self.path = comm, path
        self._temporary = path.with_name(path.name + TEMPORARY)
        self._file, self._disk, self._failure = None, None, None

    def __enter__(self) -> File:
        if self.comm.rank == 0:
            try:
                import h5py

                self._disk = _Disk(self._temporary)
                self._file = h5py.File(self._disk, "w")
            except Exception as error:
                self._failure = error
        return self

    def put(self, name: str, rows: npt.NDArray[Any]) -> ElementTree.Element:
        """Write all ranks' rows, one rank's after the other's. Collective.

        Args:
            name: of the dataset
            rows: this rank's, (n,) or (n, components); integers or float64

        Returns:
            XDMF's DataItem
        """
        kind = np.int64 if rows.dtype.kind in "iu" else np.float64
        rows = np.ascontiguousarray(rows, dtype=kind)
        counts = self.comm.allgather(len(rows))
        shape = (sum(counts), *rows.shape[1:])
        if self.comm.rank > 0:
            self.comm.Send(rows, dest=0)
        else:
            self._try(lambda: self._file.create_dataset(name, shape, kind))
            first = 0
            for rank, count in enumerate(counts):
                if rank > 0:
                    rows = np.empty((count, *shape[1:]), dtype=kind)
                    self.comm.Recv(rows, source=rank)
                self._try(lambda: self._write(name, first, rows))
                first += count
        item = ElementTree.Element(
            "DataItem",
            Dimensions=" ".join(map(str, shape)),
            NumberType="Int" if kind is np.int64 else "Float",
            Precision="8",
            Format="HDF",
        )
        item.text = f"{self.path.name}:/{name}"
        return item

    def _write(self, name: str, first: int, rows: npt.NDArray[Any]) -> None:
        if len(rows) > 0:
            self._file[name].write_direct(rows, None, np.s_[first : first + len(rows)])

    def _try(self, write: Callable[[], Any]) -> None:
        """Write on rank 0, if all has gone well so far."""
        if self._failure is None:
            try:
                write()
                self._failure = self._disk.failure
            except Exception as error:
                self._failure = error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()
        if error is not None:
            return
        with together(self.comm, "Writer"):
            if self.comm.rank == 0:
                self._try(lambda: put_in_place(self._temporary, self.path))
                if self._failure is not None:
                    with contextlib.suppress(OSError):
                        self._temporary.unlink(missing_ok=True)
                    raise ContactError(
                        f"Writer: {self.path} cannot be written: {_reason(self._failure)}"
                    ) from self._failure

    def _close(self) -> None:
        """Close what is open, whatever has happened."""
        for part in (self._file, self._disk):
            if part is not None:
                try:
                    part.close()
                except Exception as error:
                    self._failure = self._failure or error
        if self._disk is not None:
            self._failure = self._failure or self._disk.failure


class _Disk:
    """A file for h5py that never fails, and tells of its failure later: HDF5 would crash at the end
    of the process where it cannot write the last part of a file that it has open."""

    def __init__(self, path: Path):
        self._file = open(path, "w+b", buffering=0)
        for name in ("read", "readinto", "seek", "tell"):
            setattr(self, name, getattr(self._file, name))
        self.failure: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        try:
            while self.failure is None and len(rest) > 0:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self.failure = error
        return len(data)

    def truncate(self, size: int) -> int:
        try:
            self._file.truncate(size)
        except OSError as error:
            self.failure = self.failure or error
        return size

    def flush(self) -> None:
        """Nothing is kept back."""

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or error


def _reason(error: Exception) -> str:
    if isinstance(error, ModuleNotFoundError):
        return "the Python package h5py is missing (Debian: python3-h5py)."
    return f"{error}. Is there space left, and may you write there?"


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a whole file its name, once it is on the disk."""
    with open(temporary, "rb+") as file:
        os.fsync(file.fileno())
    os.replace(temporary, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_text(path: Path, text: str) -> None:
    """Replace a text file by a whole new one."""
    temporary = path.with_name(path.name + TEMPORARY)
    temporary.write_text(text, encoding="utf-8")
    put_in_place(temporary, path)


def last_time(who: str, resume: Any) -> float:
    """The last time that stays when files are resumed: a sum of steps has round-off."""
    if not (isinstance(resume, Real) and np.isfinite(resume)):
        raise InputError(f"{who}: resume is {resume!r}; give the time to go on from, or None.")
    return float(resume) + 1e-12 * abs(float(resume))


# -- XDMF -----------------------------------------------------------------------------------------


def topology(
    file: File, name: str, cells: npt.NDArray[np.int64], shape: str, degree: int
) -> ElementTree.Element:
    """XDMF's Topology of cells whose points are numbered over all ranks, in VTK's order. Collective.

    Args:
        file: to write them to
        name: of the dataset
        cells: this rank's; (n, nodes)
        shape, degree: of the cells; "point" is a cell too, of degree 1
    """
    item = file.put(name, cells)
    element = ElementTree.Element(
        "Topology",
        TopologyType=_TOPOLOGY[shape, degree],
        NumberOfElements=item.get("Dimensions", "").split()[0],
        NodesPerElement=str(cells.shape[1]),
    )
    element.append(item)
    return element


def geometry(file: File, name: str, points: npt.NDArray[np.float64]) -> ElementTree.Element:
    """XDMF's Geometry of this rank's points, (n, 3). Collective."""
    element = ElementTree.Element("Geometry", GeometryType="XYZ")
    element.append(file.put(name, points))
    return element


def attribute(
    file: File, prefix: str, name: str, centre: str, values: npt.NDArray[Any]
) -> ElementTree.Element:
    """XDMF's Attribute of this rank's values. Collective.

    Args:
        file: to write them to
        prefix: of the dataset's name
        name: of the attribute
        centre: "Node" or "Cell"
        values: scalars (n,), vectors (n, 3) or matrices (n, 9)
    """
    kinds = {1: "Scalar", 3: "Vector", 9: "Tensor"}
    components = values.shape[1] if values.ndim > 1 else 1
    element = ElementTree.Element(
        "Attribute", Name=name, AttributeType=kinds[components], Center=centre
    )
    element.append(file.put(f"{prefix}/{name.replace('/', '_')}", values))
    return element


class Series:
    """An .xdmf file: a grid for each time.

    Args:
        path: of the file

    Attributes:
        grids: XDMF's elements, one for each time
    """

    def __init__(self, path: Path):
        self.path = path
        self.grids: list[ElementTree.Element] = []

    @property
    def times(self) -> list[float]:
        return [float(grid.find("Time").get("Value")) for grid in self.grids]

    @property
    def files(self) -> set[str]:
        """Names of the HDF5 files that it needs."""
        items = [item for grid in self.grids for item in grid.iter("DataItem")]
        return {item.text.strip().partition(":")[0] for item in items}

    def read(self) -> None:
        """Take the grids of the file, if there is one.

        Raises:
            InputError: it is not such a file
        """
        if not self.path.exists():
            return
        try:
            collection = ElementTree.parse(self.path).find("Domain/Grid")
            self.grids = [] if collection is None else list(collection.findall("Grid"))
            self.times, self.files
        except (ElementTree.ParseError, AttributeError, TypeError, ValueError) as error:
            raise InputError(
                f"Writer: {self.path} is not a file of dc.Writer ({error}), and cannot be resumed;"
                " give another folder, or begin anew with resume=None."
            ) from None

    def keep(self, last: float) -> None:
        """Drop the grids of later times."""
        self.grids = [grid for grid, t in zip(self.grids, self.times) if t <= last]
        self.write()

    def write(self) -> None:
        """Replace the file."""
        root = ElementTree.Element("Xdmf", Version="3.0")
        domain = ElementTree.SubElement(root, "Domain")
        collection = ElementTree.SubElement(
            domain,
            "Grid",
            Name=self.path.stem,
            GridType="Collection",
            CollectionType="Temporal",
        )
        collection.extend(self.grids)
        ElementTree.indent(root)
        write_text(self.path, ElementTree.tostring(root, encoding="unicode") + "\n")


def append(added: Sequence[tuple[Series, ElementTree.Element]]) -> None:
    """Write series with one more grid each, or none of them if that fails.

    Raises:
        ContactError: a file cannot be written
    """
    for series, grid in added:
        series.grids.append(grid)
    try:
        for series, _ in added:
            series.write()
    except OSError as error:
        for series, grid in added:
            series.grids.remove(grid)
            with contextlib.suppress(OSError):  # where there is no space for less either
                series.write()
        raise ContactError(
            f"Writer: the .xdmf files cannot be written: {_reason(error)}"
        ) from None
