# SPDX-License-Identifier: MIT
"""Isotropic hardening: yield stress σ_y over accumulated plastic strain ε_p.

Each law can be called with an array of plastic strains and returns stresses and slopes, as a user's
own function would.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt

from . import _cpp
from .checks import is_number, numbers
from .errors import InputError

Array = npt.NDArray[np.float64]
Hardening = Callable[[Array], tuple[Array, Array]]  # ε_p (n,) -> σ_y and dσ_y/dε_p, (n,)


class _Law:
    """A law that the kernel has."""

    _kernel: Any

    def __call__(self, plastic_strain: Array) -> tuple[Array, Array]:
        """Yield stress and slope; arrays of the given shape."""
        return self._kernel(np.asarray(plastic_strain, dtype=float))

    def _check(self, fits: Callable[[], bool], allowed: str) -> None:
        """Numbers of the law, which have to be finite."""
        given = [getattr(self, field.name) for field in fields(self)]
        if not all(is_number(value) and np.isfinite(value) for value in given) or not fits():
            raise InputError(f"{self}: {allowed}, finite numbers.")


@dataclass(frozen=True)
class Swift(_Law):
    """σ_y = K (eps0 + ε_p)^n.

    Args:
        K: stress at ε_p = 1 − eps0, positive [stress]
        eps0: plastic strain at the start of hardening, positive
        n: exponent, not negative

    Raises:
        InputError: other values
    """

    K: float
    eps0: float
    n: float

    def __post_init__(self) -> None:
        self._check(
            lambda: self.K > 0 and self.eps0 > 0 and self.n >= 0, "give K, eps0 > 0 and n ≥ 0"
        )
        object.__setattr__(self, "_kernel", _cpp.Swift(self.K, self.eps0, self.n))


@dataclass(frozen=True)
class Linear(_Law):
    """σ_y = yield_stress + H ε_p.

    Args:
        yield_stress: positive [stress]
        H: slope, not negative [stress]; 0: perfect plasticity

    Raises:
        InputError: other values
    """

    yield_stress: float
    H: float = 0.0

    def __post_init__(self) -> None:
        self._check(
            lambda: self.yield_stress > 0 and self.H >= 0, "give yield_stress > 0 and H ≥ 0"
        )
        object.__setattr__(self, "_kernel", _cpp.Voce(self.yield_stress, 0.0, 0.0, self.H))


@dataclass(frozen=True)
class Voce(_Law):
    """σ_y = yield_stress + Q (1 − exp(−b ε_p)) + H ε_p.

    Args:
        yield_stress: positive [stress]
        Q: how much the stress rises by saturation, not negative [stress]
        b: rate of saturation, positive
        H: slope of the linear part, not negative [stress]

    Raises:
        InputError: other values
    """

    yield_stress: float
    Q: float
    b: float
    H: float = 0.0

    def __post_init__(self) -> None:
        self._check(self._fits, "give yield_stress, b > 0 and Q, H ≥ 0")
        object.__setattr__(self, "_kernel", _cpp.Voce(self.yield_stress, self.Q, self.b, self.H))

    def _fits(self) -> bool:
        return self.yield_stress > 0 and self.Q >= 0 and self.b > 0 and self.H >= 0


@dataclass(frozen=True)
class Tabulated(_Law):
    """σ_y linear between the points of a table, constant after the last.

    Args:
        strain: plastic strains from 0, increasing; at least two
        stress: yield stresses there, positive and not decreasing [stress]

    Raises:
        InputError: other values
    """

    strain: Sequence[float]
    stress: Sequence[float]

    def __post_init__(self) -> None:
        x, y = numbers(self.strain), numbers(self.stress)
        fits = x.ndim == 1 and x.shape == y.shape and len(x) >= 2 and x[0] == 0
        fits = fits and bool(np.all(np.diff(x) > 0) and np.all(np.diff(y) >= 0) and y[0] > 0)
        if not fits or not np.isfinite(x[-1] + y[-1]):
            raise InputError(
                f"{self}: give increasing strains from 0 and positive stresses that do not fall, finite"
                " numbers."
            )
        object.__setattr__(self, "_kernel", _cpp.Tabulated(x, y))


def check(law: Hardening) -> None:
    """Try a user's own function.

    Raises:
        InputError: it does not return two arrays of the shape given, or yields at once
    """
    if isinstance(law, _Law):
        return
    ep = np.linspace(0.0, 0.1, 3)
    try:
        stress, slope = (np.asarray(a, dtype=float) for a in law(ep))
        fits = stress.shape == slope.shape == ep.shape and bool(stress[0] > 0)
        fits = fits and bool(np.isfinite(stress).all() and np.isfinite(slope).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise InputError(
            f"J2: hardening is {law!r}; give Swift, Linear, Voce, Tabulated, or a function of an"
            " array of plastic strains that returns yield stresses and slopes, two arrays of its"
            " shape, the stress positive at 0."
        )


def flow(law: Hardening, mu: float, q: Array, ep: Array) -> Array:
    """Solve q − 3μ Δε_p − σ_y(ε_p + Δε_p) = 0 at all points together, as the kernel does at one.

    Args:
        law: any function of plastic strain
        mu: shear modulus
        q: von Mises' trial stress, (n,); points where it is nan are left out
        ep: plastic strains before the step, (n,)

    Returns:
        Δε_p, and dσ_y/dε_p at its end, infinite in elastic steps; (n, 2)
    """
    stress, slope = law(ep)
    on_surface = q - stress > -1e-8 * q
    out = np.stack([np.zeros(len(q)), np.where(on_surface, slope, np.inf)], axis=1)
    at = np.flatnonzero(q > stress)
    q, ep, slope, g = q[at], ep[at], slope[at], (q - stress)[at]
    x, low, high = np.zeros(len(at)), np.zeros(len(at)), q / (3 * mu)
    for _ in range(100):  # bisection alone would end before that
        done = np.abs(g) <= 4 * np.finfo(float).eps * q
        low, high = np.where(g > 0, x, low), np.where(g > 0, high, x)
        trial = x + g / (3 * mu + slope)
        trial = np.where((low < trial) & (trial < high), trial, 0.5 * (low + high))
        done |= trial == x
        out[at[done]] = np.stack([x, slope], axis=1)[done]
        left = ~done
        if not left.any():
            return out
        at, q, ep, x = at[left], q[left], ep[left], trial[left]
        low, high = low[left], high[left]
        stress, slope = law(ep + x)
        g = q - 3 * mu * x - stress
    out[at] = np.stack([x, slope], axis=1)
    return out
