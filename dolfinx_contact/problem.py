# SPDX-License-Identifier: MIT
"""A UFL model with contact."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from . import compat
from .bulk import derivative
from .checks import agreed
from .errors import ConvergenceError, InputError, together
from .pair import ContactPair
from .quadrature import QuadratureLaw, check_materials
from .report import Report
from .strategy import FixedPoint, Newton
from .system import System
from .watch import heed, postponed, stage


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
            raise InputError(
                f"ContactProblem: u must be a dolfinx Function, or a list of them; give these for {u!r}."
            )
        self.comm = unknowns[0].function_space.mesh.comm
        with together(self.comm, "ContactProblem"):
            pairs = self._check(forms, unknowns, pairs, bcs, strategy, petsc_options)
            materials = _listed(materials, QuadratureLaw, "materials")
            check_materials(materials, forms, unknowns)
        self.pairs, self.u = pairs, unknowns
        self.strategy = Newton() if strategy is None else strategy
        self.petsc_options = dict(petsc_options or {})
        agreed(
            self.comm,
            "ContactProblem",
            unknowns=len(unknowns),
            pairs=len(pairs),
            bcs=len(bcs),
            materials=len(materials),
            strategy=self.strategy,
            petsc_options=self.petsc_options,
        )
        _check_slaves(pairs)
        with together(self.comm, "ContactProblem"):
            if J is None:
                jacobian = derivative(forms, unknowns, materials)
            else:
                jacobian = [list(row) for row in J] if isinstance(J, (list, tuple)) else [[J]]
            _check_jacobian(jacobian, unknowns)
        with stage("ContactProblem"):
            self.system = System(forms, unknowns, jacobian, pairs, list(bcs), materials)
        self.report: Report | None = None
        for tool in {id(t): t for pair in self.pairs for t in pair.tools}.values():
            tool._pairs = [(p, p.tools.index(tool)) for p in self.pairs if tool in p.tools]

    @staticmethod
    def _check(
        forms: list[Any],
        unknowns: list[Any],
        pairs: Any,
        bcs: Any,
        strategy: Any,
        petsc_options: Any,
    ) -> list[ContactPair]:
        """What this rank can see alone; the pairs as a list."""
        if len(forms) != len(unknowns):
            raise InputError(
                f"ContactProblem: {len(forms)} residuals F for {len(unknowns)} unknowns u; give one"
                " residual for each unknown."
            )
        if not isinstance(bcs, (list, tuple)) or not all(hasattr(bc, "dof_indices") for bc in bcs):
            raise InputError(
                f"ContactProblem: bcs is {bcs!r}; give a list of Dirichlet conditions (fem.dirichletbc)."
            )
        _check_unknowns(forms, unknowns, bcs)
        if strategy is not None and not isinstance(strategy, (Newton, FixedPoint)):
            raise InputError(
                f"ContactProblem: strategy is {strategy!r}; give Newton() or FixedPoint()."
            )
        named = isinstance(petsc_options, (dict, type(None)))
        if not named or not all(isinstance(name, str) for name in petsc_options or ()):
            raise InputError(
                f"ContactProblem: petsc_options is {petsc_options!r}; give a dict of names, without"
                ' prefix, and values, as {"ksp_type": "gmres"}.'
            )
        return _listed(pairs, ContactPair, "pairs")

    def solve(self) -> Report:
        """Solve for the present loads and Dirichlet values, from the present u. Collective.

        Returns:
            iterations, residual norms, status changes, times

        Raises:
            ConvergenceError: on all ranks; u and the pairs are then as they were before the call
            UnheldError: on all ranks, if nothing holds a body as the solve begins; likewise
            ContactError: on all ranks, if u or a Dirichlet value on a surface is not finite
            KeyboardInterrupt: on all ranks, after Ctrl-C on any of them, at the next iteration
        """
        with postponed(self.comm, "solve"), stage("solve"):
            return self._solve()

    def _solve(self) -> Report:
        system = self.system
        before = system.values()
        try:
            report = self.strategy.solve(system, self.petsc_options)
            heed(self.comm, "solve")
        except BaseException:
            system.fill(before)
            raise
        self.report = report
        if not report.converged:
            free = system.bodies.unheld(system.A)
            system.fill(before)
            raise _not_converged(report, free)
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


def _not_converged(report: Report, free: str | None) -> ConvergenceError:
    """Made here: a frame with a name for what it raises lives until garbage is collected."""
    hint = "Take a smaller load step."
    if free is not None:
        hint = f"On the way contact was lost, and {free}. " + hint
    error = ConvergenceError(
        f"The contact problem did not converge: {report.reason} after"
        f" {report.iterations} iterations; u and the pairs are back at the last accepted"
        f" state. {hint}\n{report}"
    )
    error.report = report
    return error


def _listed(given: Any, kind: Any, name: str) -> list[Any]:
    """A list of things of a kind, or one of them."""
    if isinstance(given, kind):
        return [given]
    if not isinstance(given, (list, tuple)) or not all(isinstance(one, kind) for one in given):
        raise InputError(f"ContactProblem: {name} is {given!r}; give a list of {kind.__name__}.")
    return list(given)


def _check_jacobian(J: list[list[Any]], u: Sequence[Any]) -> None:
    """Rows and columns of bilinear forms on the spaces of the unknowns."""
    if len(J) != len(u) or any(len(row) != len(u) for row in J):
        raise InputError(
            f"ContactProblem: J has {[len(row) for row in J]} forms in its rows; give {len(u)} rows of"
            f" {len(u)} forms (or None)."
        )
    for i, row in enumerate(J):
        for j, form in enumerate(row):
            if form is None:
                continue
            arguments = form.arguments() if isinstance(form, ufl.Form) else ()
            spaces = [argument.ufl_function_space() for argument in arguments]
            if len(arguments) != 2 or any(
                V.ufl_element() != v.function_space.ufl_element()
                or V.ufl_domain() != v.function_space.ufl_domain()
                for V, v in zip(spaces, (u[i], u[j]))
            ):
                raise InputError(
                    f"ContactProblem: J[{i}][{j}] is no bilinear form on the spaces of u[{i}] and u[{j}];"
                    " give the derivative of the residual, or leave J out."
                )
    if not any(form is not None for row in J for form in row):
        raise InputError(
            "ContactProblem: no residual depends on an unknown, and the matrix would be zero; write F"
            " with u, not with a trial function or a copy of it."
        )


def _check_unknowns(F: Sequence[Any], u: Sequence[Any], bcs: Sequence[Any]) -> None:
    """Each residual belongs to its unknown, and each Dirichlet condition to one unknown."""
    if len(set(map(id, u))) != len(u):
        raise InputError("ContactProblem: u has a Function twice; give each unknown once.")
    for i, (form, v) in enumerate(zip(F, u)):
        tests = form.arguments() if isinstance(form, ufl.Form) else ()
        if len(tests) != 1:
            raise InputError(
                f"ContactProblem: F[{i}] has {len(tests)} test functions; give a UFL form, an"
                " integral, that is linear in one test function."
            )
        V = tests[0].ufl_function_space()
        if (
            V.ufl_element() != v.function_space.ufl_element()
            or V.ufl_domain() != v.function_space.ufl_domain()
        ):
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
