# SPDX-License-Identifier: MIT
"""Bad inputs: files, tables and pictures."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

import dolfinx_contact as dc
from dolfinx_contact import plot

from .scene import COMM, Folder, INF, NAN, RANK, kind, put, scene, told


@kind
def output():
    def writer(s, path, **given):
        options = {"folder": path / "out", "u": s.u, **given}
        return dc.Writer(**options)

    for name, value in told([None, "u", 3, [], [None]]):
        yield f"Writer: u = {name}", Folder(lambda f, v=value: writer(scene(), f, u=v))
    for name, value in told([None, "pair", 3, [None]]):
        yield f"Writer: pairs = {name}", Folder(lambda f, v=value: writer(scene(), f, pairs=v))
        yield f"Writer: fields = {name}", Folder(lambda f, v=value: writer(scene(), f, fields=v))
    for name, value in told([NAN, INF, "1", 1j]):
        yield f"Writer: resume = {name}", Folder(lambda f, v=value: writer(scene(), f, resume=v))
    yield "Writer: folder = None", lambda: dc.Writer(None, scene().u)
    yield "Writer: folder = 3", lambda: dc.Writer(3, scene().u)
    yield "Writer: the folder is a file", Folder(
        lambda f: writer(scene(), f, folder=put(f / "a", "text"))
    )
    yield "Writer: the folder is in a file", Folder(
        lambda f: writer(scene(), f, folder=put(f / "a", "text") / "out")
    )
    yield "Writer: /proc", lambda: dc.Writer("/proc/out", scene().u)
    yield "Writer: /dev/full", lambda: dc.Writer("/dev/full", scene().u)

    def scalar(f):
        s = scene()
        writer(s, f, u=fem.Function(dc.function_space(s.mesh, ("Lagrange", 1))))

    yield "Writer: u is a scalar", Folder(scalar)
    yield "Writer: a field of another mesh", Folder(
        lambda f: writer(scene(), f, fields=[scene().u])
    )

    def two(f):
        s = scene()
        a, b = (fem.Function(s.V, name="a") for _ in range(2))
        writer(s, f, fields=[a, b])

    yield "Writer: two fields of one name", Folder(two)
    yield "Writer: unsolved", Folder(lambda f: unsolved(f))

    def unsolved(f):
        s = scene()
        writer(s, f, pairs=[s.pair()]).write(0.0)

    for name, value in told([NAN, INF, "1", None, 1j, [1.0], -1.0, 1.0]):
        yield f"Writer: time {name} after 1", Folder(lambda f, v=value: second(f, v))

    def second(f, value):
        out = writer(scene(), f)
        out.write(1.0)
        out.write(value)

    yield "Writer: resumed from rubbish", Folder(lambda f: rubbish(f))

    def rubbish(f):
        if RANK == 0:
            (f / "out").mkdir()
        COMM.barrier()
        put(f / "out" / "bulk.xdmf", "<Xdmf")
        writer(scene(), f, resume=1.0)

    for name, value in told([None, 3, "/proc/table.csv", "/dev/full/a.csv"]):
        yield f"Table({name})", lambda v=value: dc.Table(v, comm=COMM)
    for name, value in told(["time", 3, [3], [None]]):
        yield f"Table: columns = {name}", Folder(
            lambda f, v=value: dc.Table(f / "a.csv", columns=v, comm=COMM)
        )
    for name, value in told([NAN, "1"]):
        yield f"Table: resume = {name}", Folder(
            lambda f, v=value: dc.Table(f / "a.csv", resume=v, comm=COMM)
        )
    yield "Table: a folder", Folder(lambda f: dc.Table(f, comm=COMM))
    yield "Table: resumed from text", Folder(
        lambda f: dc.Table(put(f / "a.csv", "a\nb\n"), resume=1.0, comm=COMM)
    )
    yield "Table: resumed from binary rubbish", Folder(
        lambda f: dc.Table(put(f / "a.csv", bytes(range(256)) * 4), resume=1.0, comm=COMM)
    )
    for name, value in told(
        [None, "a\nb", [1, 2, 3, 4], {}, 1j, object, [[1, 2], [3]], np.eye(2)]
    ):
        yield f"Table: a cell of {name}", Folder(
            lambda f, v=value: dc.Table(f / "a.csv", comm=COMM).write(x=v)
        )

    def columns(f):
        table = dc.Table(f / "a.csv", comm=COMM)
        table.write(a=1)
        table.write(b=1)

    yield "Table: other columns", Folder(columns)
    yield "Table: no columns", Folder(lambda f: dc.Table(f / "a.csv", comm=COMM).write())
    pictures = {
        "pressure": plot.pressure,
        "status": plot.status,
        "bodies": plot.bodies,
        "convergence": plot.convergence,
        "gather_bodies": plot.gather_bodies,
        "gather_pressure": plot.gather_pressure,
        "gather_friction": plot.gather_friction,
    }
    for name, f in pictures.items():
        for label, value in told(["pair", 3]):
            yield f"plot.{name}({label})", lambda f=f, v=value: f(v)
    yield "plot.pressure before the solve", lambda: plot.pressure(scene().pair())
    yield "plot.bodies to no folder", lambda: plot.bodies(scene().u, "/proc/none/a.png")
    yield "plot.bodies of an unknown format", Folder(lambda f: plot.bodies(scene().u, f / "a.doc"))
    yield "plot.bodies: field = 3", lambda: plot.bodies(scene().u, field=3)
    yield "plot.history of two lengths", lambda: plot.history([1, 2, 3], {"a": [1, 2]})
    yield "plot.history of text", lambda: plot.history(["a"], {"a": ["b"]})
