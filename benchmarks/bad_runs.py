# SPDX-License-Identifier: MIT
"""More bad inputs of the campaign (see bad_cases.py): tools, meshes, problems, steps, files, laws,
and ranks that do not agree."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import ufl
from bad_cases import (
    BOTTOM,
    COMM,
    INF,
    LAST,
    MASTER,
    NAN,
    NO_NUMBERS,
    NO_POSITIVE,
    RANK,
    SLAVE,
    TOP,
    Folder,
    kind,
    other,
    put,
    scene,
    told,
)
from dolfinx import fem

import dolfinx_contact as dc
from dolfinx_contact import compat, materials, meshes, plasticity, plot

# -- tools --------------------------------------------------------------------------------------------


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


# -- meshes -------------------------------------------------------------------------------------------

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


# -- problems and their solution ----------------------------------------------------------------------


@kind
def problems():
    def make(**given):
        s = scene()
        options = {name: f(s) if callable(f) else f for name, f in given.items()}
        dc.ContactProblem(**{"F": s.F, "u": s.u, "pairs": [s.pair()], "bcs": s.bcs, **options})

    for name, value in told([None, "F", 3, []]):
        yield f"F = {name}", lambda v=value: make(F=v)
        yield f"u = {name}", lambda v=value: make(u=v)
    du = lambda s: ufl.TrialFunction(s.V)  # noqa: E731
    forms = {
        "bilinear": lambda s: ufl.inner(du(s), s.w) * ufl.dx,
        "a functional": lambda s: ufl.inner(s.u, s.u) * ufl.dx,
        "of another space": lambda s: ufl.TestFunction(fem.FunctionSpace(s.mesh, ("DG", 0)))
        * ufl.dx,
        "of another mesh": lambda s: scene("triangle").F,
        "without u": lambda s: ufl.inner(ufl.as_vector((1.0, 0.0)), s.w) * ufl.dx,
        "two for one u": lambda s: [s.F, s.F],
        "UFL without measure": lambda s: ufl.inner(s.u, s.w),
    }
    for name, f in forms.items():
        yield f"F is {name}", lambda f=f: make(F=f)
    yield "u twice", lambda: make(F=lambda s: [s.F, s.F], u=lambda s: [s.u, s.u])
    for name, value in told([None, "pairs", 3, [None], [5]]):
        yield f"pairs = {name}", lambda v=value: make(pairs=v)
    yield "pairs are surfaces", lambda: make(pairs=lambda s: [s.surface(), s.surface(MASTER)])
    yield "a pair of another problem", lambda: make(pairs=lambda s: [scene().pair()])

    def twice(s):
        pair = s.pair()
        return [pair, pair]

    yield "a pair twice", lambda: make(pairs=twice)
    yield "two slaves of the same nodes", lambda: make(pairs=lambda s: [s.pair(), s.pair()])
    for name, value in told([None, "bcs", 3, [None], ["clamped"], [5]]):
        yield f"bcs = {name}", lambda v=value: make(bcs=v)
    yield "a condition of another space", lambda: make(bcs=lambda s: scene().bcs)
    jacobians = {
        "text": "J",
        "a number": 3,
        "the residual": lambda s: s.F,
        "two rows": lambda s: [[None], [None]],
        "of no forms": lambda s: [["a"]],
        "of another space": lambda s: ufl.derivative(scene("triangle").F, scene("triangle").u),
    }
    for name, f in jacobians.items():
        yield f"J is {name}", lambda f=f: make(J=f)
    for name, value in told(["newton", 3, [dc.Newton()]]):
        yield f"strategy = {name}", lambda v=value: make(strategy=v)
    yield "strategy is a class", lambda: make(strategy=lambda s: dc.Newton)
    for strategy in (dc.Newton, dc.FixedPoint):
        for name, value in told([-1.0, 0.0, 1.0, INF, *NO_NUMBERS]):
            yield f"{strategy.__name__}(rtol={name})", lambda s=strategy, v=value: s(rtol=v)
        for name, value in told([0, -1, 2.5, *NO_NUMBERS]):
            yield f"{strategy.__name__}(max_it={name})", lambda s=strategy, v=value: s(max_it=v)
    for name, value in told([0, -1, 2.5, NAN, "1"]):
        yield f"FixedPoint(max_loops={name})", lambda v=value: dc.FixedPoint(max_loops=v)
    yield "petsc_options: ksp_rtol = small", lambda: solving(
        petsc_options={"ksp_type": "gmres", "ksp_rtol": "small"}
    )
    for name, value in told(["ksp_type", 3, ["pc_type", "lu"], {3: "lu"}, {"ksp_type": object()}]):
        yield f"petsc_options = {name[:40]}", lambda v=value: solving(petsc_options=v)
    wrong_options = {
        "ksp_type": "conjugate",
        "pc_type": "multi",
        "snes_type": "fast",
        "pc_factor_mat_solver_type": "mump",
        "snes_max_it": "many",
        "pc_factor_shift_type": "up",
        "snes_rtol": "-1",
    }
    for name, value in wrong_options.items():
        yield f"petsc_options: {name} = {value}", lambda n=name, v=value: solving(
            petsc_options={"ksp_type": "preonly", "pc_type": "lu", n: v}
        )
    for name, value in told(["J2", 3, [None], ["steel"]]):
        yield f"materials = {name}", lambda v=value: make(materials=v)


def solving(spoil=lambda s: None, pair={}, **options):
    s = scene()
    spoil(s)
    s.problem([s.pair(**pair)], **options).solve()


@kind
def solves():
    def field(value, where=slice(None)):
        def spoil(s):
            s.u.x.array[where] = value

        return spoil

    def moved(value):
        def spoil(s):
            s.moved.x.array[:] = value

        return spoil

    for name, value in told([NAN, INF, -INF, 1e308]):
        yield f"u = {name}", lambda v=value: solving(field(v))
        yield f"a Dirichlet value of {name}", lambda v=value: solving(moved(v))
    yield "u = nan at one node of the last rank", lambda: solving(
        field(NAN, slice(0, 2 if RANK == LAST else 0))
    )

    def loads(value):
        def spoil(s):
            f = fem.Constant(s.mesh, (0.0, value))
            s.F = s.F - ufl.inner(f, s.w) * ufl.ds(subdomain_data=s.tags)(TOP)

        return spoil

    yield "a load of nan", lambda: solving(loads(NAN), pair={})
    yield "a load of inf", lambda: solving(loads(INF), pair={})

    def stiffness(value):
        def spoil(s):
            s.F = fem.Constant(s.mesh, value) * s.F

        return spoil

    for name, value in told([NAN, INF, 0.0]):
        yield f"a stiffness of {name}", lambda v=value: solving(stiffness(v))

    def loose(s):
        loads(-1e-3)(s)
        s.bcs.clear()

    yield "nothing holds the bodies", lambda: solving(loose)

    def unheld(s):
        loads(-1e-3)(s)
        s.bcs.pop(0)

    yield "nothing holds the upper body", lambda: solving(unheld)

    def turned_inside_out(s):
        """A step through the body, and an energy that knows no inverted cells."""
        G = ufl.Identity(2) + ufl.grad(s.u)
        psi = 0.5 * ufl.inner(G, G) - ufl.ln(ufl.det(G)) + ufl.ln(ufl.det(G)) ** 2
        s.F = ufl.derivative(psi * ufl.dx(metadata={"quadrature_degree": 2}), s.u, s.w)
        s.moved.x.array[1::2] = -30.0
        fixed = fem.locate_dofs_topological(s.V, 1, s.tags.find(SLAVE))
        s.bcs.append(fem.dirichletbc(np.zeros(2), fixed, s.V))

    yield "a step that turns cells inside out", lambda: solving(turned_inside_out)

    def inside_out_before(s):
        turned_inside_out(s)
        s.u.x.array[:] = 0
        s.u.interpolate(lambda x: np.array([0 * x[0], -3 * x[1]]))

    yield "cells that are inside out before the solve", lambda: solving(inside_out_before)
    for option in ("rho_n", "rho_t"):
        yield f"{option} = 1e308", lambda o=option: solving(pair={o: 1e308, "friction": 0.3})
    yield "friction = 1e300", lambda: solving(pair={"friction": 1e300})
    results = {
        "resultant": lambda p: p.resultant(),
        "particles": lambda p: p.particles,
        "true_pressure": lambda p: p.true_pressure,
        "friction_resultant": lambda p: p.friction_resultant(),
        "contact_area": lambda p: p.contact_area(),
        "dissipated_energy": lambda p: p.dissipated_energy(),
    }
    for name, ask in results.items():
        yield f"{name} before the solve", lambda ask=ask: ask(scene().pair())
    for name, value in told([None, "pair", 3]):
        yield f"infsup.constant({name})", lambda v=value: dc.infsup.constant(v)
    for name, value in told([0.0, -1.0, NAN, INF, "1"]):
        yield f"infsup.constant(pair, {name})", lambda v=value: dc.infsup.constant(
            scene().pair(), v
        )
    yield "infsup.constant where nothing has a target", lambda: dc.infsup.constant(
        scene().pair(target=dc.Proximity(radius=1e-9), master=dc.RigidPlane((0, -5), (0, 1)))
    )


# -- steps and checkpoints ----------------------------------------------------------------------------


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


# -- results ------------------------------------------------------------------------------------------


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
        writer(s, f, u=fem.Function(fem.FunctionSpace(s.mesh, ("Lagrange", 1))))

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


# -- laws ---------------------------------------------------------------------------------------------


@kind
def laws():
    J2, Swift = plasticity.J2, plasticity.Swift
    for name, value in told([0.0, -1.0, INF, *NO_NUMBERS]):
        yield f"J2: E = {name}", lambda v=value: J2(scene().u, v, 0.3)
        yield f"lame: E = {name}", lambda v=value: materials.lame(v, 0.3)
        yield f"Swift: K = {name}", lambda v=value: Swift(v, 1e-4, 0.2)
        yield f"Linear: yield_stress = {name}", lambda v=value: plasticity.Linear(v)
        yield f"Voce: b = {name}", lambda v=value: plasticity.Voce(1.0, 1.0, v)
    for name, value in told([0.5, -1.0, 0.7, *NO_NUMBERS]):
        yield f"J2: nu = {name}", lambda v=value: J2(scene().u, 1.0, v)
        yield f"lame: nu = {name}", lambda v=value: materials.lame(1.0, v)
    for name, value in told([-1, 1.5, NAN, "2", None]):
        yield f"J2: quadrature_degree = {name}", lambda v=value: J2(
            scene().u, 1.0, 0.3, quadrature_degree=v
        )
    for name, value in told(["plane stress", "3D", 2, ["3D"]]):
        yield f"J2: kind = {name}", lambda v=value: J2(scene().u, 1.0, 0.3, kind=v)
    hardenings = {
        "None": None,
        "text": "Swift",
        "a class": Swift,
        "a function that returns None": lambda x: None,
        "a function without slope": lambda x: x + 1,
        "a function of another shape": lambda x: (x + 1, 1.0),
        "a function that yields at 0": lambda x: (x, x + 1),
        "a function that returns nan": lambda x: (x * NAN, x),
    }
    for name, value in hardenings.items():
        yield f"J2: hardening is {name}", lambda v=value: J2(scene().u, 1.0, 0.3, v)
    for name, value in told([None, "u", 3]):
        yield f"J2: u = {name}", lambda v=value: J2(v, 1.0, 0.3)
    yield "J2: F of 4 components", lambda: deformed(lambda u: ufl.as_vector([1, 2, 3, u[0]]))
    yield "J2: F is a number", lambda: deformed(lambda u: 3)

    def deformed(F):
        u = scene().u
        J2(u, 1.0, 0.3, F=F(u))

    for name, value in told([[10**6], [-1], ["a"], 1.5, [0.5]]):
        yield f"J2: cells = {name}", lambda v=value: J2(scene().u, 1.0, 0.3, cells=v)
    tables = {
        "one point": ([0], [1]),
        "strains that fall": ([0, 1, 0.5], [1, 2, 3]),
        "stresses that fall": ([0, 1], [2, 1]),
        "not from 0": ([1, 2], [1, 2]),
        "nan": ([0, NAN], [1, 2]),
        "an infinite stress": ([0, 1], [1, INF]),
        "text": (["a", "b"], [1, 2]),
        "two lengths": ([0, 1], [1, 2, 3]),
        "None": (None, None),
    }
    for name, value in tables.items():
        yield f"Tabulated: {name}", lambda v=value: plasticity.Tabulated(*v)
    for name, value in told(["hexagonal", "3D", 3]):
        yield f"small_strain: geometry = {name}", lambda v=value: materials.small_strain(
            scene().u, 1.0, 1.0, v
        )
    for name, value in told([None, "u", 3]):
        yield f"deformation_gradient({name})", lambda v=value: materials.deformation_gradient(v)

    class Law:
        def update(self, F):
            return self.answer(F)

        def commit(self):
            pass

        restore = commit

    def law(answer=lambda F: (F, np.zeros((*F.shape, 2, 2))), F=None, degree=2, **missing):
        made = Law() if not missing else object()
        if not missing:
            made.answer = answer
        u = scene().u
        dc.QuadratureLaw(ufl.grad(u) if F is None else F(u), made, degree)

    answers = {
        "None": lambda F: None,
        "one array": lambda F: F,
        "text": lambda F: ("a", "b"),
        "P of another shape": lambda F: (F[:1], np.zeros((*F.shape, 2, 2))),
        "a tangent of another shape": lambda F: (F, F),
        "complex numbers": lambda F: (F + 1j, np.zeros((*F.shape, 2, 2))),
        "objects": lambda F: (F.astype(object), np.full((*F.shape, 2, 2), None)),
    }
    for name, answer in answers.items():
        yield f"a law that returns {name}", lambda a=answer: law(a)
    yield "a law that is none", lambda: law(missing=True)
    yield "a law of no Function", lambda: law(F=lambda u: ufl.Identity(2))
    yield "a law of a number", lambda: law(F=lambda u: 3)
    for name, value in told([-1, 0.5, NAN, "2", None]):
        yield f"QuadratureLaw: quadrature_degree = {name}", lambda v=value: law(degree=v)

    def stray(given):
        """The stress of a law in a residual without the law, or the other way round."""
        s = scene()
        sheet = J2(s.u, 1.0, 0.3)
        F = ufl.inner(sheet.P, ufl.grad(s.w)) * sheet.dx if given else s.F
        dc.ContactProblem(F, s.u, [s.pair()], bcs=s.bcs, materials=[] if given else [sheet])

    yield "a law that is not among the materials", lambda: stray(True)
    yield "a material that is in no residual", lambda: stray(False)


# -- ranks that do not agree --------------------------------------------------------------------------


@kind
def ranks():
    differing = {
        "friction": (0.3, 0.4),
        "no friction": (0.0, 0.4),
        "friction of nan": (0.3, NAN),
        "target": (dc.Smooth(), dc.Proximity()),
        "radius": (dc.Smooth(radius=1.0), dc.Smooth(radius=2.0)),
        "normals": ("facet", "interpolated"),
        "integration": (dc.Simpson(1), dc.Gauss(3)),
        "level": (dc.Simpson(1), dc.Simpson(2)),
        "pressure_space": (("Lagrange", 1), ("DG", 0)),
        "rho_n": (1.0, 2.0),
        "crease": (60.0, 30.0),
        "initial_contact": (1e-3, 1e-2),
        "augmented": (False, True),
        "slip": ("convected", "increment"),
        "axisymmetric": (False, True),
    }
    options = {
        "no friction": "friction",
        "friction of nan": "friction",
        "radius": "target",
        "level": "integration",
    }
    for name, (usual, value) in differing.items():
        option = options.get(name, name)
        more = {"target": dc.Proximity()} if option == "normals" else {}
        yield f"ContactPair: {name}", lambda o=option, u=usual, v=value, m=more: scene().pair(
            **m, **{o: other(v, u)}
        )
    yield "Surface: tags", lambda: scene().surface(other(MASTER, SLAVE))
    yield "Surface: an unknown tag", lambda: scene().surface(other(99, SLAVE))
    yield "Surface: no tags", lambda: dc.Surface(scene().u, other(None, scene().tags), SLAVE)
    yield "ContactPair: master of another kind", lambda: scene().pair(
        other(dc.RigidPlane((0, 0), (0, 1)), None)
    )
    yield "ContactPair: place of the tool", lambda: scene().pair(
        dc.RigidPlane((0, other(0.1, 0.0)), (0, 1))
    )
    yield "ContactPair: number of tools", lambda: scene().pair(
        [dc.RigidPlane((0, i), (0, 1)) for i in range(other(2, 1))]
    )
    yield "ContactPair: target of no kind", lambda: scene().pair(target=other("near", dc.Smooth()))
    yield "ContactProblem: number of pairs", lambda: (lambda s: s.problem(other([], [s.pair()])))(
        scene()
    )
    yield "ContactProblem: pairs of no kind", lambda: (
        lambda s: s.problem(other("pairs", [s.pair()]))
    )(scene())
    yield "ContactProblem: strategy", lambda: scene().problem(
        strategy=other(dc.FixedPoint(), dc.Newton())
    )
    yield "ContactProblem: rtol", lambda: scene().problem(
        strategy=dc.Newton(rtol=other(1e-3, 1e-8))
    )
    yield "ContactProblem: petsc_options", lambda: solving(
        petsc_options={"ksp_type": other("gmres", "preonly")}
    )
    yield "ContactProblem: petsc_options that do not exist", lambda: solving(
        petsc_options={"ksp_type": other("fast", "preonly")}
    )
    yield "ContactProblem: number of conditions", lambda: (
        lambda s: s.problem(bcs=s.bcs[: other(1, 2)])
    )(scene())

    def moving(move):
        s, tool = scene(), dc.RigidPlane((0, 0), (0, 1))
        tool.push((0, 1e-3), along=(0, 1))
        problem = s.problem([s.pair(tool)])
        move(tool)
        problem.solve()

    yield "a tool that moves elsewhere", lambda: moving(lambda t: t.move((other(1.0, 0.0), 0)))
    yield "a tool that turns otherwise", lambda: moving(lambda t: t.move(rotation=other(0.1, 0.0)))
    yield "a tool with another load", lambda: moving(lambda t: t.push((0, other(2e-3, 1e-3))))
    usual = {"end": 1.0, "step": 0.5, "min_step": 1e-3, "max_step": 0.8}
    for name, value in usual.items():
        yield f"LoadStepping: {name}", lambda n=name, v=value: scene().stepping(
            **{**usual, n: other(1.1 * v, v)}
        )
    yield "LoadStepping: end of nan", lambda: scene().stepping(end=other(NAN, 1.0))
    yield "LoadStepping: apply of no kind", lambda: scene().stepping(other(None, lambda t: None))
    yield "Writer: time", Folder(lambda f: dc.Writer(f / "a", scene().u).write(other(2.0, 1.0)))
    yield "Writer: time of text", Folder(
        lambda f: dc.Writer(f / "a", scene().u).write(other("x", 1.0))
    )
    yield "Writer: fields", Folder(
        lambda f: (
            lambda s: dc.Writer(f / "a", s.u, fields=other([], [fem.Function(s.V, name="a")]))
        )(scene())
    )
    yield "Table: columns", Folder(
        lambda f: dc.Table(f / "a.csv", comm=COMM).write(**{other("b", "a"): 1.0})
    )
    yield "J2: E", lambda: plasticity.J2(scene().u, other(2.0, 1.0), 0.3)
    yield "J2: E of nan", lambda: plasticity.J2(scene().u, other(NAN, 1.0), 0.3)
    yield "J2: quadrature_degree", lambda: plasticity.J2(
        scene().u, 1.0, 0.3, quadrature_degree=other(3, 2)
    )
    yield "read_msh: no such file on rank 0", Folder(
        lambda f: meshes.read_msh(COMM, f / "none.msh" if RANK == 0 else put_here(f), 2)
    )
    yield "infsup.constant: h", lambda: dc.infsup.constant(scene().pair(), other(NAN, 1.0))


def put_here(folder):
    path = Path(folder) / f"{RANK}.msh"
    path.write_text(GOOD)
    return path
