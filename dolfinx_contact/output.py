# SPDX-License-Identifier: MIT
"""Results over time for ParaView: the bodies, the contact surfaces, the particles; and tables.

Values are in one HDF5 file, which all ranks write together; small XDMF files say what is where.
Geometries are the reference ones, with the displacement as a field (ParaView: Warp By Vector).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .errors import ContactError, InputError, together
from .pair import ContactPair

STATUS = ("open", "slip", "stick")  # as 0, 1, 2

#: names of XDMF for cells of degree 1 and 2
_TOPOLOGY = {
    ("point", 1): "Polyvertex",
    ("interval", 1): "Polyline",
    ("triangle", 1): "Triangle",
    ("triangle", 2): "Triangle_6",
    ("quadrilateral", 1): "Quadrilateral",
    ("quadrilateral", 2): "Quadrilateral_9",
    ("tetrahedron", 1): "Tetrahedron",
    ("tetrahedron", 2): "Tetrahedron_10",
    ("hexahedron", 1): "Hexahedron",
    ("hexahedron", 2): "Hexahedron_27",
}


@dataclass
class Grid:
    """This rank's part of a picture.

    Attributes:
        points: (n, 3)
        cells: rows of a cell's points, numbered over all ranks, in VTK's order
        shape, degree: of the cells
        point_data, cell_data: for each name values (n,) or vectors (n, 3)
    """

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    shape: str
    degree: int = 1
    point_data: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)
    cell_data: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)


class Writer:
    """Writes what was accepted last, a time after the other. All methods are collective.

    In the folder are then ``bulk.xdmf``, for each pair ``contact.xdmf`` and ``particles.xdmf`` (with
    _2, _3, … for further ones), and ``results.h5`` with their numbers.

    * bulk: the displacement, and further fields
    * contact: each slave facet with the displacement, pressure and friction at its corners, and means
      of its particles' gap and slip, and what part of it is closed and sticks
    * particles: points with displacement, gap, pressure, traction, friction, slip, normal, the vector to
      the target, and status (0 open, 1 slip, 2 stick); nan where there is no target

    Args:
        folder: made if needed; its files of these names are overwritten
        u: displacement, or a list of them, of Lagrange degree 1 or 2
        pairs: contact pairs, or one
        fields: further Functions, on spaces of u's mesh: of u's degree, or one value a cell ("DG" 0)

    Raises:
        InputError: on all ranks, if u, pairs or fields are something else
        ContactError: on all ranks, if the files cannot be written
    """

    def __init__(
        self,
        folder: str | Path,
        u: Any,
        pairs: ContactPair | Sequence[ContactPair] = (),
        fields: Sequence[Any] = (),
    ):
        self.folder = Path(folder)
        self._u = list(u) if isinstance(u, (list, tuple)) else [u]
        self._pairs = [pairs] if isinstance(pairs, ContactPair) else list(pairs)
        if not self._u or not all(isinstance(v, fem.Function) for v in self._u):
            raise InputError("Writer: u must be a displacement, or a list of them.")
        if not all(isinstance(pair, ContactPair) for pair in self._pairs):
            raise InputError("Writer: pairs must be ContactPairs.")
        self._comm = self._u[0].function_space.mesh.comm
        self._bulk = [_Bulk(v) for v in self._u]
        for f in fields:
            for bulk in self._bulk:
                if bulk.takes(f):
                    break
            else:
                raise InputError(
                    f"Writer: the field {getattr(f, 'name', f)!r} is not a Function on the mesh of a"
                    ' displacement, of its degree or "DG" 0; interpolate it there.'
                )
        self._times: list[float] = []
        self._xml: dict[str, list[str]] = {}
        with together(self._comm, "Writer"):
            if self._comm.rank == 0:
                self.folder.mkdir(parents=True, exist_ok=True)
        self._open("w").close()

    def write(self, time: float) -> None:
        """Add a time, with the state accepted last.

        Args:
            time: any number, larger than the last one

        Raises:
            InputError: a time that is not larger than the last one
            ContactError: on all ranks, if a pair has no results yet or the files cannot be written
        """
        if self._times and not time > self._times[-1]:
            raise InputError(f"Writer: time is {time} after {self._times[-1]}; give a larger one.")
        with together(self._comm, "Writer.write"):
            grids = {_numbered("bulk", i): bulk.grid() for i, bulk in enumerate(self._bulk)}
            for i, pair in enumerate(self._pairs):
                particles = pair.particles
                grids[_numbered("contact", i)] = contact_grid(pair, particles)
                grids[_numbered("particles", i)] = particles_grid(particles)
        number = len(self._times)
        with self._open("r+") as file:
            for name, grid in grids.items():
                lines = self._xml.setdefault(name, [])
                lines.append(_write(self._comm, file, f"{name}/{number}", grid, time))
        self._times.append(float(time))
        with together(self._comm, "Writer.write"):
            if self._comm.rank == 0:
                for name, lines in self._xml.items():
                    _replace(self.folder / f"{name}.xdmf", _XDMF.format("\n".join(lines)))

    def _open(self, mode: str) -> Any:
        """results.h5, opened on all ranks."""
        import h5py

        options = {}
        with together(self._comm, "Writer"):
            if self._comm.size > 1:
                if not h5py.get_config().mpi:
                    raise ContactError(
                        "Writer: this h5py cannot write on several ranks; install that with MPI"
                        " (Debian: python3-h5py-mpi)."
                    )
                options = {"driver": "mpio", "comm": self._comm}
        with together(self._comm, "Writer"):
            return h5py.File(self.folder / "results.h5", mode, **options)


class _Bulk:
    """A mesh with nodes of a displacement."""

    def __init__(self, u: fem.Function):
        self._V, self._fields = u.function_space, [u]
        self._mesh = self._V.mesh
        self._degree = compat.lagrange_degree(self._V)
        if self._degree not in (1, 2) or len(compat.value_shape(self._V)) != 1:
            raise InputError(
                f"Writer: {u.name} must be a displacement in a Lagrange space of degree 1 or 2."
            )
        n = self._V.dofmap.index_map.size_local
        self._points = _three(self._V.tabulate_dof_coordinates()[:n])
        tdim = self._mesh.topology.dim
        cells = compat.dof_list(self._V)[: self._mesh.topology.index_map(tdim).size_local]
        self._shape = self._mesh.topology.cell_name()
        order = _vtk_order(self._shape, cells.shape[1])
        self._cells = compat.global_indices(self._V.dofmap.index_map)[cells[:, order]]

    def takes(self, f: Any) -> bool:
        """Add a field if it fits."""
        if not isinstance(f, fem.Function) or f.function_space.mesh is not self._mesh:
            return False
        per_cell = f.function_space.dofmap.index_map.size_local == len(self._cells)
        if compat.lagrange_degree(f.function_space) != self._degree and not per_cell:
            return False
        self._fields.append(f)
        return True

    def grid(self) -> Grid:
        grid = Grid(self._points, self._cells, self._shape, self._degree)
        for f in self._fields:
            n, size = f.function_space.dofmap.index_map.size_local, f.function_space.dofmap.index_map_bs
            values = f.x.array[: n * size].reshape(n, size)
            nodal = compat.lagrange_degree(f.function_space) == self._degree
            data = grid.point_data if nodal else grid.cell_data
            data[f.name] = _column(values)
        return grid
