# SPDX-License-Identifier: MIT
"""Two small bodies for the tests of the assembled operators, in one mesh or two, on any partition.

They do not touch in the reference configuration, so that a node is known by its position; a
displacement brings them together (operators.py).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.bulk import derivative

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
DIM = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
SLAVE, MASTER = 5, 6  # tags
HELD = 0.004  # Dirichlet value of every component
GAP = 0.1  # distance of the bodies in the reference configuration

# sizes (bodies are boxes before the mapping; the interface of the master is z = 0)
MASTER_BOX = {2: ((0.0, -0.5), (1.2, 0.0)), 3: ((0.0, 0.0, -0.5), (1.2, 1.2, 0.0))}
SLAVE_BOX = {
    2: ((0.1, GAP), (1.0, GAP + 0.4)),
    3: ((0.1, 0.1, GAP), (1.0, 1.0, GAP + 0.4)),
}
COUNTS = {2: ((3, 1), (4, 1)), 3: ((2, 2, 1), (3, 3, 1))}

DEGREES = {"P2": (2, 1), "G2": (1, 2), "P2G2": (2, 2)}  # of the displacement, of the geometry


def degree_two(name, dim):
    """Options of a model: one of DEGREES, on fewer cells."""
    degree, geometry_degree = DEGREES[name]
    return {
        "degree": degree,
        "geometry_degree": geometry_degree,
        "straight": geometry_degree == 1,
        "counts": ((2, 1), (3, 1)) if dim == 2 else ((2, 1, 1), (2, 2, 1)),
    }


def curve(x, amplitude=0.05):
    """Height of the interface: convex and concave parts, ridges of either kind on straight cells."""
    z = amplitude * np.sin(5.0 * x[:, 0] + 0.3)
    return z + 0.4 * amplitude * np.cos(4.0 * x[:, 1]) if x.shape[1] == 3 else z


def curved(x):
    """Both interfaces follow the curve, which fades out into the bodies; free ends stay plane."""
    y = x.copy()
    y[:, -1] += curve(x) * (1 - np.abs(x[:, -1]))
    return y


def apart(x, ranks):
    """The slave body on the first rank, the master body on the last."""
    return np.where(x[:, -1] > GAP, 0, ranks - 1)


def columns(x, ranks):
    """Round robin of columns: every rank cuts through the interface."""
    return np.floor(x[:, 0] / 0.3 + 0.05).astype(int) % ranks


def last(x, ranks):
    """All on the last rank."""
    return np.full(len(x), ranks - 1)


PARTITIONS = {"default": None, "apart": apart, "columns": columns, "last": last}


def bodies(cell, geometry_degree=1, straight=False, counts=None, slave_box=None):
    """Slave and master body as points and cells."""
    dim = DIM[cell]
    options = {"cell": cell, "degree": geometry_degree, "mapping": None if straight else curved}
    slave, master = counts or COUNTS[dim]
    return (
        meshes.grid(slave, *(slave_box or SLAVE_BOX[dim]), **options),
        meshes.grid(master, *MASTER_BOX[dim], **options),
    )


@dataclass
class Model:
    """Bulk model and surfaces."""

    u: list
    F: list
    J: list
    slave: object
    master: object
    bcs: list
    dim: int
    straight: bool


@functools.lru_cache(maxsize=None)
def model(
    cell,
    partition="default",
    *,
    degree=1,
    geometry_degree=1,
    straight=False,
    separate=False,
    alone=False,
    counts=None,
    bulk="neo-Hookean",
    held=False,
    slave_box=None,
):
    """Two bodies, in one mesh or in two separate ones; cached.

    Args:
        alone: on this rank alone, whatever the number of ranks
        bulk: "neo-Hookean" (E about 1), or "springs" (∫ u·w: cheap to compile)
        held: with Dirichlet conditions on the left sides, which have nodes of both interfaces
        slave_box: lower and upper corner of the slave body
    """
    comm = MPI.COMM_SELF if alone else COMM
    parts = bodies(cell, geometry_degree, straight, counts, slave_box)
    spread = PARTITIONS[partition]
    groups = [[parts[0]], [parts[1]]] if separate else [list(parts)]
    u, surfaces, bcs, F = [], {}, [], []
    for number, group in enumerate(groups):
        mesh, body = meshes.create(comm, group, spread)
        body = body + number
        tags = meshes.tag_facets(
            mesh, _predicates(DIM[cell], straight, number if separate else None), body
        )
        V = compat.vector_space(mesh, degree)
        u.append(fem.Function(V))
        F.append(_bulk(u[-1], bulk))
        for tag in (SLAVE, MASTER):
            if not separate or tag == (SLAVE, MASTER)[number]:
                surfaces[tag] = dc.Surface(u[-1], tags, tag)
        if held:
            left = fem.locate_dofs_geometrical(V, lambda x: x[0] < 0.1 + 1e-9)
            g = fem.Function(V)
            g.x.array[:] = HELD
            bcs.append(fem.dirichletbc(g, left))
    J = derivative(F, u)
    return Model(
        u=u,
        F=[compat.form(f) for f in F],
        J=[[None if a is None else compat.form(a) for a in row] for row in J],
        slave=surfaces[SLAVE],
        master=surfaces[MASTER],
        bcs=bcs,
        dim=DIM[cell],
        straight=straight,
    )


def _predicates(dim, straight, number):
    """The interfaces; of one body only where it has a number."""

    def at(height):
        def predicate(x):
            offset = 0.0 if straight else curve(x[:dim].T) * (1 - height)
            return np.isclose(x[dim - 1], height + offset)

        return predicate

    tagged = {SLAVE: (GAP, 0), MASTER: (0.0, 1)}
    return {
        tag: (at(height), body) for tag, (height, body) in tagged.items() if number in (None, body)
    }


def _bulk(u, kind):
    mesh = u.function_space.mesh
    w, dim = ufl.TestFunction(u.function_space), mesh.geometry.dim
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    if kind == "springs":
        return ufl.inner(u, w) * dx
    deformation = ufl.Identity(dim) + ufl.grad(u)
    J = ufl.det(deformation)
    psi = 0.2 * (ufl.tr(deformation.T * deformation) - dim) - 0.4 * ufl.ln(J)
    return ufl.derivative((psi + 0.3 * ufl.ln(J) ** 2) * dx, u, w)
