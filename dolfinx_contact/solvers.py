# SPDX-License-Identifier: MIT
"""Presets of PETSc options for the linear systems of Newton's iterations."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from .errors import InputError
from .multigrid import Coarsening


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

        R = [A_uu A_um; A_mu D],  D = diag(A_mm) − diag(A_mu diag(A_uu)⁻¹ A_um)
    """

    def __init__(self) -> None:
        self._system: Any = None
        self._coarsening: Any = None
        self._ptap: Any = None
        self._mg: Any = None

    def use(self, system: Any) -> None:
        self._system = system

    def setUp(self, pc: Any) -> None:
        system = self._system
        layout, A = system.layout, pc.getOperators()[1]
        opts = PETSc.Options()
        gamma = opts.getReal("gamma", 1.0)
        nu, self._n = len(system.u), layout.owned
        cut = int(layout.offsets[nu])
        self._cut = cut
        comm = layout.comm
        every = PETSc.IS().createGeneral(
            (layout.start + np.arange(self._n)).astype(PETSc.IntType), comm=comm)
        tail = PETSc.IS().createGeneral(
            (layout.start + np.arange(cut, self._n)).astype(PETSc.IntType), comm=comm)
        bulk = PETSc.IS().createGeneral(
            (layout.start + np.arange(cut)).astype(PETSc.IntType), comm=comm)
        d = A.getDiagonal()
        # (n × m) and (m × n); the blocks A_mm in them are taken off
        self._Aum = A.createSubMatrix(bulk, tail)
        self._Amu = A.createSubMatrix(tail, bulk)
        du = d.array_r[:cut].copy()
        left, right = self._Amu.createVecs()  # left over bulk?, see petsc4py
        scaled = self._Aum.copy()
        v = scaled.createVecLeft()
        v.array[:] = 1 / du
        scaled.diagonalScale(v, None)
        # diagonal of A_mu diag⁻¹ A_um
        S = self._Amu.matMult(scaled)
        s = S.getDiagonal().array_r.copy()
        Amm = A.createSubMatrix(tail, tail)
        ones = Amm.createVecRight(); ones.set(1.0)
        lump = (Amm * ones).array_r.copy()
        lump = d.array_r[cut:] if opts.getBool("nolump", False) else lump
        D = lump - s / gamma
        self._Dinv = 1.0 / D
        if opts.getBool("schur_lu", False):
            t = S.createVecLeft(); t.array[:] = -s / gamma
            Amm.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
            Amm.setDiagonal(Amm.getDiagonal() + t)
            k = PETSc.KSP().create(comm); k.setOperators(Amm); k.setType("preonly"); k.pc.setType("lu"); k.pc.setFactorSolverType("mumps"); k.setUp()
            self._sk = k
        else: self._sk = None
        self._d = d.copy()
        self._d.array[cut:] = 1.0
        # augmented diagonal
        self._du = du
        aug = self._Aum.duplicate(copy=True)
        # diag of A_um Dinv A_mu: sum_k Aum_ik Dinv_k Amu_ki
        tr = self._Amu.copy(); tr.transpose()
        aug2 = self._product_diag(self._Aum, tr, self._Dinv)
        self._d.array[:cut] -= aug2
        self._A = A
        self._multigrid(pc, A)

    def _product_diag(self, M, T, dinv):
        """Σ_k M_ik dinv_k T_ik, for two matrices of like layout (seq prototype)."""
        from scipy.sparse import csr_matrix
        def sp(m):
            i, j, v = m.getValuesCSR()
            return csr_matrix((v, j, i), shape=m.getSize())
        return np.asarray(sp(M).multiply(sp(T)).dot(dinv)).ravel()

    def _multigrid(self, pc: Any, A: Any) -> None:
        system = self._system
        comm = system.comm
        first = self._coarsening is None
        if first:
            c = self._coarsening = Coarsening(system.layout, range(len(system.u)))
            dinv = self._d.copy(); dinv.reciprocal()
            dA = A.getDiagonal(); dA.array[self._cut:] = 1.0; dA.reciprocal()
            lam = power(lambda x: dA * (A * x), self._d, self._cut)
            AP = A.matMult(c.P)
            dA.scale(-4 / 3 / lam)
            dA.array[self._cut:] = 0.0
            AP.diagonalScale(dA, None)
            AP.axpy(1.0, c.P, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            self.P = AP
            self._ptap = A.ptap(self.P)
            rows = PETSc.IS().createGeneral(
                (system.layout.start + np.arange(self._cut)).astype(PETSc.IntType), comm=comm)
            cs = self.P.getOwnershipRangeColumn()
            cols = PETSc.IS().createGeneral(np.arange(*cs).astype(PETSc.IntType), comm=comm)
            self.Pu = self.P.createSubMatrix(rows, cols)
        else:
            A.ptap(self.P, result=self._ptap)
        L = self.Pu.transposeMatMult(self._Aum)
        R = self._Amu.matMult(self.Pu)
        v = L.createVecRight(); v.array[:] = self._Dinv
        L.diagonalScale(None, v)
        X = L.matMult(R)
        K = self._ptap.copy()
        K.axpy(-1.0, X, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        dg = K.getDiagonal()
        zero = dg.array_r == 0
        self.zero = int(zero.sum())
        if zero.any():
            dg.array[zero] = 1.0
            K.setDiagonal(dg)
        K.setBlockSize(self._coarsening.size)
        vecs = []
        for m in self._coarsening.modes.T:
            v = K.createVecRight(); v.array[:] = m; vecs.append(v)
        orthonormalise(vecs)
        K.setNearNullSpace(PETSc.NullSpace().create(vectors=vecs, comm=comm))
        self.K = K
        shell = PETSc.Mat().createPython(A.getSizes(), self, comm=comm); shell.setUp()
        mg = PETSc.PC().create(comm)
        mg.setOptionsPrefix((pc.getOptionsPrefix() or "") + "contact_")
        mg.setType("mg"); mg.setMGLevels(2)
        mg.setOperators(shell, shell)
        mg.setMGInterpolation(1, self.P)
        sm = mg.getMGSmoother(1)
        sm.setOperators(shell, shell); sm.setType("chebyshev"); sm.pc.setType("jacobi")
        cs = mg.getMGCoarseSolve(); cs.setOperators(K, K); cs.setType("preonly"); cs.pc.setType("gamg")
        mg.setFromOptions()
        mg.setUp()
        self._mg = mg

    # K_γ as a python matrix
    def mult(self, mat: Any, x: Any, y: Any) -> None:
        cut = self._cut
        z = x.copy(); z.array[cut:] = 0.0
        self._A.mult(z, y)
        w = self._Aum.createVecRight()
        w.array[:] = self._Dinv * y.array_r[cut:]
        t = self._Aum.createVecLeft()
        self._Aum.mult(w, t)
        y.array[:cut] -= t.array_r
        y.array[cut:] = x.array_r[cut:]

    def getDiagonal(self, mat: Any, d: Any) -> None:
        self._d.copy(d)

    def apply(self, pc: Any, r: Any, y: Any) -> None:
        cut = self._cut
        rm = r.array_r[cut:]
        t = self._Aum.createVecLeft()
        w = self._Aum.createVecRight()
        w.array[:] = self._Dinv * rm
        self._Aum.mult(w, t)
        b = r.copy()
        b.array[:cut] -= t.array_r
        b.array[cut:] = 0.0
        self._mg.apply(b, y)
        t.array[:] = y.array_r[:cut]
        self._Amu.mult(t, w)
        if self._sk is not None:
            w.array[:] = rm - w.array_r
            z = w.duplicate(); self._sk.solve(w, z)
            y.array[cut:] = z.array_r
        else:
            y.array[cut:] = self._Dinv * (rm - w.array_r)


def orthonormalise(vecs):
    for i, v in enumerate(vecs):
        for _ in range(2):
            for w in vecs[:i]:
                v.axpy(-v.dot(w), w)
        v.normalize()


def power(apply, like, cut, its=10):
    x = like.duplicate(); x.setRandom(); x.array[cut:] = 0
    for _ in range(its):
        x.normalize(); y = apply(x); y.array[cut:] = 0; lam = y.norm(); x = y
    return lam
