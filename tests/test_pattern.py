# SPDX-License-Identifier: MIT
"""The places of the matrix against sets built from the meshes and the particles' targets alone."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from operators import MU, case
from rigid import ball, block, pair_and_problem
from two_bodies import CELLS, COMM, model

import dolfinx_contact as dc
from dolfinx_contact import compat
from dolfinx_contact.held import local_dofs

KINDS = {  # partition, target and normals, rule, friction
    "facet": ("default", "proximity-facet", dc.Simpson(1), 0.0),
    "smooth": ("apart", "smooth-interpolated", dc.Gauss(3), MU),
    "turning": ("columns", "slave-interpolated", dc.Simpson(1), MU),
    "segments": ("columns", "slave-interpolated", dc.Segments(3), 0.0),
}


def gathered(comm, mine):
    """The union of all ranks' dictionaries. Collective."""
    return {key: value for part in comm.allgather(mine) for key, value in part.items()}


def node_dofs(layout, block, nodes):
    """System dofs of global nodes, held or not."""
    return layout.node_dofs(block, nodes, np.zeros(len(nodes) * layout.block_sizes[block]))


def surface_facets(system, surface):
    """Of each facet of a surface: the dofs of its displacement, and its vertices. Collective."""
    layout, block = system.layout, system._block_of(surface.u)
    facets = zip(surface.id, surface.nodes, surface.vertices)
    mine = {int(f): (node_dofs(layout, block, n), set(v)) for f, n, v in facets}
    return gathered(system.comm, mine)


def neighbours(facets):
    """The facets that share a vertex with each one."""
    at = {}
    for f, (_, vertices) in facets.items():
        for v in vertices:
            at.setdefault(v, set()).add(f)
    return {f: set.union(*(at[v] for v in vertices)) for f, (_, vertices) in facets.items()}


def multipliers(system, pair, contact):
    """Dofs of λ and Λ of each slave facet. Collective."""
    kinds = [(contact.multiplier_block, pair._multiplier, pair._psi)]
    if pair.frictional:
        kinds.append((contact.friction_block, pair._semi_multiplier, pair._phi))
    mine = {int(f): [] for f in pair.slave.id}
    for block, function, basis in kinds:
        size, dofs = system.layout.block_sizes[block], system.layout.local_dofs(block)
        for f, nodes in zip(pair.slave.id, local_dofs(pair, function, len(basis[2]))):
            mine[int(f)] += [dofs[n * size + i] for n in nodes for i in range(size)]
    return gathered(system.comm, mine)


def of_pair(system, contact, refined):
    """Places of a pair's tangent, held unknowns included. Collective."""
    pair = contact.pair
    slaves, own = surface_facets(system, pair.slave), multipliers(system, pair, contact)
    around_slave = neighbours(slaves)
    table = contact.assembler.particles()
    facets = np.unique(np.stack([table["facet"], table["target_facet"]]), axis=1).T
    out = set()
    if pair.tools:
        tools = system.driven.dofs_of(pair.tools, pair.slave.dim)
        for f, (dofs, _) in slaves.items():
            mine = {*dofs, *own[f]}
            out.update(product(mine, mine))
            for tool in tools:
                out.update(product({*mine, *tool}, {*mine, *tool}))
        return out

    masters = surface_facets(system, pair.master)
    around = neighbours(masters)
    # a rank couples its slave facets with the master facets that may be their targets there
    here = set(contact.master.id[np.asarray(contact.master.candidate) > 0])
    near = {}
    for f, t in facets[facets[:, 1] >= 0]:
        near.setdefault(int(f), set()).update(around[int(t)] & here)
    mine = gathered(system.comm, {f: (targets, here) for f, targets in near.items()})
    interpolated = pair.normals == "interpolated"
    for f, (dofs, _) in slaves.items():
        unknowns = {*dofs, *own[f]}
        out.update(product(unknowns, unknowns))
        targets, candidates = mine.get(f, ((), ()))
        for t in targets:
            rows = {*unknowns, *masters[t][0]}
            columns = set(rows)
            columns.update(*(masters[g][0] for g in around[t] if interpolated))
            columns.update(*(masters[g][0] for g in around[t] & candidates if refined))
            if isinstance(pair.target, dc.SlaveNormal):
                columns.update(*(slaves[g][0] for g in around_slave[f]))
            out.update(product(rows, columns))
    return out


