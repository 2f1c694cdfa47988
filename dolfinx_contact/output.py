# SPDX-License-Identifier: MIT
"""Results over time for ParaView: the bodies, the contact surfaces, the particles.

Geometries are the reference ones, with the displacement as a field (ParaView: Warp By Vector).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Sequence
from xml.etree import ElementTree

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from . import compat, xdmf
from .checks import agreed, file_name, is_number
from .errors import ContactError, InputError, together
from .hdf5 import TEMPORARY, NewFile
from .pair import ContactPair
from .watch import postponed, stage

STATUS = ("open", "slip", "stick")  # as 0, 1, 2

#: fields of a grid: name, "Node" or "Cell", values of this rank
Fields = list[tuple[str, str, npt.NDArray[Any]]]

_OURS = r"(bulk|contact|particles)(_\d+)?\.xdmf|step_\d+\.h5|mesh(_\d+)?\.h5"


class Writer:
    """Writes the state accepted last, one time after the other, for ParaView. Collective.

    In the folder are then ``bulk.xdmf``, and for each pair ``contact.xdmf`` and ``particles.xdmf`` (with
    _2, _3, … for further ones); open these. Their numbers are in ``mesh.h5`` and, one a time, in
    ``step_00001.h5``, …. Each of them is put in place when it is whole, so that a run can be killed
    at any moment: all times written before can be opened.

    * bulk: the displacement, and further fields
    * contact: slave facets with the displacement, pressure and friction at their nodes; the means
      over each facet of its particles' gap and slip (nan where none has a target), and which
      fractions of it are closed and stick
    * particles: points with displacement, gap, pressure, friction, slip, normal, the vector to the
      target, and status (0 open, 1 slip, 2 stick); nan where there is no target

    To go on with a run, give ``resume`` the time of the checkpoint; write first and save the
    checkpoint then. The number of ranks may be another one.

    Args:
        folder: made if needed. Without ``resume`` files of these names in it are removed
        u: displacement, or a list of them, of Lagrange degree 1 or 2 [length]
        pairs: contact pairs, or one
        fields: further Functions on the meshes of u, scalars, vectors or matrices: of a Lagrange
            degree not above that of u or of the geometry, "DG" 0, or at quadrature points, of which
            each cell's mean is written
        resume: times up to this one stay as they are, later ones are removed; None: begin anew

    Raises:
        InputError: on all ranks, if u, pairs or fields are something else, two fields of a mesh have
            the same name, or the .xdmf files that are there are not those of a Writer
        ContactError: on all ranks, if the files cannot be written

    Attributes:
        times: those in the files
    """

    def __init__(
        self,
        folder: str | Path,
        u: Any,
        pairs: ContactPair | Sequence[ContactPair] = (),
        fields: Any = (),
        resume: float | None = None,
    ):
        displacements = list(u) if isinstance(u, (list, tuple)) else [u]
        if not displacements or not all(isinstance(v, fem.Function) for v in displacements):
            raise InputError(
                f"Writer: u must be a dolfinx Function, or a list of them; give these for {u!r}."
            )
        self._comm: MPI.Comm = displacements[0].function_space.mesh.comm
        with together(self._comm, "Writer"):
            self.folder = file_name("Writer", folder)
            pairs = _listed(pairs, ContactPair, "pairs")
            fields = list(fields) if isinstance(fields, (list, tuple)) else [fields]
            bulks = [_Bulk(v) for v in displacements]
            for f in fields:
                if not any(bulk.takes(f) for bulk in bulks):
                    raise InputError(
                        f"Writer: fields has {f!r}; give dolfinx Functions on the mesh of u."
                    )
        names = [f.name for f in fields]
        agreed(self._comm, "Writer", u=len(bulks), pairs=len(pairs), fields=names, resume=resume)
        self._grids: dict[str, Any] = {}
        for i, bulk in enumerate(bulks):
            bulk.prepare()
            self._grids[_numbered("bulk", i)] = bulk
        for i, pair in enumerate(pairs):
            self._grids[_numbered("contact", i)] = _Facets(pair)
            self._grids[_numbered("particles", i)] = _Points(pair)
        self._series = {name: xdmf.Series(self.folder / f"{name}.xdmf") for name in self._grids}
        begun = None
        with together(self._comm, "Writer"):
            if self._comm.rank == 0:
                begun = self._begin(resume)
        self.times, self._number, mesh = self._comm.bcast(begun)
        self._write_meshes(mesh)

    def _begin(self, resume: float | None) -> tuple[list[float], int, str]:
        """On rank 0: make the folder, keep what stays.

        Returns:
            times that stay, the highest number of a step's file, a name for the meshes
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            kept: set[str] = set()
            if resume is not None:
                last = xdmf.last_time("Writer", resume)
                for series in self._series.values():
                    series.read()
                for series in self._series.values():
                    series.keep(last)
                    kept |= series.files | {series.path.name}
            ours = {
                file
                for file in self.folder.iterdir()
                if re.fullmatch(_OURS, file.name.removesuffix(TEMPORARY))
            }
            # first those that name the others
            for file in sorted(ours, key=lambda file: file.suffix != ".xdmf"):
                if file.name not in kept:
                    file.unlink()
        except OSError as error:
            raise ContactError(
                f"Writer: the folder {self.folder} cannot be used: {error}; give one where you may"
                " write."
            ) from None
        numbers = {name: [0] for name in ("step", "mesh")}
        for name in kept:
            if name.endswith(".h5"):
                stem, _, number = name[:-3].partition("_")
                numbers[stem].append(int(number or 1))
        mesh = _numbered("mesh", max(numbers["mesh"])) + ".h5"
        times = sorted({t for series in self._series.values() for t in series.times})
        return times, max(numbers["step"]), mesh

    def _write_meshes(self, name: str) -> None:
        self._meshes = {}
        with NewFile(self._comm, self.folder / name, "Writer") as file:
            for name, grid in self._grids.items():
                if not isinstance(grid, _Points):
                    self._meshes[name] = _mesh_elements(file, name, grid)

    def write(self, time: float) -> None:
        """Add a time, with the state accepted last. Collective.

        Args:
            time: any number larger than the last one

        Raises:
            InputError: on all ranks, if the time is not larger than the last one
            ContactError: on all ranks, if a pair has no results yet, or the files cannot be written;
                then nothing has been added
        """
        with together(self._comm, "Writer.write"):
            last = self.times[-1] if self.times else -np.inf
            if not (is_number(time) and last < time < np.inf):
                raise InputError(
                    f"Writer: time is {time!r} after {last}; give larger and larger numbers."
                )
            fields = {name: grid.fields() for name, grid in self._grids.items()}
        agreed(self._comm, "Writer.write", time=time)
        with postponed(self._comm, "Writer.write"), stage("Writer.write"):
            self._add(time, fields)

    def _add(self, time: float, fields: dict[str, Fields]) -> None:
        added = {}
        path = self.folder / f"step_{self._number + 1:05d}.h5"
        with NewFile(self._comm, path, "Writer") as file:
            for name, grid in self._grids.items():
                element = ElementTree.Element("Grid", Name=name, GridType="Uniform")
                ElementTree.SubElement(element, "Time", Value=repr(float(time)))
                element.extend(self._meshes.get(name) or _mesh_elements(file, name, grid))
                for field in fields[name]:
                    element.append(xdmf.attribute(file, name, *field))
                added[name] = element
        with together(self._comm, "Writer.write"):
            if self._comm.rank == 0:
                xdmf.append([(series, added[name]) for name, series in self._series.items()])
        self._number += 1
        self.times.append(float(time))


