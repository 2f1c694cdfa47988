# SPDX-License-Identifier: MIT
"""The problem of the benchmarks of speed: two neo-Hookean plates in contact over a whole side.

Hexahedra of degree 1. N × N slave facets meet 0.77 N × 0.77 N master facets, so that with 1-Simpson
about 8 of the 25 particles of a slave facet share a target; the master may be finer. All particles
are in contact. The outer sides are held.
"""

from __future__ import annotations

import time
from typing import Any, Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

HEIGHT = 0.2  # of a plate
VARIANTS: dict[str, dict[str, Any]] = {
    "facet normals": {"target": dc.Proximity()},
    "facet normals, friction": {"target": dc.Proximity(), "friction": 0.3},
    "smooth": {"target": dc.Smooth()},
    "smooth, friction": {"target": dc.Smooth(), "friction": 0.3},
}
INSERT, TANGENT = PETSc.Log.Event("ContactInsert"), PETSc.Log.Event("ContactTangent")


def grids(facets: int, layers: int, finer: float = 1, overhang: int = 0) -> list[meshes.Body]:
    """Upper (the slave's) and lower plate.

    Args:
        facets: along a side of the slave
        layers: of cells in each plate
        finer: how many times finer than 0.77 the master is
        overhang: rows of facets by which the master is larger at each side
    """
    n = max(1, int(0.77 * finer * facets))
    wide = overhang / n
    n += 2 * overhang
    return [
        meshes.grid((facets, facets, layers), (0, 0, 0), (1, 1, HEIGHT), cell="hexahedron"),
        meshes.grid(
            (n, n, layers), (-wide, -wide, -HEIGHT), (1 + wide, 1 + wide, 0), cell="hexahedron"
        ),
    ]


def neo_hookean(u: Any) -> Any:
    """Energy density; μ = 400, λ = 600."""
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    J = ufl.det(F)
    return 200.0 * (ufl.tr(F.T * F) - 3 - 2 * ufl.ln(J)) + 300.0 * ufl.ln(J) ** 2


