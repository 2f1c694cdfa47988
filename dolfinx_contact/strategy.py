# SPDX-License-Identifier: MIT
"""How a step is solved: one semi-smooth Newton loop, or the nested loops of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable

from .checks import number, whole
from .errors import UnheldError
from .newton import NewtonLoop
from .report import Report
from .system import System


@dataclass
class Newton:
    """Semi-smooth Newton: contact statuses, targets and bulk in one loop, on PETSc SNES.

    A step has converged when the residual of each block is below rtol times the largest norm of the
    bulk's nodal forces (reactions included), or at the round-off of positions times stiffness (bodies
    at rest that touch), or when Newton's step is at round-off.

    Args:
        rtol: relative tolerance of the residual, between 0 and 1
        max_it: largest number of iterations

    Raises:
        InputError: other numbers
    """

    rtol: float = 1e-10
    max_it: int = 30

    def __post_init__(self) -> None:
        _check("Newton", self)

    def solve(self, system: System, options: dict[str, Any]) -> Report:
        """Solve from the Functions' present values. Collective.

        With friction, a step that begins without any pressure is solved from its frictionless
        solution (formulation, section 7): friction then knows the pressures. A body that friction
        alone holds is glued for that. Where Newton fails, it tries again with another bound of
        ρ_τ, which is kept for the next steps, and without closing what is near: a slender body is
        thrown off by that.

        Args:
            system: unknowns, residual and matrix of a problem
            options: PETSc's, without prefix

        Returns:
            what happened, over all attempts; the system's Functions hold the last iterate

        Raises:
            UnheldError: on all ranks, if nothing holds a body
        """
        before, report = system.values(), Report()
        self._solve(system, options, before, report, True)
        if not report.converged:
            system.parameters.other_bound()
            system.fill(before)
            self._solve(system, options, before, report, not system.parameters.has_pressure())
            if not report.converged:  # no trace of it
                system.parameters.other_bound()
        return report

    def _solve(
        self,
        system: System,
        options: dict[str, Any],
        before: list[Any],
        report: Report,
        close: bool,
    ) -> None:
        """One attempt, with or without the pairs' initial contact."""

        def run() -> bool:
            return NewtonLoop(system, options, self.rtol, self.max_it, close).run(report)

        def from_predictor() -> None:
            system.fill(before)
            if _predict(system, run, run):
                system.restore()
                system.go_on()
                run()

        system.start()
        if system.parameters.without_pressure():
            return from_predictor()
        try:
            run()
        except UnheldError:
            if not system.frictional:
                raise
            from_predictor()  # all slips at first; glued it may hold


@dataclass
class FixedPoint:
    """The nested loops of Ben Dhia and Zarroug (2002): geometry, threshold, status, Newton.

    Newton solves for u, λ and Λ with targets and normals, the friction's limit μλ and all statuses
    frozen. Around it the statuses are decided anew, around that the limit, and outermost targets and
    normals, each until the residual is small when it is let go. The solution is that of Newton();
    it takes more linear solves, but less can go wrong in each.

    Args:
        rtol: relative tolerance of the residual, as in Newton
        max_it: largest number of Newton iterations in the innermost loop
        max_loops: largest number of turns of each other loop

    Raises:
        InputError: other numbers
    """

    rtol: float = 1e-10
    max_it: int = 30
    max_loops: int = 40

    _order = ("geometry", "threshold", "status")

    def __post_init__(self) -> None:
        _check("FixedPoint", self)
        self.max_loops = whole("FixedPoint", "max_loops", self.max_loops, 1)

    def solve(self, system: System, options: dict[str, Any]) -> Report:
        """Solve from the Functions' present values. Collective.

        Args:
            system, options: as for Newton

        Returns:
            what happened; the system's Functions hold the last iterate

        Raises:
            UnheldError: on all ranks, if nothing holds a body
        """
        report = Report()

        def run() -> bool:
            system.residual(system.x, system.b, close=True)
            try:
                report.converged = self._loop(0, 0.0, system, options, report)
            finally:
                system.freeze()
            return report.converged

        def glued() -> bool:
            return NewtonLoop(system, options, self.rtol, self.max_it).run(report)

        def from_predictor() -> None:
            if _predict(system, run, glued):
                system.go_on()
                run()

        before = system.values()
        system.start()
        if system.parameters.without_pressure():
            system.fill(before)
            from_predictor()
            return report
        try:
            run()
        except UnheldError:  # all slips at first; glued it may hold
            system.fill(before)
            from_predictor()
        return report

    def _loop(
        self,
        level: int,
        enough: float,
        system: System,
        options: dict[str, Any],
        report: Report,
    ) -> bool:
        """Solve with the first `level` things frozen, to `enough` [force] or rtol. An inner
        loop stops at a tenth of what the outer one has left: more would be lost in its next turn.
        """
        if level == len(self._order):
            loop = NewtonLoop(system, options, self.rtol, self.max_it, close=False)
            return loop.run(report, enough)
        left = max(system.norms(system.b))
        for _ in range(self.max_loops):
            system.freeze(*self._order[: level + 1])
            if not self._loop(level + 1, max(enough, 0.1 * left), system, options, report):
                return False
            system.freeze(*self._order[:level])
            system.residual(system.x, system.b)
            report.add(*system.norms(system.b), system.changes)
            left = max(system.norms(system.b))
            if left <= enough or system.settled(system.b, self.rtol):
                return True
        report.reason = f"{self._order[level]} not settled after {self.max_loops} loops"
        return False


def _check(who: str, strategy: Newton | FixedPoint) -> None:
    strategy.rtol = number(
        who, "rtol", strategy.rtol, "a number between 0 and 1", lambda rtol: 0 < rtol < 1
    )
    strategy.max_it = whole(who, "max_it", strategy.max_it, 1)


def _predict(system: System, run: Callable[[], bool], glued: Callable[[], bool]) -> bool:
    """A first solution of a step with friction: without it, or glued where nothing else holds."""
    system.start(friction=False)
    try:
        return run()
    except UnheldError:
        system.start()
        system.glue()
        try:
            return glued()
        finally:
            system.unglue()
