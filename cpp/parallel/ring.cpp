// SPDX-License-Identifier: MIT
//
// The one-ring of a rank's facets.
#include "exchange.h"
#include "mail.h"
#include "parcels.h"

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace dolfinx_contact
{

namespace
{

/// Which facets meet at a vertex.
struct Incidence
{
  std::vector<std::int64_t> vertex; ///< distinct entries of Surface::vertices, sorted
  std::vector<int> number;          ///< position in `vertex` of each entry, (n, nv)
  std::vector<int> offset, facets;  ///< at vertex i: facets[offset[i]..offset[i + 1])

  explicit Incidence(const Surface& s)
      : number(s.vertices.size())
      , facets(s.vertices.size())
  {
    std::vector<std::pair<std::int64_t, int>> slots; // (vertex, position in s.vertices)
    slots.reserve(s.vertices.size());
    for (const std::int64_t v : s.vertices)
      slots.emplace_back(v, static_cast<int>(slots.size()));
    std::sort(slots.begin(), slots.end());
    for (int k = 0; const auto& [v, slot] : slots)
    {
      if (vertex.empty() or vertex.back() != v)
      {
        vertex.push_back(v);
        offset.push_back(k);
      }
      number[slot] = static_cast<int>(vertex.size()) - 1;
      facets[k++] = slot / s.nv();
    }
    offset.push_back(static_cast<int>(slots.size()));
  }

  std::span<const int> at(int i) const
  {
    return std::span(facets).subspan(offset[i], offset[i + 1] - offset[i]);
  }
};

/// Which own facets other ranks need for their rings: plan[r], sorted, for each rank r. Collective.
std::vector<std::vector<int>> ring_plan(MPI_Comm comm, const Surface& own)
{
  const int size = comm_size(comm);
  const Incidence incidence(own);

  // Each vertex goes to its post office ...
  std::vector<std::vector<std::int64_t>> letters(size);
  for (const std::int64_t v : incidence.vertex)
    letters[v % size].push_back(v);
  const Mail<std::int64_t> collected = all_to_all(comm, letters);
  std::vector<std::pair<std::int64_t, int>> senders; // (vertex, rank)
  senders.reserve(collected.data.size());
  for (int r = 0; r < size; ++r)
    for (const std::int64_t v : collected.from(r))
      senders.emplace_back(v, r);
  std::sort(senders.begin(), senders.end());

  // ... which answers with (vertex, other rank) for each other rank that has it
  std::vector<std::vector<std::int64_t>> answers(size);
  for (auto begin = senders.begin(); begin != senders.end();)
  {
    const auto end = std::find_if(begin, senders.end(),
                                  [v = begin->first](const auto& s) { return s.first != v; });
    for (auto a = begin; a != end; ++a)
      for (auto b = begin; b != end; ++b)
        if (a != b)
          answers[a->second].insert(answers[a->second].end(), {b->first, b->second});
    begin = end;
  }
  const Mail<std::int64_t> shared = all_to_all(comm, answers);

  std::vector<std::vector<int>> plan(size);
  for (std::size_t k = 0; k < shared.data.size(); k += 2)
  {
    const auto v
        = std::lower_bound(incidence.vertex.begin(), incidence.vertex.end(), shared.data[k]);
    const auto facets = incidence.at(static_cast<int>(v - incidence.vertex.begin()));
    std::vector<int>& to = plan[shared.data[k + 1]];
    to.insert(to.end(), facets.begin(), facets.end());
  }
  for (std::vector<int>& facets : plan)
  {
    std::sort(facets.begin(), facets.end());
    facets.erase(std::unique(facets.begin(), facets.end()), facets.end());
  }
  return plan;
}

/// Fill `ends` of the first `num_own` facets, whose rings are complete: the edges that no other
/// facet has.
void find_ends(Surface& s, int num_own)
{
  const int ne = num_edges(s.ref.shape);
  using Edge = std::pair<std::pair<std::int64_t, std::int64_t>, int>; // its vertices, f * ne + e
  std::vector<Edge> edges;
  edges.reserve(static_cast<std::size_t>(s.size()) * ne);
  for (int f = 0; f < s.size(); ++f)
    for (int e = 0; e < ne; ++e)
    {
      const auto [i, j] = reference_edge(s.ref.shape, e);
      const std::int64_t* v = &s.vertices[static_cast<std::size_t>(f) * s.nv()];
      edges.emplace_back(std::minmax(v[i], v[j]), f * ne + e);
    }
  std::sort(edges.begin(), edges.end());
  for (std::size_t k = 0; k < edges.size(); ++k)
  {
    const auto& [vertices, slot] = edges[k];
    const bool shared = (k > 0 and edges[k - 1].first == vertices)
                        or (k + 1 < edges.size() and edges[k + 1].first == vertices);
    if (not shared and slot / ne < num_own)
      s.ends[slot / ne] |= static_cast<std::uint8_t>(1 << slot % ne);
  }
}

} // namespace

Surface with_ring(MPI_Comm comm, const Surface& own)
{
  throw_together(comm, error_of(own));
  Surface out = own;
  out.ends.assign(own.size(), 0);
  out.candidate.assign(own.size(), 1);

  const std::vector<std::vector<int>> plan = ring_plan(comm, own);
  Parcels parcels(comm_size(comm));
  for (std::size_t r = 0; r < plan.size(); ++r)
    for (const int f : plan[r])
      pack(out, f, false, static_cast<int>(r), parcels);
  const Mail<std::int64_t> ints = all_to_all(comm, parcels.ints);
  const Mail<double> reals = all_to_all(comm, parcels.reals);
  const std::size_t records = ints.data.size() / num_ints(out);
  for (std::size_t k = 0; k < records; ++k)
    unpack(&ints.data[k * num_ints(out)], &reals.data[k * num_reals(out)], out);

  // The ends of a ring facet are known to its owner only, and only now
  find_ends(out, own.size());
  std::vector<std::vector<std::int64_t>> own_ends(plan.size());
  for (std::size_t r = 0; r < plan.size(); ++r)
    for (const int f : plan[r])
      own_ends[r].push_back(out.ends[f]);
  const Mail<std::int64_t> ring_ends = all_to_all(comm, own_ends);
  std::transform(ring_ends.data.begin(), ring_ends.data.end(), out.ends.begin() + own.size(),
                 [](std::int64_t ends) { return static_cast<std::uint8_t>(ends); });
  out.number_nodes();
  return out;
}

} // namespace dolfinx_contact
