# SPDX-License-Identifier: MIT
"""A partition that knows of contact: every rank gets its share of cells and of slave facets.

DOLFINx's partition balances cells. All slave facets may then sit on a few ranks, which do all contact
work while the others wait. Here the ranks are cut apart by recursive bisection: at each cut the cells
of the contact surfaces are split by a plane that halves the slave facets, all other cells by a
parallel plane that halves the cells. A slave facet and the master facets that it faces are on the
same side, so that most contact blocks are assembled where their rows live.
"""

from __future__ import annotations

from typing import Any, Iterable, Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from . import compat
from .errors import InputError, together
from .surface import check_available, check_tags, facet_closure

_TILT = np.array(
    [1.0, np.sqrt(2) * 1e-5, np.sqrt(3) * 1e-7]
)  # planes meet no two points of a grid
_HALVINGS = 60  # of the interval in which a plane is sought


def repartition(
    mesh: Any | Sequence[Any],
    facet_tags: Any | Sequence[Any],
    slave: int | Iterable[int],
    master: int | Iterable[int] = (),
    cell_tags: Any | None = None,
) -> tuple[Any, ...]:
    """The same mesh on another partition, which balances cells and slave facets. Collective.

    Geometry (of degree 1 or 2), cells and tags stay as they are; their local numbers do not. Make
    function spaces on the new mesh. Ghost cells are those of DOLFINx's default, shared facets.

    Args:
        mesh: a DOLFINx mesh; or two, the slave's body and the master's, which are cut by the same
            planes
        facet_tags: MeshTags of its facets; of two meshes a sequence of two
        slave: tag or tags of the slave's facets, of all pairs
        master: tag or tags of the master's facets; none for a rigid tool
        cell_tags: MeshTags of its cells; of two meshes a sequence of two, or None for one of them

    Returns:
        the new mesh and its facet tags, and its cell tags where ``cell_tags`` were given; of two
        meshes sequences of two in place of each

    Raises:
        InputError: on all ranks, for tags of another dimension or mesh, and for unknown tags
    """
    several = isinstance(mesh, (list, tuple))
    if several != isinstance(facet_tags, (list, tuple)) or not all(
        hasattr(m, "topology") for m in (mesh if several else [mesh])
    ):
        raise InputError(
            f"repartition: mesh is a {type(mesh).__name__} and facet_tags a {type(facet_tags).__name__};"
            " give a mesh and its tags, or a list of two and a list of their tags."
        )
    meshes = list(mesh) if several else [mesh]
    tags = list(facet_tags) if several else [facet_tags]
    of_cells = list(cell_tags) if several and cell_tags is not None else [cell_tags] * len(meshes)
    if not 1 <= len(meshes) <= 2 or len(tags) != len(meshes) or len(of_cells) != len(meshes):
        raise InputError(
            f"repartition: {len(meshes)} meshes, {len(tags)} facet_tags and {len(of_cells)}"
            " cell_tags; give one mesh, or two (the slave's and the master's) with tags of each."
        )
    comm = meshes[0].comm
    none = isinstance(master, (tuple, list)) and len(master) == 0
    with together(comm, "repartition"):
        slaves = check_tags(tags[0], slave, meshes[0])
        masters = [] if none else check_tags(tags[-1], master, meshes[-1])
    check_available(comm, tags[0], slaves)
    check_available(comm, tags[-1], masters)

    midpoints, facets, opposite = [], [], []
    for i, (m, t) in enumerate(zip(meshes, tags)):
        x = np.asarray(m.geometry.x)[compat.cell_geometry_dofs(m)[: _owned(m)]].mean(axis=1)
        midpoints.append(x[:, : m.geometry.dim])
        facets.append(_facets_of_cells(m, t, slaves if i == 0 else []))
        opposite.append(_facets_of_cells(m, t, masters if i == len(meshes) - 1 else []) > 0)
    parts = bisect(comm, *(np.concatenate(a) for a in (midpoints, facets, opposite)))
    ranks = np.split(parts, np.cumsum([len(x) for x in midpoints])[:-1])

    made = [_moved(*arguments) for arguments in zip(meshes, ranks, tags, of_cells)]
    columns = list(zip(*made)) if cell_tags is not None else list(zip(*made))[:2]
    return tuple(columns) if several else tuple(column[0] for column in columns)


