# SPDX-License-Identifier: MIT
"""Pictures of contact, by matplotlib, and VTK for surfaces in space; no display is needed.

Each function draws a figure of its own, which it returns and writes if given a file, or in axes of the
user's. All ranks call it, and rank 0 draws; the others get None, and need no axes. The figures have no
window; a notebook shows those that are returned. Only ``view`` is of another kind: a scene of PyVista's to
turn and zoom, where that is installed.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure

from . import render
from .checks import file_name, numbers
from .errors import ContactError, InputError, together
from .pair import ContactPair
from .particles import Particles
from .report import Report
from .shapes import Shapes, gather_bodies, gather_friction, gather_pressure

__all__ = [
    "Shapes",
    "bodies",
    "convergence",
    "gather_bodies",
    "gather_friction",
    "gather_pressure",
    "history",
    "pressure",
    "status",
    "view",
]

STATUS = {"open": "0.75", "slip": "tab:orange", "stick": "tab:blue"}


def bodies(
    shown: Any,
    file: str | Path | None = None,
    title: str | None = None,
    *,
    field: Any = None,
    label: str = "",
    axes: Any = None,
    clim: tuple[float, float] | None = None,
    cmap: str = "viridis",
    color: Any = "lightsteelblue",
    edges: bool = True,
) -> Any:
    """Draw deformed bodies, coloured by a field. Collective, unless polygons are given.

    Args:
        shown: a displacement, or what ``gather_bodies`` has returned (on other ranks than 0: None);
            or a list of either
        file: picture to write; its ending chooses the format
        title: heading
        field: see gather_bodies
        label: of the field, beside its colours; with its unit
        axes: of matplotlib, to draw in (rank 0)
        clim: least and largest value that the colours tell apart; None: all
        cmap: matplotlib's name of the colours
        color: of bodies without a field
        edges: draw those of the cells

    Returns:
        the figure on rank 0, else None

    Raises:
        InputError: see gather_bodies
        ContactError: on all ranks, if the file cannot be written
    """
    # the communicator lives as long as the mesh, which may be held by `shown` alone
    shapes, comm = _shapes(shown, field)

    def draw(figure: Any, axes: Any) -> None:
        values = shapes.values
        norm = None if values is None else Normalize(*(clim or _range(values)))
        if len(shapes.bounds[0]) == 3:
            n = len(shapes.polygons)

            colours = (
                np.tile(to_rgb(color), (n, 1)) if norm is None else colormaps[cmap](norm(values))
            )
            axes = render.draw(figure, axes, shapes.corners, colours[:, :3], edges)
        else:
            line = dict(edgecolor="0.25", lw=0.25) if edges else dict(edgecolor="face", lw=0.2)
            cells = PolyCollection(shapes.polygons, **line)
            if norm is None:
                cells.set_facecolor(color)
            else:
                cells.set(array=values, norm=norm, cmap=cmap)
            axes.add_collection(cells)
            axes.autoscale_view()
            axes.set_aspect("equal")
        if norm is not None:
            mappable = ScalarMappable(norm, cmap)
            figure.colorbar(mappable, ax=axes, label=label, shrink=0.75)
        if title:
            axes.set_title(title)

    return _picture(draw, comm, shapes is not None, file, axes, "plot.bodies")


def pressure(
    pair: ContactPair,
    file: str | Path | None = None,
    title: str | None = None,
    *,
    axes: Any = None,
    label: str = "contact pressure",
) -> Any:
    """Draw the nominal contact pressure of the last accepted solution. Collective.

    In 2D over the abscissa along which the slave surface is longest, in 3D on the deformed slave
    surface.

    Args:
        pair: a pair that has been solved
        file: picture to write; its ending chooses the format
        title: heading
        axes: of matplotlib, to draw in (rank 0)
        label: of the pressure, with its unit

    Returns:
        the figure on rank 0, else None

    Raises:
        InputError: another thing than a pair
        ContactError: on all ranks, if the pair has not been solved or the file cannot be written
    """
    facets = gather_pressure(pair, parts=4)

    def draw(figure: Any, axes: Any) -> None:
        x, p = facets
        if x.shape[2] == 2:
            along = _along(x.reshape(-1, 2))
            for xf, pf in zip(x, p):
                axes.plot(xf[:, along], pf, "-", color="tab:blue")
            axes.set(xlabel="xy"[along], ylabel=label)
            axes.grid(alpha=0.3)
        else:
            norm = Normalize(*_range(p))
            colours = colormaps["viridis"](norm(p.mean(axis=1)))[:, :3]
            axes = render.draw(figure, axes, [_around(x)], colours, False)
            figure.colorbar(ScalarMappable(norm, "viridis"), ax=axes, label=label, shrink=0.7)
        if title:
            axes.set_title(title)

    return _picture(draw, pair.comm, facets is not None, file, axes, "plot.pressure")


def status(
    shown: ContactPair | Particles,
    file: str | Path | None = None,
    title: str | None = None,
    *,
    axes: Any = None,
    plane: Sequence[int] | None = None,
) -> Any:
    """Draw which particles are open, slip and stick. Collective, unless particles are given.

    In 2D their pressure along the surface; in 3D the particles on a coordinate plane, as large as
    their pressure.

    Args:
        shown: a pair that has been solved, or particles that have been gathered
        file, title, axes: as for pressure
        plane: in 3D the two coordinates to draw; None: those in which the surface is largest

    Returns:
        the figure on rank 0, else None

    Raises:
        InputError: another thing than a pair
        ContactError: on all ranks, if the pair has not been solved or the file cannot be written
    """
    particles, comm = shown, None
    if not isinstance(shown, (ContactPair, Particles, type(None))):
        raise InputError(
            f"plot.status: shown is a {type(shown).__name__}; give a ContactPair, or its particles."
        )
    if isinstance(shown, ContactPair):
        particles, comm = shown.particles.gather(), shown.comm

    def draw(figure: Any, axes: Any) -> None:
        x, p = particles.position, particles.pressure
        if x.shape[1] == 2:
            along = _along(x)
            shown = x[:, along], p
            axes.set(xlabel="xy"[along], ylabel="contact pressure of the particles")
        else:
            i, j = plane or sorted(np.argsort(np.ptp(x, axis=0))[1:])
            shown = x[:, i], x[:, j]
            axes.set(xlabel="xyz"[i], ylabel="xyz"[j], aspect="equal")
        size = 4 + 12 * np.maximum(p, 0) / max(p.max(initial=0), 1e-300)
        for name, colour in STATUS.items():
            k = particles.status == name
            if k.any():
                axes.scatter(*(c[k] for c in shown), s=size[k], color=colour, lw=0, label=name)
        axes.legend()
        if title:
            axes.set_title(title)

    return _picture(draw, comm, particles is not None, file, axes, "plot.status")


def history(
    x: npt.ArrayLike,
    curves: Mapping[str, npt.ArrayLike],
    file: str | Path | None = None,
    title: str | None = None,
    *,
    xlabel: str = "load parameter",
    ylabel: str = "force",
    axes: Any = None,
    style: str = ".-",
) -> Any:
    """Draw forces, or what else was kept, over the steps. For rank 0; no communication.

    Args:
        x: load parameter, time or way, (n,)
        curves: names and values, (n,) each
        file, title, axes: as for pressure
        xlabel, ylabel: with their units
        style: matplotlib's, of the lines

    Returns:
        the figure

    Raises:
        InputError: values of another length than x
        ContactError: the file cannot be written
    """
    x = numbers(x)
    for name, values in curves.items():
        if np.shape(values) != x.shape:
            raise InputError(
                f"plot.history: {name!r} has the shape {np.shape(values)} and x {x.shape}; give one"
                " value for each."
            )

    def draw(figure: Any, axes: Any) -> None:
        for name, values in curves.items():
            axes.plot(x, values, style, label=name, markersize=4)
        axes.set(xlabel=xlabel, ylabel=ylabel)
        axes.grid(alpha=0.3)
        axes.legend()
        if title:
            axes.set_title(title)

    return _picture(draw, None, True, file, axes, "plot.history")


def convergence(
    reports: Report | Sequence[Report],
    file: str | Path | None = None,
    title: str | None = None,
    *,
    axes: Any = None,
) -> Any:
    """Draw residuals and status changes over Newton's iterations. For rank 0; no communication.

    Args:
        reports: of one solve, or of several one after the other
        file, title, axes: as for pressure

    Returns:
        the figure

    Raises:
        InputError: no reports
        ContactError: the file cannot be written
    """
    reports = [reports] if isinstance(reports, Report) else reports
    listed = isinstance(reports, (list, tuple)) and len(reports) > 0
    if not listed or not all(isinstance(report, Report) for report in reports):
        raise InputError(
            f"plot.convergence: reports is {reports!r}; give a Report, or a list of them."
        )

    def draw(figure: Any, axes: Any) -> None:
        first, beside = 0, axes.twinx()
        for report in reports:
            at = first + np.arange(len(report.norms))
            for name, colour in (("bulk", "tab:blue"), ("contact", "tab:orange")):
                # a residual of exactly 0 has no place on a logarithmic axis
                norms = np.array(report.residuals[name])
                axes.semilogy(at, np.where(norms > 0, norms, np.nan), ".-", color=colour)
            changes = np.add(report.status_changes, report.slip_changes)
            beside.bar(at, changes, width=0.8, color="0.85")
            first += len(at)
        for name, colour in (("bulk", "tab:blue"), ("contact", "tab:orange")):
            axes.plot([], [], ".-", color=colour, label=name)
        axes.plot([], [], color="0.85", linewidth=6, label="changes of status (right)")
        axes.set(xlabel="iterations, of one solve after the other", ylabel="residual [force]")
        beside.set_ylabel("particles that changed their status")
        axes.set_zorder(beside.get_zorder() + 1)  # curves before bars
        axes.patch.set_visible(False)
        axes.grid(alpha=0.3)
        axes.legend()
        if title:
            axes.set_title(title)

    return _picture(draw, None, True, file, axes, "plot.convergence")


def view(
    shown: Any,
    *,
    field: Any = None,
    label: str = "",
    clim: tuple[float, float] | None = None,
    cmap: str = "viridis",
    color: Any = "lightsteelblue",
    edges: bool = True,
) -> Any:
    """Deformed bodies, or the pressure on a slave surface in 3D, in a scene of PyVista's. Collective.

    ``show()`` of what is returned opens a window, or in a notebook a view that the mouse turns, and
    needs a display; ``show(screenshot=file)`` also writes a picture.

    Args:
        shown, field: as for bodies; or a pair that has been solved, whose pressure is shown
        label: of the field or the pressure, with its unit
        clim, cmap, color, edges: as for bodies

    Returns:
        a pyvista.Plotter on rank 0, else None; more can be added to it

    Raises:
        InputError: see gather_bodies; a pair in 2D
        ContactError: on all ranks, without PyVista, or if the pair has not been solved
    """
    if isinstance(shown, ContactPair):
        if shown.slave.dim == 2:
            raise InputError("plot.view: this pair is in 2D; draw it with plot.pressure.")
        label = label or "contact pressure"
        comm, facets, shapes = shown.comm, gather_pressure(shown, parts=4), None
        if facets is not None:
            shapes = Shapes([_around(facets[0])], facets[1].mean(axis=1))
    else:
        shapes, comm = _shapes(shown, field)
    plotter = None
    with contextlib.ExitStack() as stack:
        if comm is not None:
            stack.enter_context(together(comm, "plot.view"))
        if shapes is not None:
            plotter = render.scene(
                shapes.corners, shapes.values, label, edges, color=color, cmap=cmap, clim=clim
            )
    return plotter


def _shapes(shown: Any, field: Any) -> tuple[Shapes | None, Any]:
    """What ``bodies`` is to draw, on rank 0, and the ranks that take part; None: this one alone."""
    listed = shown if isinstance(shown, (list, tuple)) else [shown]
    if listed and all(isinstance(one, Shapes) for one in listed):
        return Shapes.together(listed), None
    if shown is None:
        return None, None
    return gather_bodies(shown, field), listed[0].function_space.mesh.comm


def _around(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Corners of facets in order around, from Basix's; (facets, corners, dim)."""
    return x[:, [0, 1, 3, 2] if x.shape[1] == 4 else [0, 1, 2]]


