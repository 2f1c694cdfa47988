# SPDX-License-Identifier: MIT
"""The stretched sheet (benchmarks, 4) at a small size: its partition, mesh and steps do not matter."""

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import ufl
import dolfinx_contact as dc
from dolfinx_contact import meshes, plasticity
from dolfinx_contact.compat import vector_space

R0, PUNCH, CORNER = 59.18, 50.8, 6.35


def stretch(comm, facets=30, layers=1, step=1.0, travel=20.0, friction=0.3):
    """Forces of punch and die [N], and the plastic strain of the whole sheet [volume]."""
    mesh, _ = meshes.create(comm, [meshes.grid((facets, layers), (0, 0), (R0, 1))])
    at = lambda i, value: lambda x: np.isclose(x[i], value)
    tags = meshes.tag_facets(mesh, {5: at(1, 1), 6: at(1, 0), 1: at(0, 0), 2: at(0, R0)})
    V = vector_space(mesh, 2)
    u, w = fem.Function(V), ufl.TestFunction(V)
    law = plasticity.Swift(K=589, eps0=1e-4, n=0.216)
    sheet = plasticity.J2(u, 69004.0, 0.3, law, quadrature_degree=4, kind="axisymmetric")
    axis = fem.locate_dofs_topological(V.sub(0), 1, tags.find(1))
    edge = fem.locate_dofs_topological(V, 1, tags.find(2))
    bcs = [fem.dirichletbc(0.0, axis, V.sub(0)), fem.dirichletbc(np.zeros(2), edge, V)]
    punch, die = dc.RigidSphere((0, 1 + PUNCH), PUNCH), dc.RigidSphere((R0, -CORNER), CORNER)
    pairs = [
        dc.ContactPair(dc.Surface(u, tags, tag), tool, friction=friction, axisymmetric=True)
        for tag, tool in ((5, punch), (6, die))
    ]
    problem = dc.ContactProblem(sheet.work(w), u, pairs, bcs=bcs, materials=[sheet])
    for _ in dc.LoadStepping(
        problem,
        lambda t: punch.move((0, -t)),
        end=travel,
        step=step,
        min_step=1e-3,
        progress=False,
    ):
        pass
    strain = sheet.plastic_strain * ufl.SpatialCoordinate(mesh)[0] * sheet.dx
    total = comm.allreduce(fem.assemble_scalar(fem.form(strain)))
    return np.array([punch.force()[1], die.force()[1], total])


@pytest.fixture(scope="module")
def serial():
    return stretch(MPI.COMM_SELF)


@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares partitions")
def test_parallel_is_serial(serial):
    np.testing.assert_allclose(stretch(MPI.COMM_WORLD), serial, rtol=1e-7)


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="serial runs")
@pytest.mark.parametrize("finer", [{"facets": 60}, {"layers": 2}, {"step": 0.5}], ids=str)
def test_refinement(serial, finer):
    """Forces and strains change by less than 2 %. (The die's force is that of the clamp and its
    together, where the clamp is at the point of tangency; it is left out.)"""
    change = stretch(MPI.COMM_SELF, **finer) / serial - 1
    assert np.all(np.abs(change[[0, 2]]) < 0.02), change
