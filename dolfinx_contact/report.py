# SPDX-License-Identifier: MIT
"""What a solve did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Sequence

import numpy as np


CHANGES = ("opened", "closed", "began_to_slip", "began_to_stick", "reversals")


def told(changes: Sequence[int]) -> str:
    """Changes of status in words, those that happened."""
    words = [f"{n} {name.replace('_', ' ')}" for name, n in zip(CHANGES, changes) if n > 0]
    return ", ".join(words) or "no change of status"


@dataclass(slots=True)
class Report:
    """Record of one solve.

    Attributes:
        converged: whether the tolerance was met
        reason: name of PETSc's SNES reason
        iterations: number of linear solves
        linear_iterations: iterations of KSP in each of them, 1 for a direct solver
        residuals: norm of the residual before each linear solve and at the end, per block: "bulk"
            and "contact" [force]
        reference: force that residuals are compared to [force]
        opened, closed, began_to_slip, began_to_stick: numbers of particles, at each of these
        reversals: particles that slip on in another direction, likewise
        time: seconds for the whole solve, residuals, Jacobians
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    linear_iterations: list[int] = field(default_factory=list)
    residuals: dict[str, list[float]] = field(default_factory=lambda: {"bulk": [], "contact": []})
    reference: float = 0.0
    opened: list[int] = field(default_factory=list)
    closed: list[int] = field(default_factory=list)
    began_to_slip: list[int] = field(default_factory=list)
    began_to_stick: list[int] = field(default_factory=list)
    reversals: list[int] = field(default_factory=list)
    time: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("total", "residual", "jacobian"), 0.0)
    )

    @property
    def norms(self) -> list[float]:
        """Norm of the whole residual before each linear solve and at the end [force]."""
        return list(np.hypot(self.residuals["bulk"], self.residuals["contact"]))

    @property
    def status_changes(self) -> list[int]:
        """Particles that opened or closed."""
        return [a + b for a, b in zip(self.opened, self.closed)]

    @property
    def slip_changes(self) -> list[int]:
        """Particles that changed between stick and slip."""
        return [a + b for a, b in zip(self.began_to_slip, self.began_to_stick)]

    def add(self, bulk: float, contact: float, changes: Sequence[int]) -> None:
        """Append a line.

        Args:
            bulk, contact: norms of the residual [force]
            changes: numbers of particles that opened, closed, began to slip, began to stick, and
                slipped on in another direction, (5,)
        """
        self.residuals["bulk"].append(bulk)
        self.residuals["contact"].append(contact)
        for name, n in zip(CHANGES, changes):
            getattr(self, name).append(int(n))

    def __str__(self) -> str:
        lines = [
            f"{'converged' if self.converged else 'not converged'} ({self.reason}) in"
            f" {self.iterations} iterations, reference force {self.reference:.3e},"
            f" {self.time['total']:.2f} s",
            " it  bulk       contact    opened  closed  to slip  to stick  reversals",
        ]
        columns = (self.residuals["bulk"], self.residuals["contact"])
        counts = [getattr(self, name) for name in CHANGES]
        for i, (bulk, contact, *changes) in enumerate(zip(*columns, *counts)):
            words = "{:7d} {:7d}  {:7d}  {:8d}  {:9d}".format(*changes)
            lines.append(f"{i:3d}  {bulk:.3e}  {contact:.3e}{words}")
        return "\n".join(lines)
