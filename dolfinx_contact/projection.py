# SPDX-License-Identifier: MIT
"""Functions on the slave surface from values at the particles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from . import _cpp, compat
from .held import local_dofs


class Projection:
    """L2 projection by the particles' rule: Σ_p w_p φ_A (f − t_p) = 0 for all A.

    The resultant of f is that of the particles' values, and nothing depends on the partition. The
    construction is collective.

    Args:
        pair: whose particles they are
        function: of the space to project on; not changed
        basis: φ on a facet: powers, coefficients, nodes
        weight: of the particles, (facets × particles,) [area]
    """

    def __init__(self, pair: Any, function: Any, basis: Any, weight: npt.NDArray[np.float64]):
        dofmap = function.function_space.dofmap
        nodes = len(basis[2])
        powers, coefficients, points = basis
        polynomials = _cpp.TraceBasis(points.shape[1], powers, coefficients)
        self._phi = np.array([polynomials.values(xi) for xi in pair._rule.points])
        self._weight = np.asarray(weight).reshape(-1, len(self._phi))
        local = local_dofs(pair, function, nodes)
        self._dofs = compat.global_indices(dofmap.index_map)[local].astype(PETSc.IntType)
        self._owned = dofmap.index_map.size_local
        size = (self._owned, None)
        matrix = PETSc.Mat().createAIJ((size, size), comm=pair.comm)
        matrix.setUp()
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        masses = np.einsum("fp,pa,pb->fab", self._weight, self._phi, self._phi)
        for dofs, mass in zip(self._dofs, masses):
            matrix.setValues(dofs, dofs, mass, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        self._x, self._b = matrix.createVecs()
        self._solver = PETSc.KSP().create(pair.comm)
        self._solver.setOperators(matrix)
        self._solver.setType("cg")
        self._solver.getPC().setType("jacobi")
        self._solver.setTolerances(rtol=1e-13)

    def __call__(self, values: npt.NDArray[np.float64], out: Any) -> None:
        """Project. Collective.

        Args:
            values: at the particles, (particles, components)
            out: Function of the space
        """
        components = values.shape[1]
        at = values.reshape(*self._weight.shape, components)
        loads = np.einsum("fp,pa,fpi->fai", self._weight, self._phi, at)
        result = out.x.array.reshape(-1, components)
        for i in range(components):
            self._b.set(0.0)
            self._b.setValues(
                self._dofs.ravel(), loads[:, :, i].ravel(), addv=PETSc.InsertMode.ADD_VALUES
            )
            self._b.assemble()
            self._solver.solve(self._b, self._x)
            result[: self._owned, i] = self._x.array_r
        out.x.scatter_forward()
