# SPDX-License-Identifier: MIT
"""Which displacements, pressures and particles fit together? The numerical inf-sup test.

Two bodies lie on each other along a flat or a curved interface. For each choice the inf-sup constant
(dolfinx_contact/infsup.py) is computed on a sequence of refined meshes; it must not fall. Layers of
cells grow geometrically away from the interface, where the first is as high as a facet is long: the
constants are those of uniform meshes to 0.2 %, at a tenth of the unknowns.

Verdicts, from the constants of the last three of five refinements, and of the last two of three in 3D:

* zero: the last is below 1e-6. Some pressure has no effect on any displacement.
* falls: one is below 0.9 times the one before.
* weak: none falls, but the last is less than a quarter of that of continuous pressures of degree 1 on
  the same meshes.
* stable: all else.

It takes about 15 minutes, and ends with 1 if infsup.doubt warns of a choice that is stable everywhere,
or does not warn of one that is not stable somewhere.

    python3 benchmarks/infsup.py --small
    python3 benchmarks/infsup.py --output docs/infsup.md --picture docs/pictures/infsup.png
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import infsup, meshes

COMM = MPI.COMM_WORLD
PRESSURES = (("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1))
RULES = (dc.Nodes(), dc.Simpson(0), dc.Simpson(1), dc.Simpson(2), dc.Segments())
SHOWN = dc.Simpson(1)  # the default; its constants are given in full
# slave and master facets at refinement k, by the name of the column; no master: a rigid plane
PLANE = {
    "8:8": lambda k: (8 * 2**k, 8 * 2**k),
    "n+1:n": lambda k: (8 * 2**k + 1, 8 * 2**k),
    "11:8": lambda k: (11 * 2**k, 8 * 2**k),
    "10:3": lambda k: (10 * 2**k, 3 * 2**k),
    "8:11": lambda k: (8 * 2**k, 11 * 2**k),
    "3:10": lambda k: (3 * 2**k, 10 * 2**k),
    "rigid": lambda k: (8 * 2**k, None),
}
# the same along each edge in 3D, by degree of the displacement
SOLID = {
    1: {
        "3:3": lambda k: (6 * k + 6, 6 * k + 6),
        "4:3": lambda k: (8 * k + 8, 6 * k + 6),
        "3:4": lambda k: (6 * k + 6, 8 * k + 8),
        "2:5": lambda k: (4 * k + 4, 10 * k + 10),
        "rigid": lambda k: (6 * k + 6, None),
    },
    2: {
        "2:2": lambda k: (2 * k + 4, 2 * k + 4),
        "3:2": lambda k: (3 * k + 6, 2 * k + 4),
        "2:3": lambda k: (2 * k + 4, 3 * k + 6),
        "1:3": lambda k: (k + 2, 3 * k + 6),
        "rigid": lambda k: (2 * k + 4, None),
    },
}
RADIUS = 2.0  # of the arc

# -- the bodies ---------------------------------------------------------------------------------------


def layers(h, most):
    """Heights of the layers' faces from 0 to 1: the first layer is h high, and each of the others
    about `most` times as high as the one before it."""
    n = max(1, int(np.ceil(np.log1p((most - 1) / h) / np.log(most))))
    powers = np.arange(n)
    low, high = 1.0, 2 * most + 1 / h
    for _ in range(200):  # h Σ q^i = 1 for the growth q
        q = (low + high) / 2
        low, high = (q, high) if h * np.sum(q**powers) < 1 else (low, q)
    return np.concatenate([[0.0], np.cumsum(q**powers) / np.sum(q**powers)])


def body(count, first, up, shape, cell, degree):
    """A slab of extent 2 (3D: 1) and height 1, above or below the interface."""
    solid = cell in ("tetrahedron", "hexahedron")
    faces = layers(first, 2.0 if solid else 1.5)

    def mapping(x):
        z = np.interp(x[:, -1] * (len(faces) - 1), np.arange(len(faces)), faces) * (
            1 if up else -1
        )
        if shape == "flat":
            return np.column_stack([x[:, :-1], z])
        angle, r = x[:, 0] / RADIUS, RADIUS - z  # the slave is inside
        return np.column_stack([r * np.sin(angle), -r * np.cos(angle)])

    lower, upper = ((0, 0, 0), (1, 1, 1)) if solid else ((-1, 0), (1, 1))
    counts = (count,) * (2 if solid else 1) + (len(faces) - 1,)
    return meshes.grid(counts, lower, upper, mapping, cell, degree if shape == "arc" else 1)


def surfaces(counts, shape, cell, degree):
    """Slave and master (or a rigid plane) of a pair. Collective."""
    solid = cell in ("tetrahedron", "hexahedron")
    extent = 1 if solid else 2
    first = extent / counts[0]
    bodies = [body(counts[0], first, True, shape, cell, degree)]
    if counts[1] is not None:
        bodies.append(body(counts[1], extent / counts[1], False, shape, cell, degree))
    mesh, number = meshes.create(COMM, bodies)

    def interface(x):
        if shape == "flat":
            return np.isclose(x[mesh.geometry.dim - 1], 0)
        return np.isclose(np.hypot(x[0], x[1]), RADIUS)

    sides = {tag: (interface, tag) for tag in range(len(bodies))}
    tags = meshes.tag_facets(mesh, sides, number)
    u = fem.Function(dc.vector_space(mesh, degree))
    if counts[1] is None:
        normal = np.eye(mesh.geometry.dim)[-1]
        return dc.Surface(u, tags, 0), dc.RigidPlane(0 * normal, normal)
    return dc.Surface(u, tags, 0), dc.Surface(u, tags, 1)


# -- the constants ------------------------------------------------------------------------------------


@dataclass
class Series:
    """Constants of one choice on a sequence of meshes."""

    shape: str  # of the interface: "flat" or "arc"
    cell: str
    degree: int  # of the displacement
    meshes: str
    space: tuple[str, int]
    rule: object
    sizes: list[float]  # of the slave's facets
    values: list[float]
    verdict: str = ""

    @property
    def name(self):
        return f"{'P' if self.space[0] == 'Lagrange' else 'DG'}{self.space[1]}"


def measure(shape, cell, degree, name, family, rules, refinements):
    """All choices of pressure and particles on a sequence of meshes. Collective."""
    found = {(space, rule): [] for space in PRESSURES for rule in rules}
    sizes = []
    for k in range(refinements):
        slave, master = surfaces(family(k), shape, cell, degree)
        sizes.append((1 if slave.dim == 3 else 2) / family(k)[0])
        for (space, rule), values in found.items():
            try:
                pair = dc.ContactPair(slave, master, pressure_space=space, integration=rule)
                values.append(infsup.constant(pair))
            except dc.InputError:  # nodal rules with degree 2 on triangles
                values.append(np.nan)
    series = []
    for (space, rule), values in found.items():
        best = found[PRESSURES[0], rule][-1]
        series.append(Series(shape, cell, degree, name, space, rule, sizes, values))
        series[-1].verdict = verdict(values, best)
    return series


def verdict(values, best):
    """See above; best: the last constant with continuous pressures of degree 1."""
    if np.isnan(values[-1]):
        return "refused"
    if values[-1] < 1e-6:
        return "zero"
    last = values[-3:] if len(values) > 3 else values[-2:]
    if any(b < 0.9 * a for a, b in zip(last, last[1:])):
        return "falls"
    return "weak" if values[-1] < 0.25 * best else "stable"


def measure_all(say, small=False):
    """Everything, in the order of the page; or a little of it. Collective."""
    out = []
    plane = {name: PLANE[name] for name in ("8:8", "11:8")}
    runs = [("flat", "quadrilateral", d, plane, (SHOWN,), 3) for d in (1, 2)]
    if not small:
        runs = [(s, "quadrilateral", d, PLANE, RULES, 5) for s in ("flat", "arc") for d in (1, 2)]
        for cell in ("hexahedron", "tetrahedron"):
            runs += [("flat", cell, d, SOLID[d], (SHOWN, dc.Segments()), 3) for d in (1, 2)]
    for shape, cell, degree, families, rules, refinements in runs:
        for name, family in families.items():
            if (shape, name) == ("arc", "rigid"):
                continue
            start = time.perf_counter()
            for series in measure(shape, cell, degree, name, family, rules, refinements):
                out.append(series)
                numbers = " ".join(f"{v:.4f}" for v in series.values)
                say(
                    f"{shape} {cell} u{degree} {name} {series.name} {series.rule}:"
                    f" {numbers} {series.verdict}"
                )
            say(f"    {time.perf_counter() - start:.1f} s")
    return out


def contradictions(all_series):
    """What infsup.doubt should say otherwise."""
    wrong, fine = [], {}
    for s in all_series:
        if s.verdict == "refused":
            continue
        facet = {"hexahedron": "quadrilateral", "tetrahedron": "triangle"}.get(s.cell, "interval")
        doubt = infsup.doubt(s.degree, s.space, facet, s.rule)
        where = f"{facet}, u of degree {s.degree}, {s.space}, {s.rule}"
        if doubt is None and s.verdict != "stable":
            wrong.append(f"no doubt, but {s.verdict}: {where}, {s.shape}, {s.meshes}")
        if doubt is not None:
            fine[where] = fine.get(where, True) and s.verdict == "stable"
    return wrong + [f"doubt, but stable everywhere: {where}" for where, yes in fine.items() if yes]


# -- the page -----------------------------------------------------------------------------------------
PREFACE = """# Which pressures fit to which displacements

