# SPDX-License-Identifier: MIT
"""Surfaces that may touch: exterior facets of a mesh, read into arrays.

A facet is parametrised by ξ on the reference facet, x(ξ) = Σ_a N_a(ξ) x_a, with the vertices in the
order that Basix gives to the cell's sub-entity. All node arrays follow the order of the standard
facet element (Basix's Lagrange element on the facet's shape), whatever the cell.

Equation numbers (F…): H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements,
Revue européenne des éléments finis 11 (2002), as restated in the mathematics page.
"""

from __future__ import annotations

import itertools
import operator
from typing import Any, Iterable

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from . import compat
from .checks import agreed
from .errors import ContactError, InputError, together

_FACET_SHAPES = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
_DISCONTINUOUS = ("DG", "DQ", "DP", "Discontinuous Lagrange")
_CONTINUOUS = ("Lagrange", "CG", "P", "Q")


class Surface:
    """Part of a body's boundary that may touch, moved by the displacement ``u``.

    The construction is collective; a rank may own none of the facets. A facet is owned by the rank
    that owns its cell. Arrays have one row for each of this rank's n facets, in the order of the
    local facet numbers; lengths are in the unit of the mesh.

    Args:
        u: displacement, a Function of a continuous Lagrange space of degree 1 or 2 with as many
            components as the mesh has dimensions (2 in 2D, 3 in 3D)
        facet_tags: MeshTags of the facets of u's mesh
        tags: tag or tags of the facets that make the surface

    Raises:
        InputError: on all ranks, if u is not such a displacement, the tags are of another dimension
            or of another mesh, a tag is unknown, the surface is empty or has interior facets

    Attributes:
        dim: geometric dimension
        shape: "interval", "triangle" or "quadrilateral"
        u, comm: the displacement, the communicator of its mesh
        facets: local facet numbers; (n,)
        cells, local_facets: local cell of each facet, and the facet's position in it; (n,)
        id: the same number on every partition; (n,) int64
        vertices: global geometry nodes of the corners; (n, vertices) int64
        nodes: global block dofs of u, in the order of the facet's displacement basis; (n, nu) int64
        X: reference positions at the nodes of the position basis, whose degree is the higher one of
            geometry and displacement; (n, np, dim)
        sigma: +1 where τ_1 × τ_2 (2D: (τ_y, −τ_x)) points into the body, else −1; (n,) int8
        reference: the facet's polynomials: "shape"; "position" and "displacement", each with
            "degree", "points", "powers", "coefficients" (see basis_polynomials); "interpolation",
            the displacement basis at the position nodes, (np, nu); "hull", from the values at the
            position nodes to Bernstein control points, (np, np); "area", the weights of the area
            vector, (np, np)
    """

    def __init__(self, u: fem.Function, facet_tags: Any, tags: int | Iterable[int]):
        if not isinstance(u, fem.Function):
            raise InputError(
                f"Surface: u is a {type(u).__name__}; give the displacement as a dolfinx Function."
            )
        mesh = u.function_space.mesh
        self.u, self.comm = u, mesh.comm
        self._bulk, self._mesh, self._mesh_facets = mesh, None, None

        with together(self.comm, "Surface"):
            degree = _check_displacement(u)
            self.tags = check_tags(facet_tags, tags, mesh)
        agreed(self.comm, "Surface", tags=self.tags)
        check_available(self.comm, facet_tags, self.tags)

        exterior = compat.exterior_facets(mesh)
        with together(self.comm, "Surface"):
            self._select(facet_tags, exterior)
        if self.comm.allreduce(len(self.facets)) == 0:
            raise InputError(
                f"Surface: no rank owns a facet with tags {self.tags}; give tags that mark at least"
                " one exterior facet on the rank that owns its cell."
            )
        with together(self.comm, "Surface"):
            self._check_nodes()
            self._read(degree)

    # -- checks -----------------------------------------------------------------------------

    def _select(self, facet_tags: Any, exterior: npt.NDArray[np.int32]) -> None:
        """Find this rank's facets, and refuse facets between two cells."""
        mesh = self._bulk
        values, indices = np.asarray(facet_tags.values), np.asarray(facet_tags.indices)
        facets = np.unique(indices[np.isin(values, self.tags)]).astype(np.int32)
        cells, links = compat.facet_cells(mesh, facets)
        own = cells < mesh.topology.index_map(mesh.topology.dim).size_local
        # a facet that sees a single, owned cell may still have a second one on another rank
        interior = (links > 1) | (own & ~np.isin(facets, exterior))
        if np.any(interior):
            nodes = compat.cell_geometry_dofs(mesh)[cells[interior][0]]
            place = np.array2string(mesh.geometry.x[nodes].mean(axis=0), precision=3)
            raise InputError(
                f"Surface: {np.sum(interior)} facets with tags {self.tags} lie between two cells"
                f" (one by the cell around {place}); a surface is made of exterior facets. Tag"
                " exterior facets only, or separate the bodies in the mesh."
            )
        self.facets, self.cells = facets[own], cells[own]
        self.local_facets = compat.local_facet_indices(mesh, self.cells, self.facets)

    def _check_nodes(self) -> None:
        """Refuse meshes on which nothing can be computed, and facets without area."""
        from .cells import check_cells, check_facets  # which need this module

        mesh = self._bulk
        check_cells(mesh)
        closure = facet_closure(mesh.topology.cell_name(), compat.coordinate_degree(mesh))
        nodes = compat.cell_geometry_dofs(mesh)[self.cells]
        x = np.asarray(mesh.geometry.x)[:, : mesh.geometry.dim]
        size = np.linalg.norm(np.ptp(x[nodes], axis=1), axis=1)
        X = x[np.take_along_axis(nodes, closure[self.local_facets], axis=1)]
        shape = _FACET_SHAPES[mesh.topology.cell_name()]
        check_facets(X, len(basix.geometry(_cell_type(shape))), size, self.tags)

    # -- arrays -----------------------------------------------------------------------------

    def _read(self, degree: int) -> None:
        """Fill the arrays of this rank."""
        mesh, V = self._bulk, self.u.function_space
        cell, self.dim = mesh.topology.cell_name(), mesh.geometry.dim
        self.shape = _FACET_SHAPES[cell]
        geometry_degree = compat.coordinate_degree(mesh)
        position_degree = max(degree, geometry_degree)
        self.reference = reference_facet(self.shape, position_degree, degree)

        self.id = compat.original_cells(mesh)[self.cells] * 8 + self.local_facets

        cell_nodes = compat.cell_geometry_dofs(mesh)
        on_facet = facet_closure(cell, geometry_degree)[self.local_facets]
        nodes = cell_nodes[self.cells[:, None], on_facet]
        self._facet_nodes = compat.global_indices(mesh.geometry.index_map())[nodes]
        self.vertices = self._facet_nodes[:, : len(basix.geometry(_cell_type(self.shape)))]

        on_facet = facet_closure(cell, degree)[self.local_facets]
        dofs = compat.dof_list(V)[self.cells[:, None], on_facet]
        self.nodes = compat.global_indices(V.dofmap.index_map)[dofs]

        # x at the position nodes: exact, since the position basis contains the geometry's
        x = np.asarray(mesh.geometry.x)[:, : self.dim]
        points = self.reference["position"]["points"]
        self.X = np.matmul(_tabulate(self.shape, geometry_degree, points), x[nodes])
        self.sigma = _orientation(
            cell, geometry_degree, x[cell_nodes[self.cells]], self.local_facets
        )

    # -- the mesh of the facets ---------------------------------------------------------------

    @property
    def mesh(self) -> Any:
        """The facets as a DOLFINx mesh of codimension 1. Collective at the first access.

        Its cells stay on the rank that owns the facet, and their nodes are in the facet's order.
        """
        if self._mesh is None:
            self._make_mesh()
        return self._mesh

    @property
    def facet_mesh_cells(self) -> npt.NDArray[np.int64]:
        """For each local cell of ``mesh`` its facet's row, (cells,). Collective at the first access."""
        if self._mesh is None:
            self._make_mesh()
        return self._mesh_facets

    def _make_mesh(self) -> None:
        geometry = self._bulk.geometry
        owned = np.asarray(geometry.x)[: geometry.index_map().size_local]
        degree = compat.coordinate_degree(self._bulk)
        mesh, facets = compat.create_facet_mesh(
            self.comm, self._facet_nodes, owned, self.shape, degree, self.dim
        )
        with together(self.comm, "Surface.mesh"):
            given = np.asarray(mesh.geometry.input_global_indices)
            kept = given[compat.cell_geometry_dofs(mesh)]
            if not np.array_equal(kept, self._facet_nodes[facets]) or len(kept) != len(self.cells):
                raise ContactError(
                    "DOLFINx has moved facets to another rank or permuted their nodes; this is an"
                    " error of dolfinx_contact, please report it with your version of DOLFINx."
                )
        self._mesh, self._mesh_facets = mesh, facets


