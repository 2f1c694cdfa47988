# SPDX-License-Identifier: MIT
"""dc.Writer: what its files hold at known points, on any number of ranks, whatever has happened."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI
from pictures import CELLS, READERS, parametric, read
from problems import small_strain, values
from scipy.spatial import cKDTree

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes, xdmf

COMM = MPI.COMM_WORLD
SHAPES = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
EVERY = [(cell, degree) for cell in SHAPES for degree in (1, 2)]
ROUND_OFF = 1e-12  # of displacements and pressures of 1e-2 and 1
SOLVER = 1e-8  # serial and parallel solutions differ by what Newton leaves


@pytest.fixture
def folder(tmp_path):
    """One folder for all ranks."""
    return Path(COMM.bcast(str(tmp_path)))


class Blocks:
    """Two blocks, one pressed on the other askew, with friction; nodes nowhere meet."""

    def __init__(self, cell="triangle", degree=1, comm=COMM, geometry_degree=1, **options):
        dim = SHAPES[cell]
        last = dim - 1
        counts = ((3, 2), (2, 2)) if dim == 2 else ((2, 2, 1), (3, 3, 1))

        def corner(a, b):
            return (a,) * last + (b,)

        upper, lower = corner(0, 0), corner(-0.2, -1)
        kind = {"cell": cell, "degree": geometry_degree}
        self.mesh, body = meshes.create(
            comm,
            [
                meshes.grid(counts[0], upper, corner(1, 1), **kind),
                meshes.grid(counts[1], lower, corner(1.1, 0), **kind),
            ],
        )
        tags = meshes.tag_facets(
            self.mesh,
            {
                5: (lambda x: np.isclose(x[last], 0), 0),
                6: (lambda x: np.isclose(x[last], 0), 1),
                1: lambda x: np.isclose(x[last], 1),
                2: lambda x: np.isclose(x[last], -1),
            },
            body,
        )
        V = compat.vector_space(self.mesh, degree)
        self.u = fem.Function(V, name="u")
        self.top = fem.Function(V)
        held = [fem.locate_dofs_topological(V, last, tags.find(tag)) for tag in (1, 2)]
        bcs = [fem.dirichletbc(self.top, held[0]), fem.dirichletbc(fem.Function(V), held[1])]
        surfaces = dc.Surface(self.u, tags, 5), dc.Surface(self.u, tags, 6)
        options = {"friction": 0.65, "integration": dc.Gauss(3), **options}
        self.pair = dc.ContactPair(*surfaces, **options)
        F = small_strain(self.u, 100.0, 0.3)
        self.problem = dc.ContactProblem(F, self.u, [self.pair], bcs=bcs)
        self.dim = dim

    def press(self, depth=0.02):
        def moved(x):
            v = np.zeros((self.dim, x.shape[1]))
            v[-1], v[0] = -depth * (1 - 1.5 * x[0]), -0.2 * depth
            return v

        self.top.interpolate(moved)
        self.top.x.scatter_forward()
        self.problem.solve()


def at(points, wanted):
    """For each of the wanted points, the number of the point that it is."""
    assert len(points) > 0 and len(wanted) > 0
    distance, number = cKDTree(points).query(wanted)
    assert distance.max() < 1e-9
    return number


def padded(vectors):
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def close(a, b, tolerance=ROUND_OFF):
    """The same numbers, nan in the same places."""
    assert np.shape(a) == np.shape(b)
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


def linear(kind):
    """Linear shape functions of the corners of a cell of VTK, at its points; (points, corners)."""
    x = parametric(kind)
    x = x[:, np.ptp(x, axis=0) > 0]
    if "Tri" in kind.replace("TriQ", "") or "Tetra" in kind:
        return np.column_stack([1 - x.sum(axis=1), x])
    corners = x[: 2 ** x.shape[1]]
    return np.prod(1 - np.abs(x[:, None] - corners[None]), axis=2)


def check_cells(picture, measure):
    """Points are where VTK has them in each cell, and the cells, parallelograms, fill a measure."""
    N, total = linear(picture.kind), 0.0
    dim = {2: 1, 3: 2, 4: 3 if "Tetra" in picture.kind else 2, 8: 3}[N.shape[1]]
    simplex = N.shape[1] == dim + 1
    first = slice(1, dim + 1) if simplex else {1: [1], 2: [1, 3], 3: [1, 3, 4]}[dim]
    for cell in picture.cells:
        x = picture.points[cell]
        corners = x[: N.shape[1]]
        assert np.abs(N @ corners - x).max() < 1e-12
        J = corners[first] - corners[0]
        total += np.sqrt(np.linalg.det(J @ J.T)) / ({2: 2, 3: 6}.get(dim, 1) if simplex else 1)
    assert total == pytest.approx(measure, rel=1e-12)


def check_bulk(picture, model, at_nodes):
    """at_nodes: positions and displacements at the nodes of u."""
    x, u = at_nodes
    number = at(picture.points, x)
    assert np.array_equal(np.sort(number), np.arange(len(picture.points)))
    close(picture.point_data["displacement"][number], padded(u))
    check_cells(picture, 1 + 1.3 ** (model.dim - 1))


def check_contact(picture, model, pressure, friction, at_nodes, particles):
    """Function values (positions, values) at the nodes of pressure, friction and u; all particles."""
    check_cells(picture, 1)
    assert len(np.unique(picture.cells)) == picture.cells.size == len(picture.points)
    N = linear(picture.kind)
    corner = picture.cells[:, : N.shape[1]]
    x = picture.points[corner].reshape(-1, 3)
    for name, (nodes, v) in (("pressure", pressure), ("friction", friction)):
        wanted = v[at(nodes, x)]
        wanted = wanted[:, 0] if name == "pressure" else padded(wanted)
        field = picture.point_data[name]
        close(field[corner.ravel()], wanted)
        close(field[picture.cells], np.einsum("nc,fc...->fn...", N, field[corner]))
    number = at(at_nodes[0], picture.points)
    close(picture.point_data["displacement"], padded(at_nodes[1][number]))
    # each facet's particles
    middles = picture.points[corner].mean(axis=1)
    for facet in np.unique(particles.facet):
        mine = particles.facet == facet
        w, status = particles.weight[mine], particles.status[mine]
        middle = w @ padded(particles.reference[mine]) / w.sum()
        data = {name: v[at(middles, [middle])[0]] for name, v in picture.cell_data.items()}
        close(data["gap"], w @ particles.gap[mine] / w.sum())
        close(data["slip"], padded((w @ particles.slip[mine])[None] / w.sum())[0])
        close(data["closed"], w @ (status != "open") / w.sum())
        close(data["sticking"], w @ (status == "stick") / w.sum())


def check_particles(picture, particles):
    assert len(picture.points) == len(particles)
    number = at(picture.points, padded(particles.reference))
    assert np.array_equal(np.sort(number), np.arange(len(particles)))
    data = {name: v[number] for name, v in picture.point_data.items()}
    close(data["displacement"], padded(particles.position - particles.reference))
    close(data["to_target"], padded(particles.target - particles.position))
    close(data["gap"], np.where(np.isinf(particles.gap), np.nan, particles.gap))
    close(data["pressure"], particles.pressure)
    for name in ("friction", "slip", "normal"):
        close(data[name], padded(getattr(particles, name)))
    assert np.array_equal(
        np.array(["open", "slip", "stick"])[data["status"].astype(int)], particles.status
    )


def files(folder):
    return sorted(file.name for file in Path(folder).iterdir())


def shift(u, value):
    """Give a displacement other values, so that steps can be told apart."""
    u.interpolate(lambda x: value * (1 + x[: u.function_space.mesh.geometry.dim]))


def sample(folder, name="bulk", field="displacement"):
    """Times of a file, and a value of a field then; on rank 0."""
    times, pictures = read(Path(folder) / f"{name}.xdmf")
    return times, [float(p.point_data[field].max()) for p in pictures]


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("cell, degree", EVERY)
def test_fields(cell, degree, reader, folder):
    """At all points of the files is what the Functions and the table of the particles have there."""
    model = Blocks(cell, degree)
    writer = dc.Writer(folder, model.u, model.pair)
    for time, depth in ((0.1, 0.01), (0.25, 0.02)):
        model.press(depth)
        writer.write(time)
    results = (
        values(model.pair.pressure),
        values(model.pair.friction),
        values(model.u),
        model.pair.particles.gather(),
    )
    assert writer.times == [0.1, 0.25]
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            pictures = {}
            for name in ("bulk", "contact", "particles"):
                times, (_, pictures[name]) = read(folder / f"{name}.xdmf", reader)
                assert times == [0.1, 0.25]
            # the three facets of triangles of degree 1 do not slip
            three = {"open", "slip", "stick"} - ({"slip"} if (cell, degree) == EVERY[0] else set())
            assert set(results[3].status) == three
            check_bulk(pictures["bulk"], model, results[2])
            check_contact(pictures["contact"], model, *results)
            check_particles(pictures["particles"], results[3])


def test_nodes_in_vtk_order():
    """Points of Basix's elements in our order are where VTK has them; elements have no other ones."""
    import basix

    for shape in ("interval", *SHAPES):
        cell = getattr(basix.CellType, shape)
        for degree in (1, 2):
            element = basix.create_element(basix.ElementFamily.P, cell, degree)
            points = np.array(element.points)
            order = xdmf.vtk_order(shape, points)
            wanted = parametric(CELLS[xdmf._TOPOLOGY[shape, degree]])
            close(padded(points[order]), wanted)


