# SPDX-License-Identifier: MIT
"""Every difference between DOLFINx versions (0.5.2 to 0.11), and nothing else.

Arrays come out and arrays go in; where a DOLFINx object is returned it is one that has the same
interface in all versions. ``cells`` always counts owned cells first, then ghost cells.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Iterator, Sequence

import basix
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import cpp as _cpp
from dolfinx import fem, graph, io, la
from dolfinx import mesh as _mesh
from mpi4py import MPI
from petsc4py import PETSc

# The interface of 0.5 (pybind11, ufl elements, VectorFunctionSpace) or that of 0.8 and later
# (nanobind, basix.ufl elements, functionspace). Versions between the two are not supported.
_OLD = not hasattr(fem, "functionspace")
_ADD = la.ScatterMode.add if hasattr(la, "ScatterMode") else la.InsertMode.add


def cpp_object(wrapper: Any) -> Any:
    """The C++ object behind a Python wrapper (the object itself where there is no wrapper)."""
    if isinstance(wrapper, _mesh.Mesh) and _OLD:
        return wrapper._mesh
    return getattr(wrapper, "_cpp_object", wrapper)


# -- meshes -----------------------------------------------------------------------------------


def cell_geometry_dofs(mesh: _mesh.Mesh) -> npt.NDArray[np.int32]:
    """Local geometry nodes of each cell, ghosts included; shape (cells, nodes)."""
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps"):
        return np.asarray(geometry.dofmaps[0])
    if not _OLD:
        return np.asarray(geometry.dofmap)
    return _rows(geometry.dofmap, geometry.cmap.create_dof_layout().num_dofs)


def coordinate_degree(mesh: _mesh.Mesh) -> int:
    """Polynomial degree of the geometry."""
    geometry = mesh.geometry
    return (geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap).degree


def original_cells(mesh: _mesh.Mesh) -> npt.NDArray[np.int64]:
    """Number of each local cell in the input of the mesh, over all ranks; shape (cells,)."""
    original = mesh.topology.original_cell_index
    if isinstance(original, (list, tuple)):  # one array a cell type
        original = original[0]
    return np.asarray(original, dtype=np.int64)


def facet_cells(
    mesh: _mesh.Mesh, facets: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """First local cell of each facet and the number of its local cells; shapes (facets,).

    Collective when the connectivity is not there yet.
    """
    links, offsets = _connectivity(mesh, mesh.topology.dim - 1, mesh.topology.dim)
    return links[offsets[facets]], (offsets[facets + 1] - offsets[facets]).astype(np.int32)


def local_facet_indices(
    mesh: _mesh.Mesh, cells: npt.NDArray[np.int32], facets: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    """Position of each facet in its cell (``facets[i]`` belongs to ``cells[i]``)."""
    links, offsets = _connectivity(mesh, mesh.topology.dim, mesh.topology.dim - 1)
    if len(cells) == 0:
        return np.zeros(0, dtype=np.int32)
    per_cell = offsets[1] - offsets[0]
    return np.argmax(links.reshape(-1, per_cell)[cells] == facets[:, None], axis=1).astype(
        np.int32
    )


def exterior_facets(mesh: _mesh.Mesh) -> npt.NDArray[np.int32]:
    """Owned facets that belong to one cell only, over all ranks. Collective at the first call."""
    mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
    return np.asarray(_mesh.exterior_facet_indices(mesh.topology), dtype=np.int32)


def same_mesh(tags: Any, mesh: _mesh.Mesh) -> bool:
    """Whether mesh tags were made on this mesh (True where that cannot be told)."""
    if hasattr(tags, "topology"):
        return cpp_object(tags.topology) is cpp_object(mesh.topology)
    if hasattr(tags, "mesh"):
        return cpp_object(tags.mesh) is cpp_object(mesh)
    return True


def create_mesh(
    comm: MPI.Comm,
    cells: npt.NDArray[np.int64],
    points: npt.NDArray[np.float64],
    cell: str,
    degree: int,
    ranks: npt.NDArray[np.int32] | None = None,
    shared: npt.NDArray[np.int64] | None = None,
) -> _mesh.Mesh:
    """A mesh of Lagrange cells from distributed input. Collective.

    Args:
        cells: this rank's part of the cells, in global node numbers; shape (cells, nodes)
        points: this rank's part of the nodes, numbered on over the ranks; shape (points, gdim)
        cell: name of the cell's shape
        degree: of the geometry
        ranks: the rank that shall own each of the given cells, shape (cells,), given by all ranks
            or by none. Without it DOLFINx's default partition
        shared: global numbers of entities of each cell, shape (cells, entities): a cell is a ghost
            on all ranks with a cell that has one of these in common. None: no ghost cells
    """
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    points = np.ascontiguousarray(points, dtype=np.float64)
    gdim = points.shape[1]
    options: dict[str, Any] = {}
    if ranks is not None:
        ranks = np.asarray(ranks, dtype=np.int32)
        offsets = np.arange(len(ranks) + 1, dtype=np.int32)
        if shared is not None:
            ranks, offsets = _with_ghosts(comm, shared, ranks)
        elif _OLD:
            # 0.5 learns from ghost cells alone which vertices the ranks share, and tears the mesh
            # apart where there are none; with GhostMode.none it drops the ghosts after that
            corners = _cpp.mesh.cell_num_vertices(_mesh.to_type(cell))
            ranks, offsets = _with_ghosts(comm, cells[:, :corners], ranks)
            options["ghost_mode"] = _mesh.GhostMode.none
        options["partitioner"] = _partitioner(ranks, offsets)
    if _OLD:
        shape = ufl.Cell(cell, geometric_dimension=gdim)
        # FFCx would choose this variant as it compiles the first form, and test functions made before
        # that would no longer be those made after it
        element = ufl.FiniteElement("Lagrange", shape, degree, variant="equispaced")
        domain = ufl.Mesh(ufl.VectorElement(element, dim=gdim))
        rows = _cpp.graph.AdjacencyList_int64(cells)
        return _mesh.create_mesh(comm, rows, points, domain, **options)
    import basix.ufl

    element = basix.ufl.element("Lagrange", cell, degree, shape=(gdim,))
    return _mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element), **options)


def gmsh_to_mesh(model: Any, comm: MPI.Comm, dim: int) -> tuple[Any, Any, Any]:
    """Mesh, cell tags and facet tags of gmsh's model on rank 0. Collective."""
    try:
        from dolfinx.io import gmsh as reader  # since 0.10
    except ImportError:
        from dolfinx.io import gmshio as reader
    found = reader.model_to_mesh(model, comm, 0, gdim=dim)
    if isinstance(found, tuple):
        return found[:3]
    return found.mesh, found.cell_tags, found.facet_tags


