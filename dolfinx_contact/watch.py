# SPDX-License-Identifier: MIT
"""What a run does that cannot go on: a time-out in place of a hang, and signals that all ranks hear.

Errors of one rank reach the others at the end of each stage (errors.together). Nothing can be promised
where a rank waits in a collective call of the user's own, in ``apply`` for one, that another rank never
makes, or has left the run altogether. There a time-out ends the job, and says where each rank is.

A signal that Python handles, as Ctrl-C, may come to one rank only, and between any two lines. In the
middle of a stage its handler therefore waits for a place that all ranks come to: the next iteration
of Newton, or the end of the stage.
"""

from __future__ import annotations

import faulthandler
import signal
import tempfile
import threading
from contextlib import contextmanager
from typing import Any, Callable, Iterator

import numpy as np
from mpi4py import MPI

# -- the time-out -------------------------------------------------------------------------------

_GRACE = 2.0  # seconds in which all ranks tell where they are before the first one ends the job
_TELL = getattr(signal, "SIGRTMAX", signal.SIGTERM)  # on which a rank writes where it is, here:
_where: Any = None  # a file

_limit = 0.0  # seconds; 0: none
_armed = False
_stages: list[str] = []  # open ones, the inner last


def timeout(seconds: float | None) -> None:
    """End the run, with a message, where a stage takes longer than this; without it a run that hangs
    does so for ever. Call it once on all ranks, for instance at the start of a script.

    Stages are set-up, ``apply``, each search and assembly, the rest of Newton's iterations (linear
    solves) and output. The time begins anew as one of them begins or ends, so that long runs need no
    longer time: take several times what the longest factorisation needs. Each rank then writes its
    stage, and where it is in your script and in ours, to the standard error, and MPI is aborted. Files
    that have been written stay whole.

    Args:
        seconds: of a stage [seconds]; None: no limit, as it is at first

    Raises:
        InputError: a number that is not positive
    """
    from .checks import number  # which needs errors, which need this module

    global _limit, _where
    allowed = "a positive number of seconds, or None for no limit"
    if seconds is not None:
        number("timeout", "seconds", seconds, allowed, lambda s: 0 < s < np.inf)
    _limit = 0.0 if seconds is None else float(seconds)
    if _limit and _where is None:
        _where = tempfile.TemporaryFile()
        faulthandler.register(_TELL, file=_where, all_threads=False)
    _arm()


@contextmanager
def stage(name: str) -> Iterator[None]:
    """What is timed: a part of the run in which this rank may wait for others.

    Args:
        name: for the message
    """
    _stages.append(name)
    _arm()
    try:
        yield
    finally:
        _stages.pop()
        _arm()


def _arm() -> None:
    """Begin to wait for the end of the present stage, if there is one."""
    global _armed
    if not _limit and not _armed:
        return
    from . import _cpp

    world = MPI.COMM_WORLD
    text = (
        f"\n[rank {world.rank} of {world.size}] dolfinx_contact: no end of {' > '.join(_stages)!r} within"
        f" {_limit:g} s; another rank has failed, hangs, or is elsewhere. This one is here:\n"
    )
    _cpp.watch(_limit if _stages else 0.0, text, int(_TELL), _where.fileno(), _GRACE)
    _armed = _limit > 0


# -- signals ------------------------------------------------------------------------------------

_SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2")
    if hasattr(signal, name)
]
_handlers: dict[int, Callable[[int, Any], Any]] = {}  # those that wait, while a stage is on
_pending: list[int] = []
_depth = 0  # of stages within one another


@contextmanager
def postponed(comm: MPI.Comm, name: str) -> Iterator[None]:
    """Handlers of signals wait for ``heed``, or the end of this. Collective.

    What Python does not handle (SIGTERM, unless a handler is set) ends the process at once, as always.
    The second time a signal comes it is handled at once too. After an error those that wait are
    heeded in the next stage.

    Args:
        comm: communicator
        name: of the stage

    Raises:
        what the handlers raise; on the other ranks, the same
    """
    global _depth
    main = threading.current_thread() is threading.main_thread()  # no other may set handlers
    if main and _depth == 0:
        for number in _SIGNALS:
            handler = signal.getsignal(number)
            if callable(handler):
                _handlers[number] = handler
                signal.signal(number, _note)
    _depth += 1
    try:
        yield
    finally:
        _depth -= 1
        if main and _depth == 0:
            for number, handler in _handlers.items():
                signal.signal(number, handler)
    if _depth == 0:
        heed(comm, name)


def heed(comm: MPI.Comm, name: str) -> None:
    """Call the handlers that wait, now that all ranks are here. Collective.

    Raises:
        what they raise; on the other ranks, the same
    """
    from .errors import together  # which needs this module

    with together(comm, name):
        while _pending:
            number = _pending.pop(0)
            _handlers[number](number, None)


def _note(number: int, frame: Any) -> None:
    if number in _pending:
        _pending.remove(number)
        _handlers[number](number, frame)
    else:
        _pending.append(number)
