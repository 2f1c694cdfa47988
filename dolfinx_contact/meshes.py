# SPDX-License-Identifier: MIT
"""Meshes by gmsh; and of mapped grids, for demos and tests: several bodies in one DOLFINx mesh.

>>> upper = grid((8, 4), lower=(0, 1), upper=(2, 2))
>>> lower = grid((9, 4), upper=(2, 1))
>>> mesh, body = create(MPI.COMM_WORLD, [lower, upper])
>>> tags = tag_facets(mesh, {1: (lambda x: np.isclose(x[1], 1), 0)}, body)
"""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Sequence

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import mesh as _mesh
from mpi4py import MPI

from . import compat
from .checks import file_name, numbers, whole
from .errors import InputError, together
from .gmsh_file import gmsh_model

_DIMENSIONS = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}

Predicate = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]
Partition = Any  # array of ranks, or callable (midpoints, number of ranks) -> ranks


@dataclass
class Body:
    """A mesh of one body on one rank, before it is a DOLFINx mesh.

    Attributes:
        points: (points, dim) [length]
        cells: numbers of their nodes in Basix's Lagrange order, (cells, nodes)
        cell: shape of the cells: "triangle", "quadrilateral", "tetrahedron" or "hexahedron"
        degree: of the geometry, 1 or 2
    """

    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    cell: str
    degree: int


def grid(
    counts: Sequence[int],
    lower: Sequence[float] | None = None,
    upper: Sequence[float] | None = None,
    mapping: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]] | None = None,
    cell: str = "quadrilateral",
    degree: int = 1,
) -> Body:
    """A grid of a box, mapped to any shape.

    Args:
        counts: number of boxes in each direction; a box is one quadrilateral or hexahedron, two
            triangles or six tetrahedra (Kuhn's subdivision)
        lower, upper: opposite corners of the box [length]; by default the unit square or cube
        mapping: takes points (n, dim) of the box to points (n, dim) of the body; mid-side nodes are
            mapped too, so that cells of degree 2 are curved
        cell: shape of the cells
        degree: of the geometry, 1 or 2

    Raises:
        InputError: unknown cell or degree, counts that do not fit
    """
    if cell not in list(_DIMENSIONS) or degree not in (1, 2):
        raise InputError(
            f"grid: {cell!r} of degree {degree!r}; give one of {', '.join(_DIMENSIONS)}, degree 1 or 2."
        )
    dim, given = _DIMENSIONS[cell], numbers(counts)
    if given.shape != (dim,) or not np.all(given >= 1) or np.any(given != np.floor(given)):
        raise InputError(f"grid: counts is {counts!r}; give {dim} integers of at least 1.")
    counts = given.astype(np.int64)

    # lattice of all nodes, the first direction runs fastest
    size = degree * counts + 1
    strides = np.concatenate([[1], np.cumprod(size[:-1])])
    lattice = _lattice(size)
    low = np.zeros(dim) if lower is None else numbers(lower)
    high = np.ones(dim) if upper is None else numbers(upper)
    if low.shape != (dim,) or high.shape != (dim,) or not np.all((low < high) & (high < np.inf)):
        raise InputError(
            f"grid: lower is {lower!r} and upper {upper!r}; give two corners of {dim} finite numbers,"
            " each of lower's below that of upper."
        )
    points = low + (high - low) * (lattice / (degree * counts))
    if mapping is not None:
        points = _mapped(mapping, points)

    # nodes of the cells of one box, in lattice steps from the box's first node
    nodes = np.array(basix.create_element(basix.ElementFamily.P, _type(cell), degree).points)
    steps = np.concatenate([_affine(nodes, corners) for corners in _split(cell, dim)])
    steps = np.rint(steps * degree).astype(np.int64)
    boxes = _lattice(counts) * degree
    cells = (boxes[:, None, :] + steps[None, :, :]) @ strides
    return Body(points, cells.reshape(-1, len(nodes)), cell, degree)