The contact pressure and the displacements must fit together. If they do not, some pressures have
little or no effect on the bodies: they are found badly or not at all, and oscillate. The inf-sup
constant measures this,

    β = inf_μ sup_v ∫ μ ⟦v⟧_n dΓ / (‖v‖_H1 ‖μ‖_h),   ‖μ‖_h² = h ∫ μ² dΓ,

with the particles' own integration, targets and normals. `dc.infsup.constant(pair)` computes it. A
choice is sound if the constant does not fall when both meshes are refined.

    python3 benchmarks/infsup.py --output docs/infsup.md --picture docs/pictures/infsup.png

Two bodies lie on each other, along a flat interface or along an arc. `u1` and `u2` are displacements
of degree 1 and 2. `P1` and `P2` are continuous pressures ("Lagrange"), `DG0` and `DG1` discontinuous
ones. `11:8` means 11 slave facets on 8 master facets; both are halved at each refinement. In `n+1:n`
the slave has one facet more than the master on all meshes. `rigid` is a rigid plane, which does not
move at all.

* *stable*: over the last three of five refinements (3D: the last two of three) no constant is below
  0.9 times the one before.
* *weak*: likewise, but the constant is less than a quarter of that of P1 on the same meshes.
* *falls*: one of the ratios is below 0.9.
* *zero*: the last constant is below 1e-6.
"""

LESSONS = """## What is seen

