# SPDX-License-Identifier: MIT
"""Errors, and a way to raise them on all ranks together.

An error that one rank meets alone would leave the others waiting in the next collective call. Each
stage of the computation (set-up, search, assembly, solve, output) therefore runs inside
:func:`together`, which ends the stage on all ranks or on none.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator

from mpi4py import MPI

from .watch import stage as timed


class ContactError(RuntimeError):
    """Anything that goes wrong in dolfinx_contact.

    Attributes:
        page: what it means and what to try; the message ends with it
    """

    page = "docs/failures.md#contacterror"

    def __str__(self) -> str:
        see = f"\nSee {self.page}"
        return (
            super().__str__().replace(see, "") + see
        )  # once, though messages are quoted and sent on


class InputError(ContactError, ValueError):
    """The user gave something that cannot work; the message says how to mend it."""

    page = "docs/failures.md#inputerror"


class UnheldError(ContactError):
    """Nothing holds a body; the message names it, how it can move, and the remedies."""

    page = "docs/failures.md#unhelderror"


class ConvergenceError(ContactError):
    """A solve failed.

    Attributes:
        report: what it did up to then, a Report
    """

    page = "docs/failures.md#convergenceerror"
    report = None


@contextmanager
def together(comm: MPI.Comm, stage: str) -> Iterator[None]:
    """Run a stage that only works on this rank, and fail on all ranks if one of them fails.

    Collective at its end: one reduction, and a broadcast only after a failure. The body must hold
    no collective call that another rank might miss.

    Args:
        comm: communicator of the stage
        stage: its name, which opens the message on the ranks that did not fail themselves

    Raises:
        the rank's own exception where the body failed; elsewhere one of the same class if that is one
        of this module, KeyboardInterrupt or SystemExit (else ContactError), with the message of the
        lowest failing rank
    """
    failure: BaseException | None = None
    with timed(stage):
        try:
            yield
        except BaseException as error:
            failure = error

        first = comm.allreduce(comm.size if failure is None else comm.rank, op=MPI.MIN)
    if first == comm.size:
        return
    kind, message = _describe(failure) if comm.rank == first else (ContactError, "")
    if isinstance(failure, SystemExit):
        kind, message = SystemExit, failure.code
    kind, message = comm.bcast((kind, message), root=first)
    if failure is not None:
        raise failure
    if kind is SystemExit:
        raise SystemExit(message)
    raise kind(f"{stage}: rank {first}: {message}")


def _describe(error: BaseException | None) -> tuple[type[BaseException], str]:
    """The class that the other ranks shall raise, and the message to put in it."""
    for kind in (InputError, UnheldError, ConvergenceError, ContactError):
        if isinstance(error, kind):
            return kind, str(error)
    text = f"{type(error).__name__}: {error}"
    return (KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else ContactError), text