class Plates:
    """The problem, and functions that do each part of a Newton iteration's work once.

    Args:
        facets, layers, finer, overhang: see ``grids``
        move: displacement of the upper plate's top
        contact: arguments of the pair, a value of VARIANTS for one; None: no contact
        load: pressure on both contact surfaces where there is no contact
        options: of PETSc, see ContactProblem
        comm, partition: see meshes.create
        repartition: divide that mesh anew by dc.repartition
    """

    def __init__(
        self,
        facets: int,
        layers: int,
        contact: dict[str, Any] | None,
        *,
        finer: float = 1,
        overhang: int = 0,
        move: Sequence[float] = (0.0, 0.0, 0.0),
        load: float = 0.0,
        options: dict[str, Any] | None = None,
        comm: Any = MPI.COMM_SELF,
        partition: Any = None,
        repartition: bool = False,
    ):
        bodies = grids(facets, layers, finer, overhang)
        mesh, body = meshes.create(comm, bodies, partition)
        at = lambda z: lambda x: np.isclose(x[2], z)  # noqa: E731
        where = {1: (at(0), 0), 2: (at(0), 1), 3: at(HEIGHT), 4: at(-HEIGHT)}
        tags = meshes.tag_facets(mesh, where, body)
        if repartition:
            mesh, tags = dc.repartition(mesh, tags, 1, 2)
        V = dc.vector_space(mesh, 1)
        self.u, w = fem.Function(V), ufl.TestFunction(V)
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
        form = ufl.derivative(neo_hookean(self.u) * dx, self.u, w)
        bcs = [
            fem.dirichletbc(np.array(value), fem.locate_dofs_topological(V, 2, tags.find(tag)), V)
            for tag, value in ((3, move), (4, (0.0, 0.0, 0.0)))
        ]
        pairs = []
        if contact is None:
            ds = ufl.Measure("ds", mesh, subdomain_data=tags)
            form += load * ufl.inner(ufl.FacetNormal(mesh), w) * (ds(1) + ds(2))
        else:
            surfaces = dc.Surface(self.u, tags, 1), dc.Surface(self.u, tags, 2)
            self.pair = dc.ContactPair(*surfaces, integration=dc.Simpson(1), **contact)
            pairs = [self.pair]
        self.problem = dc.ContactProblem(form, self.u, pairs, bcs=bcs, petsc_options=options)
        self.system = self.problem.system
        if pairs:
            self.contact = self.system.contacts[0]
        # the body of each cell, 0 for the slave's
        middles = mesh.geometry.x[compat.cell_geometry_dofs(mesh)].mean(axis=1)
        self.body = np.where(middles[:, 2] > 0, 0, 1)
        self.facets, self.dofs = facets, V.dofmap.index_map.size_global * 3

    def press(self) -> None:
        """Give displacements and pressures without solving: plates are warped, so that facets are
        bilinear; the slave slides by a fifth of a facet, except at its ends, and is pressed into
        the master. Then assemble once. Collective."""
        self.system.start()
        x = self.u.function_space.tabulate_dof_coordinates().T
        upper = np.zeros(x.shape[1])
        upper[np.unique(compat.dof_list(self.u.function_space)[self.body == 0])] = 1.0
        bump = upper * np.sin(np.pi * x[0]) * np.sin(np.pi * x[1]) / self.facets
        wave = 2e-3 * np.sin(2 * x[0]) * np.cos(x[1])
        warp = np.stack([1e-3 * np.sin(3 * x[0]), 1e-3 * x[1], wave - 0.02 * upper / self.facets])
        inside = 1 - (x[2] / HEIGHT) ** 2
        self._places = [  # between which a Newton iteration moves the slave
            (inside * (warp + np.stack([slide * bump, 0 * bump, 0 * bump]))).T.ravel()
            for slide in (0.2, 0.22)
        ]
        self.pair._multiplier.x.array[:] = -1.0
        if self.pair.frictional:
            self.pair._semi_multiplier.x.array[:] = 0.3
        self.move()
        self.assemble()
        self.count()

    def count(self) -> None:
        """Numbers of particles and of pairs of facets, over all ranks. Collective.

        Raises:
            RuntimeError: some particles are open
        """
        table, comm = self.contact.assembler.particles(), self.system.comm
        total = np.array([len(table["gap"]), np.sum(~table["closed"])])
        facets = np.unique(np.stack([table["facet"], table["target_facet"]]), axis=1)
        self.particles, is_open = comm.allreduce(total)
        self.pairs = comm.allreduce(facets.shape[1])
        if is_open:
            raise RuntimeError(f"{is_open} of {self.particles} particles are open")

    # -- the whole ------------------------------------------------------------------------------

    def assemble(self) -> None:
        """Residual and Jacobian of bulk and contact, as Newton's method calls for them."""
        system = self.system
        system.read()
        system.residual(system.x, system.b)
        system.jacobian(system.x, system.A)

    # -- parts of a Newton iteration ------------------------------------------------------------

    def move(self) -> None:
        """Put the slave to the other of its two places, 2 % of a facet away."""
        self._places.reverse()
        self.u.x.array[:] = self._places[0]

    def bulk_residual(self) -> None:
        bulk = self.system.bulk
        compat.assemble_vector_local(bulk.F[0], bulk._work[0])

    def bulk_jacobian(self) -> None:
        """With what PETSc does at the end of an assembly."""
        A = self.system.A
        A.zeroEntries()
        self.system.bulk.add(A, self.system.bulk.bcs)
        A.assemble()

    def dolfinx_alone(self) -> Callable[[], None]:
        """The bulk's assembly by DOLFINx's own functions into its own matrix: ours must not be
        slower, or contact would look cheap beside it."""
        J, F = self.system.bulk.J[0][0], self.system.bulk.F[0]
        A = petsc.create_matrix(J)

        def run() -> None:
            A.zeroEntries()
            petsc.assemble_matrix(A, J, self.system.bulk.bcs)
            A.assemble()
            petsc.assemble_vector(F).destroy()

        return run

    def search(self) -> None:
        """From the targets of the last one. With fetching displacements from other ranks."""
        self.contact.update()

    def residual(self) -> None:
        self.contact.assembler.residual(self.system.b.handle)
        self.system.b.assemble()

    def tangent(self) -> None:
        """With insertion, PETSc's end of it, and the check that the matrix has a place."""
        self.contact.assembler.pattern_holds()
        self.system.add_contact(self.system.A)
        self.system.A.assemble()

    # -- what is done once, or rarely -----------------------------------------------------------

    def fresh(self) -> Any:
        """The pair again, as a new problem has it: without targets, without master facets."""
        old = self.contact
        blocks = old._slave_block, old._master_block, old.multiplier_block
        return type(old)(self.pair, old._layout, *blocks, None)

    def exchange(self, fresh: Any) -> None:
        """Bring the master's facets, make the search tree."""
        fresh._exchange(fresh._slave_values(), fresh._ringed_values())

    def exchanged(self) -> Any:
        """The pair again, with master facets, without targets."""
        fresh = self.fresh()
        self.exchange(fresh)
        return fresh

    def cold_search(self, fresh: Any) -> None:
        values = fresh._slave_values(), fresh._master_values(), self.pair._multiplier.x.array
        fresh.assembler.update(*values, -1.0)

    def preallocation(self) -> None:
        self.system._allocate(self.system.A)

    def linear_solve(self) -> None:
        """MUMPS: analysis, factors, solution."""
        system = self.system
        ksp = PETSc.KSP().create(system.comm)
        ksp.setOperators(system.A)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        y = system.b.duplicate()
        ksp.solve(system.b, y)
        ksp.destroy()


# -- clocks -----------------------------------------------------------------------------------


class Times:
    """Seconds of several runs: the least counts, the machine may be shared."""

    def __init__(self, seconds: Sequence[float]):
        self.seconds = list(seconds)

    def __add__(self, other: Times) -> Times:
        return Times([a + b for a, b in zip(self.seconds, other.seconds)])

    @property
    def least(self) -> float:
        return min(self.seconds)

    @property
    def spread(self) -> float:
        """By how much the slowest exceeds the fastest, relative."""
        return max(self.seconds) / min(self.seconds) - 1


def clock(run: Callable[..., object], runs: int, before: Callable[[], Any] | None = None) -> Times:
    """CPU time of this process in several runs.

    Args:
        before: called before each run, untimed; ``run`` gets what it returns, if it is not None
    """
    seconds = []
    for _ in range(runs):
        given = None if before is None else before()
        start = time.process_time()
        run() if given is None else run(given)
        seconds.append(time.process_time() - start)
    return Times(seconds)


def clock_insertion(plates: Plates, runs: int) -> Times:
    """CPU time of the insertion of finished blocks into the matrix: that of the tangent, times the
    insertion's part of it in PETSc's events, which are wall times."""
    if not PETSc.Log.isActive():
        PETSc.Log.begin()

    def walls() -> Any:
        return np.array([event.getPerfInfo()["time"] for event in (INSERT, TANGENT)])

    INSERT.setActive(True)
    seconds = []
    for _ in range(runs):
        before, start = walls(), time.process_time()
        plates.tangent()
        spent = time.process_time() - start
        insertion, tangent = walls() - before
        seconds.append(spent * insertion / tangent)
    INSERT.setActive(False)  # it would slow down what is measured next
    return Times(seconds)
