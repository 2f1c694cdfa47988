# SPDX-License-Identifier: MIT
"""Faults in the middle of a run: errors of one rank, signals, full disks, ranks that hang.

All ranks end together, the last accepted state is kept, and files can be read.
"""

from __future__ import annotations

import re
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import MASTER, SLAVE, TOP, punch

import dolfinx_contact as dc

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))

import bad_input  # noqa: E402

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


class Run:
    """A punch that goes down in steps; `at` is called in each evaluation of a law of no stress."""

    def __init__(self):
        self.model = punch(COMM, counts=(12, 9))
        self.u, self.at, self.calls = self.model.u, lambda: None, 0
        self.pair = self.model.pair(friction=0.3)
        w = ufl.TestFunction(self.u.function_space)
        law = dc.QuadratureLaw(ufl.grad(self.u), self, 1)
        self.model.F += ufl.inner(law.P, ufl.grad(w)) * law.dx
        self.problem = self.model.problem(self.pair, materials=[law])
        self.stepping = dc.LoadStepping(self.problem, self.apply, step=0.25, progress=False)

    def apply(self, t):
        self.model.move(TOP, (0.0, -0.08 * t))

    def update(self, F):
        self.calls += 1
        self.at()
        return np.zeros_like(F), np.zeros((*F.shape, 2, 2))

    def commit(self):
        pass

    restore = commit

    def state(self):
        return []

    def set_state(self, state):
        pass

    def later(self, action, calls=3):
        """From now on the law acts on the last rank, once, in the middle of a solve."""
        first = self.calls

        def at():
            if COMM.rank == LAST and self.calls == first + calls:
                action()

        self.at = at

    def values(self):
        return [*self.problem.state(), self.pair.pressure.x.array.copy(), self.pair.resultant()]


