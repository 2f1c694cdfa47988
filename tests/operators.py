# SPDX-License-Identifier: MIT
"""Contact of two small bodies at a state; operators gathered in an order that no partition changes.

Shared by the tests of the assembled residual and matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from two_bodies import GAP, HELD, curve

import dolfinx_contact as dc
from dolfinx_contact.system import System

RHO, SCALE = 12.0, 1.7  # ρ_n and scale of λ; E and |λ| are about 1, so all blocks are about equal
MU, RHO_T, FRICTION_SCALE, KAPPA = 0.4, 30.0, 1.3, 0.05  # the same for friction
PARAMETERS = (RHO, SCALE, MU, RHO_T, FRICTION_SCALE, KAPPA)

# target, normals; the direction is oblique, so that it is nobody's normal
OBLIQUE = {2: (0.2, 1.0), 3: (0.2, -0.1, 1.0)}
TARGETS = ("proximity-facet", "direction-facet", "direction-direction")
INTERPOLATED = ("smooth-interpolated", "proximity-interpolated", "direction-interpolated")
TURNING = (  # e depends on X, or turns with the slave
    "varying-direction",
    "slave-direction",
    "slave-interpolated",
    "slavefacet-direction",
    "slavefacet-facet",
)


def target_of(name, dim, **options):
    """Keyword arguments of ContactPair."""
    kind, normals = name.split("-")
    if kind == "smooth":
        return {"target": dc.Smooth(**options), "normals": normals}
    if kind == "proximity":
        return {"target": dc.Proximity(**options), "normals": normals}
    if kind == "varying":
        return {"target": dc.SeekDirection(varying(dim), **options), "normals": normals}
    if kind in ("slave", "slavefacet"):
        return {"target": dc.SlaveNormal(kind == "slave", **options), "normals": normals}
    return {"target": dc.SeekDirection(OBLIQUE[dim], **options), "normals": normals}


def varying(dim):
    """A direction that depends on X."""

    def direction(x):
        e = np.ones((dim, x.shape[1]))
        e[0] = 0.2 + 0.3 * np.sin(4 * x[0])
        e[1:-1] = 0.1 * x[1]
        return e

    return direction


def relative(value, expected):
    """Largest difference over the largest entry."""
    return np.abs(value - expected).max() / np.abs(expected).max()


# -- gathered operators -----------------------------------------------------------------------------


class Numbering:
    """The unknowns of a system in canonical order: by block, position and component. Collective.

    Attributes:
        block, component: of each unknown; (n,)
        points: position of its node; (n, 3)
        position: canonical number of each system dof; (n,)
    """

    def __init__(self, system):
        layout = system.layout
        self.comm = system.comm
        self.owned = slice(layout.start, layout.start + layout.owned)
        rows = []
        for block, f in enumerate(system.functions):
            V, size = f.function_space, layout.block_sizes[block]
            points = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
            points, component = np.repeat(points, size, axis=0), np.tile(range(size), len(points))
            rows.append(np.column_stack([np.full(len(points), block), points, component]))
        # ranks follow each other in the system, and in each the blocks
        table = np.concatenate(self.comm.allgather(np.concatenate(rows)))
        # nodes are 0.1 apart: 7 digits tell them, and hide the round-off of the partition
        order = np.lexsort(np.round(table, 7).T[[4, 3, 2, 1, 0]])
        self.position = np.argsort(order)
        table = table[order]
        self.block, self.component = table[:, 0].astype(int), table[:, 4].astype(int)
        self.points = table[:, 1:4]
        same = np.all(np.abs(np.diff(table, axis=0)) < 1e-6, axis=1)
        assert not np.any(same), "two unknowns at one place: nodes cannot be told apart"

    def __len__(self):
        return len(self.position)

    def to_local(self, values):
        """This rank's entries of a canonical vector, in the order of the system."""
        return values[self.position[self.owned]]

    def gather(self, vector):
        """A PETSc vector in canonical order on all ranks. Collective."""
        out = np.empty(len(self))
        out[self.position] = np.concatenate(self.comm.allgather(vector.array_r.copy()))
        return out

    def dense(self, A):
        """A PETSc matrix in canonical order on all ranks, as a dense array. Collective."""
        offsets, columns, values = A.getValuesCSR()
        parts = self.comm.allgather((np.diff(offsets), columns, values))
        lengths, columns, values = (np.concatenate(part) for part in zip(*parts))
        rows = np.repeat(np.arange(len(lengths)), lengths)
        out = np.zeros((len(self), len(self)))
        out[self.position[rows], self.position[columns]] = values
        return out


