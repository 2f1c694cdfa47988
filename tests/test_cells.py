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


def made(cell, degree=1, mapping=None):
    body = meshes.grid((3, 2, 2)[: CELLS[cell]], mapping=mapping, cell=cell, degree=degree)
    return meshes.create(COMM, body, lambda x, ranks: np.arange(len(x)) % ranks)[0]


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
    mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
    tags = meshes.tag_facets(mesh, {5: lambda x: np.isfinite(x[0])})  # the whole boundary
    surface = dc.Surface(fem.Function(compat.vector_space(mesh, 1)), tags, 5)
    assert COMM.allreduce(len(surface.facets)) > 0


@pytest.mark.parametrize("cell", CELLS)
def test_a_body_turned_inside_out_in_a_part(cell):
    """One inner plane of nodes is moved beyond the next one."""
    mesh = made(cell, mapping=lambda x: np.where(np.isclose(x, 1 / 3) & (x == x[:, :1]), 0.8, x))
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
