# SPDX-License-Identifier: MIT
"""Meshes by gmsh: read on any ranks, and good for contact; the demos that take a user's mesh."""

import runpy
import sys
from pathlib import Path

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
DEMOS = Path(__file__).parent.parent / "demos"


@pytest.fixture
def folder(tmp_path):
    return COMM.bcast(tmp_path)


def write(file, size, quadrilaterals=False, groups=True):
    """The bodies of demos/ironing.py, by gmsh on rank 0."""
    if COMM.rank == 0:
        import gmsh

        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        geo = gmsh.model.geo
        ends = [(0.2, 4.5), (1.4, 4.5), (1.4, 5.4), (0.2, 5.4), (0.8, 4.95)]
        points = [geo.addPoint(*x, 0) for x in ends]
        arc = geo.addCircleArc(points[0], points[4], points[1])
        sides = [geo.addLine(points[i], points[(i + 1) % 4]) for i in (1, 2, 3)]
        corners = [geo.addPoint(*x, 0) for x in ((0, 0), (12, 0), (12, 4), (0, 4))]
        edges = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        bodies = [geo.addPlaneSurface([geo.addCurveLoop(c)]) for c in ([arc, *sides], edges)]
        geo.synchronize()
        if groups:
            for tag, body in enumerate(bodies, start=1):
                gmsh.model.addPhysicalGroup(2, [body], tag)
            for tag, curve in ((1, sides[1]), (2, edges[0]), (5, arc), (6, edges[2])):
                gmsh.model.addPhysicalGroup(1, [curve], tag)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.RecombineAll", quadrilaterals)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(file))
        gmsh.finalize()
    COMM.barrier()
    return file


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_tags_are_those_of_the_groups(folder, cell):
    file = write(folder / "bodies.msh", 0.4, cell == "quadrilateral")
    mesh, cells, facets = meshes.read_msh(COMM, file, 2)
    assert mesh.topology.cell_name() == cell and mesh.geometry.dim == 2
    one = fem.Constant(mesh, 1.0)
    dx, ds = ufl.dx(subdomain_data=cells, domain=mesh), ufl.ds(subdomain_data=facets, domain=mesh)

    def measure(form):
        return compat.assemble_scalar(COMM, compat.form(form))

    assert measure(one * dx(2)) == pytest.approx(48)
    assert measure(one * dx(1)) == pytest.approx(1.2 * 0.9 + 0.22, abs=0.05)
    assert measure(one * ds(1)) == pytest.approx(1.2)
    assert measure(one * ds(6)) == pytest.approx(12)
    radius, angle = 0.75, 2 * np.arcsin(0.6 / 0.75)
    assert measure(one * ds(5)) == pytest.approx(radius * angle, rel=0.02)
    V = compat.vector_space(mesh, 1)
    arc = dc.Surface(fem.Function(V), facets, 5)
    assert COMM.allreduce(len(arc.id)) > 2


def run(monkeypatch, name, file, options=""):
    """What a demo leaves, on a mesh."""
    demo = DEMOS / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(demo), "--mesh", str(file), *options.split()])
    return runpy.run_path(str(demo), run_name="__main__")


def test_a_mesh_of_the_users_in_a_demo(folder, monkeypatch):
    """Ironing on a mesh by gmsh keeps what the demo asserts: forces in the band of the literature."""
    file = write(folder / "bodies.msh", 0.25, True)
    ways = run(monkeypatch, "ironing", file, "--way 0.4")["ways"]
    assert ways[1][-1][0] == pytest.approx(0.4) and ways[1][-1][3] < -268


def test_files_that_are_none(folder):
    with pytest.raises(dc.InputError if COMM.rank == 0 else dc.ContactError, match="no file"):
        meshes.read_msh(COMM, folder / "none.msh", 2)
    if COMM.rank == 0:
        (folder / "bad.msh").write_text("nonsense")
    COMM.barrier()
    with pytest.raises(dc.ContactError, match="bad.msh"):
        meshes.read_msh(COMM, folder / "bad.msh", 2)
    file = write(folder / "plain.msh", 1.0, groups=False)
    with pytest.raises(dc.ContactError, match="physical groups"):
        meshes.read_msh(COMM, file, 2)


def test_groups_that_are_missing(folder):
    """They are named, and those that are there."""
    file = write(folder / "bodies.msh", 1.0)
    mesh, *_ = meshes.read_msh(COMM, file, 2, cells={1: "indenter"}, facets={5: "arc", 6: "slab"})
    assert mesh.topology.dim == 2
    with pytest.raises(dc.ContactError) as caught:
        meshes.read_msh(COMM, file, 2, cells={2: "slab", 5: "ring"}, facets={7: "left", 6: "top"})
    said = str(caught.value)
    assert isinstance(caught.value, dc.InputError) and (COMM.rank > 0 or "bodies.msh" in said)
    assert "no physical surface 5 (ring), no physical curve 7 (left); found:" in said
    assert "physical surfaces 1, 2; physical curves 1, 2, 5, 6" in said
    for groups in ([5, 6], {"slave": 5}, {True: "slave"}, 5):
        with pytest.raises(dc.ContactError, match="dictionary"):
            meshes.read_msh(COMM, file, 2, facets=groups)


