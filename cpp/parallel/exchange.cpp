// SPDX-License-Identifier: MIT
#include "exchange.h"

#include "../targets/bounding_volumes.h"
#include "mail.h"
#include "parcels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace dolfinx_contact
{

namespace
{

/// What is wrong with the arguments of `with_targets` and `distances`; empty if nothing.
std::string error_of(const Surface& ringed, int num_own, std::span<const double> slave_boxes,
                     std::span<const double> reach)
{
  if (const std::string error = error_of(ringed); not error.empty())
    return error;
  if (ringed.ends.size() != ringed.id.size() or ringed.x.size() != ringed.X.size())
    return "with_targets needs a surface made by with_ring and placed by Surface.displace";
  if (num_own < 0 or num_own > ringed.size())
    return "num_own is " + std::to_string(num_own) + ", it must be between 0 and the number "
           + std::to_string(ringed.size()) + " of facets";
  if (slave_boxes.size() != 2 * ringed.dim * reach.size())
    return "slave_boxes has " + std::to_string(slave_boxes.size())
           + " numbers, it must have the shape (n, 2, " + std::to_string(ringed.dim)
           + ") with n = " + std::to_string(reach.size()) + ", the number of reaches";
  for (const double r : reach)
    if (not(r >= 0))
      return "a reach is " + std::to_string(r) + ", it must not be negative";
  return "";
}

/// Slave boxes with their reaches that have come from other ranks, and which of them went where.
template <int D>
struct Requests
{
  static constexpr int width = 2 * D + 1; // lower corner, upper corner, reach
  std::vector<std::vector<int>> sent;     // to each rank: positions among this rank's slave boxes
  Mail<double> received;

  Box<D> box(int k) const
  {
    Box<D> b;
    std::copy_n(&received.data[static_cast<std::size_t>(k) * width], D, b.lo.data());
    std::copy_n(&received.data[static_cast<std::size_t>(k) * width + D], D, b.hi.data());
    return b;
  }
  double reach(int k) const { return received.data[(static_cast<std::size_t>(k) + 1) * width - 1]; }
  int begin(int rank) const { return received.offset[rank] / width; }
};

/// Send slave boxes to the ranks whose master facets, or their ring, may be within reach.
/// Collective.
template <int D>
Requests<D> request(MPI_Comm comm, std::span<const double> master_boxes,
                    std::span<const double> slave_boxes, std::span<const double> reach)
{
  const int size = comm_size(comm);
  Box<D> mine;
  for (std::size_t f = 0; f < master_boxes.size() / (2 * D); ++f)
    mine.add(BoxTree<D>::item_box(master_boxes, static_cast<int>(f)));
  std::array<double, 2 * D> corners;
  Eigen::Map<Eigen::Array<double, 2 * D, 1>>(corners.data()) << mine.lo, mine.hi;
  std::vector<double> masters(corners.size() * size);
  MPI_Allgather(corners.data(), 2 * D, MPI_DOUBLE, masters.data(), 2 * D, MPI_DOUBLE, comm);
  bytes_in += sizeof(corners) * (size - 1);

  // Rounding is monotone: the distance from the box around facets is not larger than that from one
  // of them, so that this test does not refuse what the finer one would take
  Requests<D> out;
  out.sent.resize(size);
  std::vector<std::vector<double>> letters(size);
  for (int r = 0; r < size; ++r)
  {
    const Box<D> master = BoxTree<D>::item_box(masters, r);
    for (std::size_t i = 0; i < reach.size(); ++i)
      if (master.within(BoxTree<D>::item_box(slave_boxes, static_cast<int>(i)), reach[i]))
      {
        const auto box = slave_boxes.subspan(i * 2 * D, 2 * D);
        letters[r].insert(letters[r].end(), box.begin(), box.end());
        letters[r].push_back(reach[i]);
        out.sent[r].push_back(static_cast<int>(i));
      }
  }
  out.received = all_to_all(comm, letters);
  return out;
}

/// An own facet that a rank needs, and whether that rank's slave may find a target on it.
struct Chosen
{
  int facet;
  bool candidate;
};

/// For each rank the own facets that are within reach of its slave boxes, or in the ring of one
/// that is: so each facet comes from its owner only, and once. Collective.
template <int D>
std::vector<std::vector<Chosen>> select_targets(MPI_Comm comm, const Surface& ringed, int num_own,
                                                std::span<const double> slave_boxes,
                                                std::span<const double> reach)
{
  const int size = comm_size(comm);
  const std::vector<double> boxes = ringed.boxes();
  const Requests<D> requests = request<D>(comm, boxes, slave_boxes, reach);

  // Facets that share a vertex share its node: the displacement is continuous
  std::vector<std::uint8_t> near(ringed.size()), at_near(ringed.node_table.size());
  std::vector<double> grown;
  std::vector<std::vector<Chosen>> chosen(size);
  for (int r = 0; r < size; ++r)
  {
    const int begin = requests.begin(r), end = requests.begin(r + 1);
    if (begin == end)
      continue;
    grown.clear();
    for (int k = begin; k < end; ++k)
    {
      // a little more than the reach, since rounding must not refuse what is within it
      const double margin = std::min(requests.reach(k) * (1 + 1e-9), 1e100);
      const Box<D> box = requests.box(k);
      for (int i = 0; i < D; ++i)
        grown.push_back(box.lo[i] - margin);
      for (int i = 0; i < D; ++i)
        grown.push_back(box.hi[i] + margin);
    }
    const BoxTree<D> tree(grown);
    int last = 0; // a slave box that was near
    std::fill(at_near.begin(), at_near.end(), 0);
    const std::int32_t* node = ringed.local.data();
    for (int f = 0; f < ringed.size(); ++f, node += ringed.nu())
    {
      const Box<D> box = BoxTree<D>::item_box(boxes, f);
      auto within
          = [&](int i) { return box.within(requests.box(begin + i), requests.reach(begin + i)); };
      near[f] = within(last); // facets one after the other are often neighbours
      if (not near[f])
        tree.descend([&](const Box<D>& b, int) { return b.overlaps(box) ? 0.0 : INFINITY; },
                     [&](int i)
                     {
                       if (near[f] = near[f] or within(i); near[f])
                         last = i;
                       return near[f] ? -1.0 : 0.0; // −1: nothing improves on it, stop
                     },
                     0.0);
      if (near[f])
        std::for_each(node, node + ringed.nu(), [&](int a) { at_near[a] = true; });
    }
    node = ringed.local.data();
    for (int f = 0; f < num_own; ++f, node += ringed.nu())
      if (std::any_of(node, node + ringed.nu(), [&](int a) { return at_near[a]; }))
        chosen[r].push_back({f, near[f] != 0});
  }
  return chosen;
}

/// `distances` in D dimensions.
template <int D>
std::vector<double> nearest(MPI_Comm comm, const Surface& ringed, int num_own,
                            std::span<const double> slave_boxes, std::span<const double> reach)
{
  const int size = comm_size(comm);
  const std::vector<double> boxes = ringed.boxes();
  const Requests<D> requests = request<D>(comm, boxes, slave_boxes, reach);
  const BoxTree<D> tree(std::span<const double>(boxes).first(std::size_t(num_own) * 2 * D));
  std::vector<std::vector<double>> answers(size);
  for (int r = 0; r < size; ++r)
    for (int k = requests.begin(r); k < requests.begin(r + 1); ++k)
    {
      const Box<D> slave = requests.box(k);
      double best = INFINITY;
      tree.descend([&](const Box<D>& b, int) { return b.distance2(slave); },
                   [&](int f)
                   {
                     const Box<D> box = BoxTree<D>::item_box(boxes, f);
                     if (box.within(slave, requests.reach(k)))
                       best = std::min(best, box.distance2(slave));
                     return best;
                   },
                   best);
      answers[r].push_back(std::sqrt(best));
    }
  const Mail<double> received = all_to_all(comm, answers);
  std::vector<double> out(reach.size(), INFINITY);
  for (int r = 0; r < size; ++r)
    for (std::size_t k = 0; k < requests.sent[r].size(); ++k)
    {
      double& distance = out[requests.sent[r][k]];
      distance = std::min(distance, received.from(r)[k]);
    }
  return out;
}

} // namespace

std::int64_t bytes_received()
{
  return bytes_in;
}

std::vector<double> distances(MPI_Comm comm, const Surface& ringed, int num_own,
                              std::span<const double> slave_boxes, std::span<const double> reach)
{
  throw_together(comm, error_of(ringed, num_own, slave_boxes, reach));
  return ringed.dim == 2 ? nearest<2>(comm, ringed, num_own, slave_boxes, reach)
                         : nearest<3>(comm, ringed, num_own, slave_boxes, reach);
}

Surface with_targets(MPI_Comm comm, const Surface& ringed, int num_own,
                     std::span<const double> slave_boxes, std::span<const double> reach)
{
  throw_together(comm, error_of(ringed, num_own, slave_boxes, reach));
  const std::vector<std::vector<Chosen>> chosen
      = ringed.dim == 2 ? select_targets<2>(comm, ringed, num_own, slave_boxes, reach)
                        : select_targets<3>(comm, ringed, num_own, slave_boxes, reach);
  const int size = comm_size(comm), rank = comm_rank(comm);
  Parcels parcels(size);
  for (int r = 0; r < size; ++r)
    for (const Chosen& c : chosen[r])
      if (r != rank) // this rank's own facets do not travel
        pack(ringed, c.facet, c.candidate, r, parcels);
  const Mail<std::int64_t> ints = all_to_all(comm, parcels.ints);
  const Mail<double> reals = all_to_all(comm, parcels.reals);

  Surface out;
  out.dim = ringed.dim;
  out.ref = ringed.ref;
  const std::size_t own = chosen[rank].size(), width = num_ints(out),
                    all = own + ints.data.size() / width;
  std::vector<std::pair<std::int64_t, std::size_t>> order; // (id, own facet, or `own` + record)
  order.reserve(all);
  for (const Chosen& c : chosen[rank])
    order.emplace_back(ringed.id[c.facet], order.size());
  for (std::size_t k = 0; k < ints.data.size() / width; ++k)
    order.emplace_back(ints.data[k * width], own + k);
  if (not std::is_sorted(order.begin(), order.end()))
    std::sort(order.begin(), order.end());
  out.id.reserve(all);
  out.sigma.reserve(all);
  out.ends.reserve(all);
  out.candidate.reserve(all);
  out.vertices.reserve(all * out.nv());
  out.nodes.reserve(all * out.nu());
  out.X.reserve(all * num_reals(out));
  for (const auto& [id, k] : order)
    if (k < own)
    {
      const auto [f, candidate] = chosen[rank][k];
      append(id, ringed.sigma[f], ringed.ends[f], candidate,
             &ringed.vertices[static_cast<std::size_t>(f) * out.nv()],
             &ringed.nodes[static_cast<std::size_t>(f) * out.nu()], ringed.facet_X(f), out);
    }
    else
      unpack(&ints.data[(k - own) * width], &reals.data[(k - own) * num_reals(out)], out);
  out.number_nodes();
  return out;
}

} // namespace dolfinx_contact
