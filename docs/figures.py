# SPDX-License-Identifier: MIT
"""The drawings of docs/mathematics.md, and the pictures that the code of other pages and demos make.

    python3 docs/figures.py       # writes into docs/pictures; part of `make gallery`

Pictures that look as before are left: round-off changes the bytes of a file, if nothing else.
"""

import os
import re
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parent
SLAVE, MASTER, PARTICLE = "#4c78a8", "#e0a458", "#c0392b"
ARROW = dict(arrowstyle="-|>", shrinkA=0, shrinkB=0, linewidth=1.3, mutation_scale=12)


def put(file, name):
    """A picture into docs/pictures, if it looks otherwise than the one that is there."""
    there = DOCS / "pictures" / name
    if there.exists():
        old, new = plt.imread(there), plt.imread(file)
        if old.shape == new.shape and np.abs(old - new).max() < 0.05:
            return
    there.write_bytes(Path(file).read_bytes())
    print("new:", there)


def save(figure, name):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.png"
        figure.savefig(file, dpi=100)
        put(file, file.name)
    plt.close(figure)


def blank(size, columns=1):
    """A figure of drawings without axes."""
    figure, axes = plt.subplots(1, columns, figsize=size, constrained_layout=True, squeeze=False)
    for a in axes[0]:
        a.set_aspect("equal")
        a.axis("off")
    return figure, axes[0]


def arrow(axes, start, end, colour="k"):
    axes.annotate("", end, start, arrowprops=dict(ARROW, color=colour))


def gap():
    """A particle above a curved master: target, normal, gap, tangent."""
    figure, (axes,) = blank((7.5, 3.9))
    s = np.linspace(-2.6, 2.6, 200)
    low = lambda x: -0.12 * x**2  # noqa: E731
    axes.fill_between(s, low(s), -1.6, color=MASTER, alpha=0.45, linewidth=0)
    axes.plot(s, low(s), color=MASTER, linewidth=2)
    top = lambda x: 0.85 + 0.22 * (x - 0.3) ** 2  # noqa: E731
    r = np.linspace(-1.7, 2.2, 100)
    axes.fill_between(r, top(r), 2.1, where=top(r) < 2.1, color=SLAVE, alpha=0.35, linewidth=0)
    axes.plot(r, top(r), color=SLAVE, linewidth=2)

    target = np.array([0.6, low(0.6)])
    tangent = np.array([1, -0.24 * 0.6])
    tangent /= np.linalg.norm(tangent)
    inward = np.array([tangent[1], -tangent[0]])
    # where the outward normal meets the slave
    d = np.linspace(0, 2, 4001)
    line = target - d[:, None] * inward
    particle = line[np.argmin(np.abs(line[:, 1] - top(line[:, 0])))]
    axes.plot(*np.stack([target, particle]).T, "k--", linewidth=1)
    axes.plot(*particle, "o", color=PARTICLE, markersize=8, zorder=5)
    axes.plot(*target, "o", color="k", markersize=6, zorder=5)
    arrow(axes, target, target + 0.75 * inward)
    arrow(axes, target, target + 0.75 * tangent)
    text = dict(fontsize=12)
    axes.text(*(particle + [-0.12, 0.16]), "$x^1 = X + u^1$", color=PARTICLE, ha="right", **text)
    axes.text(*(target + [-0.14, -0.32]), r"$x^2 = \bar Y + u^2$", ha="right", **text)
    axes.text(*(target + 0.75 * inward + [0.08, -0.02]), "$n$", **text)
    axes.text(*(target + 0.75 * tangent + [0.06, 0.05]), r"$\tau_1$", **text)
    axes.text(*(0.5 * (target + particle) + [0.1, 0]), "$-d_n$: gap", **text)
    axes.text(0.55, 1.72, "slave (body 1)", color=SLAVE, **text)
    axes.text(-2.5, -1.45, "master (body 2)", color="#8a5a13", **text)
    axes.set_xlim(-2.6, 2.6)
    axes.set_ylim(-1.6, 2.1)
    save(figure, "gap")


