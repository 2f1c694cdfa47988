# SPDX-License-Identifier: MIT
"""Rigid tools: masters whose surface is given, moved by a prescribed motion or driven by a force."""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from .checks import number, numbers, switch
from .errors import InputError


class RigidTool:
    """What all rigid tools have: a place, the loads on them, and the forces of contact.

    A tool is prescribed (``move``) unless a force drives it (``push``). Give it, or a list of tools,
    as the master of a ContactPair; one tool may be the master of several pairs.

    Args:
        dim: of the space, 2 or 3

    Attributes:
        dim: 2 or 3
        rotation, translation: R, (dim, dim), and c, (dim,) [length], of the present place
            y = R Y + c of material points Y
        driven: whether a force drives the tool, or has driven it
        directions: orthonormal directions in which it moves freely, (m, dim)
        load: the force on it, (dim,) [force]
    """

    def __init__(self, dim: int):
        self.dim = dim
        self.rotation, self.translation = np.eye(dim), np.zeros(dim)
        self.driven = False
        self.directions, self.load = np.zeros((0, dim)), np.zeros(dim)
        self._pairs: list[Any] = []  # of the last problem, each with the tool's number in it

    # -- motion and loads -----------------------------------------------------------------------

    def move(self, translation: Sequence[float] | None = None, rotation: Any = None) -> None:
        """Place the tool: y = R Y + c for its material points Y of the reference position.

        In directions in which a force drives it the tool stays where it is.

        Args:
            translation: c, (dim,) [length]; zero by default
            rotation: R about the origin: an angle in radians (2D) or a matrix (dim, dim); none by
                default

        Raises:
            InputError: a vector of another size, or a matrix that is not a rotation
        """
        dim = self.dim
        c = np.zeros(dim) if translation is None else numbers(translation)
        if c.shape != (dim,) or not np.all(np.isfinite(c)):
            raise InputError(f"move: translation is {translation!r}; give {dim} finite numbers.")
        if rotation is None:
            R = np.eye(dim)
        elif dim == 2 and np.ndim(rotation) == 0:
            cos, sin = np.cos(numbers(rotation)), np.sin(numbers(rotation))
            R = np.array([[cos, -sin], [sin, cos]])
        else:
            R = numbers(rotation)
        proper = R.shape == (dim, dim) and np.allclose(R @ R.T, np.eye(dim), atol=1e-9)
        if not proper or np.linalg.det(R) < 0:
            raise InputError(
                f"move: rotation is {rotation!r}; give a rotation matrix of {dim} × {dim}"
                + (" or an angle in radians." if dim == 2 else ".")
            )
        E = self.directions
        self.rotation, self.translation = R, c + E.T @ (E @ (self.translation - c))

    def push(self, force: Sequence[float], along: Any = None) -> None:
        """Drive the tool by a force: how far it goes is an unknown of the problem.

        Call it once before the ContactProblem is made, and again for each other load. A tool that
        touches nothing is first brought to the slave's surface, along the force.

        Args:
            force: on the tool, (dim,) [force]; all of it in axisymmetric problems
            along: direction, or directions (m, dim), in which the tool is free to move; by default
                that of the force, or for a force of zero the former ones. In the others it goes
                where ``move`` puts it

        Raises:
            InputError: vectors of another size or not finite, no direction, dependent directions,
                or a force outside of them
        """
        f = numbers(force)
        if f.shape != (self.dim,) or not np.all(np.isfinite(f)):
            raise InputError(f"push: force is {force!r}; give {self.dim} finite numbers.")
        if along is None:
            along = f if np.any(f) or not len(self.directions) else self.directions
        E = np.atleast_2d(numbers(along))
        if E.shape[1:] != (self.dim,) or not np.all(np.isfinite(E)) or len(E) > self.dim:
            raise InputError(
                f"push: along is {along!r}; give one direction, or up to {self.dim}, of"
                f" {self.dim} finite numbers."
            )
        lengths = np.linalg.norm(E, axis=1)
        if not np.all(lengths > 0) or np.linalg.matrix_rank(E / lengths[:, None]) < len(E):
            raise InputError(
                f"push: force is {force!r} and along is {along!r}; give directions that are not"
                " zero and not dependent (for a force of zero, say along which it acts)."
            )
        E = np.linalg.qr((E / lengths[:, None]).T)[0].T
        if np.linalg.norm(f - E.T @ (E @ f)) > 1e-9 * np.linalg.norm(f):
            raise InputError(
                f"push: force is {force!r}, but the tool is free along {along!r} only; give a force"
                " in these directions."
            )
        self.load, self.directions, self.driven = f, E, True

    def hold(self) -> None:
        """Drive it no more: it stays where it is until ``move`` puts it elsewhere."""
        self.load, self.directions = np.zeros(self.dim), np.zeros((0, self.dim))

    def motion(self) -> npt.NDArray[np.float64]:
        """The present motion (R, c), (dim, dim + 1)."""
        return np.column_stack([self.rotation, self.translation])

    # -- results of the last accepted solution --------------------------------------------------

    def force(self) -> npt.NDArray[np.float64]:
        """Force of contact on the tool, friction included, (dim,) [force]. Collective.

        Raises:
            InputError: the tool is in no problem
            ContactError: the problem has not been solved yet
        """
        return self._resultant()[: self.dim]

    def moment(self, about: Sequence[float] | None = None) -> npt.NDArray[np.float64]:
        """Moment of the contact forces on the tool [force × length]. Collective.

        Args:
            about: a point in space, (dim,); by default c, where the origin of its frame is now

        Returns:
            (3,) in 3D, (1,) in 2D

        Raises:
            InputError: a point of another size, or the tool is in no problem
            ContactError: the problem has not been solved yet
        """
        point = self.translation if about is None else numbers(about)
        if np.shape(point) != (self.dim,) or not np.all(np.isfinite(point)):
            raise InputError(
                f"moment: about is {about!r}; give a point of {self.dim} numbers, finite ones."
            )
        total = self._resultant()
        return total[self.dim :] - _cross(point[None], total[None, : self.dim])[0]

    def _resultant(self) -> npt.NDArray[np.float64]:
        """Force, and moment about the origin."""
        if not self._pairs:
            raise InputError(
                "This tool has no forces yet: give it to a ContactPair, the pair to a"
                " ContactProblem, and solve that."
            )
        total = np.zeros(self.dim + (1 if self.dim == 2 else 3))
        for pair, which in self._pairs:
            table = pair._solved()
            on = table["closed"] & (table["tool"] == which)
            forces = -table["weight"][on, None] * table["traction"][on]
            moments = _cross(table["target"][on], forces)
            total += np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])
        return self._pairs[0][0].comm.allreduce(total)

    # -- for the assembler ----------------------------------------------------------------------

    def _given(self) -> dict[str, Any]:
        """What the ranks have to agree on."""
        return {k: v for k, v in vars(self).items() if not k.startswith("_")}

    def _parts(self) -> list[tuple[Any, npt.NDArray[np.float64]]]:
        """Its pieces, each with its place (R, c) in the tool's frame."""
        return [(self, np.eye(self.dim, self.dim + 1))]

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        """Add its surface to a tool of C++; `search`: what a mesh has to know."""
        raise NotImplementedError


