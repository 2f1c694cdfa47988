# SPDX-License-Identifier: MIT
"""Files that ParaView reads: numbers in HDF5, and XDMF that says what is where."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, Sequence
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from .checks import is_number
from .errors import ContactError, InputError
from .hdf5 import NewFile, reason, write_text

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


def last_time(who: str, resume: Any) -> float:
    """The last time that stays when files are resumed: a sum of steps has round-off."""
    if not is_number(resume) or not np.isfinite(resume):
        raise InputError(f"{who}: resume is {resume!r}; give the time to go on from, or None.")
    return float(resume) + 1e-12 * abs(float(resume))


# -- XDMF -----------------------------------------------------------------------------------------


def data_item(file: NewFile, name: str, rows: npt.NDArray[Any]) -> ElementTree.Element:
    """Write all ranks' rows, and say where they are: XDMF's DataItem. Collective.

    Args:
        file: to write them to
        name: of the dataset
        rows: this rank's, (n,) or (n, components); integers or floating-point numbers
    """
    kind = np.int64 if rows.dtype.kind in "iu" else np.float64
    shape = file.put(name, rows.astype(kind, copy=False))
    item = ElementTree.Element(
        "DataItem",
        Dimensions=" ".join(map(str, shape)),
        NumberType="Int" if kind is np.int64 else "Float",
        Precision="8",
        Format="HDF",
    )
    if file.comm.rank == 0:
        item.text = f"{file.path.name}:/{name}"
    return item


def topology(
    file: NewFile, name: str, cells: npt.NDArray[np.int64], shape: str, degree: int
) -> ElementTree.Element:
    """XDMF's Topology of cells whose points are numbered over all ranks, in VTK's order. Collective.

    Args:
        file: to write them to
        name: of the dataset
        cells: this rank's; (n, nodes)
        shape, degree: of the cells; "point" is a cell too, of degree 1
    """
    item = data_item(file, name, cells)
    element = ElementTree.Element(
        "Topology",
        TopologyType=_TOPOLOGY[shape, degree],
        NumberOfElements=item.get("Dimensions", "").split()[0],
        NodesPerElement=str(cells.shape[1]),
    )
    element.append(item)
    return element


def geometry(file: NewFile, name: str, points: npt.NDArray[np.float64]) -> ElementTree.Element:
    """XDMF's Geometry of this rank's points, (n, 3). Collective."""
    element = ElementTree.Element("Geometry", GeometryType="XYZ")
    element.append(data_item(file, name, points))
    return element


def attribute(
    file: NewFile, prefix: str, name: str, centre: str, values: npt.NDArray[Any]
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
    element.append(data_item(file, f"{prefix}/{name.replace('/', '_')}", values))
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
        raise ContactError(f"Writer: the .xdmf files cannot be written: {reason(error)}") from None
