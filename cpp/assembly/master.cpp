// SPDX-License-Identifier: MIT
//
// What an Assembler knows of its master: the facets that are held here, or a tool.
#include "assembler.h"

#include <algorithm>
#include <stdexcept>

namespace dolfinx_contact
{

// Find the targets' facets again by their global numbers; both lists of facets are sorted by them.
template <int D>
void Assembler<D>::carry_over(std::vector<State>& states, const Surface& master) const
{
  auto find = [&](std::int64_t id)
  {
    const auto it = std::lower_bound(master.id.begin(), master.id.end(), id);
    return it != master.id.end() and *it == id ? static_cast<int>(it - master.id.begin()) : -1;
  };
  std::vector<int> now(_master.size()); // many particles share a facet
  std::transform(_master.id.begin(), _master.id.end(), now.begin(), find);
  for (State& s : states)
  {
    if (s.target.facet >= 0 or s.away >= 0)
    {
      const bool here = s.target.facet >= 0;
      const std::int64_t id = here ? _master.id[s.target.facet] : s.away;
      const int f = here ? now[s.target.facet] : find(id);
      s.target.facet = f >= 0 and master.candidate[f] ? f : -1;
      s.away = s.target.facet >= 0 ? -1 : id; // it may come back
    }
    if (s.cell >= 0)
      s.cell = now[s.cell];
  }
}

template <int D>
void Assembler<D>::set_master(Surface master, std::vector<PetscInt> dofs, std::vector<double> reach)
{
  if (dofs.size() != master.node_table.size() * D)
    throw std::invalid_argument("Assembler: master_dofs must have one row for each node");
  if (not reach.empty() and std::ssize(reach) != _own)
    throw std::invalid_argument("Assembler: one reach for each own facet is needed");
  _reach = std::move(reach);
  if (_met) // else there are no targets yet, in states that fill the memory
    for (Cloud* cloud : {&_now, &_accepted, &_marked})
      carry_over(cloud->states, master);
  _met = _met or master.size() > 0;
  _master = std::move(master);
  _master_dofs = std::move(dofs);
  _adder.forget();
  _search = Search<D>(_master, _options.search);
  if (interpolated())
    _normals = NodalNormals<D>(_master, _options.crease);
  neighbours();
}

template <int D>
void Assembler<D>::set_tool(std::shared_ptr<const RigidTool<D>> tool, std::vector<PetscInt> dofs)
{
  if (dofs.size() != tool->pieces.size() * D)
    throw std::invalid_argument("Assembler: one dof for each component of a piece is needed");
  _tool = std::move(tool);
  const bool driven = std::any_of(dofs.begin(), dofs.end(), [](PetscInt d) { return d >= 0; });
  _adder.forget();
  _tool_dofs = driven ? std::move(dofs) : std::vector<PetscInt>();
}

// Facets that share a vertex with each master facet, and so its node: the displacement is
// continuous.
template <int D>
void Assembler<D>::neighbours()
{
  const int n = _master.size(), nu = _master.nu();
  const FacetsAtNodes facets(_master);
  _near_offset.assign(1, 0);
  _near_offset.reserve(n + 1);
  _near.clear();
  for (int f = 0; f < n; ++f)
  {
    for (int i = f * nu; i < (f + 1) * nu; ++i)
    {
      const auto there = facets.at(_master.local[i]);
      _near.insert(_near.end(), there.begin(), there.end());
    }
    std::sort(_near.begin() + _near_offset.back(), _near.end());
    _near.erase(std::unique(_near.begin() + _near_offset.back(), _near.end()), _near.end());
    _near_offset.push_back(static_cast<std::int32_t>(_near.size()));
  }
}

template <int D>
std::vector<double> Assembler<D>::decided() const
{
  std::vector<double> out(_own, 0.0);
  for (const State& s : _now.states)
    out[s.facet] = std::max(out[s.facet], s.target.decided);
  return out;
}

// the members of this file; assembler.cpp instantiates the others
template void Assembler<2>::carry_over(std::vector<State>&, const Surface&) const;
template void Assembler<3>::carry_over(std::vector<State>&, const Surface&) const;
template void Assembler<2>::set_master(Surface, std::vector<PetscInt>, std::vector<double>);
template void Assembler<3>::set_master(Surface, std::vector<PetscInt>, std::vector<double>);
template void Assembler<2>::set_tool(std::shared_ptr<const RigidTool<2>>, std::vector<PetscInt>);
template void Assembler<3>::set_tool(std::shared_ptr<const RigidTool<3>>, std::vector<PetscInt>);
template void Assembler<2>::neighbours();
template void Assembler<3>::neighbours();
template std::vector<double> Assembler<2>::decided() const;
template std::vector<double> Assembler<3>::decided() const;

} // namespace dolfinx_contact
