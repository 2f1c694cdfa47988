// SPDX-License-Identifier: MIT
#include "assembler.h"

#include <algorithm>
#include <stdexcept>

namespace dolfinx_contact
{

template <int D>
Assembler<D>::Assembler(Surface slave, int own, Particles particles, PairOptions<D> options,
                        std::vector<PetscInt> slave_dofs,
                        std::vector<std::int32_t> multiplier_local,
                        std::vector<PetscInt> multiplier_dofs)
    : _slave(std::move(slave))
    , _own(own)
    , _particles(std::move(particles))
    , _options(options)
    , _slave_dofs(std::move(slave_dofs))
    , _multiplier_dofs(std::move(multiplier_dofs))
    , _multiplier_local(std::move(multiplier_local))
    , _slave_normals(_slave, _options.crease)
{
  const std::size_t n = _own, np = _particles.rule.size();
  const std::size_t nl = _particles.multiplier.nodes(), nd = _particles.direction.size();
  const bool directed
      = _options.rules.target == TargetRule::direction and not _options.rules.turning;
  if (_own > _slave.size() or _slave_dofs.size() != _slave.node_table.size() * D
      or _multiplier_local.size() != n * nl or _particles.weight.size() != n * np
      or nd != (directed ? n * (np + num_nodes()) * D : 0))
    throw std::invalid_argument("Assembler: tables of the slave surface do not match");
  _options.search.rule = _options.rules.target;
  // Other normals do not flip between facets: keeping the former facet would make the result depend
  // on the path, and break symmetry. But a slip is measured in the tangents of a facet, which
  // differ a little at a junction, and a particle that sticks there would alternate between two
  // facets.
  if (_options.rules.normal != NormalRule::facet)
    _options.search.margin = _options.rubbing ? 1e-4 : 0;
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

template <int D>
void Assembler<D>::set_friction(FrictionSpace<D> friction)
{
  const std::size_t np = _particles.rule.size(), nf = friction.nodes(), Q = D - 1;
  if (friction.local.size() != _own * nf or friction.tangent.size() != friction.dofs.size()
      or std::any_of(friction.local.begin(), friction.local.end(),
                     [&](std::int32_t a) { return a < 0 or (a + 1) * Q > friction.dofs.size(); }))
    throw std::invalid_argument("Assembler: tables of the friction space do not match");
  _friction = std::move(friction);
  _phi.resize(np * nf);
  for (std::size_t p = 0; p < np; ++p)
    if (nf > 0)
      _friction.basis.values(&_particles.rule.points[p * Q], &_phi[p * nf]);
}

template <int D>
void Assembler<D>::remember(std::span<const double> u_slave, std::span<const double> u_master)
{
  _slave.remember(u_slave);
  _master.remember(u_master);
}

template <int D>
void Assembler<D>::begin_step(double close)
{
  for (std::size_t i = 0; i < _states.size(); ++i)
  {
    State& s = _states[i];
    s.changes = 0;
    const double near = close * _slave.diameter(static_cast<int>(i / _particles.rule.size()));
    s.touched = _accepted[i].closed or s.gap > -near;
    const int np = _particles.rule.size();
    const double* xi = &_particles.rule.points[i % np * (D - 1)];
    s.n0 = -_slave_normals.at(_slave, static_cast<int>(i / np), xi).M.normalized();
  }
}

template <int D>
void Assembler<D>::accept()
{
  for (State& s : _states)
    if (const Friction<D> f = friction_at(s); f.acts)
      s.dissipated -= _options.law.friction * s.lambda * f.p.dot(s.slip);
  _accepted = _states;
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

// A particle, or a node of ψ, in search of its target.
template <int D>
Seeker<D> Assembler<D>::seeker(int f, const BasisValues& position, const double* xi,
                               int point) const
{
  const FacetPoint<D> p = evaluate<D>(_slave.facet_x(f), _slave.np(), position, false);
  Seeker<D> out;
  out.x = p.x;
  out.outward = -double(_slave.sigma[f]) * p.area_vector().normalized();
  const int points = _particles.rule.size() + num_nodes();
  if (turns_smoothly())
    out.e = -_slave_normals.at(_slave, f, xi).M.normalized();
  else if (_options.rules.turning)
    out.e = out.outward;
  else if (not _particles.direction.empty())
    out.e = Eigen::Map<const Vector<D>>(
        &_particles.direction[(static_cast<std::size_t>(f) * points + point) * D]);
  return out;
}

// Target, normal and gap of a particle.
template <int D>
void Assembler<D>::seek(const Seeker<D>& seeker, State& s) const
{
  s.x = seeker.x;
  s.e = seeker.e;
  s.gap = -INFINITY;
  Kinematics<D> k;
  if (_tool)
  {
    _tool->place(s.x, k);
    s.target.facet
        = k.n.dot(seeker.outward) >= 0 and std::abs(k.gap) <= _options.search.radius ? 0 : -1;
    if (s.target.facet < 0)
      return;
  }
  else
  {
    s.target = _search.find(_master, seeker, s.target, normals());
    if (s.target.facet < 0)
      return;
    NormalField<D> field;
    if (interpolated())
      field = _normals.at(_master, s.target.facet, s.target.xi.data());
    dolfinx_contact::place<D>(_master, s.target, s.x,
                              FacetProjection<D>(_master, s.target.facet).at(s.target.xi, false),
                              _options.rules.normal, s.e, k, &field);
  }
  s.gap = k.gap;
  s.n = k.n;
}

template <int D>
int Assembler<D>::update(const Unknowns& u, double close)
{
  if (u.lambda.size() != _multiplier_dofs.size() or u.Lambda.size() != _friction.dofs.size())
    throw std::invalid_argument("Assembler.update: one value for each local multiplier is needed");
  _slave.displace(u.slave);
  _slave_normals.update(_slave);
  if (not _tool)
  {
    _master.displace(u.master);
    _search.refit(_master);
    if (interpolated())
      _normals.update(_master);
  }

  const int np = _particles.rule.size(), nl = _particles.multiplier.nodes();
  const int nf = _friction.nodes(), Q = D - 1;
  int changes = 0;
  for (int f = 0; f < _own; ++f)
  {
    const double near = close >= 0 ? -close * _slave.diameter(f) : INFINITY;
    for (int p = 0; p < np; ++p)
    {
      State& s = _states[f * np + p];
      s.lambda = 0;
      for (int a = 0; a < nl; ++a)
        s.lambda += _psi[p * nl + a] * u.lambda[_multiplier_local[f * nl + a]];
      s.Lambda.setZero();
      for (int a = 0; a < nf; ++a)
        for (int i = 0; i < Q; ++i)
        {
          const int dof = _friction.local[f * nf + a] * Q + i;
          s.Lambda += _phi[p * nf + a] * u.Lambda[dof] * _friction.tangent[dof];
        }

      seek(seeker(f, _position[p], &_particles.rule.points[p * Q], p), s);
      const bool was = s.closed;
      s.closed = closed(_options.law, s.lambda, s.gap) or (std::isfinite(s.gap) and s.gap > near);
      s.changes += was != s.closed;
      changes += was != s.closed;

      s.slip.setZero();
      if (nf > 0 and s.closed)
      {
        BasisValues b;
        if (not _tool)
          _master.ref.position.tabulate(s.target.xi.data(), b, true);
        s.slip = kinematics(s, f, p, b).slip;
      }
      s.slips = friction_at(s).slips;
    }
  }
  return changes;
}

template <int D>
Vector<D> Assembler<D>::old_position(int f, int particle) const
{
  return evaluate<D>(_slave.facet_x_old(f), _slave.np(), _position[particle], false).x;
}

// All variations of a closed particle's target.
// @param b basis of the master's positions at the target, with second derivatives
template <int D>
Kinematics<D> Assembler<D>::kinematics(const State& s, int f, int particle,
                                       const BasisValues& b) const
{
  const bool rubbing = _friction.nodes() > 0;
  const Vector<D> x1_old = rubbing ? old_position(f, particle) : s.x;
  if (_tool)
    return _tool->linearise(s.x, x1_old);
  const int t = s.target.facet, np = _master.np();
  const FacetPoint<D> p = evaluate<D>(_master.facet_x(t), np, b, true);
  NormalField<D> field;
  if (interpolated())
    field = _normals.at(_master, t, s.target.xi.data());
  Slip<D> slip;
  if (rubbing)
  {
    const FacetPoint<D> old = evaluate<D>(_master.facet_x_old(t), np, b, true);
    const auto measure = _options.convected ? Slip<D>::convected : Slip<D>::increment;
    slip = measure(p, old, s.x - p.x, x1_old - old.x);
  }
  return linearise<D>(_master, s.target, s.x, p, _options.rules, s.e, &field,
                      rubbing ? &slip : nullptr);
}

template <int D>
void Assembler<D>::set_multiplier_dofs(std::vector<PetscInt> dofs)
{
  if (dofs.size() != _multiplier_dofs.size())
    throw std::invalid_argument("Assembler: one dof for each local multiplier is needed");
  _multiplier_dofs = std::move(dofs);
}

template <int D>
auto Assembler<D>::nodes() const -> std::vector<Node>
{
  // component i of some node of facet f with N_a(ξ) ≠ 0 is free
  auto may_move = [](const Surface& s, int f, const std::vector<PetscInt>& dofs, const double* xi,
                     std::array<bool, D>& out)
  {
    double N[BasisValues::max_nodes];
    s.ref.displacement.values(xi, N);
    for (int a = 0; a < s.nu(); ++a)
      for (int i = 0; i < D; ++i)
        out[i] = out[i] or (std::abs(N[a]) > 1e-8 and dofs[s.local[f * s.nu() + a] * D + i] >= 0);
  };

  std::vector<Node> out;
  for (int f = 0; f < _own; ++f)
    for (int a = 0; a < num_nodes(); ++a)
    {
      const double* xi = &_particles.nodes[a * (D - 1)];
      BasisValues b;
      _slave.ref.position.tabulate(xi, b);
      State there;
      seek(seeker(f, b, xi, _particles.rule.size() + a), there);
      Node node;
      node.has_target = there.target.facet >= 0;
      node.n = there.n;
      may_move(_slave, f, _slave_dofs, xi, node.free_to_move);
      if (node.has_target and not _tool)
        may_move(_master, there.target.facet, _master_dofs, there.target.xi.data(),
                 node.free_to_move);
      out.push_back(node);
    }
  return out;
}

template class Assembler<2>;
template class Assembler<3>;

} // namespace dolfinx_contact