def create(
    comm: MPI.Comm, bodies: Body | Sequence[Body] | None, partition: Partition | None = None
) -> tuple[_mesh.Mesh, npt.NDArray[np.int32]]:
    """One DOLFINx mesh of several bodies that share no nodes. Collective.

    Args:
        comm: communicator of the mesh
        bodies: bodies with the same cell and degree; those of rank 0 count, other ranks may give None
        partition: None for DOLFINx's partition; an array with the rank of each cell (all bodies one
            after the other), or a function of the cells' mean points (cells, dim) and the number of
            ranks that returns it; read on rank 0, and no ghost cells are made then

    Returns:
        the mesh, and the number of the body of each local cell, ghosts included

    Raises:
        InputError: bodies of different kinds, or ranks that do not exist
    """
    meta: tuple[Any, ...] | None = None
    with together(comm, "meshes.create"):
        if comm.rank == 0:
            bodies = [bodies] if isinstance(bodies, Body) else bodies
            kinds = _kinds(bodies)
            shifts = np.cumsum([0] + [len(body.points) for body in bodies])
            points = np.concatenate([body.points for body in bodies])
            cells = np.concatenate([b.cells + shift for b, shift in zip(bodies, shifts)])
            ends = np.cumsum([len(body.cells) for body in bodies])
            ranks = _ranks(partition, points, cells, comm.size)
            free = ranks is None
            meta = (*kinds.pop(), cells.shape[1], points.shape[1], ends, free)
    cell, degree, width, dim, ends, free = comm.bcast(meta, root=0)
    if comm.rank != 0:
        points, cells = np.zeros((0, dim)), np.zeros((0, width), dtype=np.int64)
        ranks = None if free else np.zeros(0, dtype=np.int32)
    mesh = compat.create_mesh(comm, cells, points, cell, degree, ranks)
    body = np.searchsorted(ends, compat.original_cells(mesh), side="right")
    return mesh, body.astype(np.int32)


def read_msh(
    comm: MPI.Comm,
    file: str | Path,
    dim: int,
    cells: dict[int, str] | None = None,
    facets: dict[int, str] | None = None,
) -> tuple[Any, Any, Any]:
    """A mesh by gmsh, with the tags of its physical groups. Collective; rank 0 reads.

    The same for all versions of DOLFINx, whose function of this kind goes by several names, and
    fails in 0.5.2. What is in no physical group is not read.

    Args:
        comm: of the mesh
        file: a .msh file
        dim: of the space
        cells, facets: groups that must be there, by their tags, and what each is, for the message
            if one is not; rank 0's count

    Returns:
        mesh, tags of cells, tags of facets

    Raises:
        InputError: on all ranks, without such a file or groups, or if gmsh or DOLFINx cannot read it
    """
    with contextlib.ExitStack() as stack:
        model = None
        with together(comm, "meshes.read_msh"):
            if comm.rank == 0:
                path = file_name("meshes.read_msh", file)
                whole("meshes.read_msh", "dim", dim, 2, 3)
                wanted = {dim: _wanted("cells", cells), dim - 1: _wanted("facets", facets)}
                model = stack.enter_context(gmsh_model(path, "meshes.read_msh"))
                if not np.isfinite(model.mesh.getNodes()[1]).all():
                    raise InputError("it has nodes that are not finite; make the mesh anew")
                if not model.getPhysicalGroups(dim):
                    raise InputError(
                        f"it has no physical groups of dimension {dim}; give one to each body, and"
                        " to the boundaries you need"
                    )
                _check_groups(model, wanted)
        return compat.gmsh_to_mesh(model, comm, dim)


