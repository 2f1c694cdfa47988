# SPDX-License-Identifier: MIT
"""Sixty runs with default settings: does contact arrive without tuning, and at what cost?

Five problems on four meshes (coarse, slave finer than the master, slave coarser, fine) with three
step sizes: small, medium and bold, the last so large that steps may have to be cut (a whole slide in
two increments). Friction is 0, 0.3 or 0.8 in a fixed pattern, 20 runs each. Nothing is tuned: no ρ,
no strategy, no solver options, and `LoadStepping` cuts steps as it comes.

A run has arrived if all its motions come to their end. At the end of each motion the answer is
checked for what every solution must fulfil, however coarse; where it does not, the run is wrong:

* Contact is there, and friction has not produced energy.
* Coulomb's law: friction is μ|λ P_B(g)| ≤ μ|λ| at each particle (F1), thus on surfaces of any shape
  Σ w |t_τ| ≤ μ Σ w p over the particles with p > 0. 1e-3 is allowed for particles that have changed
  their status often in a step, whose pressure is augmented; the others fulfil it to round-off.
* Pressure pushes: what pulls, in closed particles with p < 0 beside an edge of contact, is at most
  5 % of what pushes (pressure is ≥ 0 in the weighted mean, not at each particle).
* No particle lies deeper in the master than 20 % of the size of its facet.

Each solve that fails must raise ConvergenceError and leave displacements, multipliers and resultants
as they were. The script ends with 1 if more than 2 runs do not arrive, accepted steps take more than
8 iterations in the mean, an answer is wrong or a state was not restored. The table has the largest
figures of these checks, and the forces of the first pair at the last accepted step.

    python3 benchmarks/robustness.py --list
    python3 benchmarks/robustness.py --output robustness_table.md
    mpirun -n 2 python3 benchmarks/robustness.py --problem roller --mesh 1 --step bold
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
import traceback
from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import meshes

COMM = MPI.COMM_WORLD
FRICTION = (0.0, 0.3, 0.8)
STEPS = ("small", "medium", "bold")
MOST_SOLVES = 300  # a run that needs more is given up: it does not arrive
MOST = {"friction": 1 + 1e-3, "pull": 0.05, "depth": 0.2}

# -- the five problems --------------------------------------------------------------------------------
# Each takes the cells of the upper and the lower body along the axes and the friction. It gives the
# problem, its pairs, and its motions: apply(t), the last t, and small, medium and bold steps.


def scene(upper, lower, where, moduli, friction, plane=None, linear=False):
    """Problem, pairs and a function that moves the upper body's top as a rigid plate.

    Neo-Hookean or linear bodies, ν = 0.3, plane strain in 2D. `where` are predicates: slave, master,
    top, what is held and, with a rigid plane, the slave of a second pair.
    """
    mesh, body = meshes.create(COMM, [upper, lower])
    dim = mesh.geometry.dim
    numbers = zip((5, 6, 1, 2, 3), where, (0, 1, 0, 1, 1))
    tags = meshes.tag_facets(mesh, {tag: (on, which) for tag, on, which in numbers}, body)
    V = dc.vector_space(mesh, 1)
    u, w, plate = fem.Function(V), ufl.TestFunction(V), fem.Function(V)
    E = fem.Function(dc.function_space(mesh, ("DG", 0)))
    E.x.array[:] = np.where(body == 0, *moduli)
    G, lmbda = 1 / 2.6, 0.3 / (1.3 * 0.4)  # over E
    strain, gradient = ufl.sym(ufl.grad(u)), ufl.Identity(dim) + ufl.grad(u)
    ln_J = ufl.ln(ufl.det(gradient))
    psi = G / 2 * (ufl.inner(gradient, gradient) - dim - 2 * ln_J) + lmbda / 2 * ln_J**2
    if linear:
        psi = G * ufl.inner(strain, strain) + lmbda / 2 * ufl.tr(strain) ** 2
    F = ufl.derivative(E * psi * ufl.dx(mesh, metadata={"quadrature_degree": 2}), u, w)
    top, held = (fem.locate_dofs_topological(V, dim - 1, tags.find(tag)) for tag in (1, 2))
    bcs = [fem.dirichletbc(plate, top), fem.dirichletbc(np.zeros(dim), held, V)]
    sides = [(dc.Surface(u, tags, 5), dc.Surface(u, tags, 6))]
    if plane is not None:
        sides.append((dc.Surface(u, tags, 3), plane))
    pairs = [dc.ContactPair(*side, friction=friction) for side in sides]

    def drive(*translation, angle=0.0, axes=(0, 1), centre=np.zeros(dim)):
        c, (i, j), R = np.reshape(centre, (dim, 1)), axes, np.eye(dim)
        R[[i, j, i, j], [i, j, j, i]] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
        shift = np.reshape(translation, (dim, 1))
        plate.interpolate(lambda X: (R - np.eye(dim)) @ (X[:dim] - c) + shift)

    return dc.ContactProblem(F, u, pairs, bcs=bcs), pairs, drive


def at(axis, value):
    return lambda x: np.isclose(x[axis], value)


def on_sphere(centre, radius):
    """Or on a circle."""
    return lambda x: np.isclose(sum((a - b) ** 2 for a, b in zip(x, centre)), radius**2)


def punch(radius, half_width, height, grading, pole):
    """From [−1, 1] × [0, 1] to a punch with an arc below; grading > 0 moves nodes to its pole."""

    def mapping(x):
        s = (1 - grading) * x[:, 0] + grading * x[:, 0] ** 3
        angle = np.arcsin(half_width / radius) * s
        low = np.column_stack([radius * np.sin(angle), radius * (1 - np.cos(angle))])
        top = np.column_stack([half_width * s, np.full_like(s, height)])
        return low + x[:, 1:2] * (top - low) + pole

    return mapping


def ironing(upper, lower, mu):
    """Shallow ironing, as in demos/ironing.py: 1 mm down, of which 0.2 are a gap, 3 mm across."""
    upper = meshes.grid(upper, (-1, 0), (1, 1), punch(0.75, 0.6, 1.2, 0, (0.8, 4.2)))
    lower = meshes.grid(lower, (0, 0), (12, 4))
    where = on_sphere((0.8, 4.95), 0.75), at(1, 4), at(1, 5.4), at(1, 0)
    problem, pairs, drive = scene(upper, lower, where, (6896, 689.6), mu)
    down = (lambda t: drive(0, -t), 1, (0.1, 0.25, 0.5))
    return problem, pairs, [down, (lambda t: drive(t, -1), 3, (0.15, 0.5, 1.5))]


def reversal(upper, lower, mu):
    """A round punch is pressed on a block, drawn to the right and back, so that slip turns round;
    linear elasticity, triangles."""
    upper = meshes.grid(upper, (-1, 0), (1, 1), punch(8, 6, 6, 0.5, (0, 0)), "triangle")
    lower = meshes.grid(lower, (-10, -8), (10, 0), cell="triangle")
    where = on_sphere((0, 8), 8), at(1, 0), at(1, 6), at(1, -8)
    problem, pairs, drive = scene(upper, lower, where, (200, 200), mu, linear=True)
    down = (lambda t: drive(0, -t), 0.4, (0.05, 0.1, 0.2))
    there = (lambda t: drive(t, -0.4), 1.5, (0.1, 0.375, 0.75))
    back = (lambda t: drive(1.5 - t, -0.4), 2.5, (0.125, 0.5, 1.25))
    return problem, pairs, [down, there, back]


def stack(upper, lower, mu):
    """A block with sharp edges is pressed on a slab and pushed along it. The slab lies on a rigid
    plane and is held at its ends: two pairs, corners, a slab that may lift off; triangles."""
    upper = meshes.grid(upper, (-1, 0), (1, 1), cell="triangle")
    lower = meshes.grid(lower, (-4, -1), (4, 0), cell="triangle")
    ends = lambda x: np.isclose(np.abs(x[0]), 4)  # noqa: E731
    where = at(1, 0), at(1, 0), at(1, 1), ends, at(1, -1)
    plane = dc.RigidPlane(point=(0, -1), normal=(0, 1))
    problem, pairs, drive = scene(upper, lower, where, (600, 200), mu, plane)
    down = (lambda t: drive(0, -t), 0.1, (0.0125, 0.025, 0.05))
    return problem, pairs, [down, (lambda t: drive(t, -0.1), 1.2, (0.06, 0.2, 0.6))]


def turning(upper, lower, mu):
    """A block is pressed on the crest of a curved slab, dragged off it and turned by 60 degrees on
    the way; hexahedra."""
    height = lambda x: -(x[0] ** 2) / 8 - x[1] ** 2 / 16  # noqa: E731
    curved = lambda x: x + np.outer((1 + x[:, 2] / 0.8) * height(x.T), (0, 0, 1))  # noqa: E731
    upper = meshes.grid(upper, (-0.5, -0.5, 0), (0.5, 0.5, 0.6), cell="hexahedron")
    lower = meshes.grid(lower, (-2, -1.5, -0.8), (2, 1.5, 0), curved, "hexahedron")
    where = at(2, 0), lambda x: np.isclose(x[2], height(x)), at(2, 0.6), at(2, -0.8)
    problem, pairs, drive = scene(upper, lower, where, (600, 200), mu)
    down = (lambda t: drive(0, 0, -t), 0.08, (0.02, 0.04, 0.04))
    drag = lambda t: drive(0.7 * t, 0.2 * t, -0.08 - 0.05 * t, angle=np.pi / 3 * t)  # noqa: E731
    return problem, pairs, [down, (drag, 1, (0.1, 0.25, 0.5))]


def roller(upper, lower, mu):
    """A spherical cap meets a block 0.02 below, is pressed on it, rolls by 0.3 rad along x and is
    pushed aside along y meanwhile; tetrahedra."""

    def cap(x):
        low = 1 - np.sqrt(1 - x[:, 0] ** 2 - x[:, 1] ** 2)
        return np.column_stack([x[:, :2], low + x[:, 2] * (0.8 - low)])

    upper = meshes.grid(upper, (-0.6, -0.6, 0), (0.6, 0.6, 1), cap, "tetrahedron")
    lower = meshes.grid(lower, (-1, -0.9, -0.8), (1.3, 1.1, -0.02), cell="tetrahedron")
    where = on_sphere((0, 0, 1), 1), at(2, -0.02), at(2, 0.8), at(2, -0.8)
    problem, pairs, drive = scene(upper, lower, where, (600, 200), mu)
    down = (lambda t: drive(0, 0, -t), 0.1, (0.02, 0.05, 0.05))
    turned = dict(axes=(2, 0), centre=(0, 0, 1))
    roll = lambda t: drive(0.3 * t, 0.2 * t, -0.1, angle=0.3 * t, **turned)  # noqa: E731
    return problem, pairs, [down, (roll, 1, (0.1, 0.25, 0.5))]


# cells of the slave's body on those of the master's
PROBLEMS = {
    ironing: "6×4 on 30×8, 16×8 on 48×12, 6×5 on 96×24, 24×12 on 112×28",
    reversal: "16×6 on 24×10, 48×12 on 32×12, 24×8 on 80×24, 64×16 on 80×30",
    stack: "8×4 on 24×4, 28×10 on 40×6, 10×5 on 120×14, 40×16 on 140×18",
    turning: "4×4×2 on 10×8×2, 8×8×3 on 8×6×2, 4×4×2 on 16×14×3, 10×10×3 on 18×14×4",
    roller: "5×5×2 on 9×8×3, 10×10×3 on 8×7×3, 5×5×3 on 18×16×3, 10×10×4 on 16×14×4",
}

# -- a run --------------------------------------------------------------------------------------------


@dataclass
class Run:
    """A configuration, and what came of it."""

    make: object
    mesh: int  # 1 to 4
    cells: str
    step: int  # index in STEPS
    friction: float
    arrived: bool = False
    dofs: int = 0
    iterations: list[int] = field(default_factory=list)  # of each accepted step
    lost: list[int] = field(default_factory=list)  # iterations of each failed solve
    shortest: float = np.inf
    forces: tuple[float, float] = (np.nan, np.nan)
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(MOST, -np.inf))
    seconds: float = 0.0
    wrong: list[str] = field(default_factory=list)
    unrestored: int = 0  # failed solves that left something behind
    stopped: str = ""

    @property
    def name(self):
        step, friction = STEPS[self.step], str(self.friction)
        return self.make.__name__, f"{self.mesh}: {self.cells}", step, friction


class Watched:
    """A problem whose failed solves are counted, and checked for what they leave behind."""

    def __init__(self, problem, pairs, run):
        self.comm, self._problem, self._pairs, self._run = problem.comm, problem, pairs, run
        self._solves = 0

    def __getattr__(self, name):
        return getattr(self._problem, name)

    def _state(self):
        forces = [pair.resultant() for pair in self._pairs] if self._run.iterations else []
        return [f.x.array.copy() for f in self._problem.system.functions] + forces

    def solve(self):
        if self._solves == MOST_SOLVES:
            raise TimeoutError(f"given up after {MOST_SOLVES} solves")
        self._solves += 1
        before = self._state()
        try:
            return self._problem.solve()
        except dc.ConvergenceError as error:
            self._run.lost.append(getattr(error.report, "iterations", 0))
            same = all(map(np.array_equal, before, self._state()))
            self._run.unrestored += not COMM.allreduce(same, op=MPI.LAND)
            raise


def check(run, pair, where):
    """Is it an answer at all? Collective."""
    table = pair.particles
    total = lambda values: COMM.allreduce(float(table.weight @ values))  # noqa: E731
    push, pull = (total(np.maximum(sign * table.pressure, 0)) for sign in (1, -1))
    rubbing = total(np.linalg.norm(table.friction, axis=1))
    facets, number = np.unique(table.facet, return_inverse=True)
    size = np.bincount(number, table.weight, len(facets)) ** (1 / (pair.slave.dim - 1))
    depth, largest = (
        COMM.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
        for values in (-table.gap / size[number], size)
    )
    if not push > 0:
        run.wrong.append(f"no contact{where}")
        return
    # without friction its round-off is compared to the pressure itself
    coulomb = rubbing / push / (run.friction or 1e-9)
    for (name, most), value in zip(MOST.items(), (coulomb, pull / push, depth)):
        run.worst[name] = max(run.worst[name], value)
        if not value <= most:
            run.wrong.append(f"{name} {value:.3g}{where}")
    if not pair.dissipated_energy() >= -1e-3 * run.friction * push * largest:
        run.wrong.append(f"friction has produced {-pair.dissipated_energy():.3g}{where}")


def carry_out(run):
    """Do it, whatever happens."""
    start, motion = time.perf_counter(), 0
    try:
        upper, lower = ([int(n) for n in body.split("×")] for body in run.cells.split(" on "))
        problem, pairs, motions = run.make(upper, lower, run.friction)
        run.dofs = COMM.allreduce(problem.system.layout.owned)
        watched = Watched(problem, pairs, run)
        for motion, (apply, end, steps) in enumerate(motions, start=1):
            stepping = dc.LoadStepping(watched, apply, end, steps[run.step], progress=False)
            for step in stepping:
                run.iterations.append(step.report.iterations)
                run.shortest = min(run.shortest, step.length)
                force = pairs[0].resultant()
                run.forces = force[-1], float(np.linalg.norm(force[:-1]))
            for number, pair in enumerate(pairs, start=1):
                check(run, pair, f" (pair {number}, motion {motion})")
        run.arrived = True
    except Exception as error:
        first = (str(error).splitlines() or [""])[0]
        run.stopped = f"motion {motion}: {type(error).__name__}: {first}"
        if not isinstance(error, (dc.ConvergenceError, TimeoutError)):
            traceback.print_exc()
    run.seconds = time.perf_counter() - start
    return run


# -- the tables ---------------------------------------------------------------------------------------

PREFACE = """# Robustness

