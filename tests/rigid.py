# SPDX-License-Identifier: MIT
"""A block under rigid tools, in 2D and 3D, and what the tests of tools measure.

The block is [−1, 1] × [−1, 0], clamped below; the slave is its top, slightly bulged. Tools come from
above. Units N, mm, MPa.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from problems import BOTTOM, SLAVE, Half, Material, Model, neo_hookean, one_mesh

import dolfinx_contact as dc
from dolfinx_contact import meshes

COUNTS = {2: (12, 4), 3: (5, 5, 2)}
SOFT = Material(neo_hookean, 1000.0, 0.3)


def columns(x: np.ndarray, ranks: int) -> np.ndarray:
    """Columns of cells, dealt out in turn: the slave is cut in many places."""
    return np.floor((x[:, 0] + 1) / 0.31).astype(int) % ranks


def block(
    comm: MPI.Comm,
    dim: int,
    partition: Any = columns,
    counts: tuple[int, ...] | None = None,
    bulge: float = 0.02,
    scale: tuple[float, float] = (1.0, 1.0),
    cell: str | None = None,
) -> Model:
    """Args:
    bulge: height of the middle of the top above its ends
    scale: of lengths and of Young's modulus
    """
    length, young = scale

    def bulged(x: np.ndarray) -> np.ndarray:
        y = x.copy()
        y[:, -1] += (1 + x[:, -1]) * bulge * (1 - np.mean(x[:, :-1] ** 2, axis=1))
        return length * y

    def above(x: np.ndarray) -> np.ndarray:
        y = x[:dim] / length
        return np.isclose(y[-1], bulge * (1 - np.mean(y[:-1] ** 2, axis=0)))

    low, high = [-1.0] * dim, [1.0] * (dim - 1) + [0.0]
    cell = cell or {2: "quadrilateral", 3: "hexahedron"}[dim]
    body = meshes.grid(counts or COUNTS[dim], low, high, bulged, cell)
    faces = {SLAVE: above, BOTTOM: lambda x: np.isclose(x[dim - 1], -length)}
    half = Half(body, faces, {BOTTOM: (0.0,) * dim})
    material = Material(SOFT.law, young * SOFT.young, SOFT.poisson)
    return one_mesh(comm, [half], material, lambda x, n: partition(x / length, n))


def pair_and_problem(model: Model, tools: Any, strategy: Any = None, **options: Any) -> Any:
    pair = dc.ContactPair(model.surface(SLAVE), tools, **options)
    return pair, model.problem(pair, strategy=strategy)


def ball(dim: int, height: float = 0.02, radius: float = 0.8, at: float = 0.13) -> dc.RigidSphere:
    """A sphere (circle) above, its lowest point at a height."""
    return dc.RigidSphere([at] + [0.08] * (dim - 2) + [height + radius], radius)


def sphere_mesh(n: int, center: Any, radius: float) -> dc.RigidMesh:
    """The sides of a cube in n × n quadrilaterals each, on a sphere; in 2D 4 n lines."""
    center = np.asarray(center, dtype=float)
    if len(center) == 2:
        a = 2 * np.pi * (np.arange(4 * n) + 0.3) / (4 * n)
        x = np.column_stack([np.cos(a), np.sin(a)])
        number = np.arange(4 * n)
        # counterclockwise: the material is on the left
        return dc.RigidMesh(center + radius * x, np.column_stack([number, np.roll(number, -1)]))
    points, cells = [], []
    t = np.tan(np.pi / 4 * np.linspace(-1, 1, n + 1))
    s, r = (a.ravel() for a in np.meshgrid(t, t, indexing="ij"))
    i, j = (a.ravel() for a in np.meshgrid(range(n), range(n), indexing="ij"))
    corner = i * (n + 1) + j
    square = np.column_stack([corner, corner + n + 1, corner + n + 2, corner + 1])
    for axis in range(3):
        for side in (-1, 1):
            x = np.empty((len(s), 3))
            x[:, axis], x[:, axis - 2], x[:, axis - 1] = side, s, r
            cells.append((square if side > 0 else square[:, ::-1]) + sum(map(len, points)))
            points.append(x / np.linalg.norm(x, axis=1)[:, None])
    x = np.concatenate(points)
    _, first, same = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    x = x[first] @ _TURN.T
    return dc.RigidMesh(center + radius * x, same.ravel()[np.concatenate(cells)])


# so that no edge of the mesh lies at a special place
_TURN = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [-0.4, 1.0, 0.1], [0.3, 0.2, 1.0]]))[0]
_TURN = _TURN * np.sign(np.linalg.det(_TURN))


def punch_2d(at: float = 0.1) -> dc.RigidComposite:
    """A flat punch with rounded corners, in 2D: its face at y = 0."""
    r, half = 0.2, 0.3
    corners = [dc.RigidSphere((at + s * half, r), r) for s in (-1, 1)]
    return dc.RigidComposite([dc.RigidPlane((at, 0), (0, -1), (0, half)), *corners])


def punch_3d() -> dc.RigidComposite:
    """A round flat punch: a disk, its corner and its wall; its face at z = 0."""
    axis, r, ring = (0, 0, 1), 0.2, 0.4
    return dc.RigidComposite(
        [
            dc.RigidPlane((0, 0, 0), (0, 0, -1), (0, ring)),
            dc.RigidTorus((0, 0, r), axis, ring, r),
            dc.RigidCylinder((0, 0, r), axis, ring + r, length=1.0),
        ]
    )


def derivative_error(problem: Any, size: float = 1e-3, step: float = 1e-6) -> float:
    """Relative error of the system's matrix against differences along a random direction, near
    the present solution with the tools where they are now; the worst over the blocks of rows.
    Collective.

    Args:
        size: of the random disturbance of the unknowns
    """
    system = problem.system
    before = system.values()
    system.start()
    start = system.x.copy()
    free = np.ones(system.layout.owned)
    for rows in [system.layout.held_rows(), *(c.held_rows() for c in system.contacts)]:
        free[rows - system.layout.start] = 0.0
    for seed in range(8):  # until no status changes within a step of the differences
        random = np.random.default_rng([seed, problem.comm.rank])
        x, direction, trial, b, product = (start.duplicate() for _ in range(5))
        x.array[:] = start.array_r + size * free * random.uniform(-1, 1, len(free))
        direction.array[:] = free * random.uniform(-1, 1, len(free))
        system.residual(x, b)
        system.jacobian(x, system.A)
        system.A.mult(direction, product)
        sides, changes = [], 0
        for h in (step, -step):
            trial.waxpy(h, direction, x)
            system.residual(trial, b)
            changes += sum(system.changes[:4])
            sides.append(b.array_r.copy())
            system.residual(x, b)
        if changes == 0:
            break
    assert changes == 0
    system.fill(before)

    difference = (sides[0] - sides[1]) / (2 * step)
    sums = []
    for block in range(len(system.functions) + (len(system.driven.tools) > 0)):
        part = system.layout.slice(block)
        error, rows = (difference - product.array_r)[part], product.array_r[part]
        sums.append([error @ error, rows @ rows])
    errors, sizes = np.sqrt(problem.comm.allreduce(np.array(sums))).T
    assert np.all(sizes > 0)
    return float(np.max(errors / np.maximum(sizes, 1e-2 * np.linalg.norm(sizes))))


def statuses(pair: dc.ContactPair) -> dict[str, int]:
    """Number of particles of each status. Collective."""
    status = pair.particles.status
    return {s: pair.comm.allreduce(int(np.sum(status == s))) for s in ("open", "stick", "slip")}