def _mesh_elements(file: NewFile, name: str, grid: Any) -> list[ElementTree.Element]:
    return [
        xdmf.topology(file, f"{name}/topology", grid.cells, grid.shape, grid.degree),
        xdmf.geometry(file, f"{name}/geometry", grid.points),
    ]


# -- grids: points (n, 3); cells (cells, nodes), in global numbers and VTK's order; shape; degree -------


class _Bulk:
    """A mesh, and Functions on it."""

    def __init__(self, u: fem.Function):
        V = u.function_space
        self._mesh, degree = V.mesh, compat.lagrange_degree(V)
        if degree not in (1, 2) or compat.value_shape(V) != (self._mesh.geometry.dim,):
            raise InputError(
                f"Writer: u has {u.name}, on {V.ufl_element()}; give displacements in Lagrange spaces"
                f" of degree 1 or 2. Other unknowns are fields."
            )
        self.shape = self._mesh.topology.cell_name()
        self.degree = max(degree, compat.coordinate_degree(self._mesh))
        self._functions = {"displacement": u}

    def takes(self, f: Any) -> bool:
        """Add a field, if it is a Function on this mesh; InputError if it does not fit else."""
        if not isinstance(f, fem.Function):
            return False
        V = f.function_space
        if compat.cpp_object(V.mesh) is not compat.cpp_object(self._mesh):
            return False
        size, dim = V.dofmap.index_map_bs, self._mesh.geometry.dim
        degree = compat.lagrange_degree(V)
        nodal = degree is not None and degree <= self.degree
        if not (nodal or _per_cell(V)) or size not in (1, dim, dim**2):
            raise InputError(
                f"Writer: the field {f.name} is on {V.ufl_element()}; give scalars, vectors or matrices"
                f' of Lagrange degree up to {self.degree}, "DG" 0 or at quadrature points, or'
                " interpolate it there."
            )
        if f.name in self._functions:
            raise InputError(
                f"Writer: two fields have the name {f.name}; give each a name of its own (f.name = …;"
                ' u is written as "displacement").'
            )
        self._functions[f.name] = f
        return True

    def prepare(self) -> None:
        """Make points and cells: the nodes of the displacement, or of the geometry if its degree is
        higher. Collective."""
        V = self._functions["displacement"].function_space
        if compat.lagrange_degree(V) != self.degree:
            V = compat.function_space(self._mesh, ("Lagrange", self.degree))
        self._count = V.dofmap.index_map.size_local
        self.points = _three(V.tabulate_dof_coordinates()[: self._count])
        self._nodes = compat.dof_list(V)
        self._owned = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        order = xdmf.vtk_order(self.shape, np.array(self._element(self.degree).points))
        numbers = compat.global_indices(V.dofmap.index_map)
        self.cells = numbers[self._nodes[: self._owned, order]]

    def _element(self, degree: int) -> Any:
        cell = getattr(basix.CellType, self.shape)
        return basix.create_element(basix.ElementFamily.P, cell, degree)

    def fields(self) -> Fields:
        return [self._field(name, f) for name, f in self._functions.items()]

    def _field(self, name: str, f: fem.Function) -> tuple[str, str, npt.NDArray[np.float64]]:
        V = f.function_space
        size = V.dofmap.index_map_bs
        values, dofs = f.x.array.reshape(-1, size), compat.dof_list(V)
        if _per_cell(V):
            return name, "Cell", _column(values[dofs[: self._owned]].mean(axis=1))
        in_cells = values[dofs]
        degree = compat.lagrange_degree(V)
        if degree != self.degree:
            nodes = np.array(self._element(self.degree).points)
            in_cells = self._element(degree).tabulate(0, nodes)[0, :, :, 0] @ in_cells
        # two spaces of one degree may number their nodes in different ways
        at_points = np.zeros((self._nodes.max(initial=-1) + 1, size))
        at_points[self._nodes] = in_cells
        return name, "Node", _column(at_points[: self._count])