def laws():
    """Both laws as graphs, and the lines along which a particle decides."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.7), constrained_layout=True)
    left.plot([-1.4, 0], [0, 0], color=PARTICLE, linewidth=3)
    left.plot([0, 0], [0, 1.4], color=PARTICLE, linewidth=3, clip_on=False)
    d = np.array([-1.2, 1.2])
    left.plot(d, -1.1 * d, "k:", linewidth=1)
    left.text(-1.3, 0.16, "open: $\\lambda = 0$")
    left.text(0.07, 1.15, "contact: $d_n = 0$")
    left.text(0.45, -0.4, "$g_n = \\lambda - \\rho_n d_n = 0$")
    left.fill_between([-1.4, 0, 1.4], [1.54, 0, -1.54], -1.5, color="0.92", linewidth=0)
    left.text(-1.35, -1.2, "$g_n > 0$", color="0.4")
    left.text(0.75, 0.5, "$g_n < 0$", color="0.4")
    left.set_xlabel("$d_n$ (penetration is positive)")
    left.set_ylabel("pressure $-\\lambda$")
    left.set_title("Signorini")

    right.plot([-1.4, 0, 0, 1.4], [1, 1, -1, -1], color=PARTICLE, linewidth=3)
    right.text(0.08, 0.25, "stick: no slip,\n$\\Vert\\Lambda\\Vert \\leq 1$")
    right.text(-1.35, 1.1, "slip: friction against it")
    right.text(0.42, -1.3, "$\\Vert\\Lambda\\Vert = 1$")
    right.set_xlabel("slip $⟦\\Delta u⟧_\\tau$ in a step")
    right.set_ylabel("friction on the slave / ($\\mu$ × pressure)")
    right.set_title("Coulomb")
    for axes in (left, right):
        axes.axhline(0, color="k", linewidth=0.6)
        axes.axvline(0, color="k", linewidth=0.6)
        axes.set_xlim(-1.4, 1.4)
        axes.set_ylim(-1.5, 1.5)
        axes.set_xticks([])
        axes.set_yticks([])
    save(figure, "laws")


def particles():
    """Points of n-Simpson, n = 0, 1, 2, on the three shapes of facets; areas are weights."""
    import dolfinx_contact as dc

    figure, axes = blank((9, 2.9), 3)
    for n, a in enumerate(axes):
        for shape, place, corners in (
            ("interval", (0.0, 1.35), [[0, 0], [1, 0]]),
            ("quadrilateral", (-0.58, 0.0), [[0, 0], [1, 0], [1, 1], [0, 1]]),
            ("triangle", (0.58, 0.0), [[0, 0], [1, 0], [0, 1]]),
        ):
            rule = dc.Simpson(n).rule(shape, None)
            x, weights = np.array(rule.points), np.array(rule.weights)
            x = np.column_stack([x, np.zeros((len(x), 2 - x.shape[1]))]) + place
            outline = np.array(corners, dtype=float) + place
            closed = np.vstack([outline, outline[:1]])
            a.plot(*closed.T, color=SLAVE, linewidth=1.5)
            size = 90 * weights if shape == "interval" else 300 * weights
            a.scatter(*x.T, s=4 + size, color=PARTICLE, zorder=5, linewidth=0)
        a.set_title(f"Simpson({n})")
        a.set_xlim(-0.7, 1.7)
        a.set_ylim(-0.15, 1.5)
    save(figure, "particles")


def targets():
    """Particles along a line above a ridge and a valley: closest points jump, smooth targets do not."""
    x = np.array([[-2.6, 0.35], [-1.3, -0.35], [0, -0.25], [1.2, 0.45], [2.6, 0.1]])
    edges = np.diff(x, axis=0)
    length = np.linalg.norm(edges, axis=1)
    normals = np.column_stack([-edges[:, 1], edges[:, 0]])  # outward, times the length
    nodal = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    nodal /= np.linalg.norm(nodal, axis=1)[:, None]
    points = np.column_stack([np.linspace(-2.0, 2.0, 15), np.full(15, 0.85)])

    def closest(p):
        s = np.clip(np.sum((p - x[:-1]) * edges, axis=1) / length**2, 0, 1)
        y = x[:-1] + s[:, None] * edges
        return y[np.argmin(np.linalg.norm(p - y, axis=1))]

    def smooth(p):
        # (F6) on each edge by bisection of the cross product
        best = None
        for i in range(len(edges)):
            n = nodal[i : i + 2]

            def f(s):
                (a, b), (c, d) = p - x[i] - s * edges[i], (1 - s) * n[0] + s * n[1]
                return a * d - b * c

            if f(0.0) * f(1.0) > 0:
                continue
            low, high = 0.0, 1.0
            for _ in range(50):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if f(low) * f(middle) > 0 else (low, middle)
            y = x[i] + low * edges[i]
            if best is None or np.linalg.norm(p - y) < np.linalg.norm(p - best):
                best = y
        return best

    figure, axes = blank((9.5, 2.1), 2)
    for a, target, title in zip(
        axes,
        (closest, smooth),
        ("Proximity(): closest points (F4)", "Smooth(): interpolated normals (F6)"),
    ):
        a.fill_between(x[:, 0], x[:, 1], -0.8, color=MASTER, alpha=0.45, linewidth=0)
        a.plot(*x.T, "-", color=MASTER, linewidth=2)
        for p in points:
            y = target(p)
            a.plot(*np.stack([p, y]).T, color="0.35", linewidth=0.9)
            a.plot(*y, "o", color="k", markersize=3)
        a.plot(*points.T, "o", color=PARTICLE, markersize=5)
        if target is smooth:
            for at, n in zip(x[1:-1], nodal[1:-1]):
                arrow(a, at, at + 0.6 * n, SLAVE)
        a.set_title(title, fontsize=11)
        a.set_xlim(-2.6, 2.6)
        a.set_ylim(-0.8, 1.05)
    save(figure, "targets")


def of_page(page, pictures):
    """Run a page's code, and keep some of the files that it writes."""
    text = (DOCS / page).read_text()
    names = {"__name__": "__main__"}
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            blocks = r"^(?:```python|<!-- setup)\n(.*?)^(?:```|-->)$"
            for code in re.findall(blocks, text, re.DOTALL | re.MULTILINE):
                exec(code, names)
            for made, name in pictures.items():
                put(made, name)
        finally:
            os.chdir(here)


if __name__ == "__main__":
    gap()
    laws()
    particles()
    targets()
    of_page("start.md", {"bodies.png": "start_bodies.png", "pressure.png": "start.png"})
    of_page(
        "tutorial.md", {f"{n}.png": f"tutorial_{n}.png" for n in ("shear", "ironing", "status")}
    )
    of_page("howto/pictures.md", {"both.png": "pictures_both.png"})
    for file in sorted((DOCS.parent / "demos" / "pictures").glob("*.png")):
        put(file, file.name)
