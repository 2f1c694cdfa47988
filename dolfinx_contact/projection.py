# SPDX-License-Identifier: MIT
"""Functions on the slave surface from values at the particles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from . import compat
from .held import local_dofs
from .rules import Gauss, basis_values

_DEGREE = 8  # of a Gauss rule: products of functions of degree 2 on quadrilaterals


class Projection:
    """L2 projection by the particles' rule: Σ_p w_p φ_A (f − t_p) = 0 for all A.

    Where particles move, ∫ φ_A f dΓ is by a Gauss rule of its own. The resultant of f is that of the
    particles' values, and nothing depends on the partition. The construction is collective.

    Args:
        pair: whose particles they are
        function: of the space to project on; not changed
        basis: φ on a facet: powers, coefficients, nodes
        surface: this rank's own slave facets
    """

    def __init__(self, pair: Any, function: Any, basis: Any, surface: Any):
        dofmap = function.function_space.dofmap
        nodes = len(basis[2])
        shape, self._basis = pair.slave.shape, basis
        integration, rule = pair.integration, pair._rule
        if integration.refined:
            integration = Gauss(_DEGREE)
            rule = integration.rule(shape, pair._psi)
        weight = integration.weights(surface, shape, rule, pair._psi, pair.axisymmetric)
        phi = basis_values(basis, rule.points)
        local = local_dofs(pair, function, nodes)
        self._dofs = compat.global_indices(dofmap.index_map)[local].astype(PETSc.IntType)
        self._owned = dofmap.index_map.size_local
        size = (self._owned, None)
        matrix = PETSc.Mat().createAIJ((size, size), comm=pair.comm)
        matrix.setUp()
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        masses = np.einsum("fp,pa,pb->fab", weight, phi, phi)
        for dofs, mass in zip(self._dofs, masses):
            matrix.setValues(dofs, dofs, mass, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        self._x, self._b = matrix.createVecs()
        self._solver = PETSc.KSP().create(pair.comm)
        self._solver.setOperators(matrix)
        self._solver.setType("cg")
        self._solver.getPC().setType("jacobi")
        self._solver.setTolerances(rtol=1e-13)

    def __call__(self, table: Any, values: npt.NDArray[np.float64], out: Any) -> None:
        """Project. Collective.

        Args:
            table: columns of the particles: "row" of the facet, "xi", "weight"
            values: at the particles, (particles, components)
            out: Function of the space
        """
        components = values.shape[1]
        phi = basis_values(self._basis, table["xi"]) * table["weight"][:, None]
        loads = np.zeros((*self._dofs.shape, components))
        np.add.at(loads, table["row"], phi[:, :, None] * values[:, None, :])
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
