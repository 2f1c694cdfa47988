# SPDX-License-Identifier: MIT
"""Rigid tools: masters without unknowns, moved by a prescribed motion."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from . import _cpp
from .errors import InputError


class RigidPlane:
    """A plane with rigid material behind it.

    Args:
        point: a point of the plane in its reference position, (dim,) [length]
        normal: away from the tool's material, towards the slave; (dim,), its length does not matter

    Raises:
        InputError: vectors that are not of 2 or 3 finite numbers, or a zero normal

    Attributes:
        dim: 2 or 3
    """

    def __init__(self, point: Sequence[float], normal: Sequence[float]):
        self.point = np.asarray(point, dtype=float)
        n = np.asarray(normal, dtype=float)
        fits = self.point.shape == n.shape and n.shape in ((2,), (3,))
        if not fits or not np.all(np.isfinite([self.point, n])) or not np.any(n):
            raise InputError(
                f"RigidPlane: point is {point!r} and normal {normal!r}; give two vectors of 2 or 3"
                " finite numbers, the normal not zero."
            )
        self.normal, self.dim = n / np.linalg.norm(n), len(n)
        self.rotation, self.translation = np.eye(self.dim), np.zeros(self.dim)

    def move(self, translation: Sequence[float] | None = None, rotation: Any = None) -> None:
        """Place the tool: y = R Y + c for its material points Y of the reference position.

        Args:
            translation: c, (dim,) [length]; zero by default
            rotation: R about the origin: an angle in radians (2D) or a matrix (dim, dim); none by
                default

        Raises:
            InputError: a vector of another size, or a matrix that is not a rotation
        """
        dim = self.dim
        c = np.zeros(dim) if translation is None else np.asarray(translation, dtype=float)
        if c.shape != (dim,) or not np.all(np.isfinite(c)):
            raise InputError(f"move: translation is {translation!r}; give {dim} finite numbers.")
        if rotation is None:
            R = np.eye(dim)
        elif dim == 2 and np.ndim(rotation) == 0:
            cos, sin = np.cos(rotation), np.sin(rotation)
            R = np.array([[cos, -sin], [sin, cos]])
        else:
            R = np.asarray(rotation, dtype=float)
        proper = R.shape == (dim, dim) and np.allclose(R @ R.T, np.eye(dim), atol=1e-9)
        if not proper or np.linalg.det(R) < 0:
            raise InputError(
                f"move: rotation is {rotation!r}; give a rotation matrix of {dim} × {dim}"
                + (" or an angle in radians." if dim == 2 else ".")
            )
        self.rotation, self.translation = R, c

    def motion(self) -> npt.NDArray[np.float64]:
        """The present motion (R, c), (dim, dim + 1)."""
        return np.column_stack([self.rotation, self.translation])

    def _place(self, assembler: Any, now: Any, old: Any) -> None:
        """Give an assembler the tool, its motion and that at the last accepted step."""
        assembler.set_plane(list(self.point), list(self.normal), now, old)
