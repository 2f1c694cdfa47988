# SPDX-License-Identifier: MIT
"""The iterative preset: the solution of the direct one, its preconditioner by dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from problems import (
    MASTER,
    PUNCH_MATERIAL,
    SLAVE,
    TOP,
    block_halves,
    distance,
    dome,
    one_mesh,
    punch,
    two_meshes,
)
from rigid import ball, block, columns, pair_and_problem
from test_errors import expect
from test_mixed import make

import dolfinx_contact as dc
from dolfinx_contact import solvers

COMM = MPI.COMM_WORLD
FRICTION = pytest.mark.parametrize("friction", (0.0, 0.3))
# Newton ends where the residual is 1e-10 of the forces: that leaves three digits to soft bodies
CLOSE = 1e-7


def assert_same(solve):
    """solve(petsc_options) gives a solved pair: iterative and direct ones agree. Collective."""
    direct, iterative = solve(solvers.direct()), solve(solvers.iterative())
    assert distance(iterative.pressure, direct.pressure) < CLOSE
    assert distance(iterative.slave.u, direct.slave.u) < CLOSE
    np.testing.assert_allclose(iterative.resultant(), direct.resultant(), rtol=CLOSE, atol=1e-6)
    iterative_status, status = (COMM.allgather(p.particles.status) for p in (iterative, direct))
    assert sorted(np.concatenate(iterative_status)) == sorted(np.concatenate(status))
    assert len(iterative.report.linear_iterations) == iterative.report.iterations
    assert max(iterative.report.linear_iterations) < 60
    assert max(direct.report.linear_iterations) == 1
    return iterative


def solved(model, options, **contact):
    pair = model.pair(**contact)
    pair.report = model.problem(pair, petsc_options=options).solve()
    return pair


@FRICTION
def test_a_curved_face_in_3d(friction):
    """Facets open and close, particles stick and slip on the way."""
    pair = assert_same(lambda o: solved(dome(COMM), o, friction=friction))
    assert sum(pair.report.status_changes) > 0


@FRICTION
def test_a_punch_in_2d(friction):
    assert_same(lambda o: solved(punch(COMM), o, friction=friction))


def test_degree_two():
    halves = block_halves((5, 4), 2, top=(0.01, -0.02))
    model = lambda: one_mesh(COMM, halves, PUNCH_MATERIAL, degree=2)  # noqa: E731
    assert_same(lambda o: solved(model(), o, friction=0.3))


def test_two_meshes():
    def solve(options):
        upper, lower = two_meshes(COMM, block_halves((9, 7), top=(0.01, -0.02)), PUNCH_MATERIAL)
        pair = dc.ContactPair(upper.surface(SLAVE), lower.surface(MASTER), friction=0.3)
        problem = dc.ContactProblem(
            [upper.F, lower.F],
            [upper.u, lower.u],
            [pair],
            bcs=upper.bcs + lower.bcs,
            petsc_options=options,
        )
        pair.report = problem.solve()
        return pair

    assert_same(solve)


@pytest.mark.parametrize("dim", (2, 3))
def test_a_driven_tool(dim):
    """Its travel is an unknown, too."""

    def solve(options):
        model, tool = block(COMM, dim, columns), ball(dim, 0.0)
        tool.push(np.array([0.0] * (dim - 1) + [-15.0]))
        pair, problem = pair_and_problem(model, tool, friction=0.3)
        problem.petsc_options = options
        pair.report = problem.solve()
        return pair

    assert_same(solve)


def test_one_level():
    """As GAMG makes of few unknowns; here it sees no strong connections."""
    options = solvers.iterative(contact_pc_gamg_threshold=10)
    pair = solved(punch(COMM), options, friction=0.3)
    assert max(pair.report.linear_iterations) == 1


def dense(A):
    """A copy of a matrix's entries: PETSc's own go with the matrix."""
    converted = A.convert("dense")
    return converted.getDenseArray().copy()


@FRICTION
def test_a_body_on_contact_alone(friction):
    """A load presses it down: the bulk's matrix, of which prolongations are made, is singular."""

    def solve(options):
        model = one_mesh(COMM, block_halves((9, 7), top=(0.0, None)), PUNCH_MATERIAL)
        down = ufl.TestFunction(model.u.function_space)[1]
        model.F += 5.0 * down * ufl.Measure("ds", model.mesh, subdomain_data=model.tags)(TOP)
        return solved(model, options, friction=friction)

    pair = assert_same(solve)
    np.testing.assert_allclose(pair.resultant()[1], 10.0, rtol=1e-8)


def test_without_contact():
    model = punch(COMM)
    pair = model.pair()
    model.problem(pair, petsc_options=solvers.iterative()).solve()
    model.move(TOP, (0.0, 0.0))
    report = model.problem(pair, petsc_options=solvers.iterative()).solve()
    assert report.converged
    assert np.linalg.norm(pair.resultant()) < 1e-6


def test_load_steps():
    """Each solve makes its prolongations anew, and none loses the statuses."""

    def solve(options):
        model = punch(COMM)
        pair = model.pair(friction=0.3)
        problem = model.problem(pair, petsc_options=options)
        for part in (0.25, 0.5, 1.0):
            model.move(TOP, (0.02 * part, -0.08 * part))
            pair.report = problem.solve()
        return pair

    assert_same(solve)


