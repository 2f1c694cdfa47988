# SPDX-License-Identifier: MIT
"""A contact pair: what the user describes, and its results."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .checks import agreed, number, switch
from .errors import ContactError, InputError, together
from .particles import Particles, tangential
from .rules import (
    Gauss,
    Lobatto,
    Nodes,
    Proximity,
    SeekDirection,
    Segments,
    Simpson,
    SlaveNormal,
    Smooth,
    basis_values,
    check_determined,
)
from .stretch import area_stretch
from .surface import Surface, basis_polynomials, check_available, check_tags
from .tools import RigidTool


class ContactPair:
    """Two surfaces that may touch, with Coulomb friction.

    The construction is collective. Multipliers live on the slave's facet mesh. A pressure space that
    is known to be unstable with the displacement and the rule gives a warning (docs/infsup.md).

    Args:
        slave: carries the particles and the multipliers
        master: carries the targets: a Surface, a rigid tool (RigidPlane, RigidSphere, RigidMesh, …),
            or a list of tools, each with its own motion; the nearest one counts
        friction: Coulomb's coefficient μ, ≥ 0. Friction acts on particles that touched at the last
            accepted step, or were then within initial_contact: one that closes in a step has no
            slip before it does, so that bodies that meet should do so in a few load steps
        target: Smooth(), Proximity(), SeekDirection(e) or SlaveNormal()
        normals: "interpolated" (F8), "facet" (F7) or "direction" (n = ±e, with SeekDirection and
            SlaveNormal); None: "interpolated" with Smooth, "direction" with SlaveNormal, else
            "facet"
        crease: angle in degrees; where facets of a surface meet at a sharper edge in the reference
            configuration, their normals are not averaged
        integration: Simpson(n), Segments(degree), Gauss(degree), Lobatto(points) or Nodes()
        pressure_space: family and degree of λ on the slave's facets: "Lagrange" 1 or 2, "DG" 0 to 2
        friction_space: family and degree of the friction semi-multiplier Λ; None: those of the
            pressure
        exclude: (facet_tags, tags): multipliers are held at zero on nodes of these facets of the
            slave's mesh. Nodes where Dirichlet conditions already fix the gap are found
            automatically
        axisymmetric: weigh the particles with 2πR, R = X_1 (2D only)
        rho_n, rho_t: augmentation parameters [pressure/length, 1/length] in place of the automatic
            ones
        slip: measure of the slip in a step: "convected" with the master, which a rigid motion does
            not change, or the paper's "increment" of the displacements
        initial_contact: open particles nearer to the master than this fraction of the facet's
            diameter start a step closed
        augmented: take χ g_n for χ λ in (F1)

    Raises:
        InputError: on all ranks, for arguments of another kind, surfaces of different dimension or
            with common facets, a negative friction, rho_n, rho_t or initial_contact, a direction
            that does not fit the space, a pressure or friction space that facets cannot carry

    Attributes:
        slave, master: the surfaces
        tools: the master's rigid tools; none for a Surface
        pressure: nominal contact pressure, ≥ 0 in compression; Function on slave.mesh, of the last
            accepted solution
        friction: nominal friction traction on the slave, a vector [pressure]: the projection of the
            particles' tractions, likewise. None without friction
        coefficient: μ
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface | RigidTool | list[RigidTool],
        *,
        friction: float = 0.0,
        target: Smooth | Proximity | SeekDirection | SlaveNormal = Smooth(),
        normals: str | None = None,
        integration: Simpson | Segments | Gauss | Lobatto | Nodes = Simpson(1),
        pressure_space: tuple[str, int] = ("Lagrange", 1),
        friction_space: tuple[str, int] | None = None,
        exclude: tuple[Any, Any] | None = None,
        axisymmetric: bool = False,
        crease: float = 60.0,
        rho_n: float | None = None,
        rho_t: float | None = None,
        slip: str = "convected",
        initial_contact: float = 1e-3,
        augmented: bool = False,
    ):
        if not isinstance(slave, Surface):
            raise InputError(f"ContactPair: slave is a {type(slave).__name__}; give a Surface.")
        self.slave, self.master, self.comm = slave, master, slave.comm
        self.target, self.integration = target, integration
        if normals is None:
            normals = {Smooth: "interpolated", SlaveNormal: "direction"}.get(type(target), "facet")
        self.normals, self.crease = normals, crease
        self.pressure_space, self.axisymmetric = pressure_space, axisymmetric
        self.coefficient, self.slip = friction, slip
        self.friction_space = pressure_space if friction_space is None else friction_space
        self.rho_n, self.rho_t, self.initial_contact = rho_n, rho_t, initial_contact
        self.augmented = augmented
        with together(self.comm, "ContactPair"):
            self.tools = [] if isinstance(master, Surface) else _tools(master, slave.dim)
            self._check()
        self._agree()
        with together(self.comm, "ContactPair"):
            self._psi = self._basis("pressure_space")
            self._phi = self._basis("friction_space")
            if isinstance(integration, Segments):
                integration = self.integration = self._fitted(integration)
            self._rule = integration.rule(slave.shape, self._psi)
            points = self._rule.points
            if integration.refined:
                points = integration.points(slave.shape, self._rule)
            check_determined(integration, points, self._psi)
            if self.frictional:
                check_determined(integration, points, self._phi)
        self._warn()
        self.exclude = None if exclude is None else self._check_exclude(exclude)
        V = compat.function_space(slave.mesh, tuple(pressure_space))
        self.pressure = fem.Function(V, name="pressure")
        self._multiplier = fem.Function(V, name="multiplier")
        self.friction = self._semi_multiplier = None
        if self.frictional:
            space, mesh = tuple(self.friction_space), slave.mesh
            self._semi_multiplier = fem.Function(
                compat.function_space(mesh, space, None if slave.dim == 2 else 2),
                name="semi-multiplier",
            )
            self.friction = fem.Function(
                compat.function_space(mesh, space, slave.dim), name="friction"
            )
        self._accepted: dict[str, Any] | None = None  # tables of the last accepted solution
        self._true: fem.Function | None = None

    @property
    def frictional(self) -> bool:
        """Whether there are friction unknowns."""
        return self.coefficient > 0

    def _agree(self) -> None:
        """Refuse what is not the same on all ranks. Collective."""
        names = [name for name in vars(self) if name not in ("slave", "master", "comm", "tools")]
        tools = {"master": self.tools or "a Surface"}
        given = {name: getattr(self, name) for name in names} | tools
        given["friction"] = given.pop("coefficient")
        agreed(self.comm, "ContactPair", **given)

    def _check(self) -> None:
        slave, master = self.slave, self.master
        rigid = bool(self.tools)
        if not isinstance(self.target, (Smooth, Proximity, SeekDirection, SlaveNormal)):
            raise InputError(
                f"ContactPair: target is {self.target!r}; give Smooth(), Proximity(),"
                " SeekDirection(e) or SlaveNormal()."
            )
        if not isinstance(self.integration, (Simpson, Segments, Gauss, Lobatto, Nodes)):
            raise InputError(
                f"ContactPair: integration is {self.integration!r}; give Simpson(n),"
                " Segments(degree), Gauss(degree), Lobatto(points) or Nodes()."
            )
        if not rigid and slave.dim != master.dim:
            raise InputError(
                f"ContactPair: the slave is in {slave.dim} and the master in {master.dim}"
                " dimensions; give surfaces of the same space."
            )
        if not rigid and slave.comm.size != master.comm.size:
            raise InputError(
                "ContactPair: slave and master live on communicators of different size; make both"
                " meshes on the same one."
            )
        fits = {
            "smooth": ("interpolated",),
            "proximity": ("facet", "interpolated"),
            "direction": ("facet", "interpolated", "direction"),
        }[self.target.kind]
        if self.normals not in fits:
            raise InputError(
                f"ContactPair: normals is {self.normals!r} with {type(self.target).__name__}; give"
                ' "interpolated", which goes with every target, "facet", with all but Smooth, or'
                ' "direction", with SeekDirection and SlaveNormal; None picks what fits.'
            )
        who = "ContactPair"
        angle = "an angle in degrees, above 0 and up to 180"
        self.crease = number(who, "crease", self.crease, angle, lambda a: 0 < a <= 180)
        if rigid and isinstance(self.target, (SeekDirection, SlaveNormal)):
            raise InputError(
                f"ContactPair: target is {self.target!r}, but the target on a rigid tool is the"
                " closest point of its surface; leave target out."
            )
        direction = getattr(self.target, "direction", None)
        if direction is not None and not callable(direction) and len(direction) != slave.dim:
            raise InputError(
                f"ContactPair: the seek direction {direction!r} has {len(direction)} components in"
                f" {slave.dim} dimensions; give {slave.dim}."
            )
        for name, value, unit in (
            ("rho_n", self.rho_n, "of pressure per length"),
            ("rho_t", self.rho_t, "per length"),
        ):
            if value is not None:
                allowed = f"a positive number {unit}, or None for the automatic one"
                number(who, name, value, allowed, lambda rho: 0 < rho < np.inf)
        coefficient = "Coulomb's coefficient, a finite number ≥ 0"
        number(who, "friction", self.coefficient, coefficient, lambda mu: 0 <= mu < np.inf)
        if self.slip not in ("convected", "increment"):
            raise InputError(
                f'ContactPair: slip is {self.slip!r}; give "convected" or "increment".'
            )
        self.initial_contact = number(
            who,
            "initial_contact",
            self.initial_contact,
            "a fraction of the facet's size, 0 or more and finite",
            lambda part: 0 <= part < np.inf,
        )
        self.augmented = switch(who, "augmented", self.augmented)
        self.axisymmetric = switch(who, "axisymmetric", self.axisymmetric)
        if self.axisymmetric:
            self._check_axis()
        if not rigid and slave.u.function_space.mesh is master.u.function_space.mesh:
            common = np.intersect1d(slave.id, master.id)
            if len(common) > 0:
                raise InputError(
                    f"ContactPair: slave (tags {slave.tags}) and master (tags {master.tags}) share"
                    f" {len(common)} facets on rank {self.comm.rank}; a facet can be on one side"
                    " only. Give the two surfaces different tags."
                )

    def _check_axis(self) -> None:
        """Radii are not negative."""
        if self.slave.dim != 2:
            raise InputError(
                "ContactPair: axisymmetric pairs are two-dimensional; give a mesh of a section (r, z)."
            )
        X = self.slave.X
        if X[..., 0].min(initial=0.0) < -1e-10 * np.abs(X).max(initial=0.0):
            raise InputError(
                f"ContactPair: axisymmetric is True, but the slave reaches to r = {X[..., 0].min():.4g};"
                " give a mesh on the side r ≥ 0 of the axis alone."
            )

    def _check_exclude(self, exclude: Any) -> tuple[Any, list[int]]:
        mesh = self.slave.u.function_space.mesh
        with together(self.comm, "ContactPair"):
            try:
                facet_tags, tags = exclude
            except (TypeError, ValueError):
                raise InputError(
                    f"ContactPair: exclude is {exclude!r}; give a pair (facet_tags, tags)."
                ) from None
            tags = check_tags(facet_tags, tags, mesh)
        check_available(self.comm, facet_tags, tags)
        return facet_tags, tags

    def _basis(self, name: str) -> Any:
        space = getattr(self, name)
        known = isinstance(space, (tuple, list)) and len(space) == 2
        if known and isinstance(space[0], str) and isinstance(space[1], (int, np.integer)):
            try:
                if 0 <= space[1] <= 2:
                    return basis_polynomials(self.slave.shape, int(space[1]), space[0])
            except InputError:
                pass
        raise InputError(
            f"ContactPair: {name} is {space!r}; give a family and a degree that facets carry:"
            ' ("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1) or ("DG", 2).'
        )

    def _warn(self) -> None:
        """Tell the user, on rank 0, of a choice that is known to be unstable."""
        from .infsup import doubt  # which needs this module

        degree = self.slave.reference["displacement"]["degree"]
        text = doubt(degree, self.pressure_space, self.slave.shape, self.integration)
        if text is not None and self.comm.rank == 0:
            warnings.warn(
                f"ContactPair: {text}. dc.infsup.constant(pair) measures it on your meshes.",
                stacklevel=3,
            )

    def _fitted(self, integration: Segments) -> Segments:
        surfaces = [s for s in (self.slave, self.master) if isinstance(s, Surface)]
        spaces = [self.pressure_space] + [self.friction_space] * self.frictional
        return integration.fitted(
            [s.shape for s in surfaces],
            max(s.reference["displacement"]["degree"] for s in surfaces),
            max(int(space[1]) for space in spaces),
            self.axisymmetric,
        )

    # -- results of the last accepted solution --------------------------------------------------

    def _accept(self, contact: Any) -> None:
        """Keep the present solution. A later solve that fails moves the assembler's surfaces, so
        that results must not be asked from it."""
        assembler = contact.assembler
        x = assembler.slave.x[: assembler.own]
        self._keep(contact, assembler.particles(), x, assembler.dissipated())

    def _keep(self, contact: Any, table: dict[str, Any], slave: Any, dissipated: float) -> None:
        """Keep a solution: columns of the particles, positions of the slave's position nodes."""
        self.pressure.x.array[:] = 0.0 - self._multiplier.x.array
        table["tool"] = contact.tool_of_piece[table["piece"]]  # the last one is −1, none
        self._accepted = {**table, "slave": slave}
        self._dissipated = dissipated
        if self.frictional:
            table = self._accepted
            contact.friction_projection(table, tangential(table), self.friction)

    def _solved(self) -> dict[str, Any]:
        """Columns of the particles; "slave": current positions of the slave's position nodes."""
        if self._accepted is None:
            raise ContactError(
                "This pair has no results yet: put it in a ContactProblem and solve it first."
            )
        return self._accepted

    @property
    def particles(self) -> Particles:
        """State of this rank's particles, one row each."""
        table = {k: v.copy() for k, v in self._solved().items()}
        return Particles.of(self.slave, table, self.frictional)

    def resultant(self) -> npt.NDArray[np.float64]:
        """Total contact force on the slave, (dim,) [force]: ∫ t dΓ of (F1). Collective."""
        table = self._solved()
        return self.comm.allreduce(table["weight"] @ table["traction"])

    @property
    def true_pressure(self) -> fem.Function:
        """Contact pressure on the current area, ≥ 0 in compression [force/current area].

        A Function on slave.mesh, which jumps between facets that are stretched differently: at each
        node of a facet the nominal pressure over the stretch of the area there (Nanson's formula).
        Collective.

        Raises:
            ContactError: the pair has not been solved
        """
        self._solved()
        degree = int(self.pressure_space[1])
        if self._true is None:
            V = compat.function_space(self.slave.mesh, ("DG", degree))
            self._true = fem.Function(V, name="true pressure")
        p, out = self.pressure.function_space, self._true.function_space
        points = basis_polynomials(self.slave.shape, degree, "DG")[2]
        stretch = area_stretch(self, points)
        cells = compat.dof_list(p)[: len(stretch)]
        nominal = self.pressure.x.array[cells] @ basis_values(self._psi, points).T
        self._true.x.array[compat.dof_list(out)[: len(stretch)]] = nominal / stretch
        self._true.x.scatter_forward()
        return self._true

    def friction_resultant(self) -> npt.NDArray[np.float64]:
        """Friction's part of the resultant, (dim,) [force]. Collective."""
        table = self._solved()
        return self.comm.allreduce(table["weight"] @ tangential(table))

    def dissipated_energy(self) -> float:
        """Energy that friction has dissipated in all accepted steps [energy]. Collective."""
        self._solved()
        return float(self.comm.allreduce(self._dissipated))

    def contact_area(self) -> float:
        """Reference area of the closed particles [area; length in 2D]. Collective."""
        table = self._solved()
        return float(self.comm.allreduce(table["weight"][table["closed"]].sum()))


def _tools(master: Any, dim: int) -> list[RigidTool]:
    """The rigid tools that a master stands for."""
    tools = [master] if isinstance(master, RigidTool) else master
    if (
        not isinstance(tools, (list, tuple))
        or not tools
        or not all(isinstance(t, RigidTool) for t in tools)
    ):
        raise InputError(
            f"ContactPair: master is a {type(master).__name__}; give a Surface, a rigid tool, or a"
            " list of rigid tools."
        )
    for tool in tools:
        if tool.dim != dim:
            raise InputError(
                f"ContactPair: the slave is in {dim} and a {type(tool).__name__} in {tool.dim}"
                " dimensions; give a tool of the same space."
            )
    if len(set(map(id, tools))) < len(tools):
        raise InputError("ContactPair: a tool is given twice; give each tool once.")
    return list(tools)