@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_serial_and_parallel(cell, folder, tmp_path):
    """The files of one rank and of all have the same values at the same points of the same cells."""
    for comm, where in ((COMM, folder / "all"), (MPI.COMM_SELF, tmp_path / "one")):
        model = Blocks(cell, 2, comm)
        model.press()
        dc.Writer(where, model.u, model.pair).write(1)
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            for name in ("bulk", "contact", "particles"):
                every = [
                    read(w / f"{name}.xdmf")[1][0] for w in (folder / "all", tmp_path / "one")
                ]
                middles = [p.points[p.cells].mean(axis=1) for p in every]
                cells = at(*middles)
                a, b = every
                for field in b.cell_data:
                    close(a.cell_data[field][cells], b.cell_data[field], SOLVER)
                for i, j in enumerate(cells):
                    mine, other = a.cells[j], b.cells[i]
                    mine = mine[at(a.points[mine], b.points[other])]
                    for field in b.point_data:
                        close(a.point_data[field][mine], b.point_data[field][other], SOLVER)


@pytest.mark.parametrize("reader", READERS)
def test_more_fields(reader, folder):
    """Scalars and matrices, lower degrees, cell values, quadrature points; other meshes; curved cells."""
    one = Blocks("quadrilateral", 1, geometry_degree=2)
    two = Blocks("triangle", 2)

    def field(model, element, f, dim=None):
        function = fem.Function(compat.function_space(model.mesh, element, dim), name=element[0])
        function.interpolate(f)
        return function

    linear = field(two, ("Lagrange", 1), lambda x: 3 * x[0] - x[1])
    constant = field(one, ("DG", 0), lambda x: x[0])
    constant.name = "part/<1>"
    vector = field(two, ("DG", 0), lambda x: np.array([x[1], -x[0]]), 2)
    shift(one.u, 0.01), shift(two.u, -0.02)
    sheet = dc.plasticity.J2(
        two.u, E=70e3, nu=0.3, hardening=dc.plasticity.Swift(K=589, eps0=1e-4, n=0.216)
    )
    points = sheet.values(sheet.plastic_strain)
    sheet.fill(sheet.plastic_strain, np.arange(len(points)))
    matrix = field(one, ("Lagrange", 1), lambda x: np.array([x[0], x[1], 2 * x[0], -x[1]]), 4)
    matrix.name = "matrix"
    given = [linear, constant, vector, sheet.plastic_strain, matrix]
    dc.Writer(folder, [one.u, two.u], fields=given).write(-1.5)
    assert COMM.rank > 0 or files(folder) == [
        "bulk.xdmf",
        "bulk_2.xdmf",
        "mesh.h5",
        "step_00001.h5",
    ]
    owned = two.mesh.topology.index_map(2).size_local
    means = sheet.values(sheet.plastic_strain).reshape(owned, -1).mean(axis=1)
    means = COMM.gather((compat.original_cells(two.mesh)[:owned], means))
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            times, (first,) = read(folder / "bulk.xdmf", reader)
            (second,) = read(folder / "bulk_2.xdmf", reader)[1]
            assert times == [-1.5]
            x, y, _ = first.points.T
            close(first.point_data["displacement"], padded(0.01 * (1 + np.stack([x, y], axis=1))))
            assert first.kind == "vtkBiQuadraticQuad"
            check_cells(first, 2.3)
            o = 0 * x
            wanted = np.stack([x, y, o, 2 * x, -y, o, o, o, o], axis=1)
            close(first.point_data["matrix"], wanted)
            close(first.cell_data["part/<1>"], first.points[first.cells[:, 8], 0])
            x, y, _ = second.points.T
            close(
                second.point_data["displacement"], padded(-0.02 * (1 + np.stack([x, y], axis=1)))
            )
            close(second.point_data["Lagrange"], 3 * x - y)
            middle = second.points[second.cells[:, :3]].mean(axis=1)
            close(
                second.cell_data["DG"],
                np.stack([middle[:, 1], -middle[:, 0], 0 * middle[:, 0]], axis=1),
            )
            # cells come rank by rank
            close(second.cell_data["plastic_strain"], np.concatenate([m for _, m in means]))


