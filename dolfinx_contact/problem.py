# SPDX-License-Identifier: MIT
"""A UFL model with contact."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from . import compat
from .errors import ConvergenceError, InputError
from .pair import ContactPair
from .quadrature import QuadratureLaw, check_materials
from .report import Report
from .strategy import FixedPoint, Newton
from .system import System, derivative


class ContactProblem:
    """Find u, contact pressures and friction: F(u; w) = 0 with contact on the pairs (F1)–(F3).

    The construction is collective. It mirrors DOLFINx's NonlinearProblem.

    Args:
        F: residual form of the bulk, or a list of them, one for each unknown
        u: unknown Function, or a list, in the order of F (displacement and pressure, say); the
            displacement of each Surface must be among them
        pairs: contact pairs; none for the bulk alone
        bcs: Dirichlet conditions; they find their unknown by their space
        J: Jacobian of F (by UFL's derivative if None); for lists a list of rows with None where
            unknowns are not coupled
        strategy: Newton() (the default) or FixedPoint()
        materials: laws whose stresses are in F (plasticity.J2, or QuadratureLaw); their states go on
            with each solve, and are put back if it fails
        petsc_options: options of SNES, KSP and PC, without prefix, for instance
            {"ksp_type": "gmres"}

    Raises:
        InputError: on all ranks, if F and u do not match, a condition is not on the space of one
            unknown, a pair is used twice, a surface is moved by a Function that is not among u,
            slave surfaces share nodes, or a material and F do not belong together
    """

    def __init__(
        self,
        F: Any,
        u: Any,
        pairs: Sequence[ContactPair],
        *,
        bcs: Sequence[Any] = (),
        J: Any = None,
        strategy: Newton | FixedPoint | None = None,
        petsc_options: dict[str, Any] | None = None,
        materials: Sequence[QuadratureLaw] = (),
    ):
        forms = list(F) if isinstance(F, (list, tuple)) else [F]
        unknowns = list(u) if isinstance(u, (list, tuple)) else [u]
        if not unknowns or not all(isinstance(v, fem.Function) for v in unknowns):
            raise InputError("ContactProblem: u must be a dolfinx Function, or a list of them.")
        if len(forms) != len(unknowns):
            raise InputError(
                f"ContactProblem: {len(forms)} residuals F for {len(unknowns)} unknowns u; give one"
                " residual for each unknown."
            )
        _check_unknowns(forms, unknowns, bcs)
        if isinstance(pairs, ContactPair):
            pairs = [pairs]
        listed = isinstance(pairs, (list, tuple))
        if not listed or not all(isinstance(p, ContactPair) for p in pairs):
            raise InputError("ContactProblem: pairs must be a list of ContactPair.")
        self.pairs, self.u = list(pairs), unknowns
        self.comm = unknowns[0].function_space.mesh.comm
        _check_slaves(self.pairs)
        materials = [materials] if isinstance(materials, QuadratureLaw) else list(materials)
        check_materials(materials, forms, unknowns)
        if J is None:
            jacobian = derivative(forms, unknowns, materials)
        else:
            jacobian = [list(row) for row in J] if isinstance(J, (list, tuple)) else [[J]]
        if len(jacobian) != len(forms) or any(len(row) != len(forms) for row in jacobian):
            raise InputError(
                f"ContactProblem: J must have {len(forms)} rows of {len(forms)} forms (or None)."
            )
        self.strategy = Newton() if strategy is None else strategy
        self.petsc_options = dict(petsc_options or {})
        self.system = System(forms, unknowns, jacobian, self.pairs, list(bcs), materials)
        self.report: Report | None = None
        for tool in {id(t): t for pair in self.pairs for t in pair.tools}.values():
            tool._pairs = [(p, p.tools.index(tool)) for p in self.pairs if tool in p.tools]

    def solve(self) -> Report:
        """Solve for the present loads and Dirichlet values, from the present u. Collective.

        Returns:
            iterations, residual norms, status changes, times

        Raises:
            ConvergenceError: on all ranks; u and the pairs are then as they were before the call
            UnheldError: on all ranks, if nothing holds a body as the solve begins; likewise
            ContactError: on all ranks, if u or a Dirichlet value on a surface is not finite
        """
        system = self.system
        before = system.values()
        try:
            report = self.strategy.solve(system, self.petsc_options)
        except BaseException:
            system.fill(before)
            raise
        self.report = report
        if not report.converged:
            free = system.bodies.unheld(system.A)
            system.fill(before)
            hint = "Take a smaller load step."
            if free is not None:
                hint = f"On the way contact was lost, and {free}. " + hint
            error = ConvergenceError(
                f"The contact problem did not converge: {report.reason} after"
                f" {report.iterations} iterations; u and the pairs are back at the last accepted"
                f" state. {hint}\n{report}"
            )
            error.report = report
            raise error
        for pair, contact in zip(self.pairs, system.contacts):
            contact.assembler.accept()
            pair._accept(contact)
        system.accept()
        return report

    def state(self) -> list[Any]:
        """Copies of where all is: this rank's values of u, then places and reactions of driven tools."""
        return [*(u.x.array.copy() for u in self.u), *self.system.driven.state()]

    def set_state(self, state: Sequence[Any]) -> None:
        """Put back what ``state`` has returned; the multipliers stay.

        Args:
            state: of this problem
        """
        for u, values in zip(self.u, state):
            u.x.array[:] = values
        self.system.driven.set_state(state[len(self.u) :])

    def extrapolate(self, before: Sequence[Any], now: Sequence[Any], ratio: float) -> None:
        """Go on from two states for another part of the way between them: displacements, and tools
        in the directions in which forces drive them; where they are prescribed they stay.

        Args:
            before, now: two states, as ``state`` returns them
            ratio: number of times the way from one to the other is gone on
        """
        ahead = [b + ratio * (b - a) for a, b in zip(before, now)]
        for u, values in zip(self.u, ahead):
            u.x.array[:] = values
        self.system.driven.go_to(ahead[len(self.u) :])

    @property
    def continues(self) -> bool:
        """Whether the last step tells where the next one goes: no tool was brought to its slave."""
        return not self.system.driven.approached


def _check_unknowns(F: Sequence[Any], u: Sequence[Any], bcs: Sequence[Any]) -> None:
    """Each residual belongs to its unknown, and each Dirichlet condition to one unknown."""
    if len(set(map(id, u))) != len(u):
        raise InputError("ContactProblem: u has a Function twice; give each unknown once.")
    for i, (form, v) in enumerate(zip(F, u)):
        tests = form.arguments() if hasattr(form, "arguments") else ()
        if len(tests) != 1:
            raise InputError(
                f"ContactProblem: F[{i}] has {len(tests)} test functions; give a UFL form that is"
                " linear in one test function."
            )
        if tests[0].ufl_function_space().ufl_element() != v.function_space.ufl_element():
            raise InputError(
                f"ContactProblem: the test function of F[{i}] is not of the space of u[{i}]"
                f" ({v.name}); give the residuals in the order of the unknowns."
            )
    for i, bc in enumerate(bcs):
        count = sum(compat.contains(v.function_space, bc) for v in u)
        if count != 1:
            raise InputError(
                f"ContactProblem: the space of bcs[{i}] is that of {count} unknowns; "
                + (
                    "make the condition on the space of an unknown, or on a part V.sub(i) of it."
                    if count == 0
                    else "give each unknown a function space of its own."
                )
            )


def _check_slaves(pairs: Sequence[ContactPair]) -> None:
    """Multipliers of slave surfaces that share nodes would be dependent. Collective."""
    if len(set(map(id, pairs))) != len(pairs):
        raise InputError("ContactProblem: a pair is given twice; give each pair once.")
    for i, a in enumerate(pairs):
        for b in pairs[:i]:
            if a.slave.u is not b.slave.u:
                continue
            shared = _count_shared(a.comm, a.slave.nodes, b.slave.nodes)
            if shared > 0:
                raise InputError(
                    f"ContactProblem: the slave surfaces with tags {a.slave.tags} and"
                    f" {b.slave.tags} share {shared} nodes, and their multipliers would be"
                    " dependent. Make one slave surface of both, or let one of them be a master."
                )


def _count_shared(comm: MPI.Comm, a: npt.NDArray[np.int64], b: npt.NDArray[np.int64]) -> int:
    """Number of global nodes that are in both lists, whichever ranks hold them. Collective.

    The rank with number node mod size compares.
    """
    both = []
    for nodes in (np.unique(a), np.unique(b)):
        parts = comm.alltoall([nodes[nodes % comm.size == rank] for rank in range(comm.size)])
        both.append(np.unique(np.concatenate(parts)))
    return int(comm.allreduce(len(np.intersect1d(*both))))