# -- states -----------------------------------------------------------------------------------------

# how far the slave moves along the master, as fractions of 1; master facets are 0.3 (2D), 0.4 (3D)
SHIFTS = {
    "deformed": (0.03, 0.04),
    "sliding": (0.14, -0.07),
    "clamped": (0.31, 0.27),  # overhang 0.11 and 0.07, less than half of a facet
    "beyond": (0.52, 0.30),  # overhang 0.32: more than half of a facet
    "open": (0.03, 0.04),
}


def displacement(points, slave, configuration, dim):
    """Displacement of nodes: brings the bodies together, with waves and nodal noise.

    Args:
        points: positions (n, 3)
        slave: whether each is of the slave body (n,)
    """
    x = np.round(
        points[:, :dim], 9
    )  # without the partition's round-off, which noise would amplify
    u = np.zeros_like(x)
    # "noise" that depends on the place alone, thus on no partition
    phases = np.array(
        [[12.9898, 78.233, 37.719], [39.346, 11.135, 83.155], [73.156, 52.235, 9.151]]
    )
    noise = np.sin(1e2 * x @ phases[:dim, :dim].T + 1.0 + slave[:, None])
    u += 0.006 * noise
    u[:, 0] += 0.03 * np.sin(3.0 * x[:, -1] + 1.0)
    u[:, -1] += 0.02 * np.cos(8.0 * x[:, 0] + 1.5 * slave)
    shift = np.zeros(dim)
    shift[: dim - 1] = SHIFTS[configuration][: dim - 1]
    shift[-1] = -GAP + 0.005
    if configuration == "open":
        shift[-1] = 0.2
    u[slave] += shift
    if configuration == "deformed":  # both bodies turn, by 23 degrees in 2D
        angle = 0.4
        c, s = np.cos(angle), np.sin(angle)
        y = x + u
        turned = y.copy()
        turned[:, 0], turned[:, -1] = c * y[:, 0] - s * y[:, -1], s * y[:, 0] + c * y[:, -1]
        u = turned - x
    return u


def pressure(points):
    """Multiplier at nodes: tension in the middle of the slave, compression at its ends."""
    points = np.round(points, 9)
    x, y = (2 * np.pi / 0.9 * (points[:, i] - 0.55) for i in range(2))
    return -0.28 + 0.55 * np.cos(x) + 0.15 * np.sin(y + 0.3) + 0.04 * np.sin(57.0 * points[:, 0])


