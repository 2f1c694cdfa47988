# SPDX-License-Identifier: MIT
"""What the bad inputs share: their register, small models, broken files."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
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
    names = [re.sub(r" at 0x\w+", "", repr(v))[:60] for v in values]
    return [
        (f"{n} ({names[:i].count(n) + 1})" if n in names[:i] else n, v)
        for i, (n, v) in enumerate(zip(names, values))
    ]


NO_NUMBERS = ("1", None, 1j, [1.0, 2.0], NAN)
NO_POSITIVE = (0.0, -1.0, INF, *NO_NUMBERS)


def solving(spoil=lambda s: None, pair={}, **options):
    s = scene()
    spoil(s)
    s.problem([s.pair(**pair)], **options).solve()


# -- files ---------------------------------------------------------------------------------------------

GOOD = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "body"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
2
1 2 2 1 1 1 2 3
2 2 2 1 1 1 3 4
$EndElements
"""
MSH = {
    "an empty file": "",
    "text": "once upon a time\n",
    "binary rubbish": bytes(range(256)) * 20,
    "a version that does not exist": GOOD.replace("2.2", "9.7"),
    "no elements": GOOD.split("$Elements")[0],
    "truncated in the nodes": GOOD[: GOOD.index("3 1 1 0")],
    "truncated in the elements": GOOD[: GOOD.index("2 2 2 1 1 1 3 4")],
    "elements of nodes that are not there": GOOD.replace("1 1 2 3", "1 1 2 30"),
    "nodes that are no numbers": GOOD.replace("2 1 0 0", "2 one 0 0"),
    "a node that is nan": GOOD.replace("2 1 0 0", "2 nan 0 0"),
}


def put_here(folder):
    path = Path(folder) / f"{RANK}.msh"
    path.write_text(GOOD)
    return path
