# SPDX-License-Identifier: MIT
"""What a solve did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Sequence

import numpy as np


@dataclass
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
        status_changes: particles that opened or closed, at each of these
        slip_changes: particles that changed between stick and slip, likewise
        reversals: particles that slip on in another direction, likewise
        time: seconds for the whole solve, residuals, Jacobians
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    linear_iterations: list[int] = field(default_factory=list)
    residuals: dict[str, list[float]] = field(default_factory=lambda: {"bulk": [], "contact": []})
    reference: float = 0.0
    status_changes: list[int] = field(default_factory=list)
    slip_changes: list[int] = field(default_factory=list)
    reversals: list[int] = field(default_factory=list)
    time: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("total", "residual", "jacobian"), 0.0)
    )

    @property
    def norms(self) -> list[float]:
        """Norm of the whole residual before each linear solve and at the end [force]."""
        return list(np.hypot(self.residuals["bulk"], self.residuals["contact"]))

    def add(self, bulk: float, contact: float, changes: Sequence[int]) -> None:
        """Append a line.

        Args:
            bulk, contact: norms of the residual [force]
            changes: numbers of particles that opened or closed, changed between stick and slip, and
                slipped on in another direction, (3,)
        """
        self.residuals["bulk"].append(bulk)
        self.residuals["contact"].append(contact)
        for column, n in zip((self.status_changes, self.slip_changes, self.reversals), changes):
            column.append(int(n))

    def __str__(self) -> str:
        lines = [
            f"{'converged' if self.converged else 'not converged'} ({self.reason}) in"
            f" {self.iterations} iterations, reference force {self.reference:.3e}",
            " it    bulk       contact    open/closed  stick/slip  reversals",
        ]
        columns = (
            *(self.residuals[name] for name in ("bulk", "contact")),
            *(self.status_changes, self.slip_changes, self.reversals),
        )
        for i, (bulk, contact, status, slip, back) in enumerate(zip(*columns)):
            lines.append(
                f"{i:3d}    {bulk:.3e}  {contact:.3e}  {status:11d}  {slip:10d}  {back:9d}"
            )
        return "\n".join(lines)
