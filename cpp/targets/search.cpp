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
  {
    _largest = *std::max_element(_diameter.begin(), _diameter.end());
    _typical = std::accumulate(_diameter.begin(), _diameter.end(), 0.0) / _diameter.size();
  }
  const std::vector<double> boxes = master.boxes();
  _tree = BoxTree<D>(boxes);
  _tree.link();
  for (int f = 0; f < master.size(); ++f)
    if (options.rule != TargetRule::proximity and master.ends[f] and master.candidate[f])
      _at_end.push_back(f);
  _end_tree = BoxTree<D>(end_boxes(boxes));

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
void Search<D>::refit(const Surface& master, const NodalNormals<D>* normals)
{
  const std::vector<double> boxes = master.boxes();
  _tree.refit(boxes);
  _tree.link();
  _end_tree.refit(end_boxes(boxes));
  _normals.clear();
  _end_normals.clear();
  if (normals and _options.rule == TargetRule::smooth)
  {
    const std::vector<double> n = normal_boxes(master, *normals);
    _normals = _tree.bounds(n);
    _end_normals = _end_tree.bounds(end_boxes(n));
  }
}

// Those of the facets at ends.
template <int D>
std::vector<double> Search<D>::end_boxes(std::span<const double> boxes) const
{
  std::vector<double> out;
  out.reserve(_at_end.size() * 2 * D);
  for (const int f : _at_end)
    out.insert(out.end(), boxes.begin() + f * 2 * D, boxes.begin() + (f + 1) * 2 * D);
  return out;
}

