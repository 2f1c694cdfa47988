# SPDX-License-Identifier: MIT
"""A new partition has the same mesh and tags, balanced, and contact is the same on it."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.partition import bisect

COMM = MPI.COMM_WORLD
CELLS = [("hexahedron", 1), ("tetrahedron", 2), ("quadrilateral", 2), ("triangle", 1)]
SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2


def last(x, ranks):
    return np.full(len(x), ranks - 1)


def scattered(x, ranks):
    return np.random.default_rng(1).integers(0, ranks, len(x))


PARTITIONS = {"default": None, "scattered": scattered, "last": last}


def two_bodies(cell, degree, partition, refine=1):
    """Curved bodies with meshes that do not match: mesh, facet tags, cell tags."""
    dim = 3 if cell in ("hexahedron", "tetrahedron") else 2
    wave = lambda x: 0.02 * np.sin(3 * x)

    def curved(x):
        y = x.copy()
        y[:, -1] += wave(x[:, 0])
        return y

    side = (1,) * (dim - 1)
    counts = [8 * refine * s for s in side], [6 * refine * s for s in side]
    upper = meshes.grid((*counts[0], 6), (0.0,) * dim, (1.0,) * dim, curved, cell, degree)
    low, high = (*(-0.2 * s for s in side), -1.0), (*(1.2 * s for s in side), 0.0)
    lower = meshes.grid((*counts[1], 5), low, high, curved, cell, degree)
    mesh, body = meshes.create(COMM, [upper, lower], PARTITIONS[partition])
    at = lambda z: lambda x: np.isclose(x[dim - 1], z + wave(x[0]))
    where = {SLAVE: (at(0), 0), MASTER: (at(0), 1), TOP: at(1), BOTTOM: at(-1)}
    tags = meshes.tag_facets(mesh, where, body)
    cells = np.arange(len(body), dtype=np.int32)
    return mesh, tags, dolfinx_mesh.meshtags(mesh, dim, cells, body)


def facts(mesh, tags, cell_tags):
    """Numbers that do not depend on the partition: integrals of each tag, numbers of entities."""
    x = ufl.SpatialCoordinate(mesh)
    dx = ufl.Measure("dx", mesh, subdomain_data=cell_tags)
    ds = ufl.Measure("ds", mesh, subdomain_data=tags)
    forms = [x[0] ** 2 * dx(0), x[0] * x[1] * dx(1)]
    forms += [(1 + x[0]) * ds(tag) for tag in (SLAVE, MASTER, TOP, BOTTOM)]
    integrals = [compat.assemble_scalar(COMM, compat.form(form)) for form in forms]
    tdim = mesh.topology.dim
    maps = [mesh.topology.index_map(d) for d in (0, tdim - 1, tdim)] + [mesh.geometry.index_map()]
    return integrals, [m.size_global for m in maps]


def shares(mesh, tags):
    """Cells, slave facets and master facets of each rank, (3, ranks). Collective."""
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    facets = [compat.facet_cells(mesh, tags.find(tag))[0] < owned for tag in (SLAVE, MASTER)]
    return np.array(COMM.allgather([owned, *(int(f.sum()) for f in facets)])).T


@pytest.mark.parametrize("partition", PARTITIONS)
@pytest.mark.parametrize("cell, degree", CELLS)
def test_same_mesh_balanced(cell, degree, partition):
    old = two_bodies(cell, degree, partition)
    new = dc.repartition(*old[:2], SLAVE, MASTER, old[2])
    (integrals, sizes), (before, sizes_before) = facts(*new), facts(*old)
    np.testing.assert_allclose(integrals, before, rtol=1e-12)
    assert sizes == sizes_before  # nothing is torn apart
    assert compat.coordinate_degree(new[0]) == degree

    cells, slave, master = shares(*new[:2])
    assert np.all(np.abs(cells - cells.mean()) <= 0.02 * cells.mean() + 1)
    assert np.all(np.abs(slave - slave.mean()) <= 1.5)
    # the master is cut by the same planes: what faces the slave is spread as the slave is
    assert np.all(np.abs(master - master.mean()) <= 0.35 * master.mean() + 1)
    if partition == "last" and COMM.size > 1:
        assert np.all(shares(*old[:2])[:, 0] == 0)


def test_ghosts_are_those_of_shared_facets():
    mesh, tags, _ = two_bodies("hexahedron", 1, "default")
    new, new_tags = dc.repartition(mesh, tags, SLAVE, MASTER)
    tdim = mesh.topology.dim
    new.topology.create_connectivity(tdim - 1, tdim)
    n = new.topology.index_map(tdim).size_local
    links = new.topology.connectivity(tdim - 1, tdim)
    exterior = set(compat.exterior_facets(new).tolist())
    facets = new.topology.index_map(tdim - 1).size_local
    # an owned facet has both of its cells here
    assert all(len(links.links(f)) == 2 or f in exterior for f in range(facets))
    ghosts = COMM.allreduce(new.topology.index_map(tdim).num_ghosts)
    assert (ghosts > 0) == (COMM.size > 1)
    assert n > 0


def test_two_meshes_are_cut_by_the_same_planes():
    upper = meshes.grid((8, 8, 4), (0, 0, 0), (1, 1, 1), cell="hexahedron")
    lower = meshes.grid((6, 6, 5), (0, 0, -1), (1, 1, 0), cell="hexahedron")
    at = lambda x: np.isclose(x[2], 0)
    parts = [meshes.create(COMM, body, last)[0] for body in (upper, lower)]
    tags = [meshes.tag_facets(mesh, {5: at}) for mesh in parts]
    (a, b), (tags_a, tags_b) = dc.repartition(parts, tags, 5, 5)
    sizes = [m.topology.index_map(3).size_global for m in (a, b)]
    assert sizes == [8 * 8 * 4, 6 * 6 * 5]
    owned = [m.topology.index_map(3).size_local for m in (a, b)]
    total = np.array(COMM.allgather(sum(owned)))
    assert np.all(np.abs(total - total.mean()) <= 0.02 * total.mean() + 1)
    u, v = (fem.Function(compat.vector_space(m, 1)) for m in (a, b))
    slave, master = dc.Surface(u, tags_a, 5), dc.Surface(v, tags_b, 5)
    n = np.array(COMM.allgather([len(slave.id), len(master.id)]))
    assert n.sum(axis=0).tolist() == [64, 36]
    assert np.all(np.abs(n[:, 0] - n[:, 0].mean()) <= 1.5)
    # slave facets face master facets of the same rank, but at the cut
    if len(slave.id) and len(master.id):
        middle = [s.X[:, :, :2].mean(axis=(0, 1)) for s in (slave, master)]
        assert np.linalg.norm(middle[0] - middle[1]) < 0.15


def test_bisection_balances_what_is_far_from_uniform():
    """A patch of slave cells in the corner of a block, and many ranks' worth of weights."""
    rng = np.random.default_rng(COMM.rank)
    x = rng.random((4000 // COMM.size, 3))
    slave = ((x[:, 2] > 0.9) & (x[:, :2].max(axis=1) < 0.35)).astype(np.int64)
    ranks = bisect(COMM, x, slave, np.zeros(len(x), dtype=bool))
    cells, facets = np.zeros(COMM.size), np.zeros(COMM.size)
    np.add.at(cells, ranks, 1)
    np.add.at(facets, ranks, slave)
    COMM.Allreduce(MPI.IN_PLACE, cells)
    COMM.Allreduce(MPI.IN_PLACE, facets)
    assert np.all(np.abs(cells - cells.mean()) <= 2)
    assert np.all(np.abs(facets - facets.mean()) <= 2)


@pytest.mark.parametrize("cell, degree", [("hexahedron", 1), ("triangle", 1)])
def test_contact_is_the_same(cell, degree):
    """Forces and pressures equal those on the original partition."""
    results = []
    mesh, tags, _ = two_bodies(cell, degree, "last")
    for mesh, tags in ((mesh, tags), dc.repartition(mesh, tags, SLAVE, MASTER)):
        dim = mesh.geometry.dim
        u = fem.Function(compat.vector_space(mesh, 1))
        w = ufl.TestFunction(u.function_space)
        strain = lambda v: ufl.sym(ufl.grad(v))
        F = 100 * ufl.inner(strain(u), strain(w)) * ufl.dx
        push = [0.0] * (dim - 1) + [-0.02]
        bcs = []
        for tag, value in ((TOP, push), (BOTTOM, [0.0] * dim)):
            dofs = fem.locate_dofs_topological(u.function_space, dim - 1, tags.find(tag))
            bcs.append(fem.dirichletbc(np.array(value), dofs, u.function_space))
        pair = dc.ContactPair(dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER))
        dc.ContactProblem(F, u, [pair], bcs=bcs, strategy=dc.Newton(rtol=1e-11)).solve()
        table = pair.particles
        order = COMM.allreduce(float(np.abs(table.pressure).max(initial=0)), op=MPI.MAX)
        results.append([*pair.resultant(), pair.contact_area(), order])
    np.testing.assert_allclose(results[1], results[0], rtol=1e-7, atol=1e-7 * max(results[0]))
    assert abs(results[0][dim - 1]) > 0.1


def test_axisymmetric():
    """2D meshes of meridians: the axis is no obstacle."""
    mesh, tags, _ = two_bodies("quadrilateral", 1, "last")
    _, new_tags = dc.repartition(mesh, tags, SLAVE)
    assert COMM.allreduce(len(new_tags.find(SLAVE)), op=MPI.MAX) <= 8


def test_mistakes():
    mesh, tags, _ = two_bodies("triangle", 1, "default")
    with pytest.raises(dc.InputError, match="no facet has the tag 99"):
        dc.repartition(mesh, tags, 99)
    with pytest.raises(dc.InputError, match="one mesh, or two"):
        dc.repartition([mesh] * 3, [tags] * 3, SLAVE)
