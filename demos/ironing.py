# SPDX-License-Identifier: MIT
"""Shallow ironing: a stiff indenter is pressed into a soft slab and drawn along it, with friction.

The problem is Fischer and Wriggers' (2006), in the dimensions that Yastrebov gives (2011): a slab of
12 × 4 mm, E = 689.6 MPa, and an indenter of 1.2 × 0.9 mm with a round bottom of radius 0.75, ten times
as stiff, 0.2 above the slab near its left end; plane strain, neo-Hookean, ν = 0.32, μ = 0.3. Its top
moves down by 1 and then to the right by 10 mm. In the literature the vertical force at the end of the
descent is 268 to 332 N (for 1 mm of thickness), and the horizontal force in the middle of the way 0.30
to 0.38 of the vertical one. Codes do not agree better.

So energy is the judge: the work of the moving top is what both bodies store and what friction has
dissipated. The difference comes from the finite steps, and goes to zero with them.
The demo goes the way twice, the second time in steps of half the length, and draws both.

Run it with `python3 demos/ironing.py`, alone or under mpirun. `--slab` sets the facets along the
slab; or `--mesh FILE` is a .msh file of both bodies by Gmsh, with the physical surfaces 1 (indenter) and
2 (slab) and the physical curves 1 (top), 2 (bottom), 5 (the arc) and 6 (top of the slab). `--step` sets
the longer increment of both motions (the benchmark's own increments are 0.1 down and 0.02 aside), `--way`
the length of the slide. An increment of 1 is longer than the contact: where Newton fails, the step is
cut. `--rule` chooses the integration. With `--checkpoint FILE` each step is
saved, and after an interruption the same command and `--resume` go on, on any number of ranks. It writes
demos/pictures/ironing.png, and of the second way, in demos/output/ironing, the .xdmf files for ParaView
and a table of forces.
"""

import argparse
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from matplotlib.figure import Figure
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--slab", type=int, default=60, help="facets along the slab")
parser.add_argument("--mesh", help="a .msh file of both bodies; see above for its groups")
parser.add_argument("--step", type=float, default=0.2, help="longer increment [mm]")
parser.add_argument("--way", type=float, default=10.0, help="length of the slide [mm]")
RULES = {"simpson1": dc.Simpson(1), "simpson2": dc.Simpson(2), "segments": dc.Segments()}
parser.add_argument("--rule", choices=RULES, default="simpson1", help="contact integration")
parser.add_argument("--checkpoint", help="file to save each step in")
parser.add_argument("--resume", action="store_true", help="go on from the checkpoint")
args = parser.parse_args()

comm = MPI.COMM_WORLD
here = Path(__file__).parent
E, nu, mu = 689.6, 0.32, 0.3  # MPa: forces are in N, for 1 mm of thickness
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2

# -- the meshes ---------------------------------------------------------------------------------------


def indenter(x):
    """Its lower side is an arc of radius 0.75, from (0.2, 4.5) by (0.8, 4.2) to (1.4, 4.5)."""
    s, height = x[:, 0], x[:, 1]
    angle = np.arcsin(0.6 / 0.75) * s
    arc = np.column_stack([0.8 + 0.75 * np.sin(angle), 4.95 - 0.75 * np.cos(angle)])
    top = np.column_stack([0.8 + 0.6 * s, np.full_like(s, 5.4)])
    return arc + height[:, None] * (top - arc)


n = args.slab
if args.mesh:
    mesh, cell_tags, facet_tags = meshes.read_msh(
        comm,
        args.mesh,
        2,
        cells={1: "indenter", 2: "slab"},
        facets={TOP: "top", BOTTOM: "bottom", SLAVE: "the arc", MASTER: "top of the slab"},
    )
    body = np.ones(cell_tags.indices.max(initial=-1) + 1, dtype=int)
    body[cell_tags.indices] = cell_tags.values - 1