class _Figure(Figure):
    """Shows itself in a notebook, which knows of figures only if pyplot has told it."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


def _picture(
    draw: Any, comm: Any, here: bool, file: str | Path | None, axes: Any, stage: str
) -> Any:
    """The figure in which ``draw`` has drawn where ``here``, written if wanted."""
    figure = None

    def make() -> None:
        nonlocal figure, axes
        if not here:
            return
        if axes is None:
            figure = _Figure(figsize=(7.5, 5), constrained_layout=True)
            FigureCanvasAgg(figure)
            axes = figure.add_subplot()
        else:
            figure = axes.figure
        draw(figure, axes)
        if file is not None:
            try:
                file_name(stage, file).parent.mkdir(parents=True, exist_ok=True)
                figure.savefig(file, dpi=130)
            except (OSError, ValueError) as error:  # of matplotlib: an unknown format
                raise ContactError(
                    f"{stage}: {file} cannot be written ({error}); give another name."
                ) from error

    if comm is None:
        make()
    else:
        with together(comm, stage):
            make()
    return figure


def _range(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Least and largest value, apart from each other."""
    finite = values[np.isfinite(values)]
    low, high = float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf))
    if low > high:
        return 0.0, 1.0
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _along(x: npt.NDArray[np.float64]) -> int:
    """The coordinate in which points spread most."""
    return int(np.argmax(np.ptp(x, axis=0)))