def test_without_friction_or_targets(folder):
    """A pair without friction; particles and facets without a target have nan."""
    model = Blocks("triangle", 1, friction=0.0)
    model.press()
    table = model.pair._accepted
    away = table["X"][:, 0] > 0.5
    table["gap"][away], table["closed"][away] = np.inf, False
    table["target"][away] = table["normal"][away] = np.nan
    dc.Writer(str(folder), model.u, [model.pair]).write(0)
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            contact = read(folder / "contact.xdmf")[1][0]
            particles = read(folder / "particles.xdmf")[1][0]
            assert set(contact.point_data) == {"displacement", "pressure"}
            far = particles.points[:, 0] > 0.5
            assert far.any() and not far.all()
            for name in ("gap", "normal", "to_target"):
                unknown = np.isnan(particles.point_data[name].reshape(len(far), -1)[:, 0])
                assert np.array_equal(unknown, far)
            assert not (particles.point_data["status"][far]).any()
            middle = contact.points[contact.cells].mean(axis=1)[:, 0]
            assert np.array_equal(np.isnan(contact.cell_data["gap"]), middle > 0.6)
            assert np.array_equal(np.isnan(contact.cell_data["slip"][:, 0]), middle > 0.6)
            assert not contact.cell_data["closed"][middle > 0.6].any()


