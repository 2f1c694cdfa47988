# SPDX-License-Identifier: MIT
"""Surfaces against DOLFINx's own integrals, on any number of ranks and any partition."""

from __future__ import annotations

import itertools

import basix
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI

from dolfinx_contact import compat, meshes
from dolfinx_contact.errors import ContactError, InputError, together
from dolfinx_contact.surface import Surface, basis_polynomials

COMM = MPI.COMM_WORLD
CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
TOP, SIDE = 7, 3
QUADRATURE = 6
EPS = np.finfo(float).eps


def bend(x):
    """A smooth map that bends and turns the unit box (its Jacobian stays near a rotation)."""
    y = x.copy()
    y[:, -1] += 0.15 * np.sin(2.0 * x[:, 0]) + 0.1 * x[:, 0] * x[:, -1]
    y[:, 0] += 0.1 * x[:, -1] ** 2
    c, s = np.cos(0.7), np.sin(0.7)
    y[:, 0], y[:, -1] = c * y[:, 0] - s * y[:, -1], s * y[:, 0] + c * y[:, -1]
    if y.shape[1] == 3:
        y[:, 2] += 0.1 * x[:, 1] ** 2
        y[:, 1], y[:, 2] = c * y[:, 1] - s * y[:, 2], s * y[:, 1] + c * y[:, 2]
    return y


def round_robin(x, ranks):
    return np.arange(len(x)) % ranks


def last_rank(x, ranks):
    """Some ranks own nothing at all."""
    return np.full(len(x), ranks - 1)