def _cross(x: npt.NDArray[Any], f: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """x × f, rows; of one component in 2D."""
    if x.shape[1] == 3:
        return np.cross(x, f)
    return (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])[:, None]


def compose(outer: npt.NDArray[Any], inner: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """The motion (R, c) that does `inner` first."""
    R = outer[:, :-1]
    return np.column_stack([R @ inner[:, :-1], R @ inner[:, -1] + outer[:, -1]])


def _vectors(what: str, given: dict[str, Any], dims: tuple[int, ...]) -> list[Any]:
    """Vectors of one size, finite; those called normal or axis are returned with length 1."""
    out = [numbers(v) for v in given.values()]
    fits = all(v.shape == out[0].shape and v.shape in [(d,) for d in dims] for v in out)
    if not fits or not np.all(np.isfinite(out)):
        sizes = " or ".join(map(str, dims))
        text = " and ".join(f"{name} is {v!r}" for name, v in given.items())
        raise InputError(f"{what}: {text}; give {sizes} finite numbers each.")
    for i, name in enumerate(given):
        if name in ("normal", "axis"):
            if not np.any(out[i]):
                raise InputError(
                    f"{what}: {name} is {given[name]!r}; give a vector that is not 0."
                )
            out[i] = out[i] / np.linalg.norm(out[i])
    return out


def _positive(what: str, **given: Any) -> None:
    for name, value in given.items():
        number(what, name, value, "a positive length", lambda length: 0 < length < np.inf)


class RigidPlane(RigidTool):
    """A plane with rigid material behind it.

    Args:
        point: a point of the plane in its reference position, (dim,) [length]
        normal: away from the tool's material, towards the slave; (dim,), its length does not matter
        extent: distances from `point` between which the plane reaches [length]: a disk, or a ring

    Raises:
        InputError: vectors that are not of 2 or 3 finite numbers, a zero normal, an extent that is
            not 0 ≤ inner < outer
    """

    def __init__(
        self,
        point: Sequence[float],
        normal: Sequence[float],
        extent: tuple[float, float] = (0.0, np.inf),
    ):
        self.point, self.normal = _vectors(
            "RigidPlane", {"point": point, "normal": normal}, (2, 3)
        )
        ends = numbers(extent)
        if ends.shape != (2,) or not 0 <= ends[0] < ends[1]:
            raise InputError(
                f"RigidPlane: extent is {extent!r}; give two distances, 0 ≤ inner < outer."
            )
        super().__init__(len(self.point))
        self.extent = float(ends[0]), float(ends[1])

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        tool.add_plane(self.point, self.normal, *self.extent)


class RigidSphere(RigidTool):
    """A rigid sphere; in 2D a circle: a cylinder in plane strain, in axisymmetry a sphere (or, with
    its center off the axis, a torus).

    Args:
        center: in the reference position, (dim,) [length]
        radius: [length]
        inside: the material is outside of the sphere: a bowl

    Raises:
        InputError: a center that is not of 2 or 3 finite numbers, a radius that is not positive
    """

    def __init__(self, center: Sequence[float], radius: float, inside: bool = False):
        (self.center,) = _vectors("RigidSphere", {"center": center}, (2, 3))
        _positive("RigidSphere", radius=radius)
        super().__init__(len(self.center))
        self.radius, self.inside = float(radius), switch("RigidSphere", "inside", inside)

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        tool.add_sphere(self.center, self.radius, self.inside)


class RigidCylinder(RigidTool):
    """A rigid circular cylinder in 3D, or a part of its shell, without faces at the ends. (In 2D take
    a RigidSphere, or in axisymmetry a RigidPlane.)

    Args:
        point: on the axis, in the reference position, (3,) [length]
        axis: its direction, (3,)
        radius: [length]
        inside: the material is outside: a hole
        length: of the part from `point` on, along the axis [length]; None: without ends

    Raises:
        InputError: vectors that are not of 3 finite numbers, a zero axis, a radius or length that is
            not positive
    """

    def __init__(
        self,
        point: Sequence[float],
        axis: Sequence[float],
        radius: float,
        inside: bool = False,
        length: float | None = None,
    ):
        self.point, self.axis = _vectors("RigidCylinder", {"point": point, "axis": axis}, (3,))
        _positive("RigidCylinder", radius=radius, length=1.0 if length is None else length)
        super().__init__(3)
        self.radius, self.inside = float(radius), switch("RigidCylinder", "inside", inside)
        self.length = np.inf if length is None else float(length)

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        tool.add_cylinder(self.point, self.axis, self.radius, self.inside, self.length)


class RigidTorus(RigidTool):
    """A rigid torus in 3D: a tube around a circle, such as the corner of a die. (In 2D a tube's
    section is a RigidSphere.)

    Args:
        center: of the circle, in the reference position, (3,) [length]
        axis: of the circle, (3,)
        ring: radius of the circle [length]
        radius: of the tube [length]
        inside: the slave is within the tube, the material outside of it

    Raises:
        InputError: vectors that are not of 3 finite numbers, a zero axis, radii that are not positive
    """

    def __init__(
        self,
        center: Sequence[float],
        axis: Sequence[float],
        ring: float,
        radius: float,
        inside: bool = False,
    ):
        self.center, self.axis = _vectors("RigidTorus", {"center": center, "axis": axis}, (3,))
        _positive("RigidTorus", ring=ring, radius=radius)
        super().__init__(3)
        self.ring, self.radius = float(ring), float(radius)
        self.inside = switch("RigidTorus", "inside", inside)

    def _add(self, tool: Any, search: dict[str, Any]) -> None:
        tool.add_torus(self.center, self.axis, self.ring, self.radius, self.inside)


class RigidComposite(RigidTool):
    """Several surfaces of one rigid body, for instance a die of a ring, its corner and its wall.

    The target of a particle is on the nearest one. Where two meet they should be tangent, or leave a
    concave corner: at a sharp convex edge closest points end, so that particles slip off; round it
    with a RigidTorus.

    Args:
        tools: the surfaces, each where it is now; only the composite moves from now on. Tools that
            move independently are given to the ContactPair as a list instead

    Raises:
        InputError: no tools, tools of different dimension, or one that a force drives
    """

    def __init__(self, tools: Sequence[RigidTool]):
        given = isinstance(tools, (list, tuple)) and len(tools) > 0
        if not given or not all(isinstance(t, RigidTool) for t in tools):
            raise InputError(
                f"RigidComposite: tools is {tools!r}; give a list of rigid tools, at least one."
            )
        if len({t.dim for t in tools}) > 1 or any(t.driven for t in tools):
            raise InputError(
                f"RigidComposite: tools of dimension {[t.dim for t in tools]}, of which"
                f" {sum(t.driven for t in tools)} are driven by a force; give tools of one dimension,"
                " and drive the composite rather than one of them."
            )
        super().__init__(tools[0].dim)
        self.tools = list(tools)
        self._inner = [
            (leaf, compose(t.motion(), place)) for t in tools for leaf, place in t._parts()
        ]

    def _parts(self) -> list[tuple[Any, npt.NDArray[np.float64]]]:
        return self._inner
