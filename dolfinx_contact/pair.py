# SPDX-License-Identifier: MIT
"""A contact pair: what the user describes, and its results."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import _cpp, compat
from .errors import ContactError, InputError, together
from .rules import (
    Gauss,
    Lobatto,
    Nodes,
    Proximity,
    SeekDirection,
    Simpson,
    Smooth,
    check_determined,
)
from .surface import Surface, basis_polynomials, check_available, check_tags


class ContactPair:
    """Two surfaces that may touch, without friction.

    The construction is collective. Multipliers live on the slave's facet mesh.

    Args:
        slave: carries the particles and the multipliers
        master: carries the targets
        target: Smooth(), Proximity() or SeekDirection(e)
        normals: "interpolated" (F8), "facet" (F7) or "direction" (n = ±e, with SeekDirection
            only); None: "interpolated" with Smooth, else "facet"
        crease: angle in degrees; where facets of the master meet at a sharper edge in the reference
            configuration, their normals are not averaged
        integration: Simpson(n), Gauss(degree), Lobatto(points) or Nodes()
        pressure_space: family and degree of λ on the slave's facets: "Lagrange" 1 or 2, "DG" 0 to 2
        exclude: (facet_tags, tags): multipliers are held at zero on nodes of these facets of the
            slave's mesh. Nodes where Dirichlet conditions already fix the gap are found
            automatically
        axisymmetric: weigh the particles with 2πR, R = X_1 (2D only)
        rho_n: augmentation parameter [pressure/length] in place of the automatic one
        initial_contact: open particles nearer to the master than this fraction of the facet's
            diameter start a step closed
        augmented: take χ g_n for χ λ in (F1)

    Raises:
        InputError: on all ranks, for arguments of another kind, surfaces of different dimension or
            with common facets, a negative rho_n or initial_contact, a direction that does not fit
            the space, a pressure space that facets cannot carry

    Attributes:
        slave, master: the surfaces
        pressure: nominal contact pressure, ≥ 0 in compression; Function on slave.mesh, of the last
            accepted solution
    """

    def __init__(
        self,
        slave: Surface,
        master: Surface,
        *,
        target: Smooth | Proximity | SeekDirection = Smooth(),
        normals: str | None = None,
        integration: Simpson | Gauss | Lobatto | Nodes = Simpson(1),
        pressure_space: tuple[str, int] = ("Lagrange", 1),
        exclude: tuple[Any, Any] | None = None,
        axisymmetric: bool = False,
        crease: float = 60.0,
        rho_n: float | None = None,
        initial_contact: float = 1e-3,
        augmented: bool = False,
    ):
        for name, surface in (("slave", slave), ("master", master)):
            if not isinstance(surface, Surface):
                raise InputError(
                    f"ContactPair: {name} is a {type(surface).__name__}; give a Surface."
                )
        self.slave, self.master = slave, master
        self.comm = slave.comm
        self.target, self.integration = target, integration
        if normals is None:
            normals = "interpolated" if isinstance(target, Smooth) else "facet"
        self.normals, self.crease = normals, float(crease)
        self.pressure_space, self.axisymmetric = pressure_space, bool(axisymmetric)
        self.rho_n, self.initial_contact = rho_n, float(initial_contact)
        self.augmented = bool(augmented)
        with together(self.comm, "ContactPair"):
            self._check()
            self._psi = self._pressure_basis()
            self._rule = integration.rule(slave.shape, self._psi)
            check_determined(integration, self._rule, self._psi)
        self.exclude = None if exclude is None else self._check_exclude(exclude)
        V = compat.function_space(slave.mesh, tuple(pressure_space))
        self.pressure = fem.Function(V, name="pressure")
        self._multiplier = fem.Function(V, name="multiplier")
        self._accepted: dict[str, Any] | None = None  # tables of the last accepted solution

    def _check(self) -> None:
        slave, master = self.slave, self.master
        if not isinstance(self.target, (Smooth, Proximity, SeekDirection)):
            raise InputError(
                f"ContactPair: target is {self.target!r}; give Smooth(), Proximity() or"
                " SeekDirection(e)."
            )
        if not isinstance(self.integration, (Simpson, Gauss, Lobatto, Nodes)):
            raise InputError(
                f"ContactPair: integration is {self.integration!r}; give Simpson(n),"
                " Gauss(degree), Lobatto(points) or Nodes()."
            )
        if slave.dim != master.dim:
            raise InputError(
                f"ContactPair: the slave is in {slave.dim} and the master in {master.dim}"
                " dimensions; give surfaces of the same space."
            )
        if slave.comm.size != master.comm.size:
            raise InputError(
                "ContactPair: slave and master live on communicators of different size; make both"
                " meshes on the same one."
            )
        directed = isinstance(self.target, SeekDirection)
        fits = {
            "smooth": ("interpolated",),
            "proximity": ("facet", "interpolated"),
            "direction": ("facet", "interpolated", "direction"),
        }[self.target.kind]
        if self.normals not in fits:
            raise InputError(
                f"ContactPair: normals is {self.normals!r} with {type(self.target).__name__};"
                ' "interpolated" goes with every target, "facet" with Proximity and'
                ' SeekDirection, "direction" with SeekDirection; None picks what fits.'
            )
        if not 0 < self.crease <= 180:
            raise InputError(
                f"ContactPair: crease is {self.crease}; give an angle in degrees, above 0 and up to"
                " 180."
            )
        if directed and len(self.target.unit) != slave.dim:
            raise InputError(
                f"ContactPair: the seek direction {self.target.direction!r} has"
                f" {len(self.target.unit)} components in {slave.dim} dimensions."
            )
        if self.rho_n is not None and not (np.isfinite(self.rho_n) and self.rho_n > 0):
            raise InputError(
                f"ContactPair: rho_n is {self.rho_n}; give a positive number of pressure per"
                " length, or None for the automatic one."
            )
        if not self.initial_contact >= 0:
            raise InputError(
                f"ContactPair: initial_contact is {self.initial_contact}; give a fraction of the"
                " facet's size, 0 or more."
            )
        if self.axisymmetric and slave.dim != 2:
            raise InputError("ContactPair: axisymmetric pairs are two-dimensional (r, z).")
        if slave.u.function_space.mesh is master.u.function_space.mesh:
            common = np.intersect1d(slave.id, master.id)
            if len(common) > 0:
                raise InputError(
                    f"ContactPair: slave (tags {slave.tags}) and master (tags {master.tags}) share"
                    f" {len(common)} facets on rank {self.comm.rank}; a facet can be on one side"
                    " only. Give the two surfaces different tags."
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

    def _pressure_basis(self) -> Any:
        family, degree = self.pressure_space
        try:
            if int(degree) != degree or not 0 <= degree <= 2:
                raise InputError(f"degree {degree} is not one of 0, 1, 2")
            return basis_polynomials(self.slave.shape, degree, family)
        except InputError as error:
            raise InputError(
                f"ContactPair: pressure_space is {self.pressure_space!r} ({error}); the facets"
                ' carry ("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1), ("DG", 2).'
            ) from None

    # -- results of the last accepted solution --------------------------------------------------

    def _accept(self, assembler: Any) -> None:
        """Keep the present solution. A later solve that fails moves the assembler's surfaces, so
        that results must not be asked from it."""
        self.pressure.x.array[:] = 0.0 - self._multiplier.x.array
        self._accepted = {**assembler.particles(), "slave": assembler.slave.x}

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
        return Particles.of(self.comm, {k: v.copy() for k, v in self._solved().items()})

    def resultant(self) -> npt.NDArray[np.float64]:
        """Total contact force on the slave, (dim,) [force]: ∫ t dΓ of (F1). Collective."""
        table = self._solved()
        return self.comm.allreduce(table["weight"] @ table["traction"])

    def contact_area(self) -> float:
        """Reference area of the closed particles [area; length in 2D]. Collective."""
        table = self._solved()
        return float(self.comm.allreduce(table["weight"][table["closed"]].sum()))


@dataclass
class Particles:
    """Particles of a pair, one row each (n rows; vectors have shape (n, dim)).

    Attributes:
        reference, position: where the particle is, undeformed and now [length]
        gap: distance to the master along the normal, ≥ 0 when open, inf without a target [length]
        pressure: nominal contact pressure, ≥ 0 in compression [force/reference area]
        status: "open" or "slip"
        target: its target on the master's current surface, nan without one [length]
        normal: normal at the target, pointing away from the slave, nan without a target
        traction: contact traction on the slave [force/reference area]
        weight: its part of the slave's reference area [area]
        facet, target_facet: numbers of its facet and of its target's (−1: none), which do not
            depend on the partition
    """

    reference: npt.NDArray[np.float64]
    position: npt.NDArray[np.float64]
    gap: npt.NDArray[np.float64]
    pressure: npt.NDArray[np.float64]
    status: npt.NDArray[np.str_]
    target: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    traction: npt.NDArray[np.float64]
    weight: npt.NDArray[np.float64]
    facet: npt.NDArray[np.int64]
    target_facet: npt.NDArray[np.int64]
    comm: Any = None

    @classmethod
    def of(cls, comm: Any, table: dict[str, Any]) -> Particles:
        """From the assembler's table."""
        closed = table["closed"]
        pressure = -np.einsum("pi,pi->p", table["traction"], np.nan_to_num(table["normal"]))
        return cls(
            reference=table["X"],
            position=table["x"],
            gap=table["gap"],
            pressure=pressure + 0.0,
            status=np.where(closed, "slip", "open"),
            target=table["target"],
            normal=table["normal"],
            traction=table["traction"],
            weight=table["weight"],
            facet=table["facet"],
            target_facet=table["target_facet"],
            comm=comm,
        )

    def __len__(self) -> int:
        return len(self.gap)

    def gather(self) -> Particles | None:
        """All ranks' particles on rank 0, sorted by facet; None elsewhere. Collective."""
        names = [f.name for f in fields(self) if f.name != "comm"]
        parts = self.comm.gather({name: getattr(self, name) for name in names}, root=0)
        if parts is None:
            return None
        whole = {name: np.concatenate([part[name] for part in parts]) for name in names}
        order = np.argsort(whole["facet"], kind="stable")
        return Particles(**{name: rows[order] for name, rows in whole.items()}, comm=self.comm)
