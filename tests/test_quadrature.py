# SPDX-License-Identifier: MIT
"""Laws of the user at quadrature points."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as _mesh
from mpi4py import MPI
from specimen import COMM, Specimen, disturb, gathered, tangent_error

import dolfinx_contact as dc

MU, LAMBDA, G = 400.0, 600.0, 300.0


class Viscous:
    """Neo-Hookean, with a Maxwell element beside it: S = G (E − Γ), Γ' = (E − Γ)/time.

    P = μ (F − F⁻ᵀ) + λ log J F⁻ᵀ + F S; with backward Euler S = G (E − Γ_n)/(1 + dt/time).
    """

    def __init__(self, time=1.0, dt=0.0):
        self.time, self.dt, self.updates = time, dt, 0
        self.old = None  # Γ of the last accepted step

    def update(self, F):
        dim = F.shape[-1]
        I = np.eye(dim)
        if self.old is None:
            self.old = np.zeros_like(F)
        self.updates += 1
        ratio = self.dt / self.time
        J = np.linalg.det(F)
        with np.errstate(invalid="ignore"):
            log = np.log(J)
        H = np.swapaxes(np.linalg.inv(F), 1, 2)  # F⁻ᵀ
        strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - I)
        self.now = (self.old + ratio * strain) / (1 + ratio)
        g = G / (1 + ratio)
        S = g * (strain - self.old)
        P = MU * (F - H) + LAMBDA * log[:, None, None] * H + F @ S
        A = (
            MU * np.einsum("ik,jl->ijkl", I, I)
            + np.einsum("n,nil,nkj->nijkl", MU - LAMBDA * log, H, H)
            + LAMBDA * np.einsum("nij,nkl->nijkl", H, H)
            + np.einsum("ik,nlj->nijkl", I, S)
            + g / 2 * np.einsum("nil,nkj->nijkl", F, F)
            + g / 2 * np.einsum("nim,nkm,jl->nijkl", F, F, I)
        )
        return P, A

    def commit(self):
        self.old = self.now.copy()

    def restore(self):
        self.now = self.old.copy()


def stretched(dim=2, pressed=False, **options):
    """A clamped block with a viscous law, pulled at its top; or pressed there by a plane."""
    s = Specimen(dim, 3)
    s.law = Viscous(**options)
    s.material = dc.QuadratureLaw(ufl.Identity(dim) + ufl.grad(s.u), s.law)
    s.F = ufl.inner(s.material.P, ufl.grad(s.w)) * s.material.dx
    s.hold(2 * dim - 1, *range(dim))
    pairs = []
    if pressed:
        s.plane = dc.RigidPlane((0.0, 1.0), (0.1, -1.0))
        pairs = [dc.ContactPair(s.surface(2 * dim), s.plane, friction=0.2)]
    else:
        s.top = s.hold(2 * dim, *range(dim))
    s.made = s.problem([s.material], s.F, pairs)
    return s


@pytest.mark.parametrize("dim", (2, 3))
def test_equals_ufl(dim):
    """Without flow the law is an energy; Newton takes the same path as with UFL's derivatives."""
    s, t = stretched(dim), Specimen(dim, 3)
    t.hold(2 * dim - 1, *range(dim))
    t.top = t.hold(2 * dim, *range(dim))
    F = ufl.Identity(dim) + ufl.grad(t.u)
    J, E = ufl.det(F), (F.T * F - ufl.Identity(dim)) / 2
    psi = MU / 2 * (ufl.tr(F.T * F) - 2 * ufl.ln(J)) + LAMBDA / 2 * ufl.ln(J) ** 2
    psi += G / 2 * ufl.inner(E, E)
    dx = ufl.Measure("dx", metadata={"quadrature_degree": 2})
    energy = dc.ContactProblem(ufl.derivative(psi * dx, t.u, t.w), t.u, [], bcs=t.bcs)
    s.top.value = t.top.value = 0.3
    one, other = s.made.solve(), energy.solve()
    np.testing.assert_allclose(s.u.x.array, t.u.x.array, rtol=0, atol=1e-10)
    assert one.iterations == other.iterations
    np.testing.assert_allclose(one.norms[:-2], other.norms[:-2], rtol=1e-4)


