# SPDX-License-Identifier: MIT
"""Rigid tools given by a mesh: files, orientation, bad input, and refinement towards a sphere."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from problems import SLAVE
from rigid import block, pair_and_problem, sphere_mesh
from test_errors import expect

import dolfinx_contact as dc
from dolfinx_contact.gmsh_file import is_running

COMM = MPI.COMM_WORLD
SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
LOOP = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.fixture
def folder(tmp_path_factory):
    """One for all ranks. Collective."""
    return COMM.bcast(tmp_path_factory.mktemp("mesh") if COMM.rank == 0 else None)


def write(path, text):
    if COMM.rank == 0:
        path.write_text(text)
    COMM.Barrier()
    return path


def solved_force(tool, dim, y=-0.05, **options):
    pair, problem = pair_and_problem(block(COMM, dim), tool, **options)
    for part in (0.5, 1.0):
        tool.move([0.0] * (dim - 1) + [part * y])
        problem.solve()
    return tool.force(), pair.pressure.x.array.copy()


# -- refinement ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", (dc.Smooth(), dc.Proximity()), ids=("smooth", "proximity"))
@pytest.mark.parametrize("dim", (2, 3))
def test_a_sphere_is_approached_at_second_order(dim, target):
    """Force and pressures; facets deviate by h²/8R."""
    center = [0.13] + [0.08] * (dim - 2) + [0.82]
    force, pressure = solved_force(dc.RigidSphere(center, 0.8), dim, -0.12)
    errors = []
    for n in (4, 8, 16):
        f, p = solved_force(sphere_mesh(n, center, 0.8), dim, -0.12, target=target)
        off = COMM.allreduce(np.abs(p - pressure).max(initial=0), op=MPI.MAX)
        size = COMM.allreduce(pressure.max(initial=0), op=MPI.MAX)
        errors.append((np.linalg.norm(f - force) / np.linalg.norm(force), off / size))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders[:, 0] > 1.8)
    assert np.all(orders[:, 1] > 1.6)
    assert max(errors[-1]) < 0.03


def test_triangles_and_quadrilaterals_agree():
    """Quadrilaterals cut in two are nearly the same surface."""
    tool = sphere_mesh(8, (0.13, 0.08, 0.82), 0.8)
    c = tool.cells
    cut = dc.RigidMesh(tool.points, np.concatenate([c[:, [0, 1, 2]], c[:, [0, 2, 3]]]))
    forces = [solved_force(t, 3, -0.12)[0] for t in (tool, cut)]
    np.testing.assert_allclose(*forces, atol=0.03 * np.linalg.norm(forces[0]))


@pytest.mark.parametrize("dim", (2, 3))
def test_flip(dim):
    """Cells in the other order, flipped, are the same tool; not flipped they do not face the slave."""
    tool = sphere_mesh(6, [0.13] + [0.08] * (dim - 2) + [0.82], 0.8)
    turned = tool.cells[:, ::-1]
    force, _ = solved_force(tool, dim)
    same, _ = solved_force(dc.RigidMesh(tool.points, turned, flip=True), dim)
    np.testing.assert_allclose(same, force, atol=1e-8 * np.linalg.norm(force))
    none, _ = solved_force(dc.RigidMesh(tool.points, turned), dim)
    np.testing.assert_array_equal(none, 0 * force)


# -- files --------------------------------------------------------------------------------------------


def stl(points, cells):
    lines = ["solid tool"]
    for c in cells:
        a, b, d = points[c]
        n = np.cross(b - a, d - a)
        lines += ["facet normal %g %g %g" % tuple(n / np.linalg.norm(n)), "outer loop"]
        lines += ["vertex %.16g %.16g %.16g" % tuple(p) for p in (a, b, d)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid tool", ""])


def msh(points, blocks):
    """MSH 2.2; blocks: gmsh's type of element, physical group, cells."""
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    nodes = [f"{i + 1} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(points.tolist())]
    cells = [
        f"{kind} 2 {tag} {tag} " + " ".join(map(str, np.asarray(c) + 1))
        for kind, tag, block_ in blocks
        for c in block_
    ]
    cells = [f"{i + 1} {text}" for i, text in enumerate(cells)]
    return "\n".join(
        ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
        + ["$Nodes", str(len(nodes)), *nodes, "$EndNodes"]
        + ["$Elements", str(len(cells)), *cells, "$EndElements", ""]
    )


def corners(tool):
    """The cells' corners as points, each cell from its least one on, in no order."""
    out = []
    for c in tool.points[tool.cells]:
        rows = [tuple(np.round(p, 12) + 0.0) for p in c]
        first = rows.index(min(rows))
        out.append(tuple(rows[first:] + rows[:first]) if len(rows) > 2 else tuple(rows))
    return sorted(out)


def same_everywhere(tool):
    assert len(set(COMM.allgather((tool.points.tobytes(), tool.cells.tobytes())))) == 1


def test_stl(folder):
    """Corners are merged, and the turn of the triangles kept."""
    path = write(folder / "tool.stl", stl(TETRAHEDRON, FACES))
    tool = dc.RigidMesh.read(path, COMM)
    assert len(tool.points) == 4 and corners(tool) == corners(dc.RigidMesh(TETRAHEDRON, FACES))
    same_everywhere(tool)
    assert dc.RigidMesh.read(path, COMM, flip=True).flip


def test_stl_of_a_sphere_acts_as_the_mesh(folder):
    mesh = sphere_mesh(6, (0.13, 0.08, 0.82), 0.8)
    c = mesh.cells
    mesh = dc.RigidMesh(mesh.points, np.concatenate([c[:, [0, 1, 2]], c[:, [0, 2, 3]]]))
    tool = dc.RigidMesh.read(write(folder / "s.stl", stl(mesh.points, mesh.cells)), COMM)
    assert len(tool.points) == len(mesh.points)
    a, b = solved_force(mesh, 3)[0], solved_force(tool, 3)[0]
    np.testing.assert_allclose(b, a, atol=1e-6 * np.linalg.norm(a))  # STL in single precision


def test_msh(folder):
    """Lines in a plane, triangles, quadrilaterals; physical groups choose among them."""
    path = write(folder / "square.msh", msh(SQUARE, [(1, 7, LOOP[:2]), (1, 8, LOOP[2:])]))
    whole = dc.RigidMesh.read(path, COMM)
    assert whole.dim == 2 and corners(whole) == corners(dc.RigidMesh(SQUARE, LOOP))
    for tags, cells in ((7, LOOP[:2]), ([8], LOOP[2:]), ((7, 8), LOOP)):
        part = dc.RigidMesh.read(path, COMM, tags=tags)
        assert corners(part) == corners(dc.RigidMesh(SQUARE, cells))
        same_everywhere(part)

    blocks = [(2, 1, FACES[:3]), (2, 2, FACES[3:]), (1, 5, [[0, 1]])]
    path = write(folder / "tetrahedron.msh", msh(TETRAHEDRON, blocks))
    assert corners(dc.RigidMesh.read(path, COMM)) == corners(dc.RigidMesh(TETRAHEDRON, FACES))
    part = dc.RigidMesh.read(path, COMM, tags=1)
    assert corners(part) == corners(dc.RigidMesh(TETRAHEDRON, FACES[:3]))

    cube = sphere_mesh(1, (0, 0, 0), 1.0)
    path = write(folder / "cube.msh", msh(cube.points, [(3, 1, cube.cells)]))
    assert corners(dc.RigidMesh.read(path, COMM)) == corners(cube)


def test_gmsh_stays_as_it_was(folder):
    """A session of the user's goes on with its model; without one there is none afterwards."""
    import gmsh

    path = write(folder / "tool.stl", stl(TETRAHEDRON, FACES))
    dc.RigidMesh.read(path, COMM)
    assert not is_running(gmsh)
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        gmsh.model.geo.addPoint(0, 0, 0)
        gmsh.model.geo.synchronize()
        dc.RigidMesh.read(path, COMM)
        with pytest.raises(dc.InputError):
            dc.RigidMesh.read(write(folder / "bad.msh", "nonsense"), COMM)
        assert (
            gmsh.model.getCurrent() == "mine" and gmsh.model.list().count("dolfinx_contact") == 0
        )
        assert len(gmsh.model.getEntities(0)) == 1
    finally:
        gmsh.finalize()


def test_bad_files(folder):
    read = dc.RigidMesh.read
    expect(dc.InputError, lambda: read(folder / "none.stl", COMM), "no file", "none.stl")
    bad = write(folder / "bad.msh", "nonsense")
    expect(dc.InputError, lambda: read(bad, COMM), "bad.msh")
    unknown = write(folder / "bad.xyz", "nonsense")
    expect(dc.InputError, lambda: read(unknown, COMM), "bad.xyz")
    path = write(folder / "square.msh", msh(SQUARE, [(1, 7, LOOP)]))
    expect(dc.InputError, lambda: read(path, COMM, tags=9), "no triangles", "groups 9")
    points = np.vstack([SQUARE, [[0.0, 0.0]]])
    path = write(folder / "points.msh", msh(points, [(15, 1, [[0]])]))
    expect(dc.InputError, lambda: read(path, COMM), "no triangles")
    cube = sphere_mesh(1, (0, 0, 0), 1.0)
    cells = [(3, 1, cube.cells[1:]), (2, 1, [cube.cells[0][:3], cube.cells[0][[0, 2, 3]]])]
    path = write(folder / "mixed.msh", msh(cube.points, cells))
    expect(dc.InputError, lambda: read(path, COMM), "triangles and quadrilaterals", "one kind")
    middle = np.vstack([SQUARE, 0.5 * (SQUARE + np.roll(SQUARE, -1, axis=0))])
    path = write(folder / "curved.msh", msh(middle, [(8, 1, [[0, 1, 4], [1, 2, 5]])]))
    expect(dc.InputError, lambda: read(path, COMM), "first-order")


# -- input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points, cells, parts",
    (
        (SQUARE, FACES, ("(4, 2)", "(4, 3)", "lines (m, 2)")),
        (SQUARE, LOOP.astype(float), ("shape",)),
        (SQUARE, np.zeros((0, 2), dtype=int), ("(0, 2)",)),
        (SQUARE.ravel(), LOOP, ("(8,)",)),
        ("points", LOOP, ("points",)),
        (SQUARE * np.nan, LOOP, ("finite points",)),
        (SQUARE, LOOP + 1, ("from 1 to 4 for 4 points",)),
        (SQUARE, LOOP - 1, ("from -1 to 2",)),
        # one line, or one triangle, turns against its neighbours
        (SQUARE, np.vstack([LOOP[:3], LOOP[3:, ::-1]]), ("turn against", "reorient")),
        (TETRAHEDRON, np.vstack([FACES[:3], FACES[3:, ::-1]]), ("turn against", "reorient")),
        # three at a point, three at an edge, the same cell twice
        (SQUARE, [[0, 1], [1, 2], [3, 1]], ("more than two",)),
        (
            np.vstack([TETRAHEDRON, [1, 1, 1]]),
            [[0, 1, 2], [1, 0, 3], [0, 1, 4]],
            ("more than two",),
        ),
        (SQUARE, [[0, 1], [0, 1]], ("more than two cells",)),
        (SQUARE, [[0, 1], [1, 1]], ("cell 1", "coincide")),
        (TETRAHEDRON[[0, 1, 2, 0]], [[0, 1, 2], [0, 2, 3]], ("cell 1", "[0, 2, 3]", "coincide")),
    ),
)
def test_bad_meshes(points, cells, parts):
    expect(dc.InputError, lambda: dc.RigidMesh(points, np.asarray(cells)), *parts)


def test_open_surfaces_are_fine():
    """A part of a surface has ends; beyond them there is no target."""
    x = np.linspace(-0.4, 0.4, 5)
    tool = dc.RigidMesh(  # looks down: the material, above, is on the left
        np.column_stack([x, 0 * x]), np.column_stack([np.arange(4), np.arange(1, 5)])
    )
    pair, problem = pair_and_problem(block(COMM, 2), tool, target=dc.Proximity())
    for y in (-0.02, -0.04):
        tool.move((0, y))
        problem.solve()
    p = pair.particles
    closed = p.status != "open"
    assert tool.force()[1] > 1 and COMM.allreduce(closed.sum()) > 5
    # half of a facet beyond the ends, and within a facet of the slave
    assert np.all(np.abs(p.position[closed, 0]) < 0.4 + 0.5 * 0.2 + 0.17)
    far = np.abs(p.position[:, 0]) > 0.6
    assert np.all(np.isinf(p.gap[far]))


def test_what_is_not_a_mesh():
    slave = block(COMM, 2).surface(SLAVE)
    solid = sphere_mesh(2, (0, 0, 0), 1.0)
    expect(dc.InputError, lambda: dc.ContactPair(slave, solid), "RigidMesh in 3")
