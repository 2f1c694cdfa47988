# SPDX-License-Identifier: MIT
"""Cells that are as they should be are let through, however thin or small; others are not."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.cells import check_cells

COMM = MPI.COMM_WORLD
CELLS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


def made(cell, degree=1, mapping=None, partition=lambda x, ranks: np.arange(len(x)) % ranks):
    body = meshes.grid((3, 2, 2)[: CELLS[cell]], mapping=mapping, cell=cell, degree=degree)
    mesh = meshes.create(COMM, body, partition)[0]
    for facets_of_cells in (True, False):  # collective, and done in surfaces before
        dims = mesh.topology.dim, mesh.topology.dim - 1
        mesh.topology.create_connectivity(*(dims if facets_of_cells else dims[::-1]))
    return mesh


def bent(x):
    """A quarter of a ring; straight cells become trapezoids, those of degree 2 are curved."""
    angle, r = 0.5 * np.pi * x[:, 0], 1.0 + x[:, 1]
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), *x.T[2:]])


SOUND = {
    "as made": None,
    "mirrored": lambda x: x * [-1.0, *[1.0] * (x.shape[1] - 1)],
    "thin": lambda x: x * [1.0, 1e-7, 1.0][: x.shape[1]],
    "small": lambda x: 1e-9 * x,
    "large and far away": lambda x: 1e7 * (x + 3.0),
    "bent": bent,
}


@pytest.mark.parametrize("mapping", SOUND.values(), ids=SOUND.keys())
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("cell", CELLS)
def test_sound_cells(cell, degree, mapping):
    mesh = made(cell, degree, mapping)
    check_cells(mesh)
    tags = meshes.tag_facets(mesh, {5: lambda x: np.isfinite(x[0])})  # the whole boundary
    surface = dc.Surface(fem.Function(compat.vector_space(mesh, 1)), tags, 5)
    assert COMM.allreduce(len(surface.facets)) > 0


def folded(x):
    """An inner plane of nodes goes beyond the next one: cells between them are turned over as a whole."""
    y = x.copy()
    y[np.isclose(x[:, 0], 1 / 3), 0] = 0.8
    return y


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("cell", CELLS)
def test_a_body_folded_over(cell, degree):
    mesh = made(cell, degree, folded, lambda x, ranks: np.full(len(x), ranks - 1))
    said = ""
    try:
        check_cells(mesh)
    except dc.InputError as error:
        said = str(error)
    said = [text for text in COMM.allgather(said) if text]  # of ranks that have such cells
    assert said and all("around" in text and "move their nodes" in text for text in said)


@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_an_edge_of_length_zero(cell):
    """Wedges are made so; the cell has a volume, and a facet there has no area."""

    def wedge(x):
        y = x.copy()
        y[:, 1] *= 1 - x[:, 0]
        return y

    mesh = made(cell, mapping=wedge)
    check_cells(mesh)
    sides = {5: lambda x: np.isclose(x[0], 1), 6: lambda x: np.isclose(x[1], 0)}
    tags = meshes.tag_facets(mesh, {6: sides[6], 5: sides[5]})
    u = fem.Function(compat.vector_space(mesh, 1))
    dc.Surface(u, tags, 6)
    with pytest.raises(dc.InputError, match="have no area"):
        dc.Surface(u, tags, 5)


def test_nodes_that_are_moved_later():
    """A mesh is looked at once, but again after its nodes have moved."""
    mesh = made("quadrilateral", partition=lambda x, ranks: np.full(len(x), ranks - 1))
    check_cells(mesh)
    check_cells(mesh)
    x = mesh.geometry.x
    x[:, :2] = folded(x[:, :2])
    if COMM.rank == COMM.size - 1:
        with pytest.raises(dc.InputError, match="same side"):
            check_cells(mesh)
    x[:] = 0.0
    if COMM.rank == COMM.size - 1:
        with pytest.raises(dc.InputError, match="no volume"):
            check_cells(mesh)