def equal(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def raised(kind, call):
    """Every rank gets an error of this class; their texts."""
    with pytest.raises(BaseException) as caught:
        call()
    assert type(caught.value) is kind, repr(caught.value)
    return COMM.allgather(str(caught.value))


@pytest.fixture
def run():
    """After the first of four steps."""
    made = Run()
    made.steps = iter(made.stepping)
    next(made.steps)
    made.before = made.values()
    return made


def goes_on(run):
    """The state is that of the last accepted step, and the run can be finished from there."""
    assert equal(run.before, run.values())
    run.at = lambda: None
    reference = Run()
    list(reference.stepping)
    # an error ends an iteration; another one begins where it was
    assert run.stepping.time == 0.25 and len(list(run.stepping)) == 3
    np.testing.assert_allclose(run.pair.resultant(), reference.pair.resultant(), rtol=1e-9)


def fail():
    raise ZeroDivisionError("a user's mistake")


# -- errors of one rank, by the stage -----------------------------------------------------------------


def test_in_a_law_in_the_middle_of_a_step(run):
    run.later(fail)
    kind = ZeroDivisionError if COMM.rank == LAST else dc.ContactError
    texts = raised(kind, lambda: next(run.steps))
    assert all("a user's mistake" in text for text in texts)
    if LAST:
        assert f"material law: rank {LAST}: ZeroDivisionError" in texts[0]
    goes_on(run)


def test_in_apply(run):
    usual = run.stepping._apply
    run.stepping._apply = lambda t: fail() if COMM.rank == LAST else usual(t)
    kind = ZeroDivisionError if COMM.rank == LAST else dc.ContactError
    texts = raised(kind, lambda: next(run.steps))
    assert LAST == 0 or f"apply: rank {LAST}: ZeroDivisionError" in texts[0]
    run.stepping._apply = usual
    goes_on(run)


@pytest.mark.parametrize("stage", ("set-up", "search", "assembly", "output"))
def test_at_the_end_of_a_stage(stage, run, tmp_path, monkeypatch):
    """An error that only the last rank meets, within our own code."""
    contact = run.problem.system.contacts[0]

    class Broken:
        """An assembler of which one call fails."""

        def __init__(self, name):
            self._name, self._assembler = name, contact.assembler

        def __getattr__(self, name):
            if name == self._name and COMM.rank == LAST:
                return lambda *_: fail()
            return getattr(self._assembler, name)

    folder = Path(COMM.bcast(str(tmp_path)))
    if stage == "set-up":
        call = lambda: dc.Surface(
            run.u, run.model.tags, SLAVE if COMM.rank < LAST else []
        )  # noqa: E731
        kind = dc.InputError
    elif stage == "output":
        path = folder if COMM.rank < LAST else None
        call, kind = (lambda: dc.Writer(path, run.u)), dc.InputError
    else:
        name = {"search": "update", "assembly": "tangent"}[stage]
        monkeypatch.setattr(contact, "assembler", Broken(name))
        call = lambda: next(run.steps)  # noqa: E731
        kind = ZeroDivisionError if COMM.rank == LAST else dc.ContactError
    raised(kind, call)
    monkeypatch.undo()
    goes_on(run)


# -- numbers and cells --------------------------------------------------------------------------------


@pytest.mark.parametrize("value", (np.nan, np.inf))
def test_a_displacement_that_is_not_finite(value, run):
    """In `apply`: a Dirichlet value."""
    usual = run.stepping._apply
    run.stepping._apply = lambda t: run.model.move(TOP, (0.0, value))
    texts = raised(dc.ContactError, lambda: next(run.steps))
    assert all("not finite" in text for text in texts)
    run.stepping._apply = usual
    usual(run.stepping.time)
    goes_on(run)


def test_inverted_cells(run):
    """A step that only a body turned inside out could take."""
    usual = run.stepping._apply
    run.stepping._apply = lambda t: run.model.move(TOP, (0.0, -4.0 if t > 0.25 else -0.02))
    run.stepping._min = 0.2
    texts = raised(dc.ConvergenceError, lambda: next(run.steps))
    assert all("did not converge" in text for text in texts)
    run.stepping._apply, run.stepping._next = usual, 0.25
    usual(run.stepping.time)
    goes_on(run)


def test_a_facet_without_area():
    """On whichever rank it is, all ranks are told where."""
    model = punch(COMM, counts=(12, 9))
    facet = model.surface(SLAVE).X
    parts = [part for part in COMM.allgather(facet) if len(part)]
    a, b = parts[0][0][:2]
    x = model.mesh.geometry.x
    x[np.linalg.norm(x[:, :2] - a, axis=1) < 1e-12, :2] = b
    texts = raised(dc.InputError, lambda: model.surface(SLAVE))
    assert all("no area" in text and "move their nodes" in text for text in texts)
    model.surface(MASTER)  # that one is sound


@pytest.mark.parametrize("tag", (SLAVE, MASTER))
def test_a_facet_that_a_step_collapses(tag):
    """Dirichlet conditions bring both its ends to one place: it has no tangent then. Particles on it and
    targets on it are done without it."""
    model = punch(COMM, counts=(12, 9))
    # near the middle, where the bodies touch
    ends = np.concatenate(COMM.allgather(model.surface(tag).X.reshape(-1, 4))).reshape(-1, 2, 2)
    a, b = ends[np.argmin(np.abs(ends.mean(axis=1)[:, 0]))]
    V, middle = model.u.function_space, 0.5 * (a + b)
    for end in (a, b):
        dofs = fem.locate_dofs_geometrical(
            V, lambda x: np.hypot(x[0] - end[0], x[1] - end[1]) < 1e-9
        )
        model.bcs.append(fem.dirichletbc(middle - end - (0.0, 0.02), dofs, V))
    pair = model.pair()
    assert model.problem(pair).solve().converged
    assert np.isfinite(pair.pressure.x.array).all() and np.isfinite(model.u.x.array).all()
    assert pair.resultant()[1] > 1.0


# -- full disks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("what", ("Writer", "Table", "save"))
def test_a_full_disk_in_the_middle_of_a_run(what, run, tmp_path):
    """The system refuses to write beyond a size: an error on all ranks, what was written before is
    there, and the run goes on."""
    folder = Path(COMM.bcast(str(tmp_path)))
    writer = dc.Writer(folder / "out", run.u, run.pair)
    table = dc.Table(folder / "forces.csv", comm=COMM)
    write = {
        "Writer": lambda t: writer.write(t),
        "Table": lambda t: table.write(time=t, force=run.pair.resultant()),
        "save": lambda t: run.stepping.save(folder / "run.h5"),
    }[what]
    write(0.25)
    files = {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    limit = {"Writer": 3000, "Table": 60, "save": 5000}[what]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    COMM.barrier()
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        texts = raised(dc.ContactError, lambda: [write(0.3 + 0.01 * i) for i in range(3)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert all("cannot be written" in text and "Make space" in text for text in texts)
    COMM.barrier()
    for path, data in files.items():
        assert path.read_bytes().startswith(data)  # rows that fitted may follow
    assert not list(folder.rglob("*.part"))
    COMM.barrier()
    write(0.5)
    COMM.barrier()
    for path in folder.rglob("*.h5"):
        with h5py.File(path):
            pass
    goes_on(run)


# -- signals ------------------------------------------------------------------------------------------


def test_an_interrupt_on_one_rank_ends_the_step_on_all(run):
    run.later(lambda: signal.raise_signal(signal.SIGINT))
    texts = raised(KeyboardInterrupt, lambda: next(run.steps))
    if LAST:
        assert f"solve: rank {LAST}: KeyboardInterrupt" in texts[0]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    goes_on(run)


def test_a_signal_of_the_user_on_one_rank(run):
    """Its handler runs once, between two iterations, and the step goes on."""
    heard = []
    former = signal.signal(signal.SIGUSR1, lambda number, frame: heard.append(run.calls))
    try:
        run.later(lambda: signal.raise_signal(signal.SIGUSR1))
        came = run.calls + 3
        step = next(run.steps)
    finally:
        signal.signal(signal.SIGUSR1, former)
    assert step.time == 0.5 and step.report.converged
    assert len(heard) == (COMM.rank == LAST) and all(calls >= came for calls in heard)


def test_a_handler_of_sigterm_that_leaves(run):
    """As batch systems want it: the last accepted state can then be saved."""

    def leave(number, frame):
        sys.exit(17)

    former = signal.signal(signal.SIGTERM, leave)
    try:
        run.later(lambda: signal.raise_signal(signal.SIGTERM))
        raised(SystemExit, lambda: next(run.steps))
    finally:
        signal.signal(signal.SIGTERM, former)
    goes_on(run)


def test_an_interrupt_while_a_file_is_written(run, tmp_path, monkeypatch):
    """The file is finished first."""
    folder = Path(COMM.bcast(str(tmp_path)))
    writer = dc.Writer(folder, run.u, run.pair)
    put = dc.output.NewFile.put

    def interrupted(self, name, rows, checked=False):
        if COMM.rank == LAST and name == "contact/pressure":
            signal.raise_signal(signal.SIGINT)
        return put(self, name, rows, checked)

    monkeypatch.setattr(dc.output.NewFile, "put", interrupted)
    raised(KeyboardInterrupt, lambda: writer.write(0.25))
    monkeypatch.undo()
    assert writer.times == [0.25]
    COMM.barrier()
    assert 'Value="0.25"' in (folder / "bulk.xdmf").read_text()
    with h5py.File(folder / "step_00001.h5") as file:
        assert len(file) > 0
    goes_on(run)


def test_the_second_interrupt_is_not_postponed():
    heard = []
    former = signal.signal(signal.SIGUSR2, lambda number, frame: heard.append(number))
    try:
        with dc.watch.postponed(COMM, "stage"):
            signal.raise_signal(signal.SIGUSR2)
            assert heard == []
            signal.raise_signal(signal.SIGUSR2)
            assert heard == [signal.SIGUSR2]
        assert heard == [signal.SIGUSR2]
    finally:
        signal.signal(signal.SIGUSR2, former)


# -- the time-out -------------------------------------------------------------------------------------

HANGING = """
import sys, time
import numpy as np, ufl
from dolfinx import fem
from mpi4py import MPI
import dolfinx_contact as dc
from dolfinx_contact import compat

comm = MPI.COMM_WORLD
mesh, body = dc.meshes.create(comm, [dc.meshes.grid((4, 1)), dc.meshes.grid((4, 1), (0, -1), (1, 0))])
on = lambda y, b: (lambda x: np.isclose(x[1], y), b)
tags = dc.meshes.tag_facets(mesh, {5: on(0, 0), 6: on(0, 1), 1: on(1, 0), 2: on(-1, 1)}, body)
V = compat.vector_space(mesh, 1)
u, w = fem.Function(V), ufl.TestFunction(V)
F = ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(w)) * ufl.dx
held = [fem.locate_dofs_topological(V, 1, tags.indices[tags.values == t]) for t in (1, 2)]
bcs = [fem.dirichletbc(np.zeros(2), dofs, V) for dofs in held]
pair = dc.ContactPair(dc.Surface(u, tags, 5), dc.Surface(u, tags, 6))
problem = dc.ContactProblem(F, u, [pair], bcs=bcs)
dc.timeout(8)

def apply(t):
    if t > 0.5 and comm.rank == comm.size - 1:
        wait_for_ever()

def wait_for_ever():
    comm.barrier()  # which no other rank calls

for step in dc.LoadStepping(problem, apply, step=0.5, progress=False):
    time.sleep(0.1)
    print("accepted", step.time, flush=True)
time.sleep(9)  # nothing is timed outside of our stages
print("the end", flush=True)
"""


def child(script, ranks):
    """Exit status, output and seconds of a job of its own, on all ranks; rank 0 starts it."""
    result = None
    if COMM.rank == 0:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "script.py"
            path.write_text(script)
            begin = time.monotonic()
            installed = str(Path(dc.__file__).parent.parent)
            done = bad_input.job([path], ranks, PYTHONPATH=installed)
            result = *done, time.monotonic() - begin
    return COMM.bcast(result)


def test_a_hang_ends_with_a_message():
    """A rank waits in `apply` for a call that the other one never makes."""
    status, text, seconds = child(HANGING, 2)
    assert status != 0 and seconds < 60, text
    assert "accepted 0.5" in text and "accepted 1" not in text
    for rank in (0, 1):
        assert f"[rank {rank} of 2] dolfinx_contact: no end of 'load step > apply'" in text, text
    assert "within 8 s" in text, text
    assert re.search(r"line \d+ in wait_for_ever", text) and re.search(r"in apply\n", text)
    # the other one went on to the end of the stage
    assert re.search(r"errors\.py\", line \d+ in together", text)


def test_a_run_that_does_not_hang_is_left_alone():
    status, text, seconds = child(HANGING.replace("t > 0.5", "False"), 1)
    assert status == 0 and seconds > 5, text
    assert "the end" in text and "no end of" not in text


def test_timeouts_that_are_none():
    for value in (0.0, -1.0, np.nan, np.inf, "1"):
        raised(dc.InputError, lambda: dc.timeout(value))
    assert dc.watch._limit == 0
