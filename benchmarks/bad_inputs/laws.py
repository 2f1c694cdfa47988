# SPDX-License-Identifier: MIT
"""Bad inputs: material laws."""

from __future__ import annotations

import numpy as np
import ufl

import dolfinx_contact as dc
from dolfinx_contact import materials, plasticity

from .scene import INF, NAN, NO_NUMBERS, kind, scene, told


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
