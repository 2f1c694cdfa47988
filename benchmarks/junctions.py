# SPDX-License-Identifier: MIT
"""Contact forces while a block slides over junctions of facets, for every target and normal.

A small block with a fixed pressure on its lower side follows a wavy master of straight facets,
over ridges and valleys of up to 12 degrees. The table has, for two spacings of the block's
positions, the largest change of the nodal contact forces from one position to the next, relative
to the forces. If they are a continuous function of the position, half the spacing halves it; where
they jump, the jump stays: it is what the change tends to when the spacing goes to zero,
extrapolated from the two.

    python3 benchmarks/junctions.py --intervals 800 --picture docs/pictures/junctions.png
"""

from __future__ import annotations

import argparse

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

SLAVE, MASTER = 1, 2
DIM = {"quadrilateral": 2, "hexahedron": 3}
KINDS = {"quadrilateral": "Quadrilaterals", "hexahedron": "Hexahedra"}
FACET = 0.2  # width of the master's facets
START, WIDTH, GAP = 0.23, 0.12, 0.1  # of the block, one cell, in each direction along the master
WAY = np.array([0.5, 0.3])  # of the block
CLEARANCE = 0.02  # between the block's corner and the curve that the master's vertices lie on
JUMP = 1e-3  # of the forces: larger ones count


def curve(x):
    """Height of the master's vertices, at points (n, dim)."""
    z = 0.05 * np.sin(5.0 * x[:, 0] + 0.3)
    return z + 0.02 * np.cos(4.0 * x[:, 1]) if x.shape[1] == 3 else z


def choices(dim):
    """Target and normals by name. The direction is oblique, so that it is nobody's normal."""
    e = (0.2, 1.0) if dim == 2 else (0.2, -0.1, 1.0)
    made = [
        (dc.Smooth(), "interpolated"),
        (dc.Proximity(), "facet"),
        (dc.Proximity(), "interpolated"),
        (dc.SeekDirection(e), "facet"),
        (dc.SeekDirection(e), "interpolated"),
        (dc.SeekDirection(e), "direction"),
    ]
    made += [(dc.SlaveNormal(), n) for n in ("facet", "interpolated", "direction")]
    return {(type(target).__name__, n): (target, n) for target, n in made}


def bodies(cell):
    """The block and the master as one mesh, their tags, the displacement and its residual."""
    dim = DIM[cell]
    low, high = np.full(dim, START), np.full(dim, START + WIDTH)
    low[-1], high[-1] = GAP, GAP + WIDTH

    def mapping(x):
        y = x.copy()
        y[:, -1] += (1 + 2 * x[:, -1]) * curve(x)
        return y

    block = meshes.grid((1,) * dim, low, high, cell=cell)
    bottom, top = np.append(np.zeros(dim - 1), -0.5), np.append(np.full(dim - 1, 1.2), 0.0)
    master = meshes.grid((round(1.2 / FACET),) * (dim - 1) + (1,), bottom, top, mapping, cell)
    mesh, body = meshes.create(MPI.COMM_SELF, [block, master])
    tags = meshes.tag_facets(
        mesh,
        {
            SLAVE: (lambda x: np.isclose(x[dim - 1], GAP), 0),
            MASTER: (lambda x: np.isclose(x[dim - 1], curve(x[:dim].T)), 1),
        },
        body,
    )
    u = fem.Function(dc.vector_space(mesh, 1))
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    return u, tags, ufl.inner(u, ufl.TestFunction(u.function_space)) * dx


class Slide:
    """Contact forces as a function of the block's position between 0 and 1."""

    def __init__(self, cell, target, normals):
        self.dim = dim = DIM[cell]
        self.u, tags, F = bodies(cell)
        pair = dc.ContactPair(
            dc.Surface(self.u, tags, SLAVE),
            dc.Surface(self.u, tags, MASTER),
            target=target,
            normals=normals,
            integration=dc.Simpson(0),
            rho_n=1e-3,  # closed at any distance of the block
        )
        self.system = dc.ContactProblem(F, self.u, [pair]).system
        self.system.start()
        self.multiplier = pair._multiplier
        V = self.u.function_space
        nodes = fem.locate_dofs_geometrical(V, lambda x: x[dim - 1] > GAP - 1e-9)
        self.block = (nodes[:, None] * dim + np.arange(dim)).astype(int)

    def __call__(self, position):
        """Nodal forces on block and master, flat, and the resultant on the block."""
        system, dim = self.system, self.dim
        corner, shift = np.full((1, dim), START), np.zeros((1, dim))
        shift[0, :-1] = position * WAY[: dim - 1]
        shift[0, -1] = CLEARANCE - GAP + curve(corner + shift)[0]
        self.u.x.array[self.block] = shift[0]
        self.multiplier.x.array[:] = -1.0
        system.read()
        system.residual(system.x, system.b)  # finds the targets
        assembler = system.contacts[0].assembler
        table = assembler.particles()
        if not table["closed"].all():
            raise RuntimeError("a particle is open: the pressure is not the same everywhere")
        system.b.zeroEntries()
        assembler.residual(system.b.handle)
        system.b.assemble()
        forces = system.b.array_r[system.layout.slice(0)].copy()
        return forces, table["weight"] @ table["traction"]


