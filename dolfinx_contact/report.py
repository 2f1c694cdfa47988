# SPDX-License-Identifier: MIT
"""What a solve did."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np


CHANGES = ("opened", "closed", "began_to_slip", "began_to_stick", "reversals")


def told(changes: Sequence[int]) -> str:
    """Changes of status in words, those that happened."""
    words = [f"{n} {name.replace('_', ' ')}" for name, n in zip(CHANGES, changes) if n > 0]
    return ", ".join(words) or "no change of status"


STAGES = ("total", "residual", "jacobian")


@dataclass(slots=True)
class Report:
    """Record of one solve. LoadStepping keeps one a step, so that numbers are in arrays.

    Attributes:
        converged: whether the tolerance was met
        reason: name of PETSc's SNES reason
        iterations: number of linear solves
        reference: force that residuals are compared to [force]
        forces: before each linear solve and at the end, two norms of the residual, see ``add``; flat
        counts: likewise, iterations of KSP before (-1: no linear solve), and particles by CHANGES; flat
        seconds: for the whole solve, residuals, Jacobians
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    reference: float = 0.0
    forces: Any = ()
    counts: Any = ()
    seconds: Any = (0.0,) * len(STAGES)

    def __post_init__(self) -> None:
        self.forces = array("d", self.forces)
        self.counts = array("i", self.counts)
        self.seconds = array("d", self.seconds)

    def _changes(self, name: str) -> list[int]:
        return self.counts[1 + CHANGES.index(name) :: 1 + len(CHANGES)].tolist()

    @property
    def residuals(self) -> dict[str, list[float]]:
        """Norm of the residual before each linear solve and at the end, per block: "bulk" and
        "contact" [force]."""
        return {"bulk": self.forces[::2].tolist(), "contact": self.forces[1::2].tolist()}

    @property
    def linear_iterations(self) -> list[int]:
        """Iterations of KSP in each linear solve, 1 for a direct solver."""
        return [n for n in self.counts[:: 1 + len(CHANGES)] if n >= 0]

    @property
    def time(self) -> dict[str, float]:
        """Seconds for the whole solve ("total"), residuals ("residual"), Jacobians ("jacobian")."""
        return dict(zip(STAGES, self.seconds))

    @property
    def opened(self) -> list[int]:
        """Particles that opened, before each linear solve and at the end."""
        return self._changes("opened")

    @property
    def closed(self) -> list[int]:
        """Particles that closed, likewise."""
        return self._changes("closed")

    @property
    def began_to_slip(self) -> list[int]:
        """Particles that began to slip, likewise."""
        return self._changes("began_to_slip")

    @property
    def began_to_stick(self) -> list[int]:
        """Particles that began to stick, likewise."""
        return self._changes("began_to_stick")

    @property
    def reversals(self) -> list[int]:
        """Particles that slip on in another direction, likewise."""
        return self._changes("reversals")

    @property
    def norms(self) -> list[float]:
        """Norm of the whole residual before each linear solve and at the end [force]."""
        return list(np.hypot(*self.residuals.values()))

    @property
    def status_changes(self) -> list[int]:
        """Particles that opened or closed."""
        return [a + b for a, b in zip(self.opened, self.closed)]

    @property
    def slip_changes(self) -> list[int]:
        """Particles that changed between stick and slip."""
        return [a + b for a, b in zip(self.began_to_slip, self.began_to_stick)]

    def add(
        self, bulk: float, contact: float, changes: Sequence[int], linear: int | None = None
    ) -> None:
        """Append a line.

        Args:
            bulk, contact: norms of the residual [force]
            changes: numbers of particles that opened, closed, began to slip, began to stick, and
                slipped on in another direction, (5,)
            linear: iterations of KSP that led here, None where no linear solve did
        """
        self.forces.extend((bulk, contact))
        self.counts.extend((-1 if linear is None else linear, *changes))

    def took(self, stage: str, seconds: float) -> None:
        """Add to a time.

        Args:
            stage: "total", "residual" or "jacobian"
            seconds: to add [s]
        """
        self.seconds[STAGES.index(stage)] += seconds

    def __str__(self) -> str:
        lines = [
            f"{'converged' if self.converged else 'not converged'} ({self.reason}) in"
            f" {self.iterations} iterations, reference force {self.reference:.3e},"
            f" {self.time['total']:.2f} s",
            " it  bulk       contact    opened  closed  to slip  to stick  reversals",
        ]
        counts = [getattr(self, name) for name in CHANGES]
        for i, (bulk, contact, *changes) in enumerate(zip(*self.residuals.values(), *counts)):
            words = "{:7d} {:7d}  {:7d}  {:8d}  {:9d}".format(*changes)
            lines.append(f"{i:3d}  {bulk:.3e}  {contact:.3e}{words}")
        return "\n".join(lines)
