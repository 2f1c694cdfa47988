# SPDX-License-Identifier: MIT
"""Checkpoints: a run that was stopped goes on as if it had not been, on any number of ranks."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable

import h5py
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import (
    BOTTOM,
    MASTER,
    PUNCH_MATERIAL,
    SLAVE,
    TOP,
    block_halves,
    dome,
    height,
    one_mesh,
    punch,
    punch_halves,
    remote,
    striped,
    two_meshes,
    ROTATION,
)
from rigid import ball, block
from specimen import VOCE, Specimen
from test_errors import expect
from test_mixed import bulk
from test_quadrature import Viscous

import dolfinx_contact as dc
from dolfinx_contact import checkpoint, compat

COMM = MPI.COMM_WORLD
SAME = 1e-9  # of the largest figure


@dataclass
class Scene:
    """A run: how it is loaded, what is measured after each step."""

    problem: dc.ContactProblem
    apply: Callable[[float], Any]
    measure: Callable[[], Any]
    options: dict[str, Any]

    def stepping(self, **options: Any) -> dc.LoadStepping:
        return dc.LoadStepping(
            self.problem, self.apply, progress=False, **{**self.options, **options}
        )

    def figures(self) -> np.ndarray:
        return np.concatenate([np.ravel(a) for a in self.measure()])


def of_pair(pair: dc.ContactPair) -> Callable[[], Any]:
    def measure() -> Any:
        particles = pair.particles
        counts = [np.sum(particles.status == s) for s in ("open", "stick", "slip")]
        out = [pair.resultant(), pair.comm.allreduce(np.array(counts)), pair.contact_area()]
        if pair.frictional:
            out += [pair.friction_resultant(), pair.dissipated_energy()]
        return out

    return measure


def ironed(comm: Any, partition: Any = striped, **options: Any) -> Scene:
    """A punch is pressed into a block and drawn along, with stick and slip; steps grow."""
    model = punch(comm, partition, counts=(12, 9))
    pair = model.pair(friction=0.3, **options)

    def apply(t: float) -> None:
        model.move(TOP, (0.4 * max(0.0, t - 0.3), -0.3 * min(t, 0.3)))

    steps = {"step": 0.05, "max_step": 0.12}
    return Scene(model.problem(pair), apply, of_pair(pair), steps)


def segments(comm: Any, partition: Any = striped) -> Scene:
    return ironed(comm, partition, integration=dc.Segments())


def cut(comm: Any, partition: Any = striped) -> Scene:
    """Steps fail and are halved."""
    scene = ironed(comm, partition)
    scene.problem.strategy = dc.Newton(max_it=6)
    scene.options = {"step": 0.3, "min_step": 1e-3}
    return scene


def turned_dome(comm: Any, partition: Any = striped) -> Scene:
    """In 3D, where tangents are chosen; with friction in another space than the pressure."""
    model = dome(comm, partition)
    pair = model.pair(friction=0.3, friction_space=("DG", 1))

    def apply(t: float) -> None:
        model.move(
            TOP, ROTATION @ [0.05 * max(0.0, t - 0.4), 0.03 * t**2, -0.06 * min(1, 2 * t)]
        )

    return Scene(model.problem(pair), apply, of_pair(pair), {"step": 0.2})


def on_plane(comm: Any, partition: Any = striped) -> Scene:
    """The block of ``ironed`` on a prescribed rigid plane that is drawn along and turned."""
    model = one_mesh(comm, punch_halves((12, 9))[:1], PUNCH_MATERIAL, partition)
    plane = dc.RigidPlane((0.0, 0.0), (0.0, 1.0))
    pair = dc.ContactPair(model.surface(SLAVE), plane, friction=0.2)

    def apply(t: float) -> None:
        model.move(TOP, (0.0, -0.06 * min(1, 2 * t)))
        plane.move((0.1 * t, 0.0), 0.05 * t)

    def measure() -> Any:
        return [*of_pair(pair)(), plane.force(), plane.moment()]

    return Scene(model.problem(pair), apply, measure, {"step": 0.1})


def plastic(comm: Any, partition: Any = None) -> Scene:
    """An elastic-plastic block under a ball, loaded and unloaded."""
    s = Specimen(2, 4, comm=comm, partition=partition)
    s.sheet = dc.plasticity.J2(s.u, 69004.0, 0.3, VOCE)
    s.hold(3, 0, 1)
    tool = dc.RigidSphere((0.55, 1.5), 0.5)
    pair = dc.ContactPair(s.surface(4), tool, friction=0.2)
    problem = s.problem(s.sheet, pairs=[pair])

    def measure() -> Any:
        sums = [s.sheet.values(f).sum(axis=0) for f in (s.sheet.plastic_strain, s.sheet.kirchhoff)]
        return [*of_pair(pair)(), comm.allreduce(np.concatenate(sums))]

    return Scene(
        problem,
        lambda t: tool.move((0.03 * t, -0.05 * np.sin(np.pi * t))),
        measure,
        {"step": 0.15},
    )


def viscous(comm: Any, partition: Any = None) -> Scene:
    """A law of the user with a history, and no pairs."""
    s = Specimen(2, 3, comm=comm, partition=partition)

    class Saved(Viscous):
        def state(self):
            return [self.old]

        def set_state(self, state):
            (self.old,) = state
            self.now = self.old.copy()

    s.law = Saved(dt=0.1)
    s.material = dc.QuadratureLaw(ufl.Identity(2) + ufl.grad(s.u), s.law)
    s.hold(3, 0, 1)
    top = s.hold(4, 0, 1)
    F = ufl.inner(s.material.P, ufl.grad(s.w)) * s.material.dx
    problem = s.problem([s.material], F)

    def apply(t: float) -> None:
        top.value = 0.2 * min(t, 0.5)

    def measure() -> Any:
        P = s.material.values(s.material._stress)
        return [comm.allreduce(np.sum(P, axis=0))]

    return Scene(problem, apply, measure, {"step": 0.2})


def driven(comm: Any, partition: Any = striped) -> Scene:
    """A ball that a force drives down while it is drawn along, with friction, from afar."""
    model, tool = block(comm, 2, partition), ball(2, 0.3)
    tool.push((0.0, -1.0))
    pair = dc.ContactPair(model.surface(SLAVE), tool, friction=0.3)

    def apply(t: float) -> None:
        tool.push((0.0, -40.0 * min(1.0, 0.2 + t)))
        tool.move((0.2 * max(0.0, t - 0.4), 0.0))

    def measure() -> Any:
        return [*of_pair(pair)(), tool.translation, tool.force()]

    return Scene(model.problem(pair), apply, measure, {"step": 0.15})


def mixed(comm: Any, partition: Any = striped) -> Scene:
    """Two meshes; the slave's body has pressures as unknowns, discontinuous ones."""
    upper, lower = two_meshes(comm, punch_halves((10, 7)), PUNCH_MATERIAL, partition)
    body = bulk(upper, "u-p", 1000.0)
    pair = dc.ContactPair(upper.surface(SLAVE), lower.surface(MASTER), friction=0.3)
    problem = dc.ContactProblem(
        [*body.F, lower.F], [*body.u, lower.u], [pair], bcs=upper.bcs + lower.bcs
    )

    def apply(t: float) -> None:
        upper.move(TOP, (0.1 * max(0.0, t - 0.4), -0.08 * min(1, 2 * t)))

    return Scene(problem, apply, of_pair(pair), {"step": 0.2})


