# SPDX-License-Identifier: MIT
"""The particles of a pair as the user sees them: a table."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt


def tangential(table: dict[str, Any]) -> npt.NDArray[np.float64]:
    """Friction traction of each particle, (n, dim)."""
    t, n = table["traction"], np.nan_to_num(table["normal"])
    return t - n * np.sum(t * n, axis=1, keepdims=True)


@dataclass
class Particles:
    """Particles of a pair, one row each (n rows; vectors have shape (n, dim)).

    Attributes:
        reference, position: where the particle is, undeformed and now [length]
        gap: distance to the master along the normal, ≥ 0 when open, inf without a target [length]
        pressure: nominal contact pressure, ≥ 0 in compression [force/reference area]
        status: "open", "stick" or "slip". Without friction all that touch slip; one that has closed
            in the last step has no slip yet
        slip: tangential slip in the last step, against the master; 0 if open [length]
        target: its target on the master's current surface, nan without one [length]
        normal: normal at the target, pointing away from the slave, nan without a target
        traction: contact traction on the slave, friction included [force/reference area]
        friction: its tangential part
        dissipated: by friction in all steps [energy/reference area]; particles that move on the
            slave (Segments) have what the nearest ones had
        weight: its part of the slave's reference area [area]
        facet, target_facet: numbers of its facet and of its target's (−1: none), which do not
            depend on the partition
        tool: number of the pair's tool that its target is on, −1 without one
    """

    reference: npt.NDArray[np.float64]
    position: npt.NDArray[np.float64]
    gap: npt.NDArray[np.float64]
    pressure: npt.NDArray[np.float64]
    status: npt.NDArray[np.str_]
    target: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    traction: npt.NDArray[np.float64]
    friction: npt.NDArray[np.float64]
    slip: npt.NDArray[np.float64]
    dissipated: npt.NDArray[np.float64]
    weight: npt.NDArray[np.float64]
    facet: npt.NDArray[np.int64]
    target_facet: npt.NDArray[np.int64]
    tool: npt.NDArray[np.int64]
    # kept here, since its communicator is freed with the mesh
    slave: Any = None

    @classmethod
    def of(cls, slave: Any, table: dict[str, Any], frictional: bool) -> Particles:
        """From the assembler's table.

        Args:
            slave: the pair's slave surface
            table: columns of this rank's particles
            frictional: whether what touches can stick
        """
        closed = table["closed"]
        pressure = -np.einsum("pi,pi->p", table["traction"], np.nan_to_num(table["normal"]))
        return cls(
            reference=table["X"],
            position=table["x"],
            gap=table["gap"],
            pressure=pressure + 0.0,
            status=np.select(
                [~closed, table["slips"] | (not frictional)], ["open", "slip"], "stick"
            ),
            target=table["target"],
            normal=table["normal"],
            traction=table["traction"],
            friction=tangential(table),
            slip=table["slip"],
            dissipated=table["dissipated"],
            weight=table["weight"],
            facet=table["facet"],
            target_facet=table["target_facet"],
            tool=table["tool"],
            slave=slave,
        )

    def __len__(self) -> int:
        return len(self.gap)

    def gather(self) -> Particles | None:
        """All ranks' particles on rank 0, sorted by facet; None elsewhere. Collective."""
        names = [f.name for f in fields(self) if f.name != "slave"]
        parts = self.slave.comm.gather({name: getattr(self, name) for name in names}, root=0)
        if parts is None:
            return None
        whole = {name: np.concatenate([part[name] for part in parts]) for name in names}
        order = np.argsort(whole["facet"], kind="stable")
        return Particles(**{name: rows[order] for name, rows in whole.items()}, slave=self.slave)