def test_no_particles_at_all(folder):
    """Segments make no particles where the master is not; the file is still one."""
    model = Blocks("triangle", 1)
    model.press()
    for column, values_ in model.pair._accepted.items():
        if column != "slave":
            model.pair._accepted[column] = values_[:0]
    dc.Writer(folder, model.u, model.pair).write(0)
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            assert len(read(folder / "particles.xdmf")[1][0].points) == 0
            assert np.isnan(read(folder / "contact.xdmf")[1][0].cell_data["gap"]).all()


# -- runs that end early, and go on -------------------------------------------------------------------


class Death(BaseException):
    """Stands for SIGKILL."""


def test_death_at_any_moment(tmp_path, monkeypatch):
    """Whichever call on the files is the last one: all files can be read, and have the times before."""
    if COMM.rank > 0:
        return  # whoever is left would wait for the dead
    model = Blocks(comm=MPI.COMM_SELF)
    model.press()
    deaths, calls = 0, 0
    while deaths == calls:
        folder = tmp_path / str(calls)
        writer = dc.Writer(folder, model.u, model.pair)
        writer.write(1)
        left = calls

        def dying(real):
            def call(*args, **kwargs):
                nonlocal left
                left -= 1
                if left < 0:
                    raise Death
                return real(*args, **kwargs)

            return call

        with monkeypatch.context() as patch:
            for name in ("replace", "fsync"):
                patch.setattr(os, name, dying(getattr(os, name)))
            import h5py

            for name in ("create_dataset", "close"):
                patch.setattr(h5py.File, name, dying(getattr(h5py.File, name)))
            patch.setattr(Path, "write_text", dying(Path.write_text))
            patch.setattr(Path, "unlink", dying(Path.unlink))
            try:
                writer.write(2)
            except Death:
                deaths += 1
        counts = [
            len(read(folder / f"{name}.xdmf")[0]) for name in ("bulk", "contact", "particles")
        ]
        assert counts == sorted(counts, reverse=True) and set(counts) <= {1, 2}
        # a run that goes on from there
        writer = dc.Writer(folder, model.u, model.pair, resume=1)
        assert writer.times == [1.0]
        assert files(folder) == sorted(
            [
                "bulk.xdmf",
                "contact.xdmf",
                "mesh.h5",
                "mesh_2.h5",
                "particles.xdmf",
                "step_00001.h5",
            ]
        )
        writer.write(3)
        assert sample(folder)[0] == [1.0, 3.0]
        calls += 1
    assert deaths > 20 and counts == [2, 2, 2]


