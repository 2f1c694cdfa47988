# SPDX-License-Identifier: MIT
"""What the user chooses for a pair: where particles lie and how their targets are found.

Equations (F…): H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements, Revue
européenne des éléments finis 11 (2002), sections 3 and 4 of the formulation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Callable, Sequence

import numpy as np
import numpy.typing as npt

from . import _cpp, compat
from .checks import number, numbers, switch, whole
from .errors import InputError


# -- targets --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Smooth:
    """Target along the interpolated normal of the master (F6): x¹ = x² + d n̄.

    Forces are continuous while a particle slides across facets.

    Args:
        radius: largest |d| [length]; by default half the diagonal of the smaller surface's
            bounding box
        end_tolerance: as for Proximity, seen along the normal

    Raises:
        InputError: a radius that is not positive, or a negative tolerance
    """

    radius: float | None = None
    end_tolerance: float = 0.5
    kind = "smooth"

    def __post_init__(self) -> None:
        _check_search(self)


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
    kind = "proximity"

    def __post_init__(self) -> None:
        _check_search(self)


@dataclass(frozen=True)
class SeekDirection:
    """Target on the line through the particle along a given direction e (F5).

    Args:
        direction: e, as many numbers as the space has dimensions, not zero; its length and its sign
            do not matter. Or a function of the reference position X as DOLFINx's interpolate takes
            it: from an array (3, n) to the directions (dim, n) of n points
        radius: largest distance along e [length]; by default as for Proximity
        end_tolerance: as for Proximity, seen along e

    Raises:
        InputError: a zero or malformed direction (of a function: when the problem is made), a
            radius that is not positive, or a negative tolerance
    """

    direction: Sequence[float] | Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]
    radius: float | None = None
    end_tolerance: float = 0.5
    kind = "direction"

    def __post_init__(self) -> None:
        _check_search(self)
        if callable(self.direction):
            return
        e = numbers(self.direction)
        if e.ndim != 1 or len(e) not in (2, 3) or not np.all(np.isfinite(e)) or not np.any(e):
            raise InputError(
                f"SeekDirection: the direction is {self.direction!r}; give a vector of 2 or 3"
                " numbers that is not zero, or a function of X."
            )

    def at(self, X: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit directions on the slave.

        Args:
            X: reference positions, (n, dim) [length]

        Returns:
            directions, (n, dim)

        Raises:
            InputError: a function returns another shape, a zero or a value that is not finite
        """
        n, dim = X.shape
        if n == 0:
            return X
        if not callable(self.direction):
            e = np.tile(np.asarray(self.direction, dtype=float), (n, 1))
        else:
            padded = np.zeros((3, n))
            padded[:dim] = X.T
            returned = self.direction(padded)
            e = numbers(returned)
            if e.shape != (dim, n):
                raise InputError(
                    f"SeekDirection: the function of X returned a {type(returned).__name__} of shape"
                    f" {np.shape(returned)}; for points of shape (3, {n}) give an array of numbers of"
                    f" shape ({dim}, {n})."
                )
            e = e.T
        length = np.linalg.norm(e, axis=1)
        if not np.all(np.isfinite(length) & (length > 0)):
            worst = X[np.argmin(np.where(np.isfinite(length), length, -1.0))]
            raise InputError(
                f"SeekDirection: the direction is zero or not finite at X = {worst.tolist()}; give"
                " a direction that is defined on the whole slave surface."
            )
        return e / length[:, None]


@dataclass(frozen=True)
class SlaveNormal:
    """Target on the line through the particle along the slave's own current normal (F5).

    Args:
        interpolated: take the slave's interpolated normal (F8), continuous along its surface; else
            that of the particle's facet
        radius, end_tolerance: as for SeekDirection

    Raises:
        InputError: a radius that is not positive, or a negative tolerance
    """

    interpolated: bool = True
    radius: float | None = None
    end_tolerance: float = 0.5
    kind = "direction"

    def __post_init__(self) -> None:
        _check_search(self)
        switch("SlaveNormal", "interpolated", self.interpolated)


