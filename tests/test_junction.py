# SPDX-License-Identifier: MIT
"""Forces while particles slide over junctions of facets, and normals on any partition.

A small block with a fixed pressure slides over a master of straight facets, whose ridges, convex
and concave, have up to 15 degrees. If the contact residual is a continuous function of the block's
position (Lipschitz, that is), halving the spacing of the positions halves the largest change
between neighbours; where it jumps, the jump stays.
"""

from __future__ import annotations

import numpy as np
import pytest
from operators import PARAMETERS, SCALE, Case, Numbering, case, relative, target_of
from two_bodies import CELLS, COMM, DIM, GAP, PARTITIONS, curve, model

import dolfinx_contact as dc
from dolfinx_contact.system import System

# -- sliding over junctions ---------------------------------------------------------------------------

SLIDING = ("quadrilateral", "tetrahedron", "hexahedron")  # a facet of each shape
MASTER_COUNTS = {2: (6, 1), 3: (6, 6, 1)}  # facets of size 0.2
START, WIDTH = 0.23, 0.12  # of the block, one box, in each direction along the master
WAY = {2: (0.5,), 3: (0.5, 0.3)}  # each particle crosses junctions of either kind
CLEARANCE = 0.02  # between the block's corner and the curve that the vertices lie on
SPACINGS = (100, 200)  # intervals on the way


class Slide:
    """The contact residual as a function of the block's position. Collective, unless alone.

    Args:
        alone: on this rank alone, which is faster

    Attributes:
        crossed: numbers of the facets that were targets
    """

    def __init__(self, cell, target, alone):
        self.dim = dim = DIM[cell]
        low = np.append(np.full(dim - 1, START), GAP)
        m = model(
            cell,
            "columns",
            counts=((1,) * dim, MASTER_COUNTS[dim]),
            slave_box=(tuple(low), tuple(low + WIDTH)),
            bulk="springs",
            alone=alone,
        )
        pair = dc.ContactPair(
            m.slave, m.master, integration=dc.Simpson(0), **target_of(target, dim)
        )
        system = System(m.F, m.u, m.J, [pair], m.bcs)
        n = Numbering(system)
        multiplier = n.block == 1
        slave = n.points[:, dim - 1] > 0.5 * GAP + curve(n.points[:, :dim])
        none = np.zeros(len(n), dtype=bool)
        self.case = Case(
            system,
            pair,
            n,
            x=np.where(multiplier, -1.0 / SCALE, 0.0),  # closed at any gap below 1/RHO
            slave=slave & ~multiplier,
            master=~slave & ~multiplier,
            multiplier=multiplier,
            friction=none,
            held=none,
        )
        self.case.contact.assembler.set_parameters(*PARAMETERS)
        self.crossed: set[int] = set()

    def __call__(self, position):
        """The gathered residual at a position between 0 and 1."""
        c = self.case
        corner = np.full((1, self.dim), START)
        shift = np.zeros((1, self.dim))
        shift[0, :-1] = position * np.array(WAY[self.dim])
        shift[0, -1] = CLEARANCE - GAP + (curve(corner + shift) - curve(corner))[0]
        c.x[c.slave] = shift[0, c.numbering.component[c.slave]]
        system, contact = c.system, c.contact
        system.write(c.vector(c.x))
        contact.update()
        table = contact.assembler.particles()
        assert table["closed"].all()
        self.crossed.update(table["target_facet"].tolist())
        system.b.zeroEntries()
        contact.assembler.residual(system.b.handle)
        system.b.assemble()
        return c.numbering.gather(system.b)


def largest_changes(cell, target, alone=True):
    """Largest change between neighbouring positions at each spacing, relative to the residual."""
    slide = Slide(cell, target, alone)
    changes = []
    for intervals in SPACINGS:
        values = np.array([slide(t) for t in np.linspace(0, 1, intervals + 1)])
        size = np.linalg.norm(values, axis=1).mean()
        changes.append(np.linalg.norm(np.diff(values, axis=0), axis=1).max() / size)
    crossed = set().union(*slide.case.system.comm.allgather(slide.crossed))
    assert len(crossed) >= (4 if slide.dim == 2 else 8)
    return changes


