# SPDX-License-Identifier: MIT
"""How a step is solved: a semi-smooth Newton loop on PETSc SNES."""

from __future__ import annotations

import itertools
import logging
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from petsc4py import PETSc

from .system import System

log = logging.getLogger("dolfinx_contact")
_solver_number = itertools.count()

_DEFAULTS: dict[str, Any] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


@dataclass
class Report:
    """Record of one solve.

    Attributes:
        converged: whether the tolerance was met
        reason: name of PETSc's SNES reason
        iterations: number of linear solves
        residuals: norm of the residual before each linear solve and at the end, per block: "bulk"
            and "contact" [force]
        reference: force that residuals are compared to [force]
        status_changes: particles that changed status at each evaluation of the residual
        time: seconds for the whole solve, residuals, Jacobians
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    residuals: dict[str, list[float]] = field(default_factory=lambda: {"bulk": [], "contact": []})
    reference: float = 0.0
    status_changes: list[int] = field(default_factory=list)
    time: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("total", "residual", "jacobian"), 0.0)
    )

    @property
    def norms(self) -> list[float]:
        """Norm of the whole residual before each linear solve and at the end [force]."""
        return list(np.hypot(self.residuals["bulk"], self.residuals["contact"]))

    def __str__(self) -> str:
        lines = [
            f"{'converged' if self.converged else 'not converged'} ({self.reason}) in"
            f" {self.iterations} iterations, reference force {self.reference:.3e}",
            " it    bulk       contact    status changes",
        ]
        rows = zip(self.residuals["bulk"], self.residuals["contact"], self.status_changes)
        lines += [f"{i:3d}    {b:.3e}  {c:.3e}  {s}" for i, (b, c, s) in enumerate(rows)]
        return "\n".join(lines)


@dataclass
class Newton:
    """Semi-smooth Newton: contact statuses, targets and bulk in one loop, on PETSc SNES.

    A step has converged when the residual of each block is below rtol times the largest norm of the
    bulk's nodal forces (reactions included), or at the round-off of positions times stiffness (bodies
    at rest that touch), or when Newton's step is at round-off.

    Args:
        rtol: relative tolerance of the residual
        max_it: largest number of iterations
    """

    rtol: float = 1e-10
    max_it: int = 30

    def solve(self, system: System, options: dict[str, Any]) -> Report:
        """Solve from the Functions' present values. Collective.

        With friction, a step that begins without any pressure, or in which Newton fails, is solved
        from its frictionless solution (formulation, section 7): friction then knows the pressures.
        If that fails too, statuses cycle, and it is tried once more with a tenth and a hundredth of
        ρ_τ.

        Returns:
            what happened, over all attempts; the system's Functions hold the last iterate
        """
        before, report = _values(system), Report()

        def direct() -> bool:
            _fill(system, before)
            system.start()
            return _Loop(self, system, options).run(report).converged

        def by_frictionless() -> bool:
            _fill(system, before)
            system.start(friction=False)
            if not _Loop(self, system, options).run(report).converged:
                return False
            pressed = _values(system)
            for factor in (1.0, 0.1, 0.01):
                _fill(system, pressed)
                system.go_on(factor)
                if _Loop(self, system, options).run(report).converged:
                    return True
            return False

        if not any(pair.frictional for pair in system.pairs):
            direct()
        elif system.without_pressure():
            by_frictionless() or direct()
        else:
            direct() or by_frictionless()
        return report


def _values(system: System) -> list[Any]:
    return [f.x.array.copy() for f in system.functions]


def _fill(system: System, values: list[Any]) -> None:
    for f, array in zip(system.functions, values):
        f.x.array[:] = array


class _Loop:
    """One run of SNES."""

    def __init__(self, newton: Newton, system: System, options: dict[str, Any]):
        self.newton, self.system = newton, system
        self.report = Report()
        self._first = True
        self._failure: BaseException | None = None
        self._options = options

    def _snes(self) -> Any:
        """SNES with our defaults, the problem's options, then the command line's."""
        system, newton = self.system, self.newton
        snes = PETSc.SNES().create(system.comm)
        snes.setFunction(self._residual, system.b)
        snes.setJacobian(self._jacobian, system.A)
        snes.setTolerances(rtol=newton.rtol, atol=0.0, stol=0.0, max_it=newton.max_it)
        prefix = f"dolfinx_contact_{next(_solver_number)}_"
        database = PETSc.Options()
        given = {**_DEFAULTS, **self._options}
        for key, value in given.items():
            database[prefix + key] = value
        snes.setOptionsPrefix("")
        snes.setFromOptions()  # so that -snes_monitor and its like work
        snes.setOptionsPrefix(prefix)
        snes.setFromOptions()
        self._keys = [prefix + key for key in given]
        snes.setConvergenceTest(self._test)
        return snes

    def run(self, report: Report) -> Report:
        """Add what happens to a report."""
        system, self.report = self.system, report
        start = time.perf_counter()
        snes = self._snes()
        try:
            snes.solve(None, system.x)
            if self._failure is not None:
                raise self._failure
            report.iterations += snes.getIterationNumber()
            reason = snes.getConvergedReason()
            report.converged = reason > 0
            report.reason = _name(reason)
            if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                report.reason += " / " + _linear_name(snes.getKSP().getConvergedReason())
            system.write(system.x)
        finally:
            snes.destroy()
            database = PETSc.Options()
            for key in self._keys:
                if database.hasName(key):
                    database.delValue(key)
        report.reference = system.reference_force
        report.time["total"] += time.perf_counter() - start
        return report

    def _residual(self, snes: Any, x: Any, b: Any) -> None:
        start = time.perf_counter()
        if not self._first and not np.isfinite(x.norm()):
            b.set(np.nan)  # the step has overflown: SNES ends the solve, the search would raise
            return
        self.system.residual(x, b, close=self._first)
        self._first = False
        self.report.time["residual"] += time.perf_counter() - start

    def _jacobian(self, snes: Any, x: Any, A: Any, P: Any) -> None:
        start = time.perf_counter()
        self.system.jacobian(x, A)
        self.report.time["jacobian"] += time.perf_counter() - start

    def _test(self, snes: Any, it: int, norms: tuple[float, float, float]) -> Any:
        system, report = self.system, self.report
        reasons = PETSc.SNES.ConvergedReason
        b = snes.getFunction()[0].array_r
        bulk = system.layout.offsets[len(system.u)]
        squares = np.array([b[:bulk] @ b[:bulk], b[bulk:] @ b[bulk:]])
        bulk_norm, contact_norm = np.sqrt(system.comm.allreduce(squares))
        report.residuals["bulk"].append(float(bulk_norm))
        report.residuals["contact"].append(float(contact_norm))
        report.status_changes.append(system.status_changes)
        log.info(
            "iteration %d: bulk %.3e, contact %.3e, %d status changes",
            it,
            bulk_norm,
            contact_norm,
            system.status_changes,
        )
        if not np.isfinite(bulk_norm + contact_norm):
            return reasons.DIVERGED_FNORM_NAN
        worst, reference = max(bulk_norm, contact_norm), system.reference_force
        if worst <= max(snes.rtol * reference, snes.atol, system.round_off):
            return reasons.CONVERGED_FNORM_RELATIVE
        xnorm, ynorm, _ = norms
        if it > 0 and ynorm <= 1e-13 * xnorm and worst <= 1e-6 * reference:
            return reasons.CONVERGED_SNORM_RELATIVE
        return reasons.CONVERGED_ITERATING


def _name(reason: int) -> str:
    return _lookup(PETSc.SNES.ConvergedReason, reason)


def _linear_name(reason: int) -> str:
    return _lookup(PETSc.KSP.ConvergedReason, reason)


def _lookup(kind: Any, value: int) -> str:
    for name in dir(kind):
        if name.isupper() and getattr(kind, name) == value:
            return name
    return str(value)
