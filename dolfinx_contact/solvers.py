# SPDX-License-Identifier: MIT
"""Presets of PETSc options for the linear systems of Newton's iterations.

>>> problem = ContactProblem(F, u, pairs, bcs=bcs, petsc_options=solvers.iterative())

The iterative one preconditions the saddle point of displacements u and multipliers m (λ, Λ),

    A = [A_uu A_um; A_mu A_mm]

by the augmented (regularised) matrix R, in which the multipliers have a scaled mass matrix D, which is
eliminated:

    R = [A_uu A_um; A_mu D],   D = A_mm − γ⁻¹ A_mu diag(A_uu)⁻¹ A_um
    R⁻¹ r:  u = K⁻¹ (r_u − A_um D⁻¹ r_m),  m = D⁻¹ (r_m − A_mu u),   K = A_uu − A_um D⁻¹ A_mu

as in augmented Lagrangian preconditioners (M. Benzi and M. A. Olshanskii, SIAM J. Sci. Comput. 28
(2006); M. Benzi, G. H. Golub and J. Liesen, Acta Numerica 14 (2005)). In contact A_mm is zero, and the
eigenvalues of R⁻¹A are 1 and those of (S + γ⁻¹ S_D)⁻¹ S, with the Schur complement S = A_mu A_uu⁻¹ A_um
and S_D that of the diagonal. A facet's size h, a pressure of wave length ℓ and Young's modulus E give
S ~ ℓ/E and S_D ~ h/E times the mass matrix; since ℓ ≥ h, the eigenvalues stay between a constant and 1
on any mesh. Rows of open particles are in A_mm, and D has them exactly. K⁻¹ is one cycle of multigrid
(multigrid.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from .errors import InputError
from .multigrid import Hierarchy, mended

__all__ = ["direct", "iterative"]

_DIFFERENT = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


def direct(**options: Any) -> dict[str, Any]:
    """LU factors by MUMPS: the default.

    Args:
        options: further ones of PETSc, which overrule those here

    Returns:
        for ContactProblem's petsc_options
    """
    return {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        # Multipliers delay pivots: MUMPS's own 20 % of room to spare may be too little (error -9).
        "mat_mumps_icntl_14": 50,
        **options,
    }


def iterative(**options: Any) -> dict[str, Any]:
    """FGMRES with a multigrid cycle on the augmented displacement block, for large 3D problems.

    For displacements in Lagrange spaces, of one mesh or several, with any pairs. With other unknowns
    (mixed models) the problem's ``solve`` raises an InputError.

    Args:
        options: further ones of PETSc, which overrule those here; those of the multigrid begin with
            contact_ (contact_mg_levels_ksp_max_it=3), and contact_gamma is γ (1)

    Returns:
        for ContactProblem's petsc_options
    """
    return {
        "ksp_type": "fgmres",
        "ksp_rtol": 1e-6,
        "ksp_max_it": 300,
        "ksp_gmres_restart": 50,
        "pc_type": "python",
        "pc_python_type": "dolfinx_contact.solvers.SaddlePoint",
        **options,
    }


class SaddlePoint:
    """PETSc's python preconditioner R⁻¹. NewtonLoop tells it the system."""

    def __init__(self) -> None:
        self._system: Any = None
        self._applied = 0  # since the last setUp
        self._cycle: Any = None
        self._coarse: list[Any] = []
        self._augmented: Any = None

    def use(self, system: Any, prefix: str) -> None:
        """Precondition the matrices of a system: with its hierarchy, or a new one. Collective.

        A new one takes much memory in passing; the system's matrix, whose numbers are not needed
        now, makes room for that and is made anew.

        Args:
            system: that has been started
            prefix: of PETSc's options

        Raises:
            InputError: a bulk unknown is not a displacement
        """
        for u in system.u:
            dim = u.function_space.mesh.geometry.dim
            if u.function_space.dofmap.index_map_bs != dim:
                raise InputError(
                    f"solvers.iterative: the unknown {u.name} is not a displacement with {dim}"
                    " components; mixed models need the default, solvers.direct()."
                )
        if system.hierarchy is not None and system.hierarchy.worn:
            system.hierarchy.free()
            system.hierarchy = None
        if system.hierarchy is None:
            system.A.destroy()
            try:
                system.hierarchy = Hierarchy(system, prefix + "contact_")
            finally:
                system.A = system.new_matrix()
        self._system = system

    def setUp(self, pc: Any) -> None:
        """For the present matrix. Collective.

        Raises:
            InputError: the solver is not that of a ContactProblem
        """
        self.reset(pc)
        if self._system is None:
            raise InputError("solvers.SaddlePoint only works within a ContactProblem.")
        hierarchy = self._system.hierarchy
        A, layout, prefix = pc.getOperators()[1], self._system.layout, pc.getOptionsPrefix() or ""
        prefix += "contact_"
        if not np.isfinite(A.norm(PETSc.NormType.FROBENIUS)):
            return
        self._cycle = PETSc.PC().create(layout.comm)
        self._cycle.setOptionsPrefix(prefix)
        if not hierarchy.P:  # few unknowns
            self._cycle.setOperators(A, A)
            _factor(self._cycle)
            return
        gamma = PETSc.Options().getReal(prefix + "gamma", 1.0)
        bulk = int(layout.offsets[len(self._system.u)])
        self._augmented = _Augmented(
            A, layout, bulk, gamma, exactly=len(self._system.driven.tools) > 0
        )
        self._coarse = hierarchy.operators(self._augmented.coarse(hierarchy.P[0]))
        levels = [*reversed(self._coarse), self._augmented.matrix]
        self._cycle.setType("mg")
        self._cycle.setMGLevels(len(levels))
        self._cycle.setOperators(levels[-1], levels[-1])
        for level, K in enumerate(levels):
            if level == 0:
                solver = self._cycle.getMGCoarseSolve()
                solver.setType("preonly")
                _factor(solver.pc)
            else:
                solver = self._cycle.getMGSmoother(level)
                solver.setType("chebyshev")
                solver.pc.setType("jacobi")
                self._cycle.setMGInterpolation(level, hierarchy.P[-level])
            solver.setOperators(K, K)
        self._cycle.setFromOptions()
        self._cycle.setUp()

    def apply(self, pc: Any, r: Any, y: Any) -> None:
        """y = R⁻¹ r. Collective."""
        self._applied += 1
        if self._cycle is None:  # the matrix is not finite: PETSc ends the solve
            y.set(np.nan)
        elif self._augmented is None:
            self._cycle.apply(r, y)
        else:
            self._augmented.eliminate(self._cycle, r, y)

    def reset(self, pc: Any) -> None:
        """Forget the last matrix."""
        if self._applied > 0:
            self._system.hierarchy.count(self._applied)
        self._applied = 0
        for thing in (self._cycle, *self._coarse):
            if thing is not None:
                thing.destroy()
        if self._augmented is not None:
            self._augmented.free()
        self._cycle = self._augmented = None
        self._coarse = []


