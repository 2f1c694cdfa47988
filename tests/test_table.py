# SPDX-License-Identifier: MIT
"""dc.Table: rows that one reads back, resuming, errors on all ranks together."""

import csv
import resource
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import dolfinx_contact as dc

COMM = MPI.COMM_WORLD


@pytest.fixture
def file(tmp_path):
    """One file for all ranks, in a folder that is not there yet."""
    return Path(COMM.bcast(str(tmp_path))) / "new" / "table.csv"


def rows(file):
    """Rank 0's view of the file, on all ranks."""
    text = file.read_text() if COMM.rank == 0 else None
    return list(csv.reader(COMM.bcast(text).splitlines()))


def test_rows(file):
    table = dc.Table(file)
    values = dict(time=0.1, force=np.array([1 / 3, -2e-17]), iterations=np.int64(4), name="a, b")
    table.write(**values, done=True, place=(1, 2, 3))
    assert rows(file)[0] == (
        ["time", "force_x", "force_y", "iterations", "name", "done"]
        + ["place_x", "place_y", "place_z"]
    )
    # all digits, at once on the disk
    assert rows(file)[1] == ["0.1", repr(1 / 3), "-2e-17", "4", "a, b", "1", "1", "2", "3"]
    table.write(**values, done=False, place=[1.5, 2, np.nan])
    assert rows(file)[2][-4:] == ["0", "1.5", "2.0", "nan"] and len(rows(file)) == 3


def test_columns_in_a_given_order(file):
    table = dc.Table(str(file), columns=["time", "force"])
    table.write(force=np.ones(2), time=1)
    table.write(time=2, force=np.zeros(2))
    assert rows(file) == [["time", "force_x", "force_y"], ["1", "1.0", "1.0"], ["2", "0.0", "0.0"]]
    with pytest.raises(dc.InputError, match="a row has force; the columns are time, force"):
        table.write(force=1)


def test_resume(file):
    """Rows up to the given number stay, half a row goes."""
    table = dc.Table(file)
    for time in (0.1, 0.1 + 0.2, 0.4):
        table.write(time=time, force=10 * time)
    if COMM.rank == 0:
        with open(file, "a") as stream:
            stream.write("0.25,1")
    table = dc.Table(file, resume=0.3)
    assert [row[0] for row in rows(file)] == ["time", "0.1", repr(0.1 + 0.2)]
    with pytest.raises(dc.InputError, match="columns"):
        table.write(time=1, pressure=0)
    table.write(time=0.5, force=0)
    assert [row[0] for row in rows(file)[1:]] == ["0.1", repr(0.1 + 0.2), "0.5"]
    # nothing there, nothing kept, and from the beginning
    other = dc.Table(file.with_name("other.csv"), resume=1)
    other.write(time=2)
    dc.Table(file.with_name("other.csv"), resume=1).write(time=3)
    assert rows(file.with_name("other.csv")) == [["time"], ["3"]]
    dc.Table(file)
    assert rows(file) == []


def test_wrong_rows(file):
    table = dc.Table(file)
    for value in (np.zeros(4), np.eye(2), None, "two\nlines", 1j, [1, [2]]):
        with pytest.raises(dc.InputError, match="force is"):
            table.write(time=0, force=value)
    table.write(time=0, force=np.zeros(2))
    for row in (
        {"time": 1},
        {"time": 1, "force": 0},
        {"time": 1, "force": np.zeros(2), "more": 1},
    ):
        with pytest.raises(dc.InputError, match="columns"):
            table.write(**row)
    # other columns on one rank only
    last = COMM.size - 1
    with pytest.raises(dc.InputError):
        table.write(time=1, force=np.zeros(3 if COMM.rank == last else 2))
    assert len(rows(file)) == 2
    if COMM.rank == 0:
        file.write_text("name,force\nfirst,1\n")
    for resume, text in ((1, "other things than numbers"), ("1", "resume is '1'")):
        with pytest.raises(dc.InputError, match=text):
            dc.Table(file, resume=resume)
    assert rows(file)[1] == ["first", "1"]


def test_cannot_be_written(file):
    """A folder in the place of the file; a disk that is full leaves no part of a row."""
    if COMM.rank == 0:
        file.mkdir(parents=True)
    COMM.Barrier()
    for where in (file, file / "a" / "b.csv"):
        if where == file:
            with pytest.raises(dc.ContactError, match="cannot be written"):
                dc.Table(where)
        else:
            table = dc.Table(where)
    table.write(time=0)
    was = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (12, was[1]))
    try:
        with pytest.raises(dc.ContactError, match="cannot be written.*space left"):
            table.write(time=123456789.125)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, was)
    assert rows(where) == [["time"], ["0"]]
    table.write(time=1)
    assert rows(where) == [["time"], ["0"], ["1"]]