LOOP = """
import numpy as np, sys
sys.path.insert(0, {tests!r})
from dolfinx import fem
from mpi4py import MPI
import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
mesh, _ = meshes.create(MPI.COMM_SELF, meshes.grid((20, 20)))
u = fem.Function(compat.vector_space(mesh, 1))
writer = dc.Writer({folder!r}, u)
for time in range(100000):
    u.x.array[:] = time
    writer.write(time)
    print(time, flush=True)
"""


@pytest.mark.parametrize("lines", (1, 4, 9))
def test_killed(lines, folder):
    """A process killed while it writes leaves all times that it has said to have written."""
    if COMM.rank == 0:  # starts it; the others wait at the end of the test
        kill(lines, folder)


def kill(lines, folder):
    script = LOOP.format(folder=str(folder), tests=str(Path(__file__).parent))
    mpirun = ("OMPI_", "PMIX_", "ORTE_", "PRTE_")  # the child is not of its processes
    environment = {name: v for name, v in os.environ.items() if not name.startswith(mpirun)}
    child = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=folder,  # not where the sources are: they have no extension module
    )
    try:
        for _ in range(lines):
            said = int(child.stdout.readline())
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    times, found = sample(folder)
    assert len(times) >= lines and times == found == list(range(len(times)))
    assert said in times