class _Augmented:
    """K = A_uu − A_um D⁻¹ A_mu, as a matrix of the whole system with 1 for the multipliers.

    Nothing of A_uu is copied. The construction is collective.

    Args:
        A: matrix of the system
        layout: its numbering
        bulk: number of owned displacement dofs, which come first
        gamma: γ, the augmentation in units of the diagonal of A_uu
        exactly: solve with D exactly, else by incomplete factors of each rank's part. These are as
            good on a surface, but not for travels of tools, which couple to all of it

    Attributes:
        matrix: K for PETSc
    """

    def __init__(self, A: Any, layout: Any, bulk: int, gamma: float, exactly: bool):
        self._A, self._bulk = A, bulk
        rows = layout.start + np.arange(layout.owned, dtype=PETSc.IntType)
        # no strides: with those PETSc 3.18 returns wrong submatrices on one rank
        whole = PETSc.IS().createGeneral(rows, comm=layout.comm)
        multipliers = PETSc.IS().createGeneral(rows[bulk:], comm=layout.comm)
        # A_um and A_mu, with A_mm below and beside them
        self._columns = _part(A, whole, multipliers)
        self._rows = _part(A, multipliers, whole)
        compliance = _inverse_diagonal(A)
        compliance.array[bulk:] = 0.0
        compliance.scale(-1.0 / gamma)
        scaled = self._columns.copy()
        scaled.diagonalScale(compliance, None)
        self._D = self._rows.matMult(scaled)
        square = _part(A, multipliers, multipliers)
        self._D.axpy(1.0, square, structure=_DIFFERENT)
        self._solver = PETSc.KSP().create(layout.comm)
        self._solver.setOperators(self._D)
        self._solver.setType("preonly")
        if exactly:
            _factor(self._solver.pc)
        else:
            self._solver.pc.setType("bjacobi")
        for thing in (whole, multipliers, compliance, scaled, square):
            thing.destroy()
        self._any = self._D.getSize()[0] > 0
        if self._any:
            self._solver.setUp()
        self._x, self._y = A.createVecs()
        self._b = A.createVecLeft()
        self._r, self._m = self._D.createVecs()
        self.matrix = PETSc.Mat().createPython(A.getSizes(), self, comm=layout.comm)
        self.matrix.setUp()

    def free(self) -> None:
        """Free the memory: PETSc 3.18 keeps what Python merely lets go of."""
        for thing in (self.matrix, self._solver, self._D, self._rows, self._columns):
            thing.destroy()
        for vector in (self._x, self._y, self._b, self._r, self._m):
            vector.destroy()

    def _solve(self, r: npt.NDArray[np.float64]) -> Any:
        """D⁻¹ r. Collective."""
        self._r.array[:] = r
        if self._any:
            self._solver.solve(self._r, self._m)
        return self._m

    def mult(self, matrix: Any, x: Any, y: Any) -> None:
        """y = K x. Collective."""
        bulk = self._bulk
        x.copy(self._x)
        self._x.array[bulk:] = 0.0
        self._A.mult(self._x, y)
        self._columns.mult(self._solve(y.array_r[bulk:]), self._y)
        y.axpy(-1.0, self._y)
        y.array[bulk:] = x.array_r[bulk:]

    def getDiagonal(self, matrix: Any, diagonal: Any) -> None:
        """That of A_uu, for the smoother: the augmentation is at most γ times it."""
        self._A.getDiagonal(diagonal)
        diagonal.array[self._bulk :] = 1.0

    def coarse(self, P: Any) -> Any:
        """PᵀKP, with D lumped: pressures of coarse displacements are smooth. Collective."""
        inverse = self._D.getDiagonal()
        starts, _, values = self._D.getValuesCSR()
        if len(values):
            inverse.array[:] = np.sign(inverse.array_r) / np.add.reduceat(abs(values), starts[:-1])
        left = P.transposeMatMult(self._columns)
        left.diagonalScale(None, inverse)
        right = self._rows.matMult(P)
        K = left.matMult(right)
        K.scale(-1.0)
        plain = self._A.ptap(P)
        K.axpy(1.0, plain, structure=_DIFFERENT)
        for thing in (left, right, plain, inverse):  # plain has work space of the size of P
            thing.destroy()
        return mended(K)

    def eliminate(self, cycle: Any, r: Any, y: Any) -> None:
        """y = R⁻¹ r, with a preconditioner of K. Collective."""
        bulk = self._bulk
        self._columns.mult(self._solve(r.array_r[bulk:]), self._b)
        self._b.aypx(-1.0, r)
        self._b.array[bulk:] = 0.0
        cycle.apply(self._b, y)
        y.array[bulk:] = 0.0
        self._rows.mult(y, self._m)
        y.array[bulk:] = self._solve(r.array_r[bulk:] - self._m.array_r).array_r


def _part(A: Any, rows: Any, columns: Any) -> Any:
    """Entries of A that are not zero. Collective.

    Most places that A has for multipliers are for targets to come; in D they would be squared.
    """
    whole = A.createSubMatrix(rows, columns)
    starts, places, values = whole.getValuesCSR()
    kept = values != 0
    before = np.concatenate([[0], np.cumsum(kept)]).astype(starts.dtype)
    csr = (before[starts], places[kept], values[kept])
    part = PETSc.Mat().createAIJ(whole.getSizes(), csr=csr, comm=A.comm)
    whole.destroy()
    return part


def _inverse_diagonal(A: Any) -> Any:
    """1/|diagonal|, and 1 where it is zero; a vector."""
    inverse = A.getDiagonal()
    d = np.abs(inverse.array_r)
    inverse.array[:] = 1 / np.where(d > 0, d, 1.0)
    return inverse


def _factor(pc: Any) -> None:
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