def basis_polynomials(
    shape: str, degree: int, family: str = "Lagrange"
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """A nodal basis as polynomials: N_a(ξ) = Σ_m coefficients[a, m] Π_i ξ_i^powers[m, i].

    Args:
        shape: "interval", "triangle" or "quadrilateral"
        degree: of the basis; 0 for discontinuous families only
        family: "Lagrange" or "DG" (the other usual names of the two are understood)

    Returns:
        powers (monomials, shape's dimension), coefficients (nodes, monomials), and the nodes'
        positions on the reference shape (nodes, dimension), in Basix's order

    Raises:
        InputError: unknown family, or a degree it does not have
    """
    element = _element(shape, degree, family)
    points = np.array(element.points)
    powers = _powers(shape, degree)
    # N_a(x_b) at the nodes is the identity up to round-off; Vandermonde: N = coefficients · M
    values = element.tabulate(0, points)[0, :, :, 0]
    coefficients = np.linalg.solve(_monomials(powers, points), values).T
    return powers, _rounded(coefficients), points


def _check_displacement(u: fem.Function) -> int:
    """Degree of a displacement that a surface can use."""
    V = u.function_space
    mesh = V.mesh
    cell, gdim, tdim = mesh.topology.cell_name(), mesh.geometry.dim, mesh.topology.dim
    wanted = f"give a Function of a Lagrange space of degree 1 or 2 with {gdim} components"
    if cell not in _FACET_SHAPES or gdim != tdim:
        raise InputError(
            f"Surface: the mesh has {cell} cells in {gdim} dimensions; use one of"
            f" {', '.join(_FACET_SHAPES)}, with as many coordinates as the cell has dimensions."
        )
    if compat.coordinate_degree(mesh) not in (1, 2):
        raise InputError(
            f"Surface: the mesh has geometry of degree {compat.coordinate_degree(mesh)};"
            " make it with degree 1 or 2."
        )
    if compat.value_shape(V) != (gdim,):
        raise InputError(f"Surface: u has values of shape {compat.value_shape(V)}; {wanted}.")
    degree = compat.lagrange_degree(V)
    if degree not in (1, 2):
        raise InputError(f"Surface: u lives on {V.ufl_element()}; {wanted}.")
    if V.dofmap.index_map_bs != gdim:
        raise InputError(
            f"Surface: u is a part of a mixed function; {wanted} of its own, and pass the unknowns"
            " of a mixed model as lists of F and u."
        )
    return degree


def check_tags(facet_tags: Any, tags: int | Iterable[int], mesh: Any) -> list[int]:
    """The tags as a list, after checks of what every rank can see."""
    if not all(hasattr(facet_tags, name) for name in ("dim", "indices", "values")):
        raise InputError(f"Surface: facet_tags is a {type(facet_tags).__name__}; give MeshTags.")
    fdim = mesh.topology.dim - 1
    if facet_tags.dim != fdim:
        raise InputError(
            f"Surface: the tags are of dimension {facet_tags.dim}; give tags of the facets, which"
            f" are of dimension {fdim}."
        )
    if not compat.same_mesh(facet_tags, mesh):
        raise InputError("Surface: facet_tags belong to another mesh than u; give those of u's.")
    try:
        given = list(tags) if isinstance(tags, Iterable) else [tags]
        wanted = sorted({operator.index(tag) for tag in given})
    except TypeError:
        raise InputError(f"Surface: tags is {tags!r}; give an integer or several.") from None
    if not wanted:
        raise InputError("Surface: tags is empty; give at least one tag.")
    return wanted


def check_available(comm: Any, facet_tags: Any, tags: list[int]) -> None:
    """Refuse tags that no rank knows. Collective; all ranks come to the same answer."""
    known = comm.allgather(np.unique(np.asarray(facet_tags.values)).tolist())
    available = sorted(set(itertools.chain.from_iterable(known)))
    unknown = [tag for tag in tags if tag not in available]
    if unknown:
        raise InputError(
            f"Surface: no facet has the tag {', '.join(map(str, unknown))}; the facet tags"
            f" hold {available}. Choose among these, or tag the facets."
        )


# -- the reference facet ------------------------------------------------------------------------


def _cell_type(name: str) -> Any:
    return getattr(basix.CellType, name)


def _element(shape: str, degree: int, family: str = "Lagrange") -> Any:
    """Basix's Lagrange element, continuous or not."""
    if family not in _CONTINUOUS + _DISCONTINUOUS:
        raise InputError(f'The family is "{family}"; facets carry "Lagrange" and "DG".')
    lowest = 0 if family in _DISCONTINUOUS else 1
    if degree < lowest:
        raise InputError(f'"{family}" has no degree {degree}; the lowest is {lowest}.')
    variant, unset = basix.LagrangeVariant.gll_warped, basix.DPCVariant.unset
    family_P, discontinuous = basix.ElementFamily.P, family in _DISCONTINUOUS
    return basix.create_element(family_P, _cell_type(shape), degree, variant, unset, discontinuous)


def _rounded(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Without round-off where the exact values are quarters, as they are up to degree 2."""
    quarters = np.round(4 * values) / 4 + 0.0
    return np.where(np.abs(values - quarters) < 1e-12, quarters, values)


def _tabulate(shape: str, degree: int, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Continuous Lagrange basis at points, exact at the usual nodes; shape (points, nodes)."""
    powers, coefficients, _ = basis_polynomials(shape, degree)
    return _monomials(powers, points) @ coefficients.T


def _powers(shape: str, degree: int) -> npt.NDArray[np.int32]:
    """Exponents of the monomials: total degree on simplices, degree per direction otherwise."""
    dim = 1 if shape == "interval" else 2
    powers = itertools.product(range(degree + 1), repeat=dim)
    kept = [p for p in powers if shape == "quadrilateral" or sum(p) <= degree]
    return np.array(sorted(kept, key=lambda p: (sum(p), p[::-1])), dtype=np.int32)


def _monomials(
    powers: npt.NDArray[np.int32], points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Π_i ξ_i^p_i at points; shape (points, monomials)."""
    return np.prod(points[:, None, :] ** powers[None, :, :], axis=2)


def _bernstein(
    shape: str, degree: int, points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Bernstein polynomials at points, one for each exponent; shape (points, exponents)."""
    factorial = np.array([1.0, 1.0, 2.0])
    powers = _powers(shape, degree)
    if shape == "quadrilateral":
        first, second = (_bernstein("interval", degree, points[:, i : i + 1]) for i in range(2))
        return first[:, powers[:, 0]] * second[:, powers[:, 1]]
    rest = degree - powers.sum(axis=1)
    scale = factorial[degree] / (factorial[powers].prod(axis=1) * factorial[rest])
    return scale * _monomials(powers, points) * (1 - points.sum(axis=1))[:, None] ** rest


def _area_weights(shape: str, degree: int) -> npt.NDArray[np.float64]:
    """W_ab = ∫ (∂_1 N_a ∂_2 N_b − ∂_2 N_a ∂_1 N_b) dξ, (np, np): a facet's area vector is
    Σ_{b<a} W_ab x_a × x_b. Zero for intervals, whose area vector is the turned chord."""
    element = _element(shape, degree)
    if shape == "interval":
        return np.zeros((degree + 1, degree + 1))
    points, weights = compat.quadrature(shape, 2 * degree)
    _, first, second = element.tabulate(1, points)[:3, :, :, 0]
    W = np.einsum("p,pa,pb->ab", weights, first, second)
    return W - W.T


def reference_facet(shape: str, position_degree: int, displacement_degree: int) -> dict[str, Any]:
    """The polynomials of a facet, as described in Surface."""
    reference: dict[str, Any] = {"shape": shape}
    degrees = {"position": position_degree, "displacement": displacement_degree}
    for name, degree in degrees.items():
        powers, coefficients, points = basis_polynomials(shape, degree)
        reference[name] = {
            "degree": degree,
            "points": points,
            "powers": powers,
            "coefficients": coefficients,
        }
    points = reference["position"]["points"]
    reference["interpolation"] = _tabulate(shape, displacement_degree, points)
    reference["hull"] = _rounded(np.linalg.inv(_bernstein(shape, position_degree, points)))
    reference["area"] = _area_weights(shape, position_degree)
    return reference


# -- the facets of the reference cell -------------------------------------------------------------


def _facet_corners(cell: str) -> npt.NDArray[np.float64]:
    """Corners of each facet of the reference cell; shape (facets, corners, cell's dimension)."""
    topology, geometry = basix.topology(_cell_type(cell)), basix.geometry(_cell_type(cell))
    return np.array([geometry[list(corners)] for corners in topology[-2]])


def _on_facets(cell: str, xi: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points of the reference facet on each facet of the cell; (facets, points, dimension)."""
    corners = _facet_corners(cell)
    edges = corners[:, 1 : 1 + xi.shape[1]] - corners[:, :1]
    return corners[:, :1] + np.matmul(xi, edges)


def facet_closure(cell: str, degree: int) -> npt.NDArray[np.int64]:
    """Nodes of the cell's Lagrange element in the order of the standard facet element.

    Matched by position, facet by facet; shape (facets, facet nodes).
    """
    element = _element(cell, degree)
    wanted = _on_facets(cell, np.array(_element(_FACET_SHAPES[cell], degree).points))
    table = []
    for closure, positions in zip(element.entity_closure_dofs[-2], wanted):
        closure = np.array(closure)
        distance = np.linalg.norm(positions[:, None] - element.points[closure][None], axis=2)
        assert distance.min(axis=1).max() < 1e-12
        table.append(closure[distance.argmin(axis=1)])
    return np.array(table)


def _orientation(
    cell: str,
    degree: int,
    x: npt.NDArray[np.float64],
    local_facets: npt.NDArray[np.int32],
) -> npt.NDArray[np.int8]:
    """σ_f = sign((τ_1 × τ_2)·n) at the facet's midpoint, n = −J⁻ᵀN_ref/‖·‖ inward.

    Args:
        cell, degree: of the mesh's geometry
        x: geometry nodes of each facet's cell; shape (n, nodes, dim)
        local_facets: position of each facet in its cell; shape (n,)
    """
    shape = _FACET_SHAPES[cell]
    middle = basix.geometry(_cell_type(shape)).mean(axis=0, keepdims=True)
    points = _on_facets(cell, middle)[:, 0]
    gradients = np.array(_element(cell, degree).tabulate(1, points)[1:, :, :, 0])
    J = np.einsum("fai,jfa->fij", x, gradients[:, local_facets])
    corners = _facet_corners(cell)
    edges = (corners[:, 1 : points.shape[1]] - corners[:, :1])[local_facets]
    tau = np.einsum("fij,fkj->fki", J, edges)  # τ_k, the tangents
    if points.shape[1] == 2:
        normal = np.stack([tau[:, 0, 1], -tau[:, 0, 0]], axis=1)
    else:
        normal = np.cross(tau[:, 0], tau[:, 1])
    outward = np.asarray(basix.cell.facet_outward_normals(_cell_type(cell)))[local_facets]
    inward = -np.einsum("fji,fj->fi", np.linalg.inv(J), outward)
    return np.where(np.einsum("fi,fi->f", normal, inward) > 0, 1, -1).astype(np.int8)