@pytest.mark.parametrize("pressed", (False, True), ids=("pulled", "pressed"))
def test_tangent(pressed):
    s = stretched(pressed=pressed, dt=0.3)
    if pressed:
        s.plane.move((0.0, -0.1))
        s.made.solve()
    for _ in range(2):
        disturb(s.made, 0.02)
        assert tangent_error(s.made) < 1e-6
        s.made.system.accept()


def test_history():
    """Relaxation at a held strain: S falls by 1/(1 + dt/time) with each step. A time step that the
    user changes counts, although F does not change."""
    s = stretched(time=2.0)
    s.u.interpolate(lambda x: np.stack([0.1 * x[1], 0.2 * x[1]]))
    s.bcs.append(fem.dirichletbc(s.u.copy(), every(s.u)))
    made = s.problem([s.material], s.F)
    made.solve()
    first = viscous_stress(s)
    expected = first.copy()
    for dt in (0.5, 0.5, 1.0):
        s.law.dt = dt
        made.solve()
        expected /= 1 + dt / 2
        np.testing.assert_allclose(viscous_stress(s), expected, rtol=0, atol=1e-10 * G)
    assert np.abs(first).max(initial=G / 10) >= G / 10


def every(u):
    V = u.function_space
    return np.arange(V.dofmap.index_map.size_local + V.dofmap.index_map.num_ghosts, dtype=np.int32)


def viscous_stress(s):
    F = s.material.evaluate(s.material.F)
    strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(2))
    return G * (strain - s.law.old)


def test_a_failed_step_leaves_no_trace():
    s, t = stretched(pressed=True, dt=0.3), stretched(pressed=True, dt=0.3)
    for specimen in (s, t):
        specimen.plane.move((0.0, -0.05))
        specimen.made.solve()
    state, P = s.law.old.copy(), s.material._stress.x.array.copy()
    s.made.strategy.max_it = 1
    s.plane.move((0.0, -0.4))
    with pytest.raises(dc.ConvergenceError):
        s.made.solve()
    np.testing.assert_array_equal(s.law.old, state)
    np.testing.assert_array_equal(s.material._stress.x.array, P)
    s.made.strategy.max_it = 30
    for specimen in (s, t):
        specimen.plane.move((0.0, -0.1))
        specimen.made.solve()
    np.testing.assert_allclose(s.law.old, t.law.old, rtol=0, atol=1e-9)


def test_nothing_is_evaluated_twice():
    """One evaluation for each iterate, one as the step begins, none as it is accepted."""
    s = stretched()
    s.top.value = 0.1
    before = s.law.updates
    report = s.made.solve()
    assert s.law.updates - before <= report.iterations + 2


def test_materials_on_parts_of_a_mesh():
    """Two laws on two sets of cells and UFL on a third do what one law does on all of them."""
    s = Specimen(2, (6, 2))
    numbers = np.zeros(sum(local_sizes(s.mesh)), dtype=np.int32)
    for i in range(3):
        inside = lambda x: (x[0] > i / 3 - 1e-9) & (x[0] < (i + 1) / 3 + 1e-9)  # noqa: B023, E731
        numbers[_mesh.locate_entities(s.mesh, 2, inside)] = i
    mesh, owned = s.mesh, local_sizes(s.mesh)[0]
    tags = _mesh.meshtags(mesh, 2, np.arange(len(numbers), dtype=np.int32), numbers)
    dx = ufl.Measure("dx", domain=mesh, subdomain_data=tags)
    F = ufl.Identity(2) + ufl.grad(s.u)
    laws = [
        dc.QuadratureLaw(F, Viscous(), dx=dx(i), cells=np.flatnonzero(numbers[:owned] == i))
        for i in range(2)
    ]
    J, E = ufl.det(F), (F.T * F - ufl.Identity(2)) / 2
    psi = MU / 2 * (ufl.tr(F.T * F) - 2 * ufl.ln(J)) + LAMBDA / 2 * ufl.ln(J) ** 2
    psi += G / 2 * ufl.inner(E, E)
    rest = dx(2, metadata={"quadrature_degree": 2})
    form = sum(ufl.inner(m.P, ufl.grad(s.w)) * m.dx for m in laws)
    form += ufl.derivative(psi * rest, s.u, s.w)
    whole = dc.QuadratureLaw(F, Viscous())
    s.hold(3, 0, 1)
    top = s.hold(4, 0, 1)
    top.value = 0.2
    s.problem(laws, form).solve()
    u = s.u.x.array.copy()
    s.u.x.array[:] = 0
    s.problem([whole], ufl.inner(whole.P, ufl.grad(s.w)) * whole.dx).solve()
    np.testing.assert_allclose(s.u.x.array, u, rtol=0, atol=1e-10)


