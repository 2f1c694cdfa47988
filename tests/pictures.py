# SPDX-License-Identifier: MIT
"""Reads the .xdmf files of dc.Writer, by VTK's readers or by what XDMF says."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
from mpi4py import MPI

#: VTK's cell for each name in XDMF
CELLS = {
    "Polyvertex": "vtkPolyVertex",
    "Polyline": "vtkPolyLine",
    "Edge_3": "vtkQuadraticEdge",
    "Triangle": "vtkTriangle",
    "Triangle_6": "vtkQuadraticTriangle",
    "Quadrilateral": "vtkQuad",
    "Quadrilateral_9": "vtkBiQuadraticQuad",
    "Tetrahedron": "vtkTetra",
    "Tetrahedron_10": "vtkQuadraticTetra",
    "Hexahedron": "vtkHexahedron",
    "Hexahedron_27": "vtkTriQuadraticHexahedron",
}

#: the readers of VTK are in ParaView's packages; Debian's VTK is built without them. In a process that
#: has MPI they want all ranks to read, while the tests read on rank 0
MODULES = {"vtkXdmfReader": "vtkmodules.vtkIOXdmf2", "vtkXdmf3Reader": "vtkmodules.vtkIOXdmf3"}
READERS = ["plain"] + [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            importlib.util.find_spec(module) is None or MPI.COMM_WORLD.size > 1,
            reason=f"{name} is in python3-paraview, and reads on one rank",
        ),
    )
    for name, module in MODULES.items()
]


@dataclass
class Picture:
    """A grid at a time: points (n, 3), rows of its cells' points, the class of cells in VTK, and
    fields at points and in cells."""

    points: np.ndarray
    cells: np.ndarray
    kind: str
    point_data: dict[str, np.ndarray]
    cell_data: dict[str, np.ndarray]


def read(file: Path, reader: str = "plain") -> tuple[list[float], list[Picture]]:
    """All times of a file, and the grids then."""
    return plain(file) if reader == "plain" else by_vtk(file, reader)


def plain(file: Path) -> tuple[list[float], list[Picture]]:
    def numbers(item):
        name, path = item.text.strip().split(":")
        with h5py.File(Path(file).parent / name, "r") as h5:
            values = h5[path][()]
        assert list(values.shape) == [int(n) for n in item.get("Dimensions").split()]
        assert values.dtype.kind == item.get("NumberType")[0].lower()
        assert values.dtype.itemsize == int(item.get("Precision"))
        return values

    times, pictures = [], []
    for grid in ElementTree.parse(file).findall("Domain/Grid/Grid"):
        times.append(float(grid.find("Time").get("Value")))
        topology, data = grid.find("Topology"), {"Node": {}, "Cell": {}}
        for attribute in grid.findall("Attribute"):
            values = numbers(attribute.find("DataItem"))
            kind = {1: "Scalar", 3: "Vector", 9: "Tensor"}
            components = values.shape[1] if values.ndim > 1 else 1
            assert attribute.get("AttributeType") == kind[components]
            data[attribute.get("Center")][attribute.get("Name")] = values
        cells = numbers(topology.find("DataItem"))
        assert cells.shape == (
            int(topology.get("NumberOfElements")),
            int(topology.get("NodesPerElement")),
        )
        points = numbers(grid.find("Geometry/DataItem"))
        kind = CELLS[topology.get("TopologyType")]
        pictures.append(Picture(points, cells, kind, data["Node"], data["Cell"]))
    return times, pictures


def by_vtk(file: Path, name: str) -> tuple[list[float], list[Picture]]:
    module = importlib.import_module(MODULES[name])
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as pipeline

    def arrays(data):
        every = [data.GetArray(i) for i in range(data.GetNumberOfArrays())]
        return {a.GetName(): np.array(vtk_to_numpy(a)) for a in every}

    reader = getattr(module, name)()
    reader.SetFileName(str(file))
    reader.UpdateInformation()
    times = list(reader.GetOutputInformation(0).Get(pipeline.TIME_STEPS()))
    pictures = []
    for time in times:
        reader.UpdateTimeStep(time)
        grid = reader.GetOutputDataObject(0)
        while not hasattr(grid, "GetPoints"):
            assert grid.GetNumberOfBlocks() == 1
            grid = grid.GetBlock(0)
        kinds, cells = set(), []
        for i in range(grid.GetNumberOfCells()):
            cell = grid.GetCell(i)
            kinds.add(cell.GetClassName())
            cells.append([cell.GetPointId(j) for j in range(cell.GetNumberOfPoints())])
        assert len(kinds) == 1
        points = np.array(vtk_to_numpy(grid.GetPoints().GetData()))
        data = arrays(grid.GetPointData()), arrays(grid.GetCellData())
        pictures.append(Picture(points, np.array(cells), *kinds, *data))
    return times, pictures


def parametric(kind: str) -> np.ndarray:
    """Where a cell of VTK has its points in its own coordinates; (points, 3)."""
    module = importlib.import_module("vtkmodules.vtkCommonDataModel")
    if kind == "vtkPolyLine":
        return np.array([[0.0, 0, 0], [1, 0, 0]])  # one of any number of points
    return np.array(getattr(module, kind)().GetParametricCoords()).reshape(-1, 3)