def bisect(
    comm: MPI.Comm,
    x: npt.NDArray[np.float64],
    slave: npt.NDArray[np.int64],
    master: npt.NDArray[np.bool_],
) -> npt.NDArray[np.int32]:
    """A rank for each cell, by recursive bisection. Collective; cells stay where they are.

    Args:
        x: midpoints of this rank's cells; (cells, dim)
        slave: number of slave facets of each; (cells,)
        master: whether it has a master facet; (cells,)

    Returns:
        ranks from 0 to the size of the communicator; (cells,)
    """
    first = np.zeros(len(x), dtype=np.int32)  # the cell is for one of the ranks from `first` ...
    count = np.full(len(x), comm.size, dtype=np.int32)  # ... to first + count
    while (group_size := comm.allreduce(int(count.max(initial=1)), op=MPI.MAX)) > 1:
        assert group_size <= comm.size
        divided = _cut(comm, x, slave, master, first, count)
        low = count // 2
        first, count = (
            np.where(divided, first, first + low).astype(np.int32),
            np.where(divided, np.maximum(low, 1), count - low).astype(np.int32),
        )
    return first


def _cut(
    comm: MPI.Comm,
    x: npt.NDArray[np.float64],
    slave: npt.NDArray[np.int64],
    master: npt.NDArray[np.bool_],
    first: npt.NDArray[np.int32],
    count: npt.NDArray[np.int32],
) -> npt.NDArray[np.bool_]:
    """Whether each cell is for the lower count // 2 of its group's ranks; all groups at once."""
    n = comm.size

    def sums(weights: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Σ of each group over all ranks; (groups, …), groups being named by their first rank."""
        out = np.zeros((n, *weights.shape[1:]))
        np.add.at(out, first, weights)
        comm.Allreduce(MPI.IN_PLACE, out)
        return out

    # how many of the group's ranks are below the cut; groups of one rank are not cut
    size = np.zeros(n, dtype=np.int64)
    np.maximum.at(size, first, count)
    comm.Allreduce(MPI.IN_PLACE, size, op=MPI.MAX)
    fraction = np.where(size > 1, (size // 2) / np.maximum(size, 1), 1.0)

    # facets may be fewer than ranks: then cells alone are balanced
    facets = slave.astype(np.float64)
    spread = np.where((sums(facets) >= size)[first], facets, 1.0)
    direction = _directions(sums, x, spread, first)
    key = np.einsum("ci,ci->c", x, direction[first])

    # near the slave facets a plane that divides them, elsewhere one that divides the cells
    reach = _slave_boxes(comm, x, slave > 0, first)
    inside = np.all((x >= reach[0][first]) & (x <= reach[1][first]), axis=1)
    bound = (slave > 0) | (master & inside)
    plane = _quantile(comm, key, facets, first, fraction * sums(facets), sums)
    below = key <= plane[first]
    rest = np.where(bound, 0.0, 1.0)
    wanted = fraction * sums(np.ones(len(x))) - sums(np.where(bound & below, 1.0, 0.0))
    plane = _quantile(comm, key, rest, first, wanted, sums)
    return np.where(bound, below, key <= plane[first]) | (size[first] <= 1)


def _directions(
    sums: Any,
    x: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    first: npt.NDArray[np.int32],
) -> npt.NDArray[np.float64]:
    """Normal of each group's planes: an axis of the coordinates, or the principal axis of the
    weights where they extend clearly more along that; (groups, dim)."""
    dim = x.shape[1]
    total = np.maximum(sums(weights), 1e-300)
    mean = sums(weights[:, None] * x) / total[:, None]
    r = x - mean[first]
    moments = sums(weights[:, None, None] * r[:, :, None] * r[:, None, :]) / total[:, None, None]
    values, vectors = np.linalg.eigh(moments)
    out = np.zeros((len(mean), dim))
    for g, (variance, axes) in enumerate(zip(values, vectors)):
        along = np.diag(moments[g])
        main = np.eye(dim)[np.argmax(along)]
        if along.max() < 0.8 * variance[-1]:
            main = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
        # a tiny tilt: cells of a grid are not all cut at once
        k = int(np.argmax(np.abs(main)))
        others = [np.eye(dim)[(k + 1 + i) % dim] for i in range(dim - 1)]
        out[g] = _TILT[:dim] @ np.array([main, *others])
    return out


def _slave_boxes(
    comm: MPI.Comm,
    x: npt.NDArray[np.float64],
    on_slave: npt.NDArray[np.bool_],
    first: npt.NDArray[np.int32],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Box of each group's slave cells, wider by a tenth of its diagonal; lower, upper (groups, dim)."""
    lower = np.full((comm.size, x.shape[1]), np.inf)
    upper = -lower
    np.minimum.at(lower, first[on_slave], x[on_slave])
    np.maximum.at(upper, first[on_slave], x[on_slave])
    comm.Allreduce(MPI.IN_PLACE, lower, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, upper, op=MPI.MAX)
    some = np.isfinite(lower)
    wider = 0.1 * np.linalg.norm(np.where(some, upper - lower, 0.0), axis=1, keepdims=True)
    return lower - wider, upper + wider


def _quantile(
    comm: MPI.Comm,
    key: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    first: npt.NDArray[np.int32],
    wanted: npt.NDArray[np.float64],
    sums: Any,
) -> npt.NDArray[np.float64]:
    """For each group the key up to which the weights amount to about ``wanted``; (groups,).

    Bisection of the keys' interval; no rank sees another's keys.
    """
    low = np.full(comm.size, np.inf)
    high = -low
    np.minimum.at(low, first, key)
    np.maximum.at(high, first, key)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    some = np.isfinite(low)
    low, high = np.where(some, low, 0.0), np.where(some, high, 0.0)
    low = low - 1e-9 * (high - low)  # nothing is below it
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        # half of the last weight may be too much
        enough = sums(np.where(key <= middle[first], weights, 0.0)) >= wanted - 0.5
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    # all or nothing where that is wanted
    return np.where(wanted <= 0.5, np.where(wanted > 0, high, -np.inf), high)


def _owned(mesh: Any) -> int:
    return mesh.topology.index_map(mesh.topology.dim).size_local


def _facets_of_cells(mesh: Any, tags: Any, wanted: list[int]) -> npt.NDArray[np.int64]:
    """Number of facets with the wanted tags of each owned cell; (cells,)."""
    chosen = np.isin(np.asarray(tags.values), wanted)
    facets = np.unique(np.asarray(tags.indices)[chosen]).astype(np.int32)
    cells = compat.facet_cells(mesh, facets)[0]
    return np.bincount(cells[cells < _owned(mesh)], minlength=_owned(mesh))


def _moved(
    mesh: Any, ranks: npt.NDArray[np.int32], facet_tags: Any, cell_tags: Any | None
) -> tuple[Any, Any, Any]:
    """The mesh and its tags with each owned cell on the given rank."""
    geometry, comm = mesh.geometry, mesh.comm
    cell, degree = mesh.topology.cell_name(), compat.coordinate_degree(mesh)
    nodes = compat.global_indices(geometry.index_map())[compat.cell_geometry_dofs(mesh)]
    owned_nodes = np.asarray(geometry.x)[: geometry.index_map().size_local, : geometry.dim]
    facets = compat.global_facets(mesh)
    new = compat.create_mesh(comm, nodes[: _owned(mesh)], owned_nodes, cell, degree, ranks, facets)

    tdim = mesh.topology.dim
    tagged = np.asarray(facet_tags.indices, dtype=np.int32)
    cells = compat.facet_cells(mesh, tagged)[0]
    local = compat.local_facet_indices(mesh, cells, tagged)
    corners = nodes[cells[:, None], facet_closure(cell, degree)[local]]
    new_facet_tags = compat.transfer_tags(new, tdim - 1, corners, facet_tags.values)
    new_cell_tags = None
    if cell_tags is not None:
        corners = nodes[np.asarray(cell_tags.indices)]
        new_cell_tags = compat.transfer_tags(new, tdim, corners, cell_tags.values)
    return new, new_facet_tags, new_cell_tags
