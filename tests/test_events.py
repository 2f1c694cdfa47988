# SPDX-License-Identifier: MIT
"""PETSc's log tells the parts of contact's work apart."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc
from problems import taylor_blocks

NAMES = (
    *("ContactSearch", "ContactResidual", "ContactTangent", "ContactInsert", "ContactSend"),
    *("ContactPattern", "ContactExchange", "ContactAllocate", "BulkResidual", "BulkJacobian"),
)


def test_events():
    comm = MPI.COMM_WORLD
    events = {name: PETSc.Log.Event(name) for name in NAMES}
    # all ranks must have given one number to each: PETSc adds up by numbers
    numbers = [event.id for event in events.values()]
    assert comm.bcast(numbers, root=0) == numbers

    if not PETSc.Log.isActive():
        PETSc.Log.begin()
    for event in events.values():
        event.setActive(True)  # also after a benchmark's test
    model = taylor_blocks(comm)
    before = {name: event.getPerfInfo()["count"] for name, event in events.items()}
    report = model.problem(model.pair()).solve()
    after = {name: event.getPerfInfo() for name, event in events.items()}
    count = {name: after[name]["count"] - before[name] for name in NAMES}
    for event in events.values():
        event.setActive(False)  # of no use to the other tests

    # Newton evaluates a residual more than it makes steps; the step begins with a search
    for name in ("ContactTangent", "BulkJacobian"):
        assert count[name] == report.iterations
    for name in ("ContactResidual", "BulkResidual"):
        assert count[name] > report.iterations
    assert count["ContactSearch"] > count["ContactResidual"]
    assert count["ContactExchange"] >= 1 and count["ContactAllocate"] >= 1
    assert count["ContactSend"] == (report.iterations if comm.size > 1 else 0)
    assert count["ContactPattern"] == count["ContactAllocate"]
    inserted = comm.allreduce(count["ContactInsert"])
    assert inserted > 0
    assert after["ContactInsert"]["time"] <= after["ContactTangent"]["time"]
