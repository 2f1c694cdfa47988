# SPDX-License-Identifier: MIT
"""One pair inside a problem: brings the targets' facets here, moves both surfaces, assembles."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from . import _cpp, compat, events
from .errors import ContactError, together
from .exchange import Exchange
from .friction import FrictionUnknowns
from .held import agreed, excluded, local_dofs
from .layout import Layout
from .pair import ContactPair
from .projection import Projection
from .rules import SeekDirection, SlaveNormal
from .surface import Surface
from .tools import compose


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
        wanted.destroy()

    def free(self) -> None:
        """Free the memory: PETSc 3.18 keeps what Python merely lets go of. Collective."""
        self._scatter.destroy()
        self._values.destroy()

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
        slave, master, multiplier: blocks of the two displacements and of λ in the layout; no master
            for a rigid tool
        friction: block of Λ; None without friction
        tool_dofs: system dofs of the translations of the pair's tools, (tools, dim), −1 if
            prescribed; None: all are

    Attributes:
        touches: with friction, whether there were particles in contact as the step began
        master: C++ surface of the master facets that are here
        tool_of_piece: number of the tool of each piece, and −1 at the end
    """

    def __init__(
        self,
        pair: ContactPair,
        layout: Layout,
        slave: int,
        master: int | None,
        multiplier: int,
        friction: int | None,
        tool_dofs: npt.NDArray[Any] | None = None,
    ):
        self.pair, self._layout = pair, layout
        self._comm, self._shape = pair.comm, getattr(_cpp.Shape, pair.slave.shape)
        self._slave_block, self._master_block = slave, master
        self.multiplier_block, self.friction_block = multiplier, friction

        own = _cpp_surface(pair.slave)
        ringed = _cpp.with_ring(self._comm.py2f(), own)
        self._slave_values = NodeValues(pair.slave.u, ringed.node_table)
        held = self._slave_values(layout.held_vector(slave))
        slave_dofs = layout.node_dofs(slave, ringed.node_table, held)
        self._own, self._ringed_slave = own, ringed

        self._facets: Exchange | None = None
        if not pair.tools:
            master_own = _cpp_surface(pair.master)
            self._ringed = _cpp.with_ring(self._comm.py2f(), master_own)
            self._ringed_values = NodeValues(pair.master.u, self._ringed.node_table)
            self._held_master = layout.held_vector(master)
            self._radius = self._search_radius(own, master_own)
            self._facets = Exchange(
                self._comm,
                ringed,
                len(own),
                self._ringed,
                len(master_own),
                self._radius,
                pair.target.end_tolerance,
                pair.integration.refined,
            )
        else:
            self._radius = self._search_radius(own)

        self._multiplier_nodes = local_dofs(pair, pair._multiplier, len(pair._psi[2]))
        with together(self._comm, "contact set-up"):
            self.assembler = self._make(own, ringed, slave_dofs)
        self._make_tool(tool_dofs)
        self._excluded = self._exclude(pair._multiplier, pair.pressure_space, pair._psi)
        self.held = self._excluded.copy()
        self._friction, self.touches = None, False
        if friction is not None:
            self._friction = FrictionUnknowns(pair)
            self.friction_projection = Projection(pair, pair.friction, pair._phi, own)
            self._excluded_friction = self._exclude(
                pair._semi_multiplier, pair.friction_space, pair._phi
            )
        self._master_values: NodeValues | None = None  # of the facets that are here
        self._old: list[Any] | None = None  # displacements of slave and master, PETSc's vectors
        self.remember()

    def _exclude(self, function: Any, space: Any, basis: Any) -> npt.NDArray[np.bool_]:
        return excluded(self.pair, function, int(space[1]), len(basis[2]))

    def _search_radius(self, *surfaces: Any) -> float:
        """d_max: the user's, or half the diagonal of the smaller surface's bounding box."""
        if self.pair.target.radius is not None:
            return float(self.pair.target.radius)
        diagonals = []
        for surface in surfaces:
            x = surface.X.reshape(-1, self.pair.slave.dim)
            lower, upper = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
            self._comm.Allreduce(MPI.IN_PLACE, lower, op=MPI.MIN)
            self._comm.Allreduce(MPI.IN_PLACE, upper, op=MPI.MAX)
            diagonals.append(np.linalg.norm(upper - lower))
        return 0.5 * float(min(diagonals))

    def _make(self, own: Any, ringed: Any, slave_dofs: npt.NDArray[Any]) -> Any:
        pair = self.pair
        refined, weight = pair.integration.refined, np.zeros(0)
        points = pair._rule.points
        if refined:
            points = pair.slave.reference["position"]["points"]
        else:
            weight = pair.integration.weights(
                own, pair.slave.shape, pair._rule, pair._psi, pair.axisymmetric
            )
        powers, coefficients, nodes = pair._psi
        if pair.frictional and not np.array_equal(nodes, pair._phi[2]):
            nodes = np.concatenate([nodes, pair._phi[2]])
        direction = np.zeros(0)
        if isinstance(pair.target, SeekDirection):
            X = _cpp.reference_positions(own, np.concatenate([points, nodes]))
            direction = pair.target.at(X.reshape(-1, pair.slave.dim))
        turning = isinstance(pair.target, SlaveNormal)
        kind = _cpp.Assembler2 if pair.slave.dim == 2 else _cpp.Assembler3
        return kind(
            ringed,
            len(own),
            pair._rule,
            weight,
            _cpp.TraceBasis(nodes.shape[1], powers, coefficients),
            nodes,
            getattr(_cpp.TargetRule, pair.target.kind),
            getattr(_cpp.NormalRule, pair.normals),
            direction,
            turning,
            turning and not pair.target.interpolated,
            self._radius,
            pair.target.end_tolerance,
            np.deg2rad(pair.crease),
            pair.augmented,
            pair.slip == "convected",
            pair.frictional,
            slave_dofs,
            self._multiplier_nodes,
            self._layout.local_dofs(self.multiplier_block),
            refined,
            pair.axisymmetric,
        )

    def _make_tool(self, dofs: npt.NDArray[Any] | None) -> None:
        """Give the assembler the pieces of the pair's tools."""
        pair, tools = self.pair, self.pair.tools
        self._parts = [
            (i, leaf, place) for i, tool in enumerate(tools) for leaf, place in tool._parts()
        ]
        self.tool_of_piece = np.array([i for i, _, _ in self._parts] + [-1])
        if not tools:
            return
        self._tool = (_cpp.RigidTool2 if pair.slave.dim == 2 else _cpp.RigidTool3)()
        search = {
            "target": getattr(_cpp.TargetRule, pair.target.kind),
            "normals": getattr(_cpp.NormalRule, pair.normals),
            "radius": self._radius,
            "end_tolerance": pair.target.end_tolerance,
            "crease": np.deg2rad(pair.crease),
        }
        with together(self._comm, "contact set-up"):
            for _, leaf, _ in self._parts:
                leaf._add(self._tool, search)
            if dofs is None:
                dofs = np.full((len(tools), pair.slave.dim), -1)
            self.assembler.set_tool(self._tool, dofs[self.tool_of_piece[:-1]])

    def _motions(self) -> list[npt.NDArray[np.float64]]:
        """Present motion of each piece."""
        return [compose(self.pair.tools[i].motion(), place) for i, _, place in self._parts]

    # -- at the start of a step -----------------------------------------------------------------

    def remember(self) -> None:
        """The present displacements are those of the last accepted step: slips start there."""
        surfaces = [self.pair.slave] if self.pair.tools else [self.pair.slave, self.pair.master]
        now = [compat.petsc_vec(surface.u) for surface in surfaces]
        if self._old is None:
            self._old = [vector.duplicate() for vector in now]
        for old, vector in zip(self._old, now):
            vector.copy(old)
        self._old_motions = self._motions()
        if self._friction is not None:
            self._friction.accept()
        self._tell_old()

    def _tell_old(self) -> None:
        """Give the assembler the old displacements. Collective."""
        slave, *master = self._old
        if self.pair.tools:
            self.assembler.remember(self._slave_values(slave), np.zeros(0))
        elif self._facets.fetched:
            self.assembler.remember(self._slave_values(slave), self._master_values(*master))

    @property
    def tangents(self) -> npt.NDArray[np.float64] | None:
        """Tangents of friction in the last accepted step, (local nodes, dim − 1, dim)."""
        return None if self._friction is None else self._friction.accepted

    def resume(self, particles: dict[str, Any], tangents: Any, dissipated: float) -> None:
        """Go on from an accepted step of another run; unknowns and tools are in place. Collective.

        Args:
            particles: columns of Assembler.particles, in the order of the facets
            tangents: of friction, those of this rank's own nodes; None without friction
            dissipated: by friction, this rank's part
        """
        with together(self._comm, "contact set-up"):
            self.assembler.resume(particles, dissipated)
        self.remember()
        if self._friction is not None:
            self._friction.resume(tangents)
        self._ringed_slave.displace(self._slave_values())
        x = self._ringed_slave.x[: len(self._own)]
        self.pair._keep(self, dict(particles), x, dissipated)

    def begin_step(self) -> None:
        """A step begins: forget the status changes of the last one, choose the tangents of friction.
        Collective."""
        if self._friction is None:
            self.assembler.begin_step(-1.0)
            return
        self.update(at_rest=True)
        touched = self.assembler.begin_step(self.pair.initial_contact)
        self.touches = self._comm.allreduce(touched) > 0
        powers, coefficients, nodes = self.pair._phi
        continuous = self.pair.friction_space[0] not in ("DG", "Discontinuous Lagrange", "DP")
        free = self.assembler.nodes()[2]
        tangents = self._friction.choose(
            self.assembler.slave_normals(nodes, continuous), free[:, -len(nodes) :]
        )
        self._friction.held |= self._excluded_friction
        self.pair._semi_multiplier.x.array[self._friction.held] = 0.0
        dofs = self._layout.local_dofs(self.friction_block)
        with together(self._comm, "contact set-up"):
            self.assembler.set_friction(
                _cpp.TraceBasis(nodes.shape[1], powers, coefficients),
                self._friction.local,
                np.where(self._friction.held, -1, dofs),
                tangents,
            )

    def hold(self) -> None:
        """Hold the multipliers without a free gap at zero, and those the user excludes.

        Needs the surfaces in place, thus one call of ``update`` before. Collective.
        """
        pair = self.pair
        while True:
            with together(self._comm, "contact set-up"):
                found, normal, free, decided = self.assembler.nodes()
            decided = decided.max(axis=1, initial=0.0)
            lacking = self._facets is not None and self._facets.lacking(decided).any()
            if not self._comm.allreduce(bool(lacking), op=MPI.LOR):
                break
            self._widen(decided)
            self._search(again=True)  # all are settled: this places the new facets
        nl = len(pair._psi[2])
        moves = (np.abs(normal) > 1e-8) & free
        fixed = found[:, :nl] & ~moves[:, :nl].any(axis=2)
        self.held = self._excluded | agreed(
            pair._multiplier, self._multiplier_nodes, fixed, any_facet=False
        )
        pair._multiplier.x.array[self.held] = 0.0
        dofs = self._layout.local_dofs(self.multiplier_block)
        self.assembler.set_multiplier_dofs(np.where(self.held, -1, dofs))

    def clearance(self, tool: Any) -> tuple[float, float, float]:
        """How far a tool is from the slave: smallest gap, the gap that counts as none, and how far
        targets are searched. Collective."""
        table = self.assembler.particles()
        on = self.tool_of_piece[table["piece"]] == self.pair.tools.index(tool)
        gap = self._comm.allreduce(float(table["gap"][on].min(initial=np.inf)), op=MPI.MIN)
        return gap, 0.5 * self.pair.initial_contact * self.facet_size(), self._radius

    def touching(self, tool: Any) -> int:
        """Number of this rank's closed particles on a tool."""
        if tool not in self.pair.tools:
            return 0
        counts = self.assembler.touching()
        return int(counts[self.tool_of_piece[:-1] == self.pair.tools.index(tool)].sum())

    def held_rows(self) -> npt.NDArray[Any]:
        """System dofs of the held multipliers that this rank owns."""
        rows = [self._owned(self.multiplier_block, self.held)]
        if self._friction is not None:
            rows.append(self._owned(self.friction_block, self._friction.held))
        return np.concatenate(rows)

    def _owned(self, block: int, which: npt.NDArray[np.bool_]) -> npt.NDArray[Any]:
        size = self._layout.slice(block)
        n = size.stop - size.start
        return self._layout.local_dofs(block)[:n][which[:n]]

    # -- every iteration ------------------------------------------------------------------------

    def update(self, close: float = -1.0, at_rest: bool = False) -> npt.NDArray[np.int64]:
        """Move the surfaces to the present displacements, search, decide statuses. Collective.

        Args:
            close: see Assembler.update (initial contact), negative: none
            at_rest: to the displacements and tools of the last accepted step

        Returns:
            numbers of particles over all ranks that opened, closed, began to slip, began to stick, and
            slip on in another direction, (5,)

        Raises:
            ContactError: on all ranks, if a displacement is not finite
        """
        slave_u, master_u = (*self._old, None)[:2] if at_rest else (None, None)
        slave = self._slave_values(slave_u)
        ringed = np.zeros(0) if self.pair.tools else self._ringed_values(master_u)
        with together(self._comm, "contact search"):
            if not (np.isfinite(slave).all() and np.isfinite(ringed).all()):
                raise ContactError(
                    "the displacement of a contact surface is not finite (nan or inf); give u and"
                    " the Dirichlet conditions finite values before solve()"
                )
        self._place = slave, ringed, master_u, close
        if self.pair.tools:
            old = self._old_motions
            for piece, now in enumerate(old if at_rest else self._motions()):
                self._tool.move(piece, now, old[piece])
        else:
            self._exchange(slave, ringed)
        changes = self._search(again=False)
        while changes[-1] > 0:
            self._widen(self.assembler.decided())
            more = self._search(again=True)
            changes = np.array([*(changes + more)[:-1], more[-1]])
        return changes[:-1]

    def _search(self, again: bool) -> npt.NDArray[np.int64]:
        """Search and decide where the last update has placed the surfaces; see Assembler.update.
        Collective.

        Returns:
            changes as of ``update``, and the number of ranks with particles that are not settled
        """
        slave, _, master_u, close = self._place
        master = np.zeros(0) if self.pair.tools else self._master_values(master_u)
        friction = self.pair._semi_multiplier
        found = np.zeros(6, dtype=np.int64)
        with together(self._comm, "contact search"):
            found[:-1] = self.assembler.update(
                slave,
                master,
                self.pair._multiplier.x.array,
                float(close),
                # before the first tangents there are none
                np.zeros(0) if friction is None or not self._has_tangents else friction.x.array,
                again,
            )
            if self._facets is not None:
                found[-1] = self._facets.lacking(self.assembler.decided()).any()
        self._comm.Allreduce(MPI.IN_PLACE, found)
        return found

    @property
    def _has_tangents(self) -> bool:
        return self._friction is not None and self._friction.tangents is not None

    def _exchange(self, slave: npt.NDArray[Any], ringed: npt.NDArray[Any]) -> None:
        """Fetch the master's facets near this rank's slave facets, if anything has moved far.
        Collective."""
        if self._facets.moved_far(slave, ringed):
            decided = self.assembler.decided() if self._facets.fetched else np.zeros(0)
            with events.EXCHANGE:
                self._hold(self._facets.fetch(slave, ringed, decided))

    def _widen(self, decided: npt.NDArray[np.float64]) -> None:
        """Fetch more facets where a search is not settled. Collective.

        Args:
            decided: how far away the search of each own slave facet was decided, (facets,)
        """
        slave, ringed = self._place[:2]
        with events.EXCHANGE:
            self._hold(self._facets.widen(slave, ringed, decided))

    def _hold(self, master: Any) -> None:
        """Give the assembler other master facets. Collective."""
        self.master = master
        if self._master_values is not None:
            self._master_values.free()
        self._master_values = NodeValues(self.pair.master.u, master.node_table)
        held = self._master_values(self._held_master)
        dofs = self._layout.node_dofs(self._master_block, master.node_table, held)
        with together(self._comm, "contact exchange"):
            self.assembler.set_master(master, dofs, self._facets.told())
        self._tell_old()

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
        nodes = np.searchsorted(self._ringed_slave.node_table, own.nodes)
        mean = self._slave_values(vector).reshape(-1, dim).mean(axis=1)[nodes].mean(axis=1)
        vector.destroy()
        weights = _cpp.particle_weights(own, _cpp.simpson(self._shape, 0), self.pair.axisymmetric)
        sums = self._comm.allreduce(np.array([np.abs(mean).sum(), weights.sum()]))
        return float(max(sums[0] / sums[1], np.finfo(float).tiny ** 0.25))

    def facet_size(self) -> float:
        """Mean diameter of the slave's facets [length]. Collective."""
        d = self._own.diameters()
        total, n = self._comm.allreduce(np.array([d.sum(), len(d)]))
        return float(total / n)

    def largest_pressure(self) -> float:
        """Largest |λ| of the present multipliers [pressure]. Collective."""
        values = np.abs(self.pair._multiplier.x.array)
        return float(self._comm.allreduce(values.max(initial=0.0), op=MPI.MAX))