def local_sizes(mesh):
    cells = mesh.topology.index_map(mesh.topology.dim)
    return cells.size_local, cells.num_ghosts


@pytest.mark.parametrize("shape", ((), (2,), (2, 2)))
def test_any_shape(shape):
    """Laws of a scalar, a vector, a tensor: P = 3F."""

    class Linear:
        def update(self, F):
            size = int(np.prod(shape))
            return 3 * F, np.tile(3 * np.eye(size), (len(F), 1, 1)).reshape(len(F), *shape, *shape)

        def commit(self):
            pass

        restore = commit

    s = Specimen(2)
    F = {(): ufl.div(s.u), (2,): s.u, (2, 2): ufl.grad(s.u)}[shape]
    law = dc.QuadratureLaw(F, Linear())
    assert law.P.ufl_shape == shape
    form = ufl.inner(law.P, law.variation(s.u, s.w)) * law.dx
    other = 3 * ufl.inner(F, law.variation(s.u, s.w)) * law.dx
    s.u.interpolate(lambda x: np.stack([x[0] * x[1], x[1]]))
    law.update()
    one, two = (fem.petsc.assemble_vector(fem.form(f)) for f in (form, other))
    assert (one - two).norm() < 1e-13 * two.norm()
    one, two = (
        fem.petsc.assemble_matrix(fem.form(a))
        for a in (law.tangent(form, s.u), ufl.derivative(other, s.u))
    )
    one.assemble(), two.assemble()
    assert (one - two).norm() < 1e-13 * two.norm()


def test_parallel():
    """Fields are in the law's order on any number of ranks."""
    s = Specimen(2, 4)
    law = dc.QuadratureLaw(ufl.Identity(2) + ufl.grad(s.u), Viscous())
    f = law.field((2,))
    law.fill(f, law.positions())
    x = gathered(law, f)
    assert COMM.allreduce(law.size) == len(x) == 64
    np.testing.assert_array_equal(x, x[np.lexsort(np.round(x, 9).T)])
    integral = COMM.allreduce(fem.assemble_scalar(fem.form(f[0] * law.dx)), op=MPI.SUM)
    assert integral == pytest.approx(0.5, rel=1e-12)


# -- input -----------------------------------------------------------------------------------------


class Wrong(Viscous):
    def update(self, F):
        P, A = super().update(F)
        return P, A[0]


def test_input():
    s, t = Specimen(2), Specimen(2)
    F = ufl.Identity(2) + ufl.grad(s.u)
    with pytest.raises(dc.InputError, match="no commit"):
        dc.QuadratureLaw(F, type("Half", (), {"update": 0, "restore": 0})())
    with pytest.raises(dc.InputError, match="no dolfinx Function"):
        dc.QuadratureLaw(ufl.Identity(2), Viscous())
    with pytest.raises(dc.InputError, match="quadrature_degree"):
        dc.QuadratureLaw(F, Viscous(), -1)
    with pytest.raises(dc.InputError, match="owns the cells"):
        dc.QuadratureLaw(F, Viscous(), cells=[0, 10**6] if COMM.rank == 0 else None)
    with pytest.raises(dc.InputError, match="shape"):
        dc.QuadratureLaw(F, Wrong())
    law = dc.QuadratureLaw(F, Viscous())
    form = ufl.inner(law.P, ufl.grad(s.w)) * law.dx
    with pytest.raises(dc.InputError, match="not given"):
        s.problem([], form)
    with pytest.raises(dc.InputError, match="list of QuadratureLaw"):
        s.problem([Viscous()], form)
    with pytest.raises(dc.InputError, match="no residual"):
        s.problem([law], ufl.inner(F, ufl.grad(s.w)) * law.dx)
    with pytest.raises(dc.InputError, match="none of the unknowns"):
        t.problem([law], ufl.inner(law.P, ufl.grad(t.w)) * law.dx)
