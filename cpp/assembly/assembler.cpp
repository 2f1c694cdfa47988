// SPDX-License-Identifier: MIT
#include "assembler.h"

#include "events.h"

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
    , _first_normals(_slave_normals)
{
  const std::size_t n = _own, np = _particles.refined ? 0 : _particles.rule.size();
  const std::size_t nl = _particles.multiplier.nodes(), nd = _particles.direction.size();
  const Rules& rules = _options.rules;
  const bool along = rules.target == TargetRule::direction;
  if (_own > _slave.size() or _slave_dofs.size() != _slave.node_table.size() * D
      or _multiplier_local.size() != n * nl or _particles.weight.size() != n * np
      or nd != (along and not rules.turning ? n * (num_directions() + num_nodes()) * D : 0))
    throw std::invalid_argument("Assembler: tables of the slave surface do not match");
  if ((rules.turning or rules.normal == NormalRule::direction) and not along)
    throw std::invalid_argument("Assembler: only a seek direction can turn, or be the normal");
  if (rules.target == TargetRule::smooth and rules.normal != NormalRule::interpolated)
    throw std::invalid_argument("Assembler: smooth targets have interpolated normals");
  _options.search.rule = _options.rules.target;
  // Other normals do not flip between facets: keeping the former facet would make the result depend
  // on the path, and break symmetry. But a slip is measured in the tangents of a facet, which
  // differ a little at a junction, and a particle that sticks there would alternate between two
  // facets.
  if (_options.rules.normal != NormalRule::facet)
    _options.search.margin = _options.rubbing ? 1e-4 : 0;
  lay_out();
}

template <int D>
void Assembler<D>::set_friction(FrictionSpace<D> friction)
{
  const std::size_t nf = friction.nodes(), Q = D - 1;
  if (friction.local.size() != _own * nf or friction.tangent.size() != friction.dofs.size()
      or std::any_of(friction.local.begin(), friction.local.end(),
                     [&](std::int32_t a) { return a < 0 or (a + 1) * Q > friction.dofs.size(); }))
    throw std::invalid_argument("Assembler: tables of the friction space do not match");
  if (friction.dofs != _friction.dofs) // other rows than before: the matrix has no place for them
  {
    _pattern.clear();
    _adder.forget();
  }
  _friction = std::move(friction);
  for (std::size_t p = 0; p < _samples.size(); ++p)
    tabulate(&_particles.rule.points[p * Q], _samples[p]);
}

template <int D>
void Assembler<D>::remember(std::span<const double> u_slave, std::span<const double> u_master)
{
  _slave.remember(u_slave);
  _master.remember(u_master);
  if (interpolated() and _options.convected and _options.rubbing)
  {
    _old_normals = _normals;
    std::swap(_master.x, _master.x_old);
    _old_normals.update(_master);
    std::swap(_master.x, _master.x_old);
  }
}

// The gap d_n beyond which an open particle of a facet counts as closed.
template <int D>
double Assembler<D>::near(int f, double close) const
{
  return close >= 0 ? -close * _slave.diameter(f) : INFINITY;
}

template <int D>
void Assembler<D>::set_law(const ContactLaw& law, const Scales& scale)
{
  _options.law = law;
  _options.scale = scale;
  for (State& s : _now.states)
    s.changes = 0;
}

// Points of a facet at which the direction is given, beside the nodes of ψ.
template <int D>
int Assembler<D>::num_directions() const
{
  return _particles.refined ? _slave.np() : _particles.rule.size();
}

// The given direction e.
// @param point a node of ψ, or −1 and less: particle −1 − point
template <int D>
Vector<D> Assembler<D>::given_direction(int f, const BasisValues& position, int point) const
{
  const int n = num_directions();
  auto at = [&](int i)
  {
    const std::size_t first = (static_cast<std::size_t>(f) * (n + num_nodes()) + i) * D;
    return Eigen::Map<const Vector<D>>(&_particles.direction[first]);
  };
  if (point >= 0)
    return at(n + point);
  if (not _particles.refined)
    return at(-1 - point);
  Vector<D> e = Vector<D>::Zero();
  for (int a = 0; a < n; ++a)
    e += position.N[a] * at(a);
  return e.normalized();
}

