# SPDX-License-Identifier: MIT
"""Checkpoints: a run that was stopped goes on as if it had not been, on any number of ranks."""

from __future__ import annotations

import os
import resource
import types
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
    MASTER,
    PUNCH_MATERIAL,
    SLAVE,
    TOP,
    dome,
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
from versions import space

import dolfinx_contact as dc
from dolfinx_contact import checkpoint, compat, meshes, surface
from dolfinx_contact.report import CHANGES

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


def proximity(comm: Any, partition: Any = striped) -> Scene:
    """Closest points with facets' normals: a particle near a junction keeps its former facet."""
    return ironed(comm, partition, target=dc.Proximity())


def cut(comm: Any, partition: Any = striped) -> Scene:
    """Steps fail and are halved."""
    scene = ironed(comm, partition)
    scene.problem.strategy = dc.Newton(max_it=4)
    scene.options = {"step": 0.2, "min_step": 1e-3}
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


def plastic(comm: Any, partition: Any = striped) -> Scene:
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
        lambda t: tool.move((0.03 * t, -0.03 * np.sin(np.pi * t))),
        measure,
        {"step": 0.15},
    )


def viscous(comm: Any, partition: Any = striped) -> Scene:
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
    problem = model.problem(pair)

    def apply(t: float) -> None:
        tool.push((0.0, -40.0 * min(1.0, 0.2 + t)))
        tool.move((0.2 * max(0.0, t - 0.4), 0.0))

    def measure() -> Any:
        return [*of_pair(pair)(), tool.translation, tool.force(), problem.system.driven._reactions]

    return Scene(problem, apply, measure, {"step": 0.15})


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


SCENES = (ironed, segments, proximity, cut, turned_dome, on_plane, plastic, viscous, driven, mixed)


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
    for kind in ("iterations", *CHANGES):
        assert [getattr(s.report, kind) for s in steps] == [
            getattr(s.report, kind) for s in others
        ], kind
    assert_same(rows, figures)


@pytest.mark.parametrize("part", (0.25, 0.6))
@pytest.mark.parametrize("make", SCENES)
def test_a_stopped_run_goes_on(make, part, folder):
    """On the same ranks, and from the ranks' file on each rank alone."""
    file = folder / "run.h5"
    uninterrupted = whole(make, COMM)
    if make is cut:
        assert sum(s.failed for s in uninterrupted[0]) > 1
    stop = int(np.ceil(part * len(uninterrupted[0])))
    first_part(make, COMM, file, stop)
    assert sorted(os.listdir(folder)) == ["run.h5"]
    assert_goes_on(second_part(make, COMM, file, stop), uninterrupted)
    assert_goes_on(second_part(make, MPI.COMM_SELF, file, stop), uninterrupted)


def test_facets_with_other_numbers(folder, monkeypatch):
    """Numbers of facets may depend on the partition, as after dc.repartition. Particles that are
    beside their former facets by less than the margin stay there."""
    file, stop = folder / "run.h5", 8
    uninterrupted = whole(proximity, COMM)
    first_part(proximity, COMM, file, stop)
    with h5py.File(file) as saved:
        particles = saved["tables/pair0.particles"]
        beside = particles["closed"][()] & (np.abs(particles["target_xi"][:, 0] - 0.5) > 0.501)
    assert beside.any()
    ids = proximity(COMM).problem.pairs[0].master.id

    def others(mesh: Any) -> Any:
        return 1000 - compat.original_cells(mesh)

    names = {**vars(compat), "original_cells": others}
    monkeypatch.setattr(surface, "compat", types.SimpleNamespace(**names))
    assert not np.intersect1d(ids, proximity(COMM).problem.pairs[0].master.id).size
    assert_goes_on(second_part(proximity, COMM, file, stop), uninterrupted)

    scene = proximity(COMM)
    scene.stepping().load(file)
    (pair,), (contact,) = scene.problem.pairs, scene.problem.system.contacts
    contact.update(at_rest=True)
    closed, xi = pair._accepted["closed"], contact.assembler.particles()["target_xi"]
    np.testing.assert_allclose(xi[closed], pair._accepted["target_xi"][closed], atol=1e-9)


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


