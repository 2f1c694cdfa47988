# SPDX-License-Identifier: MIT
"""Bad inputs: forms, conditions and solver options; what shows while a problem is solved."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

import dolfinx_contact as dc

from .scene import INF, LAST, MASTER, NAN, NO_NUMBERS, RANK, SLAVE, TOP, kind, scene, solving, told


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
        "of another space": lambda s: ufl.TestFunction(dc.function_space(s.mesh, ("DG", 0)))
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
