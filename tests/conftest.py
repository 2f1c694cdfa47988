# SPDX-License-Identifier: MIT
"""Makes pytest at home under mpirun.

Every rank runs every test, and all meet after each one. Rank 0 prints; the other ranks speak only
of their own failures, at once. Whoever hangs shows where and ends the whole job.
"""

import faulthandler
import io
import os
import re
import sys
import time
from pathlib import Path

import pytest
from mpi4py import MPI

# Test the installed package: the source directory has no extension module.
root = Path(__file__).resolve().parent.parent
sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != root]

#: Seconds one test may take, and how long a rank that failed waits for the others.
test_timeout = float(os.environ.get("CONTACT_TEST_TIMEOUT", 400))
failure_timeout = min(60.0, test_timeout / 2)

#: Modules that one process, or two, show as well as three do: where ranks outnumber the cores, the others
#: alone take minutes. Tests whose names tell of ranks or partitions run on any number.
ENOUGH = {
    1: "benchmarks convergence docs docstrings infsup locking materials memory quadrature report"
    " strategy tangent",
    2: "bad_input demos driven errors faults mixed msh output plasticity plot segments tools"
    " true_pressure",
}
ABOUT_RANKS = re.compile("parallel|serial|distributed|partition|ranks")

comm = MPI.COMM_WORLD.Dup()
stderr = sys.stderr
failed: list[str] = []  # tests that failed here
failed_elsewhere: list[str] = []  # tests that failed on another rank only


def pytest_configure(config):
    global stderr
    stderr = os.fdopen(os.dup(2), "w")  # pytest captures the original


def pytest_collection_modifyitems(config, items):
    enough = {module: n for n, modules in ENOUGH.items() for module in modules.split()}
    left = [
        i
        for i in items
        if comm.size > enough.get(i.path.stem.removeprefix("test_"), comm.size)
        and not ABOUT_RANKS.search(i.originalname)
    ]
    gone = {id(i) for i in left}
    items[:] = [i for i in items if id(i) not in gone]
    config.hook.pytest_deselected(items=left)


@pytest.hookimpl(trylast=True)
def pytest_sessionstart(session):
    if comm.rank > 0:
        session.config.get_terminal_writer()._file = io.StringIO()


def report_failure(report):
    if report.failed:
        failed.append(report.nodeid)
        if comm.rank > 0:
            print(
                f"[rank {comm.rank}] {report.nodeid}\n{report.longreprtext}",
                file=stderr,
                flush=True,
            )


pytest_runtest_logreport = report_failure
pytest_collectreport = report_failure


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    faulthandler.dump_traceback_later(test_timeout, exit=True, file=stderr)
    yield
    meet(item.nodeid)
    faulthandler.cancel_dump_traceback_later()


def meet(nodeid: str):
    """Waits for the other ranks at the end of a test and tells them whether it failed here."""
    here = int(nodeid in failed)
    anywhere = bytearray([here])
    request = comm.Iallreduce(MPI.IN_PLACE, [anywhere, MPI.UNSIGNED_CHAR], op=MPI.MAX)
    end = time.monotonic() + failure_timeout
    while not request.Test():
        if here and time.monotonic() > end:
            print(
                f"[rank {comm.rank}] {nodeid} failed here and other ranks hang in it: aborting",
                file=stderr,
                flush=True,
            )
            comm.Abort(1)
        time.sleep(1e-3)
    if anywhere[0] and not here:
        failed_elsewhere.append(nodeid)


def pytest_terminal_summary(terminalreporter):
    for nodeid in failed_elsewhere:
        terminalreporter.write_line(f"FAILED on another rank than {comm.rank}: {nodeid}")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session):
    if failed_elsewhere:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
