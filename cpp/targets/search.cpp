// SPDX-License-Identifier: MIT
#include "search.h"

#include <unordered_set>

namespace dolfinx_contact
{

namespace
{
constexpr double inside = 1e-8; // ξ counts as inside its facet up to this
constexpr double tie = 1e-10;   // relative difference of two costs that counts as none
constexpr double grazing = 0.1; // least |e·n_f| of a facet met along e (formulation, section 4)
} // namespace

template <int D>
Search<D>::Search(const Surface& master, const SearchOptions<D>& options)
    : _options(options)
{
  _diameter.resize(master.size());
  for (int f = 0; f < master.size(); ++f)
    _diameter[f] = master.diameter(f);
  if (not _diameter.empty())
    _largest = *std::max_element(_diameter.begin(), _diameter.end());
  _tree = BoxTree<D>(master.boxes());

  // A corner is at an end if an edge of any facet that meets there is
  const Shape shape = master.ref.shape;
  const int nv = master.nv();
  std::unordered_set<std::int64_t> at_end;
  for (int f = 0; f < master.size(); ++f)
    for (int e = 0; e < num_edges(shape); ++e)
      if ((master.ends[f] >> e) & 1)
        for (int v : reference_edge(shape, e))
          at_end.insert(master.vertices[f * nv + v]);
  _end_corners.resize(master.size(), 0);
  for (int f = 0; f < master.size(); ++f)
    for (int v = 0; v < nv; ++v)
      if (at_end.contains(master.vertices[f * nv + v]))
        _end_corners[f] |= 1 << v;
}

template <int D>
void Search<D>::refit(const Surface& master)
{
  _tree.refit(master.boxes());
}

// Lower bound of the cost of all facets in a box.
template <int D>
double Search<D>::bound(const Box<D>& box, const Vector<D>& x) const
{
  if (_options.rule == TargetRule::proximity)
    return std::sqrt(box.distance2(x.array()));

  // smallest |s| for which x + s e is in the box grown by the reach
  const double reach = _options.end_tolerance * _largest;
  double lo = -INFINITY, hi = INFINITY;
  for (int i = 0; i < D; ++i)
  {
    const double a = box.lo[i] - reach - x[i], b = box.hi[i] + reach - x[i];
    const double e = _options.direction[i];
    if (std::abs(e) < 1e-14)
    {
      if (a > 0 or b < 0)
        return INFINITY;
    }
    else
    {
      lo = std::max(lo, std::min(a / e, b / e));
      hi = std::min(hi, std::max(a / e, b / e));
    }
  }
  if (lo > hi)
    return INFINITY;
  // growing the box also along e lowers the bound by no more than the reach: still a lower bound
  return lo > 0 ? lo : hi < 0 ? -hi : 0.0;
}

// Facets whose outward normal does not face the slave are refused; for (F5) also grazing ones.
template <int D>
bool Search<D>::faces(const FacetProjection<D>& facet, const FacetPoint<D>& p,
                      const Vector<D>& outward) const
{
  const Vector<D> n = facet.normal(p);
  if (n.dot(outward) < 0)
    return false;
  return _options.rule == TargetRule::proximity or std::abs(n.dot(_options.direction)) >= grazing;
}

// True if a clamped target lies on a physical end of the surface.
template <int D>
bool Search<D>::on_end(const FacetProjection<D>& facet, const Target<D>& t) const
{
  if (t.clamp == Clamp::vertex)
    return (_end_corners[t.facet] >> t.edge) & 1;
  return t.clamp == Clamp::edge and facet.is_end(t.edge);
}

// A target clamped to a physical end counts while the particle overshoots the end a little only.
template <int D>
bool Search<D>::within_end(const FacetProjection<D>& facet, const Vector<D>& x,
                           const Target<D>& t) const
{
  if (not on_end(facet, t))
    return true;
  const FacetPoint<D> p = facet.at(t.xi, false);
  const Vector<D> m
      = _options.rule == TargetRule::proximity ? facet.normal(p) : Vector<D>(_options.direction);
  const Vector<D> r = x - p.x;
  return (r - r.dot(m) * m).norm() <= _options.end_tolerance * _diameter[t.facet];
}

// (F4) closest point of the facet, clamped to its edges; (F5) intersection inside the facet.
template <int D>
auto Search<D>::on_facet(const Surface& master, int f, const Vector<D>& x, const Vector<D>& outward,
                         const Vector<Q>* start) const -> Found
{
  Found found;
  const FacetProjection<D> facet(master, f);
  Target<D> t;
  t.facet = f;
  t.xi = start ? *start : facet.start(x);
  if (_options.rule == TargetRule::direction)
  {
    double s = 0;
    if (not facet.intersect(x, _options.direction, t.xi, s) or facet.outside(t.xi) > inside)
      return found;
    found.cost = std::abs(s);
  }
  else if (facet.closest(x, t.xi) and facet.outside(t.xi) <= inside)
  {
    found.cost = (x - facet.at(t.xi, false).x).norm();
  }
  else
  {
    double best = INFINITY;
    Target<D> clamped;
    for (int e = 0; e < num_edges(master.ref.shape); ++e)
    {
      const double d2 = facet.clamp(x, Vector<D>::Zero(), e, clamped);
      if (d2 < best)
      {
        best = d2;
        t = clamped;
      }
    }
    found.cost = std::sqrt(best);
  }
  if (found.cost > _options.radius or not faces(facet, facet.at(t.xi, false), outward))
    return {};
  found.target = t;
  return found;
}

// (F5) misses the surface: the nearest physical end beside the ray, seen along e.
template <int D>
auto Search<D>::at_end(const Surface& master, int f, const Vector<D>& x,
                       const Vector<D>& outward) const -> Found
{
  Found found;
  const FacetProjection<D> facet(master, f);
  for (int e = 0; e < num_edges(master.ref.shape); ++e)
  {
    Target<D> t;
    if (not facet.is_end(e))
      continue;
    const double cost = std::sqrt(facet.clamp(x, _options.direction, e, t));
    const FacetPoint<D> p = facet.at(t.xi, false);
    if (cost < found.cost and within_end(facet, x, t)
        and std::abs(_options.direction.dot(x - p.x)) <= _options.radius
        and faces(facet, p, outward))
      found = {t, cost};
  }
  return found;
}

// Costs that tie go to the lowest global facet number, so that no partition changes a target.
template <int D>
void Search<D>::best_of(const Surface& master, const Found& found, Found& best) const
{
  if (found.target.facet < 0)
    return;
  const bool ties = best.target.facet >= 0
                    and std::abs(found.cost - best.cost) <= tie * _diameter[found.target.facet];
  if (ties ? master.id[found.target.facet] < master.id[best.target.facet] : found.cost < best.cost)
    best = found;
}

// The former facet at the extrapolated ξ, unclamped, while ξ is within the margin and no other
// facet is clearly nearer than `cost`.
template <int D>
auto Search<D>::keep(const Surface& master, const Vector<D>& x, const Vector<D>& outward,
                     const Target<D>& former, double cost) const -> Found
{
  Found found;
  const FacetProjection<D> facet(master, former.facet);
  Target<D> t = former;
  t.clamp = Clamp::none;
  const double near = cost + _options.margin * _diameter[t.facet];
  double s = 0;
  const bool proximity = _options.rule == TargetRule::proximity;
  const bool solved
      = proximity ? facet.closest(x, t.xi) : facet.intersect(x, _options.direction, t.xi, s);
  if (solved and facet.outside(t.xi) <= _options.margin and not facet.beyond_end(t.xi, inside))
  {
    const FacetPoint<D> p = facet.at(t.xi, false);
    const double c = proximity ? (x - p.x).norm() : std::abs(s);
    if (c <= near and c <= _options.radius and faces(facet, p, outward))
      found = {t, c};
  }
  else if (proximity)
  {
    // at an inner ridge both facets hold the closest point: stay on the former one
    const Found again = on_facet(master, former.facet, x, outward);
    if (again.cost <= cost + tie * _diameter[t.facet])
      found = again;
  }
  return found;
}

template <int D>
Target<D> Search<D>::find(const Surface& master, const Vector<D>& x, const Vector<D>& outward,
                          const Target<D>& former) const
{
  Found best;
  const double slack = tie * _largest;
  auto key = [&](const Box<D>& box) { return bound(box, x); };
  double limit = _options.radius;
  if (former.facet >= 0) // a warm start bounds the search
  {
    best = on_facet(master, former.facet, x, outward, &former.xi);
    limit = std::min(limit, best.cost + slack);
  }
  _tree.descend(
      key,
      [&](int f)
      {
        if (master.candidate[f] and f != former.facet)
          best_of(master, on_facet(master, f, x, outward), best);
        return std::min(_options.radius, best.cost + slack);
      },
      limit);

  const bool stayed = best.target.facet == former.facet and best.target.clamp == Clamp::none;
  if (best.target.facet >= 0 and former.facet >= 0 and not stayed)
  {
    const Found kept = keep(master, x, outward, former, best.cost);
    if (kept.target.facet >= 0)
      best = kept;
  }
  if (best.target.facet < 0 and _options.rule == TargetRule::direction)
    _tree.descend(
        key,
        [&](int f)
        {
          if (master.candidate[f])
            best_of(master, at_end(master, f, x, outward), best);
          return _options.radius; // keys are distances along e, costs beside it
        },
        _options.radius);

  if (best.target.facet >= 0
      and not within_end(FacetProjection<D>(master, best.target.facet), x, best.target))
    return {};
  return best.target;
}

template class Search<2>;
template class Search<3>;

} // namespace dolfinx_contact
