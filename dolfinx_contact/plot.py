# SPDX-License-Identifier: MIT
"""Pictures of contact, by matplotlib; no display is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import compat
from .errors import together
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
    facets = gather_pressure(pair)
    with together(pair.comm, "plot.pressure"):
        if facets is not None:
            _draw(facets, pair.slave.dim, Path(file), title)


def gather_pressure(pair: ContactPair) -> tuple[Any, Any] | None:
    """Slave facets and their pressures on rank 0, None elsewhere. Collective.

    Returns:
        current positions of the corners (facets, corners, dim) and pressures there (facets,
        corners)
    """
    pair._solved()
    slave = pair.slave
    powers, coefficients, _ = pair._psi
    corners = slave.reference["position"]["points"][: slave.vertices.shape[1]]
    basis = np.prod(corners[:, None, :] ** powers[None], axis=2) @ coefficients.T
    cells = compat.dof_list(pair.pressure.function_space)[: len(slave.id)]
    values = pair.pressure.x.array[cells] @ basis.T
    X = pair._assembler.slave.x[slave.facet_mesh_cells][:, : len(corners)]
    parts = pair.comm.gather((X, values), root=0)
    if parts is None:
        return None
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _draw(facets: tuple[Any, Any], dim: int, file: Path, title: str | None) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.5), constrained_layout=True)
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
        axes.plot(xf[:, along], pf, "o-", color="tab:blue", markersize=3)
    axes.set_xlabel("xy"[along])
    axes.set_ylabel("contact pressure")
    axes.grid(alpha=0.3)


def _draw_surface(figure: Any, x: Any, p: Any) -> None:
    from matplotlib import cm, colors
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes = figure.add_subplot(projection="3d")
    around = [0, 1, 3, 2] if x.shape[1] == 4 else [0, 1, 2]
    scale = colors.Normalize(p.min(), p.max() if np.ptp(p) > 0 else p.min() + 1)
    faces = Poly3DCollection(x[:, around], edgecolor="k", linewidth=0.2)
    faces.set_facecolor(cm.viridis(scale(p.mean(axis=1))))
    axes.add_collection3d(faces)
    lower, upper = x.reshape(-1, 3).min(axis=0), x.reshape(-1, 3).max(axis=0)
    middle, half = 0.5 * (lower + upper), 0.5 * float(np.max(upper - lower))
    for axis, m in zip("xyz", middle):
        getattr(axes, f"set_{axis}lim")(m - half, m + half)
        getattr(axes, f"set_{axis}label")(axis)
    axes.set_box_aspect((1, 1, 1))
    figure.colorbar(cm.ScalarMappable(scale, cm.viridis), ax=axes, label="contact pressure")
