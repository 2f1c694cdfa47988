# SPDX-License-Identifier: MIT
"""Small contact problems for the tests, on any communicator and any partition.

A problem is two bodies: the slave (upper) with a face SLAVE below and TOP above, the master (lower)
with a face MASTER above and BOTTOM below. Units N, mm, MPa.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes

SLAVE, MASTER, TOP, BOTTOM = 5, 6, 1, 2
UPPER, LOWER = 0, 1  # numbers of the two bodies in one mesh

# two turns about generic axes, so that no facet is parallel to a coordinate plane
ROTATION = Rotation.from_euler("xyz", [0.3, 0.5, -0.7]).as_matrix()


# -- materials --------------------------------------------------------------------------------


def small_strain(u: fem.Function, E: float, nu: float) -> Any:
    """Residual of linear elasticity (plane strain in 2D). Its moments balance in the reference."""
    w, mu, lmbda, dx = _ingredients(u, E, nu)
    strain, identity = ufl.sym(ufl.grad(u)), ufl.Identity(len(u))
    stress = 2 * mu * strain + lmbda * ufl.tr(strain) * identity
    return ufl.inner(stress, ufl.grad(w)) * dx


def neo_hookean(u: fem.Function, E: float, nu: float) -> Any:
    """Residual of a compressible neo-Hookean body. It is objective: its moments balance in the
    current positions."""
    w, mu, lmbda, dx = _ingredients(u, E, nu)
    F = ufl.Identity(len(u)) + ufl.grad(u)
    inverse = ufl.inv(F).T
    P = mu * (F - inverse) + lmbda * ufl.ln(ufl.det(F)) * inverse
    return ufl.inner(P, ufl.grad(w)) * dx


def _ingredients(u: fem.Function, E: float, nu: float) -> tuple[Any, ...]:
    """Test function, Lamé's constants, measure. Constants keep the compiled code the same."""
    mesh = u.function_space.mesh
    mu = constant(mesh, E / (2 * (1 + nu)))
    lmbda = constant(mesh, E * nu / ((1 + nu) * (1 - 2 * nu)))
    degree = compat.lagrange_degree(u.function_space)  # fewer points leave hourglasses
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 2 * degree})
    return ufl.TestFunction(u.function_space), mu, lmbda, dx


def constant(mesh: Any, value: float) -> fem.Constant:
    return fem.Constant(mesh, PETSc.ScalarType(value))


# -- models -----------------------------------------------------------------------------------


@dataclass
class Model:
    """A bulk model before contact: its unknown, residual, tags and conditions.

    ``driven[tag][i]`` is the Constant that holds component i of the displacement of a face, or None
    where that component is free.
    """

    u: fem.Function
    F: Any
    tags: Any
    bcs: list[Any]
    driven: dict[int, list[Any]]

    @property
    def mesh(self) -> Any:
        return self.u.function_space.mesh

    @property
    def comm(self) -> MPI.Comm:
        return self.mesh.comm

    def surface(self, tag: int) -> dc.Surface:
        return dc.Surface(self.u, self.tags, tag)

    def pair(self, **options: Any) -> dc.ContactPair:
        return dc.ContactPair(self.surface(SLAVE), self.surface(MASTER), **options)

    def problem(self, pair: dc.ContactPair, **options: Any) -> dc.ContactProblem:
        return dc.ContactProblem(self.F, self.u, [pair], bcs=self.bcs, **options)

    def move(self, tag: int, displacement: Any) -> None:
        """Prescribe the components of a face that are held."""
        for value, given in zip(self.driven[tag], displacement):
            if value is not None:
                value.value = given

    def solve(self, strategy: dc.Newton | None = None, **options: Any) -> dc.ContactPair:
        """Make a pair and solve with it from the present u."""
        pair = self.pair(**options)
        pair.report = self.problem(pair, strategy=strategy).solve()
        return pair


@dataclass
class Half:
    """One of the two bodies.

    ``faces``: for each tag a function of points (3, n); ``held``: for each tag the displacement of
    the face, with None for free components.
    """

    body: meshes.Body
    faces: dict[int, Callable[[np.ndarray], np.ndarray]]
    held: dict[int, tuple[float | None, ...]]


@dataclass
class Material:
    law: Callable[..., Any]
    young: float
    poisson: float


