# SPDX-License-Identifier: MIT
"""Meshes by gmsh: read on any ranks, and good for contact; the demo that takes a user's mesh."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
IRONING = Path(__file__).parent.parent / "demos" / "ironing.py"


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path)


def write(file, size, quadrilaterals=False, groups=True):
    """The bodies of demos/ironing.py, by gmsh on rank 0."""
    if COMM.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        geo = gmsh.model.geo
        ends = [(0.2, 4.5), (1.4, 4.5), (1.4, 5.4), (0.2, 5.4), (0.8, 4.95)]
        points = [geo.addPoint(*x, 0) for x in ends]
        arc = geo.addCircleArc(points[0], points[4], points[1])
        sides = [geo.addLine(points[i], points[(i + 1) % 4]) for i in (1, 2, 3)]
        corners = [geo.addPoint(*x, 0) for x in ((0, 0), (12, 0), (12, 4), (0, 4))]
        edges = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        bodies = [geo.addPlaneSurface([geo.addCurveLoop(c)]) for c in ([arc, *sides], edges)]
        geo.synchronize()
        if groups:
            for tag, body in enumerate(bodies, start=1):
                gmsh.model.addPhysicalGroup(2, [body], tag)
            for tag, curve in ((1, sides[1]), (2, edges[0]), (5, arc), (6, edges[2])):
                gmsh.model.addPhysicalGroup(1, [curve], tag)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.RecombineAll", quadrilaterals)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(file))
        gmsh.finalize()
    COMM.barrier()
    return file


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_tags_are_those_of_the_groups(folder, cell):
    file = write(folder / "bodies.msh", 0.4, cell == "quadrilateral")
    mesh, cells, facets = meshes.read_msh(COMM, file, 2)
    assert mesh.topology.cell_name() == cell and mesh.geometry.dim == 2
    one = fem.Constant(mesh, 1.0)
    dx, ds = ufl.dx(subdomain_data=cells, domain=mesh), ufl.ds(subdomain_data=facets, domain=mesh)

    def measure(form):
        return compat.assemble_scalar(COMM, compat.form(form))

    assert measure(one * dx(2)) == pytest.approx(48)
    assert measure(one * dx(1)) == pytest.approx(1.2 * 0.9 + 0.22, abs=0.05)
    assert measure(one * ds(1)) == pytest.approx(1.2)
    assert measure(one * ds(6)) == pytest.approx(12)
    radius, angle = 0.75, 2 * np.arcsin(0.6 / 0.75)
    assert measure(one * ds(5)) == pytest.approx(radius * angle, rel=0.02)
    V = compat.vector_space(mesh, 1)
    arc = dc.Surface(fem.Function(V), facets, 5)
    assert COMM.allreduce(len(arc.id)) > 2


def test_a_mesh_of_the_users_in_a_demo(folder, monkeypatch):
    """Ironing on a mesh by gmsh keeps what the demo asserts: forces in the band of the literature."""
    file = write(folder / "bodies.msh", 0.25, True)
    options = ["--mesh", str(file), "--way", "0.4"]
    monkeypatch.setattr(sys, "argv", [str(IRONING), *options])
    names = runpy.run_path(str(IRONING), run_name="__main__")
    ways = names["ways"]
    assert ways[1][-1][0] == pytest.approx(0.4) and ways[1][-1][3] < -268


def test_files_that_are_none(folder):
    with pytest.raises(dc.InputError if COMM.rank == 0 else dc.ContactError, match="no file"):
        meshes.read_msh(COMM, folder / "none.msh", 2)
    if COMM.rank == 0:
        (folder / "bad.msh").write_text("nonsense")
    COMM.barrier()
    with pytest.raises(dc.ContactError, match="bad.msh"):
        meshes.read_msh(COMM, folder / "bad.msh", 2)
    file = write(folder / "plain.msh", 1.0, groups=False)
    with pytest.raises(dc.ContactError, match="physical groups"):
        meshes.read_msh(COMM, file, 2)
