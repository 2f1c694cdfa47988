# SPDX-License-Identifier: MIT
"""Pictures: what is gathered for them, and that they are drawn on any ranks, without a display."""

import gc
import importlib.util
import os

import numpy as np
import pytest
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from matplotlib.image import imread
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes, render

COMM = MPI.COMM_WORLD
MU = 0.3


def blocks(dim, degree=1, cell=None):
    """Two blocks, pressed and sheared in one step of each; the displacement, pair, reports."""
    cell = cell or {2: "quadrilateral", 3: "hexahedron"}[dim]
    low, mid = [0] * dim, [1] * (dim - 1)
    bodies = [
        meshes.grid([3] * dim, [0.1] * (dim - 1) + [0], [0.9] * (dim - 1) + [0.5], cell=cell),
        meshes.grid([2] * dim, low[:-1] + [-0.5], mid + [0], cell=cell),
    ]
    mesh, body = meshes.create(COMM, bodies)
    at = lambda z: lambda x: np.isclose(x[dim - 1], z)  # noqa: E731
    tags = meshes.tag_facets(mesh, {1: (at(0), 0), 2: (at(0), 1), 3: at(0.5), 4: at(-0.5)}, body)
    V = compat.vector_space(mesh, degree)
    u, w = fem.Function(V, name="u"), ufl.TestFunction(V)
    strain = ufl.sym(ufl.grad(u))
    F = ufl.derivative(100 * ufl.inner(strain, strain) * ufl.dx, u, w)
    top = fem.Function(V)
    bcs = [
        fem.dirichletbc(top, fem.locate_dofs_topological(V, dim - 1, tags.find(3))),
        fem.dirichletbc(np.zeros(dim), fem.locate_dofs_topological(V, dim - 1, tags.find(4)), V),
    ]
    pair = dc.ContactPair(dc.Surface(u, tags, 1), dc.Surface(u, tags, 2), friction=MU)
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    reports = []
    for shift in (0.0, 0.004):
        move = np.zeros(dim)
        move[0], move[-1] = shift, -0.01
        top.interpolate(lambda x: np.tile(move[:, None], x.shape[1]))
        reports.append(problem.solve())
    return u, pair, reports


@pytest.fixture(scope="module", params=[2, 3])
def solved(request):
    return blocks(request.param)


def ink(file):
    """Part of a picture that is not white."""
    return np.mean(imread(file)[:, :, :3].min(axis=2) < 0.98)


def test_bodies_are_where_the_displacement_has_moved_them(solved):
    u, _, _ = solved
    dim = u.function_space.mesh.geometry.dim
    height = fem.Function(compat.function_space(u.function_space.mesh, ("Lagrange", 1)))
    height.interpolate(lambda x: x[dim - 1])
    shapes = dc.plot.gather_bodies(u, height)
    assert (shapes is None) == (COMM.rank > 0)
    if shapes is not None:
        # cells in 2D, all faces in 3D
        count = 3**dim + 2**dim if dim == 2 else 6 * (9 + 4)
        assert len(shapes.polygons) == len(shapes.values) == count
        lower, upper = shapes.bounds
        np.testing.assert_allclose((lower[-1], upper[-1]), (-0.5, 0.49))
        # the field is that of the undeformed heights of the middles, moved by 0.01 at most
        middles = np.array([polygon[:, -1].mean() for polygon in shapes.polygons])
        assert np.abs(middles - shapes.values).max() < 0.011
        assert np.abs(middles - shapes.values).max() > 0.009


def test_areas_of_curved_cells():
    """Outlines of cells of degree 2 follow the curve: the polygons have the deformed area."""
    u, _, _ = blocks(2, degree=2)
    u.interpolate(lambda x: np.array([0 * x[0], 0.3 * x[0] ** 2]))
    shapes = dc.plot.gather_bodies(u)
    if shapes is not None:
        assert shapes.values is None
        for polygon in shapes.polygons:
            x, y = polygon.T
            assert len(polygon) == 16
            assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0
        # the deformation keeps areas; chords of a quarter of an edge are off by 1/16 of the curve
        total = sum(
            0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
            for x, y in (p.T for p in shapes.polygons)
        )
        assert total == pytest.approx(0.8 * 0.5 + 0.5, rel=1e-12)


def test_what_nobody_else_holds(tmp_path):
    """A mesh of DOLFINx frees its communicator as it goes; who asks the ranks later has to hold it."""
    figure = dc.plot.bodies(blocks(2)[0], tmp_path / "bodies.png")
    particles = blocks(2)[1].particles
    gc.collect()
    whole, count = particles.gather(), COMM.allreduce(len(particles))
    assert (figure is None) == (whole is None) == (COMM.rank > 0)
    assert whole is None or len(whole) == count > 0


def test_fields_of_cells_and_vectors(solved):
    u, _, _ = solved
    cells = u.function_space.mesh.topology.index_map(u.function_space.mesh.topology.dim)
    one = np.ones(cells.size_local + cells.num_ghosts)
    shapes, moved = dc.plot.gather_bodies(u, one), dc.plot.gather_bodies(u, u)
    if shapes is not None:
        np.testing.assert_array_equal(shapes.values, 1)
        size = np.hypot(0.004, 0.01)
        assert 0 < moved.values.min() and moved.values.max() < 1.01 * size
        assert moved.values.max() > 0.9 * size