def one_mesh(
    comm: MPI.Comm,
    halves: list[Half],
    material: Material,
    partition: Any = None,
    degree: int = 1,
) -> Model:
    """The bodies in one mesh, moved by one displacement of a degree."""
    mesh, body = meshes.create(comm, [half.body for half in halves], partition)
    faces = {tag: (f, i) for i, half in enumerate(halves) for tag, f in half.faces.items()}
    tags = meshes.tag_facets(mesh, faces, body)
    u = fem.Function(compat.vector_space(mesh, degree), name="displacement")
    V, driven, bcs = u.function_space, {}, []
    for tag, displacement in {t: d for half in halves for t, d in half.held.items()}.items():
        driven[tag] = [None if value is None else constant(mesh, value) for value in displacement]
        facets = tags.indices[tags.values == tag]
        for i, value in enumerate(driven[tag]):
            if value is not None:
                dofs = fem.locate_dofs_topological(V.sub(i), mesh.topology.dim - 1, facets)
                bcs.append(fem.dirichletbc(value, dofs, V.sub(i)))
    return Model(u, material.law(u, material.young, material.poisson), tags, bcs, driven)


def two_meshes(
    comm: MPI.Comm,
    halves: list[Half],
    material: Material,
    partition: Any = None,
    degree: int = 1,
) -> list[Model]:
    """Each body in a mesh of its own, moved by its own displacement."""
    return [one_mesh(comm, [half], material, partition, degree) for half in halves]


def block_halves(
    counts: tuple[int, int] = (11, 8),
    layers: int = 4,
    cells: tuple[str, str] = ("quadrilateral", "quadrilateral"),
    top: tuple[float | None, ...] = (0.0, -0.024),
    gap: float = 0.0,
) -> list[Half]:
    """[−1, 1] × [0, 1] on [−1, 1] × [−1, 0], the bottom clamped.

    Args:
        counts: slave and master facets
        layers: of cells in each block
        cells: of the slave and of the master
        top: displacement of the top
        gap: between the blocks
    """
    upper = meshes.grid((counts[0], layers), (-1, gap), (1, 1 + gap), cell=cells[0])
    lower = meshes.grid((counts[1], layers), (-1, -1), (1, 0), cell=cells[1])
    return [
        Half(
            upper,
            {SLAVE: lambda x: np.isclose(x[1], gap), TOP: lambda x: np.isclose(x[1], 1 + gap)},
            {TOP: top},
        ),
        Half(
            lower,
            {MASTER: lambda x: np.isclose(x[1], 0), BOTTOM: lambda x: np.isclose(x[1], -1)},
            {BOTTOM: (0.0, 0.0)},
        ),
    ]


def taylor_blocks(comm: MPI.Comm, partition: Any = None) -> Model:
    """Main case of benchmark 2: two blocks of E = 1e7, ν = 0, pressed by 0.024: λ = −1.2e5.

    11 slave and 8 master facets. The top may slide but for one node near its middle.
    """
    halves = block_halves(top=(None, -0.024))
    made = one_mesh(comm, halves, Material(small_strain, 1e7, 0.0), partition)
    V = made.u.function_space
    V0 = V.sub(0).collapse()[0]
    middle = -1 + 2 * 6 / 11
    pinned = fem.locate_dofs_geometrical(
        (V.sub(0), V0), lambda x: np.isclose(x[1], 1) & np.isclose(x[0], middle)
    )
    made.bcs.append(fem.dirichletbc(fem.Function(V0), pinned, V.sub(0)))
    return made


def cube_halves(
    counts: tuple[int, int] = (4, 3), cells: tuple[str, str] = ("hexahedron", "hexahedron")
) -> list[Half]:
    """Two unit cubes, one on the other, rotated by ROTATION and pressed by 0.01 in all.

    Args:
        counts: facets along the slave's and the master's edges (before they are cut in triangles)
        cells: of the slave and of the master
    """
    n, m = counts
    upper = meshes.grid((n, n, 2), (0, 0, 0), (1, 1, 1), turn, cells[0])
    lower = meshes.grid((m, m, 2), (0, 0, -1), (1, 1, 0), turn, cells[1])
    return [
        Half(
            upper,
            {
                SLAVE: lambda x: np.isclose(height(x), 0),
                TOP: lambda x: np.isclose(height(x), 1),
            },
            {TOP: tuple(-0.01 * ROTATION[:, 2])},
        ),
        Half(
            lower,
            {
                MASTER: lambda x: np.isclose(height(x), 0),
                BOTTOM: lambda x: np.isclose(height(x), -1),
            },
            {BOTTOM: (0.0, 0.0, 0.0)},
        ),
    ]


