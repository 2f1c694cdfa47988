# SPDX-License-Identifier: MIT
"""One pair inside a problem: brings the targets' facets here, moves both surfaces, assembles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from . import _cpp, compat
from .errors import ContactError, together
from .held import agreed, excluded, multiplier_dofs
from .layout import Layout
from .pair import ContactPair
from .rules import SeekDirection
from .surface import Surface


class NodeValues:
    """Values of a Function at nodes that any rank may own, fetched from their owners.

    Args:
        u: vector-valued Function
        nodes: global block dofs, (n,)
    """

    def __init__(self, u: Any, nodes: npt.NDArray[np.int64]):
        block = u.function_space.dofmap.index_map_bs
        indices = (nodes[:, None] * block + np.arange(block)).ravel()
        self._vector = compat.petsc_vec(u)
        self._values = PETSc.Vec().createSeq(len(indices))
        wanted = PETSc.IS().createGeneral(indices.astype(PETSc.IntType), PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(self._vector, wanted, self._values, None)

    def __call__(self, vector: Any = None) -> npt.NDArray[np.float64]:
        """The present values, flat, (n × block size,). Collective."""
        source = self._vector if vector is None else vector
        self._scatter.scatter(source, self._values)
        return self._values.array_r.copy()


def _cpp_surface(surface: Surface) -> Any:
    """The C++ surface of this rank's own facets."""
    r = surface.reference
    position, displacement = (
        _cpp.TraceBasis(surface.dim - 1, r[name]["powers"], r[name]["coefficients"])
        for name in ("position", "displacement")
    )
    return _cpp.Surface(
        surface.dim,
        getattr(_cpp.Shape, surface.shape),
        position,
        displacement,
        r["interpolation"],
        r["hull"],
        r["area"],
        surface.id,
        surface.vertices,
        surface.nodes,
        surface.X,
        surface.sigma,
    )


