// SPDX-License-Identifier: MIT
#pragma once

#include "../geometry/surface.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace dolfinx_contact
{

/// Facets as they travel: fixed-size records of `num_ints` integers (id, sigma, ends, candidate,
/// vertices, nodes) and `num_reals` reals (X), one list for each rank.
struct Parcels
{
  std::vector<std::vector<std::int64_t>> ints;
  std::vector<std::vector<double>> reals;
  explicit Parcels(int ranks)
      : ints(ranks)
      , reals(ranks)
  {
  }
};

inline int num_ints(const Surface& s)
{
  return 4 + s.nv() + s.nu();
}
inline int num_reals(const Surface& s)
{
  return s.np() * s.dim;
}

/// Append facet f of `s` to the parcel for rank `to`.
inline void pack(const Surface& s, int f, bool candidate, int to, Parcels& parcels)
{
  std::vector<std::int64_t>& ints = parcels.ints[to];
  ints.insert(ints.end(), {s.id[f], s.sigma[f], s.ends[f], candidate});
  const auto vertex = s.vertices.begin() + static_cast<std::ptrdiff_t>(f) * s.nv();
  ints.insert(ints.end(), vertex, vertex + s.nv());
  const auto node = s.nodes.begin() + static_cast<std::ptrdiff_t>(f) * s.nu();
  ints.insert(ints.end(), node, node + s.nu());
  std::vector<double>& reals = parcels.reals[to];
  reals.insert(reals.end(), s.facet_X(f), s.facet_X(f) + num_reals(s));
}

/// Append a facet to `s`.
inline void append(std::int64_t id, std::int8_t sigma, std::uint8_t ends, bool candidate,
                   const std::int64_t* vertices, const std::int64_t* nodes, const double* X,
                   Surface& s)
{
  s.id.push_back(id);
  s.sigma.push_back(sigma);
  s.ends.push_back(ends);
  s.candidate.push_back(candidate);
  s.vertices.insert(s.vertices.end(), vertices, vertices + s.nv());
  s.nodes.insert(s.nodes.end(), nodes, nodes + s.nu());
  s.X.insert(s.X.end(), X, X + num_reals(s));
}

/// Append one record to `s`.
inline void unpack(const std::int64_t* ints, const double* reals, Surface& s)
{
  append(ints[0], static_cast<std::int8_t>(ints[1]), static_cast<std::uint8_t>(ints[2]),
         ints[3] != 0, ints + 4, ints + 4 + s.nv(), reals, s);
}

/// What is wrong with a surface; empty if nothing.
inline std::string error_of(const Surface& s)
{
  const std::size_t n = s.id.size();
  if (s.dim != facet_dim(s.ref.shape) + 1)
    return "Surface.dim is " + std::to_string(s.dim) + ", it must be the facet's dimension plus 1";
  if (s.vertices.size() != n * s.nv() or s.nodes.size() != n * s.nu()
      or s.X.size() != n * num_reals(s) or s.sigma.size() != n)
    return "Surface.vertices, nodes, X and sigma must have one row for each entry of id";
  return "";
}

} // namespace dolfinx_contact