# -- the demos ---------------------------------------------------------------------------------

GMSH = {"interval": 1, "triangle": 2, "quadrilateral": 3, "hexahedron": 5}  # its types of elements
ORDER = {2: [0, 1], 3: [0, 1, 2], 4: [0, 1, 3, 2], 8: [0, 1, 3, 2, 4, 5, 7, 6]}  # its corners


def write_bodies(file, bodies, places):
    """A .msh file by rank 0: body i is group i + 1; facets as for meshes.tag_facets."""
    rows, points = [], []
    for number, body in enumerate(bodies):
        dim, shift = body.points.shape[1], 1 + sum(map(len, points))
        kind = getattr(basix.CellType, body.cell)
        corners = np.zeros((3, len(body.points)))
        corners[:dim] = body.points.T
        points.append(corners.T)
        rows += [
            (GMSH[body.cell], number + 1, shift + cell[ORDER[len(cell)]]) for cell in body.cells
        ]
        facets = [body.cells[:, facet] for facet in basix.topology(kind)[dim - 1]]
        facet = "interval" if dim == 2 else "quadrilateral"
        for tag, chosen in places.items():
            where, owner = chosen if isinstance(chosen, tuple) else (chosen, number)
            for nodes in facets if owner == number else ():
                found = nodes[where(corners)[nodes].all(axis=1)]
                rows += [(GMSH[facet], tag, shift + row[ORDER[len(row)]]) for row in found]
    if COMM.rank == 0:
        lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes"]
        points = np.concatenate(points)
        lines += [str(len(points)), *(f"{i} {x} {y} {z}" for i, (x, y, z) in enumerate(points, 1))]
        lines += ["$EndNodes", "$Elements", str(len(rows))]
        for i, (kind, tag, nodes) in enumerate(rows, 1):
            lines.append(f"{i} {kind} 2 {tag} {tag} {' '.join(map(str, nodes))}")
        file.write_text("\n".join([*lines, "$EndElements", ""]))
    COMM.barrier()
    return file


def at(i, value):
    return lambda x: np.isclose(x[i], value)


def on(height):
    return lambda x: np.isclose(x[1], height(x[0]))


def between(width, lower, upper, power=1.0):
    """Takes the square to the part of the plane between two curves, finer at x = 0 and below."""

    def shape(x):
        s, t = width * np.sign(x[:, 0]) * np.abs(x[:, 0]) ** power, x[:, 1] ** power
        return np.column_stack([s, (1 - t) * lower(s) + t * upper(s)])

    return shape


def circle(R):
    """The lower side of one above the origin."""
    return lambda x: R - np.sqrt(R**2 - x**2)


def flat(height):
    return lambda x: np.full_like(x, height)


def two_blocks():
    bodies = [meshes.grid((7, 3), (-1, 0), (1, 1)), meshes.grid((5, 3), (-1, -1), (1, 0))]
    return bodies, {5: (at(1, 0), 0), 6: (at(1, 0), 1), 1: at(1, 1), 2: at(1, -1)}


def two_cubes():
    upper = meshes.grid((4, 4, 2), (0, 0, 0), (1, 1, 1), cell="hexahedron")
    lower = meshes.grid((3, 3, 2), (0, 0, -1), (1, 1, 0), cell="hexahedron")
    return [upper, lower], {5: (at(2, 0), 0), 6: (at(2, 0), 1), 1: at(2, 1), 2: at(2, -1)}


def rounds(R, width, least, n):
    """A body with a round lower side on its mirror image, for s from `least` (−1, or 0: the axis) to 1."""
    shape = between(width, circle(R), flat(R), 2.0)
    bodies = [
        meshes.grid(n, (least, 0), (1, 1), lambda x, s=s: shape(x) * (1, s), "triangle")
        for s in (1, -1)
    ]
    low = lambda x: np.isclose(np.abs(x[1]), circle(R)(x[0]))  # noqa: E731
    places = {5: (low, 0), 6: (low, 1), 1: at(1, R), 2: at(1, -R), 3: at(0, 0)}
    return bodies, {tag: places[tag] for tag in (5, 6, 1, 2, *((3,) if least == 0 else ()))}


def wedge():
    shape = between(2, lambda x: 0.1 * x, flat(1))
    return [meshes.grid((8, 4), mapping=shape)], {5: on(lambda x: 0.1 * x), 1: at(1, 1)}


