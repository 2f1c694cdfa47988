# SPDX-License-Identifier: MIT
"""The numerical inf-sup constant of a pair: do displacements, pressures and particles fit together?

    β = inf_μ sup_v b(μ, v)/(‖v‖_H1 ‖μ‖_h),   b(μ, v) = ∫_Γ μ ⟦v⟧_n dΓ,   ‖μ‖_h² = h ∫_Γ μ² dΓ

The contact pressures converge if β does not fall when the meshes are refined (F. Brezzi, RAIRO 8-R2,
1974); the test is that of D. Chapelle and K.-J. Bathe, The inf-sup test, Computers & Structures 47
(1993), for contact N. El-Abbasi and K.-J. Bathe, Stability and patch test performance of contact
discretizations, Computers & Structures 79 (2001). √h ‖μ‖_L2 stands for the norm of H^{−1/2}(Γ).
"""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from . import _cpp, compat
from .contact import PairAssembly, _cpp_surface
from .errors import ContactError, InputError, together
from .held import agreed, local_dofs
from .layout import Layout
from .pair import ContactPair
from .rules import Nodes, basis_values
from .surface import _CONTINUOUS

# Shift of the eigenvalues −β², which are pure numbers: far below the β² of a sound choice and of the
# bad ones (1e-8 already, on fine meshes), so that these are told apart, and far above round-off.
_SHIFT = 1e-8
_PREFIX = "dolfinx_contact_infsup_"  # of PETSc's options


def constant(pair: ContactPair, h: float | None = None) -> float:
    """The inf-sup constant β of a pair on its present meshes, at the present u. Collective.

    It is a pure number, and the same in all units of length. One number says little: compare those
    of a few refinements. All particles that have a target are closed; friction does not count.
    Displacements have the norm ‖v‖² = ∫ |∇v|² + |v|²/L² over the meshes of both bodies, without
    Dirichlet conditions, L the extent of Γ (its measure, in 3D the root of it). With a rigid tool
    only the slave moves. Pressures that the pair excludes are left out, and those of facets on which
    a particle has no target.

    Args:
        pair: a contact pair; it need not be solved, and is not changed
        h: mesh size [length]; None: the mean diameter of the slave's facets

    Returns:
        β ≥ 0; below about 1e-6 it is zero

    Raises:
        InputError: on all ranks, if pair is no ContactPair, h is not positive and finite, or no
            pressure is left whose particles all have targets
        ContactError: on all ranks, if SLEPc finds no eigenvalue
    """
    if not isinstance(pair, ContactPair):
        raise InputError(f"infsup.constant: pair is a {type(pair).__name__}; give a ContactPair.")
    with together(pair.comm, "infsup.constant"):
        if h is not None and not (isinstance(h, numbers.Real) and 0 < h < np.inf):
            raise InputError(
                f"infsup.constant: h is {h!r}; give a positive, finite length, or None for the"
                " mean diameter of the slave's facets."
            )
    beta, size = _constant(pair)
    # since 3.18 PETSc keeps what Python drops until all ranks come here together
    PETSc.garbage_cleanup(pair.comm)
    return beta * float(np.sqrt(size / (size if h is None else h)))


def _constant(pair: ContactPair) -> tuple[float, float]:
    """β with the mean diameter of the slave's facets, and this diameter. Collective."""
    u, rigid = [pair.slave.u], bool(pair.tools)
    if not rigid and pair.master.u is not pair.slave.u:
        u.append(pair.master.u)
    layout = Layout(pair.comm, [*u, pair._multiplier], [])
    # a pair assembled without friction: λ is its only multiplier
    contact = PairAssembly(pair, layout, 0, None if rigid else len(u) - 1, len(u), None)
    size = contact.facet_size()
    # unknowns are v and q × size: all blocks are then of one size, whatever the unit of length
    contact.assembler.set_parameters(1.0, 1 / size)
    contact.update(close=1e300)  # open particles with d_n > −1e300 × a diameter close: all do
    kept = _kept(pair, contact, layout, len(u))

    M, extent = _mass(pair, layout, len(u))
    A = [petsc.assemble_matrix(compat.form(_h1(v, extent, pair.axisymmetric))) for v in u]
    for matrix in A:
        matrix.assemble()
    tangent = _tangent(contact, layout)
    columns = PETSc.IS().createGeneral(kept, comm=pair.comm)
    # B from the rows of (F1), where δλ stands beside ⟦w⟧_n alone: those of (F2) have all of δd_n (F12)
    B = []
    for block in range(len(u)):
        dofs = layout.start + np.arange(*layout.offsets[block : block + 2])
        rows = PETSc.IS().createGeneral(dofs.astype(PETSc.IntType), comm=pair.comm)
        B.append(tangent.createSubMatrix(rows, columns).transpose())
    M = M.createSubMatrix(columns, columns)
    M.scale(1 / size)
    return _smallest(A, B, M), size