def jump(changes):
    """The part of the largest change that does not shrink with the spacing h: c(h) = jump + s h."""
    return 2 * changes[1] - changes[0]


@pytest.mark.parametrize("target", ("smooth-interpolated", "direction-interpolated"))
@pytest.mark.parametrize("cell", SLIDING)
def test_continuous(cell, target, record_property):
    coarse, fine = largest_changes(cell, target, alone=False)
    record_property("changes", (coarse, fine))
    assert 1.8 < coarse / fine < 2.2


@pytest.mark.parametrize("cell", SLIDING)
@pytest.mark.parametrize("kind", ("proximity", "direction"))
def test_facet_normals_jump(kind, cell, record_property):
    """Facet normals jump by the angle of the ridge."""
    coarse, fine = largest_changes(cell, f"{kind}-facet")
    record_property("changes", (coarse, fine))
    assert coarse / fine < 1.2
    assert jump((coarse, fine)) > 0.05


@pytest.mark.parametrize("cell", SLIDING)
def test_closest_points_jump_in_valleys(cell, record_property):
    """With interpolated normals the closest point still jumps in a valley, by the angle times the
    distance: less than with facet normals."""
    facet, interpolated = (
        largest_changes(cell, f"proximity-{normals}") for normals in ("facet", "interpolated")
    )
    record_property("changes", interpolated)
    assert jump(interpolated) < 0.2 * jump(facet)


# -- partitions ---------------------------------------------------------------------------------------


def scattered(x, ranks):
    """Diagonals of the master's boxes in turn: facets that share an edge are on different ranks."""
    size = 0.24 if x.shape[1] == 2 else 0.4
    return np.floor(x[:, :-1] / size).astype(int).sum(axis=1) % ranks


def vertices_on_several_ranks(surface):
    """Number of vertices of a surface whose own facets are not all on one rank. Collective."""
    parts = [np.unique(part) for part in surface.comm.allgather(surface.vertices)]
    return int(np.sum(np.unique(np.concatenate(parts), return_counts=True)[1] > 1))


@pytest.mark.parametrize(
    ("geometry_degree", "configuration"),
    ((1, "clamped"), (2, "deformed")),
    ids=("straight", "curved"),
)
@pytest.mark.parametrize("target", ("smooth", "proximity", "direction"))
@pytest.mark.parametrize("cell", CELLS)
def test_normals_on_any_partition(
    cell, target, geometry_degree, configuration, monkeypatch, record_property
):
    """Operators equal those that this rank assembles alone, where vertices' facets are scattered."""
    monkeypatch.setitem(PARTITIONS, "scattered", scattered)
    odd = ((3, 1), (5, 1)) if DIM[cell] == 2 else ((3, 3, 1), (3, 3, 1))
    options = {"geometry_degree": geometry_degree, "counts": odd, "bulk": "springs"}
    rule = dc.Simpson(1 if DIM[cell] == 2 else 0)
    c, alone = (
        case(m, f"{target}-interpolated", rule, configuration)
        for m in (model(cell, "scattered", **options), model(cell, alone=True, **options))
    )
    assert COMM.size == 1 or vertices_on_several_ranks(c.pair.master) >= 4
    table = c.particles()
    assert table["closed"].any() and not table["closed"].all()
    assert np.array_equal(table["target_facet"], alone.particles()["target_facet"])
    mine = (*c.residual(), c.matrix(), c.contact_matrix())
    expected = (*alone.residual(), alone.matrix(), alone.contact_matrix())
    # the same sums in another order: round-off of some 100 terms
    errors = [relative(value, other) for value, other in zip(mine, expected)]
    record_property("worst", max(errors))
    assert max(errors) < 1e-13
