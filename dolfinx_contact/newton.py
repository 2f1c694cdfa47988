# SPDX-License-Identifier: MIT
"""One run of PETSc SNES on a contact system."""

from __future__ import annotations

import itertools
import logging
import time
from typing import Any

import numpy as np
from petsc4py import PETSc

from .compat import errors_of_callbacks
from .errors import ContactError, InputError
from .report import Report, told
from .solvers import SaddlePoint, direct
from .system import System
from .watch import heed

log = logging.getLogger("dolfinx_contact")
_solver_number = itertools.count()
# PETSc's numbers of errors that come of options: out of range, of another kind, unknown, not there
_OPTIONS = (62, 63, 83, 86, 92)
# Newton may go without progress for so many steps: the first ones change many statuses
_PATIENCE = 3

_DEFAULTS: dict[str, Any] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    **direct(),
}


class NewtonLoop:
    """Newton's iterations from the system's present unknowns.

    Args:
        system: that has been started
        options: of PETSc, without prefix
        rtol: relative tolerance of the residual
        max_it: largest number of iterations
        close: apply the pairs' initial contact at the first residual
    """

    def __init__(
        self,
        system: System,
        options: dict[str, Any],
        rtol: float,
        max_it: int,
        close: bool = True,
    ):
        self.system, self._options = system, options
        self._rtol, self._max_it, self._close = rtol, max_it, close
        self.report = Report()
        self._first = self._first_matrix = True
        self._known: tuple[Any, Any] | None = None  # a trial x and its residual
        self._keys: list[str] = []  # of PETSc's options that are ours

    def _set(self, snes: Any, b: Any) -> None:
        """Our defaults, the problem's options, then the command line's. Collective."""
        system = self.system
        snes.setFunction(self._residual, b)
        snes.setTolerances(rtol=self._rtol, atol=0.0, stol=0.0, max_it=self._max_it)
        prefix = f"dolfinx_contact_{next(_solver_number)}_"
        database = PETSc.Options()
        given = {**_DEFAULTS, **self._options}
        for key, value in given.items():
            database[prefix + key] = value
            self._keys.append(prefix + key)
        self._monitored = any(database.hasName(p + "snes_monitor") for p in ("", prefix))
        snes.setOptionsPrefix("")
        snes.setFromOptions()  # so that -snes_monitor and its like work
        snes.setOptionsPrefix(prefix)
        snes.setFromOptions()
        pc = snes.getKSP().getPC()
        if pc.getType() == "python" and isinstance(pc.getPythonContext(), SaddlePoint):
            pc.getPythonContext().use(system, prefix)
        snes.setJacobian(self._jacobian, system.A)
        snes.setConvergenceTest(self._test)
        snes.setLineSearchPreCheck(self._shorten)

    def run(self, report: Report, enough: float = 0.0) -> bool:
        """Iterate, and add what happens to a report. Collective.

        Args:
            report: of the step
            enough: a norm of the residual that is small enough, whatever rtol says [force]

        Returns:
            whether it converged; the system's Functions hold the last iterate

        Raises:
            UnheldError: on all ranks, if nothing holds a body at the first iterate
            InputError: on all ranks, if solvers.iterative meets an unknown that is no displacement, or
                PETSc refuses an option
            ContactError: PETSc has another error
        """
        system, self.report, self._enough = self.system, report, enough
        self._start = len(report.status_changes)
        start = time.perf_counter()
        snes = PETSc.SNES().create(system.comm)
        # vectors of its own: PETSc leaves them locked where a callback raises
        x, b, *self._trial = (system.x.duplicate() for _ in range(4))
        system.x.copy(x)
        try:
            self._set(snes, b)
            if not 0 <= snes.rtol < 1 or snes.max_it < 1:
                raise InputError(
                    f"petsc_options: snes_rtol is {snes.rtol} and snes_max_it {snes.max_it}; give a"
                    " tolerance between 0 and 1, and at least one iteration."
                )
            with errors_of_callbacks():
                snes.solve(None, x)
            x.copy(system.x)
            b.copy(system.b)
            report.iterations += snes.getIterationNumber()
            reason = snes.getConvergedReason()
            report.converged = reason > 0
            report.reason = _name(reason)
            if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                report.reason += " / " + _linear_name(snes.getKSP().getConvergedReason())
            system.write(system.x)
        except PETSc.Error as error:
            raise _explained(error, self._options) from error
        finally:
            # PETSc 3.18 keeps what Python merely lets go of
            for thing in (snes, x, b, *self._trial):
                thing.destroy()
            database = PETSc.Options()
            for key in self._keys:
                if database.hasName(key):
                    database.delValue(key)
        report.reference = system.reference_force
        report.took("total", time.perf_counter() - start)
        return report.converged

    def _residual(self, snes: Any, x: Any, b: Any) -> None:
        if self._known is not None and x.equal(self._known[0]):
            self._known[1].copy(b)
        else:
            self._evaluate(x, b)
        self._known = None

    def _evaluate(self, x: Any, b: Any) -> None:
        if not self._first and not np.isfinite(x.norm()):
            b.set(np.nan)  # the step has overflown; the search would raise
            return
        start = time.perf_counter()
        self.system.residual(x, b, close=self._close and self._first)
        self._first = False
        self.report.took("residual", time.perf_counter() - start)

    def _jacobian(self, snes: Any, x: Any, A: Any, P: Any) -> None:
        start = time.perf_counter()
        allocations = self.system.allocations
        self.system.jacobian(x, A)
        if self.system.allocations > allocations:
            # PETSc 3.22 sees no new pattern on several ranks, and would go on with the old analysis
            snes.getKSP().getPC().reset()
        if self._first_matrix:
            self.system.check_held()
        self._first_matrix = False
        self.report.took("jacobian", time.perf_counter() - start)

    def _shorten(self, x: Any, step: Any) -> None:
        """Shorten a step that ends where the residual is not finite (inverted cells), or where
        Newton makes no progress, since statuses cycle, or where a tool that a force drives has lost
        the slave, or gone through it. Collective.

        As long as there is progress steps are whole: statuses settle fastest then. Without it, the
        residual has to fall: between changes of status it is smooth, and falls along the step.
        """
        system, norms = self.system, self.report.norms[self._start :]
        recent = norms[-1 - _PATIENCE : -1]
        progress = len(recent) < _PATIENCE or norms[-1] <= 0.5 * min(recent)
        (trial, b), tried = self._trial, []
        system.mark()
        most = system.driven.longest(step)
        adrift = system.driven.adrift(system.contacts)
        for halvings in range(7):
            if halvings > 3 and min(tried)[0] < np.inf:
                break
            length = most * 0.5**halvings
            if tried:
                system.recall()
            trial.waxpy(-length, step, x)
            self._evaluate(trial, b)
            norm = np.hypot(*system.norms(b))
            if not adrift and system.driven.adrift(system.contacts):
                norm = np.inf
            tried.append((norm if np.isfinite(norm) else np.inf, length))
            if norm < np.inf and (progress or adrift or norm <= (1 - 0.2 * length) * norms[-1]):
                break
        best = min(tried)[1]
        if best == tried[-1][1]:
            self._known = trial, b  # SNES asks for it next
        else:
            system.recall()
        step.scale(best)

    def _test(self, snes: Any, it: int, norms: tuple[float, float, float]) -> Any:
        system, report = self.system, self.report
        heed(system.comm, "solve")
        reasons = PETSc.SNES.ConvergedReason
        bulk, contact = system.norms(snes.getFunction()[0])
        linear = snes.getKSP().getIterationNumber() if it > 0 else None
        report.add(bulk, contact, system.changes, linear)
        log.info(
            "iteration %d: bulk %.3e, contact %.3e; %s",
            *(it, bulk, contact, told(system.changes)),
        )
        worst = max(bulk, contact)
        if self._monitored:
            PETSc.Sys.Print(f"    contact: {told(system.changes)}", comm=system.comm)
        if not np.isfinite(worst):
            return reasons.DIVERGED_FNORM_NAN
        if worst <= max(snes.atol, self._enough) or system.settled(
            snes.getFunction()[0], snes.rtol
        ):
            return reasons.CONVERGED_FNORM_RELATIVE
        xnorm, ynorm, _ = norms
        if it > 0 and ynorm <= 1e-13 * xnorm and worst <= 1e-6 * system.reference_force:
            return reasons.CONVERGED_SNORM_RELATIVE
        return reasons.CONVERGED_ITERATING


def _explained(error: Any, options: dict[str, Any]) -> ContactError:
    """An error of PETSc's as one of ours."""
    text = str(error).splitlines()[-1].partition("] ")[2] or str(error)
    if error.ierr in _OPTIONS:
        return InputError(
            f"petsc_options: PETSc refuses {options} with its error {error.ierr} ({text}); give names of"
            " solvers that this build of PETSc has, and values that they take."
        )
    return ContactError(
        f"PETSc has ended the solve with its error {error.ierr} ({text}); take the default solver"
        " (petsc_options=None), or another one."
    )


def _name(reason: int) -> str:
    return _lookup(PETSc.SNES.ConvergedReason, reason)


def _linear_name(reason: int) -> str:
    return _lookup(PETSc.KSP.ConvergedReason, reason)


def _lookup(kind: Any, value: int) -> str:
    for name in dir(kind):
        if name.isupper() and getattr(kind, name) == value:
            return name
    return str(value)