// A particle, or a node of ψ, in search of its target.
// @param point see given_direction
template <int D>
Seeker<D> Assembler<D>::seeker(int f, const BasisValues& position, const double* xi,
                               int point) const
{
  const FacetPoint<D> p = evaluate<D>(_slave.facet_x(f), _slave.np(), position, false);
  Seeker<D> out;
  out.x = p.x;
  out.outward = -double(_slave.sigma[f]) * p.area_vector().normalized();
  if (turns_smoothly())
    out.e = -_slave_normals.at(_slave, f, xi).M.normalized();
  else if (_options.rules.turning)
    out.e = out.outward;
  else if (not _particles.direction.empty())
    out.e = given_direction(f, position, point);
  return out;
}

// Target, normal and gap of a particle.
template <int D>
void Assembler<D>::seek(const Seeker<D>& seeker, State& s) const
{
  s.x = seeker.x;
  s.e = seeker.e;
  s.gap = -INFINITY;
  if (_tool)
  {
    const RigidTarget<D> t
        = _tool->find(s.x, seeker.outward, _options.search.radius, s.piece, s.target);
    s.piece = t.piece;
    s.target = t.target;
    s.gap = t.gap;
    s.n = t.n;
    return;
  }
  s.target = _search.find(_master, seeker, s.target, normals());
  if (s.target.facet < 0)
    return;
  NormalField<D> field;
  if (interpolated())
    field = _normals.at(_master, s.target.facet, s.target.xi.data());
  Kinematics<D> k;
  dolfinx_contact::place<D>(_master, s.target, s.x,
                            FacetProjection<D>(_master, s.target.facet).at(s.target.xi, false),
                            _options.rules.normal, s.e, k, &field);
  s.gap = k.gap;
  s.n = k.n;
}

template <int D>
Vector<D> Assembler<D>::target_point(const State& s) const
{
  return _tool ? _tool->point(s.piece, s.target, s.x)
               : FacetProjection<D>(_master, s.target.facet).at(s.target.xi, false).x;
}

template <int D>
Changes Assembler<D>::update(const Unknowns& u, double close, bool again)
{
  const Logged logged(Event::search);
  if (u.lambda.size() != _multiplier_dofs.size() or u.Lambda.size() != _friction.dofs.size())
    throw std::invalid_argument("Assembler.update: one value for each local multiplier is needed");
  _slave.displace(u.slave);
  if (not _tool)
    _master.displace(u.master);
  if (not _frozen.geometry)
  {
    _slave_normals.update(_slave);
    if (not _tool and interpolated())
      _normals.update(_master);
    if (not _tool)
      _search.refit(_master, normals());
  }

  if (_particles.refined)
  {
    _lambda.assign(u.lambda.begin(), u.lambda.end());
    _semi_multiplier.assign(u.Lambda.begin(), u.Lambda.end());
    if (not _frozen.geometry and not again)
      refine();
  }

  const int nl = _particles.multiplier.nodes(), nf = _friction.nodes(), Q = D - 1;
  Changes changes;
  Sample buffer;
  for (int f = 0; f < _own; ++f)
  {
    const double touching = near(f, close);
    for (int p = _now.offset[f]; p < _now.offset[f + 1]; ++p)
    {
      State& s = _now.states[p];
      if (again and s.settled)
        continue;
      const Sample& here = sample(s, buffer);
      s.lambda = 0;
      for (int a = 0; a < nl; ++a)
        s.lambda += here.psi[a] * u.lambda[_multiplier_local[f * nl + a]];
      s.Lambda.setZero();
      for (int a = 0; a < nf; ++a)
        for (int i = 0; i < Q; ++i)
        {
          const int dof = _friction.local[f * nf + a] * Q + i;
          s.Lambda += here.phi[a] * u.Lambda[dof] * _friction.tangent[dof];
        }

      if (_frozen.geometry)
        stay(here.position, s);
      else
      {
        Target<D> former = s.target;
        seek(seeker(f, here.position, s.xi.data(), _now.offset[f] - p - 1), s);
        s.settled = _tool or s.target.decided <= reach(f);
        if (not s.settled) // it is as if it had not been looked for
        {
          former.decided = s.target.decided;
          s.target = former;
          continue;
        }
        s.away = -1;
      }
      const bool was = s.closed;
      s.closed
          = std::isfinite(s.gap)
            and (_frozen.status ? was : closed(_options.law, s.lambda, s.gap) or s.gap > touching);
      s.changes += was != s.closed;
      changes.opened += was and not s.closed;
      changes.closed += s.closed and not was;
      if (nf == 0)
        continue;

      if (not s.closed)
        s.slip.setZero();
      else if (not _frozen.geometry)
        s.slip = slip(s, here.position);
      const Friction<D> before = s.friction;
      s.friction = friction(s);
      if (before.acts and s.friction.acts)
      {
        changes.slid += s.friction.slips and not before.slips;
        changes.stuck += before.slips and not s.friction.slips;
        changes.reversals += before.slips and s.friction.slips and before.p.dot(s.friction.p) < 0;
      }
    }
  }
  return changes;
}

