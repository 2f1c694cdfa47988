# SPDX-License-Identifier: MIT
"""Which master facets a rank holds: those that may be targets of its slave facets, and no others.

A search is decided by the facets within the distance of what it has found. So each slave facet has
a *reach*: all master facets within it are here. Where a particle has found nothing, or something
beyond the reach, the reach grows and facets are fetched, until no facet on another rank could change
the result. The targets are then those of a search of the whole surface, whatever the partition.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from . import _cpp
from .errors import together

_NEAR = 0.25  # first reach beyond the nearest facet, in diameters of the largest facet
_MARGIN = 0.5  # the least, in diameters
_FORMER = 0.02  # a former target is kept where it is farther than the best by less, in diameters
_GROWTH = 4.0  # of a reach within which nothing was found


class Exchange:
    """The master's facets near this rank's slave facets. The construction is collective.

    Args:
        comm: communicator
        slave, num_slaves: C++ surface with its ring, and the number of own facets, which come first
        master, num_masters: the same of the master
        radius: d_max, the largest distance of a target [length]
        end_tolerance: by how many diameters a particle may be beside the surface
        refined: whether the particles are those of the common refinement, which needs all facets
            within a diameter

    Attributes:
        margin: facets within the reach are here while surfaces move by less than half of it
    """

    def __init__(
        self,
        comm: MPI.Comm,
        slave: Any,
        num_slaves: int,
        master: Any,
        num_masters: int,
        radius: float,
        end_tolerance: float,
        refined: bool,
    ):
        self._comm, self._dim = comm, slave.X.shape[2]
        self._slave, self._num_slaves = slave, num_slaves
        self._master, self._num_masters = master, num_masters
        diameters = [slave.diameters()[:num_slaves], master.diameters()[:num_masters]]
        largest = comm.allreduce(max(float(d.max(initial=0)) for d in diameters), op=MPI.MAX)
        self._near, self._slack = _NEAR * largest, _FORMER * largest
        self._least = np.full(num_slaves, self._near)  # reach of each facet
        if refined:
            self._least = np.maximum(self._least, np.sqrt(self._dim) * diameters[0])
        # an end beside the surface is farther than the distance along the normal
        self._radius = radius + end_tolerance * largest
        # a tenth of a rank's part of the surface: the more there is, the less often it is fetched
        self.margin = max(_MARGIN * largest, 0.1 * radius / comm.size ** (1 / (self._dim - 1)))
        self._reach: npt.NDArray[np.float64] | None = None  # of each own slave facet
        self._at: tuple[npt.NDArray[np.float64], ...] | None = None

    @property
    def fetched(self) -> bool:
        """Whether there are facets here."""
        return self._at is not None

    def moved_far(self, slave: npt.NDArray[np.float64], master: npt.NDArray[np.float64]) -> bool:
        """Whether surfaces have moved by more than the margin allows. Collective.

        Args:
            slave, master: displacements of the nodes of the surfaces with rings, flat
        """
        farthest = np.array([np.inf])
        if self._at is not None:
            parts = [np.abs(slave - self._at[0]), np.abs(master - self._at[1])]
            farthest[0] = max(float(np.max(part, initial=0.0)) for part in parts)
        self._comm.Allreduce(MPI.IN_PLACE, farthest, op=MPI.MAX)
        return bool(farthest[0] * np.sqrt(self._dim) > 0.5 * self.margin)

    def fetch(
        self,
        slave: npt.NDArray[np.float64],
        master: npt.NDArray[np.float64],
        decided: npt.NDArray[np.float64],
    ) -> Any:
        """The facets that the particles need where the surfaces are now. Collective.

        Args:
            slave, master: displacements as for ``moved_far``
            decided: how far away the last search of each own slave facet was decided, (facets,)

        Returns:
            the C++ surface
        """
        boxes = self._place(slave, master)
        if self._reach is None:
            self._reach = self._limited(self._least)
        else:  # particles without a target look everywhere
            self._reach = self._limited(np.maximum(decided + self._near, self._least))
        return self._bring(slave, master, boxes)

    def lacking(self, decided: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Own slave facets with particles that are not settled."""
        return decided > self.told()

    def widen(
        self,
        slave: npt.NDArray[np.float64],
        master: npt.NDArray[np.float64],
        decided: npt.NDArray[np.float64],
    ) -> Any:
        """As ``fetch``, with a larger reach where particles are not settled. Collective."""
        assert self._reach is not None
        boxes = self._place(slave, master)
        lacking = self.lacking(decided)
        # what was found is an upper bound of the distance of what is to be found
        wanted = np.where(np.isfinite(decided), decided + self._near, _GROWTH * self._reach)
        seek = np.flatnonzero(lacking & np.isinf(decided))
        beyond = self._nearest(boxes[seek]) + self._near
        away = beyond > self._reach[seek]  # there is nothing within the reach
        wanted[seek[away]] = beyond[away]
        self._reach = self._limited(np.where(lacking, wanted, self._reach))
        return self._bring(slave, master, boxes)

    def told(self) -> npt.NDArray[np.float64]:
        """Distance up to which a search is decided, infinite where it sees all within d_max."""
        assert self._reach is not None
        return np.where(self._reach < self._radius, self._reach - self._slack, np.inf)

    def _place(self, slave: Any, master: Any) -> npt.NDArray[np.float64]:
        """Move both surfaces; boxes of the own slave facets. Collective."""
        with together(self._comm, "contact exchange"):
            self._slave.displace(slave)
            self._master.displace(master)
        return self._slave.boxes()[: self._num_slaves]

    def _limited(self, reach: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.minimum(reach, self._radius)

    def _bring(self, slave: Any, master: Any, boxes: npt.NDArray[np.float64]) -> Any:
        self._at = slave.copy(), master.copy()
        reach = self._reach + self.margin
        comm = self._comm.py2f()
        return _cpp.with_targets(comm, self._master, self._num_masters, boxes, reach)

    def _nearest(self, boxes: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Distance of the nearest master facet from each box, infinite beyond d_max. Collective.

        Ranks are asked that are farther and farther away, by those only that have found nothing.
        """
        distance, bound = np.full(len(boxes), np.inf), self._near
        while True:
            seek = np.flatnonzero(np.isinf(distance))
            within = np.full(len(seek), min(bound, self._radius))
            comm = self._comm.py2f()
            distance[seek] = _cpp.distances(
                comm, self._master, self._num_masters, boxes[seek], within
            )
            left = np.array([np.isinf(distance).any() and bound < self._radius], dtype=np.int64)
            self._comm.Allreduce(MPI.IN_PLACE, left)
            if left[0] == 0:
                return distance
            bound *= _GROWTH
