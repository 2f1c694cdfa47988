# SPDX-License-Identifier: MIT
"""Elements for large plastic strain: the recipes of benchmarks/locking.py, and its page."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from dolfinx_contact import meshes

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "benchmarks"))
import locking  # noqa: E402

sys.path.pop(0)

COMM = MPI.COMM_WORLD
DEPTH = 0.15
FREE = ["Q2", "P2", "Q2 selective", "Q1/P0", "Q1/P0/P0", "Q2/P1", "P2/P1"]


@pytest.fixture(scope="module")
def indented():
    """Results of the block on a coarse mesh, each computed once."""
    known = {}

    def result(name):
        if name not in known:
            known[name] = locking.indent(COMM, name, 8, DEPTH)
        return known[name]

    return result


@pytest.mark.parametrize("name", ["P1", "Q1"])
def test_plain_elements_lock(name, indented):
    """They are too stiff by 35 % (Q1) and 80 % (P1) there."""
    assert indented(name).force[DEPTH] > 1.3 * indented("Q2/P1").force[DEPTH]
    assert indented(name).oscillation > 3


@pytest.mark.parametrize("name", FREE)
def test_the_others_agree(name, indented):
    """Within 2.4 % (measured) with 4 cells of degree 2 over the height, in large plastic strain."""
    result = indented(name)
    assert result.largest_strain() > 0.3
    assert abs(result.force[DEPTH] / indented("Q2/P1").force[DEPTH] - 1) < 0.03


@pytest.mark.parametrize("name", ["Q2 selective", "Q1/P0", "Q1/P0/P0", "Q2/P1", "P2/P1"])
def test_mean_stress_is_smooth(name, indented):
    assert indented(name).oscillation < 0.1


@pytest.mark.parametrize("name", ["Q1", "Q2 selective", "Q1/P0", "Q1/P0/P0", "Q2/P1", "P2/P1"])
def test_parallel_is_serial(name, indented):
    """Newton leaves 1e-10 of the forces in each of the steps."""
    alone = locking.indent(MPI.COMM_SELF, name, 8, DEPTH).force[DEPTH]
    assert indented(name).force[DEPTH] == pytest.approx(alone, rel=1e-6)


def test_reduced_integration_has_a_mode_without_energy():
    """One in a block on symmetry planes, none in a sheet with a clamped rim."""
    for kind, counts, size, rim, modes in (
        ("plane strain", (8, 4), (2, 1), (1, locking.LOWER), 1),
        ("axisymmetric", (30, 2), (59.18, 1), (None, locking.RIM), 0),
    ):
        mesh, tags, recipe = locking.grid(MPI.COMM_SELF, "Q2 reduced", counts, size)
        _, (u,), law, _ = recipe(mesh, kind, locking.BLOCK)
        bcs = locking.held(u, tags, [(0, locking.AXIS), rim])
        A = fem.petsc.assemble_matrix(fem.form(law.J), bcs=bcs)
        A.assemble()
        dense = A.convert("dense")
        values = dense.getDenseArray()
        energies = np.linalg.eigvalsh(0.5 * (values + values.T))
        assert np.sum(energies < 1e-12 * energies[-1]) == modes


@pytest.mark.parametrize("name", ["Q2 reduced", "Q1/P0"])
def test_sheet(name):
    """The punch force of an independent model, 28.9 kN at 20 mm, within 1.5 %."""
    found = locking.stretch(COMM, name, (30, 2), (20,)).force[20]
    assert abs(found / locking.REFERENCE[20] - 1) < 0.015


def stationary(recipe, kind, **choice):
    """Residuals and unknowns of a recipe on two cells, at a state with strains."""
    cell = "hexahedron" if kind == "3D" else "quadrilateral"
    body = meshes.grid((2,) + (1,) * (2 if kind == "3D" else 1), cell=cell)
    body.points[:, 0] += 1  # off the axis
    mesh, _ = meshes.create(MPI.COMM_SELF, body)
    forms, unknowns, law, _ = recipe(mesh, kind, locking.BLOCK, **choice)
    rng = np.random.default_rng(3)
    for f in unknowns:
        f.x.array[:] += 0.01 * rng.standard_normal(f.x.array.shape)
    return forms, unknowns, law


@pytest.mark.parametrize("kind", ["plane strain", "axisymmetric", "3D"])
@pytest.mark.parametrize("recipe", ["two_fields", "three_fields"])
def test_jacobian(recipe, kind):
    """Symmetric, and the derivative of the residuals, in plastic flow."""
    volume = ("DG", 0)
    forms, unknowns, law = stationary(
        getattr(locking, recipe), kind, degree=1, points=2, volume=volume
    )

    def residual():
        law.update()
        return np.concatenate([fem.petsc.assemble_vector(fem.form(f)).array for f in forms])

    def jacobian():
        law.update()
        rows = []
        for f, test in zip(forms, unknowns):
            row = []
            for v in unknowns:
                a = ufl.derivative(f, v)
                tangent = law.tangent(f, v)
                A = fem.petsc.assemble_matrix(fem.form(a if tangent is None else a + tangent))
                A.assemble()
                dense = A.convert("dense")  # the array lives as long as it
                row.append(dense.getDenseArray().copy())
            rows.append(row)
        return np.block(rows)

    J = jacobian()
    assert np.abs(J - J.T).max() < 1e-9 * np.abs(J).max()
    assert np.any(law.law.ep > 1e-4)
    rng, start, h = np.random.default_rng(5), [f.x.array.copy() for f in unknowns], 1e-6
    step = [rng.standard_normal(s.shape) for s in start]
    ends = []
    for sign in (1, -1):
        for f, s, d in zip(unknowns, start, step):
            f.x.array[:] = s + sign * h * d
        ends.append(residual())
    central = (ends[0] - ends[1]) / (2 * h)
    # the yield surface is not crossed; second differences of a function of size E: h² and 1e-16/h
    exact = J @ np.concatenate(step)
    assert np.linalg.norm(central - exact) < 1e-5 * np.linalg.norm(exact)


def test_page_has_the_recipes():
    """The code on the page is the code that runs."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "locking.md").read_text(), re.S)
    source = (ROOT / "benchmarks" / "locking.py").read_text()
    names = {}
    for block in blocks:
        exec(block, names)
        for function in re.split(r"\n\n\n(?=def )", block.strip()):
            if function.startswith("def "):
                assert function in source
    assert {"plain", "two_fields", "three_fields", "selective"} <= set(names)


@pytest.mark.skipif(COMM.size > 1, reason="its parts are tested above on several ranks")
def test_small_benchmark():
    locking.main(["--small"])
