# SPDX-License-Identifier: MIT
"""A box to be loaded in tests of materials. Units N, mm, MPa."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

COMM = MPI.COMM_WORLD
E, NU = 69004.0, 0.3
VOCE = dc.plasticity.Voce(80.0, 200.0, 15.0, 30.0)


class Specimen:
    """[0, 1]^dim of quadrilaterals or hexahedra (or of ``size``), its displacement and conditions.

    The face x_i = 0 has the tag 2i + 1, the opposite one 2i + 2.
    """

    def __init__(
        self,
        dim: int,
        counts: tuple[int, ...] | int = 2,
        size: tuple[float, ...] | None = None,
        comm: MPI.Comm = COMM,
        partition: Any = None,
    ):
        counts = (counts,) * dim if isinstance(counts, int) else counts
        size = (1.0,) * dim if size is None else size
        cell = "quadrilateral" if dim == 2 else "hexahedron"
        grid = meshes.grid(counts, (0,) * dim, size, cell=cell)
        self.mesh, _ = meshes.create(comm, grid, partition)
        faces = {}
        for i in range(dim):
            faces[2 * i + 1] = lambda x, i=i: np.isclose(x[i], 0)
            faces[2 * i + 2] = lambda x, i=i: np.isclose(x[i], size[i])
            self.tags = meshes.tag_facets(self.mesh, faces)
        self.u = fem.Function(compat.vector_space(self.mesh, 1), name="displacement")
        self.w = ufl.TestFunction(self.u.function_space)
        self.bcs: list[Any] = []
        self.dim, self.comm = dim, comm

    def hold(self, tag: int, *components: int, V: Any = None) -> Any:
        """Hold components on a face; returns the Constant of their common value."""
        V = self.u.function_space if V is None else V
        value = fem.Constant(self.mesh, PETSc.ScalarType(0))
        facets = self.tags.indices[self.tags.values == tag]
        for i in components:
            dofs = fem.locate_dofs_topological(V.sub(i), self.dim - 1, facets)
            self.bcs.append(fem.dirichletbc(value, dofs, V.sub(i)))
        return value

    def rollers(self, *axes: int) -> None:
        """No normal displacement of the faces x_i = 0."""
        for i in axes:
            self.hold(2 * i + 1, i)

    def surface(self, tag: int) -> dc.Surface:
        return dc.Surface(self.u, self.tags, tag)

    def problem(self, materials: Any, F: Any = None, pairs: Any = (), **options: Any) -> Any:
        """With the materials' own virtual work, if F is not given."""
        materials = [materials] if isinstance(materials, dc.QuadratureLaw) else materials
        F = sum(m.work(self.w) for m in materials) if F is None else F
        return dc.ContactProblem(
            F, self.u, list(pairs), bcs=self.bcs, materials=materials, **options
        )


def gathered(law: Any, f: Any) -> np.ndarray:
    """Values of a field at all points of all ranks, by position; (points, components). Collective."""
    x = np.concatenate(law.comm.allgather(law.positions()))
    values = np.concatenate(law.comm.allgather(law.values(f)))
    return values[np.lexsort(np.round(x, 9).T)]


def disturb(problem: Any, size: float) -> None:
    """Add random numbers to what is free of the first unknown. Collective."""
    u, rng = problem.u[0], np.random.default_rng(problem.comm.rank)
    free = ~problem.system.layout.held_mask(0)
    u.x.array[:] += size * free * rng.uniform(-1, 1, len(u.x.array))
    u.x.scatter_forward()


def tangent_error(problem: Any) -> float:
    """‖J d − dF/dε‖/‖dF/dε‖ of the problem's Jacobian at its present
    unknowns, in a random direction d. Collective."""
    system, rng = problem.system, np.random.default_rng(problem.comm.rank)
    system.start()
    system.residual(system.x, system.b)
    system.jacobian(system.x, system.A)
    x, d = system.x.copy(), system.x.duplicate()
    d.array[:] = rng.uniform(-1, 1, len(d.array_r))
    for block, scale in enumerate(system.scale):  # of the same size in the user's units
        d.array[system.layout.slice(block)] /= scale
    product = system.A * d

    def residual(length: float) -> Any:
        at, b = x.copy(), system.b.duplicate()
        at.axpy(length, d)
        system.residual(at, b)
        return b

    h = 1e-6  # of strains of 1e-1: truncation 1e-16, round-off 1e-10
    difference = 8 * (residual(h) - residual(-h)) - (residual(2 * h) - residual(-2 * h))
    difference.scale(1 / (12 * h))
    system.write(x)
    return (product - difference).norm() / difference.norm()