def tag_facets(
    mesh: _mesh.Mesh,
    predicates: dict[int, Predicate | tuple[Predicate, int]],
    body: npt.NDArray[np.int32] | None = None,
) -> Any:
    """Tag exterior facets by position. Collective.

    Args:
        mesh: the mesh
        predicates: for each tag a function of points (3, n) that is true at all vertices of the
            facets to tag, or a pair of it and the number of a body; later tags overwrite earlier
        body: body of each local cell, as ``create`` returns it; needed where a pair is given

    Raises:
        InputError: no dictionary of tags and functions, functions that do not return a truth value for
            each point, a pair without ``body``
    """
    with together(mesh.comm, "tag_facets"):
        _check_predicates(predicates)
    fdim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(fdim, fdim + 1)
    tagged: dict[int, int] = {}
    for tag, chosen in predicates.items():
        predicate, number = chosen if isinstance(chosen, tuple) else (chosen, None)
        facets = _located(mesh, fdim, predicate, tag)
        if number is not None:
            if body is None:
                raise InputError(f"tag_facets: tag {tag} names body {number}; give body as well.")
            facets = facets[body[compat.facet_cells(mesh, facets)[0]] == number]
        tagged.update(dict.fromkeys(facets.tolist(), tag))
    indices = np.array(sorted(tagged), dtype=np.int32)
    values = np.array([tagged[facet] for facet in indices.tolist()], dtype=np.int32)
    return _mesh.meshtags(mesh, fdim, indices, values)


# -- helpers ----------------------------------------------------------------------------------


def _wanted(name: str, groups: Any) -> dict[int, str]:
    """Groups that the user wants, checked."""
    fits = groups is None or isinstance(groups, dict)
    for tag in groups or () if fits else ():
        fits = fits and isinstance(tag, (int, np.integer)) and not isinstance(tag, bool)
    if not fits:
        raise InputError(
            f"meshes.read_msh: {name} is {groups!r}; give a dictionary from tags, integers, to what"
            " the physical groups are."
        )
    return groups or {}


def _check_groups(model: Any, wanted: dict[int, dict[int, str]]) -> None:
    """Refuse a model of gmsh's that lacks physical groups; ``wanted``: their meaning by dimension
    and tag."""
    missing, there = [], []
    for dim, groups in wanted.items():
        kind = {1: "physical curve", 2: "physical surface", 3: "physical volume"}[dim]
        tags = [tag for _, tag in model.getPhysicalGroups(dim)]
        tags = [tag for tag in tags if len(model.mesh.getNodesForPhysicalGroup(dim, tag)[0])]
        names = [model.getPhysicalName(dim, tag) for tag in tags]
        found = [f"{tag} {name!r}" if name else str(tag) for tag, name in zip(tags, names)]
        there.append(f"{kind}s {', '.join(found) or 'none'}")
        missing += [f"no {kind} {tag} ({groups[tag]})" for tag in groups if tag not in tags]
    if missing:
        raise InputError(
            f"it has {', '.join(missing)}; found: {'; '.join(there)}. Give each group that is wanted"
            " its tag, and a mesh"
        )


