# SPDX-License-Identifier: MIT
"""Checks of what users give: numbers, switches and files, and that all ranks give the same."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any, Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from .errors import InputError


def is_number(value: Any) -> bool:
    """Whether something is one real number, maybe nan or infinite; no text, no bool."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return False
    return array.ndim == 0 and array.dtype.kind in "iuf"


def number(
    who: str, name: str, value: Any, allowed: str, fits: Callable[[float], bool] | None = None
) -> float:
    """A real number.

    Args:
        who, name: begin the message
        value: as given
        allowed: what it may be; ends the message
        fits: whether it may be this; by default if it is finite

    Raises:
        InputError: it is no number, or does not fit
    """
    if not is_number(value) or not (np.isfinite if fits is None else fits)(float(value)):
        raise InputError(f"{who}: {name} is {value!r}; give {allowed}.")
    return float(value)


def numbers(value: Any) -> npt.NDArray[np.float64]:
    """An array of floats; a nan, which fits nowhere, if it is none (text and complex numbers are
    none)."""
    try:
        array = np.asarray(value)
        return array.astype(float) if array.dtype.kind in "biuf" else np.array(np.nan)
    except (TypeError, ValueError):
        return np.array(np.nan)


def whole(who: str, name: str, value: Any, least: int, most: int | None = None) -> int:
    """An integer, from least to most.

    Raises:
        InputError: it is another one, or none
    """
    integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not integer or value < least or (most is not None and value > most):
        end = "" if most is None else f" to {most}"
        raise InputError(
            f"{who}: {name} is {value!r}; give an integer from {least}{end or ' on'}."
        )
    return int(value)


def switch(who: str, name: str, value: Any) -> bool:
    """True or False.

    Raises:
        InputError: something else, as a text that is true whatever it says
    """
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{who}: {name} is {value!r}; give True or False.")
    return bool(value)


def file_name(who: str, value: Any) -> Path:
    """A path.

    Raises:
        InputError: no text and no path
    """
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{who}: the file or folder is {value!r}; give a name, a text or a Path.")
    return Path(value)


# -- the same on all ranks ----------------------------------------------------------------------


def agreed(comm: MPI.Comm, who: str, **given: Any) -> None:
    """Refuse what is not the same on all ranks; numbers may differ by round-off. Collective.

    Args:
        comm: ranks that should agree
        who: begins the message
        given: values by name

    Raises:
        InputError: on all ranks, with the name and two values
    """
    if comm.size == 1:
        return
    mine = {name: told(value) for name, value in given.items()}
    first = comm.bcast(mine, root=0)
    differing = [name for name in first if mine.get(name) != first[name]]
    rank = comm.allreduce(comm.rank if differing else comm.size, op=MPI.MIN)
    if rank < comm.size:
        name, value = comm.bcast(
            (differing[0], mine.get(differing[0])) if rank == comm.rank else None, root=rank
        )
        raise InputError(
            f"{who}: {name} is {first[name]} on rank 0 and {value} on rank {rank}; give all ranks the"
            " same (compute it on one rank and broadcast it, if need be)."
        )


def told(value: Any) -> str:
    """A text that is the same on all ranks for the same value: no addresses, no round-off."""
    if isinstance(value, (bool, str, bytes, type(None))):
        return repr(value)
    if is_number(value):
        return f"{float(value):.10g}"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{told(k)}: {told(v)}" for k, v in value.items()) + "}"
    if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 20:
        return f"an array {value.shape} with sum {value.sum():.10g}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "(" + ", ".join(map(told, value)) + ")"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = (f"{f.name}={told(getattr(value, f.name))}" for f in dataclasses.fields(value))
        return f"{type(value).__name__}({', '.join(parts)})"
    if callable(value):
        return "a function"
    if hasattr(value, "_given"):
        return f"{type(value).__name__}{told(value._given())}"
    return f"a {type(value).__name__}"
