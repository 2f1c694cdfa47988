// SPDX-License-Identifier: MIT
#include "assembler.h"

#include "petsc_check.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <unordered_map>

namespace dolfinx_contact
{

template <int D>
Assembler<D>::Assembler(Surface slave, Particles particles, PairOptions<D> options,
                        std::vector<PetscInt> slave_dofs,
                        std::vector<std::int32_t> multiplier_local,
                        std::vector<PetscInt> multiplier_dofs)
    : _slave(std::move(slave))
    , _particles(std::move(particles))
    , _options(options)
    , _slave_dofs(std::move(slave_dofs))
    , _multiplier_dofs(std::move(multiplier_dofs))
    , _multiplier_local(std::move(multiplier_local))
{
  const std::size_t n = _slave.size(), np = _particles.rule.size();
  const std::size_t nl = _particles.multiplier.nodes();
  if (_slave_dofs.size() != _slave.node_table.size() * D or _multiplier_local.size() != n * nl
      or _particles.weight.size() != n * np)
    throw std::invalid_argument("Assembler: tables of the slave surface do not match");
  // interpolated normals do not jump at junctions: keeping the former facet would only make the
  // result depend on the path, and break symmetry
  if (interpolated())
    _options.search.margin = 0;
  _states.resize(n * np);
  _accepted = _states;
  _position.resize(np);
  _displacement.resize(np);
  _psi.resize(np * nl);
  for (std::size_t p = 0; p < np; ++p)
  {
    const double* xi = &_particles.rule.points[p * (D - 1)];
    _slave.ref.position.tabulate(xi, _position[p]);
    _slave.ref.displacement.tabulate(xi, _displacement[p]);
    _particles.multiplier.values(xi, &_psi[p * nl]);
  }
}

// Find the targets' facets again by their global numbers; both lists of facets are sorted by them.
template <int D>
void Assembler<D>::carry_over(std::vector<State>& states, const Surface& master) const
{
  for (State& s : states)
    if (s.target.facet >= 0)
    {
      const std::int64_t id = _master.id[s.target.facet];
      const auto it = std::lower_bound(master.id.begin(), master.id.end(), id);
      const int f = static_cast<int>(it - master.id.begin());
      s.target.facet = it != master.id.end() and *it == id and master.candidate[f] ? f : -1;
    }
}

template <int D>
void Assembler<D>::set_master(Surface master, std::vector<PetscInt> dofs)
{
  if (dofs.size() != master.node_table.size() * D)
    throw std::invalid_argument("Assembler: master_dofs must have one row for each node");
  carry_over(_states, master);
  carry_over(_accepted, master);
  _master = std::move(master);
  _master_dofs = std::move(dofs);
  _search = Search<D>(_master, _options.search);
  if (interpolated())
    _normals = NodalNormals<D>(_master, _options.crease);
  neighbours();
}

// Facets that share a vertex with each master facet.
template <int D>
void Assembler<D>::neighbours()
{
  const int n = _master.size(), nv = _master.nv();
  std::unordered_map<std::int64_t, std::vector<std::int32_t>> around;
  for (int f = 0; f < n; ++f)
    for (int v = 0; v < nv; ++v)
      around[_master.vertices[f * nv + v]].push_back(f);
  _near_offset.assign(1, 0);
  _near.clear();
  for (int f = 0; f < n; ++f)
  {
    for (int v = 0; v < nv; ++v)
    {
      const auto& a = around[_master.vertices[f * nv + v]];
      _near.insert(_near.end(), a.begin(), a.end());
    }
    std::sort(_near.begin() + _near_offset.back(), _near.end());
    _near.erase(std::unique(_near.begin() + _near_offset.back(), _near.end()), _near.end());
    _near_offset.push_back(static_cast<std::int32_t>(_near.size()));
  }
}

template <int D>
int Assembler<D>::update(std::span<const double> u_slave, std::span<const double> u_master,
                         std::span<const double> lambda, double close)
{
  if (lambda.size() != _multiplier_dofs.size())
    throw std::invalid_argument("Assembler.update: one multiplier for each local dof is needed");
  _slave.displace(u_slave);
  _master.displace(u_master);
  _search.refit(_master);
  if (interpolated())
    _normals.update(_master);

  const int np = _particles.rule.size(), nl = _particles.multiplier.nodes();
  int changes = 0;
  for (int f = 0; f < _slave.size(); ++f)
  {
    const double near = close >= 0 ? -close * _slave.diameter(f) : INFINITY;
    for (int p = 0; p < np; ++p)
    {
      State& s = _states[f * np + p];
      const FacetPoint<D> point = evaluate<D>(_slave.facet_x(f), _slave.np(), _position[p], false);
      s.x = point.x;
      const Vector<D> outward = -double(_slave.sigma[f]) * point.area_vector().normalized();
      s.lambda = 0;
      for (int a = 0; a < nl; ++a)
        s.lambda += _psi[p * nl + a] * lambda[_multiplier_local[f * nl + a]];

      s.target = _search.find(_master, s.x, outward, s.target, normals());
      place(s);
      const bool was = s.closed;
      s.closed = closed(_options.law, s.lambda, s.gap) or (std::isfinite(s.gap) and s.gap > near);
      s.changes += was != s.closed;
      changes += was != s.closed;
    }
  }
  return changes;
}

// Gap and normal of a particle at its target.
template <int D>
void Assembler<D>::place(State& s) const
{
  s.gap = -INFINITY;
  if (s.target.facet < 0)
    return;
  const double* xi = s.target.xi.data();
  NormalField<D> field;
  if (interpolated())
    field = _normals.at(_master, s.target.facet, xi);
  Kinematics<D> k;
  dolfinx_contact::place<D>(_master, s.target, s.x,
                            FacetProjection<D>(_master, s.target.facet).at(s.target.xi, false),
                            _options.normals, _options.search.direction, k, &field);
  s.gap = k.gap;
  s.n = k.n;
}

template <int D>
void Assembler<D>::set_multiplier_dofs(std::vector<PetscInt> dofs)
{
  if (dofs.size() != _multiplier_dofs.size())
    throw std::invalid_argument("Assembler: one dof for each local multiplier is needed");
  _multiplier_dofs = std::move(dofs);
}

template <int D>
std::vector<std::uint8_t> Assembler<D>::fixed_multipliers() const
{
  const int nl = _particles.multiplier.nodes();
  std::vector<std::uint8_t> fixed(static_cast<std::size_t>(_slave.size()) * nl, 0);
  constexpr double none = 1e-8; // a basis value or a component of the normal that counts as zero

  // no node of facet f with N_a(ξ) ≠ 0 is free to move along n
  auto held = [&](const Surface& s, int f, const std::vector<PetscInt>& dofs, const double* xi,
                  const Vector<D>& n)
  {
    double N[BasisValues::max_nodes];
    s.ref.displacement.values(xi, N);
    for (int a = 0; a < s.nu(); ++a)
      for (int i = 0; i < D; ++i)
        if (std::abs(N[a]) > none and std::abs(n[i]) > none
            and dofs[s.local[f * s.nu() + a] * D + i] >= 0)
          return false;
    return true;
  };

  for (int f = 0; f < _slave.size(); ++f)
    for (int a = 0; a < nl; ++a)
    {
      const double* xi = &_particles.nodes[a * (D - 1)];
      BasisValues b;
      _slave.ref.position.tabulate(xi, b);
      const FacetPoint<D> point = evaluate<D>(_slave.facet_x(f), _slave.np(), b, false);
      const Vector<D> outward = -double(_slave.sigma[f]) * point.area_vector().normalized();
      State there;
      there.x = point.x;
      there.target = _search.find(_master, point.x, outward, {}, normals());
      place(there);
      if (there.target.facet < 0) // open: its row is regular
        continue;
      fixed[f * nl + a]
          = held(_slave, f, _slave_dofs, xi, there.n)
            and held(_master, there.target.facet, _master_dofs, there.target.xi.data(), there.n);
    }
  return fixed;
}

template <int D>
CouplingBasis Assembler<D>::basis(int particle) const
{
  CouplingBasis b;
  b.N = _displacement[particle].N;
  b.psi = &_psi[particle * _particles.multiplier.nodes()];
  b.slave = _slave.nu();
  b.multiplier = _particles.multiplier.nodes();
  return b;
}

// System dofs of a pair, in the order of the coupling: slave, multiplier, master (if any).
template <int D>
void Assembler<D>::dofs_of(int facet, int target, std::vector<PetscInt>& dofs) const
{
  dofs.clear();
  auto add_nodes = [&](const Surface& s, int f, const std::vector<PetscInt>& table)
  {
    for (int a = 0; a < s.nu(); ++a)
      for (int i = 0; i < D; ++i)
        dofs.push_back(table[s.local[f * s.nu() + a] * D + i]);
  };
  add_nodes(_slave, facet, _slave_dofs);
  const int nl = _particles.multiplier.nodes();
  for (int a = 0; a < nl; ++a)
    dofs.push_back(_multiplier_dofs[_multiplier_local[facet * nl + a]]);
  if (target >= 0)
    add_nodes(_master, target, _master_dofs);
}

// Visit the particles of a slave facet grouped by target: visit(target, particles). Open particles
// are grouped as target −1: nothing couples them to a master.
template <int D>
template <typename Visit>
void Assembler<D>::for_each_pair(int facet, Visit visit) const
{
  const int np = _particles.rule.size();
  auto target = [&](int p)
  {
    const State& s = _states[facet * np + p];
    return s.closed ? s.target.facet : -1;
  };
  std::vector<int> order(np);
  for (int p = 0; p < np; ++p)
    order[p] = p;
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::pair(target(a), a) < std::pair(target(b), b); });
  for (int begin = 0, end; begin < np; begin = end)
  {
    for (end = begin; end < np and target(order[end]) == target(order[begin]);)
      ++end;
    visit(target(order[begin]), std::span(order).subspan(begin, end - begin));
  }
}

