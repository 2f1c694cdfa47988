# SPDX-License-Identifier: MIT
"""Presets of PETSc options for the linear systems of Newton's iterations."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from .errors import InputError
from .multigrid import Hierarchy, coarse, inverse_diagonal, mend

_DIFFERENT = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


def direct(**options: Any) -> dict[str, Any]:
    """LU by MUMPS, the default."""
    return {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        **options,
    }


def iterative(**options: Any) -> dict[str, Any]:
    return {
        "ksp_type": "fgmres",
        "ksp_rtol": 1e-8,
        "ksp_max_it": 300,
        "ksp_gmres_restart": 50,
        "pc_type": "python",
        "pc_python_type": "dolfinx_contact.solvers.SaddlePoint",
        **options,
    }


class SaddlePoint:
    """PETSc's python preconditioner: R⁻¹ with

        R = [A_uu A_um; A_mu D],  D = A_mm − A_mu diag(A_uu)⁻¹ A_um / γ
    """

    def __init__(self) -> None:
        self._system: Any = None
        self._hierarchy: Any = None
        self._mg: Any = None

    def use(self, system: Any) -> None:
        self._system = system

    def setUp(self, pc: Any) -> None:
        system, A = self._system, pc.getOperators()[1]
        layout = system.layout
        bulk = int(layout.offsets[len(system.u)])
        prefix = pc.getOptionsPrefix() or ""
        gamma = PETSc.Options().getReal(prefix + "gamma", 1.0)
        if self._hierarchy is None:
            self._hierarchy = Hierarchy(A, layout, range(len(system.u)))
        P = self._hierarchy.P
        self._augmented = _Augmented(A, layout, bulk, gamma)
        operators = [self._augmented.matrix, *self._augmented.coarse(P)]
        self._mg = mg = PETSc.PC().create(layout.comm)
        mg.setOptionsPrefix(prefix + "contact_")
        mg.setType("mg")
        mg.setMGLevels(len(operators))
        for level, K in enumerate(reversed(operators)):
            solver = mg.getMGSmoother(level) if level else mg.getMGCoarseSolve()
            solver.setOperators(K, K)
            if level:
                solver.setType("chebyshev")
                solver.pc.setType("jacobi")
                mg.setMGInterpolation(level, P[len(P) - level])
            else:
                solver.setType("preonly")
                solver.pc.setType("lu")
                solver.pc.setFactorSolverType("mumps")
        mg.setOperators(operators[0], operators[0])
        mg.setFromOptions()
        mg.setUp()

    def apply(self, pc: Any, r: Any, y: Any) -> None:
        """y = R⁻¹ r, with a cycle of multigrid for A_uu − A_um D⁻¹ A_mu."""
        self._augmented.precondition(self._mg, r, y)


class _Augmented:
    """A_uu − A_um D⁻¹ A_mu as a matrix of the whole system, with 1 for the multipliers.

    Nothing of A_uu is copied.
    """

    def __init__(self, A: Any, layout: Any, bulk: int, gamma: float):
        self._A, self._bulk = A, bulk
        comm, rows = layout.comm, layout.start + np.arange(layout.owned, dtype=PETSc.IntType)
        every, tail = (PETSc.IS().createGeneral(part, comm=comm) for part in (rows, rows[bulk:]))
        self._diagonal = A.getDiagonal()
        self._diagonal.array[bulk:] = 1.0
        # A_um above A_mm, and A_mu beside A_mm
        self._columns, self._rows = A.createSubMatrix(every, tail), A.createSubMatrix(tail, every)
        compliance = inverse_diagonal(A)
        compliance.array[bulk:] = 0.0
        compliance.scale(-1.0 / gamma)
        scaled = self._columns.copy()
        scaled.diagonalScale(compliance, None)
        D = self._rows.matMult(scaled)
        scaled.destroy()
        D.axpy(1.0, A.createSubMatrix(tail, tail), structure=_DIFFERENT)
        self._D = D
        self._solver = PETSc.KSP().create(comm)
        self._solver.setOperators(D)
        self._solver.setType("preonly")
        self._solver.pc.setType("lu")
        self._solver.pc.setFactorSolverType("mumps")
        self._solver.setUp()
        self._x, self._y = A.createVecs()
        self._b = self._x.duplicate()
        self._r, self._m = D.createVecs()
        self.matrix = PETSc.Mat().createPython(A.getSizes(), self, comm=comm)
        self.matrix.setUp()

    def coarse(self, P: Any) -> list[Any]:
        """The operators of the coarse levels."""
        if not P:
            return []
        lumped = self._D.getDiagonal()
        indptr, _, values = self._D.getValuesCSR()
        if len(values):
            lumped.array[:] = np.sign(lumped.array_r) / np.add.reduceat(np.abs(values), indptr[:-1])
        left = P[0].transposeMatMult(self._columns)
        left.diagonalScale(None, lumped)
        K = self._A.ptap(P[0])
        K.axpy(-1.0, left.matMult(self._rows.matMult(P[0])), structure=_DIFFERENT)
        mend(K)
        operators = [K]
        for prolongation in P[1:]:
            operators.append(coarse(operators[-1], prolongation))
        return operators

    def mult(self, matrix: Any, x: Any, y: Any) -> None:
        bulk = self._bulk
        x.copy(self._x)
        self._x.array[bulk:] = 0.0
        self._A.mult(self._x, y)
        self._r.array[:] = y.array_r[bulk:]
        self._solver.solve(self._r, self._m)
        self._columns.mult(self._m, self._y)
        y.axpy(-1.0, self._y)
        y.array[bulk:] = x.array_r[bulk:]

    def getDiagonal(self, matrix: Any, diagonal: Any) -> None:
        self._diagonal.copy(diagonal)

    def precondition(self, mg: Any, r: Any, y: Any) -> None:
        bulk = self._bulk
        self._r.array[:] = r.array_r[bulk:]
        self._solver.solve(self._r, self._m)
        self._columns.mult(self._m, self._b)
        self._b.aypx(-1.0, r)
        self._b.array[bulk:] = 0.0
        mg.apply(self._b, y)
        y.array[bulk:] = 0.0
        self._rows.mult(y, self._m)
        self._r.array[:] = r.array_r[bulk:] - self._m.array_r
        self._solver.solve(self._r, self._m)
        y.array[bulk:] = self._m.array_r
