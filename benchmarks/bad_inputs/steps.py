# SPDX-License-Identifier: MIT
"""Bad inputs: load steps and checkpoints."""

from __future__ import annotations

import h5py

import dolfinx_contact as dc

from .scene import COMM, Folder, INF, NAN, RANK, kind, put, scene, told


@kind
def steps():
    for name in ("end", "step", "min_step", "max_step"):
        for label, value in told([0.0, -1.0, NAN, INF, "1", 1j, [1.0]]):
            yield f"{name} = {label}", lambda n=name, v=value: scene().stepping(**{n: v})
    yield "min_step above step", lambda: scene().stepping(min_step=2.0)
    yield "max_step below step", lambda: scene().stepping(max_step=0.5)
    yield "progress = 'no'", lambda: scene().stepping(progress="no")
    for name, value in told([None, "problem", 3]):
        yield f"problem = {name}", lambda v=value: dc.LoadStepping(v, lambda t: None)
    for name, value in told([None, "apply", 3]):
        yield f"apply = {name}", lambda v=value: scene().stepping(v)

    def loaded(value):
        s = scene()

        def apply(t):
            s.moved.x.array[1::2] = value

        list(s.stepping(apply))

    yield "apply sets nan", lambda: loaded(NAN)
    yield "apply sets inf", lambda: loaded(INF)

    def saving(spoil=lambda stepping: None, name="a.h5", **arrays):
        def call(folder):
            stepping = scene().stepping()
            next(iter(stepping))
            spoil(stepping)
            stepping.save(
                name if name is None or isinstance(name, int) else folder / name, **arrays
            )

        return Folder(call)

    yield "save before a step", Folder(lambda f: scene().stepping().save(f / "a.h5"))
    yield "save to no folder", saving(name="none/a.h5")
    yield "save to a folder", saving(name=".")
    yield "save to None", saving(name=None)
    yield "save to a number", saving(name=3)
    for name, value in told(["text", None, [None], [[1], [1, 2]], {}, object]):
        yield f"save an array that is {name}", saving(x=value)

    def loading(spoil, other=scene):
        def call(folder):
            stepping = scene().stepping()
            next(iter(stepping))
            stepping.save(folder / "a.h5")
            COMM.barrier()
            path = spoil(folder / "a.h5")
            other().stepping().load(path)

        return Folder(call)

    def cut(part):
        def spoil(path):
            if RANK == 0:
                data = path.read_bytes()
                path.write_bytes(data[: int(part * len(data))])
            COMM.barrier()
            return path

        return spoil

    for part in (0.0, 0.01, 0.5, 0.99):
        yield f"load a file of which {part:.0%} is there", loading(cut(part))

    def flipped(where):
        """One bit is another one."""

        def spoil(path):
            if RANK == 0:
                data = bytearray(path.read_bytes())
                data[where(path, data)] ^= 4
                path.write_bytes(data)
            COMM.barrier()
            return path

        return spoil

    def of_table(name):
        def where(path, data):
            with h5py.File(path) as file:
                return file[name].id.get_chunk_info(0).byte_offset + 3

        return where

    places = {
        "what makes it HDF5": lambda path, data: 1,
        "the version of its first part": lambda path, data: 8,
        "the tree of its groups": lambda path, data: data.find(b"TREE"),
        "a heap of names": lambda path, data: data.find(b"HEAP"),
        "the name of a table": lambda path, data: data.find(b"tables"),
        "its figures": lambda path, data: data.find(b'"time": ') + 8,
    }
    tables = ("u0.0/now", "u0.0/places", "pair0.pressure.0/multiplier", "pair0.particles/gap")
    places.update({name: of_table(f"tables/{name}") for name in tables})
    for name, where in places.items():
        yield f"load a file with a flipped bit in {name}", loading(flipped(where))

    def edited(name, change=None):
        def spoil(path):
            if RANK == 0:
                with h5py.File(path, "r+") as file:
                    data = file[name]
                    data = change(data[()]) if change else None
                    del file[name]
                    if data is not None:
                        file[name] = data
            COMM.barrier()
            return path

        return spoil

    for name in ("format", "figures", "tables", "tables/u0.0/now", "tables/pair0.particles"):
        yield f"load a file without {name}", loading(edited(name))
    yield "load a file of another format", loading(edited("format", lambda d: "checkpoint 99"))
    yield "load a file whose figures are no JSON", loading(edited("figures", lambda d: "{"))
    yield "load a file whose figures are none", loading(edited("figures", lambda d: "{}"))
    yield "load a file with places of nan", loading(
        edited("tables/u0.0/places", lambda d: d * NAN)
    )
    yield "load a file with fewer rows", loading(edited("tables/u0.0/now", lambda d: d[:-1]))
    yield "load a file with u of nan", loading(edited("tables/u0.0/now", lambda d: d * NAN))
    yield "load a file with λ of text", loading(
        edited("tables/pair0.pressure.0/multiplier", lambda d: "text")
    )
    yield "load no file", loading(lambda path: path.with_name("b.h5"))
    yield "load a folder", loading(lambda path: path.parent)
    yield "load None", loading(lambda path: None)
    yield "load text", loading(lambda path: put(path, "text"))
    yield "load into another mesh", loading(lambda path: path, lambda: scene("triangle"))
    yield "load into another degree", loading(lambda path: path, lambda: scene(degree=2))
    yield "checkpoint.arrays of no file", lambda: dc.checkpoint.arrays("/no/such/file.h5")
    yield "checkpoint.arrays of text", Folder(lambda f: dc.checkpoint.arrays(put(f / "a", "text")))
    yield "checkpoint.arrays of None", lambda: dc.checkpoint.arrays(None)
