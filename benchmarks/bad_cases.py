# SPDX-License-Identifier: MIT
"""Bad inputs of the campaign in bad_input.py, by kind; each is a name and a call that must fail.

Every call runs on all ranks, on meshes of a few cells that are made anew for it. Cases of the kind
"ranks" give each rank something else, and are none on one rank.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
RANK, LAST = COMM.rank, COMM.size - 1
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2
NAN, INF = float("nan"), float("inf")
KINDS = {}


def kind(function):
    """A generator of (name, call)."""
    KINDS[function.__name__] = function
    return function


def cases(name):
    """All (name, call) of a kind, none for "ranks" on one rank."""
    found = [] if name == "ranks" and COMM.size == 1 else list(KINDS[name]())
    names = [label for label, _ in found]
    assert len(set(names)) == len(names), {n for n in names if names.count(n) > 1}
    return found


# -- small models -------------------------------------------------------------------------------------


class Scene:
    """A block on another one, held below and moved above; `points` may spoil the nodes of a body."""

    def __init__(self, cell="quadrilateral", degree=1, spoil=None):
        dim = 2 if cell in ("quadrilateral", "triangle") else 3
        flat = (0,) * (dim - 2)
        upper = meshes.grid(
            (3, *[1] * (dim - 1)), (-1, *flat, 0), (1, *[1] * (dim - 1)), None, cell
        )
        ends = (-2, *flat, -1), (2, *[1] * (dim - 2), 0)
        lower = meshes.grid((5, *[1] * (dim - 1)), *ends, None, cell)
        faces = [(SLAVE, 0, 0), (TOP, 1, 0), (MASTER, 0, 1), (BOTTOM, -1, 1)]
        at = lambda value: lambda x: np.isclose(x[dim - 1], value)  # noqa: E731
        self.mesh, body = meshes.create(COMM, [upper, lower])
        self.tags = meshes.tag_facets(self.mesh, {t: (at(z), b) for t, z, b in faces}, body)
        self.body, self.dim = body, dim
        if spoil is not None:
            spoil(self.mesh.geometry.x)
        self.V = compat.vector_space(self.mesh, degree)
        self.u, self.w = fem.Function(self.V, name="displacement"), ufl.TestFunction(self.V)
        self.F = self.elastic(self.u, self.w)
        self.top, self.bottom = (
            fem.locate_dofs_topological(self.V, dim - 1, self.tags.find(t)) for t in (TOP, BOTTOM)
        )
        self.moved = fem.Function(self.V)
        down = np.array([0.0] * (dim - 1) + [-0.01])
        self.moved.x.array[:] = np.tile(down, len(self.moved.x.array) // dim)
        self.bcs = [
            fem.dirichletbc(self.moved, self.top),
            fem.dirichletbc(np.zeros(dim), self.bottom, self.V),
        ]

    @staticmethod
    def elastic(u, w):
        dx = ufl.dx(metadata={"quadrature_degree": 2})
        e = ufl.sym(ufl.grad(u))
        return (2 * ufl.inner(e, ufl.grad(w)) + ufl.tr(e) * ufl.div(w)) * dx

    def surface(self, tag=SLAVE):
        return dc.Surface(self.u, self.tags, tag)

    def pair(self, master=None, **options):
        return dc.ContactPair(self.surface(), master or self.surface(MASTER), **options)

    def problem(self, pairs=None, **options):
        pairs = [self.pair()] if pairs is None else pairs
        return dc.ContactProblem(self.F, self.u, pairs, **{"bcs": self.bcs, **options})

    def stepping(self, apply=lambda t: None, **options):
        options = {"progress": False, "end": 1.0, "step": 1.0, **options}
        return dc.LoadStepping(self.problem(), apply, **options)


def scene(*args, **options):
    return Scene(*args, **options)


def other(value, usual):
    """Something else on the last rank."""
    return value if RANK == LAST else usual


class Folder:
    """A folder of all ranks for one case: what `call(folder)` leaves there goes with it."""

    def __init__(self, call):
        self.call = call

    def __call__(self):
        path = COMM.bcast(tempfile.mkdtemp() if RANK == 0 else None)
        try:
            self.call(Path(path))
        finally:
            COMM.barrier()
            if RANK == 0:
                shutil.rmtree(path, ignore_errors=True)


def put(path, data):
    """A file that rank 0 writes."""
    if RANK == 0:
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
    COMM.barrier()
    return path


def told(values):
    """Values with names, which are the same on all ranks."""
    names = [re.sub(r"<([^>]*?)( object)? at 0x\w+>", r"\1", repr(v))[:60] for v in values]
    return [
        (f"{n} ({names[:i].count(n) + 1})" if n in names[:i] else n, v)
        for i, (n, v) in enumerate(zip(names, values))
    ]


NO_NUMBERS = ("1", None, 1j, [1.0, 2.0], NAN)
NO_POSITIVE = (0.0, -1.0, INF, *NO_NUMBERS)

# -- surfaces -----------------------------------------------------------------------------------------


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
        whole = fem.Function(fem.FunctionSpace(s.mesh, element))
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


# -- meshes whose nodes are wrong ---------------------------------------------------------------------


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


# -- pairs --------------------------------------------------------------------------------------------


@kind
def pairs():
    for name, value in told([None, "slave", 5]):
        yield f"slave = {name}", lambda v=value: dc.ContactPair(v, scene().surface(MASTER))
        yield f"master = {name}", lambda v=value: dc.ContactPair(scene().surface(), v)
    plane = dc.RigidPlane((0, 0), (0, 1))
    yield "slave is a tool", lambda: dc.ContactPair(plane, plane)
    for name, value in told([[], [None], [plane, plane], [plane, "a"], {plane: 1}]):
        yield f"master = {name}", lambda v=value: dc.ContactPair(scene().surface(), v)
    yield "master is u", lambda: dc.ContactPair(scene().surface(), scene().u)
    yield "master is a list of surfaces", lambda: dc.ContactPair(
        scene().surface(), [scene().surface(MASTER)]
    )
    yield "a tool of 3D in 2D", lambda: dc.ContactPair(
        scene().surface(), dc.RigidSphere((0, 0, 0), 1)
    )

    def same(slave, master):
        s = scene()
        dc.ContactPair(s.surface(slave), s.surface(master))

    yield "slave is master", lambda: same(SLAVE, SLAVE)
    yield "slave and master overlap", lambda: same(SLAVE, [SLAVE, MASTER])
    yield "slave in 2D, master in 3D", lambda: dc.ContactPair(
        scene().surface(), scene("hexahedron").surface(MASTER)
    )
    wrong = {
        "friction": (-0.3, INF, *NO_NUMBERS, -1e300, lambda x: 0.3),
        "target": (None, "closest", dc.Smooth, 3, ["smooth"]),
        "normals": ("smooth", 3, ["facet"], "direction"),
        "integration": (None, "Simpson", dc.Simpson, 3, lambda: 3),
        "pressure_space": (
            *(None, "Lagrange", 1, (), ("Lagrange",), ("Lagrange", 1, 2), ("Lagrange", 7)),
            *(("Lagrange", -1), ("Lagrange", 0), ("Lagrange", NAN), ("Lagrange", None)),
            *(("Lagrange", "1"), (1, "Lagrange"), ("RT", 1), (None, 1), ("Lagrange", 1.5)),
        ),
        "exclude": (3, "12", (SLAVE,), (None, 1), (1, 2, 3)),
        "axisymmetric": ("no", 2, None, NAN),
        "crease": (0, -10, 181, *NO_NUMBERS),
        "rho_n": (0.0, -1.0, INF, "1", 1j, [1.0, 2.0], NAN),
        "rho_t": (0.0, -1.0, INF, "1", 1j, [1.0, 2.0], NAN),
        "slip": (None, "incremental", 3),
        "initial_contact": (-0.1, INF, *NO_NUMBERS),
        "augmented": ("no", 2, None),
    }
    for option, values in wrong.items():
        for name, value in told(values):
            yield f"{option} = {name}", lambda o=option, v=value: scene().pair(**{o: v})
    for name, value in told([("Lagrange", 3), "DG", ("DG", 1, 1), (1, 1)]):
        yield f"friction_space = {name}", lambda v=value: scene().pair(
            friction=0.3, friction_space=v
        )

    def excluding(make, tag):
        s = scene()
        s.pair(exclude=(make(s), tag))

    yield "exclude: unknown tag", lambda: excluding(lambda s: s.tags, 99)
    yield "exclude: tags of another mesh", lambda: excluding(lambda s: scene().tags, TOP)
    yield "axisymmetric in 3D", lambda: scene("hexahedron").pair(axisymmetric=True)
    for target in (dc.SeekDirection((0, 1)), dc.SlaveNormal()):
        yield f"{type(target).__name__} on a tool", lambda t=target: scene().pair(plane, target=t)
    yield "facet normals with Smooth", lambda: scene().pair(target=dc.Smooth(), normals="facet")
    yield "a direction of 3D in 2D", lambda: scene().pair(target=dc.SeekDirection((0, 0, 1)))
    yield "a direction of 2D in 3D", lambda: scene("hexahedron").pair(
        target=dc.SeekDirection((0, 1))
    )
    yield "Lobatto on triangles", lambda: scene("tetrahedron").pair(integration=dc.Lobatto(3))
    yield "one point for two pressures", lambda: scene().pair(integration=dc.Gauss(1))
    yield "nodes without weight", lambda: scene("tetrahedron").pair(
        integration=dc.Nodes(), pressure_space=("Lagrange", 2)
    )


# -- targets and rules --------------------------------------------------------------------------------


@kind
def rules():
    for rule, values in {
        dc.Simpson: (-1, 7, 0.5, 10**9, "1", None, NAN, 1j, [1], True),
        dc.Gauss: (0, -3, 21, 2.0, "2", None, NAN, [2], True),
        dc.Lobatto: (1, 0, 11, 3.0, "3", None, INF, [3], True),
        dc.Segments: (0, -1, 21, 2.0, "2", NAN, [2], True),
    }.items():
        for name, value in told(values):
            yield f"{rule.__name__}({name})", lambda r=rule, v=value: r(v)
    for target in (dc.Smooth, dc.Proximity, dc.SlaveNormal):
        for name, value in told([0.0, -1.0, NAN, "1", 1j, [1.0, 2.0]]):
            yield f"{target.__name__}(radius={name})", lambda t=target, v=value: t(radius=v)
        for name, value in told([-0.5, INF, *NO_NUMBERS]):
            yield f"{target.__name__}(end_tolerance={name})", lambda t=target, v=value: t(
                end_tolerance=v
            )
    yield "SlaveNormal('yes')", lambda: dc.SlaveNormal("yes")
    directions = [(0, 0), (1,), (1, 0, 0, 0), (NAN, 1), (INF, 1), None, "ab", 3, [[0, 1]], (1j, 0)]
    for name, value in told([*directions, ("0", "1"), {}]):
        yield f"SeekDirection({name})", lambda v=value: dc.SeekDirection(v)
    functions = {
        "None": lambda x: None,
        "text": lambda x: "up",
        "another shape": lambda x: x[:1],
        "transposed": lambda x: np.ones((x.shape[1], 2)),
        "nan": lambda x: np.full((2, x.shape[1]), NAN),
        "zero": lambda x: np.zeros((2, x.shape[1])),
        "zero at one place": lambda x: np.stack([0 * x[0], x[0] > 0.4]),
        "complex numbers": lambda x: np.ones((2, x.shape[1]), dtype=complex),
        "objects": lambda x: np.full((2, x.shape[1]), None),
    }
    for name, f in functions.items():
        yield f"SeekDirection of a function that returns {name}", lambda f=f: seeking(f)


def seeking(f):
    s = scene()
    s.problem([s.pair(target=dc.SeekDirection(f))])
