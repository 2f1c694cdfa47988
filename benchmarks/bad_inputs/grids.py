# SPDX-License-Identifier: MIT
"""Bad inputs: grids, .msh files, tags and partitions."""

from __future__ import annotations

import numpy as np

import dolfinx_contact as dc
from dolfinx_contact import meshes

from .scene import COMM, Folder, GOOD, MSH, NAN, SLAVE, kind, put, scene, told


@kind
def grids():
    for name, value in told([(0, 1), (-2, 2), (1,), (1, 1, 1), 3, None, "ab", (1.5, 2), (NAN, 1)]):
        yield f"counts = {name}", lambda v=value: meshes.grid(v)
    for name, value in told(["pentagon", None, 4, "interval"]):
        yield f"cell = {name}", lambda v=value: meshes.grid((1, 1), cell=v)
    for name, value in told([0, 3, 1.5, "1", None]):
        yield f"degree = {name}", lambda v=value: meshes.grid((1, 1), degree=v)
    for name, value in told([(0,), (0, 0, 0), (NAN, 0), "ab", (1, 1), (2, 0), 5j]):
        yield f"lower = {name}", lambda v=value: meshes.grid((1, 1), v, (1, 1))
    mappings = {
        "None": lambda x: None,
        "text": lambda x: "x",
        "another shape": lambda x: x[:, :1],
        "fewer points": lambda x: x[:1],
        "nan": lambda x: x * NAN,
    }
    for name, f in mappings.items():
        yield f"a mapping that returns {name}", lambda f=f: meshes.grid((2, 2), mapping=f)
    yield "a mapping that is none", lambda: meshes.grid((2, 2), mapping="x")
    square = meshes.grid((2, 2))
    for name, value in told([None, [], "ab", [None], 3]):
        yield f"create: bodies = {name}", lambda v=value: meshes.create(COMM, v)
    yield "create: bodies of two kinds", lambda: meshes.create(
        COMM, [square, meshes.grid((2, 2), cell="triangle")]
    )
    for name, value in told([[0], [0, 0, 0, 99], [-1] * 4, "abcd", [0.5] * 4, 3]):
        yield f"create: partition = {name}", lambda v=value: meshes.create(COMM, square, v)
    yield "create: a partition that returns None", lambda: meshes.create(
        COMM, square, lambda x, n: None
    )
    broken = {
        "cells beyond the points": lambda b: b.cells.__iadd__(100),
        "negative cells": lambda b: b.cells.__isub__(100),
        "points that are nan": lambda b: b.points.__imul__(NAN),
        "cells of 3 corners": lambda b: setattr(b, "cells", b.cells[:, :3]),
        "cells that are no integers": lambda b: setattr(b, "cells", b.cells * 1.5),
        "an unknown cell": lambda b: setattr(b, "cell", "pentagon"),
        "no cells": lambda b: setattr(b, "cells", b.cells[:0]),
    }
    for name, spoil in broken.items():

        def call(spoil=spoil):
            body = meshes.grid((2, 2))
            spoil(body)
            meshes.create(COMM, body)

        yield f"create: {name}", call
    on = lambda x: np.isclose(x[1], 0)  # noqa: E731
    predicates = {
        "no dictionary": [on],
        "no function": {5: "bottom"},
        "a body without numbers": {5: (on, 0)},
        "a function that returns None": {5: lambda x: None},
        "a function of another shape": {5: lambda x: np.ones(3, dtype=bool)},
        "a function that returns numbers": {5: lambda x: x[0]},
        "a tag that is no integer": {"five": on},
        "a tag of 64 bits": {2**40: on},
    }
    for name, value in predicates.items():
        yield f"tag_facets: {name}", lambda v=value: meshes.tag_facets(scene().mesh, v)
    for name, data in MSH.items():
        yield f"read_msh: {name}", Folder(
            lambda f, d=data: meshes.read_msh(COMM, put(f / "a.msh", d), 2)
        )
    yield "read_msh: no physical groups", Folder(
        lambda f: meshes.read_msh(COMM, put(f / "a.msh", GOOD.replace(" 1 1 1 ", " 0 1 1 ")), 2)
    )
    for name, dim in told([3, 1, 0, 4, -1, "2", None, 2.5]):
        yield f"read_msh: dim = {name}", Folder(
            lambda f, d=dim: meshes.read_msh(COMM, put(f / "a.msh", GOOD), d)
        )
    for name, value in told([[1], "ab", 5, {"1": "block"}, {1.5: "block"}, {77: "block"}]):
        yield f"read_msh: cells = {name}", Folder(
            lambda f, v=value: meshes.read_msh(COMM, put(f / "a.msh", GOOD), 2, cells=v)
        )
        yield f"read_msh: facets = {name}", Folder(
            lambda f, v=value: meshes.read_msh(COMM, put(f / "a.msh", GOOD), 2, facets=v)
        )
    yield "read_msh: no such file", lambda: meshes.read_msh(COMM, "/no/such/file.msh", 2)
    yield "read_msh: no name", lambda: meshes.read_msh(COMM, None, 2)
    yield "read_msh: a folder", Folder(lambda f: meshes.read_msh(COMM, f, 2))
    for name, value in told([99, "5", None, 5.5, []]):
        yield f"repartition: slave = {name}", lambda v=value: parted(v)
    for name, value in told([99, "5", 5.5]):
        yield f"repartition: master = {name}", lambda v=value: parted(SLAVE, v)
    yield "repartition: no mesh", lambda: dc.repartition([], [], SLAVE)
    yield "repartition: two meshes, one set of tags", lambda: dc.repartition(
        [scene().mesh, scene().mesh], scene().tags, SLAVE
    )
    yield "repartition: tags of another mesh", lambda: dc.repartition(
        scene().mesh, scene().tags, SLAVE
    )
    yield "repartition: a mesh that is none", lambda: dc.repartition("mesh", scene().tags, SLAVE)


def parted(*tags):
    s = scene()
    dc.repartition(s.mesh, s.tags, *tags)
