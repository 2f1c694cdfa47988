# SPDX-License-Identifier: MIT
"""Tables of resultants and reports, a row a step, as CSV."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any, Sequence

import numpy as np
from mpi4py import MPI

from .checks import agreed, file_name
from .errors import ContactError, InputError, together
from .hdf5 import write_text
from .xdmf import last_time


class Table:
    """A CSV file that grows by a row with each ``write``. All methods are collective; rank 0 writes.

    >>> table = dc.Table("forces.csv")
    >>> table.write(time=step.time, force=pair.resultant(), iterations=step.report.iterations)

    gives the columns time, force_x, force_y (and force_z in 3D), iterations.

    Args:
        file: its folder is made if needed; without ``resume`` it is replaced
        columns: names of the keyword arguments of ``write``, in the order of the columns; None: those
            of the first row
        resume: rows whose first column is up to this number stay, and others are removed; None: begin
            anew
        comm: communicator of those who write; None: all processes

    Raises:
        InputError: on all ranks, if the file to resume is no such table
        ContactError: on all ranks, if the file cannot be written
    """

    def __init__(
        self,
        file: str | Path,
        columns: Sequence[str] | None = None,
        resume: float | None = None,
        comm: MPI.Comm | None = None,
    ):
        self._comm = MPI.COMM_WORLD if comm is None else comm
        self._header: list[str] | None = None
        with together(self._comm, "Table"):
            self._file = file_name("Table", file)
            listed = columns is None or isinstance(columns, (list, tuple))
            if not listed or not all(isinstance(name, str) for name in columns or ()):
                raise InputError(
                    f"Table: columns is {columns!r}; give a list of names, or None for those of the"
                    " first row."
                )
        self._columns = None if columns is None else list(columns)
        agreed(self._comm, "Table", columns=self._columns, resume=resume)
        with together(self._comm, "Table"):
            if self._comm.rank == 0:
                try:
                    self._file.parent.mkdir(parents=True, exist_ok=True)
                    text = "" if resume is None else self._kept(last_time("Table", resume))
                    write_text(self._file, text)
                except OSError as error:
                    raise self._unwritable(error) from None
        self._header = self._comm.bcast(self._header)

    def _kept(self, last: float) -> str:
        """What stays of the file: the header, and rows whose first column is not above last."""
        if not self._file.exists():
            return ""
        lines = self._file.read_text("utf-8", errors="replace").splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):
            lines.pop()  # the run was ended while it wrote this one
        rows = list(csv.reader(lines))
        if not rows:
            return ""
        try:
            kept = [line for line, row in zip(lines[1:], rows[1:]) if float(row[0]) <= last]
        except (ValueError, IndexError):
            raise InputError(
                f"Table: {self._file} cannot be resumed: its first column holds other things than"
                " numbers; give another file, or begin anew with resume=None."
            ) from None
        self._header = rows[0]
        return "".join([lines[0], *kept])

    def write(self, **values: Any) -> None:
        """Add a row. Collective.

        Args:
            values: for each name a number, a line of text, or a vector of 2 or 3 numbers, which makes
                columns with _x, _y, _z

        Raises:
            InputError: on all ranks, if a value is something else, or the columns are not those of
                the first row (of the file, when resumed)
            ContactError: on all ranks, if the row cannot be written
        """
        with together(self._comm, "Table.write"):
            names = list(values) if self._columns is None else self._columns
            if not values:
                raise InputError(
                    "Table: a row has no values; give one for each column, name=value."
                )
            if set(names) != set(values):
                raise InputError(
                    f"Table: a row has {', '.join(values)}; the columns are {', '.join(names)}; give the"
                    " same in each row."
                )
            row = dict(cell for name in names for cell in _cells(name, values[name]))
            if self._header is None:
                lines = [list(row), list(row.values())]
            elif list(row) == self._header:
                lines = [list(row.values())]
            else:
                raise InputError(
                    f"Table: a row has the columns {', '.join(row)}, but {self._file} has"
                    f" {', '.join(self._header)}; give the same in each row."
                )
        agreed(self._comm, "Table.write", columns=list(row))
        with together(self._comm, "Table.write"):
            if self._comm.rank == 0:
                self._append(lines)
        self._columns, self._header = names, list(row)

    def _append(self, lines: list[list[Any]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(lines)
        try:
            with open(self._file, "ab", buffering=0) as file:
                before, rest = file.seek(0, os.SEEK_END), text.getvalue().encode()
                try:
                    while rest:
                        rest = rest[file.write(rest) :]
                except OSError:
                    file.truncate(before)  # no part of a row
                    raise
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> ContactError:
        return ContactError(
            f"Table: {self._file} cannot be written: {error}. Is there space left, and may you write"
            " there? Make space, or give another file."
        )


def _cells(name: str, value: Any) -> list[tuple[str, Any]]:
    """Columns and cells of a value."""
    if isinstance(value, str) and "\n" not in value:
        return [(name, value)]
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0)
    if array.dtype.kind in "biuf" and array.shape in ((), (2,), (3,)):
        numbers = array.astype(int if array.dtype.kind == "b" else array.dtype).tolist()
        if array.ndim == 0:
            return [(name, numbers)]
        return [(f"{name}_{axis}", number) for axis, number in zip("xyz", numbers)]
    raise InputError(
        f"Table: {name} is {value!r}; give a number, a line of text, or a vector of 2 or 3 numbers."
    )