# -- what the file holds, and what may go wrong ---------------------------------------------------


def saved(folder: Path, make: Any = ironed, stop: int = 2, comm: Any = COMM) -> tuple[Any, Path]:
    """A stepping after some steps, and its checkpoint."""
    file, stepping = folder / "run.h5", make(comm).stepping()
    for step in stepping:
        if step.number == stop:
            break
    stepping.save(file, a=1.5, b=[[1, 2]], c=True)
    return stepping, file


def state_of(stepping: Any) -> list[Any]:
    """All that a failed load must leave alone."""
    problem = stepping.problem
    out = [u.x.array.copy() for u in problem.system.functions]
    for pair, contact in zip(problem.pairs, problem.system.contacts):
        out += [np.array(v) for v in contact.assembler.particles().values()]
        out += [np.array(v) for v in (pair._accepted or {}).values()]
    out += [np.array([stepping.time, stepping._next, stepping._ease, len(stepping.steps)])]
    return out


def assert_unchanged(before: list[Any], after: list[Any]) -> None:
    assert len(before) == len(after)
    for a, b in zip(before, after):
        np.testing.assert_array_equal(a, b)


def test_the_users_arrays(folder):
    """They come back on all ranks, as they were."""
    _, file = saved(folder)
    arrays = ironed(COMM).stepping().load(file)
    assert set(arrays) == {"a", "b", "c"}
    assert arrays["a"] == 1.5 and arrays["a"].shape == ()
    np.testing.assert_array_equal(arrays["b"], [[1, 2]])
    assert arrays["b"].dtype == int and arrays["c"].dtype == bool
    assert set(dc.checkpoint.arrays(file, COMM)) == {"a", "b", "c"}


def test_results_are_those_of_the_checkpoint(folder):
    """Fields and particles of the pair, before any further step; loads are in place."""
    stepping, file = saved(folder, turned_dome, 3)
    (pair,) = stepping.problem.pairs
    other = turned_dome(COMM, striped)
    loaded, times, apply = other.stepping(), [], other.apply
    loaded._apply = lambda t: (times.append(t), apply(t))
    loaded.load(file)
    assert times == [loaded.time] == [stepping.time]
    (again,) = other.problem.pairs
    for f, g in ((pair.pressure, again.pressure), (pair.friction, again.friction)):
        np.testing.assert_allclose(g.x.array, f.x.array, atol=1e-12 * np.abs(f.x.array).max())
    for name, column in vars(pair.particles).items():
        if name != "slave":
            np.testing.assert_array_equal(getattr(again.particles, name), column, name)
    np.testing.assert_allclose(again._solved()["slave"], pair._solved()["slave"], atol=1e-15)
    steps = COMM.bcast(list(stepping.steps))  # the seconds in it are of rank 0
    assert list(loaded.steps) == steps


def test_back_to_an_earlier_step(folder):
    """A problem that has gone on goes back to its checkpoint, and the same way again."""
    scene, file = ironed(COMM), folder / "run.h5"
    stepping = scene.stepping()
    for step in stepping:
        if step.number == 4:
            stepping.save(file)
    end = scene.figures()
    stepping.load(file)
    assert len(stepping.steps) == 4
    assert len(list(stepping)) == len(stepping.steps) - 4
    assert_same(scene.figures(), end)


def test_loads_after_the_end_are_new_steps(folder):
    """A finished run is saved, and resumed with a later end."""
    stepping, file = saved(folder, ironed, 100)
    assert stepping.time == 1.0
    scene = ironed(COMM)
    longer = scene.stepping(end=1.1)
    longer.load(file)
    assert [s.number for s in longer] == [len(stepping.steps) + 1]
    assert longer.time == 1.1


