# SPDX-License-Identifier: MIT
"""Finite-strain J2 plasticity (Simo 1992): F = F_e F_p, Hencky elasticity, isotropic hardening.

>>> sheet = plasticity.J2(u, E=69004.0, nu=0.3, hardening=plasticity.Swift(589, 1e-4, 0.216))
>>> F = ufl.inner(sheet.P, sheet.grad(w)) * sheet.dx
>>> problem = ContactProblem(F, u, [pair], bcs=bcs, materials=[sheet])
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from . import _cpp, compat
from . import hardening as _hardening
from .checks import agreed, is_number
from .errors import InputError, together
from .hardening import Hardening, Linear, Swift, Tabulated, Voce
from .quadrature import QuadratureLaw

__all__ = ["J2", "Linear", "Swift", "Tabulated", "Voce"]

log = logging.getLogger("dolfinx_contact")
Array = npt.NDArray[np.float64]

_KINDS = {"plane strain": 2, "axisymmetric": 2, "3D": 3}
# Components of a 3 × 3 tensor that vary where the third axis is principal
_BLOCK = ((0, 0), (0, 1), (1, 0), (1, 1), (2, 2))


class J2(QuadratureLaw):
    """Hencky elasticity and von Mises plasticity, integrated with the exponential map.

    Elastic energy is λ/2 (tr ε)² + μ ε:ε in the logarithmic elastic strain ε; plastic flow keeps the
    volume, so that linear elements lock: take quadratic ones, or a mixed F. State is kept in three
    dimensions also where the mesh has two. The construction is collective.

    Args:
        u: displacement
        E: Young's modulus, positive [stress]
        nu: Poisson's ratio, −1 < nu < 1/2
        hardening: Swift, Linear, Voce, Tabulated, or a function of an array of plastic strains that
            returns yield stresses and slopes (arrays)
        quadrature_degree: of the points; 2 is enough for linear elements, and for quadratic triangles
            and tetrahedra; quadratic quadrilaterals and hexahedra need 4, or they have hourglasses
        F: deformation gradient of u and maybe other unknowns in place of I + grad u: F̄ of a mixed
            or F-bar method; (2, 2) for plane strain, else (3, 3)
        kind: "plane strain" (the default in 2D), "axisymmetric" about x[0] = 0 (components in the
            order r, z, θ) or "3D"
        dx, cells: see QuadratureLaw

    Raises:
        InputError: on all ranks: values out of range, u or F of another shape

    Attributes:
        P: first Piola–Kirchhoff stress, of the shape of F: (3, 3) in 3D and axisymmetric, (2, 2) in
            plane strain
        plastic_strain: ε_p of the last accepted step; a quadrature Function, as the next ones
        elastic_volume: tr ε there, from the stress; exp of it is det F
        kirchhoff: τ there, (3, 3)
    """

    def __init__(
        self,
        u: fem.Function,
        E: float,
        nu: float,
        hardening: Hardening = Swift(K=589, eps0=1e-4, n=0.216),
        quadrature_degree: int = 2,
        *,
        F: Any = None,
        kind: str | None = None,
        dx: Any = None,
        cells: npt.NDArray[np.int32] | None = None,
    ):
        if not isinstance(u, fem.Function):
            raise InputError(f"J2: u is a {type(u).__name__}; give the displacement, a Function.")
        mesh = u.function_space.mesh
        dim = mesh.geometry.dim
        kind = ("plane strain" if dim == 2 else "3D") if kind is None else kind
        with together(mesh.comm, "J2"):
            numbers = is_number(E) and is_number(nu)
            if not numbers or not (0 < E < np.inf and -1 < nu < 0.5):
                raise InputError(
                    f"J2: E is {E!r} and nu {nu!r}; give a finite E > 0 and −1 < nu < 1/2."
                )
        agreed(
            mesh.comm, "J2", E=E, nu=nu, quadrature_degree=quadrature_degree, hardening=hardening
        )
        if kind not in list(_KINDS) or _KINDS[kind] != dim or mesh.topology.dim != dim:
            raise InputError(
                f"J2: kind is {kind!r} on a mesh of dimension {mesh.topology.dim} in {dim}D; give"
                ' "plane strain" or "axisymmetric" in 2D, "3D" in 3D.'
            )
        if compat.value_shape(u.function_space) != (dim,):
            raise InputError(
                f"J2: u has values of shape {compat.value_shape(u.function_space)}; give a displacement"
                f" with {dim} components."
            )
        _hardening.check(hardening)
        self.u, self.kind, self.hardening = u, kind, hardening
        X = ufl.SpatialCoordinate(mesh)
        if F is None:
            F = ufl.Identity(dim) + ufl.grad(u)
            if kind == "axisymmetric":
                F = _blocks([F[0, 0], F[0, 1], F[1, 0], F[1, 1], 1 + u[0] / X[0]])
        allowed = [(3, 3), (2, 2)] if kind == "plane strain" else [(3, 3)]
        shape = getattr(F, "ufl_shape", "of no UFL")
        if shape not in allowed:
            raise InputError(f"J2: F has the shape {shape}; for {kind} give one of {allowed}.")
        # only what varies of F goes through the kernel
        varies = F if dim == 3 or F.ufl_shape == (2, 2) else ufl.as_vector([F[i] for i in _BLOCK])
        self.lmbda, self.mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        points = _Points(self.lmbda, self.mu, hardening)
        super().__init__(varies, points, quadrature_degree, dx=dx, cells=cells)
        self.F = F
        if self.P.ufl_shape == (5,):
            self.P = _blocks(self.P)
        self._weight = 2 * np.pi * X[0] if kind == "axisymmetric" else 1
        self.plastic_strain = self.field((), "plastic_strain")
        self.elastic_volume = self.field((), "elastic_volume")
        self.kirchhoff = self.field((3, 3), "kirchhoff")

    def grad(self, w: Any) -> Any:
        """Variation of F with the displacement: ∇w, in axial symmetry with w_r/r in the third place.

        ``inner(P, grad(w))`` is virtual work for all kinds and all F.

        Args:
            w: test function of the displacement, or another direction

        Returns:
            UFL of P's shape
        """
        return self.variation(self.u, w)

    def work(self, w: Any) -> Any:
        """The form P : grad(w) dx, in axial symmetry 2πr P : grad(w) dx.

        Args:
            w: test function of the displacement
        """
        return self._weight * ufl.inner(self.P, self.grad(w)) * self.dx

    @property
    def J(self) -> Any:
        """Jacobian of ``work`` with u, a bilinear form."""
        form = self.work(ufl.TestFunction(self.u.function_space))
        J = self.tangent(form, self.u)
        return J + ufl.derivative(form, self.u) if self.u in form.coefficients() else J

    def commit(self) -> None:
        super().commit()
        self._fill_results()

    def set_state(self, columns: dict[str, Array]) -> None:
        super().set_state(columns)
        self._fill_results()

    def _fill_results(self) -> None:
        ep, tau = self.law.ep, self.law.tau
        self.fill(self.plastic_strain, ep)
        volume = tau[:, :3].sum(axis=1) / (3 * self.lmbda + 2 * self.mu)
        self.fill(self.elastic_volume, volume)
        self.fill(self.kirchhoff, tau[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]])


class _Points:
    """The law at points: (4,), (5,) or (3, 3) components of F in, C_p⁻¹ and ε_p kept."""

    def __init__(self, lmbda: float, mu: float, hardening: Hardening):
        self._lame, self._hardening = (lmbda, mu), hardening
        self._old: tuple[Array, Array] | None = None  # C_p⁻¹, ε_p of the last accepted step

    def update(self, F: Array) -> tuple[Array, Array]:
        n, shape = len(F), F.shape[1:]
        k = int(np.prod(shape))
        F = np.ascontiguousarray(F).reshape(n, k)
        if self._old is None:
            self._old = np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros(n)
            self.cp, self.ep = (a.copy() for a in self._old)
            self.tau = np.zeros((n, 6))
        P, A = np.empty((n, k)), np.empty((n, k, k))
        arrays = (k, F, *self._old, self.cp, self.ep, self.tau, P, A)
        kernel = getattr(self._hardening, "_kernel", None)
        if kernel is not None:
            bad = _cpp.j2_update(*self._lame, kernel, *arrays)
        else:
            q = _cpp.j2_trial_stress(*self._lame, k, F, self._old[0])
            flow = _hardening.flow(self._hardening, self._lame[1], q, self._old[1])
            bad = _cpp.j2_update_given(*self._lame, flow, *arrays)
        if bad:
            log.info("plasticity: det F is not positive at %d points", bad)
        return P.reshape(n, *shape), A.reshape(n, *shape, *shape)

    def commit(self) -> None:
        self._old = self.cp.copy(), self.ep.copy()

    def restore(self) -> None:
        self.cp[:], self.ep[:] = self._old

    def state(self) -> list[Array]:
        return [*self._old, self.tau]

    def set_state(self, state: list[Array]) -> None:
        *old, self.tau = (np.ascontiguousarray(a) for a in state)
        self._old = tuple(old)
        self.cp, self.ep = (a.copy() for a in old)


def _blocks(c: Any) -> Any:
    """The 3 × 3 tensor of the components of _BLOCK."""
    return ufl.as_tensor([[c[0], c[1], 0], [c[2], c[3], 0], [0, 0, c[4]]])
