# SPDX-License-Identifier: MIT
"""The bulk of a contact problem: the user's forms, and their rows in the system."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives

from . import compat, events
from .layout import Layout
from .quadrature import QuadratureLaw


class Bulk:
    """Residual and Jacobian of the bulk, the first blocks of a system.

    Args:
        F: residual forms, one for each unknown
        u: unknowns
        J: forms of the Jacobian, by rows; None where blocks are not coupled
        bcs: Dirichlet conditions
        materials: laws at quadrature points in F and J
        layout: of the system
    """

    def __init__(
        self,
        F: Sequence[Any],
        u: Sequence[Any],
        J: Sequence[Sequence[Any]],
        bcs: Sequence[Any],
        materials: Sequence[QuadratureLaw],
        layout: Layout,
    ):
        self.u, self.bcs, self.materials, self.layout = list(u), list(bcs), list(materials), layout
        self.comm = u[0].function_space.mesh.comm
        self.F = [compat.form(f) for f in F]
        self.J = [[None if a is None else compat.form(a) for a in row] for row in J]
        self.row_scale = [1.0] * len(self.u)  # with them all rows are forces (scaling.py)
        self.displacements = list(range(len(self.u)))  # blocks with rows that are forces anyway
        self.force = 0.0  # largest norm of their rows in the last residual, reactions included
        self._work = [fem.Function(f.function_space) for f in self.u]
        self._maps = [
            PETSc.LGMap().create(layout.local_dofs(i), comm=self.comm) for i in range(len(self.u))
        ]

    @property
    def size(self) -> int:
        """Number of this rank's rows."""
        return self.layout.offsets[len(self.u)]

    def update_materials(self, again: bool = False) -> None:
        """Stresses and tangents for the Functions' present values. Collective."""
        for material in self.materials:
            with events.MATERIAL:
                material.update(again)

    # -- residual -------------------------------------------------------------------------------

    def residual(self) -> npt.NDArray[Any] | None:
        """Rows of this rank for the present u, in the system's units; None on all ranks if they are
        not finite. Collective.

        Where u does not meet a Dirichlet value yet, it is lifted as in DOLFINx, and has the value
        imposed afterwards.
        """
        before = [u.x.array.copy() for u in self.u]
        lift = any(self._violates_bcs(block) for block in range(len(self.u)))
        lift = self.comm.allreduce(lift, op=MPI.LOR)
        self.force, self._finite = 0.0, True
        with events.BULK_RESIDUAL:
            parts = [self._forces(row, lift) for row in range(len(self.u))]
        if not self._finite:  # maybe in held rows alone, which would hide it
            return None
        for row, (u, part) in enumerate(zip(self.u, parts)):
            compat.set_bc(u, self.bcs)
            held = self.layout.held_mask(row)[: len(part)]
            part[held] = (before[row] - u.x.array)[: len(part)][held]
            part *= self.row_scale[row]
        return np.concatenate(parts)

    def _violates_bcs(self, block: int) -> bool:
        """Whether a Dirichlet value of an unknown is not met on this rank."""
        values = self.u[block].x.array.copy()
        compat.set_bc_array(values, self._bcs_of(block))
        return bool(np.any(values != self.u[block].x.array))

    def _forces(self, row: int, lift: bool) -> npt.NDArray[Any]:
        """Forces of one block, owned entries; with `lift`, J (g − u) added for the Dirichlet
        values g: the first Newton step then takes the bulk there along its tangent."""
        forces = compat.assemble_vector_local(self.F[row], self._work[row])
        norm = np.sqrt(self.comm.allreduce(float(forces @ forces)))
        self._finite &= bool(np.isfinite(norm))
        # reactions included: what residuals are compared to
        if np.isfinite(norm) and row in self.displacements:
            self.force = max(self.force, norm)
        if lift:
            columns = [j for j, a in enumerate(self.J[row]) if a is not None]
            forces += compat.lifting(
                self._work[row],
                [self.J[row][j] for j in columns],
                [self._bcs_of(j) for j in columns],
                [self.u[j].x.array for j in columns],
            )
        return forces

    def _bcs_of(self, block: int) -> list[Any]:
        return [bc for bc in self.bcs if compat.contains(self.u[block].function_space, bc)]

    # -- Jacobian -------------------------------------------------------------------------------

    def add(self, A: Any, bcs: Sequence[Any]) -> None:
        """Add the bulk's Jacobian; with conditions, 1 on the diagonal of the held rows."""
        for i, row in enumerate(self.J):
            for j, a in enumerate(row):
                if a is not None:
                    A.setLGMap(self._maps[i], self._maps[j])
                    compat.assemble_matrix_unrolled(A, a, bcs)
        if bcs:
            add_diagonal(A, self.layout.held_rows(), 1.0)

    def scale(self, A: Any, scale: Sequence[float]) -> None:
        """Multiply the assembled bulk's blocks by the scales of rows and unknowns. Collective.

        Args:
            scale: of all unknowns of the system
        """
        if len(self.displacements) == len(self.u):
            return
        left, right = A.createVecs()
        for vector, units in ((left, self.row_scale), (right, scale)):
            vector.set(1.0)
            for block in range(len(self.u)):
                vector.array[self.layout.slice(block)] = units[block]
        A.diagonalScale(left, right)
        left.destroy()
        right.destroy()

    def add_pattern(self, pattern: Any) -> None:
        """Places of the bulk's Jacobian. Collective."""
        for i, row in enumerate(self.J):
            first = self.layout.start + self.layout.slice(i).start
            for j, a in enumerate(row):
                if a is not None:
                    offsets, columns = compat.pattern(a)
                    size = self.layout.block_sizes[j]
                    dofs = self.layout.system_dofs(j, columns * size).astype(PETSc.IntType)
                    pattern.add_sparse(first, self.layout.block_sizes[i], offsets, dofs, size)


def add_diagonal(A: Any, rows: npt.NDArray[Any], value: float) -> None:
    """Add a value on the diagonal of owned rows."""
    if len(rows) == 0:  # petsc4py divides by the number of rows
        return
    at = rows.reshape(-1, 1)
    A.setValuesRCV(at, at, np.full(at.shape, value), addv=PETSc.InsertMode.ADD_VALUES)


def derivative(
    F: Sequence[Any], u: Sequence[Any], materials: Sequence[QuadratureLaw] = ()
) -> list[list[Any]]:
    """Jacobian forms of F by UFL, completed with the materials' tangents; None where a residual does
    not depend on an unknown."""
    rows = []
    for f in F:
        known, row = set(f.coefficients()), []
        for v in u:
            parts = [_derivative(f, v)] if v in known else []
            parts += [m.tangent(f, v) for m in materials]
            parts = [part for part in parts if part is not None]
            row.append(sum(parts[1:], parts[0]) if parts else None)
        rows.append(row)
    return rows


def _derivative(f: Any, u: Any) -> Any:
    """Derivative of a form; None if it is zero, as that of a Lagrangian that is linear in u."""
    form = ufl.derivative(f, u)
    return None if expand_derivatives(form).empty() else form