def transfer_tags(
    mesh: _mesh.Mesh,
    dim: int,
    entities: npt.NDArray[np.int64],
    values: npt.NDArray[np.int32],
) -> Any:
    """Mesh tags from entities that any ranks give. Collective.

    Args:
        dim: dimension of the entities
        entities: their geometry nodes in the numbering of the input of the mesh; (n, nodes)
        values: tags; (n,)
    """
    entities = np.ascontiguousarray(entities, dtype=np.int64)
    values = np.ascontiguousarray(values, dtype=np.int32)
    if _OLD:
        vertices, found = _cpp.io.distribute_entity_data(cpp_object(mesh), dim, entities, values)
    else:
        vertices, found = io.distribute_entity_data(mesh, dim, entities, values)
    mesh.topology.create_entities(dim)
    mesh.topology.create_connectivity(dim, 0)
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    make = graph.create_adjacencylist if _OLD else graph.adjacencylist
    tags = _mesh.meshtags_from_entities(mesh, dim, make(vertices), found)
    # several ranks may have given the same entity
    indices, first = np.unique(np.asarray(tags.indices), return_index=True)
    return _mesh.meshtags(mesh, dim, indices, np.asarray(tags.values)[first])


def global_facets(mesh: _mesh.Mesh) -> npt.NDArray[np.int64]:
    """Global numbers of the facets of each owned cell; shape (cells, facets). Collective."""
    tdim = mesh.topology.dim
    mesh.topology.create_entities(tdim - 1)
    links, offsets = _connectivity(mesh, tdim, tdim - 1)
    numbers = global_indices(mesh.topology.index_map(tdim - 1))[links]
    owned = mesh.topology.index_map(tdim).size_local
    per_cell = offsets[1] - offsets[0] if len(offsets) > 1 else 1
    return numbers.reshape(-1, per_cell)[:owned]