def crossed():
    """The bodies of demos/drag_and_turn.py, coarse."""
    block = lambda x: np.column_stack(
        [x[:, :2], circle(5)(x[:, 0]) * (1 - x[:, 2]) + 0.6 * x[:, 2]]
    )
    slab = lambda x: np.column_stack(
        [x[:, :2], -circle(5)(x[:, 1]) * (1 + x[:, 2]) + 0.5 * x[:, 2]]
    )
    bodies = [
        meshes.grid((6, 6, 2), (-0.8, -0.8, 0), (0.8, 0.8, 1), block, "hexahedron"),
        meshes.grid((8, 6, 2), (-1.1, -0.9, -1), (1.3, 0.9, 0), slab, "hexahedron"),
    ]
    lower = lambda x: np.isclose(x[2], circle(5)(x[0]))  # noqa: E731
    upper = lambda x: np.isclose(x[2], -circle(5)(x[1]))  # noqa: E731
    return bodies, {5: (lower, 0), 6: (upper, 1), 1: at(2, 0.6), 2: at(2, -0.5)}


def sheet():
    places = {5: at(1, 1), 6: at(1, 0), 1: at(0, 0), 2: at(0, 59.18)}
    return [meshes.grid((20, 2), (0, 0), (59.18, 1))], places


def steel():
    # the upper side is where the elements are small
    shape = between(8, flat(0), flat(-8), 1.7)
    return [meshes.grid((12, 12), mapping=shape)], {5: at(1, 0), 1: at(0, 0), 2: at(1, -8)}


def rubber():
    return [meshes.grid((8, 6), (0, 0), (10, 10))], {5: at(1, 10), 1: at(1, 0), 2: at(0, 0)}


def half_sphere():
    """A quarter of a disk; the far sides of the square are the arc."""

    def shape(x):
        return 50 * x * np.sqrt(1 - x[:, ::-1] ** 2 / 2)

    arc = lambda x: np.isclose(np.hypot(x[0], x[1]), 50)  # noqa: E731
    return [meshes.grid((8, 8), mapping=shape)], {5: arc, 1: at(1, 0), 2: at(0, 0)}


# Of each demo: the mesh, options, what rank 0 has, and the value to a relative tolerance. It is exact for
# blocks, cubes and the wedge, the load of cattaneo, else from the demo's own mesh.
USERS = {
    "two_blocks": (two_blocks, "", lambda d: d["force"][1], 2 * 1.2e5, 0.002),
    "two_cubes": (two_cubes, "", lambda d: d["force"], 1e5, 1e-3),
    "hertz": (lambda: rounds(50, 40, 0, (12, 6)), "", lambda d: d["large"][0][2], 6.60e5, 0.1),
    "cattaneo": (lambda: rounds(8, 6, -1, (24, 6)), "", lambda d: d["shear"][-1], 0.936, 1e-3),
    "wedge": (wedge, "", lambda d: d["rows"][-1][1], 0.631579, 1e-5),
    "drag_and_turn": (crossed, "", lambda d: d["rows"][-1][1], 13.65, 0.1),
    "sheet": (sheet, "--travel 5", lambda d: d["with_friction"].rows[-1, 1], 2410.0, 0.03),
    "indentation": (steel, "", lambda d: d["depth"].max(), 0.115, 0.1),
    "rubber": (rubber, "", lambda d: d["fine"], 171.0, 0.02),
    "elastoplastic_sphere": (half_sphere, "", lambda d: d["forces"]["mesh"][-1], 3.72e6, 0.1),
}

# on several ranks without those of many steps
QUICK = ("two_blocks", "two_cubes", "hertz", "cattaneo", "wedge")


@pytest.mark.parametrize("name", USERS if COMM.size == 1 else QUICK)
def test_demos_take_the_mesh_of_the_user(folder, monkeypatch, name):
    """They go through all their steps, keep what they assert of every mesh, and have the same force."""
    make, options, measured, value, tolerance = USERS[name]
    file = write_bodies(folder / "mine.msh", *make())
    names = run(monkeypatch, name, file, options)
    if COMM.rank == 0:
        assert measured(names) == pytest.approx(value, rel=tolerance)


@pytest.mark.parametrize("name", (*USERS, "ironing"))
def test_demos_name_groups_that_are_missing(folder, monkeypatch, name):
    """The message tells which, and what there is."""
    cell, counts = "quadrilateral", (1, 1)
    if name in ("two_cubes", "drag_and_turn"):
        cell, counts = "hexahedron", (1, 1, 1)
    file = write_bodies(folder / "mine.msh", [meshes.grid(counts, cell=cell)], {9: at(0, 0)})
    with pytest.raises(dc.InputError, match=r"no physical \w+ \d \(.*found: .* 9\."):
        run(monkeypatch, name, file)