else:
    mesh, body = meshes.create(
        comm,
        [
            meshes.grid((max(6, n // 8), max(4, n // 12)), (-1, 0), (1, 1), indenter),
            meshes.grid((n, n // 4), (0, 0), (12, 4)),
        ],
    )
    facet_tags = meshes.tag_facets(
        mesh,
        {
            SLAVE: (lambda x: np.abs(np.hypot(x[0] - 0.8, x[1] - 4.95) - 0.75) < 1e-6, 0),
            MASTER: (lambda x: np.isclose(x[1], 4), 1),
            TOP: (lambda x: np.isclose(x[1], 5.4), 0),
            BOTTOM: (lambda x: np.isclose(x[1], 0), 1),
        },
        body,
    )

# -- the bulk, in UFL: compressible neo-Hookean, plane strain -----------------------------------------

V = dc.vector_space(mesh, 1)
u, w = fem.Function(V, name="displacement"), ufl.TestFunction(V)
stiffness = fem.Function(dc.function_space(mesh, ("DG", 0)), name="stiffness")
stiffness.x.array[:] = np.where(body == 0, 10.0, 1.0)
gradient = dc.materials.deformation_gradient(u)
psi = dc.materials.neo_hookean(gradient, *dc.materials.lame(E, nu))
stored = stiffness * psi * ufl.dx(mesh, metadata={"quadrature_degree": 2})
F = ufl.derivative(stored, u, w)
plate = fem.Function(V)
bcs = [
    fem.dirichletbc(plate, fem.locate_dofs_topological(V, 1, facet_tags.find(TOP))),
    fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, facet_tags.find(BOTTOM)), V),
]

# -- contact, and the two motions in steps ------------------------------------------------------------


def place(x, y):
    """Move the top of the indenter."""
    plate.interpolate(lambda X: np.array([np.full_like(X[0], x), np.full_like(X[0], y)]))


def iron(increment, before, saved, folder=None):
    """Go the way, and write it to a folder. Columns: x, y, horizontal and vertical force, work, energy,
    iterations, cuts.

    `before`: results of a way that is done; `saved`: arrays of a checkpoint of this way, or None.
    """
    u.x.array[:] = 0
    slave, master = dc.Surface(u, facet_tags, SLAVE), dc.Surface(u, facet_tags, MASTER)
    pair = dc.ContactPair(slave, master, friction=mu, integration=RULES[args.rule])
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    inside = fem.form(stored)
    if folder is not None:
        reached = np.abs(saved["rows"][-1][:2]).sum() if saved else None
        writer = dc.Writer(folder, u, pair, fields=[stiffness], resume=reached)
        table = dc.Table(folder / "forces.csv", resume=reached)
    rows = [np.zeros(8)]
    # 1 down, then aside
    for leg, end in enumerate((1.0, args.way)):
        if saved and leg < saved["leg"]:
            continue
        apply = (lambda t: place(0, -t)) if leg == 0 else (lambda t: place(t, -1))
        first = min(increment, 0.1) if leg == 0 else min(increment, end)
        steps = dc.LoadStepping(problem, apply, end=end, step=first, progress=False)
        if saved and leg == saved["leg"]:
            rows = list(steps.load(args.checkpoint)["rows"])
        for step in steps:
            at = np.array([0, -step.time] if leg == 0 else [step.time, -1])
            # the top pushes with what the slab's contact takes up, by the trapezoidal rule
            force = -pair.resultant()
            work = rows[-1][4] + 0.5 * (force + rows[-1][2:4]) @ (at - rows[-1][:2])
            energy = comm.allreduce(fem.assemble_scalar(inside)) + pair.dissipated_energy()
            rows.append(np.array([*at, *force, work, energy, step.report.iterations, step.failed]))
            if folder is not None:
                way = leg + step.time
                writer.write(way)
                table.write(way=way, force=force, work=work, energy=energy)
            if comm.rank == 0:
                print(
                    "{:7.4f} {:7.4f}   H {:8.3f}  V {:8.3f}   work {:9.3f}, stored and dissipated"
                    " {:9.3f}   {:3.0f} iterations, {:.0f} cuts".format(
                        *at, force[0], -force[1], *rows[-1][4:]
                    ),
                    flush=True,
                )
            if args.checkpoint:
                steps.save(args.checkpoint, rows=rows, leg=leg, **before)
    return np.array(rows)


saved = dc.checkpoint.arrays(args.checkpoint, comm) if args.resume else None
ways = [saved["first"]] if saved and "first" in saved else []
while len(ways) < 2:
    done, folder = ({"first": ways[0]}, here / "output" / "ironing") if ways else ({}, None)
    ways.append(iron(args.step / (1 + len(ways)), done, saved, folder))
    saved = None
deformed = dc.plot.gather_bodies(u, body)

# -- picture and assertions ---------------------------------------------------------------------------

if comm.rank == 0:
    figure = Figure(figsize=(9, 8), constrained_layout=True)
    bodies, forces, energies = figure.subplots(3, 1, height_ratios=(1.3, 1.2, 1))
    for number, colour in ((1, "lightsteelblue"), (0, "wheat")):
        shown = dc.plot.Shapes([deformed.corners[0][deformed.values == number]])
        dc.plot.bodies(shown, title="At the end of the way", color=colour, axes=bodies)
    for rows, style, step in zip(ways, ("--", "-"), (args.step, args.step / 2)):
        path = np.abs(rows[:, 1]) + rows[:, 0]
        forces.plot(path, -rows[:, 3], "C0" + style, label=f"vertical, increments of {step:g}")
        forces.plot(path, rows[:, 2], "C3" + style, label=f"horizontal, increments of {step:g}")
        energies.plot(
            path[1:], 100 * (rows[1:, 4] / np.maximum(rows[1:, 5], 1e-9) - 1), "k" + style
        )
    forces.plot(
        [1, 1], [268, 332], "C0", linewidth=6, alpha=0.3, label="literature, end of descent"
    )
    forces.set_ylabel("force [N]")
    forces.legend(fontsize=8, loc=(0.35, 0.39))
    energies.set_ylim(-3, 3)
    energies.set_ylabel("work against energy [%]")
    energies.set_xlabel("way of the indenter: 1 down, then aside [mm]")
    for axes in (forces, energies):
        axes.grid(alpha=0.3)
    file = here / "pictures" / "ironing.png"
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=110)
    print("picture:", file)

    errors = []
    for rows in ways:
        descent = -rows[np.argmin(rows[:, 1]), 3]  # the first row at the bottom
        sliding = rows[(rows[:, 0] >= min(1.5, args.way)) & (rows[:, 0] <= 7)]
        ratio = -sliding[:, 2] / sliding[:, 3]
        errors.append(abs(rows[-1, 4] - rows[-1, 5]))
        print(
            f"end of the descent {descent:.1f} N; horizontal over vertical force {ratio.min():.3f} to"
            f" {ratio.max():.3f}; work − energy {errors[-1]:.3f} of {rows[-1, 4]:.1f} N mm;"
            f" {rows[1:, 6].mean():.1f} iterations a step, {rows[:, 7].sum():.0f} cuts"
        )
        assert 268 < descent < 332, "vertical force in the literature's band"
        assert (
            0.30 < ratio.min() and ratio.max() < 0.38
        ), "ratio of forces in the literature's band"
    for error, rows, step in zip(errors, ways, (args.step, args.step / 2)):
        # first order in the steps: 0.09 of their length with 60 facets, 0.12 with 120
        assert error < 0.15 * min(step, 0.2) * rows[-1, 4], "work is stored or dissipated"
    # forces where both have stopped: every increment of the longer steps that was not cut
    same = [r for r in ways[0] if np.abs(ways[1][:, :2] - r[:2]).sum(axis=1).min() < 1e-9]
    pairs = [(r, ways[1][np.abs(ways[1][:, :2] - r[:2]).sum(axis=1).argmin()]) for r in same]
    largest = max(np.linalg.norm(r[2:4]) for r in same)
    change = [
        np.linalg.norm(a[2:4] - b[2:4]) / largest for a, b in pairs if a[0] >= min(1, args.way)
    ]
    print(
        f"steps halved: forces change by {100 * max(change):.2f} %, the energy's error to"
        f" {errors[1] / errors[0]:.2f} of it"
    )
    assert max(change) < 0.01, "forces do not depend on the steps"
    if not ways[0][:, 7].any():  # with cuts the first way's steps are not the longer ones
        assert errors[1] < errors[0] or args.step < 0.1, "the energy's error falls with the steps"