class _Facets:
    """The slave's facets, none of which share points."""

    def __init__(self, pair: ContactPair):
        self._pair, slave = pair, pair.slave
        position = slave.reference["position"]
        self._nodes = position["points"]
        self.shape, self.degree = slave.shape, position["degree"]
        self.points = _three(slave.X.reshape(-1, slave.dim))
        rows = _numbers(slave.comm, len(self.points)).reshape(len(slave.X), len(self._nodes))
        self.cells = rows[:, xdmf.vtk_order(self.shape, self._nodes)]

    def fields(self) -> Fields:
        pair, slave = self._pair, self._pair.slave
        table = pair._solved()
        out = [
            ("displacement", "Node", _column((table["slave"] - slave.X).reshape(-1, slave.dim))),
            ("pressure", "Node", self._at_nodes(pair.pressure, pair._psi)),
        ]
        if pair.frictional:
            out.append(("friction", "Node", self._at_nodes(pair.friction, pair._phi)))
        particles, row, n = pair.particles, table["row"], len(slave.X)

        def mean(values: Any, which: Any) -> Any:
            """Over the particles of each facet that are among which, by their areas."""
            weight = np.where(which, particles.weight, 0.0)
            columns = np.atleast_2d(np.where(which, np.transpose(values), 0.0))
            sums = np.stack([np.bincount(row, weight * c, n) for c in columns], axis=1)
            with np.errstate(invalid="ignore"):
                return _column(sums / np.bincount(row, weight, n)[:, None])

        met, all_ = np.isfinite(particles.gap), np.ones(len(row), dtype=bool)
        out += [
            ("gap", "Cell", mean(particles.gap, met)),
            ("slip", "Cell", mean(particles.slip, met)),
        ]
        for name, which in (
            ("closed", particles.status != "open"),
            ("sticking", particles.status == "stick"),
        ):
            out.append((name, "Cell", np.nan_to_num(mean(1.0 * which, all_))))
        return out

    def _at_nodes(self, f: fem.Function, basis: Any) -> npt.NDArray[np.float64]:
        """A Function on the facet mesh, at the nodes of the facets."""
        powers, coefficients = basis[:2]
        N = np.prod(self._nodes[:, None, :] ** powers[None], axis=2) @ coefficients.T
        size = f.function_space.dofmap.index_map_bs
        rows = self._pair.slave.facet_mesh_cells  # of the mesh's cells
        in_cells = f.x.array.reshape(-1, size)[compat.dof_list(f.function_space)[: len(rows)]]
        out = np.empty((len(rows), len(self._nodes), size))
        out[rows] = N @ in_cells
        return _column(out.reshape(-1, size))