60 runs with default settings: no parameter, strategy or solver option is given. They were chosen and
written down before the first of them was run. `benchmarks/robustness.py` has the problems; `make
robustness` runs them and writes this page.

Five problems, each on four meshes (slave cells on master cells) and in three step sizes, with μ = 0,
0.3 and 0.8 in turn. Steps that fail are halved by `LoadStepping`. A run has arrived if it got to the
end of its motions. It is wrong if, after a motion, friction exceeds μ times the pressure, the master
pulls, or a particle has sunk into it by more than a fifth of its facet. Iterations are all linear
solves of the accepted steps.

"""
COLUMNS = (
    "problem | mesh | step | μ | dofs | arrived | steps | failed solves | iterations per step"
    " | shortest step | vertical force | horizontal force | friction/(μ × pressure) | pull in %"
    " | depth in % | s | remarks"
)
GROUPS = "problem | arrived | steps | failed solves | iterations per step | s"


def head(columns):
    return f"| {columns} |\n" + "|---" * len(columns.split("|")) + "|"


def markdown(*cells):
    """A row; what is not finite is left out."""
    known = (c if isinstance(c, str) else f"{c:.4g}" if np.isfinite(c) else "–" for c in cells)
    return f"| {' | '.join(cell.replace('|', '/') for cell in known)} |"


def mean(iterations):
    return sum(iterations) / len(iterations) if iterations else np.nan


def row(run):
    remarks = [run.stopped] * bool(run.stopped) + [f"wrong: {what}" for what in run.wrong]
    remarks += [f"{run.unrestored} failed solves not undone"] * bool(run.unrestored)
    counts = run.dofs, "yes" if run.arrived else "no", len(run.iterations), len(run.lost)
    friction, pull, depth = run.worst["friction"], run.worst["pull"], run.worst["depth"]
    worst = friction if run.friction else "–", 100 * pull, 100 * depth
    measured = mean(run.iterations), run.shortest, *run.forces, *worst, round(run.seconds)
    return markdown(*run.name, *counts, *measured, "; ".join(remarks))


def summary(runs):
    """Markdown, and whether these runs pass."""
    lines = ["", head(GROUPS)]
    groups = {make.__name__: [run for run in runs if run.make is make] for make in PROBLEMS}
    for name, group in {**groups, "all": runs}.items():
        arrived = f"{sum(run.arrived for run in group)} of {len(group)}"
        every, lost = (
            [n for run in group for n in getattr(run, k)] for k in ("iterations", "lost")
        )
        seconds = round(sum(run.seconds for run in group))
        if group:
            lines.append(markdown(name, arrived, len(every), len(lost), mean(every), seconds))
    late, wrong = sum(not run.arrived for run in runs), sum(bool(run.wrong) for run in runs)
    left = sum(run.unrestored for run in runs)
    passed = late <= 2 and mean(every) <= 8 and wrong == 0 and left == 0
    lines.append(
        f"\nRuns with wrong answers: {wrong}. Failed solves that were not undone: {left}. Iterations"
        f" in failed solves, beside those of the table: {sum(lost)}."
        f" {'Passed' if passed else 'Not passed'}."
    )
    return "\n".join(lines), passed


def campaign():
    """All runs: problem p on mesh m with step s has friction number (p + m + s) mod 3."""
    return [
        Run(make, m + 1, cells.split(", ")[m], s, FRICTION[(p + m + s) % 3])
        for p, (make, cells) in enumerate(PROBLEMS.items())
        for m, s in itertools.product(range(4), range(3))
    ]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problem", choices=[make.__name__ for make in PROBLEMS])
    parser.add_argument("--mesh", type=int, choices=range(1, 5))
    parser.add_argument("--step", choices=STEPS)
    parser.add_argument("--list", action="store_true", help="print the runs, do nothing")
    parser.add_argument("--output", help="file to write the tables to as well")
    options = parser.parse_args()
    runs = [
        run
        for run in campaign()
        if options.problem in (None, run.make.__name__)
        and options.mesh in (None, run.mesh)
        and options.step in (None, STEPS[run.step])
    ]
    lines = []

    def tell(line):
        lines.append(line)
        if COMM.rank == 0:
            print(line, flush=True)

    if options.list:
        tell("\n".join(markdown(*run.name) for run in runs))
        return 0
    tell(head(COLUMNS))
    for run in runs:
        tell(row(carry_out(run)))
    text, passed = summary(runs)
    tell(text)
    if options.output and COMM.rank == 0:
        with open(options.output, "w", encoding="utf-8") as file:
            file.write(PREFACE + "\n".join(lines) + "\n")
    COMM.barrier()  # mpirun ends all ranks when one fails
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