def test_mixed_spaces_and_spaces_of_any_degree(folder):
    """Rows of a mixed space, of facets' midpoints, of several points on an edge, of constants."""
    mesh = punch(COMM, striped).mesh
    alone = punch(MPI.COMM_SELF).mesh
    for element in (
        [("Lagrange", 3)],
        [("DQ", 0)],
        [("DQ", 1, 2)],
        [("Lagrange", 2, 2), ("DQ", 1)],
    ):
        V, W = (space(m, *element) for m in (mesh, alone))
        f, g, file = fem.Function(V), fem.Function(W), folder / "f.h5"
        whole = lambda x: np.array([np.sin(x[0]) + 3 * x[1] ** 2, x[0] * x[1] + x[0]])
        for i, h in enumerate((f, g)):
            parts = [h.sub(k) for k in range(2)] if len(checkpoint.dof_tables(V, "")) > 1 else [h]
            for part in parts:
                try:
                    part.interpolate(whole)
                except RuntimeError:
                    part.interpolate(lambda x: whole(x)[0])
        tables = {}
        for i, (rows, table) in enumerate(checkpoint.dof_tables(V, "f")):
            table.columns["f"] = f.x.array[rows]
            tables[f"f{i}"] = table
        checkpoint.write(COMM, file, {}, tables, {})
        with checkpoint.Checkpoint(COMM, file) as read:
            pass
        with checkpoint.Checkpoint(MPI.COMM_SELF, file) as read:
            back = fem.Function(W)
            for i, (rows, table) in enumerate(checkpoint.dof_tables(W, "f")):
                back.x.array[rows] = read.columns(f"f{i}", table)["f"]
        np.testing.assert_allclose(back.x.array, g.x.array, atol=1e-13)


def test_unknowns_without_points_are_refused():
    s = Specimen(2, 2)
    V = space(s.mesh, ("RTCF", 1))
    expect(dc.InputError, lambda: checkpoint.dof_tables(V, "u[1]"), "u[1]", "no values at points")


def test_bodies_in_one_another_are_refused():
    """Two cells at one place: rows of the one could be taken for the other's."""
    bodies = [meshes.grid((2, 2), (0, 0), (1, 1)) for _ in range(2)]
    mesh, _ = meshes.create(COMM, bodies, lambda x, ranks: np.zeros(len(x), dtype=int))
    V = compat.vector_space(mesh, 1)
    expect(dc.InputError, lambda: checkpoint.dof_tables(V, "u[0]"), "u[0]", "coincide")


def test_nothing_to_save_yet(folder):
    stepping = ironed(COMM).stepping()
    expect(dc.InputError, lambda: stepping.save(folder / "run.h5"), "nothing is solved yet")
    assert os.listdir(folder) == []


def test_arrays_that_are_no_numbers(folder):
    stepping, file = saved(folder)
    before = file.read_bytes()
    expect(dc.InputError, lambda: stepping.save(file, names=["a"]), "names", "numbers")
    expect(dc.InputError, lambda: stepping.save(file, f=[None]), "f is of type", "numbers")
    assert file.read_bytes() == before


def test_a_law_that_keeps_its_state(folder):
    scene = viscous(COMM)
    stepping = scene.stepping()
    next(iter(stepping))
    scene.problem.system.bulk.materials[0].law = type("Mute", (), {})()
    expect(
        dc.InputError,
        lambda: stepping.save(folder / "run.h5"),
        "Mute",
        "no state and no set_state",
    )