def create_facet_mesh(
    comm: MPI.Comm,
    cells: npt.NDArray[np.int64],
    points: npt.NDArray[np.float64],
    shape: str,
    degree: int,
    gdim: int,
) -> tuple[_mesh.Mesh, npt.NDArray[np.int64]]:
    """A mesh of codimension 1 whose cells stay on the rank that gives them. Collective.

    DOLFINx's own ``create_submesh`` is not used: in 0.5.2 it leaves degrees of freedom on ranks
    without a cell, and straightens a geometry of degree 2.

    Args:
        cells: facets of this rank in global node numbers; shape (facets, nodes)
        points: owned nodes of this rank; shape (points, gdim) or wider
        shape: "interval", "triangle" or "quadrilateral"
        degree: of the geometry

    Returns:
        the mesh, and for each of its local cells the row of ``cells`` it was made from
    """
    ranks = np.full(len(cells), comm.rank, dtype=np.int32)
    mesh = create_mesh(comm, cells, points[:, :gdim], shape, degree, ranks)
    first = comm.scan(len(cells)) - len(cells)
    return mesh, original_cells(mesh) - first


# -- function spaces and functions -----------------------------------------------------------


def function_space(mesh: _mesh.Mesh, element: tuple[str, int], dim: int | None = None) -> Any:
    """A DOLFINx space of scalars or of vectors, under one name in all versions. Collective.

    Args:
        mesh: a DOLFINx mesh
        element: family and degree, ("Lagrange", 2) or ("DG", 0)
        dim: number of components of a vector; None for scalars
    """
    if not _OLD:
        return fem.functionspace(mesh, element if dim is None else (*element, (dim,)))
    if dim is None:
        return fem.FunctionSpace(mesh, element)
    return fem.VectorFunctionSpace(mesh, element, dim=dim)


def vector_space(mesh: _mesh.Mesh, degree: int) -> Any:
    """The DOLFINx space of displacements: continuous Lagrange vectors of the mesh's dimension.

    Collective. The same as ``fem.VectorFunctionSpace(mesh, ("Lagrange", degree))`` in DOLFINx 0.5 and
    ``fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))`` from 0.8 on.

    Args:
        mesh: a DOLFINx mesh
        degree: 1 or 2 where surfaces may touch
    """
    return function_space(mesh, ("Lagrange", degree), mesh.geometry.dim)


def lagrange_degree(V: Any) -> int | None:
    """Degree of a continuous Lagrange space, scalar or blocked; None for any other space."""
    element = _scalar_element(V)
    if is_quadrature(V):
        return None
    if hasattr(element, "basix_element"):
        element = element.basix_element
        name = str(element.family).split(".")[-1]
        return element.degree if name == "P" and not element.discontinuous else None
    if not hasattr(element, "family") or element.family() not in ("Lagrange", "Q"):
        return None
    return element.degree()


def is_quadrature(V: Any) -> bool:
    """Whether a space, scalar or blocked, has values at quadrature points."""
    element = _scalar_element(V)
    if type(element).__name__ == "_QuadratureElement":
        return True
    return _OLD and element is not None and element.family() == "Quadrature"


def _scalar_element(V: Any) -> Any:
    """Element of a space's components; None if they have different ones."""
    element = V.ufl_element()
    subs = element.sub_elements
    subs = list(subs() if callable(subs) else subs)
    if any(sub != subs[0] for sub in subs[1:]):
        return None
    return subs[0] if subs else element


def value_shape(V: Any) -> tuple[int, ...]:
    """Shape of the values of a space: () for scalars, (n,) for vectors."""
    if hasattr(V, "value_shape"):
        return tuple(V.value_shape)
    return tuple(V.ufl_element().value_shape())


