// SPDX-License-Identifier: MIT
#pragma once

#include "../geometry/surface.h"

#include <cstdint>
#include <mpi.h>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// The facets of this rank and their one-ring: all facets that share a vertex with one of them.
///
/// An interpolated normal (F8) depends on all facets around a vertex, and an edge is a physical end
/// only if no facet of any rank continues behind it; both are local questions once the ring is
/// here. Ghost cells are not asked for it: DOLFINx need not have any.
///
/// Collective. Ranks that share a vertex find each other through a "post office", the rank with
/// number vertex mod communicator size; no rank ever sees the whole surface.
///
/// @param own this rank's facets (maybe none); each facet of the surface is on exactly one rank.
///   `dim` and `ref` are the same on all ranks. `ends`, `candidate` and what `number_nodes` derives
///   are not read
/// @return the facets of `own` in their order (candidate = 1), then those of other ranks that share
///   a vertex with them (candidate = 0), ordered by owner. `ends` is exact for all of them.
///   `number_nodes` has been called
/// @throws std::invalid_argument on all ranks if a table has a wrong size on one of them
Surface with_ring(MPI_Comm comm, const Surface& own);

/// The facets that may be a target of this rank's slave facets, and their one-rings.
///
/// A facet may be a target if its current box is within the reach of a slave box. Its whole ring
/// comes along, so that its interpolated normals can be computed here. The result depends on this
/// rank's slave boxes only, not on who owns which facet.
///
/// Collective, and every rank talks only to those whose facets lie near its own slave facets.
///
/// @param ringed the master surface by `with_ring`, in its current position
/// @param num_own its first `num_own` facets are this rank's own
/// @param slave_boxes current boxes of this rank's own slave facets, (n, 2, dim), lower then upper
///   corner, as from `Surface::boxes`
/// @param reach how far away from each box a target may be, (n); infinite: anywhere
/// @return the facets that may be a target (candidate = 1) and those that are only in the ring of
///   one (candidate = 0), once each, sorted by `id`. `number_nodes` has been called, thus x = X
/// @throws std::invalid_argument on all ranks if an argument is wrong on one of them
Surface with_targets(MPI_Comm comm, const Surface& ringed, int num_own,
                     std::span<const double> slave_boxes, std::span<const double> reach);

/// Distance of each slave box from the nearest box of a master facet, infinite if there is none
/// within its reach. Collective; arguments as for `with_targets`.
std::vector<double> distances(MPI_Comm comm, const Surface& ringed, int num_own,
                              std::span<const double> slave_boxes, std::span<const double> reach);

/// Bytes that this rank has received from others by `with_ring`, `with_targets` and `distances`
/// since the program began, those of collective calls included.
std::int64_t bytes_received();

} // namespace dolfinx_contact