#: of the cubes: λ = −5e4 = −E × 0.01/2
CUBE_MATERIAL = Material(small_strain, 1e7, 0.0)


def turn(x: np.ndarray) -> np.ndarray:
    """ROTATION of points (n, 3)."""
    return x @ ROTATION.T


def height(x: np.ndarray) -> np.ndarray:
    """Coordinate along the rotated third axis of points (3, n)."""
    return ROTATION[:, 2] @ x


def punch_halves(
    counts: tuple[int, int] = (20, 13), depth: float = 0.08, shift: float = 0.0137
) -> list[Half]:
    """The lower part of a disk (R = 1, ±60°) above a block of [−1.5, 1.5] × [−1, 0].

    They touch in one point at first. The facets lie at generic places, so that no search ties.

    Args:
        counts: facets of the arc, and of the block's top
        depth: how far the flat top of the punch is moved down
        shift: of the punch to the right
    """

    def arc(x: np.ndarray) -> np.ndarray:
        """[−1, 1] × [0, 1] to the disk: the lower side to the arc, the upper to a chord."""
        angle = np.pi / 3 * x[:, 0]
        below = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
        above = np.stack([0.9 * x[:, 0], np.ones(len(x))], axis=1)
        return below + x[:, 1:] * (above - below) + np.array([shift, 0.0])

    upper = meshes.grid((counts[0], 4), (-1, 0), (1, 1), arc)
    lower = meshes.grid((counts[1], 4), (-1.5, -1), (1.5, 0))
    return [
        Half(
            upper,
            {
                SLAVE: lambda x: np.isclose(np.hypot(x[0] - shift, x[1] - 1), 1),
                TOP: lambda x: np.isclose(x[1], 1),
            },
            {TOP: (0.0, -depth)},
        ),
        Half(
            lower,
            {MASTER: lambda x: np.isclose(x[1], 0), BOTTOM: lambda x: np.isclose(x[1], -1)},
            {BOTTOM: (0.0, 0.0)},
        ),
    ]


PUNCH_MATERIAL = Material(neo_hookean, 1000.0, 0.3)


def punch(comm: MPI.Comm, partition: Any = None, **options: Any) -> Model:
    """Both halves of ``punch_halves`` in one mesh, neo-Hookean."""
    return one_mesh(comm, punch_halves(**options), PUNCH_MATERIAL, partition)


def dome(comm: MPI.Comm, partition: Any = None) -> Model:
    """3D: a block with a rounded face on a flat one, rotated, neo-Hookean, partly in contact."""

    def bulge(x: np.ndarray) -> np.ndarray:
        y = x.copy()
        drop = 0.15 * ((x[:, 0] - 0.53) ** 2 + (x[:, 1] - 0.46) ** 2)
        y[:, 2] += (1 - x[:, 2]) * drop
        return turn(y)

    def bulge_height(x: np.ndarray) -> np.ndarray:
        """Height above the rounded face, of points (3, n)."""
        y = ROTATION.T @ x
        return y[2] - 0.15 * ((y[0] - 0.53) ** 2 + (y[1] - 0.46) ** 2)

    upper = meshes.grid((4, 4, 2), (0.02, 0.03, 0), (0.97, 1.0, 1), bulge, "hexahedron")
    lower = meshes.grid((3, 3, 2), (-0.1, -0.13, -1), (1.12, 1.1, 0), turn, "hexahedron")
    halves = [
        Half(
            upper,
            {
                SLAVE: lambda x: np.isclose(bulge_height(x), 0),
                TOP: lambda x: np.isclose(height(x), 1),
            },
            {TOP: tuple(-0.04 * ROTATION[:, 2])},
        ),
        Half(
            lower,
            {
                MASTER: lambda x: np.isclose(height(x), 0),
                BOTTOM: lambda x: np.isclose(height(x), -1),
            },
            {BOTTOM: (0.0, 0.0, 0.0)},
        ),
    ]
    return one_mesh(comm, halves, PUNCH_MATERIAL, partition)


# -- partitions: mean points (cells, dim) and number of ranks -> rank of each cell -------------


def apart(x: np.ndarray, ranks: int) -> np.ndarray:
    """Slave on the last rank, master on the first; with three ranks the middle one owns nothing."""
    return np.where(_upright(x)[:, -1] > 0, ranks - 1, 0)