def collapse(V: Any) -> tuple[Any, npt.NDArray[np.int32]]:
    """A subspace as a space of its own, and the dofs that its own are in the parent. Collective."""
    part, dofs = V.collapse()
    # since 0.10 one array for each kind of cell
    return part, np.asarray(dofs[0] if len(dofs) and np.ndim(dofs[0]) else dofs, dtype=np.int32)


def dof_list(V: Any) -> npt.NDArray[np.int32]:
    """Local block dofs of each cell, ghosts included; shape (cells, dofs)."""
    dofs = V.dofmap.list
    return (
        _rows(dofs, V.dofmap.dof_layout.num_dofs) if hasattr(dofs, "offsets") else np.asarray(dofs)
    )


def petsc_vec(function: fem.Function) -> Any:
    """PETSc vector that shares the function's values (with ghosts)."""
    return function.vector if _OLD else function.x.petsc_vec


def scatter_reverse_add(vector: Any) -> None:
    """Add ghost values of a Function or of a DOLFINx vector to their owners. Collective."""
    (vector.x if hasattr(vector, "x") else vector).scatter_reverse(_ADD)


def from_owners(V: Any, numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Numbers of the local nodes of a space, those of ghosts from their owners. Collective."""
    f = fem.Function(V)
    f.x.array[:] = np.repeat(numbers, V.dofmap.index_map_bs)
    f.x.scatter_forward()
    return f.x.array[:: V.dofmap.index_map_bs].real.astype(np.int64)


def quadrature(
    shape: str, degree: int, lobatto: bool = False
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Points (points, dimension) and weights of a Gauss (or Gauss–Lobatto) rule by Basix."""
    cell = getattr(basix.CellType, shape)
    kind = basix.QuadratureType
    rule = kind.gll if lobatto else getattr(kind, "Default", None) or kind.default
    if _OLD:
        return basix.make_quadrature(rule, cell, degree)
    return basix.make_quadrature(cell, degree, rule=rule)


def quadrature_space(mesh: _mesh.Mesh, degree: int, shape: tuple[int, ...]) -> Any:
    """Space of values at the points of ``quadrature(cell, degree)``.

    Args:
        shape: (): scalars, (n,): vectors, (m, n): matrices
    """
    if not _OLD:
        import basix.ufl

        cell = mesh.topology.cell_name()
        element = basix.ufl.quadrature_element(
            cell, value_shape=shape, scheme="default", degree=degree
        )
        return fem.functionspace(mesh, element)
    kind = (ufl.FiniteElement, ufl.VectorElement, ufl.TensorElement)[len(shape)]
    size = ({}, {"dim": shape[0] if shape else 0}, {"shape": shape})[len(shape)]
    element = kind("Quadrature", mesh.ufl_cell(), degree, quad_scheme="default", **size)
    return fem.FunctionSpace(mesh, element)


def evaluate(
    expression: fem.Expression, mesh: _mesh.Mesh, cells: npt.NDArray[np.int32]
) -> npt.NDArray[np.float64]:
    """Values of a ``fem.Expression`` at its points in some cells.

    Args:
        expression: with the points it was made for
        mesh: a DOLFINx mesh
        cells: local numbers, shape (n,)

    Returns:
        shape (n, points, components)
    """
    values = expression.eval(cells) if _OLD else expression.eval(mesh, cells)
    points = expression.X() if callable(expression.X) else expression.X
    size = int(np.prod(expression.ufl_expression.ufl_shape))
    return np.asarray(values).reshape(len(cells), len(points), size)


# -- index maps -------------------------------------------------------------------------------


def global_indices(index_map: Any) -> npt.NDArray[np.int64]:
    """Global number of each local index, owned first, then ghosts."""
    owned = np.arange(*index_map.local_range, dtype=np.int64)
    return np.concatenate([owned, np.asarray(index_map.ghosts, dtype=np.int64)])


# -- forms ------------------------------------------------------------------------------------


def form(ufl_form: Any) -> Any:
    """Compile a UFL form (or a list of forms) with default options. Collective."""
    return fem.form(ufl_form)


def pattern(compiled: Any) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Sparsity of a bilinear form in blocks of dofs. Collective.

    Returns:
        offsets of the owned block rows, shape (rows + 1,), and the global block columns
    """
    sparsity = fem.create_sparsity_pattern(compiled)
    sparsity.assemble() if hasattr(sparsity, "assemble") else sparsity.finalize()
    entries = sparsity.graph
    columns, offsets = entries if isinstance(entries, tuple) else (entries.array, entries.offsets)
    # since 0.11 finalising puts the columns of other ranks into the second map
    columns_of = getattr(sparsity, "column_index_map", lambda: sparsity.index_map(1))
    local_to_global = global_indices(columns_of())
    rows = compiled.function_spaces[0].dofmap.index_map.size_local  # rows of ghosts follow in 0.5
    offsets = np.array(offsets[: rows + 1], dtype=np.int64)
    return offsets, local_to_global[np.asarray(columns)[: offsets[-1]]]


def assemble_matrix_unrolled(A: Any, compiled: Any, bcs: Sequence[Any] = ()) -> None:
    """Add a bilinear form to a PETSc matrix of block size 1 by its local numbers.

    Rows and columns of constrained dofs are left out, their diagonal is not set, and the matrix is
    not finalised. Constants and coefficients are packed anew, so that changed loads are seen.
    """
    conditions = [cpp_object(bc) for bc in bcs]
    _cpp.fem.petsc.assemble_matrix(A, cpp_object(compiled), *_packed(compiled), conditions, True)


def _packed(compiled: Any) -> tuple[Any, Any]:
    """Constants and coefficients of a form. (DOLFINx's Python does it by functions that hold each
    other in 0.11, and stay until Python's garbage is collected.)"""
    a = cpp_object(compiled)
    return _cpp.fem.pack_constants(a), _cpp.fem.pack_coefficients(a)


def assemble_vector_local(compiled: Any, work: fem.Function) -> npt.NDArray[np.float64]:
    """Assemble a linear form; owned, unrolled entries, the other ranks' shares added. Collective.

    Args:
        compiled: the form
        work: any Function of the test space. (A new vector each time is a new Python class in 0.5)
    """
    work.x.array[:] = 0.0
    fem.assemble_vector(work.x.array, compiled, *_packed(compiled))
    scatter_reverse_add(work)
    return _owned(work)


def _owned(f: fem.Function) -> npt.NDArray[np.float64]:
    """Copy of the values that this rank owns."""
    dofmap = f.function_space.dofmap
    return np.array(f.x.array[: dofmap.index_map.size_local * dofmap.index_map_bs])


def assemble_scalar(comm: MPI.Comm, compiled: Any) -> float:
    """Value of a functional over all ranks. Collective."""
    return comm.allreduce(fem.assemble_scalar(compiled))


def lifting(
    work: fem.Function,
    forms: Sequence[Any],
    bcs: Sequence[Sequence[Any]],
    x0: Sequence[npt.NDArray[np.float64]],
) -> npt.NDArray[np.float64]:
    """Σ_j J_j (g_j − x0_j) for the Dirichlet values g_j; owned entries. Collective.

    Args:
        work: any Function of the test space
        forms: J_j, one for each unknown
        bcs: conditions on each unknown
        x0: local values of each unknown
    """
    work.x.array[:] = 0.0
    conditions = [list(b) for b in bcs]
    packed = [_packed(a) for a in forms]
    constants, coefficients = [c for c, _ in packed], [c for _, c in packed]
    fem.apply_lifting(
        work.x.array, list(forms), conditions, list(x0), -1.0, constants, coefficients
    )
    scatter_reverse_add(work)
    return _owned(work)


# -- Dirichlet conditions --------------------------------------------------------------------


def contains(V: Any, bc: Any) -> bool:
    """Whether a Dirichlet condition holds on V or on one of its subspaces."""
    return bool(cpp_object(V).contains(cpp_object(bc.function_space)))


def bc_dofs(bc: Any) -> tuple[npt.NDArray[np.int32], int]:
    """Local unrolled dofs of a Dirichlet condition, owned ones first, and how many are owned."""
    dofs = np.sort(np.array(bc.dof_indices()[0], dtype=np.int32))
    # DOLFINx's own count takes ghosts for owned dofs where dofs come in blocks (seen in 0.5.2)
    V = bc.function_space
    dofmap = V.dofmap if hasattr(V, "dofmap") else V.dofmaps[0]
    owned = dofmap.index_map.size_local * dofmap.index_map_bs
    return dofs, int(np.searchsorted(dofs, owned))


def set_bc_array(values: npt.NDArray[np.float64], bcs: Sequence[Any]) -> None:
    """Impose Dirichlet values on the local values (ghosts included) of a Function."""
    if _OLD:
        fem.set_bc(values, list(bcs))
    else:
        for bc in bcs:
            bc.set(values)


def set_bc(u: fem.Function, bcs: Sequence[Any]) -> None:
    """Impose the Dirichlet values on a Function, ghosts included. Collective.

    Conditions on other spaces than that of ``u`` are skipped.
    """
    set_bc_array(u.x.array, [bc for bc in bcs if contains(u.function_space, bc)])
    u.x.scatter_forward()


# -- PETSc ------------------------------------------------------------------------------------


@contextmanager
def errors_of_callbacks() -> Iterator[None]:
    """What Python raises in PETSc's callbacks comes out as it is; petsc4py 3.22 and later wrap it."""
    raised = None
    try:
        yield
    except PETSc.Error as error:
        raised, error.__cause__ = error.__cause__, None
        if raised is None:
            raise
    if raised is not None:
        raise raised


# -- helpers ----------------------------------------------------------------------------------


def _rows(adjacency: Any, width: int) -> npt.NDArray[np.int32]:
    """An adjacency list whose rows have equal length, as a 2D array (also without rows)."""
    return np.asarray(adjacency.array).reshape(-1, width)


def _connectivity(
    mesh: _mesh.Mesh, d0: int, d1: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    mesh.topology.create_connectivity(d0, d1)
    links = mesh.topology.connectivity(d0, d1)
    return np.asarray(links.array), np.asarray(links.offsets)


def _partitioner(ranks: npt.NDArray[np.int32], offsets: npt.NDArray[np.int32]) -> Any:
    """A cell partitioner that sends the given cells to given ranks, the owner first."""
    make = graph.create_adjacencylist if _OLD else graph.adjacencylist

    def destinations(*_: Any) -> Any:
        return cpp_object(make(ranks, offsets))

    return destinations


def _with_ghosts(
    comm: MPI.Comm, entities: npt.NDArray[np.int64], ranks: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """For each cell its owner, then all other ranks with a cell that has an entity in common.

    The rank with number entity mod size collects who has the entity, and answers. Collective.

    Args:
        entities: global numbers of each cell's vertices or facets; shape (cells, entities)
        ranks: owners; shape (cells,)

    Returns:
        ranks, and offsets of each cell's row among them; shape (cells + 1,)
    """
    n, width = entities.shape
    pairs = np.stack([entities.ravel(), np.repeat(ranks, width).astype(np.int64)], axis=1)
    pairs = np.unique(pairs, axis=0)
    asked = comm.alltoall([pairs[pairs[:, 0] % comm.size == p] for p in range(comm.size)])
    known = np.unique(np.concatenate(asked), axis=0)
    numbers, counts = np.unique(known[:, 0], return_counts=True)
    several = known[np.isin(known[:, 0], numbers[counts > 1])]
    answers = comm.alltoall([several[np.isin(several[:, 0], a[:, 0])] for a in asked])
    sharing = np.unique(np.concatenate(answers), axis=0)

    # join of (cell, entity) and (entity, rank)
    first, last = (
        np.searchsorted(sharing[:, 0], entities.ravel(), side) for side in ("left", "right")
    )
    hits = last - first
    cells = np.repeat(np.repeat(np.arange(n), width), hits)
    place = np.arange(len(cells)) - np.repeat(np.cumsum(hits) - hits, hits)
    other = sharing[np.repeat(first, hits) + place, 1]
    ghost = other != ranks[cells]
    cell_rank = np.unique(np.stack([cells[ghost], other[ghost]], axis=1), axis=0)

    # the owner first
    rows = np.concatenate([np.arange(n), cell_rank[:, 0]])
    order = np.argsort(rows, kind="stable")
    flat = np.concatenate([ranks, cell_rank[:, 1].astype(np.int32)])[order]
    offsets = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))])
    return flat.astype(np.int32), offsets.astype(np.int32)
