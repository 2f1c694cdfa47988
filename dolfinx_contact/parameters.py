# SPDX-License-Identifier: MIT
"""Scales and augmentation parameters of the pairs of a system, chosen anew in each step.

λ is scaled by the stiffness of the slave surface per area [pressure/length], and ρ_n is a fraction of
it. ρ_τ is chosen so that ρ_τ μ p is about equal to it, with p the largest pressure at the start of the
step; κ = μ p/ρ_τ (formulation, section 1).
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy.typing as npt

# ρ_n in units of the stiffness per area of the slave surface. Well below 1, so that the statuses of
# particles with a small gap inside a facet follow the pressure (formulation, section 7).
_RHO_N = 1e-2
# ρ_τ μ p in the same units: here slip and change of Λ count about equally, and Newton settles best.
_RHO_T = 1.0
# ρ_τ times the facet's size is at most the first: pressures may be tiny as a step starts. Where Newton
# fails, the second: slender bodies slip by a good part of a facet while friction builds up.
_MOST_RHO_T = 1500.0, 50.0


class Parameters:
    """Parameters of some pairs.

    Args:
        contacts: the pairs in their system

    Attributes:
        chosen: what each pair has in the present step: "rho_n" and, with friction, "rho_t" and
            "pressure"
    """

    def __init__(self, contacts: Sequence[Any]):
        self._contacts = list(contacts)
        self._stiffness = [1.0] * len(self._contacts)
        self._most = 0  # which of the bounds of ρ_τ holds
        self.chosen: list[dict[str, float]] = []

    def measure(self, diagonal: npt.NDArray[Any]) -> None:
        """See PairAssembly.stiffness. Collective."""
        self._stiffness = [contact.stiffness(diagonal) for contact in self._contacts]

    def choose(self, scale: list[float], friction: bool = True) -> None:
        """Choose for the present pressures, and give them to the assemblers. Collective.

        Args:
            scale: units of the system's unknowns; those of λ and Λ are filled in
            friction: False: without it for now
        """
        self.chosen = []
        for contact, stiffness in zip(self._contacts, self._stiffness):
            pair = contact.pair
            chosen = {"rho_n": pair.rho_n or _RHO_N * stiffness}
            if pair.frictional:
                size = contact.facet_size()
                p = self._pressure(contact, stiffness) or 1e-6 * stiffness * size
                mu, most = max(pair.coefficient, 0.1), _MOST_RHO_T[self._most] / size
                rho_t = pair.rho_t or min(_RHO_T * stiffness / (mu * p), most)
                chosen |= {"rho_t": rho_t, "pressure": p}
                scale[contact.friction_block] = rho_t
            scale[contact.multiplier_block] = stiffness
            self.chosen.append(chosen)
        self._give(friction)

    def _give(self, friction: bool = True) -> None:
        """Give the chosen ones to the assemblers."""
        for contact, stiffness, chosen in zip(self._contacts, self._stiffness, self.chosen):
            pair, rho_n = contact.pair, chosen["rho_n"]
            if not pair.frictional:
                contact.assembler.set_parameters(rho_n, stiffness)
                continue
            mu, rho_t, p = max(pair.coefficient, 0.1), chosen["rho_t"], chosen["pressure"]
            contact.assembler.set_parameters(
                rho_n,
                stiffness,
                pair.coefficient if friction else 0.0,
                rho_t,
                rho_t,
                mu * p / rho_t,
                1e-12 * p,
            )

    def state(self) -> dict[str, Any]:
        """What was measured and chosen, for ``set_state``."""
        return {"stiffness": self._stiffness, "most": self._most, "chosen": self.chosen}

    def set_state(self, state: dict[str, Any]) -> None:
        self._stiffness, self._most = list(state["stiffness"]), state["most"]
        self.chosen = [dict(chosen) for chosen in state["chosen"]]
        self._give()

    def other_bound(self) -> None:
        """From now on take the other bound of ρ_τ."""
        self._most = 1 - self._most

    def without_pressure(self) -> bool:
        """Whether pairs with friction touch, but none of them has a pressure yet, in the step that
        has been started. Collective."""
        touching = [
            self._pressure(c, s) for c, s in zip(self._contacts, self._stiffness) if c.touches
        ]
        return bool(touching) and not any(touching)

    def has_pressure(self) -> bool:
        """Whether some pair has a pressure. Collective."""
        return any([self._pressure(c, s) for c, s in zip(self._contacts, self._stiffness)])

    @staticmethod
    def _pressure(contact: Any, stiffness: float) -> float:
        """Largest pressure of a pair; 0 where it is round-off, as open pairs have it. Collective."""
        p = contact.largest_pressure()
        return p if p > 1e-14 * stiffness * contact.facet_size() else 0.0