class _Points:
    """The particles of a pair."""

    shape, degree = "point", 1

    def __init__(self, pair: ContactPair):
        self._pair = pair

    def fields(self) -> Fields:
        """Brings the points to where the particles are, too: some rules make new ones each step."""
        p = self._pair.particles
        self.points = _three(p.reference)
        columns = {
            "displacement": p.position - p.reference,
            "gap": np.where(np.isfinite(p.gap), p.gap, np.nan),
            "pressure": p.pressure,
            "friction": p.friction,
            "slip": p.slip,
            "normal": p.normal,
            "to_target": p.target - p.position,
            "status": np.array([STATUS.index(status) for status in p.status], dtype=np.int64),
        }
        return [(name, "Node", _column(values)) for name, values in columns.items()]

    @property
    def cells(self) -> npt.NDArray[np.int64]:
        """Collective."""
        return _numbers(self._pair.comm, len(self.points)).reshape(-1, 1)


# -- helpers ---------------------------------------------------------------------------------------


def _listed(given: Any, kind: Any, name: str) -> list[Any]:
    """One thing of a kind, or a list of them, as a list."""
    listed = [given] if isinstance(given, kind) else given
    if not isinstance(listed, (list, tuple)) or not all(isinstance(one, kind) for one in listed):
        raise InputError(
            f"Writer: {name} must be a {kind.__name__}, or a list of them; give these for {given!r}."
        )
    return list(listed)


def _numbered(name: str, i: int) -> str:
    return name if i == 0 else f"{name}_{i + 1}"


def _numbers(comm: MPI.Comm, n: int) -> npt.NDArray[np.int64]:
    """Numbers over all ranks of this rank's n rows. Collective."""
    return np.arange(n) + (comm.scan(n) - n)


def _per_cell(V: Any) -> bool:
    """Whether a space has one value a cell, or values at quadrature points."""
    return compat.is_quadrature(V) or (
        compat.lagrange_degree(V) is None and compat.dof_list(V).shape[1] == 1
    )


def _three(vectors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Vectors of two components with a third one, zero."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _column(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values (n, components), as XDMF has them: scalars (n,), vectors (n, 3), matrices (n, 9)."""
    if values.ndim == 1 or values.shape[1] == 1:
        return values.reshape(-1)
    if values.shape[1] == 4:
        two = np.pad(values.reshape(-1, 2, 2), ((0, 0), (0, 1), (0, 1)))
        return two.reshape(-1, 9)
    return values if values.shape[1] == 9 else _three(values)