def _check_search(rule: Any) -> None:
    name = type(rule).__name__
    if rule.radius is not None:
        number(name, "radius", rule.radius, "a positive length, or None", lambda r: r > 0)
    number(
        name,
        "end_tolerance",
        rule.end_tolerance,
        "a finite number ≥ 0",
        lambda part: 0 <= part < np.inf,
    )


# -- particles ------------------------------------------------------------------------------------


class _Rule:
    """What a pair asks of its rule; here particles carry the weights of a quadrature on the
    reference facet."""

    refined = False

    def rule(self, shape: str, psi: Any) -> Any:
        """Points and weights on the reference facet.

        Args:
            shape: of the facets: "interval", "triangle" or "quadrilateral"
            psi: the pressure's basis on a facet, see surface.basis_polynomials

        Raises:
            InputError: a rule that these facets or pressures cannot have
        """
        raise NotImplementedError

    def weights(self, slave: Any, shape: str, rule: Any, psi: Any, axisymmetric: bool) -> Any:
        """Reference measure of each particle, (facets, particles) [area; length in 2D].

        Args:
            slave: the facets, as the C++ core has them
            shape, psi: as for ``rule``
            rule: what ``rule`` has returned
            axisymmetric: with the factor 2πR

        Raises:
            InputError: a particle without weight, where the rule cannot do without it
        """
        return _cpp.particle_weights(slave, rule, axisymmetric)


@dataclass(frozen=True)
class Simpson(_Rule):
    """Sub-element Simpson points: 2ⁿ parts of a facet per direction (4ⁿ triangles), as in the paper.

    Args:
        n: level, from 0 to 6

    Raises:
        InputError: any other level
    """

    n: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "n", whole("Simpson", "n", self.n, 0, 6))

    def rule(self, shape: str, psi: Any) -> Any:
        return _cpp.simpson(getattr(_cpp.Shape, shape), self.n)


@dataclass(frozen=True)
class Gauss(_Rule):
    """Gauss points, exact up to a degree (Basix's rules).

    Args:
        degree: of the polynomials that are integrated exactly on an affine facet, from 1 to 20

    Raises:
        InputError: any other degree
    """

    degree: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "degree", whole("Gauss", "degree", self.degree, 1, 20))

    def rule(self, shape: str, psi: Any) -> Any:
        return _cpp.ParticleRule(*compat.quadrature(shape, self.degree))


@dataclass(frozen=True)
class Lobatto(_Rule):
    """Gauss–Lobatto points: on intervals and, as a tensor product, on quadrilaterals.

    Args:
        points: per direction, ends included, from 2 to 10; exact for degree 2 points − 3

    Raises:
        InputError: any other number; on use, triangular facets
    """

    points: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", whole("Lobatto", "points", self.points, 2, 10))

    def rule(self, shape: str, psi: Any) -> Any:
        if shape == "triangle":
            raise InputError(
                "Lobatto: there is no Gauss-Lobatto rule on triangles; use Simpson(n), whose"
                " particles lie on vertices and edges too, or Gauss(degree)."
            )
        points, weights = compat.quadrature(shape, 2 * self.points - 3, lobatto=True)
        return _cpp.ParticleRule(np.clip(points, 0.0, 1.0), weights)  # ends without round-off


@dataclass(frozen=True)
class Nodes(_Rule):
    """The nodes of the pressure space, with lumped weights ∫ ψ_a dΓ.

    Raises:
        InputError: on use, pressures of degree 2 on triangles, where ∫ ψ_a dΓ = 0 at the vertices
    """

    def rule(self, shape: str, psi: Any) -> Any:
        # nodes on the reference facet, and ∫ ψ_a there
        points, weights = compat.quadrature(shape, 4)
        lumped = weights @ basis_values(psi, points)
        if lumped.min() < 1e-12:
            raise InputError(
                "Nodes: a nodal rule with pressures of degree 2 on triangles has particles without"
                " weight (∫ ψ_a dΓ = 0 at the vertices), and the system would be singular. Use"
                " Simpson(n) or Gauss(degree), or pressures of degree 1."
            )
        return _cpp.ParticleRule(psi[2], lumped)

    def weights(self, slave: Any, shape: str, rule: Any, psi: Any, axisymmetric: bool) -> Any:
        # the axisymmetric factor stays inside the integral, so that a node on the axis keeps a weight
        powers, coefficients, nodes = psi
        basis = _cpp.TraceBasis(nodes.shape[1], powers, coefficients)
        fine = _cpp.ParticleRule(*compat.quadrature(shape, 10))
        out = _cpp.lumped_weights(slave, basis, fine, axisymmetric)
        if out.size and out.min() <= 1e-12 * out.max():
            raise InputError(
                "Nodes: in axisymmetry a node of a pressure of degree 2 has no weight on the axis"
                " (∫ ψ_a 2πR dΓ = 0), and the system would be singular. Use Simpson(n) or"
                " Gauss(degree), or pressures of degree 1."
            )
        return out


