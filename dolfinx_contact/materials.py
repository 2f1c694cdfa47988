# SPDX-License-Identifier: MIT
"""Energies of elastic bodies in UFL: the lines that models have in common.

>>> mu, lmbda = materials.lame(E=210e3, nu=0.3)
>>> psi = materials.neo_hookean(materials.deformation_gradient(u), mu, lmbda)
>>> F = ufl.derivative(psi * ufl.dx, u, w)

Energies are per volume of the reference configuration, and functions of the 3 × 3 deformation gradient.
Moduli are numbers, Constants, or any scalar of UFL. All energies and their stresses vanish in the
reference configuration, and give Hooke's law with μ and λ for small strains.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from ufl.core.expr import Expr

from .checks import is_number, number
from .errors import InputError

GEOMETRIES = ("plane strain", "axisymmetric", "3D")


def lame(E: Any, nu: Any) -> tuple[Any, Any]:
    """Lamé's constants (μ, λ) [pressure] of isotropic elasticity.

    Args:
        E: Young's modulus [pressure]; a number, a Constant or a Function
        nu: Poisson's ratio, likewise

    Raises:
        InputError: numbers that are not E > 0 and −1 < ν < 1/2
    """
    if not isinstance(E, Expr):
        number("materials.lame", "E", E, "a positive, finite number", lambda e: 0 < e < np.inf)
    if not isinstance(nu, Expr) and not (is_number(nu) and -1 < nu < 0.5):
        raise InputError(
            f"materials.lame: ν is {nu!r}; give −1 < ν < 0.5 (nearly incompressible bodies need mixed"
            " elements: docs/mixed.md)."
        )
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def displacement_gradient(u: Any, geometry: str | None = None) -> Any:
    """∇u as a 3 × 3 matrix.

    Args:
        u: displacement [length], of 2 components (or r and z) or 3
        geometry: one of GEOMETRIES; None: "3D" for 3 components, "plane strain" for 2

    Raises:
        InputError: a geometry that u's components do not fit, or an unknown one
    """
    shape = getattr(u, "ufl_shape", None)
    if shape not in ((2,), (3,)):
        raise InputError(
            f"materials: u is {u!s:.80}, of the shape {shape}; give a displacement of 2 or 3 components."
        )
    dim = shape[0]
    geometry = {2: "plane strain", 3: "3D"}[dim] if geometry is None else geometry
    if geometry not in GEOMETRIES or (geometry == "3D") != (dim == 3):
        fit = ("3D",) if dim == 3 else GEOMETRIES[:2]
        raise InputError(
            f"materials: the geometry {geometry!r} with a displacement of {dim} components; give one"
            f" of {fit}."
        )
    G = ufl.grad(u)
    if geometry == "3D":
        return G
    hoop = u[0] / radius(u) if geometry == "axisymmetric" else 0
    return ufl.as_matrix([[G[0, 0], G[0, 1], 0], [G[1, 0], G[1, 1], 0], [0, 0, hoop]])


def deformation_gradient(u: Any, geometry: str | None = None) -> Any:
    """F = 1 + ∇u as a 3 × 3 matrix.

    Args:
        u, geometry: as for displacement_gradient

    Raises:
        InputError: as for displacement_gradient
    """
    return ufl.Identity(3) + displacement_gradient(u, geometry)


def radius(u: Any) -> Any:
    """Distance from the axis r = 0 [length]: integrate 2π r ψ dx for the energy of a whole ring.

    Args:
        u: displacement
    """
    return ufl.SpatialCoordinate(u.function_space.mesh)[0]


def small_strain(u: Any, mu: Any, lmbda: Any, geometry: str | None = None) -> Any:
    """Energy of linear elasticity, μ ε:ε + λ/2 (tr ε)², with ε = sym ∇u.

    Args:
        u, geometry: as for displacement_gradient
        mu, lmbda: Lamé's constants [pressure]

    Raises:
        InputError: as for displacement_gradient
    """
    e = ufl.sym(displacement_gradient(u, geometry))
    return mu * ufl.inner(e, e) + lmbda / 2 * ufl.tr(e) ** 2


def saint_venant_kirchhoff(F: Any, mu: Any, lmbda: Any) -> Any:
    """μ E:E + λ/2 (tr E)² with E = (FᵀF − 1)/2. It softens in compression: small strains only.

    Args:
        F: deformation gradient
        mu, lmbda: Lamé's constants [pressure]
    """
    E = (F.T * F - ufl.Identity(3)) / 2
    return mu * ufl.inner(E, E) + lmbda / 2 * ufl.tr(E) ** 2


def neo_hookean(F: Any, mu: Any, lmbda: Any) -> Any:
    """μ/2 (F:F − 3 − 2 ln J) + λ/2 (ln J)², J = det F.

    J. Bonet and R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis (2008), (6.27).

    Args:
        F: deformation gradient
        mu, lmbda: Lamé's constants [pressure]
    """
    log = ufl.ln(ufl.det(F))
    return mu / 2 * (ufl.inner(F, F) - 3 - 2 * log) + lmbda / 2 * log**2


def mooney_rivlin(F: Any, c1: Any, c2: Any, kappa: Any) -> Any:
    """W = c₁ (Ī₁ − 3) + c₂ (Ī₂ − 3) + κ/2 (J − 1)², with the invariants of J^(−2/3) FᵀF.

    Args:
        F: deformation gradient
        c1, c2: constants [pressure]; μ = 2 (c₁ + c₂)
        kappa: bulk modulus [pressure]; λ = κ − 2/3 μ
    """
    C, J = F.T * F, ufl.det(F)
    first, second = ufl.tr(C), (ufl.tr(C) ** 2 - ufl.tr(C * C)) / 2
    isochoric = c1 * (J ** (-2 / 3) * first - 3) + c2 * (J ** (-4 / 3) * second - 3)
    return isochoric + kappa / 2 * (J - 1) ** 2


def hencky(F: Any, mu: Any, lmbda: Any) -> Any:
    """μ H:H + λ/2 (tr H)², with Hencky's strain H = ½ ln(FᵀF).

    The logarithm is a rational function of C = FᵀF, without eigenvalues: Gauss's rule of seven points
    for ln C = ∫₀¹ (C − 1)(1 + t (C − 1))⁻¹ dt. Principal strains are right to 3e-7 for stretches between
    1/2 and 2, to 1e-4 between 1/3 and 3; tr H = ln J
    is exact.

    Args:
        F: deformation gradient
        mu, lmbda: Lamé's constants [pressure]
    """
    identity = ufl.Identity(3)
    D = F.T * F - identity
    points, weights = np.polynomial.legendre.leggauss(7)
    H = sum(
        float(w) / 4 * D * ufl.inv(identity + float((1 + t) / 2) * D)
        for t, w in zip(points, weights)
    )
    return mu * ufl.inner(H, H) + lmbda / 2 * ufl.ln(ufl.det(F)) ** 2
