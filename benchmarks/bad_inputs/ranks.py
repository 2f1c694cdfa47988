# SPDX-License-Identifier: MIT
"""Bad inputs: ranks that do not agree."""

from __future__ import annotations

from dolfinx import fem

import dolfinx_contact as dc
from dolfinx_contact import meshes, plasticity

from .scene import COMM, Folder, MASTER, NAN, RANK, SLAVE, kind, other, put_here, scene, solving


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
