# SPDX-License-Identifier: MIT
"""Newton converges quadratically on a curved sliding interface in 3D, with interpolated normals.

A block with a rounded face slides over a bumpy slab, both neo-Hookean, partly in contact. Statuses
do not change while orders are measured: the tangent must be the exact derivative then, with the
targets' motion over the facets and that of the nodal normals (F6'), (F8').
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from problems import BOTTOM, MASTER, PUNCH_MATERIAL, SLAVE, TOP, Half, Model, one_mesh, powers

import dolfinx_contact as dc
from dolfinx_contact import meshes

COMM = MPI.COMM_WORLD
SHARP = dc.Newton(rtol=1e-12)
DEPTH, SLIDE = 0.06, (0.13, 0.07)  # slab facets are 0.25 wide


def bumps(x, y):
    """Height of the slab: convex and concave, ridges of about 10 degrees between facets."""
    return 0.05 * np.sin(4.0 * x + 0.4) * np.cos(3.0 * y - 0.2)


def roundness(x, y):
    """Height of the block's lower face above its lowest point."""
    return 0.25 * ((x - 0.53) ** 2 + (y - 0.46) ** 2)


def bumpy(cell) -> Model:
    """The block just above the slab."""
    lift = 0.05

    def block(x):
        z = x.copy()
        z[:, 2] += lift + (1 - x[:, 2] / 0.6) * roundness(x[:, 0], x[:, 1])
        return z

    def slab(x):
        z = x.copy()
        z[:, 2] += (1 + x[:, 2] / 0.5) * bumps(x[:, 0], x[:, 1])
        return z

    upper = meshes.grid((4, 4, 2), (0.12, 0.13, 0), (0.93, 0.91, 0.6), block, cell)
    lower = meshes.grid((6, 6, 2), (-0.25, -0.27, -0.5), (1.28, 1.25, 0), slab, cell)
    halves = [
        Half(
            upper,
            {
                SLAVE: lambda x: np.isclose(x[2], lift + roundness(x[0], x[1])),
                TOP: lambda x: np.isclose(x[2], lift + 0.6),
            },
            {TOP: (0.0, 0.0, -DEPTH)},
        ),
        Half(
            lower,
            {
                MASTER: lambda x: np.isclose(x[2], bumps(x[0], x[1])),
                BOTTOM: lambda x: np.isclose(x[2], -0.5),
            },
            {BOTTOM: (0.0, 0.0, 0.0)},
        ),
    ]
    return one_mesh(COMM, halves, PUNCH_MATERIAL)


def targets(pair):
    """Target facets of this rank's closed particles, −1 for open ones."""
    p = pair.particles
    return np.where(p.status == "open", -1, p.target_facet)


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
def test_newton_is_quadratic_on_a_curved_sliding_interface(cell, record_property):
    """Few iterations for a slide of half a facet in one step; then, from the solution disturbed by
    ε, the residuals go with ε, ε² and ε⁴, which gives two successive orders of convergence."""
    model = bumpy(cell)
    # particles that start a step closed because they are near would change their status
    pair = model.pair(target=dc.Smooth(), initial_contact=0.0)
    problem = model.problem(pair, strategy=SHARP)
    assert problem.solve().iterations <= 7
    before = targets(pair)
    model.move(TOP, (*SLIDE, -DEPTH))
    report = problem.solve()
    # six or so in which particles close, open and cross facets, and two without: 8 and 7 measured
    assert report.iterations <= 8
    record_property("slide", (report.iterations, report.status_changes))
    after = targets(pair)
    crossed = (after >= 0) & (before >= 0) & (after != before)
    assert COMM.allreduce(int(crossed.sum())) >= 50
    assert COMM.allreduce(int((after < 0).sum())) > 0  # partly in contact

    x = model.u.function_space.tabulate_dof_coordinates()
    wave = np.sin(x @ np.array([[3.0, 1.0, 2.0], [-1.0, 2.0, 1.0], [2.0, -3.0, 1.0]]) + 0.3)
    first, second, third = powers(problem, model.u, 5e-4 * wave, most=3)
    orders = second / first, third / second
    record_property("orders", orders)
    assert first == pytest.approx(1, abs=0.05)  # ε
    assert all(1.9 < order < 2.1 for order in orders), orders
