# SPDX-License-Identifier: MIT
"""What the user chooses for a pair: where particles lie and how their targets are found.

Equations (F…): H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements, Revue
européenne des éléments finis 11 (2002), sections 3 and 4 of the formulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import basix
import numpy as np
import numpy.typing as npt

from . import _cpp
from .errors import InputError


# -- targets --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Proximity:
    """Closest point of the master's current surface (F4).

    Args:
        radius: particles farther from the master than this have no target [length]; by default
            half the diagonal of the smaller surface's bounding box
        end_tolerance: a particle may overshoot a physical end of the master by this fraction of a
            facet's diameter and is then clamped to the end; beyond it is open

    Raises:
        InputError: a radius that is not positive, or a negative tolerance
    """

    radius: float | None = None
    end_tolerance: float = 0.5

    def __post_init__(self) -> None:
        _check_search(self)


@dataclass(frozen=True)
class SeekDirection:
    """Target on the line through the particle along a fixed direction e (F5).

    Args:
        direction: e, as many numbers as the space has dimensions, not zero; its length and its sign
            do not matter
        radius: largest distance along e [length]; by default as for Proximity
        end_tolerance: as for Proximity, seen along e

    Raises:
        InputError: a zero or malformed direction, a radius that is not positive, or a negative
            tolerance
    """

    direction: Sequence[float]
    radius: float | None = None
    end_tolerance: float = 0.5

    def __post_init__(self) -> None:
        _check_search(self)
        e = np.asarray(self.direction, dtype=float)
        if e.ndim != 1 or len(e) not in (2, 3) or not np.all(np.isfinite(e)) or not np.any(e):
            raise InputError(
                f"SeekDirection: the direction is {self.direction!r}; give a vector of 2 or 3"
                " numbers that is not zero."
            )

    @property
    def unit(self) -> npt.NDArray[np.float64]:
        """e/‖e‖."""
        e = np.asarray(self.direction, dtype=float)
        return e / np.linalg.norm(e)


def _check_search(rule: Any) -> None:
    name = type(rule).__name__
    if rule.radius is not None and not rule.radius > 0:
        raise InputError(f"{name}: radius is {rule.radius}; give a positive length, or None.")
    if not rule.end_tolerance >= 0:
        raise InputError(f"{name}: end_tolerance is {rule.end_tolerance}; give a number ≥ 0.")


# -- particles ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Simpson:
    """Sub-element Simpson points: 2ⁿ parts of a facet per direction (4ⁿ triangles).

    Args:
        n: level, from 0 to 6

    Raises:
        InputError: any other level
    """

    n: int = 1

    def __post_init__(self) -> None:
        if not isinstance(self.n, int) or not 0 <= self.n <= 6:
            raise InputError(f"Simpson: n is {self.n!r}; give an integer from 0 to 6.")

    def particles(self, slave: Any, shape: Any, psi: Any, axisymmetric: bool) -> Any:
        """The rule on the reference facet, and each particle's measure (facets, particles)."""
        rule = _cpp.simpson(shape, self.n)
        return rule, _cpp.particle_weights(slave, rule, axisymmetric)


@dataclass(frozen=True)
class Gauss:
    """Gauss points (Gauss–Jacobi on triangles beyond Basix's tables), exact up to a degree.

    Args:
        degree: of the polynomials that are integrated exactly on an affine facet, from 1 to 20

    Raises:
        InputError: any other degree
    """

    degree: int

    def __post_init__(self) -> None:
        if not isinstance(self.degree, int) or not 1 <= self.degree <= 20:
            raise InputError(f"Gauss: degree is {self.degree!r}; give an integer from 1 to 20.")

    def particles(self, slave: Any, shape: Any, psi: Any, axisymmetric: bool) -> Any:
        """The rule on the reference facet, and each particle's measure (facets, particles)."""
        rule = _gauss(shape, self.degree)
        return rule, _cpp.particle_weights(slave, rule, axisymmetric)


@dataclass(frozen=True)
class Nodes:
    """The nodes of the pressure space, with lumped weights ∫ ψ_a dΓ."""

    def particles(self, slave: Any, shape: Any, psi: Any, axisymmetric: bool) -> Any:
        """The nodes on the reference facet, and each particle's measure (facets, particles).

        Raises:
            InputError: pressures of degree 2 on triangles, where ∫ ψ_a dΓ = 0 at the vertices
        """
        powers, coefficients, points = psi
        basis = _cpp.TraceBasis(points.shape[1], powers, coefficients)
        rule = _cpp.ParticleRule(points, np.zeros(len(points)))
        fine = _gauss(shape, 10)
        integrals = [
            sum(w * basis.values(x)[a] for x, w in zip(fine.points, fine.weights))
            for a in range(len(points))
        ]
        if min(integrals) < 1e-12:
            raise InputError(
                "Nodes: a nodal rule with pressures of degree 2 on triangles has particles without"
                " weight (∫ ψ_a dΓ = 0 at the vertices), and the system would be singular. Use"
                " Simpson(n) or Gauss(degree), or pressures of degree 1."
            )
        return rule, _cpp.lumped_weights(slave, basis, fine, axisymmetric)


def _gauss(shape: Any, degree: int) -> Any:
    points, weights = basix.make_quadrature(getattr(basix.CellType, shape.name), degree)
    return _cpp.ParticleRule(points, weights)