def _mapped(mapping: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points where a mapping has taken them."""
    returned = mapping(points) if callable(mapping) else mapping
    moved = numbers(returned)
    if moved.shape != points.shape or not np.isfinite(moved).all():
        raise InputError(
            f"grid: the mapping is or returns a {type(returned).__name__} of shape {np.shape(returned)};"
            f" give a function that takes points {points.shape} to as many finite points."
        )
    return moved


def _kinds(bodies: Any) -> set[tuple[str, int]]:
    """Cell and degree of bodies, after checks."""
    listed = isinstance(bodies, (list, tuple)) and len(bodies) > 0
    if not listed or not all(isinstance(body, Body) for body in bodies):
        raise InputError(
            f"create: bodies is {bodies!r}; give a Body, or a list of them (see grid)."
        )
    for i, body in enumerate(bodies):
        fits = body.cell in list(_DIMENSIONS) and body.degree in (1, 2)
        if fits:
            points, cells = numbers(body.points), np.asarray(body.cells)
            element = basix.create_element(basix.ElementFamily.P, _type(body.cell), body.degree)
            fits = points.ndim == 2 and points.shape[1] == _DIMENSIONS[body.cell]
            fits = fits and bool(np.isfinite(points).all()) and cells.dtype.kind in "iu"
            fits = fits and cells.ndim == 2 and cells.shape[1] == element.dim and len(cells) > 0
            fits = fits and cells.min() >= 0 and cells.max() < len(points)
        if not fits:
            raise InputError(
                f"create: body {i} of {body.cell!r} and degree {body.degree!r} does not hang together;"
                f" give finite points, and at least one cell whose nodes are among them (cells of"
                f" {', '.join(_DIMENSIONS)}, degree 1 or 2)."
            )
    kinds = {(body.cell, body.degree) for body in bodies}
    if len(kinds) != 1:
        raise InputError(f"create: the bodies are {sorted(kinds)}; give bodies of one kind.")
    return kinds


def _check_predicates(predicates: Any) -> None:
    fits = isinstance(predicates, dict)
    for tag, chosen in predicates.items() if fits else ():
        predicate = chosen[0] if isinstance(chosen, tuple) and len(chosen) == 2 else chosen
        fits = fits and callable(predicate)
        fits = fits and isinstance(tag, (int, np.integer)) and -(2**31) <= tag < 2**31
    if not fits:
        raise InputError(
            f"tag_facets: predicates is {predicates!r}; give a dictionary from tags, integers of 32 bits, to"
            " functions of points, or pairs of these and the number of a body."
        )


def _located(mesh: Any, fdim: int, predicate: Predicate, tag: int) -> npt.NDArray[np.int32]:
    """Exterior facets at whose vertices a predicate is true."""
    wrong: list[Any] = []

    def marked(x: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        found = predicate(x)
        array = np.asarray(found)
        if array.shape == x.shape[1:] and array.dtype.kind == "b":
            return array
        wrong.append(found)
        return np.zeros(x.shape[1], dtype=bool)

    facets = np.asarray(_mesh.locate_entities_boundary(mesh, fdim, marked), dtype=np.int32)
    with together(mesh.comm, "tag_facets"):
        if wrong:
            raise InputError(
                f"tag_facets: the function of tag {tag} returned {wrong[0]!r:.80}; give one that returns"
                " a truth value for each point."
            )
    return facets


def _type(cell: str) -> Any:
    return getattr(basix.CellType, cell)


def _lattice(size: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """All integer points below ``size``, the first coordinate fastest; shape (points, dim)."""
    return np.stack(np.unravel_index(np.arange(np.prod(size)), size, order="F"), axis=1)


def _split(cell: str, dim: int) -> list[npt.NDArray[np.float64]]:
    """Corners of the cells of the unit box; each (corners, dim)."""
    if cell in ("quadrilateral", "hexahedron"):
        return [np.array(basix.geometry(_type(cell)))]
    # Kuhn: from the origin to the opposite corner along the axes, in every order
    walks = itertools.permutations(np.eye(dim))
    return [np.cumsum([np.zeros(dim), *walk], axis=0) for walk in walks]


def _affine(
    nodes: npt.NDArray[np.float64], corners: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Points of the reference cell in the box, for a cell that is an affine image."""
    if len(corners) != corners.shape[1] + 1:  # the box itself
        return nodes
    return corners[0] + nodes @ (corners[1:] - corners[0])


def _ranks(
    partition: Partition | None,
    points: npt.NDArray[np.float64],
    cells: npt.NDArray[np.int64],
    size: int,
) -> npt.NDArray[np.int32] | None:
    """The rank of each cell, checked."""
    if partition is None:
        return None
    given = partition(points[cells].mean(axis=1), size) if callable(partition) else partition
    found = numbers(given)
    if found.shape == (len(cells),) and np.all(found == np.floor(found)):
        ranks = found.astype(np.int32)
    else:
        ranks = np.full(1, -1, dtype=np.int32)
    if ranks.shape != (len(cells),) or ranks.min() < 0 or ranks.max() >= size:
        raise InputError(
            f"create: the partition has shape {found.shape} and ranks {np.unique(found).tolist()};"
            f" give each of the {len(cells)} cells a rank between 0 and {size - 1}."
        )
    return ranks
