// SPDX-License-Identifier: MIT
//
// Where an Assembler's particles are, and what they remember of the last accepted step.
#include "assembler.h"

namespace dolfinx_contact
{

// Bases at ξ.
template <int D>
void Assembler<D>::tabulate(const double* xi, Sample& out) const
{
  _slave.ref.position.tabulate(xi, out.position);
  _slave.ref.displacement.tabulate(xi, out.displacement);
  _particles.multiplier.values(xi, out.psi.data());
  if (_friction.nodes() > 0)
    _friction.basis.values(xi, out.phi.data());
}

template <int D>
const Sample& Assembler<D>::sample(const State& s, Sample& buffer) const
{
  if (not _particles.refined)
    return _samples[&s - &_now.states[_now.offset[s.facet]]];
  tabulate(s.xi.data(), buffer);
  return buffer;
}

// The first particles: fixed ones; if they move, those of facets that face nothing.
template <int D>
void Assembler<D>::lay_out()
{
  _now.offset.assign(_own + 1, 0);
  if (_particles.refined)
  {
    refine();
    _accepted = _now;
    return;
  }
  const int np = _particles.rule.size();
  _samples.resize(np);
  for (int p = 0; p < np; ++p)
    tabulate(&_particles.rule.points[p * (D - 1)], _samples[p]);
  for (int f = 0; f < _own; ++f)
  {
    _now.offset[f + 1] = (f + 1) * np;
    for (int p = 0; p < np; ++p)
    {
      State s;
      s.facet = f;
      s.xi = Eigen::Map<const Vector<D - 1>>(&_particles.rule.points[p * (D - 1)]);
      s.weight = _particles.weight[f * np + p];
      _now.states.push_back(s);
    }
  }
  _accepted = _now;
}

// The nearest particle of the same facet; null if there is none.
template <int D>
auto Assembler<D>::nearest(const Cloud& cloud, const State& s) -> const State*
{
  const State* best = nullptr;
  double least = INFINITY;
  for (const State& t : cloud.of(s.facet))
    if (const double d2 = (t.xi - s.xi).squaredNorm(); d2 < least)
    {
      least = d2;
      best = &t;
    }
  return best;
}

// The particles of one facet's refinement.
template <int D>
CellPoints<D> Assembler<D>::cells(int f, bool motion) const
{
  const double reach = std::min(_options.search.radius, _slave.diameter(f));
  std::vector<int> near;
  std::array<double, 2 * D> box;
  _slave.box(f, reach, box.data());
  if (not _tool)
    _search.near(BoxTree<D>::item_box(box, 0), near);
  std::erase_if(near, [&](int g) { return not _master.candidate[g]; });
  std::sort(near.begin(), near.end()); // facets are in the order of their global numbers
  Vector<D> e = Vector<D>::Zero();
  if (_options.rules.target == TargetRule::direction and not _options.rules.turning)
  {
    BasisValues b;
    double centre[2] = {};
    Eigen::Map<Vector<D - 1>>{centre} = FacetProjection<D>::centre(_slave.ref.shape);
    _slave.ref.position.tabulate(centre, b);
    e = given_direction(f, b, -1);
  }
  return Segments<D>(_particles.rule).points(_slave, f, _master, near, e, reach, motion);
}

// Particles of the common refinement where both surfaces are now. What a particle remembers is a
// property of its place: that of the nearest one of the last accepted step, so that the residual
// depends on the displacements alone. What it was in the last evaluation serves for counting, and
// as a first guess.
template <int D>
void Assembler<D>::refine()
{
  Cloud next;
  next.offset.assign(1, 0);
  next.states.reserve(_now.states.size());
  Sample here;
  for (int f = 0; f < _own; ++f)
  {
    const std::vector<CellPoint<D>> points = cells(f, false).points;
    const std::span<const State> before = _now.of(f);
    for (std::size_t p = 0; p < points.size(); ++p)
    {
      State s;
      s.facet = f;
      s.xi = points[p].xi;
      // as long as there are equally many they are the same ones
      if (const State* last = before.size() == points.size() ? &before[p] : nearest(_now, s))
      {
        s = *last;
        s.xi = points[p].xi;
      }
      tabulate(s.xi.data(), here);
      s.weight
          = points[p].weight * reference_measure(_slave, f, here.position, _particles.axisymmetric);
      s.cell = points[p].master;
      if (s.cell >= 0 and s.target.facet != s.cell)
        s.target = {s.cell, FacetProjection<D>::centre(_master.ref.shape)};
      if (const State* kept = _accepted.offset.empty() ? nullptr : nearest(_accepted, s))
      {
        s.touched = kept->touched;
        s.dissipated = kept->dissipated;
        if (_options.rubbing)
          s.n0 = first_normal(s);
      }
      next.states.push_back(s);
    }
    next.offset.push_back(static_cast<int>(next.states.size()));
  }
  _now = std::move(next);
}

// The slave's outward normal as the step began.
template <int D>
Vector<D> Assembler<D>::first_normal(const State& s) const
{
  return -_first_normals.at(_slave, s.facet, s.xi.data()).M.normalized();
}

template <int D>
int Assembler<D>::begin_step(double close)
{
  _frozen = {};
  for (State& s : _now.states)
    s.changes = 0;
  for (State& s : _accepted.states)
    s.changes = 0;
  if (not _options.rubbing)
    return 0;
  _first_normals = _slave_normals;
  int touched = 0;
  Cloud kept = _now; // `restore` comes back into the step that begins here
  for (State& s : kept.states)
  {
    const State* last
        = _particles.refined ? nearest(_accepted, s) : &_accepted.states[&s - kept.states.data()];
    const double touching = near(s.facet, close);
    State& now = _now.states[&s - kept.states.data()];
    const Vector<D - 1> xi = s.xi;
    const double weight = s.weight;
    s = *last;
    s.xi = xi;
    s.weight = weight;
    s.touched = now.touched = s.closed or now.gap > touching;
    s.n0 = now.n0 = first_normal(now);
    touched += s.touched;
  }
  _accepted = std::move(kept);
  return touched;
}

template <int D>
void Assembler<D>::accept()
{
  for (State& s : _now.states)
    if (s.friction.acts)
    {
      const double d = -_options.law.friction * s.friction.limit * s.friction.p.dot(s.slip);
      s.dissipated += d;
      _dissipated += s.weight * d;
    }
  _accepted = _now;
}

template <int D>
void Assembler<D>::resume(std::vector<State> states, double dissipated)
{
  Cloud cloud;
  cloud.offset.assign(_own + 1, 0);
  for (const State& s : states)
    ++cloud.offset.at(s.facet + 1);
  for (int f = 0; f < _own; ++f)
  {
    if (not _particles.refined and cloud.offset[f + 1] != _particles.rule.size())
      throw std::invalid_argument("Assembler: a facet has other particles than its rule's");
    cloud.offset[f + 1] += cloud.offset[f];
  }
  cloud.states = std::move(states);
  if (not _tool)
    carry_over(cloud.states, _master);
  _met = true; // they may have targets that are yet to come
  _now = _accepted = _marked = std::move(cloud);
  _frozen = {};
  _dissipated = dissipated;
}

// the members of this file; assembler.cpp instantiates the others
template void Assembler<2>::tabulate(const double*, Sample&) const;
template void Assembler<3>::tabulate(const double*, Sample&) const;
template const Sample& Assembler<2>::sample(const State&, Sample&) const;
template const Sample& Assembler<3>::sample(const State&, Sample&) const;
template void Assembler<2>::lay_out();
template void Assembler<3>::lay_out();
template CellPoints<2> Assembler<2>::cells(int, bool) const;
template CellPoints<3> Assembler<3>::cells(int, bool) const;
template void Assembler<2>::refine();
template void Assembler<3>::refine();
template Vector<2> Assembler<2>::first_normal(const State&) const;
template Vector<3> Assembler<3>::first_normal(const State&) const;
template auto Assembler<2>::nearest(const Cloud&, const State&) -> const State*;
template auto Assembler<3>::nearest(const Cloud&, const State&) -> const State*;
template int Assembler<2>::begin_step(double);
template int Assembler<3>::begin_step(double);
template void Assembler<2>::accept();
template void Assembler<3>::accept();
template void Assembler<2>::resume(std::vector<State>, double);
template void Assembler<3>::resume(std::vector<State>, double);

} // namespace dolfinx_contact
