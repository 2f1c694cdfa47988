# SPDX-License-Identifier: MIT
"""Memory does not grow from step to step."""

import ctypes
import gc
import sys
from pathlib import Path

from mpi4py import MPI

import dolfinx_contact as dc

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from long_run import ironing  # noqa: E402

COMM = MPI.COMM_WORLD


class Heap(ctypes.Structure):
    """struct mallinfo2 of glibc."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keep".split()
    ]


def in_use():
    """Bytes that C and C++ hold on this rank; Python's small objects are apart."""
    gc.collect()
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = Heap
    heap = libc.mallinfo2()
    return heap.uordblks + heap.hblkhd


def test_steps_leave_nothing_for_the_collector():
    """Objects that hold each other stay until Python's collector comes, vectors and all: with a class
    for each assembled vector (DOLFINx 0.5), or what a failed solve has raised."""
    problem, pair, place = ironing(COMM, 24)
    problem.solve()  # what is made once is made now
    problem.strategy = dc.Newton(max_it=5)  # some steps fail
    apply = lambda t: place(0.0, -0.6 * t)  # noqa: E731
    stepping = dc.LoadStepping(problem, apply, step=1.0, min_step=0.05, progress=False)
    gc.collect()
    gc.disable()
    try:
        failed = [step.failed for step in stepping]
        left = gc.collect()
    finally:
        gc.enable()
    assert sum(failed) > 0 and len(failed) > 1
    # a failed solve used to leave 14 objects, each residual 5; Python itself may leave a few
    assert left < 10, f"{left} objects in {len(failed)} steps"


def test_steps_leave_no_memory_behind():
    """Steps to and fro, in each of which master facets are fetched anew: PETSc's objects are freed.
    (One vector of this problem has 3 kB; with two of them left in each step this fails.)"""
    problem, pair, place = ironing(COMM, 24)
    period, held = 20, []

    def apply(t):
        way = abs((t / period) % 1 - 0.5)  # from 0.5 to 0 and back
        place(1.0 - 2 * way, -0.15 * min(t / 5, 1))

    for step in dc.LoadStepping(problem, apply, end=100.0, step=1.0, progress=False):
        pair.resultant()
        if step.number % 20 == 0:
            held.append(in_use())
    # what a step leaves behind is in each difference; other things of this process are in some
    growth = min(b - a for a, b in zip(held[1:], held[2:]))
    assert COMM.allreduce(growth, op=MPI.MAX) < 20 * 1500