def measure(cell, target, normals, intervals):
    """Largest changes of the nodal forces at the two spacings, relative to the forces; and at the
    finer one the changes, the positions and the resultants."""
    slide = Slide(cell, target, normals)
    positions = np.linspace(0, 1, 2 * intervals + 1)
    forces, resultants = (np.array(part) for part in zip(*map(slide, positions)))
    size = np.linalg.norm(forces, axis=1).mean()
    coarse, fine = (
        np.linalg.norm(np.diff(forces[::step], axis=0), axis=1) / size for step in (2, 1)
    )
    return (coarse.max(), fine.max()), fine, positions, resultants


def jump(changes):
    """What the largest change tends to: c(h) = jump + s h."""
    return max(0.0, 2 * changes[1] - changes[0])


def word(changes):
    return "jumps" if jump(changes) > JUMP else "continuous"


def table(cell, intervals, results):
    """Markdown."""
    print(f"\n{KINDS[cell]}, {intervals} and {2 * intervals} intervals:\n")
    print("| target | normals | largest change | at half the spacing | ratio | jump | |")
    print("|---|---|---|---|---|---|---|")
    for (target, normals), (changes, *_) in results.items():
        coarse, fine = changes
        print(
            f"| `{target}` | {normals} | {100 * coarse:.2f} % | {100 * fine:.2f} % |"
            f" {coarse / fine:.2f} | {100 * jump(changes):.2f} % | {word(changes)} |"
        )


def draw(results, file):
    """Resultant on the block, and change of the nodal forces from one position to the next,
    against the block's position; one row for each choice (2D)."""
    import matplotlib.pyplot as plt

    rows = len(results) + 1
    figure, axes = plt.subplots(
        rows,
        3,
        figsize=(12, 1.15 * rows + 0.9),
        sharex=True,
        gridspec_kw={"height_ratios": [1.2] + [1] * (rows - 1)},
        constrained_layout=True,
    )
    vertices = np.arange(0, 1.2 + 1e-9, FACET)
    heights = curve(np.column_stack([vertices, 0 * vertices]))
    every = np.concatenate([resultants for *_, resultants in results.values()]) / WIDTH
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.12 * (high - low)
    titles = (
        "horizontal force on the block\n/ (pressure × width)",
        "vertical force on the block\n/ (pressure × width)",
        "change of the nodal forces between\npositions / nodal forces",
    )
    for ax, title in zip(axes[0], titles):
        ax.plot(vertices, heights, "o-", color="0.3", ms=4)
        ax.set_ylim(-0.1, 0.1)
        ax.set_yticks([])
        ax.set_title(title, fontsize=10)
    axes[0, 0].set_ylabel("master", rotation=0, ha="right", va="center", fontsize=9)
    for row, ((target, normals), (changes, steps, at, resultants)) in zip(
        axes[1:], results.items()
    ):
        color = "C3" if word(changes) == "jumps" else "C0"
        middle = START + WIDTH / 2 + at * WAY[0]
        for i, ax in enumerate(row[:2]):
            ax.plot(middle, resultants[:, i] / WIDTH, color=color, lw=1.4)
            ax.set_ylim(low[i] - margin[i], high[i] + margin[i])
        row[2].semilogy(middle[1:], np.maximum(steps, 1e-9), color=color, lw=1.1)
        row[2].set_ylim(1e-4, 0.5)
        row[2].set_yticks([1e-4, 1e-2], ["0.01 %", "1 %"])
        row[2].minorticks_off()
        label = f"{target}\n{normals} normals\n{word(changes)}"
        row[0].set_ylabel(label, rotation=0, ha="right", va="center", fontsize=9)
    for ax in axes.ravel():
        ax.tick_params(labelsize=8)
        for x in vertices:
            ax.axvline(x, color="0.85", lw=0.8, zorder=0)
    for ax in axes[-1]:
        ax.set_xlabel("middle of the block", fontsize=9)
    axes[0, 0].set_xlim(START + WIDTH / 2, START + WIDTH / 2 + WAY[0])
    figure.savefig(file, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--intervals", type=int, default=800, help="at the wider spacing (800)")
    parser.add_argument("--picture", help="file to draw the forces of the 2D block to")
    options = parser.parse_args()
    for cell in DIM:
        results = {
            name: measure(cell, *choice, options.intervals)
            for name, choice in choices(DIM[cell]).items()
        }
        table(cell, options.intervals, results)
        if options.picture and DIM[cell] == 2:
            draw(results, options.picture)


if __name__ == "__main__":
    main()