def doubt(
    displacement_degree: int, pressure_space: tuple[str, int], shape: str, integration: Any
) -> str | None:
    """What is known against a choice, measured in docs/infsup.md; None if nothing is.

    Bad pressures are those that the slave's displacements do not see. What the master sees of them
    depends on both meshes: it is nothing where they match, and for a rigid tool.

    Args:
        displacement_degree: of the slave
        pressure_space: family and degree
        shape: of the slave's facets: "interval", "triangle" or "quadrilateral"
        integration: the pair's rule

    Returns:
        a sentence for the user, without a full stop
    """
    family, degree = pressure_space
    discontinuous = family not in _CONTINUOUS
    # DG of degree k has as many pressures a facet as the trace has functions for k one below its own
    # degree; on triangles it has more
    most = displacement_degree - (2 + (shape == "triangle") if discontinuous else 0)
    shared = discontinuous and degree > 0 and isinstance(integration, Nodes)
    if degree <= most and not shared:
        return None
    why = "some pressures that alternate along the surface have little effect or none"
    if shared:
        why = "particles of neighbouring facets coincide, and only the sum of their pressures acts"
    stable = '("Lagrange", 1)' + (' or ("Lagrange", 2)' if displacement_degree == 2 else "")
    return (
        f'pressure_space ("{family}", {degree}) with displacements of degree {displacement_degree}'
        f" and {integration!r} is not stable: {why}, and they may oscillate; take {stable}"
    )


def _kept(pair: Any, contact: Any, layout: Layout, block: int) -> npt.NDArray[Any]:
    """System dofs of the multipliers of the test that this rank owns. Collective."""
    table = contact.assembler.particles()
    away = np.isin(pair.slave.id, table["facet"][~table["closed"]])
    nodes = contact._multiplier_nodes
    away = np.repeat(away[:, None], nodes.shape[1], axis=1)
    out = contact._excluded | agreed(pair._multiplier, nodes, away, any_facet=True)
    part = layout.slice(block)
    kept = layout.start + part.start + np.flatnonzero(~out[: part.stop - part.start])
    if pair.comm.allreduce(len(kept)) == 0:
        raise InputError(
            "infsup.constant: there is no pressure whose particles all have targets; move the"
            " surfaces closer together, or give the target a larger radius."
        )
    return kept.astype(PETSc.IntType)


def _h1(u: Any, extent: float, axisymmetric: bool) -> Any:
    """∫ ∇v·∇w + v·w/L², with the axisymmetric measure and the hoop's share where it applies."""
    V = u.function_space
    v, w, x = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.SpatialCoordinate(V.mesh)
    scale = fem.Constant(V.mesh, PETSc.ScalarType(1 / extent**2))
    # exact on affine cells; without it DOLFINx takes many more points on quadrilaterals
    degree = 2 * compat.lagrange_degree(V) + axisymmetric
    dx = ufl.Measure("dx", V.mesh, metadata={"quadrature_degree": degree})
    product = ufl.inner(ufl.grad(v), ufl.grad(w)) + scale * ufl.inner(v, w)
    if axisymmetric:
        product = 2 * ufl.pi * (x[0] * product + v[0] * w[0] / x[0])
    return product * dx