def test_prolongations_are_kept():
    """From step to step, until linear solves take twice their first iterations."""
    model = punch(COMM)
    problem = model.problem(model.pair(friction=0.3), petsc_options=solvers.iterative())
    kept = []
    for part in (0.5, 0.75, 1.0):
        model.move(TOP, (0.0, -0.08 * part))
        first = problem.solve().linear_iterations
        kept.append(problem.system.hierarchy)
        if len(kept) == 2:
            kept[0].count(2 * kept[0].iterations[0] + 1)
    assert kept[0] is kept[1]
    assert kept[2] is not kept[1]
    assert kept[1].P == []  # freed
    assert kept[2].iterations == [first[0], first[-1]]


# -- the preconditioner ---------------------------------------------------------------------------


class Dense:
    """Solves with a dense matrix, in place of a multigrid cycle."""

    def __init__(self, K):
        self.K = K

    def apply(self, b, y):
        y.array[:] = np.linalg.solve(self.K, b.array_r)


@FRICTION
def test_augmented_matrix(friction):
    """K, its coarse matrix and R⁻¹ against dense constructions, on each rank alone."""
    model = punch(MPI.COMM_SELF, counts=(12, 9))
    pair = model.pair(friction=friction)
    problem = model.problem(pair)
    problem.solve()
    system = problem.system
    system.residual(system.x, system.b)
    system.jacobian(system.x, system.A)
    n = int(system.layout.offsets[1])
    gamma = 1.7
    augmented = solvers._Augmented(system.A, system.layout, n, gamma, exactly=True)
    A = dense(system.A)
    D = A[n:, n:] - A[n:, :n] @ np.diag(1 / abs(np.diag(A)[:n])) @ A[:n, n:] / gamma
    K = np.eye(len(A))
    K[:n, :n] = A[:n, :n] - A[:n, n:] @ np.linalg.solve(D, A[n:, :n])
    R = A.copy()
    R[n:, n:] = D

    random = np.random.default_rng(1)
    r, y = system.A.createVecs()
    r.array[:] = random.standard_normal(len(A))
    augmented.mult(None, r, y)
    np.testing.assert_allclose(y.array, K @ r.array, atol=1e-9 * abs(K).max())
    augmented.eliminate(Dense(K), r, y)
    np.testing.assert_allclose(R @ y.array, r.array, atol=1e-7)

    P = np.zeros((len(A), 7))
    P[:n] = random.standard_normal((n, 7)) * (random.random((n, 7)) < 0.3)
    lumped = np.diag(1 / (np.sign(np.diag(D)) * abs(D).sum(axis=1)))
    expected = P.T @ A @ P - (P.T @ A)[:, n:] @ lumped @ (A @ P)[n:]
    columns = np.tile(np.arange(7, dtype=PETSc.IntType), len(A))
    starts = np.arange(0, 7 * len(A) + 1, 7, dtype=PETSc.IntType)
    sparse = PETSc.Mat().createAIJ(P.shape, csr=(starts, columns, P.ravel()), comm=MPI.COMM_SELF)
    coarse = dense(augmented.coarse(sparse))
    np.testing.assert_allclose(coarse, expected, atol=1e-12 * abs(expected).max())
    augmented.free()


@FRICTION
def test_iterations_do_not_grow(friction):
    """Of linear solves, when facets are halved twice."""
    means = []
    for n in (3, 12):
        halves = block_halves((5 * n, 4 * n), 2 * n, top=(0.02, -0.02))
        model = one_mesh(COMM, halves, PUNCH_MATERIAL)
        pair = solved(model, solvers.iterative(), friction=friction)
        means.append(np.mean(pair.report.linear_iterations))
    assert means[1] < 1.6 * means[0], means


def test_options_overrule():
    options = solvers.iterative(ksp_rtol=1e-3, contact_mg_levels_ksp_max_it=4)
    loose = solved(punch(COMM), options)
    plain = solved(punch(COMM), solvers.iterative())
    assert np.mean(loose.report.linear_iterations) < 0.6 * np.mean(plain.report.linear_iterations)
    assert solvers.direct(pc_type="cholesky")["pc_type"] == "cholesky"


def test_too_few_iterations():
    """A linear solve that fails ends the solve, names itself, and leaves u."""
    model = punch(COMM)
    problem = model.problem(model.pair(), petsc_options=solvers.iterative(ksp_max_it=1))
    with pytest.raises(dc.ConvergenceError, match="DIVERGED_LINEAR_SOLVE / DIVERGED_MAX_IT"):
        problem.solve()
    assert not np.any(model.u.x.array)


def test_only_displacements():
    mixed = make("plane", "taylor-hood", petsc_options=solvers.iterative())
    before = PETSc.Options().getAll()
    expect(dc.InputError, mixed.problem.solve, "not a displacement", "solvers.direct")
    assert PETSc.Options().getAll() == before


def test_only_contact_problems():
    A = PETSc.Mat().createAIJ((3, 3), nnz=1, comm=MPI.COMM_SELF)
    A.setUp()
    A.assemble()
    pc = PETSc.PC().create(MPI.COMM_SELF)
    pc.setOperators(A, A)
    with pytest.raises(dc.InputError, match="within a ContactProblem"):
        solvers.SaddlePoint().setUp(pc)