* **P1 is stable with u1 and u2, P2 with u2**: on flat interfaces and arcs, in 2D and 3D, with all
  rules, whichever side is finer. The slave alone suffices: its displacements can follow each such
  pressure, so that the mesh of the master cannot spoil it. The rigid plane, which does not move at
  all, shows it.
* **DG0 with u1 falls where the meshes match, and on a rigid plane.** In 2D the constant halves with
  each refinement. The mode is a checkerboard: pressures +1 and −1 from facet to facet do no work with
  the displacement of any inner node. Only the ends of the interface see it.
* **DG0 with u1 on other meshes depends on which side is finer.** Where the nodes of the master lie
  elsewhere, the master sees the checkerboard. A finer master sees it well (8:11, 3:10: stable). A
  coarser one averages over several facets and sees little: with 11:8 the constant settles at a fifth
  of P1's, with 10:3 it is below a fifteenth and still sinks slowly, and on hexahedra with 4:3 it
  falls. With one facet more than the master (n+1:n) the meshes match in some places and not in
  others. The constant falls with √h there: meshes need not match everywhere to be bad.
  Triangular facets outnumber their nodes; on them it is zero unless the master is finer.
* **P2 and DG1 with u1** have about twice as many pressures as the slave has nodes. What the slave does
  not see is left to the master. On flat interfaces some pressures have no effect at all unless the
  master is finer (in 3D: much finer). On arcs normals turn a little from facet to facet; the constant
  is not zero there, but tends to it. With 8:11 it is a thirtieth (P2) to a hundredth (DG1) of P1's.
  Only a master three times as fine helps (3:10; on tetrahedra DG1 is zero with 2:5 still).
* **DG1 with u2** is DG0 with u1 one degree higher, a saw-tooth in place of the checkerboard. It falls
  on matching meshes, on a rigid plane, and with n+1:n and 10:3; it is weak with 11:8, and stable if the
  master is finer.
* **DG0 with u2 is stable on lines and quadrilaterals**: the node in the middle of a facet sees the
  pressure of its facet alone. Triangles have no such node. On them DG0 with u2 falls, but for a finer
  master.
* **The rule** matters little for continuous pressures and for DG0: no verdict changes. Simpson(1),
  Simpson(2) and Segments differ by a third at most, mostly by a few per cent. Constants with Nodes
  are up to three times as high, and so are those of P2 with Simpson(0), whose particles are the nodes:
  lumped weights make more of alternating pressures than the ∫ μ² of the norm does. Only compare
  constants of one rule.
* **DG1 depends on the rule.** With Nodes the particles of neighbouring facets coincide, and only the
  sum of their pressures acts: zero on all meshes, for u1 and u2. With Simpson(0) it falls on all
  meshes for nearly the same reason: the particle in the middle does not see a saw-tooth. With
  Simpson(1) and richer rules it is stable if the master is fine enough.