def broken(kind: str, file: Path, stepping: Any) -> tuple[Path, tuple[str, ...]]:
    """A file that does not fit, made on rank 0, and what the error has to tell."""
    path = file.with_name("other.h5")
    if COMM.rank == 0:
        data = file.read_bytes()
        if kind == "truncated":
            path.write_bytes(data[: len(data) // 2])
        elif kind == "empty":
            path.write_bytes(b"")
        elif kind == "text":
            path.write_text("a run")
        elif kind == "another format":
            with h5py.File(path, "w") as other:
                other["a"] = 1
        elif kind == "lacking":
            path.write_bytes(data)
            with h5py.File(path, "r+") as other:
                del other["tables/pair0.particles"]
    COMM.barrier()
    return path, ("other.h5", "There is no" if kind == "missing" else "no whole checkpoint")


@pytest.mark.parametrize(
    "kind", ("missing", "truncated", "empty", "text", "another format", "lacking")
)
def test_files_that_are_no_checkpoints(kind, folder):
    stepping, file = saved(folder)
    before = state_of(stepping)
    path, parts = broken(kind, file, stepping)
    expect(dc.InputError, lambda: stepping.load(path), *parts)
    assert_unchanged(before, state_of(stepping))
    stepping.load(file)  # it can still be done


def other_scene(kind: str) -> tuple[Scene, tuple[str, ...]]:
    """A scene that the checkpoint of ``ironed`` does not fit."""
    if kind == "facets":
        model = punch(COMM, striped, counts=(13, 9))
        return Scene(model.problem(model.pair(friction=0.3)), lambda t: None, None, {}), (
            "u[0]",
            "nodes",
        )
    if kind == "places":  # as many nodes at other places
        model = punch(COMM, striped, counts=(12, 9), shift=0.02)
        return Scene(model.problem(model.pair(friction=0.3)), lambda t: None, None, {}), (
            "u[0] (displacement)",
            "are not in the file",
        )
    model = punch(COMM, striped, counts=(12, 9))
    if kind == "friction":
        return Scene(model.problem(model.pair()), lambda t: None, None, {}), (
            "pairs[0]",
            "no friction",
        )
    if kind == "rule":
        pair = model.pair(friction=0.3, integration=dc.Simpson(2))
        return Scene(model.problem(pair), lambda t: None, None, {}), ("pairs[0]", "Simpson(n=2)")
    if kind == "pressure":
        pair = model.pair(friction=0.3, pressure_space=("DG", 0), friction_space=("Lagrange", 1))
        return Scene(model.problem(pair), lambda t: None, None, {}), ("pairs[0]", "DG")
    if kind == "no pair":
        problem = dc.ContactProblem(model.F, model.u, [], bcs=model.bcs)
        return Scene(problem, lambda t: None, None, {}), ("pairs[0]", "the problem none")
    tool = dc.RigidPlane((0.0, 0.0), (0.0, 1.0))
    pair = dc.ContactPair(model.surface(SLAVE), tool, friction=0.3)
    return Scene(model.problem(pair), lambda t: None, None, {}), ("pairs[0]", "RigidPlane")


@pytest.mark.parametrize(
    "kind", ("facets", "places", "friction", "rule", "pressure", "no pair", "tool")
)
def test_checkpoints_of_other_problems(kind, folder):
    _, file = saved(folder)
    scene, parts = other_scene(kind)
    stepping = scene.stepping()
    before = state_of(stepping)
    expect(dc.InputError, lambda: stepping.load(file), "run.h5", *parts)
    assert_unchanged(before, state_of(stepping))


def test_no_folder(folder):
    stepping, _ = saved(folder)
    expect(dc.ContactError, lambda: stepping.save(folder / "none" / "run.h5"), "none", "written")


@pytest.mark.parametrize("size", (0, 2000, 20000))
def test_a_full_disk(size, folder):
    """The system refuses to write beyond a size: the former checkpoint stays, and no other file."""
    stepping, file = saved(folder)
    data = file.read_bytes()
    assert len(data) > 1.5 * size
    next(iter(stepping))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        expect(dc.ContactError, lambda: stepping.save(file), "run.h5", "cannot be written")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert file.read_bytes() == data and sorted(os.listdir(folder)) == ["run.h5"]
    stepping.save(file)  # there is room again
    COMM.barrier()
    assert ironed(COMM).stepping().load(file) == {}


@pytest.mark.parametrize("name", ("fsync", "replace"))
def test_a_crash_before_the_end(name, folder, monkeypatch):
    """Nothing has replaced the former file before the new one is on the disk."""
    stepping, file = saved(folder)
    data = file.read_bytes()

    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, name, fail)
    expect(dc.ContactError, lambda: stepping.save(file, b=2), "No space left on device")
    assert file.read_bytes() == data


def test_a_part_that_was_left_does_not_matter(folder):
    """A run that was killed while it wrote has left the part that was written."""
    stepping, file = saved(folder)
    if COMM.rank == 0:
        (folder / "run.h5.part").write_bytes(file.read_bytes()[:3000])
    COMM.barrier()
    ironed(COMM).stepping().load(file)
    stepping.save(file)
    COMM.barrier()
    assert sorted(os.listdir(folder)) == ["run.h5"]
