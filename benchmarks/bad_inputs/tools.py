# SPDX-License-Identifier: MIT
"""Bad inputs: rigid tools; rigid meshes and their files."""

from __future__ import annotations

import numpy as np

import dolfinx_contact as dc

from .scene import COMM, Folder, GOOD, INF, MSH, NAN, NO_POSITIVE, kind, put, scene, told


@kind
def tools():
    no_vectors = [
        None,
        "ab",
        1.0,
        (1,),
        (1, 0, 0, 0),
        (NAN, 1),
        (INF, 1),
        (1j, 1),
        ((0, 1), (1, 0)),
    ]
    for name, value in told([*no_vectors, (0, 0, 1), np.array([0, 1j])]):
        yield f"RigidPlane((0, 0), {name})", lambda v=value: dc.RigidPlane((0, 0), v)
    for name, value in told(no_vectors):
        yield f"RigidPlane({name}, (0, 1))", lambda v=value: dc.RigidPlane(v, (0, 1))
        yield f"RigidSphere({name}, 1)", lambda v=value: dc.RigidSphere(v, 1.0)
    yield "a plane without normal", lambda: dc.RigidPlane((0, 0), (0, 0))
    for name, value in told([(1, 0), (-1, 2), (1, 1), 3, None, "ab", (0, NAN), (0, 1, 2)]):
        yield f"extent = {name}", lambda v=value: dc.RigidPlane((0, 0), (0, 1), v)
    z, e = (0, 0, 0), (0, 0, 1)
    for name, value in told(NO_POSITIVE):
        yield f"radius of a sphere = {name}", lambda v=value: dc.RigidSphere((0, 0), v)
        yield f"radius of a cylinder = {name}", lambda v=value: dc.RigidCylinder(z, e, v)
        yield f"radius of a torus = {name}", lambda v=value: dc.RigidTorus(z, e, 1.0, v)
        yield f"ring of a torus = {name}", lambda v=value: dc.RigidTorus(z, e, v, 1.0)
    for name, value in told((0.0, -1.0, NAN, "1")):
        yield f"length of a cylinder = {name}", lambda v=value: dc.RigidCylinder(
            z, e, 1.0, length=v
        )
    for name, value in told([z, (0, 1), None, "xyz", (NAN, 0, 1)]):
        yield f"axis of a cylinder = {name}", lambda v=value: dc.RigidCylinder(z, v, 1.0)
        yield f"axis of a torus = {name}", lambda v=value: dc.RigidTorus(z, v, 1.0, 0.2)
    yield "inside = 'no'", lambda: dc.RigidSphere((0, 0), 1.0, "no")
    plane, ball = dc.RigidPlane((0, 0), (0, 1)), dc.RigidSphere((0, 0, 0), 1.0)
    for name, value in told([None, [], plane, [None], [plane, ball], "ab"]):
        yield f"composite of {name}", lambda v=value: dc.RigidComposite(v)

    def driven():
        tool = dc.RigidPlane((0, 0), (0, 1))
        tool.push((0, -1))
        dc.RigidComposite([tool])

    yield "composite of a driven tool", driven
    for name, value in told(no_vectors[1:]):
        yield f"move({name})", lambda v=value: dc.RigidPlane((0, 0), (0, 1)).move(v)
    turns = [NAN, "left", np.ones((2, 2)), np.diag([1, -1]), np.eye(3), [1, 2], 2 * np.eye(2), 1j]
    for name, value in told(turns):
        yield f"move(rotation={name})", lambda v=value: dc.RigidPlane((0, 0), (0, 1)).move(
            rotation=v
        )
    for name, value in told([(0, 0), *no_vectors]):
        yield f"push({name})", lambda v=value: dc.RigidPlane((0, 0), (0, 1)).push(v)
    for name, value in told([(0, 0), (1, 0), (NAN, 1), "up", [(1, 0), (2, 0)], np.ones((3, 2))]):
        yield f"push((0, -1), along={name})", lambda v=value: dc.RigidPlane((0, 0), (0, 1)).push(
            (0, -1), v
        )
    yield "force of a tool in no problem", lambda: dc.RigidPlane((0, 0), (0, 1)).force()
    for name, value in told([(1,), "ab", (NAN, 1)]):
        yield f"moment(about={name})", lambda v=value: dc.RigidPlane((0, 0), (0, 1)).moment(v)

    def unsolved():
        s, tool = scene(), dc.RigidPlane((0, 0), (0, 1))
        s.problem([s.pair(tool)])
        tool.force()

    yield "force before the solve", unsolved

    def late():
        s, tool = scene(), dc.RigidPlane((0, 0), (0, 1))
        problem = s.problem([s.pair(tool)])
        tool.push((0, 1))
        problem.solve()

    yield "first push after the problem was made", late

    def away():
        s, tool = scene(), dc.RigidPlane((0, -1), (0, 1))
        tool.push((0, -1))
        s.problem([s.pair(tool)]).solve()

    yield "a tool that is pushed away", away


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


@kind
def rigid_meshes():
    x, c = SQUARE, TRIANGLES
    for name, value in told(
        [None, "x", 3, x[0], x[:, :1], np.full((4, 3), NAN), np.zeros((4, 3))]
    ):
        yield f"points = {name}", lambda v=value: dc.RigidMesh(v, c)
    for name, value in told([None, "c", 3, [], c[0], c + 2, c - 1, 1.0 * c, [[0, 1, 2, 3, 0]]]):
        yield f"cells = {name}", lambda v=value: dc.RigidMesh(x, v)
    yield "a cell twice", lambda: dc.RigidMesh(x, np.vstack([c, c[:1]]))
    yield "neighbours that turn against each other", lambda: dc.RigidMesh(
        x, [[0, 1, 2], [0, 3, 2]]
    )
    yield "a corner twice", lambda: dc.RigidMesh(x, [[0, 1, 1]])
    yield "corners on a line", lambda: dc.RigidMesh(
        x * [1, 0, 0] + [[0] * 3, [0] * 3, [1, 0, 0], [2, 0, 0]], c
    )
    yield "two points at one place", lambda: dc.RigidMesh(x[[0, 0, 2, 3]], c)
    yield "three cells at an edge", lambda: dc.RigidMesh(
        np.vstack([x, [[1, 0, 1]]]), [[0, 1, 2], [2, 0, 3], [0, 2, 4]]
    )
    yield "inf in a point", lambda: dc.RigidMesh(np.where(x == 1, INF, x), c)
    yield "flip = 'no'", lambda: dc.RigidMesh(x, c, "no")
    yield "read: no such file", lambda: dc.RigidMesh.read("/no/such/file.msh", COMM)
    yield "read: no name", lambda: dc.RigidMesh.read(None, COMM)
    for name, data in MSH.items():
        yield f"read: {name}", Folder(
            lambda f, d=data: dc.RigidMesh.read(put(f / "a.msh", d), COMM)
        )
    yield "read: a folder", Folder(lambda f: dc.RigidMesh.read(f, COMM))
    for name, tags in told([99, "top", [None], 1.5]):
        yield f"read: tags = {name}", Folder(
            lambda f, t=tags: dc.RigidMesh.read(put(f / "a.msh", GOOD), COMM, t)
        )