class PairAssembly:
    """Surfaces, exchange and assembler of a pair in the numbering of a system.

    The construction is collective.

    Args:
        pair: the user's pair
        layout: numbering of the system
        slave, master, multiplier: blocks of the two displacements and of λ in the layout
    """

    def __init__(
        self, pair: ContactPair, layout: Layout, slave: int, master: int, multiplier: int
    ):
        self.pair, self._layout = pair, layout
        self._comm, self._shape = pair.comm, getattr(_cpp.Shape, pair.slave.shape)
        self._slave_block, self._master_block = slave, master
        self.multiplier_block = multiplier
        self._changed_since = np.inf  # how far nodes moved since the last exchange
        self._held_master = layout.held_vector(master)

        own = _cpp_surface(pair.slave)
        self._slave_values = NodeValues(pair.slave.u, own.node_table)
        held = self._slave_values(layout.held_vector(slave))
        slave_dofs = layout.node_dofs(slave, own.node_table, held)

        master_own = _cpp_surface(pair.master)
        self._num_own = len(master_own)
        self._ringed = _cpp.with_ring(self._comm.py2f(), master_own)
        self._ringed_values = NodeValues(pair.master.u, self._ringed.node_table)

        self._radius = self._search_radius(own, master_own)
        sizes = np.concatenate([own.diameters(), master_own.diameters(), [0.0]])
        largest = self._comm.allreduce(float(sizes.max()), op=MPI.MAX)
        # exchanged facets stay sufficient while surfaces move by less than half the margin
        self._margin = max(largest, 0.1 * self._radius)

        with together(self._comm, "contact set-up"):
            self.assembler = self._make(own, slave_dofs)
        self._own = own
        self._excluded = excluded(pair)
        self.held = self._excluded.copy()

    def _search_radius(self, slave: Any, master: Any) -> float:
        """d_max: the user's, or half the diagonal of the smaller surface's bounding box."""
        if self.pair.target.radius is not None:
            return float(self.pair.target.radius)
        diagonals = []
        for surface in (slave, master):
            x = surface.X.reshape(-1, self.pair.slave.dim)
            lower, upper = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
            self._comm.Allreduce(MPI.IN_PLACE, lower, op=MPI.MIN)
            self._comm.Allreduce(MPI.IN_PLACE, upper, op=MPI.MAX)
            diagonals.append(np.linalg.norm(upper - lower))
        return 0.5 * float(min(diagonals))

    def _make(self, own: Any, slave_dofs: npt.NDArray[Any]) -> Any:
        pair = self.pair
        weight = pair.integration.weights(
            own, pair.slave.shape, pair._rule, pair._psi, pair.axisymmetric
        )
        powers, coefficients, points = pair._psi
        directed = isinstance(pair.target, SeekDirection)
        kind = _cpp.Assembler2 if pair.slave.dim == 2 else _cpp.Assembler3
        return kind(
            own,
            pair._rule,
            weight,
            _cpp.TraceBasis(points.shape[1], powers, coefficients),
            points,
            getattr(_cpp.TargetRule, pair.target.kind),
            getattr(_cpp.NormalRule, pair.normals),
            pair.target.unit if directed else np.zeros(pair.slave.dim),
            self._radius,
            pair.target.end_tolerance,
            np.deg2rad(pair.crease),
            pair.augmented,
            slave_dofs,
            multiplier_dofs(pair),
            self._layout.local_dofs(self.multiplier_block),
        )

    # -- at the start of a step -----------------------------------------------------------------

    def hold(self) -> None:
        """Hold the multipliers without a free gap at zero, and those the user excludes.

        Needs the surfaces in place, thus one call of ``update`` before. Collective.
        """
        with together(self._comm, "contact set-up"):
            fixed = self.assembler.fixed_multipliers()
        self.held = self._excluded | agreed(self.pair, fixed, any_facet=False)
        self.pair._multiplier.x.array[self.held] = 0.0
        dofs = self._layout.local_dofs(self.multiplier_block)
        self.assembler.set_multiplier_dofs(np.where(self.held, -1, dofs))
        self.assembler.begin_step()

    def held_rows(self) -> npt.NDArray[Any]:
        """System dofs of the held multipliers that this rank owns."""
        size = self._layout.slice(self.multiplier_block)
        dofs = self._layout.local_dofs(self.multiplier_block)
        return dofs[: size.stop - size.start][self.held[: size.stop - size.start]]

    # -- every iteration ------------------------------------------------------------------------

    def update(self, close: float = -1.0) -> int:
        """Move the surfaces to the present displacements, search, decide statuses. Collective.

        Args:
            close: see Assembler.update (initial contact), negative: none

        Returns:
            number of particles over all ranks whose status changed

        Raises:
            ContactError: on all ranks, if a displacement is not finite
        """
        slave, ringed = self._slave_values(), self._ringed_values()
        with together(self._comm, "contact search"):
            if not (np.isfinite(slave).all() and np.isfinite(ringed).all()):
                raise ContactError(
                    "the displacement of a contact surface is not finite (nan or inf); give u and"
                    " the Dirichlet conditions finite values before solve()"
                )
        self._exchange(slave, ringed)
        master = self._master_values()
        changes = 0
        with together(self._comm, "contact search"):
            changes = self.assembler.update(
                slave, master, self.pair._multiplier.x.array, float(close)
            )
        return self._comm.allreduce(changes)

    def _exchange(self, slave: npt.NDArray[Any], ringed: npt.NDArray[Any]) -> None:
        """Fetch the master's facets near this rank's slave facets, if anything has moved far."""
        if np.isfinite(self._changed_since):
            moved = [np.abs(slave - self._at[0]), np.abs(ringed - self._at[1]), [0.0]]
            self._changed_since = max(float(np.max(part, initial=0.0)) for part in moved)
        farthest = self._comm.allreduce(self._changed_since, op=MPI.MAX)
        if farthest * np.sqrt(self.pair.slave.dim) <= 0.5 * self._margin:
            return
        with together(self._comm, "contact exchange"):
            self._own.displace(slave)
            self._ringed.displace(ringed)
        master = _cpp.with_targets(
            self._comm.py2f(),
            self._ringed,
            self._num_own,
            self._own.boxes(),
            self._radius + self._margin,
        )
        self._master_values = NodeValues(self.pair.master.u, master.node_table)
        held = self._master_values(self._held_master)
        dofs = self._layout.node_dofs(self._master_block, master.node_table, held)
        with together(self._comm, "contact exchange"):
            self.assembler.set_master(master, dofs)
        self._at, self._changed_since = (slave, ringed), 0.0

    # -- scale ----------------------------------------------------------------------------------

    def stiffness(self, diagonal: npt.NDArray[np.float64]) -> float:
        """Stiffness of the slave surface per area [pressure/length], at least a tiny one.

        A node's diagonal (about E h^{d−2}) over its tributary area (about h^{d−1}) is of the order
        of E/h; here summed over facets, thus the same on every partition. Collective.

        Args:
            diagonal: of the bulk's Jacobian, this rank's owned dofs of the system
        """
        vector = compat.petsc_vec(self.pair.slave.u).duplicate()
        vector.array[:] = diagonal[self._layout.slice(self._slave_block)]
        dim, own = self.pair.slave.dim, self._own
        nodes = np.searchsorted(own.node_table, own.nodes)
        mean = self._slave_values(vector).reshape(-1, dim).mean(axis=1)[nodes].mean(axis=1)
        area = _cpp.particle_weights(own, _cpp.simpson(self._shape, 0), False).sum()
        sums = self._comm.allreduce(np.array([np.abs(mean).sum(), area]))
        return float(max(sums[0] / sums[1], np.finfo(float).tiny ** 0.25))
