# SPDX-License-Identifier: MIT
"""Finite-strain J2 plasticity: against analytic and integrated curves, and within problems."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import distance
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from specimen import COMM, NU, VOCE, E, Specimen, disturb, gathered, tangent_error

import dolfinx_contact as dc
from dolfinx_contact import _cpp, compat, plasticity
from dolfinx_contact.plasticity import J2, Linear, Swift, Tabulated, Voce

SWIFT = Swift(K=589, eps0=1e-4, n=0.216)
MU, LAMBDA = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
SYMMETRIC = [0, 3, 5, 3, 1, 4, 5, 4, 2]


def points(hardening=SWIFT):
    """The law of J2 by itself."""
    return plasticity._Points(LAMBDA, MU, hardening)


def uniaxial(stretch, hardening):
    """Axial Kirchhoff stress and ε_p: log stretch = τ/E + ε_p, τ = σ_y(ε_p), whatever the steps."""
    total = abs(np.log(stretch))
    ep = brentq(lambda e: hardening(e)[0] / E + e - total, 0, total, xtol=1e-15)
    return float(np.sign(stretch - 1) * hardening(ep)[0]), ep


# -- curves ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardening", (SWIFT, VOCE, Linear(80.0, 500.0), Linear(80.0)))
@pytest.mark.parametrize("kind", ("axisymmetric", "3D"))
def test_uniaxial(kind, hardening):
    """Tension to 1.3 and compression to 0.8, in steps of any size."""
    for stretches in ((1.1, 1.3), (0.8,)):
        s = Specimen(3 if kind == "3D" else 2)
        s.rollers(*range(s.dim))
        top = s.hold(2 * s.dim, s.dim - 1)
        sheet = J2(s.u, E, NU, hardening, kind=kind)
        problem = s.problem(sheet)
        for stretch in stretches:
            top.value = stretch - 1
            problem.solve()
        tau, ep = uniaxial(stretches[-1], hardening)
        expected = np.zeros((3, 3))
        axial = s.dim - 1
        expected[axial, axial] = tau
        kirchhoff = sheet.values(sheet.kirchhoff).reshape(-1, 3, 3)
        np.testing.assert_allclose(
            kirchhoff, np.broadcast_to(expected, kirchhoff.shape), atol=1e-6
        )
        np.testing.assert_allclose(sheet.values(sheet.plastic_strain), ep, atol=1e-10)
        volume = sheet.values(sheet.elastic_volume)
        np.testing.assert_allclose(volume, tau * (1 - 2 * NU) / E, atol=1e-10)


def test_simple_shear():
    """F = I + γ e_1 ⊗ e_2 to γ = 1, where the principal axes turn: the rate equations, integrated by
    SciPy, against the algorithm, extrapolated to small steps (its error is of first order)."""
    b_of = lambda F, cp: F @ cp @ F.T  # noqa: E731

    def stress(b):
        values, axes = np.linalg.eigh(b)
        e = 0.5 * np.log(values)
        return axes @ np.diag(LAMBDA * e.sum() + 2 * MU * e) @ axes.T

    def mises(tau):
        s = tau - np.trace(tau) / 3 * np.eye(3)
        q = np.sqrt(1.5) * np.linalg.norm(s)
        return q, 1.5 * s / q

    def shear(gamma):
        F = np.eye(3)
        F[0, 1] = gamma
        return F

    def rate(gamma, state):
        """dC_p⁻¹/dγ = −2 ε_p' F⁻¹ N b F⁻ᵀ, and 3μ + H times ε_p' = 2μ N:l"""
        cp, ep = state[:9].reshape(3, 3), state[9]
        F, l = shear(gamma), np.zeros((3, 3))
        l[0, 1] = 1
        b = b_of(F, cp)
        q, N = mises(stress(b))
        flow = 2 * MU * np.sum(N * l) / (3 * MU + VOCE(ep)[1])
        back = np.linalg.inv(F)
        return np.append((-2 * flow * back @ N @ b @ back.T).ravel(), flow)

    yields = brentq(
        lambda g: mises(stress(b_of(shear(g), np.eye(3))))[0] - 80, 1e-6, 0.1, xtol=1e-15
    )
    start = np.append(np.eye(3).ravel(), 0.0)
    path = solve_ivp(rate, (yields, 1), start, method="DOP853", rtol=1e-11, atol=1e-13)
    exact = np.append(stress(b_of(shear(1), path.y[:9, -1].reshape(3, 3))), path.y[9, -1])

    def integrated(steps):
        law = points(VOCE)
        for gamma in np.linspace(yields, 1, steps + 1):
            law.update(shear(gamma)[None])
            law.commit()
        return np.append(law.tau[0, SYMMETRIC], law.ep[0])

    found = [integrated(n) for n in (1000, 2000, 4000)]
    errors = [np.abs(f - exact).max() / np.abs(exact).max() for f in found]
    assert errors[2] < 1e-3 and errors[1] / errors[2] == pytest.approx(2, rel=0.05)
    once = [2 * b - a for a, b in zip(found, found[1:])]
    np.testing.assert_allclose((4 * once[1] - once[0]) / 3, exact, atol=1e-6 * exact[:9].max())
    assert (4 * once[1] - once[0])[9] / 3 == pytest.approx(exact[9], rel=1e-6)


@pytest.mark.parametrize("hardening", (SWIFT, VOCE, Tabulated([0, 0.01, 0.3], [80, 120, 200])))
def test_a_function_of_the_user_does_the_same_as_the_kernel(hardening):
    """Also flow keeps the volume, det C_p = 1, over large increments."""

    def swift(ep):
        stress = 589 * (1e-4 + ep) ** 0.216
        return stress, 0.216 * stress / (1e-4 + ep)

    def voce(ep):
        rest = np.exp(-15 * ep)
        return 80 + 200 * (1 - rest) + 30 * ep, 200 * 15 * rest + 30

    def table(ep):
        return np.interp(ep, [0, 0.01, 0.3], [80, 120, 200]), np.where(
            ep < 0.01, 4000.0, np.where(ep < 0.3, 80 / 0.29, 0.0)
        )

    own = {Swift: swift, Voce: voce, Tabulated: table}[type(hardening)]
    rng, n = np.random.default_rng(1), 200
    one, other, F = points(hardening), points(own), np.tile(np.eye(3), (n, 1, 1))
    for step in range(20):
        F = F + rng.uniform(-1, 1, F.shape) * 10.0 ** rng.uniform(-5, -1, (n, 1, 1))
        (P, A), (Q, B) = one.update(F), other.update(F)
        np.testing.assert_allclose(Q, P, rtol=0, atol=1e-10 * np.abs(P).max())
        np.testing.assert_allclose(B, A, rtol=0, atol=1e-10 * np.abs(A).max())
        np.testing.assert_allclose(other.ep, one.ep, rtol=0, atol=1e-12)
        one.commit(), other.commit()
    assert one.ep.min() > 0.01 and one.ep.max() > 0.3
    det = np.linalg.det(one.cp[:, SYMMETRIC].reshape(-1, 3, 3))
    np.testing.assert_allclose(det, 1, rtol=0, atol=1e-10)


# -- problems --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ("plane strain", "axisymmetric", "3D"))
def test_tangent(kind):
    """Elastic, and with flow from a state with history; J of J2 is what the problem makes."""
    s = Specimen(3 if kind == "3D" else 2, 3)
    sheet = J2(s.u, E, NU, kind=kind)
    problem = s.problem(sheet)
    form = ufl.inner(sheet.P, ufl.grad(s.w)) * sheet.dx if kind != "axisymmetric" else None
    own = s.problem(sheet, form, J=sheet.J)
    for size in (1e-7, 0.05, 0.05):
        disturb(problem, size)
        assert tangent_error(problem) < 1e-6
        assert tangent_error(own) < 1e-6
        assert (problem.system.b - own.system.b).norm() < 1e-12 * own.system.b.norm()
        problem.system.accept()
    assert COMM.allreduce(sheet.values(sheet.plastic_strain).max(initial=0), op=MPI.MAX) > 0.01


def test_tangent_of_a_mixed_model():
    """F̄ = (θ/det F)^(1/3) F with the volume ratio θ as an unknown of its own, one a cell."""
    s = Specimen(3)
    theta = fem.Function(compat.function_space(s.mesh, ("DG", 0)))
    theta.x.array[:] = 1.02
    F = ufl.Identity(3) + ufl.grad(s.u)
    F = (theta / ufl.det(F)) ** (1 / 3) * F
    sheet = J2(s.u, E, NU, F=F)
    q = ufl.TestFunction(theta.function_space)
    volume = ufl.det(ufl.Identity(3) + ufl.grad(s.u))
    forms = [
        sheet.work(s.w),
        ufl.inner(sheet.P, sheet.variation(theta, q)) * sheet.dx
        + E * (theta - volume) * q * sheet.dx,
    ]
    problem = dc.ContactProblem(forms, [s.u, theta], [], materials=[sheet])
    for _ in range(2):
        disturb(problem, 0.05)
        assert tangent_error(problem) < 1e-6
        problem.system.accept()


def test_plane_strain_is_a_slab_of_held_thickness():
    results = []
    for dim in (2, 3):
        s = Specimen(dim, (3, 3, 1)[:dim], (1, 1, 0.3)[:dim])
        s.hold(3, *range(dim))  # below
        across, up = s.hold(4, 0), s.hold(4, 1)
        if dim == 3:
            s.hold(5, 2), s.hold(6, 2)
        sheet = J2(s.u, E, NU)
        problem = s.problem(sheet)
        for t in (0.5, 1.0):
            across.value, up.value = 0.1 * t, 0.04 * t
            problem.solve()
        x = np.concatenate(COMM.allgather(sheet.positions()))[:, :2]
        values = [
            np.concatenate(COMM.allgather(sheet.values(f)))
            for f in (sheet.plastic_strain, sheet.kirchhoff)
        ]
        order = np.lexsort(np.round(x, 9).T)
        if dim == 3:  # two points across the thickness
            order = order[::2]
        results.append([v[order] for v in values])
    for flat, thick in zip(*results):
        np.testing.assert_allclose(thick, flat, rtol=0, atol=1e-8 * np.abs(flat).max())
    assert results[0][0].max() > 0.05


def test_upsetting():
    """A cylinder between a plane and its mirror image, without friction: homogeneous compression.
    The force is π R² τ/stretch."""
    s = Specimen(2, 3)
    s.rollers(0, 1)
    plane = dc.RigidPlane((0.0, 1.0), (0.0, -1.0))
    pair = dc.ContactPair(s.surface(4), plane, axisymmetric=True)
    sheet = J2(s.u, E, NU, kind="axisymmetric")
    problem = s.problem(sheet, pairs=[pair])
    for stretch in (0.97, 0.9, 0.8):
        plane.move((0.0, stretch - 1))
        problem.solve()
        tau, ep = uniaxial(stretch, SWIFT)
        force = np.pi * tau / stretch
        np.testing.assert_allclose(pair.resultant(), (0, force), atol=1e-6 * abs(force))
        np.testing.assert_allclose(sheet.values(sheet.plastic_strain), ep, atol=1e-6)


class Press:
    """A block on a clamped base, pressed by an oblique rigid plane, with friction."""

    def __init__(self, comm=COMM, partition=None, friction=0.2, **options):
        self.s = s = Specimen(2, 4, comm=comm, partition=partition)
        s.hold(3, 0, 1)
        self.plane = dc.RigidPlane((0.5, 1.0), (0.05, -1.0))
        self.pair = dc.ContactPair(s.surface(4), self.plane, friction=friction)
        self.sheet = J2(s.u, E, NU, **options)
        self.problem = s.problem(
            self.sheet, pairs=[self.pair], strategy=dc.Newton(rtol=1e-12, max_it=40)
        )

    def go(self, depth):
        self.plane.move((0.0, -depth))
        return self.problem.solve()

    def state(self):
        """Everything that a failed step must put back."""
        law = self.sheet.law
        arrays = [self.s.u.x.array, law.cp, law.ep, *law._old]
        fields = [self.sheet.plastic_strain, self.sheet.kirchhoff, self.sheet._stress]
        return [np.array(a) for a in arrays + [f.x.array for f in fields]]


def test_newton_is_quadratic_with_contact():
    """In a step where all of the face is pressed and no status changes: each residual is at most ten
    times the square of the one before (relative to the forces). The factor is the ratio of elastic
    and plastic stiffness: directions with little of either count alike in the norm."""
    press = Press(friction=0.0)
    for depth in (0.03, 0.06, 0.08, 0.1, 0.12, 0.14):
        press.go(depth)
    report = press.go(0.144)
    assert sum(report.status_changes) == 0
    norms = np.array(report.norms) / report.reference
    assert norms[0] > 0.1 and norms[-1] < 1e-12 and report.iterations <= 4
    assert np.all(norms[1:] <= 10 * norms[:-1] ** 2 + 1e-13)
    assert COMM.allreduce(press.sheet.law.ep.min(initial=1), op=MPI.MIN) > 0.01


def test_tangent_with_contact_and_friction():
    press = Press()
    for depth in (0.03, 0.06, 0.08, 0.1):
        press.go(depth)
    disturb(press.problem, 0.01)
    assert tangent_error(press.problem) < 1e-6


def test_volume_changes_elastically():
    """log det F = tr ε, which is computed from the stress."""
    press = Press()
    for depth in (0.05, 0.1):
        press.go(depth)
    det = press.sheet.evaluate(ufl.det(press.sheet.F))
    volume = press.sheet.values(press.sheet.elastic_volume)[:, 0]
    np.testing.assert_allclose(np.log(det), volume, rtol=0, atol=1e-9)


def test_a_failed_step_leaves_no_trace():
    press, other = Press(), Press()
    press.go(0.05), other.go(0.05)
    before = press.state()
    press.problem.strategy.max_it = 2
    with pytest.raises(dc.ConvergenceError):
        press.go(0.1)
    for now, then in zip(press.state(), before):
        np.testing.assert_array_equal(now, then)
    press.problem.strategy.max_it = 40
    press.go(0.07), other.go(0.07)
    for now, then in zip(press.state(), other.state()):
        np.testing.assert_allclose(now, then, rtol=0, atol=1e-10 * np.abs(then).max(initial=1))


def test_cells_turned_inside_out_shorten_newtons_step():
    """Stress is nan then, and nothing is raised; a step out of reach ends as one that failed."""
    s = Specimen(2)
    s.hold(3, 0, 1)
    top = s.hold(4, 1)
    sheet = J2(s.u, E, NU)
    problem = s.problem(sheet)
    s.u.interpolate(lambda x: np.stack([0 * x[0], -1.5 * x[1]]))
    sheet.update()
    assert np.all(np.isnan(sheet.values(sheet._stress)))
    s.u.x.array[:] = 0
    top.value = -1.5
    with pytest.raises(dc.ConvergenceError):
        problem.solve()
    assert np.all(s.u.x.array == 0) and not np.any(np.isnan(sheet._stress.x.array))
    top.value = -0.1
    problem.solve()


@functools.lru_cache(maxsize=None)
def pressed_alone():
    return pressed(MPI.COMM_SELF)


def pressed(comm, partition=None):
    press = Press(comm, partition)
    for depth in (0.05, 0.1):
        press.go(depth)
    return press


@pytest.mark.parametrize("partition", (None, lambda x, ranks: np.floor(7 * x[:, 0]) % ranks))
def test_parallel(partition):
    """Displacements and states are those of one rank."""
    press, alone = pressed(COMM, partition), pressed_alone()
    assert distance(press.s.u, alone.s.u) < 1e-9
    for name in ("plastic_strain", "kirchhoff"):
        now, then = (gathered(p.sheet, getattr(p.sheet, name)) for p in (press, alone))
        np.testing.assert_allclose(now, then, rtol=0, atol=1e-8 * np.abs(then).max())


# -- input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, words",
    (
        ({"E": -1.0}, "E > 0"),
        ({"nu": 0.5}, "nu < 1/2"),
        ({"kind": "3D"}, "plane strain"),
        ({"kind": "plane stress"}, "plane strain"),
        ({"F": ufl.Identity(4)}, "shape"),
        ({"hardening": lambda ep: ep}, "yield stresses and slopes"),
        ({"hardening": lambda ep: (ep, ep)}, "positive at 0"),
        ({"hardening": 80.0}, "Swift"),
        ({"quadrature_degree": 1.5}, "quadrature_degree"),
    ),
)
def test_input(options, words):
    s = Specimen(2)
    with pytest.raises(dc.InputError, match=words):
        J2(s.u, **{"E": E, "nu": NU, **options})


@pytest.mark.parametrize(
    "make",
    (
        lambda: Swift(589, 0.0, 0.2),
        lambda: Swift(float("nan"), 1e-4, 0.2),
        lambda: Linear(0.0),
        lambda: Linear(80.0, -1.0),
        lambda: Voce(80.0, 10.0, 0.0),
        lambda: Tabulated([0.1, 0.2], [1.0, 2.0]),
        lambda: Tabulated([0.0, 0.2], [2.0, 1.0]),
        lambda: Tabulated([0.0], [2.0]),
    ),
)
def test_hardening_input(make):
    with pytest.raises(dc.InputError, match="give"):
        make()


def test_kernel_refuses_arrays_that_do_not_fit():
    with pytest.raises(ValueError, match="number of points"):
        _cpp.j2_trial_stress(LAMBDA, MU, 9, np.zeros((2, 9)), np.zeros((3, 6)))
