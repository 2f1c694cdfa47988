# SPDX-License-Identifier: MIT
"""Matching meshes: particles lie exactly on the corners of master facets."""

import numpy as np
import pytest
from mpi4py import MPI
from problems import BOTTOM, MASTER, SLAVE, TOP, Half, Material, one_mesh, small_strain

import dolfinx_contact as dc
from dolfinx_contact import meshes

TARGETS = [dc.Smooth(), dc.Proximity(), dc.SlaveNormal(), dc.SeekDirection((0, 0, 1))]


@pytest.mark.parametrize("target", TARGETS, ids=lambda t: type(t).__name__)
def test_every_particle_on_a_corner_has_a_target(target):
    """Four facets meet there, and round-off must not let all of them refuse it."""
    comm, at = MPI.COMM_WORLD, lambda z: lambda x: np.isclose(x[2], z)
    upper = meshes.grid((12, 12, 1), (0, 0, 0), (1, 1, 1), cell="hexahedron")
    lower = meshes.grid((12, 12, 1), (0, 0, -1), (1, 1, 0), cell="hexahedron")
    halves = [
        Half(upper, {SLAVE: at(0), TOP: at(1)}, {TOP: (0.0, 0.0, -0.01)}),
        Half(lower, {MASTER: at(0), BOTTOM: at(-1)}, {BOTTOM: (0.0, 0.0, 0.0)}),
    ]
    model = one_mesh(comm, halves, Material(small_strain, 1.0, 0.0))
    pair = model.solve(target=target)
    particles = pair.particles
    assert comm.allreduce(len(particles)) == 144 * 25
    assert np.isfinite(particles.gap).all() and np.all(particles.status == "slip")
    assert np.allclose(particles.pressure, 0.005, rtol=1e-9)
