# SPDX-License-Identifier: MIT
"""What ranks hold decides their searches as the whole master surface would; and it is little."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, exchange, meshes

COMM = MPI.COMM_WORLD
RULES = {
    "smooth": {"target": dc.Smooth()},
    "proximity": {"target": dc.Proximity(), "friction": 0.2},
    "direction": {"target": dc.SeekDirection((0.02, 0.05, 1.0))},
    "slave normal": {"target": dc.SlaveNormal(), "friction": 0.2},
    "segments": {"target": dc.Smooth(), "integration": dc.Segments()},
}


def sliced(x, ranks):
    """The same whenever it is called, as DOLFINx's own partition need not be."""
    return np.argsort(np.argsort(x[:, 0], kind="stable")) * ranks // len(x)


def scattered(x, ranks):
    return np.random.default_rng(3).integers(0, ranks, len(x))


def inclined(dim, overhang):
    """A slave that rises away from the master, and may be beside it at first; points of both."""

    def bent(x):
        y = x.copy()
        y[:, -1] += 0.05 * np.sin(4 * x[:, 0]) + 0.35 * np.maximum(x[:, 0] - 0.4, 0)
        return y

    def wave(x):
        return np.c_[x[:, :-1], x[:, -1] + 0.03 * np.cos(7 * x[:, 0])]

    rest = [1] * (dim - 2)
    cell = "hexahedron" if dim == 3 else "quadrilateral"
    sides = [-0.4 if overhang else 0.1, *(0.4 * r for r in rest)], [1.0, *(0.6 * r for r in rest)]
    counts = (21, *(3 * r for r in rest), 1), (44, *(17 * r for r in rest), 1)
    slave = meshes.grid(counts[0], [*sides[0], 0], [*sides[1], 0.2], bent, cell)
    master = meshes.grid(counts[1], [0] * (dim - 1) + [-0.3], [1.6, *rest, 0], wave, cell)
    return slave, master, bent, wave


def tables(dim, arguments, partition, overhang):
    """Particles after each of some motions, by facet and place, as far as this rank has them."""
    slave, master, bent, wave = inclined(dim, overhang)
    mesh, body = meshes.create(COMM, [slave, master], partition)
    at = lambda f: lambda x: np.isclose(x[dim - 1], f(np.c_[x[: dim - 1].T, 0 * x[0]])[:, -1])
    tags = meshes.tag_facets(mesh, {5: (at(bent), 0), 6: (at(wave), 1)}, body)
    V = compat.vector_space(mesh, 1)
    u = fem.Function(V)
    F = ufl.inner(u, ufl.TestFunction(V)) * ufl.dx
    arguments = dict(arguments)
    if "direction" in getattr(arguments["target"], "__dict__", {}):
        arguments["target"] = dc.SeekDirection(arguments["target"].direction[3 - dim :])
    pair = dc.ContactPair(dc.Surface(u, tags, 5), dc.Surface(u, tags, 6), **arguments)
    contact = dc.ContactProblem(F, u, [pair]).system.contacts[0]
    above = np.unique(compat.dof_list(V)[body == 0])
    out, held = [], []
    for x, z in ((0, 0), (0.01, -0.02), (0.3, -0.05), (0.32, 0.2), (0.9, -0.3), (0.1, 0.0)):
        u.x.array[dim * above] = x
        u.x.array[dim * above + dim - 1] = z
        contact.update()
        contact.hold()
        table = contact.assembler.particles()
        keys = ("facet", "xi", "target_facet", "gap", "target", "normal", "closed")
        out.append([np.asarray(table[k]).copy() for k in keys] + [contact.held.copy()])
        held.append(len(contact.master))
    return out, held


@pytest.mark.parametrize("overhang", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("rule", RULES)
def test_targets_are_those_of_the_whole_surface(rule, dim, overhang, monkeypatch):
    """Through motions small and large, near and far, with ends in sight."""
    for partition in (sliced, scattered)[: 4 - dim]:
        found, few = tables(dim, RULES[rule], partition, overhang)
        with monkeypatch.context() as patch:
            patch.setattr(exchange, "_NEAR", 1e6)  # all within d_max
            expected, many = tables(dim, RULES[rule], partition, overhang)
        for step, (ours, theirs) in enumerate(zip(found, expected)):
            for a, b in zip(ours, theirs):
                # a facet that has been away in between is searched from another start: round-off
                exact = a.dtype.kind != "f"
                compare = np.testing.assert_array_equal if exact else np.testing.assert_allclose
                compare(a, b, err_msg=f"motion {step}", **({} if exact else {"atol": 1e-12}))
        # it would be no test if the facets were the same
        total = COMM.allreduce(np.array([few, many])).sum(axis=1)
        assert total[0] < total[1]
        gap = np.concatenate([step[3] for step in expected])
        assert COMM.allreduce(int(np.isfinite(gap).sum())) > 0
        assert COMM.allreduce(int(np.isinf(gap).sum())) > 0


def benchmark():
    path = Path(__file__).resolve().parent.parent / "benchmarks" / "exchange.py"
    spec = importlib.util.spec_from_file_location("benchmark_exchange", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("partition", ["graph", "repartition"])
def test_facets_held_are_proportional_to_own(partition):
    held, received, size, near = benchmark().measure(20, partition)
    assert held <= 2 * near
    assert received <= 2 * size * near
    assert (received > 0) == (COMM.size > 1)
