# SPDX-License-Identifier: MIT
"""The bulk's part of a system's operators against DOLFINx's own assembly."""

from __future__ import annotations

import time

import numpy as np
import pytest
import ufl
from dolfinx import fem
from operators import Numbering, case, relative
from petsc4py import PETSc
from two_bodies import CELLS, COMM, GAP, MASTER, PARTITIONS, SLAVE, bodies, curve, model

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes
from dolfinx_contact.bulk import derivative
from dolfinx_contact.system import System

EPS = np.finfo(float).eps


def bulk_blocks(system, J, bcs):
    """DOLFINx's own matrices of the bulk's blocks, in the canonical order of the system."""
    comm = system.comm
    numbering = Numbering(system)
    out = np.zeros((len(numbering), len(numbering)))
    for i, row in enumerate(J):
        for j, a in enumerate(row):
            if a is None:
                continue
            A = fem.petsc.assemble_matrix(a, bcs, float(i == j))
            A.assemble()
            offsets, columns, values = A.getValuesCSR()
            first, _ = A.getOwnershipRange()
            rows = first + np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
            parts = comm.allgather((rows, columns, values))
            rows, columns, values = (np.concatenate(part) for part in zip(*parts))
            at = [
                numbering.position[system.layout.system_dofs(block, dofs.astype(np.int64))]
                for block, dofs in ((i, rows), (j, columns))
            ]
            out[tuple(at)] = values
    return out


@pytest.mark.parametrize("held", (False, True), ids=("free", "held"))
@pytest.mark.parametrize("separate", (False, True), ids=("one", "two"))
@pytest.mark.parametrize("partition", ("default", "columns"))
@pytest.mark.parametrize("cell", CELLS)
def test_bulk(cell, partition, separate, held):
    """The bulk's rows and columns are DOLFINx's, with contact open and, less contact, closed."""
    m = model(cell, partition, separate=separate, held=held)
    target = "proximity-facet"
    for configuration in ("open", "sliding"):
        c = case(m, target, dc.Simpson(1), configuration)
        closed = c.particles()["closed"]
        matrix = c.matrix()
        expected = bulk_blocks(c.system, m.J, m.bcs)
        bulk = np.ix_(~c.multiplier, ~c.multiplier)
        if configuration == "open":
            assert not closed.any()
            assert not np.any(matrix[np.ix_(~c.multiplier, c.multiplier)])
            # the same insertions of the same numbers; ranks' sums may come in another order
            assert relative(matrix[bulk], expected[bulk]) < 4 * EPS
        else:
            assert closed.any()
            contact = c.contact_matrix()
            assert np.abs(contact[bulk]).max() > 1e-2
            # an addition and a subtraction more
            assert relative((matrix - contact)[bulk], expected[bulk]) < 16 * EPS


@pytest.mark.parametrize("partition", ("default", "columns"))
def test_coupled_unknowns(partition):
    """A scalar beside the displacement, coupled both ways, with conditions on either."""
    mesh, body = meshes.create(COMM, list(bodies("quadrilateral")), PARTITIONS[partition])
    at = (lambda x: np.isclose(x[1], GAP + 0.9 * curve(x[:2].T)), 0)
    other = (lambda x: np.isclose(x[1], curve(x[:2].T)), 1)
    tags = meshes.tag_facets(mesh, {SLAVE: at, MASTER: other}, body)
    V, Q = compat.vector_space(mesh, 1), compat.function_space(mesh, ("Lagrange", 1))
    u, q, w, v = fem.Function(V), fem.Function(Q), ufl.TestFunction(V), ufl.TestFunction(Q)
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    F = [
        (ufl.inner(u, w) + q**2 * ufl.div(w)) * dx,
        (q * v + 3 * ufl.inner(u, u) * v) * dx,
    ]
    J = [[compat.form(a) for a in row] for row in derivative(F, [u, q])]
    bcs = []
    for space, value in ((V, np.full(2, 0.1)), (Q, 0.3)):
        left = fem.locate_dofs_geometrical(space, lambda x: x[0] < 0.1 + 1e-9)
        bcs.append(fem.dirichletbc(value, left, space))
    u.interpolate(lambda x: np.stack([0.1 * x[1], -0.9 * GAP + 0.2 * x[0] * x[1]]))
    q.interpolate(lambda x: 1 + x[0] * x[1])
    compat.set_bc_array(u.x.array, bcs[:1])
    compat.set_bc_array(q.x.array, bcs[1:])
    pair = dc.ContactPair(dc.Surface(u, tags, SLAVE), dc.Surface(u, tags, MASTER))
    system = System([compat.form(f) for f in F], [u, q], J, [pair], bcs)
    pair._multiplier.x.array[:] = -1.0
    system.read()
    system.residual(system.x, system.b)
    system.create_matrix()
    pair._multiplier.x.array[:] = -1.0  # the scales of λ and q are known now
    system.read()
    system.residual(system.x, system.b)
    system.jacobian(system.x, system.A)
    numbering = Numbering(system)
    matrix = numbering.dense(system.A)
    expected = bulk_blocks(system, J, bcs)
    blocks = [numbering.block == i for i in range(3)]
    (one, row), (same, column) = system.bulk.row_scale, system.scale[:2]
    assert one == same == 1.0 and row > 0 and column > 0
    expected[blocks[1]] *= row
    expected[:, blocks[1]] *= column
    for i, j in ((0, 1), (1, 0), (1, 1)):
        part = np.ix_(blocks[i], blocks[j])
        assert np.abs(expected[part]).max() > 1e-3
        # the same numbers; ranks' sums may come in another order
        assert relative(matrix[part], expected[part]) < 4 * EPS
    assert not np.any(matrix[np.ix_(blocks[1], blocks[2])])
    assert np.any(matrix[np.ix_(blocks[0], blocks[2])])
    whole = numbering.gather(system.b)
    for i, f in enumerate(F):
        vector = fem.petsc.assemble_vector(compat.form(f))
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD_VALUES, mode=PETSc.ScatterMode.REVERSE)
        dofs, owned = compat.bc_dofs(bcs[i])
        vector.array_w[dofs[:owned]] = 0
        parts = np.concatenate(COMM.allgather(vector.array_r.copy()))
        dofs = system.layout.system_dofs(i, np.arange(len(parts), dtype=np.int64))
        value = whole[numbering.position[dofs]]
        if i == 1:  # contact adds nothing to it
            assert relative(value, row * parts) < 4 * EPS
        else:  # nodes away from the interfaces
            far = np.abs(numbering.points[numbering.position[dofs], 1]) > 0.3
            assert far.any() and relative(value[far], parts[far]) < 4 * EPS


def test_forms_can_grow_after_they_were_compiled():
    """FFCx of DOLFINx 0.5 changes a mesh's coordinate element with the first form that it compiles."""
    mesh, _ = meshes.create(COMM, [meshes.grid((3, 2), cell="triangle")])
    V = compat.vector_space(mesh, 1)
    new = COMM.bcast(time.time())  # a form that has never been compiled
    F = new * ufl.inner(ufl.grad(fem.Function(V)), ufl.grad(ufl.TestFunction(V))) * ufl.dx
    fem.form(F)
    F -= ufl.TestFunction(V)[0] * ufl.ds
    assert len(F.arguments()) == 1
    fem.form(F)
