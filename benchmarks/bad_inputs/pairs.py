# SPDX-License-Identifier: MIT
"""Bad inputs: arguments of pairs; targets and rules."""

from __future__ import annotations

import numpy as np

import dolfinx_contact as dc

from .scene import INF, MASTER, NAN, NO_NUMBERS, SLAVE, TOP, kind, scene, told


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
