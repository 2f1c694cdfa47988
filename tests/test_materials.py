# SPDX-License-Identifier: MIT
"""Energies of dc.materials against NumPy at random deformations, and their limits."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import compat, materials, meshes

MU, LMBDA = 3.0, 7.0
C1, C2 = 1.1, 0.4
KAPPA = LMBDA + 2 / 3 * 2 * (C1 + C2)


def numpy_energies(F):
    """At a 3 × 3 matrix; for hencky by Schur's form."""
    C, J, one = F.T @ F, np.linalg.det(F), np.eye(3)
    E, H = (C - one) / 2, logm(C).real / 2
    second = (np.trace(C) ** 2 - np.trace(C @ C)) / 2
    ln = np.log(J)
    return {
        "saint_venant_kirchhoff": MU * np.sum(E * E) + LMBDA / 2 * np.trace(E) ** 2,
        "neo_hookean": MU / 2 * (np.trace(C) - 3 - 2 * ln) + LMBDA / 2 * ln**2,
        "mooney_rivlin": C1 * (np.trace(C) / J ** (2 / 3) - 3)
        + C2 * (second / J ** (4 / 3) - 3)
        + KAPPA / 2 * (J - 1) ** 2,
        "hencky": MU * np.sum(H * H) + LMBDA / 2 * np.trace(H) ** 2,
    }


LAWS = ("saint_venant_kirchhoff", "neo_hookean", "mooney_rivlin", "hencky")


def energy(law, F):
    moduli = (C1, C2, KAPPA) if law == "mooney_rivlin" else (MU, LMBDA)
    return getattr(materials, law)(F, *moduli)


def affine(gradient, offset=0.0):
    """A displacement of a unit cube or square (one cell on each rank, on its own)."""
    dim = len(gradient)
    lower = np.array([offset] + [0.0] * (dim - 1))
    cell = {2: "quadrilateral", 3: "hexahedron"}[dim]
    box = meshes.grid((1,) * dim, lower, lower + 1, cell=cell)
    mesh = meshes.create(MPI.COMM_SELF, [box])[0]
    u = fem.Function(compat.vector_space(mesh, 1))
    u.interpolate(lambda x: gradient @ x[:dim])
    return u


def integral(density, u):
    dx = ufl.dx(u.function_space.mesh, metadata={"quadrature_degree": 2})
    return fem.assemble_scalar(fem.form(density * dx))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("dim", (2, 3))
def test_energy(law, dim):
    for seed in range(3):
        G = 0.3 * np.random.default_rng(seed).uniform(-1, 1, (dim, dim))
        u = affine(G)
        F = np.eye(3)
        F[:dim, :dim] += G
        found = integral(energy(law, materials.deformation_gradient(u)), u)
        np.testing.assert_allclose(found, numpy_energies(F)[law], rtol=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_objective(law):
    """A rotation after the deformation changes nothing."""
    G = 0.3 * np.random.default_rng(5).uniform(-1, 1, (3, 3))
    turn = Rotation.from_euler("xyz", [0.4, -1.0, 0.7]).as_matrix()
    still, turned = affine(G), affine(turn @ (np.eye(3) + G) - np.eye(3))
    found = [integral(energy(law, materials.deformation_gradient(u)), u) for u in (still, turned)]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_small_strains(law):
    """Hooke's law: the second derivative, and no stress at first."""
    G = np.random.default_rng(7).uniform(-1, 1, (3, 3))
    u, v = affine(np.zeros((3, 3))), affine(G)
    direction = fem.Function(u.function_space)
    direction.x.array[:] = v.x.array
    psi = energy(law, materials.deformation_gradient(u))
    first = ufl.derivative(psi, u, direction)
    assert abs(integral(psi, u)) < 1e-12
    assert abs(integral(first, u)) < 1e-12
    mu = 2 * (C1 + C2) if law == "mooney_rivlin" else MU  # KAPPA was chosen so that λ is LMBDA
    hooke = integral(materials.small_strain(v, mu, LMBDA), v)
    e = (G + G.T) / 2
    np.testing.assert_allclose(
        hooke, mu * np.sum(e * e) + LMBDA / 2 * np.trace(e) ** 2, rtol=1e-12
    )
    second = integral(ufl.derivative(first, u, direction), u)
    np.testing.assert_allclose(second, 2 * hooke, rtol=1e-10)


def test_axisymmetric():
    """A ring that grows by a tenth, from r = 2 to 3: hoop stretch 1.1; its volume by 2πr."""
    u = affine(np.diag([0.1, 0.0]), offset=2.0)
    F = materials.deformation_gradient(u, "axisymmetric")
    r = materials.radius(u)
    np.testing.assert_allclose(integral(2 * np.pi * r, u), np.pi * (9 - 4), rtol=1e-12)
    stretched = numpy_energies(np.diag([1.1, 1.0, 1.1]))["neo_hookean"]
    found = integral(2 * np.pi * r * materials.neo_hookean(F, MU, LMBDA), u)
    np.testing.assert_allclose(found, stretched * 5 * np.pi, rtol=1e-10)


def test_lame():
    mu, lmbda = materials.lame(210e3, 0.3)
    np.testing.assert_allclose(mu * (3 * lmbda + 2 * mu) / (lmbda + mu), 210e3)
    np.testing.assert_allclose(lmbda / (2 * (lmbda + mu)), 0.3)
    with pytest.raises(dc.InputError, match="positive"):
        materials.lame(-1.0, 0.3)
    with pytest.raises(dc.InputError, match="mixed"):
        materials.lame(1.0, 0.5)


def test_geometries():
    with pytest.raises(dc.InputError, match="plane strain"):
        materials.deformation_gradient(affine(np.eye(2)), "3D")
    with pytest.raises(dc.InputError, match="3D"):
        materials.deformation_gradient(affine(np.eye(3)), "axisymmetric")
    with pytest.raises(dc.InputError, match="plane stress"):
        materials.deformation_gradient(affine(np.eye(2)), "plane stress")