template <int D>
Vector<D> Assembler<D>::old_position(const State& s, const BasisValues& position) const
{
  return evaluate<D>(_slave.facet_x_old(s.facet), _slave.np(), position, false).x;
}

// ⟦Δu⟧ of a particle with a target.
template <int D>
Vector<D> Assembler<D>::slip(const State& s, const BasisValues& position) const
{
  const Vector<D> x_old = old_position(s, position);
  if (_tool)
    return _tool->slip(s.piece, s.x, x_old);
  BasisValues b;
  _master.ref.position.tabulate(s.target.xi.data(), b, true);
  return slip_at(s, evaluate<D>(_master.facet_x(s.target.facet), _master.np(), b, true), b, x_old)
      .value;
}

// The slip of a particle whose target is at p.
// @param b basis of the master's positions at the target, with second derivatives
template <int D>
Slip<D> Assembler<D>::slip_at(const State& s, const FacetPoint<D>& p, const BasisValues& b,
                              const Vector<D>& x_old) const
{
  const FacetPoint<D> old = evaluate<D>(_master.facet_x_old(s.target.facet), _master.np(), b, true);
  const Vector<D> r = s.x - p.x, r_old = x_old - old.x;
  if (not _options.convected)
    return Slip<D>::increment(p, old, r, r_old);
  if (not interpolated())
    return Slip<D>::convected(p, old, r, r_old);
  const auto normal = [&](const NodalNormals<D>& normals)
  { return InterpolatedNormal<D>(normals.at(_master, s.target.facet, s.target.xi.data())); };
  return Slip<D>::convected(p, old, r, r_old, normal(_normals), normal(_old_normals));
}

// All variations of a closed particle's target.
// @param position basis of the slave's positions at the particle
// @param b basis of the master's positions at the target, with second derivatives
template <int D>
Kinematics<D> Assembler<D>::kinematics(const State& s, const BasisValues& position,
                                       const BasisValues& b) const
{
  if (_frozen.geometry)
    return Kinematics<D>::fixed(s.n, s.gap, s.slip);
  const bool rubbing = _friction.nodes() > 0;
  const Vector<D> x_old = rubbing ? old_position(s, position) : s.x;
  if (_tool)
    return _tool->linearise(s.piece, s.target, s.x, x_old);
  const int t = s.target.facet;
  const FacetPoint<D> p = evaluate<D>(_master.facet_x(t), _master.np(), b, true);
  NormalField<D> field;
  if (interpolated())
    field = _normals.at(_master, t, s.target.xi.data());
  Slip<D> slip;
  if (rubbing)
    slip = slip_at(s, p, b, x_old);
  return linearise<D>(_master, s.target, s.x, p, _options.rules, s.e, &field,
                      rubbing ? &slip : nullptr);
}

template <int D>
void Assembler<D>::set_multiplier_dofs(std::vector<PetscInt> dofs)
{
  if (dofs.size() != _multiplier_dofs.size())
    throw std::invalid_argument("Assembler: one dof for each local multiplier is needed");
  if (dofs != _multiplier_dofs)
  {
    _pattern.clear();
    _adder.forget();
  }
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
      seek(seeker(f, b, xi, a), there);
      Node node;
      node.has_target = there.target.facet >= 0;
      node.decided = there.target.decided;
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
