# SPDX-License-Identifier: MIT
"""New HDF5 files, which rank 0 writes; the other ranks send it their rows in turn, so that it never
holds more than one of them.

A file is written under another name, and takes its place when it is whole and on the disk: a run that
is killed, or meets a full disk, leaves no half-written file, and a former one stays as it was.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path
from types import TracebackType
from typing import Any, Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from .errors import ContactError, together

TEMPORARY = ".part"  # ends the names of files that are being written


class NewFile:
    """A new HDF5 file, as a context that all ranks enter together.

    An error of rank 0 waits for the end of the context, since other ranks are sending to it, and is
    then raised on all ranks; the file is not there then.

    Args:
        comm: communicator of those who write
        path: of the file, on rank 0; one of this name is replaced
        who: begins the message of an error

    Raises:
        ContactError: at the end, on all ranks, if it cannot be written
    """

    def __init__(self, comm: MPI.Comm, path: Any, who: str):
        self.comm, self._who = comm, who
        if comm.rank == 0:
            self.path = Path(path)
            self._temporary = self.path.with_name(self.path.name + TEMPORARY)
        self._file: Any = None
        self._disk: _Disk | None = None
        self._failure: Exception | None = None

    def __enter__(self) -> NewFile:
        if self.comm.rank == 0:
            try:
                import h5py

                self._disk = _Disk(self._temporary)
                self._file = h5py.File(self._disk, "w")
            except Exception as error:
                self._failure = error
        return self

    def put(self, name: str, rows: npt.NDArray[Any], checked: bool = False) -> tuple[int, ...]:
        """Write all ranks' rows, one rank's after the other's. Collective.

        Args:
            name: of the dataset
            rows: this rank's, (n, …), of one type on all ranks
            checked: with HDF5's checksums, so that a reader notices where bytes have changed

        Returns:
            the shape of all
        """
        comm, rows = self.comm, np.ascontiguousarray(rows)
        counts = comm.allgather(len(rows))
        shape = (sum(counts), *rows.shape[1:])
        if comm.rank > 0:
            if len(rows):
                comm.Send([rows.view(np.uint8), MPI.BYTE], dest=0)
            return shape
        options = {"fletcher32": checked} if all(shape) else {}  # which need a part to be of
        self._try(lambda: self._file.create_dataset(name, shape, rows.dtype, **options))
        first = 0
        for rank, count in enumerate(counts):
            if count == 0:
                continue
            if rank > 0:
                rows = np.empty((count, *shape[1:]), dtype=rows.dtype)
                comm.Recv([rows.view(np.uint8), MPI.BYTE], source=rank)
            part = np.s_[first : first + count]
            self._try(lambda: self._file[name].write_direct(rows, None, part))
            first += count
        return shape

    def add(self, name: str, data: Any) -> None:
        """Write data of rank 0, with a checksum."""

        def write() -> None:
            self._file.create_dataset(name, data=data).attrs["crc32"] = checksum(data)

        self._try(write)

    def _try(self, write: Callable[[], Any]) -> None:
        """Write on rank 0, if all has gone well so far."""
        if self._failure is None and self.comm.rank == 0:
            try:
                write()
                self._failure = self._disk.failure
            except Exception as error:
                self._failure = error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()
        if error is not None:
            return
        with together(self.comm, self._who):
            self._try(lambda: put_in_place(self._temporary, self.path))
            if self._failure is not None:
                with contextlib.suppress(OSError):
                    self._temporary.unlink(missing_ok=True)
                raise ContactError(
                    f"{self._who}: {self.path} cannot be written: {reason(self._failure)} A former"
                    " one is as it was."
                ) from self._failure

    def _close(self) -> None:
        """Close what is open, whatever has happened."""
        for part in (self._file, self._disk):
            if part is not None:
                try:
                    part.close()
                except Exception as error:
                    self._failure = self._failure or error
        if self._disk is not None:
            self._failure = self._failure or self._disk.failure


class _Disk:
    """A file for h5py that never fails, and tells of its failure later: HDF5 would crash at the end
    of the process where it cannot write the last part of a file that it has open (seen in 1.10).
    """

    def __init__(self, path: Path):
        self._file = open(path, "w+b", buffering=0)
        for name in ("read", "readinto", "seek", "tell"):
            setattr(self, name, getattr(self._file, name))
        self.failure: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        try:
            while self.failure is None and len(rest) > 0:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self.failure = error
        return len(data)

    def truncate(self, size: int) -> int:
        try:
            self._file.truncate(size)
        except OSError as error:
            self.failure = self.failure or error
        return size

    def flush(self) -> None:
        """Nothing is kept back."""

    def close(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or error


def checksum(data: Any) -> int:
    """Of a text, a number or an array of numbers."""
    return zlib.crc32(data.encode() if isinstance(data, str) else np.asarray(data).tobytes())


def reason(error: Exception) -> str:
    """Why something cannot be written, in words."""
    if isinstance(error, ModuleNotFoundError):
        return "the Python package h5py is missing (Debian: python3-h5py)."
    return f"{error}. Is there space left, and may you write there? Make space, or give another folder."


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a whole file its name, once it is on the disk."""
    with open(temporary, "rb+") as file:
        os.fsync(file.fileno())
    os.replace(temporary, path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def write_text(path: Path, text: str) -> None:
    """Replace a text file by a whole new one."""
    temporary = path.with_name(path.name + TEMPORARY)
    temporary.write_text(text, encoding="utf-8")
    put_in_place(temporary, path)
