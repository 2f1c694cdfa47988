# SPDX-License-Identifier: MIT
"""Load steps that shorten where Newton fails and grow again where it goes well."""

from __future__ import annotations

import logging
import pickle
import zlib
from dataclasses import asdict, astuple, dataclass
from typing import Any, Callable, Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from .checkpoint import Checkpoint, write
from .checks import agreed, file_name, number, switch
from .errors import ConvergenceError, InputError, together
from .history import History
from .report import Report
from .watch import postponed, stage

log = logging.getLogger("dolfinx_contact")
_EASY = 6  # a step of so many iterations went well


@dataclass(slots=True)
class Step:
    """An accepted step.

    Attributes:
        number: of the step, from 1
        time: load parameter t at its end
        length: of the step
        report: of its solve
        failed: solves that failed since the last accepted step
        smallest: length of the shortest step so far
    """

    number: int
    time: float
    length: float
    report: Report
    failed: int
    smallest: float

    def __str__(self) -> str:
        cuts = f", {self.failed} failed before" if self.failed else ""
        return (
            f"step {self.number} to t = {self.time:g} (length {self.length:.3g}):"
            f" {self.report.iterations} iterations{cuts}"
        )


class Steps(Sequence[Step]):
    """Accepted steps, packed, since a long run keeps thousands of them.

    Args:
        steps: to begin with
    """

    def __init__(self, steps: Iterable[Step] = ()):
        self._packed: list[bytes] = []
        for step in steps:
            self.append(step)

    def append(self, step: Step) -> None:
        """Add a step at the end.

        Args:
            step: a copy of it is kept
        """
        packed = zlib.compress(pickle.dumps(astuple(step)))
        # zlib's result is the rest of a larger block: kept, it would leave holes in the heap
        self._packed.append(bytes(memoryview(packed)))

    def __len__(self) -> int:
        return len(self._packed)

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return [self[j] for j in range(len(self))[i]]
        *begin, report, failed, smallest = pickle.loads(zlib.decompress(self._packed[i]))
        return Step(*begin, Report(*report), failed, smallest)