def _mass(pair: Any, layout: Layout, block: int) -> tuple[Any, float]:
    """∫ ψ_a ψ_b dΓ over the whole surface, exact whatever the particles, in the rows and columns of
    the system; and the extent of Γ. Collective."""
    points, weights = compat.quadrature(pair.slave.shape, 8)
    rule, own = _cpp.ParticleRule(points, weights), _cpp_surface(pair.slave)
    weight = np.asarray(_cpp.particle_weights(own, rule, pair.axisymmetric))
    psi = basis_values(pair._psi, points)
    masses = np.einsum("fp,pa,pb->fab", weight.reshape(-1, len(points)), psi, psi)
    nodes = local_dofs(pair, pair._multiplier, psi.shape[1])
    M = _matrix(pair.comm, layout.owned)
    M.setUp()
    M.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    for dofs, mass in zip(layout.local_dofs(block)[nodes], masses):
        M.setValues(dofs, dofs, mass, addv=PETSc.InsertMode.ADD_VALUES)
    M.assemble()
    area = pair.comm.allreduce(float(weight.sum()))
    return M, area if pair.slave.dim == 2 and not pair.axisymmetric else area**0.5


def _tangent(contact: PairAssembly, layout: Layout) -> Any:
    """The contact tangent (F9), (F13), all particles with a target closed. Collective."""
    comm, n = layout.comm, layout.owned
    pattern, T = _cpp.Pattern(comm.py2f(), n), _matrix(comm, n)
    with together(comm, "infsup.constant"):
        contact.assembler.add_pattern(pattern)
    pattern.finish()
    pattern.allocate(T.handle)
    # said to all ranks: PETSc waits for ever where a rank without rows has another setting
    T.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
    with together(comm, "infsup.constant"):
        contact.assembler.tangent(T.handle)
    T.assemble()
    return T


def _matrix(comm: Any, n: int) -> Any:
    """A square matrix with n rows on this rank."""
    matrix = PETSc.Mat().create(comm)
    matrix.setSizes(((n, None), (n, None)))
    matrix.setType("aij")
    return matrix


def _smallest(A: list[Any], B: list[Any], M: Any) -> float:
    """β from the largest eigenvalue −β² of

        [[A, Bᵀ], [B, 0]] (v, q) = −β² [[0, 0], [0, M]] (v, q),  thus  B A⁻¹ Bᵀ q = β² M q.

    All eigenvalues are ≤ 0. With a shift σ > 0 the matrix that is factorised, [[A, Bᵀ], [B, −σM]],
    is quasi-definite and never singular, even where β = 0. Collective.

    Args:
        A: H1 products of the displacements
        B: b of the multipliers (rows) and each displacement
        M: products of the multipliers
    """
    from slepc4py import SLEPc  # Debian's DOLFINx brings it, others may not

    n, comm = len(A), M.comm
    left, right = ([[None] * (n + 1) for _ in range(n + 1)] for _ in range(2))
    for i, (a, b) in enumerate(zip(A, B)):
        left[i][i], left[n][i], left[i][n] = a, b, b.transpose(PETSc.Mat())
        right[i][i] = a.duplicate()
    left[n][n], right[n][n] = M.duplicate(), M
    K, R = (PETSc.Mat().createNest(rows, comm=comm).convert("aij") for rows in (left, right))
    solver = SLEPc.EPS().create(comm)
    solver.setOptionsPrefix(_PREFIX)
    solver.setOperators(K, R)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setTarget(_SHIFT)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTolerances(tol=1e-10, max_it=500)
    solver.setDimensions(1, min(32, K.size[0]))
    transform = solver.getST()
    transform.setType("sinvert")
    transform.setShift(_SHIFT)
    ksp = transform.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    # where many β are zero MUMPS moves many pivots, and needs more memory than it foresees
    key = _PREFIX + "st_mat_mumps_icntl_14"
    PETSc.Options()[key] = 400
    try:
        solver.solve()
    finally:
        PETSc.Options().delValue(key)
    if solver.getConverged() == 0:
        raise ContactError(
            f"infsup.constant: SLEPc found no eigenvalue (reason {solver.getConvergedReason()});"
            " this is an error of dolfinx_contact, please report it."
        )
    return float(np.sqrt(max(0.0, -solver.getEigenvalue(0).real)))
