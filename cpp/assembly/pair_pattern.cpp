// SPDX-License-Identifier: MIT
//
// Places in the matrix for the blocks of the pairs of facets.
#include "assembler.h"
#include "events.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace dolfinx_contact
{

// The unknowns of a pair of facets (f, t) are those of f (slave, multipliers), those of t, and
// where normals are interpolated the nodes around f and t: columns only. That is
//
//     f × (f, around f, t, around t),   t × (f, around f),   t × (t, around t)
//
// Facets have many targets and targets many facets: blocks of the first two kinds are added once
// for each slave facet, with all its targets, and those of the third once for each target.
template <int D>
void Assembler<D>::add_pattern(Pattern& pattern)
{
  const Logged logged(Event::pattern);
  _adder.forget();
  _pattern.assign(_own, {});
  const int num_targets = _tool ? static_cast<int>(_tool_dofs.size()) / D : _master.size();
  const std::vector<PetscInt>& table = _tool ? _tool_dofs : _master_dofs;
  std::vector<std::vector<std::int32_t>> around(num_targets); // of the targets met so far
  std::vector<int> row(table.size() / D, -1), column(row);    // last facet that met a node
  std::vector<int> targets;
  std::vector<std::int32_t> rows, columns;
  std::vector<PetscInt> own, ring, dofs, other;
  for (int f = 0; f < _own; ++f)
  {
    targets.clear();
    if (_tool)
    {
      targets.resize(num_targets);
      std::iota(targets.begin(), targets.end(), 0);
    }
    else
      for (const State& s : _now.of(f))
        for (const int t : {s.target.facet, s.cell})
          if (t >= 0)
            targets.insert(targets.end(), _near.begin() + _near_offset[t],
                           _near.begin() + _near_offset[t + 1]);
    std::sort(targets.begin(), targets.end());
    targets.erase(std::unique(targets.begin(), targets.end()), targets.end());
    if (not _tool)
      std::erase_if(targets, [&](int t) { return not _master.candidate[t]; });

    rows.clear();
    columns.clear();
    for (const int t : targets)
    {
      for (const std::int32_t node : target_nodes(t))
        if (std::exchange(row[node], f) != f)
          rows.push_back(node);
      if (around[t].empty())
        around[t] = nodes_around(t);
      for (const std::int32_t node : around[t])
        if (std::exchange(column[node], f) != f)
          columns.push_back(node);
      if (not _tool)
        _pattern[f].push_back(_master.id[t]); // sorted: facets are
    }
    std::sort(rows.begin(), rows.end());
    std::sort(columns.begin(), columns.end());

    dofs_of(f, -1, own);
    ring = own;
    if (turns_smoothly() and not targets.empty())
    {
      node_dofs(_slave_normals.nodes(_slave, f), _slave_dofs, other);
      ring.insert(ring.end(), other.begin(), other.end());
    }
    node_dofs(rows, table, dofs);
    pattern.add(dofs, ring);
    node_dofs(columns, table, dofs);
    dofs.insert(dofs.begin(), ring.begin(), ring.end());
    pattern.add(own, dofs);
  }
  for (int t = 0; t < num_targets; ++t)
    if (not around[t].empty())
    {
      node_dofs(target_nodes(t), table, dofs);
      node_dofs(around[t], table, other);
      pattern.add(dofs, other);
    }
}

// Nodes of a master facet, or of a piece of the tool.
template <int D>
std::vector<std::int32_t> Assembler<D>::target_nodes(int t) const
{
  if (_tool)
    return {t};
  const auto first = _master.local.begin() + t * _master.nu();
  return {first, first + _master.nu()};
}

// Its nodes, and those around that the tangent of a pair depends on.
template <int D>
std::vector<std::int32_t> Assembler<D>::nodes_around(int t) const
{
  std::vector<std::int32_t> out = target_nodes(t);
  if (_tool)
    return out;
  if (_particles.refined) // cells may end at the facets around (motion_tangent)
    for (int k = _near_offset[t]; k < _near_offset[t + 1]; ++k)
      if (_master.candidate[_near[k]])
      {
        const std::vector<std::int32_t> nodes = target_nodes(_near[k]);
        out.insert(out.end(), nodes.begin(), nodes.end());
      }
  if (interpolated())
  {
    const std::vector<std::int32_t> nodes = _normals.nodes(_master, t);
    out.insert(out.end(), nodes.begin(), nodes.end());
  }
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

template <int D>
bool Assembler<D>::pattern_holds() const
{
  if (static_cast<int>(_pattern.size()) != _own)
    return false;
  auto holds = [&](const State& s, int target)
  {
    return target < 0
           or std::binary_search(_pattern[s.facet].begin(), _pattern[s.facet].end(),
                                 _master.id[target]);
  };
  return _tool
         or std::all_of(_now.states.begin(), _now.states.end(),
                        [&](const State& s) {
                          return (not s.closed or holds(s, s.target.facet)) and holds(s, s.cell);
                        });
}

// the members of this file; assembler.cpp instantiates the others
template void Assembler<2>::add_pattern(Pattern&);
template void Assembler<3>::add_pattern(Pattern&);
template std::vector<std::int32_t> Assembler<2>::target_nodes(int) const;
template std::vector<std::int32_t> Assembler<3>::target_nodes(int) const;
template std::vector<std::int32_t> Assembler<2>::nodes_around(int) const;
template std::vector<std::int32_t> Assembler<3>::nodes_around(int) const;
template bool Assembler<2>::pattern_holds() const;
template bool Assembler<3>::pattern_holds() const;

} // namespace dolfinx_contact