def test_resume(folder):
    """Times up to the given one stay, with their mesh; others go, with their files; leftovers go."""
    model = Blocks()
    writer = dc.Writer(folder, model.u)
    for time in (0.1, 0.1 + 0.2, 0.4, 0.5):
        shift(model.u, time)
        writer.write(time)
    before = None
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            before = sample(folder)
            # what a killed run may leave, and what is not ours
            (folder / "step_00005.h5").write_bytes((folder / "step_00004.h5").read_bytes()[:3000])
            for name in ("step_00006.h5.part", "bulk.xdmf.part", "notes.txt", "step_1.txt"):
                (folder / name).write_text("x")
            assert sample(folder) == before
            shutil.copytree(folder, folder.parent / "again")
    model = Blocks()  # as another run has
    writer = dc.Writer(folder, model.u, resume=0.3)  # less than 0.1 + 0.2 by round-off
    assert writer.times == [0.1, 0.1 + 0.2]
    wanted = "bulk.xdmf mesh.h5 mesh_2.h5 notes.txt step_00001.h5 step_00002.h5 step_1.txt".split()
    assert COMM.rank > 0 or files(folder) == wanted
    with pytest.raises(dc.InputError, match="larger"):
        writer.write(0.2)
    shift(model.u, 0.7)
    writer.write(0.45)
    shift(model.u, 0.8)
    writer = dc.Writer(folder, model.u, resume=0.45)
    writer.write(0.6)
    with dc.errors.together(COMM, "test"):
        if COMM.rank == 0:
            times, found = sample(folder)
            assert times == [0.1, 0.1 + 0.2, 0.45, 0.6]
            close(np.array(found), np.array([*before[1][:2], 0.7 * 2.1, 0.8 * 2.1]))
            assert {"mesh.h5", "mesh_2.h5", "mesh_3.h5", "step_00004.h5"} <= set(files(folder))
    # in a new folder nothing is there to stay; without resume nothing stays
    assert dc.Writer(folder / "new", model.u, resume=3.0).times == []
    dc.Writer(folder.parent / "again", model.u)
    assert COMM.rank > 0 or files(folder.parent / "again") == [
        "mesh.h5",
        "notes.txt",
        "step_1.txt",
    ]


def test_resume_on_other_ranks(folder):
    """A run on all ranks goes on alone, and the other way round."""
    for communicators in ((COMM, MPI.COMM_SELF), (MPI.COMM_SELF, COMM)):
        where = folder / str(communicators[0].size == COMM.size)
        for number, comm in enumerate(communicators):
            if comm.rank < comm.size and (comm.size == COMM.size or COMM.rank == 0):
                model = Blocks(comm=comm)
                model.press(0.01 * (1 + number))
                writer = dc.Writer(where, model.u, model.pair, resume=number or None)
                writer.write(number + 1)
                assert writer.times == [1.0, 2.0][: number + 1]
            COMM.Barrier()
        results = values(model.u) if comm is COMM else None
        with dc.errors.together(COMM, "test"):
            if COMM.rank == 0:
                for name in ("bulk", "contact", "particles"):
                    times, (first, second) = read(where / f"{name}.xdmf")
                    assert times == [1.0, 2.0]
                    assert len(first.points) == len(second.points)
                if results is not None:
                    second = read(where / "bulk.xdmf")[1][1]
                    check_bulk(second, model, results)


# -- errors, on all ranks together ----------------------------------------------------------------


def test_wrong_arguments(folder):
    model = Blocks()
    u, V = model.u, model.u.function_space
    other = Blocks("quadrilateral").u
    quadratic = fem.Function(compat.function_space(model.mesh, ("Lagrange", 2)), name="quadratic")
    linear = fem.Function(compat.function_space(model.mesh, ("DG", 1)), name="discontinuous")
    scalar = fem.Function(compat.function_space(model.mesh, ("Lagrange", 1)), name="temperature")
    for u_, arguments, text in (
        ("u", {}, "must be a dolfinx Function"),
        ([], {}, "must be a dolfinx Function"),
        (scalar, {}, "temperature.* displacements"),
        (u, {"pairs": [model.pair, u]}, "must be a ContactPair"),
        (u, {"fields": [other]}, "on the mesh of u"),
        (u, {"fields": [u.ufl_shape]}, "give dolfinx Functions"),
        (u, {"fields": quadratic}, "the field quadratic is on .*degree up to 1"),
        (u, {"fields": linear}, "the field discontinuous is on .*interpolate"),
        (u, {"fields": [scalar, scalar]}, "two fields have the name temperature"),
        (u, {"fields": fem.Function(V, name="displacement")}, "two fields have the name"),
        (u, {"resume": "1"}, "resume is '1'"),
        (u, {"resume": np.nan}, "resume is nan"),
    ):
        with pytest.raises(dc.InputError, match=text):
            dc.Writer(folder / "no", u_, **arguments)
    writer = dc.Writer(folder, u, model.pair)
    with pytest.raises(dc.ContactError, match="no results yet"):
        writer.write(0.0)
    model.press()
    writer.write(0)
    for time in (0.0, -1, np.nan, np.inf, "1", None, [1.0]):
        with pytest.raises(dc.InputError, match="larger"):
            writer.write(time)
    # different on the ranks
    with pytest.raises(dc.InputError):
        writer.write(2.0 if COMM.rank < COMM.size - 1 else -2.0)
    writer.write(3.0)
    assert writer.times == [0.0, 3.0]
    assert COMM.rank > 0 or sample(folder)[0] == [0.0, 3.0]