@dataclass
class Case:
    """A pair in a system, at a state.

    Attributes:
        x: canonical vector of the state; it meets the Dirichlet conditions
        slave: whether each unknown is of the slave body's displacement; likewise master,
            multiplier, friction
        held: whether a Dirichlet condition holds each unknown
    """

    system: System
    pair: dc.ContactPair
    numbering: Numbering
    x: np.ndarray
    slave: np.ndarray
    master: np.ndarray
    multiplier: np.ndarray
    friction: np.ndarray
    held: np.ndarray

    @property
    def contact(self):
        return self.system.contacts[0]

    def vector(self, x):
        """The system's vector of unknowns, filled from a canonical vector."""
        self.system.x.array[:] = self.numbering.to_local(x)
        return self.system.x

    def residual(self, x=None):
        """Whole residual and that of contact alone at a state, gathered. Collective."""
        system = self.system
        system.residual(self.vector(self.x if x is None else x), system.b)
        whole = self.numbering.gather(system.b)
        system.b.zeroEntries()
        self.contact.assembler.residual(system.b.handle)
        system.b.assemble()
        return whole, self.numbering.gather(system.b)

    def matrix(self, x=None):
        """Whole matrix at a state, gathered dense. Collective."""
        system = self.system
        vector = self.vector(self.x if x is None else x)
        system.residual(vector, system.b)
        system.jacobian(vector, system.A)
        return self.numbering.dense(system.A)

    def contact_matrix(self):
        """Contact's part of the matrix, for the targets of the last residual. Collective."""
        A = self.system.A
        A.zeroEntries()
        self.system.add_contact(A)
        A.assemble()
        return self.numbering.dense(A)

    def particles(self):
        """The table of all ranks' particles, sorted by facet and reference position. Collective."""
        parts = self.system.comm.allgather(self.contact.assembler.particles())
        table = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
        order = np.lexsort(np.round(np.column_stack([table["X"][:, ::-1], table["facet"]]), 7).T)
        return {key: rows[order] for key, rows in table.items()}


def case(m, target, rule, configuration, *, search=None, **options):
    """A system of one pair with its matrix allocated, at a state. Collective.

    Args:
        m: Model
        target: one of TARGETS
        rule: integration rule
        configuration: key of SHIFTS
        search: options of the target
        options: of ContactPair
    """
    pair = dc.ContactPair(
        m.slave,
        m.master,
        integration=rule,
        **target_of(target, m.dim, **(search or {})),
        **options,
    )
    system = System(m.F, m.u, m.J, [pair], m.bcs)
    numbering = Numbering(system)
    bulk = numbering.block < len(m.u)
    middle = 0.5 * GAP + (0.0 if m.straight else curve(numbering.points[:, : m.dim]))
    slave = bulk & (numbering.points[:, m.dim - 1] > middle)
    if len(m.u) == 2:
        assert np.array_equal(slave, numbering.block == 0)
    x = np.empty(len(numbering))
    u = displacement(numbering.points, slave, configuration, m.dim)
    x[bulk] = np.take_along_axis(u, numbering.component[:, None] % m.dim, axis=1)[bulk, 0]
    multiplier, friction = (numbering.block == len(m.u) + i for i in range(2))
    x[multiplier] = pressure(numbering.points[multiplier]) / SCALE
    points = np.round(numbering.points[friction], 9)
    phase = points @ [31.0, 17.0, 0.0] + 1.7 * numbering.component[friction]
    x[friction] = 1.2 * np.sin(phase) / FRICTION_SCALE
    held = np.zeros(len(numbering), dtype=bool)
    rows = np.concatenate(numbering.comm.allgather(system.layout.held_rows()))
    held[numbering.position[rows]] = True
    x[held] = HELD
    made = Case(system, pair, numbering, x, slave, bulk & ~slave, multiplier, friction, held)
    system.scale[len(m.u)] = SCALE
    if friction.any():
        # the last accepted step: turned a little less, and the slave elsewhere
        wave = np.round(numbering.points, 9) @ [23.0, 19.0, 0.0] + 2.1 * numbering.component
        system.write(made.vector(np.where(bulk, 0.99 * x, x) + 0.029 * slave * np.sin(wave)))
        made.contact.remember()
        made.pair.initial_contact = 10.0  # all touch, so that friction acts
        made.contact.begin_step()
        system.write(made.vector(x))
        made.contact.update()
        made.contact.hold()
        system.scale[len(m.u) + 1] = FRICTION_SCALE
    made.contact.assembler.set_parameters(*PARAMETERS)
    made.residual()
    system.create_matrix()
    made.residual()
    return made