template <int D>
void Assembler<D>::residual(::Vec b) const
{
  check(VecSetOption(b, VEC_IGNORE_NEGATIVE_INDICES, PETSC_TRUE), "VecSetOption");
  const int np = _particles.rule.size();
  std::vector<PetscInt> dofs;
  PairVector<D> block;
  BasisValues M;
  for (int f = 0; f < _slave.size(); ++f)
    for_each_pair(f,
                  [&](int target, std::span<const int> particles)
                  {
                    dofs_of(f, target, dofs);
                    block.setZero(dofs.size());
                    for (int p : particles)
                    {
                      const State& s = _states[f * np + p];
                      CouplingBasis B = basis(p);
                      if (target >= 0)
                      {
                        _master.ref.displacement.tabulate(s.target.xi.data(), M);
                        B.M = &M;
                        B.master = _master.nu();
                      }
                      add_residual<D>(B, _options.law, s.closed, s.lambda, s.gap,
                                      traction_at(f * np + p), _particles.weight[f * np + p],
                                      _options.scale, block);
                    }
                    check(VecSetValues(b, dofs.size(), dofs.data(), block.data(), ADD_VALUES),
                          "VecSetValues");
                  });
}

template <int D>
void Assembler<D>::tangent(Mat A) const
{
  const int np = _particles.rule.size();
  const Vector<D> e = _options.search.direction;
  std::vector<PetscInt> dofs;
  PairMatrix<D> block;
  BasisValues P, M;
  const bool same = _master.ref.isoparametric();
  NormalField<D> field;
  NormalColumns<D> columns; // of the pair's normals, multiplied by ∂n_A/∂u at its end
  std::unordered_map<int, NormalDerivative<D>> derivatives;
  std::vector<PetscInt> ring;
  for (int f = 0; f < _slave.size(); ++f)
    for_each_pair(
        f,
        [&](int target, std::span<const int> particles)
        {
          dofs_of(f, target, dofs);
          block.setZero(dofs.size(), dofs.size());
          if (interpolated() and target >= 0)
            columns.reset(_master.nv(), static_cast<int>(dofs.size()));
          for (int p : particles)
          {
            const State& s = _states[f * np + p];
            const double w = _particles.weight[f * np + p];
            CouplingBasis B = basis(p);
            if (target < 0)
            {
              add_open_tangent<D>(B, _options.law, w, _options.scale, block);
              continue;
            }
            _master.ref.position.tabulate(s.target.xi.data(), P, true);
            if (not same)
              _master.ref.displacement.tabulate(s.target.xi.data(), M);
            B.M = same ? &P : &M;
            B.master = _master.nu();
            const FacetPoint<D> point = evaluate<D>(_master.facet_x(target), _master.np(), P, true);
            if (interpolated())
              field = _normals.at(_master, target, s.target.xi.data());
            const Kinematics<D> k = linearise<D>(_master, s.target, s.x, point,
                                                 _options.search.rule, _options.normals, e, &field);
            const Traction<D> t = linearised_traction<D>(law(s), s.lambda, k);
            add_closed_tangent<D>(B, k, t, w, _options.scale, block);
            if (interpolated())
            {
              double N[4], dN[2][4];
              corner_basis(_master.ref.shape, s.target.xi.data(), N, dN);
              add_normal_columns<D>(B, k, t, w, _options.scale, N, _master.nv(), columns);
            }
          }
          check(MatSetValues(A, dofs.size(), dofs.data(), dofs.size(), dofs.data(), block.data(),
                             ADD_VALUES),
                "MatSetValues (contact tangent)");
          if (interpolated() and target >= 0)
          {
            auto it = derivatives.find(target);
            if (it == derivatives.end())
              it = derivatives.emplace(target, _normals.derivative(_master, target)).first;
            const NormalDerivative<D>& d = it->second;
            ring_dofs(d.nodes, ring);
            RingMatrix values = columns.corner[0] * d.dn[0];
            for (int c = 1; c < _master.nv(); ++c)
              values += columns.corner[c] * d.dn[c];
            check(MatSetValues(A, dofs.size(), dofs.data(), ring.size(), ring.data(), values.data(),
                               ADD_VALUES),
                  "MatSetValues (contact tangent, normals)");
          }
        });
}