@dataclass(frozen=True)
class Segments(_Rule):
    """Exact integration on the common refinement of slave facets and projected master facets.

    Neither side of the integrals has a node or an edge inside a cell of the refinement: an interval
    in 2D, a convex polygon in 3D. Each cell gets a Gauss rule, on a polygon one for each triangle
    that it is cut into. Non-matching meshes then pass the patch test to round-off. The cells follow
    the surfaces; what the master does not cover is a cell too.

    Newton's tangent has the derivative of all places and weights with the corners of both surfaces.

    Args:
        degree: of the polynomials that are integrated exactly on each cell, from 1 to 20; None:
            what affine facets need, λ·⟦w⟧ and λ·λ*

    Raises:
        InputError: any other degree
    """

    degree: int | None = None
    refined = True

    def __post_init__(self) -> None:
        if self.degree is not None:
            object.__setattr__(self, "degree", whole("Segments", "degree", self.degree, 1, 20))

    def fitted(
        self, shapes: Sequence[str], displacement: int, multiplier: int, axisymmetric: bool
    ) -> Segments:
        """This rule, with a degree where none is given.

        Args:
            shapes: of the slave's and the master's facets
            displacement, multiplier: the highest degrees
            axisymmetric: R is in the integrals

        Returns:
            a rule with a degree
        """
        if self.degree is not None:
            return self
        # a bilinear function is of degree 2 along a diagonal
        each = 2 if "quadrilateral" in shapes else 1
        degree = each * (multiplier + max(displacement, multiplier)) + axisymmetric
        return replace(self, degree=degree)

    def rule(self, shape: str, psi: Any) -> Any:
        # on the reference interval or triangle, for each simplex of a cell
        simplex = "interval" if shape == "interval" else "triangle"
        return _cpp.ParticleRule(*compat.quadrature(simplex, self.degree))

    def points(self, shape: str, rule: Any) -> npt.NDArray[np.float64]:
        """Particles of a reference facet that is one cell, (particles, dim − 1).

        Args:
            shape: of the facets
            rule: what ``rule`` has returned
        """
        if shape != "quadrilateral":
            return rule.points
        return np.concatenate([rule.points, 1.0 - rule.points])


def basis_values(psi: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A facet's basis at points of the reference facet, (points, nodes)."""
    powers, coefficients, _ = psi
    return np.prod(points[:, None, :] ** powers[None], axis=2) @ coefficients.T


def check_determined(integration: Any, points: npt.NDArray[np.float64], psi: Any) -> None:
    """Refuse a rule whose particles do not determine the pressure on a facet.

    With Ψ_pa = ψ_a(ξ_p), (F2) has the rows Ψᵀ(…): if the rank of Ψ is less than the number of ψ_a,
    some pressure is zero at all particles, its rows are null and the system is singular.

    Args:
        points: particles of a facet

    Raises:
        InputError: the rank is too small
    """
    nodes = psi[2]
    rank = np.linalg.matrix_rank(basis_values(psi, points), tol=1e-10)
    if rank < len(nodes):
        raise InputError(
            f"{integration}: {len(points)} particles a facet determine {rank} of the {len(nodes)}"
            " pressure values of a facet; the rows of the others would be null and the system"
            " singular. Use a richer rule, or a pressure space of lower degree."
        )