def of_bulk(system):
    """Places of the bulk's Jacobian. Collective."""
    out = set()
    for i, row in enumerate(system.bulk.J):
        for j, a in enumerate(row):
            if a is None:
                continue
            cells = []
            for block in (i, j):
                V = system.functions[block].function_space
                nodes = compat.global_indices(V.dofmap.index_map)[compat.dof_list(V)]
                cells.append([node_dofs(system.layout, block, n) for n in nodes])
            for rows, columns in zip(*cells):
                out.update(product(rows, columns))
    return set().union(*system.comm.allgather(out))


def expected(system, refined=False):
    """All places. Collective."""
    comm, layout = system.comm, system.layout
    held = set(layout.held_rows())
    for contact in system.contacts:
        held.update(contact.held_rows())
    held = set().union(*comm.allgather(held))
    places = set()
    for contact in system.contacts:
        places |= of_pair(system, contact, refined)
    places = {(i, j) for i, j in places if i not in held and j not in held} | of_bulk(system)
    if comm.rank == 0 and system.driven.tools:
        for dofs in system.driven.dofs:
            places.update(product(dofs.ravel(), dofs.ravel()))
    places = set().union(*comm.allgather(places))
    size = comm.allreduce(layout.owned)
    return places | {(i, i) for i in range(size)}


def found(system):
    """All places of the matrix, those of one rank after the other's. Collective."""
    offsets, columns, _ = system.A.getValuesCSR()
    rows = system.layout.start + np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    pairs = list(zip(rows, columns))
    assert len(set(pairs)) == len(pairs)
    return set().union(*system.comm.allgather(set(pairs)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cell", CELLS)
def test_two_bodies(cell, kind):
    partition, target, rule, friction = KINDS[kind]
    options = {"friction": friction, "crease": 180.0}
    m = model(cell, partition, held=kind in ("facet", "smooth"))
    c = case(m, target, rule, "clamped", **options)
    assert found(c.system) == expected(c.system, refined=kind == "segments")


@pytest.mark.parametrize("partition", ("apart", "columns"))
def test_two_unknowns(partition):
    """Bodies on meshes of their own."""
    m = model("triangle", partition, separate=True)
    c = case(m, "smooth-interpolated", dc.Simpson(1), "clamped", crease=180.0)
    assert found(c.system) == expected(c.system)


@pytest.mark.parametrize("partition", ("default", "apart", "columns"))
def test_new_targets(partition):
    """Once targets have left it, the pattern is that of the new ones alone."""
    m = model(
        "quadrilateral",
        partition,
        counts=((2, 1), (12, 1)),
        slave_box=((0.05, 0.1), (0.3, 0.3)),
    )
    c = case(m, "smooth-interpolated", dc.Simpson(1), "sliding", crease=180.0)
    first = found(c.system)
    c.x[c.slave & (c.numbering.component == 0)] += 0.57  # 5.7 facets of the master
    c.matrix()
    assert found(c.system) == expected(c.system) != first


@pytest.mark.parametrize("dim", (2, 3))
def test_driven_tool(dim):
    """The rows and columns of a tool that a force drives."""
    m, tool = block(COMM, dim), ball(dim, -0.05)
    tool.push(np.eye(dim)[-1] * -1e-3)
    _, problem = pair_and_problem(m, tool, friction=MU)
    problem.system.start()
    assert found(problem.system) == expected(problem.system)
