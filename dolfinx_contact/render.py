# SPDX-License-Identifier: MIT
"""Polygons in space: a picture by VTK where it can open a window, off the screen, else matplotlib's; or a
scene of PyVista's, to turn and zoom."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import numpy.typing as npt

from .errors import ContactError

_PIXELS = (1400, 1050)
_LIGHT = dict(ambient=0.75, diffuse=0.3)  # mostly the colours of the bar, and some shape
_BEHIND = (-0.75, -1.0, 0.65)  # where the camera is, seen from the middle


def draw(
    figure: Any, axes: Any, polygons: list[Any], colours: npt.NDArray[np.float64], edges: bool
) -> Any:
    """Draw polygons in axes; returns the axes they are in.

    Args:
        figure, axes: of matplotlib; axes that are not of its 3D kind are replaced by such if there is
            no VTK, or no display for it
        polygons: arrays (polygons, corners, 3) [length]
        colours: red, green, blue for each, (all polygons, 3), from 0 to 1
        edges: whether they are drawn
    """
    if not hasattr(axes, "get_zlim"):
        with _display() as there:
            image = _by_vtk(polygons, colours, edges) if there else None
        if image is not None:
            axes.imshow(image)
            axes.set_axis_off()
            return axes
        place = axes.get_subplotspec()
        axes.remove()
        axes = figure.add_subplot(place, projection="3d")
    _by_matplotlib(axes, polygons, colours, edges)
    return axes


def _by_matplotlib(axes: Any, polygons: list[Any], colours: Any, edges: bool) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    edge = (0.2, 0.2, 0.2, 0.5) if edges else colours
    faces = [polygon for kind in polygons for polygon in kind]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=colours, edgecolors=edge, linewidths=0.2)
    )
    points = np.concatenate([kind.reshape(-1, 3) for kind in polygons])
    lower, upper = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (lower + upper), 0.5 * float(np.max(upper - lower))
    for axis, m in zip("xyz", middle):
        getattr(axes, f"set_{axis}lim")(m - half, m + half)
        getattr(axes, f"set_{axis}label")(axis)
    axes.set_box_aspect((1, 1, 1), zoom=0.85)
    axes.tick_params(labelsize=8)


def scene(
    polygons: list[Any],
    values: npt.NDArray[np.float64] | None,
    label: str,
    edges: bool,
    **colours: Any,
) -> Any:
    """A Plotter of PyVista's with polygons in it.

    Args:
        polygons: arrays (polygons, corners, 2 or 3) [length]
        values: one for each, or None
        label: of the values
        edges: whether they are drawn
        colours: color, cmap and clim, as for add_mesh

    Raises:
        ContactError: there is no PyVista
    """
    try:
        import pyvista
    except ImportError as error:
        raise ContactError(
            f"plot.view: PyVista cannot be imported ({error}); install it (Debian 13: python3-pyvista),"
            " or draw with plot.bodies or plot.pressure, which do without."
        ) from error
    flat = polygons[0].shape[2] == 2
    data = pyvista.PolyData(*_faces([np.pad(k, [(0, 0)] * 2 + [(0, flat)]) for k in polygons]))
    label = label or "values"
    if values is not None:
        data.cell_data[label] = values
    plotter = pyvista.Plotter()
    plotter.set_background("white")
    shown = {} if values is None else dict(scalars=label, scalar_bar_args=dict(color="black"))
    plotter.add_mesh(data, show_edges=edges, **_LIGHT, **shown, **colours)
    plotter.add_axes(color="black")
    if flat:
        plotter.view_xy()
    else:
        plotter.camera_position = _BEHIND
    return plotter


def _faces(polygons: list[Any]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Points (n, 3), and each polygon's number of corners followed by their numbers, in one row."""
    points = np.concatenate([kind.reshape(-1, 3) for kind in polygons])
    cells, first = [], 0
    for kind in polygons:
        n, corners = kind.shape[:2]
        ids = first + np.arange(n * corners).reshape(n, corners)
        cells.append(np.column_stack([np.full(n, corners), ids]).ravel())
        first += n * corners
    return points, np.concatenate(cells).astype(np.int64)


def _by_vtk(polygons: list[Any], colours: Any, edges: bool) -> Any:
    """An image (rows, columns, 3); None without VTK."""
    try:
        import vtk
        from vtk.util import numpy_support as arrays
    except ImportError:
        return None
    points, ids = _faces(polygons)
    data, where, faces = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    where.SetData(arrays.numpy_to_vtk(points, deep=True))
    faces.SetCells(
        sum(len(kind) for kind in polygons), arrays.numpy_to_vtkIdTypeArray(ids, deep=True)
    )
    data.SetPoints(where)
    data.SetPolys(faces)
    rgb = np.ascontiguousarray(np.rint(255 * colours[:, :3]).astype(np.uint8))
    data.GetCellData().SetScalars(arrays.numpy_to_vtk(rgb, deep=True))
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    actor.GetProperty().SetAmbient(_LIGHT["ambient"])
    actor.GetProperty().SetDiffuse(_LIGHT["diffuse"])
    actor.GetProperty().SetEdgeVisibility(edges)
    actor.GetProperty().SetEdgeColor(0.2, 0.2, 0.2)
    scene, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
    scene.SetBackground(1, 1, 1)
    scene.AddActor(actor)
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(*_PIXELS)
    window.AddRenderer(scene)
    camera = scene.GetActiveCamera()
    camera.SetPosition(*_BEHIND)
    camera.SetFocalPoint(0, 0, 0)
    camera.SetViewUp(0, 0, 1)
    scene.ResetCamera()
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    out = grab.GetOutput()
    columns, rows, _ = out.GetDimensions()
    image = arrays.vtk_to_numpy(out.GetPointData().GetScalars()).reshape(rows, columns, -1)
    window.Finalize()
    return _cropped(image[::-1])


def _cropped(image: Any) -> Any:
    """Without the white around it."""
    ink = np.argwhere((image < 255).any(axis=2))
    if len(ink) == 0:
        return image
    lower, upper = ink.min(axis=0), ink.max(axis=0) + 1
    return image[lower[0] : upper[0], lower[1] : upper[1]].copy()


@contextlib.contextmanager
def _display() -> Iterator[bool]:
    """Whether there is a display that VTK may use: without one it ends the process.

    That of the environment if it answers, else Xvfb where it is installed.
    """
    name = os.environ.get("DISPLAY", "")
    if Path(f"/tmp/.X11-unix/X{name.split(':')[-1].split('.')[0]}").is_socket():
        yield True
        return
    server = shutil.which("Xvfb")
    if server is None:
        yield False
        return
    command = [server, "-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            number = process.stdout.readline().strip()
            os.environ["DISPLAY"] = ":" + number
            yield bool(number)
        finally:
            if name:
                os.environ["DISPLAY"] = name
            else:
                os.environ.pop("DISPLAY", None)
            process.terminate()