So a pressure that the slave's own displacements can follow is safe. Others need a finer master on every
part of the interface. `dc.infsup.doubt` says this in short.
"""


def call(rule):
    return "`" + repr(rule).replace("degree=None", "").replace("n=", "") + "`"


def show(value):
    return "–" if np.isnan(value) else "0" if value < 1e-6 else f"{value:.3g}"


def rows_of(series, *names):
    """Series grouped by some of their attributes, in order."""
    groups = {}
    for s in series:
        groups.setdefault(tuple(getattr(s, name) for name in names), []).append(s)
    return groups


def table(header, rows):
    lines = [f"| {' | '.join(line)} |" for line in [header, ["---"] * len(header), *rows]]
    return "\n".join(lines) + "\n"


def verdicts(series, text=lambda s: s.verdict):
    """Rows: displacement, pressure and rule; columns: meshes."""
    names = list(dict.fromkeys(s.meshes for s in series))
    rows = []
    for (degree, name, rule), group in rows_of(series, "degree", "name", "rule").items():
        cells = {s.meshes: text(s) for s in group}
        rows.append([f"u{degree}", name, call(rule), *(cells.get(n, "") for n in names)])
    return table(["u", "pressure", "integration", *names], rows)


def page(series):
    plane = [s for s in series if s.cell == "quadrilateral"]
    out = [PREFACE, "![Constants against the mesh size](pictures/infsup.png)\n", LESSONS]
    out.append("## Five refinements\n")
    for shape, about in (("flat", "Flat interface"), ("arc", "Arc")):
        shown = [s for s in plane if s.shape == shape and s.rule == SHOWN]
        rows = [
            [f"u{s.degree}", s.name, s.meshes, *map(show, s.values), s.verdict]
            for group in rows_of(shown, "degree", "name").values()
            for s in group
        ]
        out.append(f"{about}, {call(SHOWN)}, constants from the coarsest mesh to the finest:\n")
        out.append(table(["u", "pressure", "meshes", "1", "2", "3", "4", "5", ""], rows))
    out.append("## All rules\n")
    for shape, about in (("flat", "Flat interface"), ("arc", "Arc")):
        out.append(f"{about}, verdict and the constant on the finest mesh:\n")
        here = [s for s in plane if s.shape == shape]
        out.append(verdicts(here, lambda s: f"{s.verdict} {show(s.values[-1])}"))
    out.append("## 3D\n")
    for (cell, degree), group in rows_of(series, "cell", "degree").items():
        if cell != "quadrilateral":
            about = {"hexahedron": "Hexahedra", "tetrahedron": "Tetrahedra"}[cell]
            out.append(f"{about} with u{degree}, flat, constants of three refinements:\n")
            three = lambda s: f"{s.verdict}: {', '.join(map(show, s.values))}"  # noqa: E731
            out.append(verdicts(group, three))
    return "\n".join(out)


def draw(series, file):
    """Constants against h: a column for each mesh, a row for each degree of the displacement."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    columns = ("8:8", "11:8", "8:11", "3:10")
    figure, axes = plt.subplots(2, 4, figsize=(12, 6), sharex=True, sharey=True)
    colours = {"P1": "C0", "P2": "C1", "DG0": "C2", "DG1": "C3"}
    for s in series:
        if s.cell != "quadrilateral" or s.rule != SHOWN or s.meshes not in columns:
            continue
        values = np.maximum(s.values, 1e-4)  # zeros lie on the frame
        ax = axes[s.degree - 1, columns.index(s.meshes)]
        label = s.name if s.shape == "flat" else None
        style = {"flat": "o-", "arc": "x--"}[s.shape]
        ax.loglog(s.sizes, values, style, color=colours[s.name], label=label, markersize=4)
        ax.set_title(f"u{s.degree}, {s.meshes}", fontsize=10)
        ax.grid(alpha=0.3)
        ax.set_ylim(1e-4, 2)
    axes[0, 3].legend(title="flat: –, arc: - -", loc="lower left")
    for ax in axes[1]:
        ax.set_xlabel("size of a slave facet")
    for ax in axes[:, 0]:
        ax.set_ylabel("inf-sup constant")
    figure.tight_layout()
    figure.savefig(file, dpi=110)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", help="write the page to this file")
    parser.add_argument("--picture", help="draw the constants into this file")
    parser.add_argument("--small", action="store_true", help="a few seconds, and no page")
    options = parser.parse_args(arguments)

    def say(text):
        if COMM.rank == 0:
            print(text, flush=True)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pairs warn of what is measured here
        series = measure_all(say, options.small)
    wrong = contradictions(series)
    if COMM.rank == 0:
        if options.output and not options.small:
            with open(options.output, "w", encoding="utf-8") as file:
                file.write(page(series))
        if options.picture and not options.small:
            draw(series, options.picture)
        print("\n".join(wrong) or "infsup.doubt agrees with the constants.")
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
