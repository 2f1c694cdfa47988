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
from mpi4py import MPI
from petsc4py import PETSc

from . import _cpp, compat, events
from .bodies import Bodies
from .bulk import Bulk, add_diagonal
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
        self.u, self.pairs = list(u), list(pairs)
        self.comm = u[0].function_space.mesh.comm
        frictional = [pair for pair in pairs if pair.frictional]
        self.functions = self.u + [pair._multiplier for pair in pairs]
        self.functions += [pair._semi_multiplier for pair in frictional]
        tools, dim = driven_tools(pairs), u[0].function_space.mesh.geometry.dim
        self.layout = Layout(self.comm, self.functions, bcs, 2 * dim * len(tools))
        self.bulk = Bulk(F, u, J, bcs, materials, self.layout)
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
        self.parameters = Parameters(self.contacts)
        # largest force as the step began or now: iterates on the way may be far off
        self.reference_force, self._first_force = 0.0, -1.0
        self.round_off = 0.0  # residual of bodies at rest that touch but for round-off [force]
        self.changes = np.zeros(5, dtype=int)  # see PairAssembly.update
        self.A: Any = None
        self.hierarchy: Any = None  # of solvers.iterative
        self.x = PETSc.Vec().createMPI((self.layout.owned, None), comm=self.comm)
        self.b = self.x.duplicate()
        self.allocations = 0  # new patterns of the matrix
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

    # -- residual -------------------------------------------------------------------------------

    def residual(self, x: Any, b: Any, close: bool = False) -> None:
        """b = residual of (F1)–(F3) at x. Collective.

        Where x does not meet a Dirichlet value yet, the bulk is lifted as in DOLFINx and contact
        sees the bodies with the value imposed. Where forces are not finite, all of b is nan.

        Args:
            close: apply the pairs' initial contact
        """
        self.write(x)
        self.bulk.update_materials()
        rows = self.bulk.residual()
        if rows is None:
            b.set(np.nan)
            return
        if self._first_force < 0:
            self._first_force = self.bulk.force
        self.reference_force = max(self._first_force, self.bulk.force)
        b.zeroEntries()
        b.array[: self.bulk.size] = rows

        self.changes = np.zeros(5, dtype=int)
        for pair, contact in zip(self.pairs, self.contacts):
            self.changes += contact.update(pair.initial_contact if close else -1.0)
            with _assembled(b), together(self.comm, "contact residual"):
                contact.assembler.residual(b.handle)
        self.driven.residual(b)
        b.assemble()

    def norms(self, b: Any) -> tuple[float, float]:
        """Norms of the rows of the bulk and of contact [force]. Collective."""
        rows, bulk = b.array_r, self.bulk.size
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
        self.bulk.update_materials()
        A.zeroEntries()
        with events.BULK_JACOBIAN:
            self.bulk.add(A, self.bulk.bcs)
            A.assemble()  # contact adds to its arrays
            self.bulk.scale(A, self.scale)
        self.add_contact(A)
        for contact in self.contacts:
            add_diagonal(A, contact.held_rows(), 1.0)
        self.driven.tangent(A, self.contacts)
        A.assemble()

    def add_contact(self, A: Any) -> None:
        """Add the pairs' tangents to a matrix that is assembled. Collective."""
        self._remote.zero()
        with _assembled(A), together(self.comm, "contact tangent"):
            for contact in self.contacts:
                contact.assembler.tangent(A.handle, self._remote)
        self._remote.send(A.handle)

    def _allocate(self, A: Any) -> None:
        """Allocate the bulk's pattern and that of the present targets and their neighbours; fill A
        with zeros. Collective."""
        pattern = _cpp.Pattern(self.comm.py2f(), self.layout.owned)
        self.bulk.add_pattern(pattern)
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
            compat.set_bc(u, self.bulk.bcs)
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
        self.bulk.update_materials(
            again=True
        )  # their parameters may be new, the time step for one
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
        for material in self.bulk.materials:
            material.restore()

    def accept(self) -> None:
        """The present displacements are a solution: slips and plastic flow of the next step start
        from there. Collective."""
        for contact in self.contacts:
            contact.remember()
        for material in self.bulk.materials:
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
        alone = System(self.bulk.F, self.u, self.bulk.J, [], self.bulk.bcs)
        A = alone.new_matrix()
        alone.bulk.add(A, self.bulk.bcs)
        A.assemble()
        return A

    def measured(self) -> dict[str, Any]:
        """Units and stiffnesses as they were measured before the first step, for ``set_measured``:
        on deformed bodies they would be others."""
        return {
            "scale": self.scale,
            "row_scale": self.bulk.row_scale,
            "displacements": self.bulk.displacements,
            "round_off": self.round_off,
            "driven": self.driven.stiffness,
            "parameters": self.parameters.state(),
        }

    def set_measured(self, figures: dict[str, Any]) -> None:
        """Measure no more, but take these."""
        self.scale, self.bulk.row_scale = list(figures["scale"]), list(figures["row_scale"])
        self.bulk.displacements = list(figures["displacements"])
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
        self.bulk.add(self.A, [])
        self.A.assemble()
        diagonal = self.A.getDiagonal().array.copy()
        present = [[a is not None for a in row] for row in self.bulk.J]
        scales, self.bulk.row_scale, self.bulk.displacements = block_scales(
            self.A, self.layout, present, self.bodies.blocks
        )
        self.scale[: len(self.u)] = scales
        for block in set(range(len(self.u))) - set(self.bulk.displacements):
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
