# SPDX-License-Identifier: MIT
"""What a solve tells: its record, PETSc's monitor, logging."""

import logging

from mpi4py import MPI
from petsc4py import PETSc
from problems import taylor_blocks

from dolfinx_contact import report as module

COMM = MPI.COMM_WORLD


def test_told():
    assert module.told((0, 0, 0, 0, 0)) == "no change of status"
    assert module.told((2, 0, 1, 0, 3)) == "2 opened, 1 began to slip, 3 reversals"


def test_record_monitor_and_log_agree(capfd, caplog):
    """Each line of -snes_monitor has beside it what opened, closed, began to slip; the log too."""
    model = taylor_blocks(COMM)
    options = PETSc.Options()
    options["snes_monitor"] = None
    try:
        with caplog.at_level(logging.INFO, logger="dolfinx_contact"):
            report = model.solve(friction=0.3).report
    finally:
        options.delValue("snes_monitor")
    assert report.closed[0] > 0 == report.opened[0]
    assert sum(report.status_changes) == sum(report.opened) + sum(report.closed)
    counts = [
        [getattr(report, name)[i] for name in module.CHANGES] for i in range(len(report.norms))
    ]
    rows = str(report).splitlines()[2:]
    assert [[int(n) for n in row.split()[3:]] for row in rows] == counts
    logged = [record.getMessage().split("; ") for record in caplog.records]
    logged = [parts[1] for parts in logged if parts[0].startswith("iteration")]
    assert logged == [module.told(count) for count in counts]
    out = capfd.readouterr().out
    if COMM.rank == 0:
        shown = [line.strip() for line in out.splitlines() if "contact: " in line]
        assert shown == ["contact: " + words for words in logged]
        assert out.count("SNES Function norm") == len(shown)
    else:
        assert not out