def test_every_picture_is_written(solved, tmp_path):
    u, pair, reports = solved
    folder = COMM.bcast(tmp_path)
    drawn = {
        "bodies": dc.plot.bodies(u, folder / "bodies.png", "bodies", field=u, label="|u|"),
        "pressure": dc.plot.pressure(pair, folder / "pressure.png"),
        "status": dc.plot.status(pair, folder / "status.png"),
    }
    assert all((figure is None) == (COMM.rank > 0) for figure in drawn.values())
    for figure in filter(None, drawn.values()):  # what a notebook asks for
        assert figure._repr_png_().startswith(b"\x89PNG")
    if COMM.rank == 0:
        dc.plot.history([0, 1, 2], {"normal": [0, 1, 2]}, folder / "new" / "history.png")
        dc.plot.convergence(reports, folder / "convergence.png")
        for name in (*drawn, "new/history", "convergence"):
            assert 0.005 < ink(folder / f"{name}.png") < 0.8, name


def test_axes_of_the_user(solved):
    u, pair, reports = solved
    figure = Figure()
    panels = figure.subplots(2, 2).ravel() if COMM.rank == 0 else [None] * 4
    assert dc.plot.bodies(u, axes=panels[0]) in (figure, None)
    dc.plot.pressure(pair, axes=panels[1])
    particles = pair.particles.gather()
    if COMM.rank == 0:
        dc.plot.status(particles, axes=panels[2], title="status")
        dc.plot.convergence(reports[0], axes=panels[3])
        assert panels[2].get_title() == "status"
        labels = {text.get_text() for text in panels[2].get_legend().get_texts()}
        assert labels == set(particles.status)
        bars = panels[3].figure.axes[-1].patches
        changes = np.add(reports[0].status_changes, reports[0].slip_changes)
        np.testing.assert_array_equal([bar.get_height() for bar in bars], changes)


@pytest.mark.parametrize("server", ("none", "of its own"))
def test_without_a_display(solved, tmp_path, monkeypatch, server):
    """VTK ends a process that has no display: it is not asked then."""
    u, _, _ = solved
    folder = COMM.bcast(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    if server == "none":
        monkeypatch.setattr(render.shutil, "which", lambda name: None)
    dc.plot.bodies(u, folder / "plain.png")
    if COMM.rank == 0:
        assert 0.05 < ink(folder / "plain.png") < 0.8
    assert "DISPLAY" not in os.environ


def test_a_scene_to_turn(solved, tmp_path):
    """Where PyVista is, a scene of the bodies or of the pressure; elsewhere all ranks say what to install."""
    u, pair, _ = solved
    dim = u.function_space.mesh.geometry.dim
    file = COMM.bcast(tmp_path) / "view.png"
    if importlib.util.find_spec("pyvista") is None:
        for shown in (u, pair) if dim == 3 else (u,):
            with pytest.raises(dc.ContactError, match="python3-pyvista"):
                dc.plot.view(shown)
        return
    view = dc.plot.view(u, field=u, label="|u|")
    assert (view is None) == (COMM.rank > 0)
    if view is not None:
        shapes, data = dc.plot.gather_bodies(u, u) if COMM.size == 1 else None, view.mesh
        assert data.n_cells == (3**dim + 2**dim if dim == 2 else 6 * (9 + 4))
        np.testing.assert_allclose(np.reshape(data.bounds, (3, 2))[dim - 1], (-0.5, 0.49))
        if shapes is not None:
            np.testing.assert_array_equal(data.cell_data["|u|"], shapes.values)
        if "DISPLAY" in os.environ:
            view.off_screen = True
            view.screenshot(file)
            assert 0.05 < ink(file) < 0.9
        view.close()
    if dim == 2:
        with pytest.raises(dc.InputError, match="plot.pressure"):
            dc.plot.view(pair)
        return
    force, view = pair.resultant()[2], dc.plot.view(pair)
    if view is not None:
        data = view.mesh
        assert data.n_cells == 9 * 16
        # normals are tilted a little
        mean = data.cell_data["contact pressure"].mean()
        assert mean == pytest.approx(force / 0.8**2, rel=1e-3)
        view.close()


def test_input(solved, tmp_path):
    u, _, reports = solved
    folder = COMM.bcast(tmp_path)
    pressure = fem.Function(compat.function_space(u.function_space.mesh, ("Lagrange", 1)))
    for wrong in (3.0, [], pressure):
        with pytest.raises(dc.InputError, match="displacement"):
            dc.plot.bodies(wrong)
    with pytest.raises(dc.InputError, match="one value for each"):
        dc.plot.bodies(u, field=np.ones((2, 2)))
    with pytest.raises(dc.InputError, match="2 fields for 1"):
        dc.plot.bodies(u, field=[u, u])
    with pytest.raises(dc.InputError, match="one value"):
        dc.plot.history([0, 1], {"force": [1, 2, 3]})
    with pytest.raises(dc.InputError, match="Report"):
        dc.plot.convergence([])
    if COMM.rank == 0:
        (folder / "file").write_text("")
    COMM.barrier()
    with pytest.raises(dc.ContactError, match="file"):
        dc.plot.bodies(u, folder / "file" / "picture.png")


def test_mirror_images(solved, tmp_path):
    u, _, _ = solved
    shapes = dc.plot.gather_bodies(u, u)
    if shapes is not None:
        both = dc.plot.bodies([shapes, shapes.mirrored()], tmp_path / "both.png")
        assert isinstance(both, Figure) and ink(tmp_path / "both.png") > 0.05
        whole = type(shapes).together([shapes, shapes.mirrored()])
        assert len(whole.polygons) == len(whole.values) == 2 * len(shapes.polygons)
        lower, upper = whole.bounds
        np.testing.assert_allclose(-lower[0], upper[0])
        np.testing.assert_allclose((lower, upper)[1][1:], shapes.bounds[1][1:])