def striped(x: np.ndarray, ranks: int) -> np.ndarray:
    """Columns of cells, dealt out in turn: the interface is cut in many places."""
    return np.floor(_upright(x)[:, 0] / 0.31).astype(int) % ranks


def remote(x: np.ndarray, ranks: int) -> np.ndarray:
    """Cells near the interface go to the last rank: the others own cells, but no contact facets."""
    far = np.abs(_upright(x)[:, -1]) > 0.6
    return np.where(far, np.arange(len(x)) % ranks, ranks - 1)


def _upright(x: np.ndarray) -> np.ndarray:
    """Points (n, dim) before the rotation of 3D problems."""
    return x @ ROTATION if x.shape[1] == 3 else x


# -- results ----------------------------------------------------------------------------------


def values(f: fem.Function) -> tuple[np.ndarray, np.ndarray]:
    """Positions and values at the nodes of a Function, of all ranks, on all ranks. Collective.

    Returns:
        positions (nodes, 3) and values (nodes, components), in no order
    """
    V = f.function_space
    owned = V.dofmap.index_map.size_local
    x = V.tabulate_dof_coordinates()[:owned]
    v = f.x.array.reshape(-1, V.dofmap.index_map_bs)[:owned]
    comm = V.mesh.comm
    return np.concatenate(comm.allgather(x)), np.concatenate(comm.allgather(v))


def distance(a: fem.Function, b: fem.Function) -> float:
    """Largest difference of two Functions at their nodes, over b's largest value. Collective.

    The Functions may live on different communicators; their nodes must be the same points.
    """
    (x, v), (y, w) = values(a), values(b)
    assert len(x) == len(y) > 0
    apart, at = cKDTree(y).query(x)
    assert apart.max() < 1e-9  # the same points up to round-off, mesh sizes are above 0.05
    assert np.array_equal(np.sort(at), np.arange(len(y)))
    scale = np.abs(w).max()
    assert scale > 0
    return float(np.abs(v - w[at]).max() / scale)


def spread(f: fem.Function) -> float:
    """(max − min)/mean over the nodes. Collective."""
    v = values(f)[1]
    return float((v.max() - v.min()) / v.mean())


def powers(problem: dc.ContactProblem, u: fem.Function, wave: np.ndarray, most: int) -> np.ndarray:
    """Powers of ε with which the first three residual norms grow, where Newton starts from the
    present solution disturbed by ε × wave: about 1, 2 and 4 if it is quadratic. Collective.

    Asserts that no status changes and that Newton takes few iterations.

    Args:
        wave: values at the nodes of u, (nodes, dim)
        most: iterations
    """
    solution, norms = u.x.array.copy(), []
    for size in (1, 2):
        u.x.array[:] = solution + size * wave.ravel()
        report = problem.solve()
        assert sum(report.status_changes) == 0 and report.iterations <= most
        norms.append(report.norms[:3])
        # well above the round-off of the assembly, about 1e-14 of the forces
        assert norms[-1][2] > 1e-10 * report.reference
    return np.log2(np.array(norms[1]) / norms[0])


def balance(model: Model, tag: int, deformed: bool = True) -> np.ndarray:
    """Force and moment that the support of a face exerts on the body. Collective.

    Sums of the nodal forces of F without Dirichlet conditions; moments about the origin, in the
    current or in the reference positions.

    Returns:
        force (dim,), then moment (1 in 2D, 3 in 3D)
    """
    u, V = model.u, model.u.function_space
    dim, owned = V.mesh.geometry.dim, V.dofmap.index_map.size_local
    forces = compat.assemble_vector_local(compat.form(model.F), fem.Function(V)).reshape(-1, dim)
    facets = model.tags.indices[model.tags.values == tag]
    nodes = fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, facets)
    nodes = nodes[nodes < owned]
    x = V.tabulate_dof_coordinates()[nodes, :dim]
    if deformed:
        x = x + u.x.array.reshape(-1, dim)[nodes]
    return V.mesh.comm.allreduce(wrench(x, forces[nodes]))


def wrench(x: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Sum of forces at points (n, dim) and of their moments about the origin."""
    if x.shape[1] == 3:
        moments = np.cross(x, forces)
    else:
        moments = x[:, :1] * forces[:, 1:] - x[:, 1:] * forces[:, :1]
    return np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])