def test_not_ours(folder):
    """A broken .xdmf cannot be resumed; nothing is removed then."""
    if COMM.rank == 0:
        (folder / "bulk.xdmf").write_text("<Xdmf><Domain")
    COMM.Barrier()
    with pytest.raises(dc.InputError, match="is not a file of dc.Writer"):
        dc.Writer(folder, Blocks().u, resume=1)
    assert COMM.rank > 0 or files(folder) == ["bulk.xdmf"]


def test_folder_that_is_a_file(folder):
    if COMM.rank == 0:
        (folder / "file").write_text("x")
    COMM.Barrier()
    for name in ("file", "file/below"):
        with pytest.raises(dc.ContactError, match="cannot be used"):
            dc.Writer(folder / name, Blocks().u)


def test_without_h5py(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(dc.ContactError, match="python3-h5py"):
        dc.Writer(folder, Blocks().u)


def test_disk_full(folder):
    """Files that may not grow: the error is everywhere, and later all goes on."""
    mesh, _ = meshes.create(COMM, meshes.grid((60, 60)))
    u = fem.Function(compat.vector_space(mesh, 1))
    writer = dc.Writer(folder, u)
    shift(u, 1.0)
    writer.write(1)
    was = resource.getrlimit(resource.RLIMIT_FSIZE)
    size = (folder / "step_00001.h5").stat().st_size if COMM.rank == 0 else 0
    for limit in (size - 1, size - 2000, size // 2, 1, 0):
        limit = max(limit, 0)  # HDF5 writes the last bytes when it closes the file
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, was[1]))  # SIGXFSZ is ignored by Python
        try:
            with pytest.raises(dc.ContactError, match="cannot be written.*space left"):
                writer.write(2)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, was)
        assert COMM.rank > 0 or sample(folder) == ([1.0], [2.0])
        assert COMM.rank > 0 or files(folder) == ["bulk.xdmf", "mesh.h5", "step_00001.h5"]
    shift(u, 1.5)
    writer.write(2)
    assert COMM.rank > 0 or sample(folder) == ([1.0, 2.0], [2.0, 3.0])


def test_disk_full_for_the_last_file(folder, monkeypatch):
    """No file has the new time where one of them cannot have it."""
    model = Blocks()
    model.press()
    writer = dc.Writer(folder, model.u, model.pair)
    writer.write(1)
    real = xdmf.Series.write

    def full(series):
        if series.path.stem == "particles" and len(series.grids) > 1:
            raise OSError("No space left on device")
        real(series)

    with monkeypatch.context() as patch:
        patch.setattr(xdmf.Series, "write", full)
        with pytest.raises(dc.ContactError, match="cannot be written.*space"):
            writer.write(2)
    for time in ([1.0], [1.0, 3.0]):
        if COMM.rank == 0:
            for name in ("bulk", "contact", "particles"):
                assert sample(folder, name)[0] == time
        COMM.Barrier()
        if writer.times == [1.0]:
            writer.write(3)