SCENES = (ironed, segments, cut, turned_dome, on_plane, plastic, viscous, driven, mixed)


@pytest.fixture
def folder(tmp_path):
    """One folder for all ranks."""
    path = COMM.bcast(tmp_path, root=0)
    yield path
    COMM.barrier()


def whole(make: Any, comm: Any, **options: Any) -> tuple[Any, np.ndarray]:
    """An uninterrupted run: steps, and what was measured after each."""
    scene = make(comm, **options)
    rows = []
    stepping = scene.stepping()
    for _ in stepping:
        rows.append(scene.figures())
    return stepping.steps, np.array(rows)


def first_part(make: Any, comm: Any, file: Path, stop: int, **options: Any) -> None:
    """Run up to a step, and save after each."""
    scene = make(comm, **options)
    stepping, rows = scene.stepping(), []
    for step in stepping:
        rows.append(scene.figures())
        stepping.save(file, rows=rows, number=step.number)
        if step.number == stop:
            break


def second_part(
    make: Any, comm: Any, file: Path, stop: int, **options: Any
) -> tuple[Any, np.ndarray]:
    """Everything anew, and on from the file."""
    scene = make(comm, **options)
    stepping = scene.stepping()
    arrays = stepping.load(file)
    assert arrays["number"] == stop == len(stepping.steps)
    rows = list(arrays["rows"])
    # results are there before the first step
    assert_same(scene.figures(), rows[-1], 1e-12)
    for _ in stepping:
        rows.append(scene.figures())
    return stepping.steps, np.array(rows)


def assert_same(a: Any, b: Any, tolerance: float = SAME) -> None:
    """Columns agree, each to its largest figure, and to that of all for those that vanish."""
    a, b = np.atleast_2d(a), np.atleast_2d(b)
    assert a.shape == b.shape
    scale = np.maximum(np.abs(b).max(axis=0), 1e-3 * np.abs(b).max())
    assert np.max(np.abs(a - b) / scale) < tolerance, np.abs(a - b).max(axis=0) / scale


def assert_goes_on(resumed: Any, uninterrupted: Any) -> None:
    (steps, rows), (others, figures) = resumed, uninterrupted
    assert [s.number for s in steps] == [s.number for s in others]
    for name in ("time", "length", "smallest"):
        a, b = ([getattr(s, name) for s in run] for run in (steps, others))
        np.testing.assert_allclose(a, b, rtol=1e-13)
    assert [s.failed for s in steps] == [s.failed for s in others]
    for kind in ("iterations", "status_changes", "slip_changes", "reversals"):
        assert [getattr(s.report, kind) for s in steps] == [
            getattr(s.report, kind) for s in others
        ], kind
    assert_same(rows, figures)


@pytest.mark.parametrize("make", SCENES)
def test_a_stopped_run_goes_on(make, folder):
    """On the same ranks, and from the ranks' file on each rank alone."""
    file = folder / "run.h5"
    uninterrupted = whole(make, COMM)
    stop = len(uninterrupted[0]) // 2
    first_part(make, COMM, file, stop)
    assert sorted(os.listdir(folder)) == ["run.h5"]
    assert_goes_on(second_part(make, COMM, file, stop), uninterrupted)
    assert_goes_on(second_part(make, MPI.COMM_SELF, file, stop), uninterrupted)


@pytest.mark.parametrize("make", (ironed, turned_dome, plastic, driven, mixed))
def test_from_one_rank_to_all(make, folder):
    """A file of one rank's run is taken up by all, on another partition."""
    file = folder / "run.h5"
    uninterrupted = whole(make, MPI.COMM_SELF)
    stop = len(uninterrupted[0]) // 2
    if COMM.rank == 0:
        first_part(make, MPI.COMM_SELF, file, stop)
    COMM.barrier()
    assert_goes_on(second_part(make, COMM, file, stop, partition=remote), uninterrupted)