def last_rank_has_surface(x, ranks):
    """The first rank owns cells, but none of the surface's facets (from 2 ranks on)."""
    away = np.arange(len(x)) % ranks
    return np.where(np.arange(len(x)) < len(x) // 2, away, ranks - 1)


PARTITIONS = (None, round_robin, last_rank, last_rank_has_surface)


def box(cell, degree, partition=None, comm=COMM):
    """A bent box, and the facets of its top and of one side."""
    dim = 2 if cell in CELLS[:2] else 3
    counts = (3, 2) if dim == 2 else (2, 3, 2)
    straight = meshes.grid(counts, cell=cell, degree=degree)
    mapped = meshes.grid(counts, mapping=bend, cell=cell, degree=degree)
    mesh, _ = meshes.create(comm, [mapped], partition)
    # facets are found by position while the box is straight
    bent = mesh.geometry.x.copy()
    given = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    mesh.geometry.x[:, :dim] = straight.points[given]
    fdim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(fdim, fdim + 1)
    tagged = [
        (
            tag,
            dolfinx_mesh.locate_entities_boundary(
                mesh, fdim, lambda x, i=i, v=v: np.isclose(x[i], v)
            ),
        )
        for tag, i, v in ((TOP, dim - 1, 1.0), (SIDE, 0, 0.0))
    ]
    mesh.geometry.x[:] = bent
    return mesh, tagged


def surface_on(cell, geometry_degree, degree, partition=None, comm=COMM, tag=TOP):
    mesh, tagged = box(cell, geometry_degree, partition, comm)
    facets = np.concatenate([facets for _, facets in tagged])
    values = np.concatenate([np.full(len(facets), t, dtype=np.int32) for t, facets in tagged])
    order = np.argsort(facets)
    tags = dolfinx_mesh.meshtags(mesh, mesh.topology.dim - 1, facets[order], values[order])
    u = fem.Function(compat.vector_space(mesh, degree))
    return Surface(u, tags, tag), tags


def evaluate(basis, points):
    """Values and gradients of polynomials; shapes (points, nodes), (dim, points, nodes)."""
    powers, coefficients = basis["powers"], basis["coefficients"]
    values = np.prod(points[:, None, :] ** powers, axis=2) @ coefficients.T
    gradients = []
    for i in range(powers.shape[1]):
        lowered = powers.copy()
        lowered[:, i] = np.maximum(powers[:, i] - 1, 0)
        monomials = powers[:, i] * np.prod(points[:, None, :] ** lowered, axis=2)
        gradients.append(monomials @ coefficients.T)
    return values, np.array(gradients)


def normals_and_points(surface, degree=QUADRATURE):
    """Area vectors that point outward with weights, and positions, both (facets, points, dim)."""
    points, weights = basix.make_quadrature(
        getattr(basix.CellType, surface.reference["shape"]), degree
    )
    values, gradients = evaluate(surface.reference["position"], points)
    x = np.matmul(values, surface.X)
    tau = [np.matmul(gradient, surface.X) for gradient in gradients]
    if surface.dim == 2:
        area = np.stack([tau[0][..., 1], -tau[0][..., 0]], axis=-1)
    else:
        area = np.cross(tau[0], tau[1])
    return -surface.sigma[:, None, None] * area * weights[:, None], x


def gathered(u):
    """Block values of a function in the order of its global numbering, on every rank."""
    size, bs = u.function_space.dofmap.index_map.size_local, u.function_space.dofmap.index_map_bs
    comm = u.function_space.mesh.comm
    return np.concatenate(comm.allgather(u.x.array[: size * bs].reshape(-1, bs)))


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("geometry_degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_area_and_orientation(cell, geometry_degree, degree, partition):
    """Areas and weighted outward normals agree with DOLFINx's, by the same quadrature."""
    surface, tags = surface_on(cell, geometry_degree, degree, partition, tag=[TOP, SIDE])
    bulk = surface.u.function_space.mesh
    area, x = normals_and_points(surface)
    ds = ufl.Measure(
        "ds", domain=bulk, subdomain_data=tags, metadata={"quadrature_degree": QUADRATURE}
    )
    ds = ds(TOP) + ds(SIDE)

    one = compat.form(1.0 * ds)
    mine = COMM.allreduce(np.linalg.norm(area, axis=2).sum())
    theirs = compat.assemble_scalar(COMM, one)
    assert abs(mine - theirs) < 1e3 * EPS * theirs

    # the weight differs from facet to facet: two wrong signs cannot cancel
    direction = fem.Constant(bulk, np.zeros(surface.dim))
    place = ufl.SpatialCoordinate(bulk)
    weight = 2 + place[0] + place[1] ** 2
    form = compat.form(weight * ufl.dot(ufl.FacetNormal(bulk), direction) * ds)
    mine = COMM.allreduce(np.sum((2 + x[..., 0] + x[..., 1] ** 2)[..., None] * area, axis=(0, 1)))
    for i, axis in enumerate(np.eye(surface.dim)):
        direction.value[:] = axis
        assert abs(mine[i] - compat.assemble_scalar(COMM, form)) < 1e3 * EPS * theirs

    mesh = surface.mesh
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": QUADRATURE})
    assert abs(compat.assemble_scalar(COMM, compat.form(1.0 * dx)) - theirs) < 1e3 * EPS * theirs


def distinct(numbers):
    return len(np.unique(np.concatenate(COMM.allgather(numbers.ravel()))))


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("cell", CELLS)
def test_bulk_mesh_hangs_together(cell, partition):
    """The meshes of these tests are the same on every partition, inner boundaries included."""
    mesh, _ = box(cell, 2, partition)
    alone, _ = box(cell, 2, comm=MPI.COMM_SELF)
    for dim in (0, mesh.topology.dim - 1, mesh.topology.dim):
        sizes = [one.topology.index_map(dim).size_global for one in (mesh, alone)]
        assert sizes[0] == sizes[1]
    sizes = [one.geometry.index_map().size_global for one in (mesh, alone)]
    assert sizes[0] == sizes[1]
    assert COMM.allreduce(len(compat.exterior_facets(mesh))) == len(compat.exterior_facets(alone))


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("geometry_degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_facet_mesh(cell, geometry_degree, partition):
    """The facet mesh has this rank's facets, no others, with the same parametrisation."""
    surface, _ = surface_on(cell, geometry_degree, 1, partition)
    mesh = surface.mesh
    assert mesh is surface.mesh
    assert mesh.topology.dim == surface.dim - 1 and mesh.geometry.dim == surface.dim
    index_map = mesh.topology.index_map(mesh.topology.dim)
    assert index_map.num_ghosts == 0 and index_map.size_local == len(surface.id)
    assert sorted(surface.facet_mesh_cells) == list(range(len(surface.id)))
    # the facets hang together across ranks: as many vertices and nodes as the bulk has there
    assert mesh.topology.index_map(0).size_global == distinct(surface.vertices)
    space = compat.function_space(mesh, ("Lagrange", 1))
    assert space.dofmap.index_map.size_global == distinct(surface.vertices)

    x = mesh.geometry.x[compat.cell_geometry_dofs(mesh)]
    facets = surface.facet_mesh_cells
    shape = surface.reference["shape"]
    powers, coefficients, nodes = basis_polynomials(shape, geometry_degree)
    xi = np.random.default_rng(1).random((5, nodes.shape[1])) / 2
    theirs, _ = evaluate({"powers": powers, "coefficients": coefficients}, xi)
    mine, _ = evaluate(surface.reference["position"], xi)
    difference = theirs @ x[..., : surface.dim] - mine @ surface.X[facets]
    assert np.all(np.abs(difference) < 100 * EPS)

    # spaces on it work: interpolate and integrate on every partition
    f = fem.Function(space)
    f.interpolate(lambda x: 1 + 0 * x[0])
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": QUADRATURE})
    area = compat.assemble_scalar(COMM, compat.form(1.0 * dx))
    assert abs(compat.assemble_scalar(COMM, compat.form(f * dx)) - area) < 1e3 * EPS * area


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("geometry_degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_displacement_at_nodes(cell, geometry_degree, degree, partition):
    """The facet's dofs are those of its nodes: a polynomial takes its value at their positions."""
    surface, _ = surface_on(cell, geometry_degree, degree, partition)

    def polynomial(x):
        parts = [1 + x[0] - 2 * x[1] ** 2, x[0] * x[1] + x[2], 3 * x[2] ** 2 - x[0] + x[1]]
        return np.stack(parts[: surface.dim])

    surface.u.interpolate(polynomial)
    surface.u.x.scatter_forward()
    values = gathered(surface.u)[surface.nodes]

    reference = surface.reference
    at_nodes, _ = evaluate(reference["position"], reference["displacement"]["points"])
    x = np.zeros((*values.shape[:2], 3))
    x[..., : surface.dim] = at_nodes @ surface.X
    expected = np.moveaxis(polynomial(np.moveaxis(x, 2, 0)), 0, 2)
    assert np.all(np.abs(values - expected) < 1e3 * EPS)

    # u = x is reproduced at the position nodes wherever the space holds the geometry
    surface.u.interpolate(lambda x: x[: surface.dim])
    surface.u.x.scatter_forward()
    values = reference["interpolation"] @ gathered(surface.u)[surface.nodes]
    if degree >= geometry_degree:
        assert np.all(np.abs(values - surface.X) < 100 * EPS)
    else:
        corners = surface.vertices.shape[1]
        assert np.all(np.abs(values[:, :corners] - surface.X[:, :corners]) < 100 * EPS)


@pytest.mark.parametrize("geometry_degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_vertices(cell, geometry_degree):
    """``vertices`` number the geometry's corners over all ranks, in the facet's order."""
    surface, _ = surface_on(cell, geometry_degree, 2, round_robin)
    geometry = surface.u.function_space.mesh.geometry
    owned = geometry.x[: geometry.index_map().size_local, : surface.dim]
    x = np.concatenate(COMM.allgather(owned))[surface.vertices]
    assert np.array_equal(x, surface.X[:, : x.shape[1]])


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("cell", CELLS)
def test_ids_are_those_of_one_rank(cell, partition):
    """Every facet is owned once, and its number does not depend on the partition."""
    surface, _ = surface_on(cell, 2, 1, partition)
    alone, _ = surface_on(cell, 2, 1, comm=MPI.COMM_SELF)
    ids = np.concatenate(COMM.allgather(surface.id))
    X = np.concatenate(COMM.allgather(surface.X))
    original = compat.original_cells(surface.u.function_space.mesh)[surface.cells]
    assert surface.id.dtype == np.int64
    assert np.array_equal(surface.id, 8 * original + surface.local_facets)
    assert len(np.unique(ids)) == len(ids)
    mine, theirs = np.argsort(ids), np.argsort(alone.id)
    assert np.array_equal(ids[mine], alone.id[theirs])
    assert np.array_equal(X[mine], alone.X[theirs])


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_hull(shape, degree):
    """Control points bound a polynomial, and are those of the Bernstein basis."""
    cell = {"interval": "triangle", "triangle": "tetrahedron", "quadrilateral": "hexahedron"}[
        shape
    ]
    surface, _ = surface_on(cell, degree, degree)
    reference = surface.reference
    hull, nodes = reference["hull"], reference["position"]["points"]
    # Bernstein polynomials sum up to one and reproduce linear functions
    assert np.allclose(hull.sum(axis=1), 1, atol=100 * EPS, rtol=0)
    assert np.allclose(np.sort((hull @ nodes).ravel()), np.sort(nodes.ravel()), atol=100 * EPS)
    random = np.random.default_rng(2)
    xi = random.random((200, nodes.shape[1]))
    xi = xi[xi.sum(axis=1) < 1] if shape == "triangle" else xi
    values = random.standard_normal((len(nodes), 50))
    inside, _ = evaluate(reference["position"], xi)
    control = hull @ values
    assert np.all(inside @ values <= control.max(axis=0) + 100 * EPS)
    assert np.all(inside @ values >= control.min(axis=0) - 100 * EPS)


@pytest.mark.parametrize(
    "family, degree", [("Lagrange", 1), ("Lagrange", 2), ("DG", 0), ("DG", 1)]
)
@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_basis_polynomials(shape, family, degree):
    """The polynomials are the basis that DOLFINx uses: its dofs are values at the points."""
    powers, coefficients, points = basis_polynomials(shape, degree, family)
    values, gradients = evaluate({"powers": powers, "coefficients": coefficients}, points)
    assert np.allclose(values, np.eye(len(points)), atol=100 * EPS, rtol=0)
    assert np.issubdtype(powers.dtype, np.integer)
    centre = basix.geometry(getattr(basix.CellType, shape)).mean(axis=0)
    assert np.allclose(points.mean(axis=0), centre, atol=100 * EPS)

    cell = {"interval": "triangle", "triangle": "tetrahedron", "quadrilateral": "hexahedron"}[
        shape
    ]
    surface, _ = surface_on(cell, 2, 1)
    f = fem.Function(compat.function_space(surface.mesh, (family, degree)))
    f.interpolate(lambda x: 1 + x[0] - 2 * x[1])
    dofs = compat.dof_list(f.function_space)[: len(surface.id)]
    position, _ = evaluate(surface.reference["position"], points)
    x = position @ surface.X[surface.facet_mesh_cells]
    difference = f.x.array[dofs] - (1 + x[..., 0] - 2 * x[..., 1])
    assert np.all(np.abs(difference) < 100 * EPS)


# -- wrong input: every rank gets an InputError that says how to mend it ---------------------------


def refused(match, u, tags, wanted):
    with pytest.raises(InputError, match=match):
        Surface(u, tags, wanted)
    COMM.barrier()  # nobody is left waiting


@pytest.fixture
def square():
    mesh, _ = meshes.create(COMM, [meshes.grid((4, 4))])
    tags = meshes.tag_facets(mesh, {TOP: lambda x: np.isclose(x[1], 1.0)})
    return mesh, tags, fem.Function(compat.vector_space(mesh, 1))


def test_unknown_tag(square):
    _, tags, u = square
    refused(rf"no facet has the tag 8; .*\[{TOP}\]", u, tags, 8)
    refused("tag 8", u, tags, [TOP, 8])


def test_wrong_kind_of_tags(square):
    mesh, tags, u = square
    refused("tags is 7.5", u, tags, 7.5)
    refused("tags is empty", u, tags, [])
    refused("give MeshTags", u, {"top": 7}, 7)
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    cell_tags = dolfinx_mesh.meshtags(mesh, 2, cells, np.full(len(cells), TOP, dtype=np.int32))
    refused("dimension 2", u, cell_tags, TOP)


def test_tags_of_another_mesh(square):
    _, _, u = square
    other, _ = meshes.create(COMM, [meshes.grid((4, 4))])
    tags = meshes.tag_facets(other, {TOP: lambda x: np.isclose(x[1], 1.0)})
    refused("another mesh", u, tags, TOP)


def test_wrong_displacement(square):
    mesh, tags, u = square
    refused("give the displacement", ufl.SpatialCoordinate(mesh), tags, TOP)
    wrong = {
        "scalar": (("Lagrange", 1), None),
        "three components": (("Lagrange", 1), 3),
        "cubic": (("Lagrange", 3), 2),
        "discontinuous": (("DG", 1), 2),
    }
    for element, dim in wrong.values():
        V = compat.function_space(mesh, element, dim)
        refused("degree 1 or 2 with 2 components", fem.Function(V), tags, TOP)


def test_surface_mesh_is_no_body(square):
    """A mesh of codimension 1 has no interior; its displacement makes no surface."""
    _, tags, u = square
    u = fem.Function(compat.vector_space(Surface(u, tags, TOP).mesh, 1))
    refused("interval cells in 2 dimensions", u, tags, TOP)


def test_empty_surface(square):
    """Facets tagged only where their cell is a ghost belong to nobody (one rank: no ghosts)."""
    mesh, _, u = square
    mesh.topology.create_connectivity(1, 2)
    index_map = mesh.topology.index_map(1)
    facets = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cells, links = compat.facet_cells(mesh, facets)
    facets = facets[(links == 1) & (cells >= mesh.topology.index_map(2).size_local)]
    tags = dolfinx_mesh.meshtags(mesh, 1, facets, np.full(len(facets), TOP, dtype=np.int32))
    refused(r"hold \[\]|no rank owns", u, tags, TOP)


@pytest.mark.parametrize("partition", [None, round_robin])
def test_interior_facets(partition):
    """Also where only one rank knows, and where the second cell is on another rank."""
    mesh, _ = meshes.create(COMM, [meshes.grid((4, 4))], partition)
    u = fem.Function(compat.vector_space(mesh, 1))
    exterior = compat.exterior_facets(mesh)
    size = mesh.topology.index_map(1).size_local
    interior = np.setdiff1d(np.arange(size, dtype=np.int32), exterior)
    _, links = compat.facet_cells(mesh, interior)
    kinds = {"one": interior[:1], "all": interior, "between ranks": interior[links == 1]}
    if partition is not None and COMM.size > 1:
        assert COMM.allreduce(len(kinds["between ranks"])) > 0
    for rank, kind in itertools.product(range(COMM.size), kinds.values()):
        some = kind if COMM.rank == rank else kind[:0]
        if COMM.allreduce(len(some)) == 0:
            continue
        facets = np.union1d(exterior, some).astype(np.int32)
        tags = dolfinx_mesh.meshtags(mesh, 1, facets, np.full(len(facets), TOP, dtype=np.int32))
        refused("lie between two cells", u, tags, TOP)


def test_together_keeps_the_type():
    """The failing rank raises its own exception, the others one of our classes."""
    last = COMM.size - 1
    for error, others in ((InputError("no"), InputError), (ZeroDivisionError("no"), ContactError)):
        with pytest.raises((type(error), others)) as caught:
            with together(COMM, "search"):
                if COMM.rank == last:
                    raise error
        if COMM.rank == last:
            assert caught.value is error
        else:
            assert type(caught.value) is others
            assert str(caught.value).startswith(f"search: rank {last}: ")
            assert str(caught.value).removesuffix(f"\nSee {others.page}").endswith("no")
    with together(COMM, "search"):
        pass
