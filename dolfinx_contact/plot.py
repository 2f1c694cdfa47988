# SPDX-License-Identifier: MIT
"""Pictures of contact, by matplotlib; no display is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import compat
from .errors import ContactError, together
from .pair import ContactPair


def pressure(pair: ContactPair, file: str | Path, title: str | None = None) -> None:
    """Draw the nominal contact pressure of the last accepted solution. Collective.

    In 2D over the arc length of the slave surface, in 3D on the deformed slave surface; only rank 0
    draws.

    Args:
        pair: a pair that has been solved
        file: picture to write; its ending chooses the format
        title: heading

    Raises:
        ContactError: on all ranks, if the pair has not been solved or the file cannot be written
    """
    facets = gather_pressure(pair, parts=4)
    with together(pair.comm, "plot.pressure"):
        if facets is not None:
            _draw(facets, pair.slave.dim, Path(file), title)


def gather_pressure(pair: ContactPair, parts: int = 1) -> tuple[Any, Any] | None:
    """Slave facets and their pressures on rank 0, None elsewhere. Collective.

    Args:
        pair: a pair that has been solved
        parts: cut each facet into this many parts per direction (quadrilaterals and intervals)

    Returns:
        current positions of the corners (pieces, corners, dim) and pressures there (pieces,
        corners); corners in Basix's order
    """
    gathered = _gather(pair, pair.pressure, pair._psi, parts)
    return None if gathered is None else (gathered[0], gathered[1][..., 0])


def gather_friction(pair: ContactPair, parts: int = 1) -> tuple[Any, Any] | None:
    """Slave facets and their friction tractions on rank 0, None elsewhere. Collective.

    Args:
        pair: a pair with friction that has been solved
        parts: as for gather_pressure

    Returns:
        current positions of the corners and nominal friction tractions there, both (pieces,
        corners, dim)

    Raises:
        ContactError: the pair has no friction
    """
    if pair.friction is None:
        raise ContactError("This pair has no friction; make it with friction=μ.")
    return _gather(pair, pair.friction, pair._phi, parts)


def _gather(pair: ContactPair, function: Any, basis: Any, parts: int) -> tuple[Any, Any] | None:
    """Corners of pieces of the slave's facets, and a Function of its mesh there; on rank 0."""
    moved = pair._solved()["slave"]
    slave = pair.slave
    points = _pieces(slave.shape, parts)  # (pieces, corners, facet dimension)
    flat = points.reshape(-1, points.shape[2])

    def tabulated(powers: Any, coefficients: Any) -> Any:
        return np.prod(flat[:, None, :] ** powers[None], axis=2) @ coefficients.T

    position = slave.reference["position"]
    size = function.function_space.dofmap.index_map_bs
    cells = compat.dof_list(function.function_space)[: len(slave.id)]
    at_nodes = function.x.array.reshape(-1, size)[cells]
    values = tabulated(*basis[:2]) @ at_nodes
    x = tabulated(position["powers"], position["coefficients"]) @ moved[slave.facet_mesh_cells]
    gathered = pair.comm.gather((x, values), root=0)
    if gathered is None:
        return None
    corners = points.shape[1]
    return (
        np.concatenate([part[0].reshape(-1, corners, slave.dim) for part in gathered]),
        np.concatenate([part[1].reshape(-1, corners, size) for part in gathered]),
    )


def _pieces(shape: str, parts: int) -> Any:
    """Corners of the pieces of a reference facet; (pieces, corners, facet dimension)."""
    if shape == "triangle":
        return np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    ends = np.stack([np.arange(parts), np.arange(1, parts + 1)], axis=1) / parts
    if shape == "interval":
        return ends[:, :, None]
    corner = [(i, j) for j in range(2) for i in range(2)]
    pairs = [(a, b) for b in range(parts) for a in range(parts)]
    return np.array([[[ends[a, i], ends[b, j]] for i, j in corner] for a, b in pairs])


def _draw(facets: tuple[Any, Any], dim: int, file: Path, title: str | None) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5) if dim == 2 else (7.5, 6))
    FigureCanvasAgg(figure)
    if dim == 2:
        _draw_line(figure.add_subplot(), *facets)
    else:
        _draw_surface(figure, *facets)
    if title:
        figure.suptitle(title)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=120)


def _draw_line(axes: Any, x: Any, p: Any) -> None:
    """Pressure over the abscissa along which the surface is longest."""
    along = int(np.argmax(np.ptp(x.reshape(-1, 2), axis=0)))
    order = np.argsort(x[:, :, along].mean(axis=1))
    for xf, pf in zip(x[order], p[order]):
        axes.plot(xf[:, along], pf, "-", color="tab:blue")
    axes.set_xlabel("xy"[along])
    axes.set_ylabel("contact pressure")
    axes.grid(alpha=0.3)


def _draw_surface(figure: Any, x: Any, p: Any) -> None:
    from matplotlib import cm, colors
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes = figure.add_subplot(projection="3d")
    around = [0, 1, 3, 2] if x.shape[1] == 4 else [0, 1, 2]
    scale = colors.Normalize(p.min(), p.max() if np.ptp(p) > 0 else p.min() + 1)
    faces = Poly3DCollection(x[:, around], linewidth=0.1)
    colours = cm.viridis(scale(p.mean(axis=1)))
    faces.set_facecolor(colours)
    faces.set_edgecolor(colours)
    axes.add_collection3d(faces)
    lower, upper = x.reshape(-1, 3).min(axis=0), x.reshape(-1, 3).max(axis=0)
    middle, half = 0.5 * (lower + upper), 0.5 * float(np.max(upper - lower))
    for axis, m in zip("xyz", middle):
        getattr(axes, f"set_{axis}lim")(m - half, m + half)
        getattr(axes, f"set_{axis}label")(axis)
    axes.set_box_aspect((1, 1, 1), zoom=0.85)
    axes.tick_params(labelsize=8)
    mappable = cm.ScalarMappable(scale, cm.viridis)
    figure.colorbar(mappable, ax=axes, label="contact pressure", shrink=0.7, pad=0.12)