class LoadStepping:
    """Solve a problem for t from 0 to an end, in steps; iterate over it.

    A step that fails is halved, and the problem is back at the last accepted step; after two steps
    that went well (at most 6 iterations), or four that went somehow, the next is 1.5 times as long,
    up to max_step. Each begins at displacements (and places of tools that forces drive) that
    are extrapolated from the last two, unless a tool has just met its slave. ``save`` in the loop
    writes a checkpoint, ``load`` before it goes on from there.

    Args:
        problem: a ContactProblem
        apply: sets the loads and Dirichlet values of a t; after a failed step it is called again
            with the last accepted t
        end: last t
        step: first step
        min_step: steps shorter than this are not tried
        max_step: longest step; None: the first one
        progress: show a progress bar on rank 0

    Raises:
        InputError: steps that are not 0 < min_step ≤ step ≤ max_step, an end that is not positive
        ConvergenceError: while iterating, on all ranks, if a step would be shorter than min_step;
            the last accepted step is in place, and its loads
        KeyboardInterrupt: while iterating, on all ranks, after Ctrl-C on any of them; likewise. What
            ``apply`` raises on one rank ends the iteration on all ranks, too

    Attributes:
        time: t of the last accepted step
        steps: the accepted steps, a sequence; copies of those that the iteration gave
    """

    def __init__(
        self,
        problem: Any,
        apply: Callable[[float], Any],
        end: float = 1.0,
        step: float = 0.1,
        min_step: float = 1e-4,
        max_step: float | None = None,
        progress: bool = True,
    ):
        if not all(hasattr(problem, name) for name in ("comm", "solve", "state", "set_state")):
            raise InputError(
                f"LoadStepping: problem is a {type(problem).__name__}; give a ContactProblem."
            )
        max_step = step if max_step is None else max_step
        with together(problem.comm, "LoadStepping"):
            self._check(apply, end, step, min_step, max_step, progress)
        agreed(
            problem.comm, "LoadStepping", end=end, step=step, min_step=min_step, max_step=max_step
        )
        self.problem, self._apply, self.end = problem, apply, float(end)
        self._next, self._min, self._max = float(step), float(min_step), float(max_step)
        self._progress, self._shortest = progress, float("inf")
        self.time, self.steps = 0.0, Steps()
        # state one accepted step ago, and the length of that step
        self._before: tuple[list[Any], float] | None = None
        self._ease = 0  # how well the last steps went
        self._history: History | None = None  # for ``save`` and ``load``

    @staticmethod
    def _check(
        apply: Any, end: Any, step: Any, min_step: Any, max_step: Any, progress: Any
    ) -> None:
        """What this rank can see alone."""
        if not callable(apply):
            raise InputError(
                f"LoadStepping: apply is {apply!r}; give a function of t that sets the loads."
            )
        sizes = {"end": end, "step": step, "min_step": min_step, "max_step": max_step}
        for name, value in sizes.items():
            number("LoadStepping", name, value, "a positive, finite number", _positive)
        switch("LoadStepping", "progress", progress)
        if not min_step <= step <= max_step:
            raise InputError(
                f"LoadStepping: min_step is {min_step}, step {step} and max_step {max_step}; give"
                " 0 < min_step ≤ step ≤ max_step."
            )

    def __iter__(self) -> Iterator[Step]:
        hidden = not self._progress or self.problem.comm.rank > 0
        with tqdm(total=self.end, disable=hidden, bar_format=_BAR, initial=self.time) as bar:
            while self.end - self.time > 1e-12 * self.end:
                with postponed(self.problem.comm, "load step"):
                    step = self._advance()
                self._ease += 2 if step.report.iterations <= _EASY else 1
                if step.failed:
                    self._ease = 0
                if self._ease >= 4:
                    self._next, self._ease = min(1.5 * self._next, self._max), 0
                bar.update(step.length)
                bar.set_postfix_str(
                    f"step {step.length:.3g}, {step.report.iterations} iterations", refresh=False
                )
                yield step

    def _advance(self) -> Step:
        """The next accepted step."""
        failed = 0
        while True:
            left = self.end - self.time
            # no sliver at the end
            length = left if self._next > left * (1 - 1e-9) else self._next
            target = self.end if length == left else self.time + length
            accepted = self.problem.state()
            self._set_loads(target, accepted)
            if self._before is not None:
                before, last = self._before
                self.problem.extrapolate(before, accepted, length / last)
            try:
                report = self.problem.solve()
            except ConvergenceError as error:
                failed += 1
                self._put_back(accepted)
                log.info("t = %g: a step of %g failed", self.time, length)
                if 0.5 * length < self._min:
                    error.args = (
                        f"LoadStepping: stopped at t = {self.time:g}: a step of {length:.3g} failed"
                        f" and half of it is below min_step = {self._min:g}.\n{error}",
                    )
                    raise
                self._next = 0.5 * length
                continue
            except BaseException:
                self._put_back(accepted)
                raise
            self._before = (accepted, length) if self.problem.continues else None
            self._shortest = min(self._shortest, length)
            step = Step(len(self.steps) + 1, target, length, report, failed, self._shortest)
            self.time = target
            self.steps.append(step)
            return step

    def _set_loads(self, t: float, accepted: list[Any]) -> None:
        """Call ``apply``; where that fails on a rank it fails on all, with the last accepted state."""
        try:
            with stage("load step"), together(self.problem.comm, "apply"):
                self._apply(t)
        except BaseException:
            self.problem.set_state(accepted)
            raise

    def _put_back(self, accepted: list[Any]) -> None:
        """Displacements and loads of the last accepted step."""
        self.problem.set_state(accepted)
        self._apply(self.time)

    # -- checkpoints ----------------------------------------------------------------------------

    def save(self, path: Any, **arrays: npt.ArrayLike) -> None:
        """Write all that is needed to go on from the last accepted step to an HDF5 file. Collective.

        A former file of this name stays until the new one is whole on the disk: whenever the run is
        stopped, there is a checkpoint to go on from.

        Args:
            path: of the file
            arrays: anything of your own, numbers; what rank 0 gives is kept

        Raises:
            InputError: on all ranks, if nothing is solved yet, for arrays that are no numbers,
                unknowns that are no values at points, and laws at quadrature points without ``state``
            ContactError: on all ranks, if the file cannot be written; the former one is as it was
        """
        with together(self.problem.comm, "LoadStepping.save"):
            mine, path = {}, file_name("LoadStepping.save", path)
            if self.problem.comm.rank == 0:
                mine = {name: _numbers(name, value) for name, value in arrays.items()}
        history = self._problem_history()
        before, last = (None, None) if self._before is None else self._before
        tables = history.tables(before)
        figures = {
            "time": self.time,
            "next": self._next,
            "shortest": self._shortest,
            "ease": self._ease,
            "last": last,
            "steps": [asdict(step) for step in self.steps],
            **history.figures(before),
        }
        with postponed(self.problem.comm, "LoadStepping.save"), stage("LoadStepping.save"):
            write(self.problem.comm, path, figures, tables, mine)

    def load(self, path: Any) -> dict[str, npt.NDArray[Any]]:
        """Go on from a checkpoint, on any number of ranks. Collective.

        The problem is made as it was in the run that has saved; its unknowns, pairs, materials and
        tools are then as in the checkpoint, and ``apply`` is called with its t. Go on iterating: steps
        and results are those of a run without a stop.

        Args:
            path: of a file that ``save`` has written

        Returns:
            the arrays that ``save`` was given, by name and of their shape

        Raises:
            InputError: on all ranks, if there is no such file, it is not whole, or of another mesh,
                model or kind of pair; the problem is as it was
        """
        history = self._problem_history()
        with stage("LoadStepping.load"), Checkpoint(self.problem.comm, path) as file:
            figures = file.figures
            history.compare(path, figures["kinds"])
            columns = history.read(file)
        before = history.put(columns, figures)
        self.steps = Steps(
            Step(**{**s, "report": Report(**s["report"])}) for s in figures["steps"]
        )
        self.time, self._shortest, self._ease = (
            figures[name] for name in ("time", "shortest", "ease")
        )
        self._next = min(figures["next"], self._max)
        self._before = None if before is None else (before, figures["last"])
        self._apply(self.time)
        return file.arrays

    def _problem_history(self) -> History:
        if self._history is None:
            self._history = History(self.problem)
        return self._history


def _positive(value: float) -> bool:
    return 0 < value < np.inf


def _numbers(name: str, value: npt.ArrayLike) -> npt.NDArray[Any]:
    """A user's array for a checkpoint."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "biufc":
        raise InputError(
            f"LoadStepping.save: {name} is of type {array.dtype}; give numbers, or arrays of them."
        )
    return array


_BAR = "{l_bar}{bar}| t = {n:.4g} of {total:.4g} [{elapsed}<{remaining}] {postfix}"
