# SPDX-License-Identifier: MIT
"""Pressure on the current area: uniform states known in closed form, and forces that are the same."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.stretch import area_stretch

COMM = MPI.COMM_WORLD
E, NU = 1.0, 0.3
SQUEEZE = 0.2


def squeezed(cell, degree=1, axisymmetric=False, space=("Lagrange", 1)):
    """A block that may slide on all its sides, squeezed on a rigid plane; the pair and u."""
    dim = 3 if cell in ("tetrahedron", "hexahedron") else 2
    mesh, _ = meshes.create(COMM, meshes.grid([3] * dim, [0] * dim, [1] * dim, cell=cell))
    at = lambda i, v: lambda x: np.isclose(x[i], v)  # noqa: E731
    tags = meshes.tag_facets(
        mesh, {1: at(dim - 1, 0), 2: at(dim - 1, 1), **{3 + i: at(i, 0) for i in range(dim - 1)}}
    )
    V = compat.vector_space(mesh, degree)
    u, w = fem.Function(V), ufl.TestFunction(V)
    F = dc.materials.deformation_gradient(u, "axisymmetric" if axisymmetric else None)
    psi = dc.materials.neo_hookean(F, *dc.materials.lame(E, NU))
    factor = 2 * np.pi * dc.materials.radius(u) if axisymmetric else 1
    form = ufl.derivative(factor * psi * ufl.dx(mesh, metadata={"quadrature_degree": 4}), u, w)
    bcs = []
    for i, tag, value in [(dim - 1, 2, -SQUEEZE), *((i, 3 + i, 0.0) for i in range(dim - 1))]:
        W = V.sub(i)
        dofs = fem.locate_dofs_topological(W, dim - 1, tags.find(tag))
        bcs.append(fem.dirichletbc(value, dofs, W))
    plane = dc.RigidPlane(np.zeros(dim), np.eye(dim)[-1])
    pair = dc.ContactPair(
        dc.Surface(u, tags, 1), plane, axisymmetric=axisymmetric, pressure_space=space
    )
    dc.ContactProblem(form, u, [pair], bcs=bcs).solve()
    return pair, u


@pytest.mark.parametrize(
    "cell, degree, axisymmetric, space",
    (
        ("quadrilateral", 1, False, ("Lagrange", 1)),
        ("triangle", 2, False, ("DG", 0)),
        ("quadrilateral", 2, True, ("Lagrange", 1)),
        ("hexahedron", 1, False, ("Lagrange", 1)),
        ("tetrahedron", 1, False, ("Lagrange", 1)),
    ),
)
def test_uniform_squeeze(cell, degree, axisymmetric, space):
    """The block grows sideways by a factor b: area by b (plane strain), or b²; pressures shrink."""
    pair, u = squeezed(cell, degree, axisymmetric, space)
    dim = pair.slave.dim
    n = u.function_space.dofmap.index_map.size_local
    sideways = u.x.array[: dim * n].reshape(n, dim)[:, 0].max(initial=0.0)
    b = 1 + COMM.allreduce(sideways, op=MPI.MAX)
    assert b > 1.05
    growth = b ** (2 if axisymmetric or dim == 3 else 1)
    nominal, true = pair.pressure.x.array, pair.true_pressure.x.array
    p = COMM.allreduce(nominal.max(initial=0.0), op=MPI.MAX)
    np.testing.assert_allclose(nominal, p, rtol=1e-7)
    np.testing.assert_allclose(true, p / growth, rtol=1e-7)
    assert p > 0.1 * E


def test_bent_facets():
    """At each node the force of an element of the surface is the same, by either pressure."""
    mesh, _ = meshes.create(COMM, meshes.grid((6, 3), (0, 0), (2, 1)))
    on = lambda y: lambda x: np.isclose(x[1], y)  # noqa: E731
    tags = meshes.tag_facets(mesh, {5: on(0), 1: on(1)})
    V = compat.vector_space(mesh, 2)
    u, w = fem.Function(V), ufl.TestFunction(V)
    psi = dc.materials.neo_hookean(dc.materials.deformation_gradient(u), *dc.materials.lame(E, NU))
    F = ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 4}), u, w)
    bcs = [fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, tags.find(1)), V)]
    punch = dc.RigidSphere((1, -1), 1.0)
    pair = dc.ContactPair(dc.Surface(u, tags, 5), punch)
    with pytest.raises(dc.ContactError, match="solve it first"):
        pair.true_pressure
    problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
    for _ in dc.LoadStepping(
        problem, lambda t: punch.move((0, 0.2 * t)), step=0.25, progress=False
    ):
        pass
    ends, true = np.array([[0.0], [1.0]]), pair.true_pressure
    stretch = area_stretch(pair, ends)
    assert COMM.allreduce(np.abs(stretch - 1).max(initial=0.0), op=MPI.MAX) > 0.02
    at_ends = true.x.array[compat.dof_list(true.function_space)[: len(stretch)]]
    nodes = compat.dof_list(pair.pressure.function_space)[: len(stretch)]
    np.testing.assert_allclose(at_ends * stretch, pair.pressure.x.array[nodes], atol=1e-14)
    assert pair.true_pressure is true
    # and the stretch is that of the surface as it is drawn: its length by chords
    points, weights = np.polynomial.legendre.leggauss(6)
    stretch = area_stretch(pair, 0.5 + 0.5 * points[:, None])
    length = COMM.allreduce(0.5 * (stretch @ weights).sum() / 3)  # facets of 1/3
    drawn = dc.plot.gather_pressure(pair, parts=64)
    if drawn is not None:
        chords = np.linalg.norm(np.diff(drawn[0], axis=1), axis=2).sum()
        assert chords == pytest.approx(length, rel=1e-5) and length > 2.01
