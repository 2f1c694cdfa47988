# SPDX-License-Identifier: MIT
"""The monolithic system of a contact problem: unknowns, residual, matrix (Ben Dhia and Zarroug 2002).

Unknowns are the bulk's and, for each pair, λ/s and Λ/ρ_τ with s the pair's scale [pressure/length].
The rows of (F2) are multiplied by s and those of (F3) by ρ_τ, and in mixed models the bulk's other
unknowns than displacements have scales as well (scaling.py). All rows are then forces and the blocks
are of one size, whatever the units of the user.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Iterator, Sequence

import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives

from . import _cpp, compat, events
from .bodies import Bodies
from .contact import PairAssembly
from .driven import DrivenTools, driven_tools
from .errors import ContactError, InputError, together
from .layout import Layout
from .pair import ContactPair
from .parameters import Parameters
from .quadrature import QuadratureLaw
from .scaling import block_scales
from .surface import Surface


class System:
    """Residual and Jacobian of bulk and contact in one PETSc vector and matrix.

    The construction is collective.

    Args:
        F: residual forms, one for each bulk unknown
        u: bulk unknowns
        J: forms of the Jacobian, by rows; None where blocks are not coupled
        pairs: contact pairs whose displacements are among u
        bcs: Dirichlet conditions on the bulk unknowns
        materials: laws at quadrature points in F and J
    """

    def __init__(
        self,
        F: Sequence[Any],
        u: Sequence[Any],
        J: Sequence[Sequence[Any]],
        pairs: Sequence[ContactPair],
        bcs: Sequence[Any],
        materials: Sequence[QuadratureLaw] = (),
    ):
        self.materials = list(materials)
        self.u, self.pairs, self.bcs = list(u), list(pairs), list(bcs)
        self.comm = u[0].function_space.mesh.comm
        self._F = [compat.form(f) for f in F]
        self._J = [[None if a is None else compat.form(a) for a in row] for row in J]
        frictional = [pair for pair in pairs if pair.frictional]
        self.functions = self.u + [pair._multiplier for pair in pairs]
        self.functions += [pair._semi_multiplier for pair in frictional]
        tools, dim = driven_tools(pairs), u[0].function_space.mesh.geometry.dim
        self.layout = Layout(self.comm, self.functions, bcs, 2 * dim * len(tools))
        self.driven = DrivenTools(tools, self.layout, len(self.functions))
        self.contacts = [
            PairAssembly(
                pair,
                self.layout,
                self._block_of(pair.slave.u),
                None if pair.tools else self._block_of(pair.master.u),
                len(self.u) + i,
                len(self.u) + len(pairs) + frictional.index(pair) if pair.frictional else None,
                self.driven.dofs_of(pair.tools, dim),
            )
            for i, pair in enumerate(pairs)
        ]
        self._measured = False  # the units and stiffnesses that follow
        self.scale = [1.0] * len(self.functions)  # units of the unknowns
        self._row_scale = [1.0] * len(self.u)
        self._displacements = list(range(len(self.u)))  # blocks with rows that are forces
        self.parameters = Parameters(self.contacts)
        # largest force as the step began or now: iterates on the way may be far off
        self.reference_force, self._first_force, self._force = 0.0, -1.0, 0.0
        self.round_off = 0.0  # residual of bodies at rest that touch but for round-off [force]
        self.changes = np.zeros(5, dtype=int)  # see PairAssembly.update
        self.A: Any = None
        self.hierarchy: Any = None  # of solvers.iterative
        self.x = PETSc.Vec().createMPI((self.layout.owned, None), comm=self.comm)
        self.b = self.x.duplicate()
        self.allocations = 0  # new patterns of the matrix
        self._maps = [
            PETSc.LGMap().create(self.layout.local_dofs(i), comm=self.comm)
            for i in range(len(self.u))
        ]
        surfaces = []
        for i, pair in enumerate(pairs):
            for name, surface in (("slave", pair.slave), ("master", pair.master)):
                if isinstance(surface, Surface):
                    label = f"{name} of pair {i}, tags {surface.tags}"
                    surfaces.append((label, surface, self._block_of(surface.u)))
        self.bodies = Bodies(self.layout, surfaces, self.driven)

    def _block_of(self, u: Any) -> int:
        for block, v in enumerate(self.u):
            if v is u:
                return block
        raise InputError(
            "ContactProblem: a surface is moved by a Function that is not among the unknowns u;"
            " make the surface from the unknown displacement."
        )

    # -- unknowns -------------------------------------------------------------------------------

    def read(self) -> None:
        """Fill x from the Functions and tools."""
        for block, f in enumerate(self.functions):
            part = self.layout.slice(block)
            self.x.array[part] = f.x.array[: part.stop - part.start] / self.scale[block]
        self.driven.read(self.x)

    def write(self, x: Any) -> None:
        """Fill the Functions from x, ghosts included, and place the tools. Collective."""
        values = x.array_r
        for block, f in enumerate(self.functions):
            part = self.layout.slice(block)
            f.x.array[: part.stop - part.start] = values[part] * self.scale[block]
            f.x.scatter_forward()
        self.driven.write(x)

    def values(self) -> list[Any]:
        """Copies of all unknowns, for ``fill``."""
        return [*(f.x.array.copy() for f in self.functions), self.driven.state()]

    def fill(self, values: Sequence[Any]) -> None:
        """Put all unknowns back, and every particle to the last accepted step."""
        for f, array in zip(self.functions, values):
            f.x.array[:] = array
        self.driven.set_state(values[-1])
        self.restore()

    def _update_materials(self, again: bool = False) -> None:
        """Stresses and tangents for the Functions' present values. Collective."""
        for material in self.materials:
            with events.MATERIAL:
                material.update(again)

    # -- residual -------------------------------------------------------------------------------

    def residual(self, x: Any, b: Any, close: bool = False) -> None:
        """b = residual of (F1)–(F3) at x. Collective.

        Where x does not meet a Dirichlet value yet, the bulk is lifted as in DOLFINx and contact
        sees the bodies with the value imposed. Where forces are not finite, all of b is nan.

        Args:
            close: apply the pairs' initial contact
        """
        self.write(x)
        self._update_materials()
        before = [u.x.array.copy() for u in self.u]
        lift = any(self._violates_bcs(u) for u in self.u)
        lift = self.comm.allreduce(lift, op=MPI.LOR)
        self._force, self._finite = 0.0, True
        with events.BULK_RESIDUAL:
            parts = [self._bulk_residual(row, lift) for row in range(len(self.u))]
        if not self._finite:  # maybe in held rows alone, which would hide it
            b.set(np.nan)
            return
        if self._first_force < 0:
            self._first_force = self._force
        self.reference_force = max(self._first_force, self._force)
        for row, (u, part) in enumerate(zip(self.u, parts)):
            compat.set_bc(u, self.bcs)
            held = self.layout.held_mask(row)[: len(part)]
            part[held] = (before[row] - u.x.array)[: len(part)][held]
            part *= self._row_scale[row]
        b.zeroEntries()
        b.array[: self.layout.offsets[len(self.u)]] = np.concatenate(parts)

        self.changes = np.zeros(5, dtype=int)
        for pair, contact in zip(self.pairs, self.contacts):
            self.changes += contact.update(pair.initial_contact if close else -1.0)
            with _assembled(b), together(self.comm, "contact residual"):
                contact.assembler.residual(b.handle)
        self.driven.residual(b)
        b.assemble()

    def norms(self, b: Any) -> tuple[float, float]:
        """Norms of the rows of the bulk and of contact [force]. Collective."""
        rows, bulk = b.array_r, self.layout.offsets[len(self.u)]
        squares = np.array([rows[:bulk] @ rows[:bulk], rows[bulk:] @ rows[bulk:]])
        bulk_norm, contact_norm = np.sqrt(self.comm.allreduce(squares))
        return float(bulk_norm), float(contact_norm)

    def tolerance(self, rtol: float) -> float:
        """The norm of a residual that is small enough [force]."""
        return max(rtol * self.reference_force, self.round_off)

    def settled(self, b: Any, rtol: float) -> bool:
        """Whether a residual is small enough: both its norms, and what tools driven by forces lack
        of their loads, which may be far below the bulk's forces. Collective."""
        if max(self.norms(b)) > self.tolerance(rtol):
            return False
        return self.driven.lack(b, self.round_off) <= rtol

    def _violates_bcs(self, u: Any) -> bool:
        """Whether a Dirichlet value of u is not met on this rank."""
        values = u.x.array.copy()
        compat.set_bc_array(values, self._bcs_of(self._block_of(u)))
        return bool(np.any(values != u.x.array))

    def _bulk_residual(self, row: int, lift: bool) -> npt.NDArray[Any]:
        """Forces of one bulk block, owned entries; with `lift`, J (g − u) added for the Dirichlet
        values g: the first Newton step then takes the bulk there along its tangent."""
        forces = compat.assemble_vector_local(self._F[row])
        norm = np.sqrt(self.comm.allreduce(float(forces @ forces)))
        self._finite &= bool(np.isfinite(norm))
        # reactions included: what residuals are compared to
        if np.isfinite(norm) and row in self._displacements:
            self._force = max(self._force, norm)
        if lift:
            columns = [j for j, a in enumerate(self._J[row]) if a is not None]
            forces += compat.lifting(
                self.u[row],
                [self._J[row][j] for j in columns],
                [self._bcs_of(j) for j in columns],
                [self.u[j].x.array for j in columns],
            )
        return forces

    def _bcs_of(self, block: int) -> list[Any]:
        return [bc for bc in self.bcs if compat.contains(self.u[block].function_space, bc)]

    # -- matrix ---------------------------------------------------------------------------------

    def jacobian(self, x: Any, A: Any) -> None:
        """A = derivative of the residual at x with the statuses frozen. Collective.

        The last call of ``residual`` has moved the surfaces and found the targets. If a target has
        left the pattern, the matrix gets a new one.
        """
        holds = all(contact.assembler.pattern_holds() for contact in self.contacts)
        if not self.comm.allreduce(holds, op=MPI.LAND):
            with events.ALLOCATE:
                self._allocate(A)
            self.allocations += 1
        self.write(x)
        self._update_materials()
        A.zeroEntries()
        with events.BULK_JACOBIAN:
            self._add_bulk(A, self.bcs)
            A.assemble()  # contact adds to its arrays
            self._scale_bulk(A)
        self.add_contact(A)
        for contact in self.contacts:
            _add_diagonal(A, contact.held_rows(), 1.0)
        self.driven.tangent(A, self.contacts)
        A.assemble()

    def add_contact(self, A: Any) -> None:
        """Add the pairs' tangents to a matrix that is assembled. Collective."""
        self._remote.zero()
        with _assembled(A), together(self.comm, "contact tangent"):
            for contact in self.contacts:
                contact.assembler.tangent(A.handle, self._remote)
        self._remote.send(A.handle)

    def _add_bulk(self, A: Any, bcs: Sequence[Any]) -> None:
        """Add the bulk's Jacobian; with conditions, 1 on the diagonal of the held rows."""
        for i, row in enumerate(self._J):
            for j, a in enumerate(row):
                if a is not None:
                    A.setLGMap(self._maps[i], self._maps[j])
                    compat.assemble_matrix_unrolled(A, a, bcs)
        if bcs:
            _add_diagonal(A, self.layout.held_rows(), 1.0)

    def _scale_bulk(self, A: Any) -> None:
        """Multiply the assembled bulk's blocks by the scales of rows and unknowns. Collective."""
        if len(self._displacements) == len(self.u):
            return
        left, right = A.createVecs()
        for vector, scale in ((left, self._row_scale), (right, self.scale)):
            vector.set(1.0)
            for block in range(len(self.u)):
                vector.array[self.layout.slice(block)] = scale[block]
        A.diagonalScale(left, right)
        left.destroy()
        right.destroy()

    def _add_bulk_pattern(self, pattern: Any) -> None:
        """Places of the bulk's Jacobian. Collective."""
        for i, row in enumerate(self._J):
            first = self.layout.start + self.layout.slice(i).start
            for j, a in enumerate(row):
                if a is not None:
                    offsets, columns = compat.pattern(a)
                    size = self.layout.block_sizes[j]
                    dofs = self.layout.system_dofs(j, columns * size).astype(PETSc.IntType)
                    pattern.add_sparse(first, self.layout.block_sizes[i], offsets, dofs, size)

    def _allocate(self, A: Any) -> None:
        """Allocate the bulk's pattern and that of the present targets and their neighbours; fill A
        with zeros. Collective."""
        pattern = _cpp.Pattern(self.comm.py2f(), self.layout.owned)
        self._add_bulk_pattern(pattern)
        with together(self.comm, "contact pattern"):
            for contact in self.contacts:
                contact.assembler.add_pattern(pattern)
        self.driven.add_pattern(pattern)
        pattern.finish()
        pattern.allocate(A.handle)
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        pattern.fill(A.handle)
        self._remote = pattern.remote_rows()  # what contact adds to the rows of other ranks

    def start(self, friction: bool = True) -> None:
        """Begin a step at the Functions' present values. Collective.

        Places the surfaces with the Dirichlet values imposed, finds the multipliers to hold, makes
        the matrix if there is none yet, and fills x.

        Args:
            friction: False: solve without it first, then ``go_on``
        """
        self.driven.check(self.pairs, self.comm)
        self.reference_force, self._first_force = 0.0, -1.0
        for contact in self.contacts:
            contact.begin_step()
        before = [u.x.array.copy() for u in self.u]
        for u in self.u:
            compat.set_bc(u, self.bcs)
        with together(self.comm, "solve"):
            for u in self.u:
                if not np.isfinite(u.x.array).all():
                    raise ContactError(
                        f"the unknown {u.name} is not finite (nan or inf) as the step begins; give u"
                        " and the Dirichlet conditions finite values before solve()"
                    )
        for contact in self.contacts:
            contact.update()
        self.driven.begin(self.contacts)
        self.driven.approach(self.contacts)
        for contact in self.contacts:
            contact.hold()
        for u, values in zip(self.u, before):
            u.x.array[:] = values
        self._update_materials(again=True)  # their parameters may be new, the time step for one
        if self.A is None:
            self.create_matrix()
        self.parameters.choose(self.scale, friction)
        self.read()

    def freeze(self, *what: str) -> None:
        """Freeze "geometry", "threshold" or "status" as they are, and let go of the others."""
        for contact in self.contacts:
            contact.assembler.freeze(**{name: True for name in what})

    def glue(self) -> None:
        """All that touches sticks, at any pressure, until ``unglue`` is called. Collective."""
        self.residual(self.x, self.b, close=True)
        self.freeze("threshold", "status")
        for contact, parameters in zip(self.contacts, self.parameters.chosen):
            if contact.pair.frictional:
                contact.assembler.glue(parameters["pressure"])

    def unglue(self) -> None:
        """Friction as it is again. Its Λ, of other pressures, is forgotten: all sticks at first."""
        self.freeze()
        for pair in self.pairs:
            if pair.frictional:
                pair._semi_multiplier.x.array[:] = 0.0

    def check_held(self) -> None:
        """See Bodies.check; with the matrix of the last ``jacobian``. Collective."""
        self.bodies.check(self.A)

    def go_on(self) -> None:
        """Go on with friction in the present step, with parameters for the present pressures."""
        self.parameters.choose(self.scale)
        self.read()

    @property
    def frictional(self) -> bool:
        """Whether some pair has friction."""
        return any(pair.frictional for pair in self.pairs)

    def mark(self) -> None:
        """Keep the particles' present states for ``recall``."""
        for contact in self.contacts:
            contact.assembler.mark()

    def recall(self) -> None:
        """Forget what evaluations since ``mark`` have done to the particles."""
        for contact in self.contacts:
            contact.assembler.recall()

    def restore(self) -> None:
        """Put every particle and every material back to the last accepted step."""
        for contact in self.contacts:
            contact.assembler.restore()
        for material in self.materials:
            material.restore()

    def accept(self) -> None:
        """The present displacements are a solution: slips and plastic flow of the next step start
        from there. Collective."""
        for contact in self.contacts:
            contact.remember()
        for material in self.materials:
            material.commit()

    def new_matrix(self) -> Any:
        """A matrix with places for the bulk and the present targets. Collective."""
        n = self.layout.owned
        A = PETSc.Mat().create(self.comm)
        A.setSizes(((n, None), (n, None)))
        A.setType("aij")
        with events.ALLOCATE:
            self._allocate(A)
        return A

    def bulk_matrix(self) -> Any:
        """The Jacobian of the bulk alone, numbered as the system without its last blocks: of each
        rank the rows of u. Collective."""
        alone = System(self._F, self.u, self._J, [], self.bcs)
        A = alone.new_matrix()
        alone._add_bulk(A, self.bcs)
        A.assemble()
        return A

    def measured(self) -> dict[str, Any]:
        """Units and stiffnesses as they were measured before the first step, for ``set_measured``:
        on deformed bodies they would be others."""
        return {
            "scale": self.scale,
            "row_scale": self._row_scale,
            "displacements": self._displacements,
            "round_off": self.round_off,
            "driven": self.driven.stiffness,
            "parameters": self.parameters.state(),
        }

    def set_measured(self, figures: dict[str, Any]) -> None:
        """Measure no more, but take these."""
        self.scale, self._row_scale = list(figures["scale"]), list(figures["row_scale"])
        self._displacements = list(figures["displacements"])
        self.round_off, self.driven.stiffness = figures["round_off"], figures["driven"]
        self.parameters.set_state(figures["parameters"])
        self._measured = True

    def create_matrix(self) -> None:
        """Make the matrix for the present targets, and find how stiff the bodies are. Collective."""
        self.A = self.new_matrix()
        if not self._measured:
            self._measure()

    def _measure(self) -> None:
        """Find units of the unknowns, and how stiff the bodies are. Collective."""
        self._measured = True
        self._add_bulk(self.A, [])
        self.A.assemble()
        diagonal = self.A.getDiagonal().array.copy()
        present = [[a is not None for a in row] for row in self._J]
        scales, self._row_scale, self._displacements = block_scales(
            self.A, self.layout, present, self.bodies.blocks
        )
        self.scale[: len(self.u)] = scales
        for block in set(range(len(self.u))) - set(self._displacements):
            diagonal[self.layout.slice(block)] = 0.0
        x = max(float(np.abs(u.function_space.mesh.geometry.x).max(initial=0)) for u in self.u)
        sizes = np.array([np.abs(diagonal).max(initial=0), x])
        self.comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
        self.round_off = 10 * np.finfo(float).eps * float(np.prod(sizes))
        self.driven.stiffness = float(sizes[0])
        self.parameters.measure(diagonal)


@contextmanager
def _assembled(thing: Any) -> Iterator[None]:
    """After an error of all ranks no entries wait on any of them: PETSc would add them to the next
    vector, and refuse the next matrix. Collective then."""
    try:
        yield
    except BaseException:
        thing.assemble()
        raise


def _add_diagonal(A: Any, rows: npt.NDArray[Any], value: float) -> None:
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
