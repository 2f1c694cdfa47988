# SPDX-License-Identifier: MIT
"""Distributed solutions equal the serial one, on any partition."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from mpi4py import MPI
from problems import MASTER, ROTATION, SLAVE, apart, distance, dome, punch, remote, striped

import dolfinx_contact as dc

COMM = MPI.COMM_WORLD
PARTITIONS = (apart, striped, remote, None)

#: problem and target; all in generic position, so that no search ends in a tie
CASES = {
    "2D smooth": (punch, dc.Smooth()),
    "3D smooth": (dome, dc.Smooth()),
    "2D proximity": (punch, dc.Proximity()),
    "2D direction": (punch, dc.SeekDirection((0.05, 1.0))),
    "3D proximity": (dome, dc.Proximity()),
    "3D direction": (dome, dc.SeekDirection(tuple(ROTATION @ (0.04, 0.05, 1.0)))),
}


def solve(case, comm, partition=None):
    """Newton to 1e-12: its default tolerance is no better than what is compared."""
    make, target = CASES[case]
    model = make(comm, partition)
    return model, model.solve(dc.Newton(rtol=1e-12), target=target)


@functools.lru_cache(maxsize=None)
def serial(case):
    """The solution by this rank alone. Called after a distributed solve, which has compiled the
    forms: the ranks need not compile the same file at the same time."""
    return solve(case, MPI.COMM_SELF)


def owners(surface):
    """Number of facets of each rank. Collective."""
    return np.array(surface.comm.allgather(len(surface.id)))


@pytest.mark.parametrize("partition", PARTITIONS, ids=lambda p: p.__name__ if p else "default")
@pytest.mark.parametrize("case", CASES)
def test_distributed_equals_serial(case, partition):
    model, pair = solve(case, COMM, partition)
    alone, reference = serial(case)
    # both leave 1e-12 of the forces, or less as Newton is quadratic (2e-15 was seen); the margin is
    # for a last step that stops just below the tolerance
    assert distance(model.u, alone.u) < 1e-9
    assert distance(pair.pressure, reference.pressure) < 1e-9
    size = np.abs(reference.resultant()).max()
    np.testing.assert_allclose(pair.resultant(), reference.resultant(), atol=1e-9 * size)
    # the same particles are closed, so that areas differ by the order of the sum only
    assert pair.contact_area() == pytest.approx(reference.contact_area(), rel=1e-13)
    assert pair.report.iterations == reference.report.iterations
    assert pair.report.status_changes == reference.report.status_changes


@pytest.mark.parametrize("case", ["2D proximity", "3D proximity"])
def test_particles_do_not_depend_on_the_partition(case):
    _, reference = serial_after(case)
    expected = reference.particles.gather()
    for partition in PARTITIONS:
        _, pair = solve(case, COMM, partition)
        whole = pair.particles.gather()
        if COMM.rank != 0:
            assert whole is None
            continue
        # numbers of facets are those of the input mesh, in which both are sorted
        np.testing.assert_array_equal(whole.facet, expected.facet)
        # within a facet the order follows its vertices, which the partition may turn around
        ours, theirs = (
            np.lexsort((*np.round(p.reference.T, 9), p.facet)) for p in (whole, expected)
        )
        closed = expected.status[theirs] == "slip"
        assert 0 < closed.sum() < len(closed)
        np.testing.assert_array_equal(whole.status[ours] == "slip", closed)
        np.testing.assert_array_equal(
            whole.target_facet[ours][closed], expected.target_facet[theirs][closed]
        )
        for name in ("reference", "position", "target", "pressure", "gap", "weight"):
            a, b = getattr(whole, name)[ours][closed], getattr(expected, name)[theirs][closed]
            # solutions agree to 1e-9 (above) of the bodies' size and of the highest pressure
            np.testing.assert_allclose(a, b, atol=1e-8 * max(1, np.abs(b).max()), err_msg=name)


def serial_after(case):
    """The serial solution, after the forms are compiled by all ranks together."""
    CASES[case][0](COMM).pair()
    solve(case, COMM)
    return serial(case)


def test_partitions_are_what_they_claim():
    """Guards the tests above: without this they might all run on one rank's facets."""
    model = punch(COMM, apart)
    slave, master = owners(model.surface(SLAVE)), owners(model.surface(MASTER))
    assert slave[-1] == 20 and master[0] == 13
    assert COMM.size == 1 or not np.any((slave > 0) & (master > 0))

    model = punch(COMM, striped)
    assert np.all(owners(model.surface(SLAVE)) > 0) and np.all(owners(model.surface(MASTER)) > 0)

    for make in (punch, dome):
        model = make(COMM, remote)
        for tag in (SLAVE, MASTER):
            assert not owners(model.surface(tag))[:-1].any()
        cells = model.mesh.topology.index_map(model.mesh.topology.dim).size_local
        assert min(COMM.allgather(cells)) > 0

    model = dome(COMM, striped)
    assert np.count_nonzero(owners(model.surface(SLAVE))) == COMM.size
    model = dome(COMM, apart)
    slave, master = owners(model.surface(SLAVE)), owners(model.surface(MASTER))
    assert slave[-1] == 16 and master[0] == 9


def test_one_rank_without_any_cell():
    """Only the last rank has cells; the others take part in every collective call."""
    model, pair = punch(COMM, lambda x, n: np.full(len(x), n - 1)), None
    pair = model.solve(dc.Newton(rtol=1e-12), target=dc.Proximity())
    alone, reference = serial("2D proximity")
    # the same sums in the same rank: only the direct solver's order may differ
    assert distance(model.u, alone.u) < 1e-9
    assert distance(pair.pressure, reference.pressure) < 1e-9


def test_sliding_across_ranks():
    """Targets come from other ranks as the punch moves over columns of cells, step by step."""

    def slide(comm, partition=None):
        model = punch(comm, partition, depth=0.03)
        pair = model.pair()
        problem = model.problem(pair, strategy=dc.Newton(rtol=1e-12))
        for x in np.linspace(0, 0.85, 6):
            model.move(1, (x, -0.03 - 0.03 * x))
            problem.solve()
        return model, pair

    model, pair = slide(COMM, striped)
    alone, reference = slide(MPI.COMM_SELF)
    assert distance(model.u, alone.u) < 1e-9
    assert distance(pair.pressure, reference.pressure) < 1e-9