// Lower bound of the cost of all facets in a box; a line may pass it beside by `reach`.
template <int D>
double Search<D>::bound(const Box<D>& box, const Query& q, double reach) const
{
  if (_options.rule != TargetRule::direction)
    return std::sqrt(box.distance2(q.x.array())); // ‖x¹ − x²‖ is |d| for smooth targets too

  // smallest |s| for which x + s e is in the box grown by the reach
  double lo = -INFINITY, hi = INFINITY;
  for (int i = 0; i < D; ++i)
  {
    const double a = box.lo[i] - reach - q.x[i], b = box.hi[i] + reach - q.x[i];
    const double e = q.e[i];
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

// The direction m of the rule at a target: ±e, n̄, or the facet's normal for proximity.
template <int D>
Vector<D> Search<D>::direction(const Query& q, const Target<D>& t) const
{
  if (_options.rule == TargetRule::direction)
    return q.e;
  if (_options.rule == TargetRule::smooth)
    return SmoothProjection<D>(q.master, t.facet, *q.normals).normal(t.xi);
  const FacetProjection<D> facet(q.master, t.facet);
  return facet.normal(facet.at(t.xi, false));
}

// Facets whose outward normal does not face the slave are refused, so that the far side of a thin
// body is never taken; for (F5) also grazing ones.
template <int D>
bool Search<D>::faces(const Query& q, const FacetProjection<D>& facet, const Target<D>& t) const
{
  if (_options.rule == TargetRule::smooth)
    return direction(q, t).dot(q.outward) >= 0;
  const Vector<D> n = facet.normal(facet.at(t.xi, false));
  if (n.dot(q.outward) < 0)
    return false;
  return _options.rule == TargetRule::proximity or std::abs(n.dot(q.e)) >= grazing;
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
bool Search<D>::within_end(const Query& q, const Target<D>& t) const
{
  const FacetProjection<D> facet(q.master, t.facet);
  if (not on_end(facet, t))
    return true;
  const Vector<D> m = direction(q, t), r = q.x - facet.at(t.xi, false).x;
  return (r - r.dot(m) * m).norm() <= _options.end_tolerance * _diameter[t.facet];
}

// (F4) closest point of the facet, clamped to its edges; (F5), (F6) the nearest solution inside it.
template <int D>
auto Search<D>::on_facet(const Query& q, int f, double limit, const Vector<Q>* start) const -> Found
{
  Found found;
  const FacetProjection<D> facet(q.master, f);
  const Vector<Q> first = start ? *start : facet.start(q.x);
  const Shape shape = q.master.ref.shape;
  Target<D> t;
  t.facet = f;
  if (_options.rule == TargetRule::proximity)
  {
    const double distance = closest_point(facet, shape, q.x, first, limit, inside, t);
    if (distance <= _options.radius and faces(q, facet, t))
      found = {t, distance};
    return found;
  }
  auto offer = [&](const Vector<Q>& xi, double s)
  {
    t.xi = xi;
    if (std::abs(s) < found.cost and std::abs(s) <= _options.radius and facet.outside(xi) <= inside
        and faces(q, facet, t))
      found = {t, std::abs(s)};
  };
  if (_options.rule == TargetRule::smooth)
    SmoothProjection<D>(q.master, f, *q.normals).solutions(q.x, first, limit, offer);
  else
    crossings(facet, shape, q.x, q.e, first, offer);
  return found;
}

// (F5) or (F6) miss the surface: the nearest physical end beside it, seen along the rule's
// direction.
template <int D>
auto Search<D>::at_end(const Query& q, int f) const -> Found
{
  Found found;
  const FacetProjection<D> facet(q.master, f);
  for (int e = 0; e < num_edges(q.master.ref.shape); ++e)
  {
    if (not facet.is_end(e))
      continue;
    Target<D> t;
    double cost;
    if (_options.rule == TargetRule::smooth)
    {
      const SmoothProjection<D> smooth(q.master, f, *q.normals);
      if (smooth.far_beside(q.x, e, _options.end_tolerance * _diameter[f]))
        continue; // `within_end` would refuse it
      cost = smooth.clamp(q.x, e, t);
    }
    else
      cost = std::sqrt(facet.clamp(q.x, q.e, e, t));
    if (cost < found.cost and within_end(q, t)
        and std::abs(direction(q, t).dot(q.x - facet.at(t.xi, false).x)) <= _options.radius
        and faces(q, facet, t))
      found = {t, cost};
  }
  return found;
}

// Costs that tie go to the lowest global facet number, so that no partition changes a target.
template <int D>
void Search<D>::best_of(const Query& q, const Found& found, Found& best) const
{
  if (found.target.facet < 0)
    return;
  const std::vector<std::int64_t>& id = q.master.id;
  const bool ties = best.target.facet >= 0
                    and std::abs(found.cost - best.cost) <= tie * _diameter[found.target.facet];
  if (ties ? id[found.target.facet] < id[best.target.facet] : found.cost < best.cost)
    best = found;
}

// The former facet at the extrapolated ξ, unclamped, while ξ is within the margin and no other
// facet is clearly nearer than `cost`.
template <int D>
auto Search<D>::keep(const Query& q, const Target<D>& former, double cost) const -> Found
{
  Found found;
  const FacetProjection<D> facet(q.master, former.facet);
  Target<D> t = former;
  t.clamp = Clamp::none;
  const double near = cost + _options.margin * _diameter[t.facet];
  double s = 0;
  const bool proximity = _options.rule == TargetRule::proximity;
  const bool solved
      = proximity ? facet.closest(q.x, t.xi)
        : _options.rule == TargetRule::smooth
            ? SmoothProjection<D>(q.master, former.facet, *q.normals).solve(q.x, t.xi, s)
            : facet.intersect(q.x, q.e, t.xi, s);
  if (solved and facet.outside(t.xi) <= _options.margin and not facet.beyond_end(t.xi, inside))
  {
    const double c = proximity ? (q.x - facet.at(t.xi, false).x).norm() : std::abs(s);
    if (c <= near and c <= _options.radius and faces(q, facet, t))
      found = {t, c};
  }
  else if (proximity)
  {
    // at an inner ridge both facets hold the closest point: stay on the former one
    const Found again = on_facet(q, former.facet, INFINITY);
    if (again.cost <= cost + tie * _diameter[t.facet])
      found = again;
  }
  return found;
}

template <int D>
Target<D> Search<D>::find(const Query& q, const Target<D>& former) const
{
  if (_tree.empty())
    return {};
  Found best;
  const double slack = tie * _largest;
  double limit = _options.radius;
  auto key = [&](const Box<D>& box, int node)
  {
    const double cost = bound(box, q, inside * _largest);
    const bool none
        = cost > limit
          or (not _normals.empty() and not may_lead_to<D>(q.x, box, _normals[node], 0, limit));
    return none ? INFINITY : cost;
  };
  auto visit = [&](int f)
  {
    if (q.master.candidate[f] and f != former.facet)
      best_of(q, on_facet(q, f, limit), best);
    return limit = std::min(limit, best.cost + slack);
  };
  if (former.facet >= 0) // a warm start bounds the search
    best = on_facet(q, former.facet, limit, &former.xi);
  if (best.target.facet >= 0)
  {
    limit = std::min(limit, best.cost + slack);
    _tree.descend_near(former.facet, q.x.array(), limit + inside * _largest, key, visit, limit);
  }
  else
  {
    // Nothing bounds it before the first target: where the nearest facet has none, the tree would
    // show half of the surface before the next. So the bound grows by and by.
    const double farthest = std::min(_options.radius, _tree.root().farthest(q.x.array()));
    double reach = std::max(_typical, 1e-3 * farthest);
    for (bool more = true; more; reach *= 4)
    {
      limit = std::min({reach, _options.radius, best.cost + slack});
      _tree.descend(key, visit, limit);
      more = reach < farthest and not(best.cost <= reach);
    }
  }

  const bool stayed = best.target.facet == former.facet and best.target.clamp == Clamp::none;
  const bool keeps = _options.margin > 0 or _options.rule == TargetRule::proximity;
  if (keeps and best.target.facet >= 0 and former.facet >= 0 and not stayed)
  {
    const Found kept = keep(q, former, best.cost);
    if (kept.target.facet >= 0)
      best = kept;
  }
  // Beside the surface (F5) and (F6) look at all ends within the radius
  best.target.decided = best.target.facet < 0 ? INFINITY : best.cost;
  if (best.target.facet < 0 and _options.rule != TargetRule::proximity)
    _end_tree.descend(
        [&](const Box<D>& box, int node)
        {
          const double aside = _options.end_tolerance * _largest;
          const bool none
              = not _end_normals.empty()
                and not may_lead_to<D>(q.x, box, _end_normals[node], aside, _options.radius);
          return none ? INFINITY : bound(box, q, aside);
        },
        [&](int i)
        {
          best_of(q, at_end(q, _at_end[i]), best);
          return _options.radius; // keys are distances along the direction, costs beside it
        },
        _options.radius);

  if (best.target.facet >= 0 and not within_end(q, best.target))
    best.target = {-1, Vector<Q>::Zero(), Clamp::none, 0, best.target.decided};
  return best.target;
}

template class Search<2>;
template class Search<3>;

} // namespace dolfinx_contact