template <int D>
void Assembler<D>::ring_dofs(const std::vector<std::int32_t>& nodes,
                             std::vector<PetscInt>& dofs) const
{
  dofs.clear();
  for (const std::int32_t node : nodes)
    for (int i = 0; i < D; ++i)
      dofs.push_back(_master_dofs[node * D + i]);
}

template <int D>
void Assembler<D>::insert_pattern(Mat A, bool remember)
{
  const int np = _particles.rule.size();
  if (remember)
    _pattern.assign(_slave.size(), {});
  std::vector<PetscInt> dofs, ring;
  std::vector<PetscScalar> zeros;
  std::vector<int> targets;
  for (int f = 0; f < _slave.size(); ++f)
  {
    targets.assign(1, -1);
    for (int p = 0; p < np; ++p)
      if (const int t = _states[f * np + p].target.facet; t >= 0)
        targets.insert(targets.end(), _near.begin() + _near_offset[t],
                       _near.begin() + _near_offset[t + 1]);
    std::sort(targets.begin(), targets.end());
    targets.erase(std::unique(targets.begin(), targets.end()), targets.end());
    for (int t : targets)
    {
      if (t >= 0 and not _master.candidate[t])
        continue;
      dofs_of(f, t, dofs);
      zeros.assign(dofs.size() * dofs.size(), 0.0);
      check(MatSetValues(A, dofs.size(), dofs.data(), dofs.size(), dofs.data(), zeros.data(),
                         ADD_VALUES),
            "MatSetValues (contact pattern)");
      if (interpolated() and t >= 0)
      {
        ring_dofs(_normals.nodes(_master, t), ring);
        zeros.assign(dofs.size() * ring.size(), 0.0);
        check(MatSetValues(A, dofs.size(), dofs.data(), ring.size(), ring.data(), zeros.data(),
                           ADD_VALUES),
              "MatSetValues (contact pattern, normals)");
      }
      if (remember and t >= 0)
        _pattern[f].push_back(_master.id[t]); // sorted: facets are
    }
  }
}

template <int D>
bool Assembler<D>::pattern_holds() const
{
  const int np = _particles.rule.size();
  if (static_cast<int>(_pattern.size()) != _slave.size())
    return false;
  for (int f = 0; f < _slave.size(); ++f)
    for (int p = 0; p < np; ++p)
    {
      const State& s = _states[f * np + p];
      if (s.closed
          and not std::binary_search(_pattern[f].begin(), _pattern[f].end(),
                                     _master.id[s.target.facet]))
        return false;
    }
  return true;
}

template class Assembler<2>;
template class Assembler<3>;

} // namespace dolfinx_contact
