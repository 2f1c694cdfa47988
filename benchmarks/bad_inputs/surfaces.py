# SPDX-License-Identifier: MIT
"""Bad inputs: displacements, tags and spaces of surfaces; meshes with wrong nodes or cells."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

from .scene import COMM, INF, LAST, MASTER, NAN, RANK, SLAVE, Scene, kind, scene, told


@kind
def surfaces():
    for name, value in told([None, "u", 3, np.zeros(4)]):
        yield f"u = {name}", lambda v=value: dc.Surface(v, scene().tags, SLAVE)
    yield "u is a test function", lambda: dc.Surface(scene().w, scene().tags, SLAVE)
    spaces = {
        "scalar": ("Lagrange", 1),
        "Nédélec": ("N1curl", 1),
        "Raviart-Thomas": ("RT", 1),
    }
    for name, element in spaces.items():

        def call(element=element):
            s = scene("triangle")
            dc.Surface(fem.Function(compat.function_space(s.mesh, element)), s.tags, SLAVE)

        yield f"u is {name}", call
    vectors = {
        "discontinuous": ("DG", 1, None),
        "of cells": ("DG", 0, None),
        "cubic": ("Lagrange", 3, None),
        "of 3 components in 2D": ("Lagrange", 1, 3),
        "of 1 component": ("Lagrange", 1, 1),
    }
    for name, (family, degree, size) in vectors.items():

        def call(family=family, degree=degree, size=size):
            s = scene()
            V = compat.function_space(s.mesh, (family, degree), size or 2)
            dc.Surface(fem.Function(V), s.tags, SLAVE)

        yield f"u is {name}", call

    def mixed():
        s = scene()
        element = ufl.MixedElement(
            ufl.VectorElement("Lagrange", s.mesh.ufl_cell(), 1),
            ufl.FiniteElement("Lagrange", s.mesh.ufl_cell(), 1),
        )
        whole = fem.Function(dc.function_space(s.mesh, element))
        dc.Surface(whole.sub(0), s.tags, SLAVE)

    yield "u is a part of a mixed function", mixed

    def line():
        mesh = dolfinx_mesh.create_interval(COMM, 8, (0, 1))
        tags = dolfinx_mesh.meshtags(mesh, 0, np.array([0], dtype=np.int32), np.int32(SLAVE))
        dc.Surface(fem.Function(compat.function_space(mesh, ("Lagrange", 1))), tags, SLAVE)

    yield "a mesh of lines", line
    for name, value in told([None, "tags", [5, 6], {5: 1}, np.arange(4)]):
        yield f"facet_tags = {name}", lambda v=value: dc.Surface(scene().u, v, SLAVE)
    for cell, dimensions in {"quadrilateral": (0, 2), "hexahedron": (0, 1, 3)}.items():
        for d in dimensions:

            def call(cell=cell, d=d):
                s = scene(cell)
                s.mesh.topology.create_entities(d)
                n = s.mesh.topology.index_map(d).size_local
                tags = dolfinx_mesh.meshtags(
                    s.mesh, d, np.arange(n, dtype=np.int32), np.full(n, SLAVE, np.int32)
                )
                dc.Surface(s.u, tags, SLAVE)

            yield f"tags of dimension {d} of {cell}s", call
    yield "tags of another mesh", lambda: dc.Surface(scene().u, scene("triangle").tags, SLAVE)
    yield "tags of an equal mesh", lambda: dc.Surface(scene().u, scene().tags, SLAVE)
    unknown = [99, -1, 2**40, [SLAVE, 99]]
    no_tags = [None, "5", 5.0, NAN, [], set(), [[5]], [None], 5j, ["5"], np.zeros(0)]
    for name, value in told(unknown + no_tags):
        yield f"tag = {name}", lambda v=value: scene().surface(v)

    def inner(where):
        s = scene()
        s.mesh.topology.create_connectivity(1, 2)
        links = np.diff(s.mesh.topology.connectivity(1, 2).offsets)
        facets = np.flatnonzero(links == 2).astype(np.int32) if where() else np.zeros(0, np.int32)
        facets = np.union1d(facets, s.tags.find(SLAVE)).astype(np.int32)
        tags = dolfinx_mesh.meshtags(s.mesh, 1, facets, np.full(len(facets), SLAVE, np.int32))
        dc.Surface(s.u, tags, SLAVE)

    yield "facets between cells", lambda: inner(lambda: True)
    yield "facets between cells on the last rank", lambda: inner(lambda: RANK == LAST)


def at(*place):
    """Nodes at a place."""
    return lambda x: np.flatnonzero(np.linalg.norm(x[:, : len(place)] - place, axis=1) < 1e-9)


def setting(where, values):
    """A function that moves nodes."""

    def spoil(x):
        x[where(x)] = [*values, *[0.0] * (3 - len(values))]

    return spoil


@kind
def geometry():
    a, b = (-1.0, 0.0), (-1 / 3, 0.0)  # two slave nodes; the first is a corner
    inner, above = (-0.4, -1.0), (-1 / 3, 1.0)  # nodes away from the contact
    spoilt = {
        "nan at the slave": (a, (NAN, 0.0)),
        "inf at the slave": (a, (INF, 0.0)),
        "nan at the master's side": ((2.0, 0.0), (NAN, 0.0)),
        "nan in the bulk": (inner, (NAN, NAN)),
        "inf in the bulk": (inner, (0.0, INF)),
        "a slave facet of length 0": (a, b),
        "a cell folded over": (b, (2.0, 0.0)),
        "a twisted cell": (above, (0.9, 1.0)),
        "a node beyond the opposite side": (above, (-1 / 3, -0.5)),
        "huge coordinates": (a, (1e308, 0.0)),
    }
    for cell in ("quadrilateral", "triangle"):
        for name, (place, value) in spoilt.items():

            def call(cell=cell, place=place, value=value):
                scene(cell, spoil=setting(at(*place), value)).problem().solve()

            yield f"{name}, {cell}s", call

    def all_at(value):
        def spoil(x):
            x[:] = value

        return spoil

    for cell in ("quadrilateral", "hexahedron"):
        for name, value in told([0.0, NAN]):
            yield f"all nodes at {name}, {cell}s", lambda c=cell, v=value: scene(
                c, spoil=all_at(v)
            ).problem().solve()
    corner, along = (-1.0, 0.0, 0.0), (-1 / 3, 0.0, 0.0)
    solid = {
        "nan at the slave": [(corner, (NAN, 0, 0))],
        "a facet without area": [(corner, along), ((-1.0, 1.0, 0.0), (-1 / 3, 1.0, 0.0))],
        "a flat cell": [((-1.0, y, 0.0), (-1.0, y, 1.0)) for y in (0.0, 1.0)]
        + [((-1 / 3, y, 0.0), (-1 / 3, y, 1.0)) for y in (0.0, 1.0)],
        "an inverted cell": [((-1.0, y, 1.0), (-1.0, y, -2.0)) for y in (0.0, 1.0)]
        + [((-1 / 3, y, 1.0), (-1 / 3, y, -2.0)) for y in (0.0, 1.0)],
    }
    for cell in ("hexahedron", "tetrahedron"):
        for name, moves in solid.items():

            def call(cell=cell, moves=moves):
                def spoil(x):
                    for place, value in moves:
                        setting(at(*place), value)(x)

                scene(cell, spoil=spoil).problem().solve()

            yield f"{name}, {cell}s", call

    def duplicated():
        """Every cell by itself, with nodes of its own: the body is in pieces."""
        whole = meshes.grid((3, 1), (-1, 0), (1, 1))
        points = whole.points[whole.cells].reshape(-1, 2)
        cells = np.arange(len(points)).reshape(-1, 4)
        pieces = meshes.Body(points, cells, "quadrilateral", 1)
        mesh, body = meshes.create(COMM, [pieces, meshes.grid((4, 1), (-2, -1), (2, 0))])
        on = {
            SLAVE: (lambda x: np.isclose(x[1], 0), 0),
            MASTER: (lambda x: np.isclose(x[1], 0), 1),
        }
        tags = meshes.tag_facets(mesh, on, body)
        u = fem.Function(compat.vector_space(mesh, 1))
        w = ufl.TestFunction(u.function_space)
        F = Scene.elastic(u, w) - w[1] * ufl.dx
        pair = dc.ContactPair(dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER))
        dc.ContactProblem(F, u, [pair]).solve()

    yield "duplicated nodes: cells that hang together by nothing", duplicated
    yield "an axisymmetric body on both sides of the axis", lambda: scene().pair(axisymmetric=True)
