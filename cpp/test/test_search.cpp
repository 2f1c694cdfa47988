// SPDX-License-Identifier: MIT
//
// Targets against brute force on all facets: dense sampling, then a local optimisation that shares
// nothing with the code under test.
#include "../targets/search.h"
#include "facets.h"

#include <catch2/catch.hpp>
#include <numbers>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

template <int D>
struct Brute
{
  static constexpr int Q = D - 1, n = 8; // samples per direction
  const Surface& s;
  std::vector<Vector<Q>> xi;
  std::vector<Vector<D>> x;  // (facets, samples)
  std::vector<double> reach; // no point of a facet is farther from its nearest sample

  explicit Brute(const Surface& s)
      : s(s)
  {
    for (int j = 0; j <= (Q == 2 ? n : 0); ++j)
      for (int i = 0; i <= (s.ref.shape == Shape::triangle ? n - j : n); ++i)
      {
        const Eigen::Vector2d p(i / double(n), j / double(n));
        xi.push_back(p.head<Q>());
      }
    for (int f = 0; f < s.size(); ++f)
    {
      double longest = 0;
      for (const Vector<Q>& p : xi)
      {
        const FacetPoint<D> point = FacetProjection<D>(s, f).at(p, false);
        x.push_back(point.x);
        longest = std::max(longest, point.tau.colwise().norm().sum());
      }
      reach.push_back(longest / n);
    }
  }

  bool inside(const Vector<Q>& p, double tol) const
  {
    return p.minCoeff() >= -tol and p.maxCoeff() <= 1 + tol
           and (s.ref.shape != Shape::triangle or p.sum() <= 1 + tol);
  }

  bool faces(int f, const Vector<Q>& p, const Vector<D>& outward) const
  {
    const FacetProjection<D> facet(s, f);
    return facet.normal(facet.at(p, false)).dot(outward) >= 0;
  }

  /// Closest point of facet f by compass search, with directions along all edges.
  double closest(int f, const Vector<D>& y, Vector<Q> p, double d, Vector<Q>& best) const
  {
    static const Eigen::Vector2d all[]
        = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}};
    const FacetProjection<D> facet(s, f);
    for (double h = 0.5 / n; h > 1e-12;)
    {
      bool better = false;
      for (int k = 0; k < (Q == 1 ? 2 : 8); ++k)
      {
        const Vector<Q> trial = p + h * all[k].head<Q>();
        if (not inside(trial, 0))
          continue;
        if (const double e = (y - facet.at(trial, false).x).norm(); e < d)
        {
          d = e;
          p = trial;
          better = true;
        }
      }
      if (not better)
        h *= 0.5;
    }
    best = p;
    return d;
  }

  /// Distance of the closest points of all facing facets.
  double proximity(const Vector<D>& y, const Vector<D>& outward) const
  {
    double best = INFINITY;
    for (int f = 0; f < s.size(); ++f)
    {
      double d = INFINITY;
      Vector<Q> start, p;
      for (std::size_t k = 0; k < xi.size(); ++k)
        if (const double e = (y - x[f * xi.size() + k]).norm(); e < d)
        {
          d = e;
          start = xi[k];
        }
      if (d - reach[f] > best)
        continue;
      d = closest(f, y, start, d, p);
      if (d < best and faces(f, p, outward))
        best = d;
    }
    return best;
  }

  /// Smallest |s| at which y + s e meets a facing facet that it does not graze.
  double direction(const Vector<D>& y, const Vector<D>& e, const Vector<D>& outward) const
  {
    double best = INFINITY;
    for (int f = 0; f < s.size(); ++f)
      for (std::size_t k = 0; k < xi.size(); ++k)
      {
        const Vector<D> r = y - x[f * xi.size() + k];
        if ((r - r.dot(e) * e).norm() > reach[f])
          continue;
        const FacetProjection<D> facet(s, f);
        Vector<Q> p = xi[k];
        for (int it = 0; it < 20; ++it)
        {
          const FacetPoint<D> q = facet.at(p, false);
          Eigen::Matrix<double, D, D> A;
          A << q.tau, -e;
          const Vector<D> d = A.fullPivLu().solve(y - q.x);
          p += d.template head<Q>();
        }
        const FacetPoint<D> q = facet.at(p, false);
        const Vector<D> left = y - q.x;
        if ((left - left.dot(e) * e).norm() > 1e-12)
          continue;
        const double slope = std::abs(facet.normal(q).dot(e));
        if (slope >= 0.1 and inside(p, 1e-10) and faces(f, p, outward))
          best = std::min(best, left.norm());
      }
    return best;
  }
};

/// Size of the facets is about 0.3 (2D: 0.2), everything bumps by a few percent.
template <int D>
Surface test_surface(const Element& element, bool closed, std::mt19937& random)
{
  using Map = std::function<Vector<D>(const Eigen::Vector3d&)>;
  using Side = std::function<Vector<D>(const Vector<D>&)>;
  const Map wave = [](const Eigen::Vector3d& p)
  {
    Vector<D> x = p.head<D>();
    x[D - 1] = 0.1 * std::sin(4 * p[0] + 3 * p[1]);
    return x;
  };
  const Map round = [](const Eigen::Vector3d& p)
  {
    const double angle = 2 * std::numbers::pi * p[0];
    const Eigen::Vector3d x
        = D == 2 ? Eigen::Vector3d(std::cos(angle), std::sin(angle), 0) : p.normalized().eval();
    return Vector<D>(x.head<D>());
  };
  const Side below = [](const Vector<D>&) { return Vector<D>(-Vector<D>::Unit(D - 1)); };
  const Side centre = [](const Vector<D>& x) { return Vector<D>(-x); };
  Cells cells;
  if (D == 2)
    cells = line_cells(closed ? 31 : 5);
  else
    cells = closed ? cube_cells(element.shape, 4) : square_cells(element.shape, 4);
  Surface s
      = build<D>(element.ref(), cells, closed ? round : wave, closed ? centre : below, random);
  s.displace(random_displacement(s, 0.01, random));
  return s;
}

/// A point near the surface and the slave's outward normal there: against the master's most often.
template <int D>
std::pair<Vector<D>, Vector<D>> particle(const Surface& s, std::mt19937& random)
{
  const int f = random() % s.size();
  Vector<D - 1> xi = uniform_vector<D - 1>(random, 0, 1);
  if (s.ref.shape == Shape::triangle and xi.sum() > 1)
    xi = Vector<D - 1>::Ones() - xi;
  const FacetProjection<D> facet(s, f);
  const FacetPoint<D> p = facet.at(xi, false);
  const Vector<D> n = facet.normal(p);
  const double distance = uniform(random, -0.25, 0.25);
  const Vector<D> aside = uniform_vector<D>(random, -0.1, 0.1);
  const Vector<D> noise = uniform_vector<D>(random, -1, 1);
  return {p.x + distance * n + aside, (n + (random() % 4 ? 0.3 : 3.0) * noise).normalized()};
}

// Orthogonality, or optimality among the points of the facet if clamped
template <int D>
void check_closest(const Surface& s, const Target<D>& t, const Vector<D>& x)
{
  constexpr int Q = D - 1;
  const Shape shape = s.ref.shape;
  const FacetProjection<D> facet(s, t.facet);
  const FacetPoint<D> p = facet.at(t.xi, false);
  const Vector<Q> slope = p.tau.transpose() * (x - p.x); // −½ grad of the distance squared
  CAPTURE(t.facet, t.xi.transpose(), static_cast<int>(t.clamp), slope.transpose());
  REQUIRE(facet.outside(t.xi) <= 1e-8); // what counts as inside
  if (t.clamp == Clamp::none)
    REQUIRE(slope.norm() <= 1e-12);
  if (t.clamp == Clamp::edge)
    REQUIRE(std::abs(slope.dot(facet.edge_direction(shape, t.edge))) <= 1e-12);
  if (t.clamp != Clamp::none) // no way into the facet shortens it
    for (int v = 0; v < num_vertices(shape); ++v)
      REQUIRE(slope.dot(facet.vertex(shape, v) - t.xi) <= 1e-12);
}

template <int D>
void proximity_like_brute_force(bool closed)
{
  for (const Element& element : elements<D>())
  {
    std::mt19937 random(21);
    const Surface s = test_surface<D>(element, closed, random);
    const Brute<D> brute(s);
    SearchOptions<D> o;
    o.end_tolerance = 100; // ends have their own test
    o.radius = 0.2;
    const Search<D> search(s, o);
    o.radius = INFINITY;
    const Search<D> unbounded(s, o);
    int near = 0, far = 0, clamped = 0;
    for (int i = 0; i < 300; ++i)
    {
      const auto [x, outward] = particle<D>(s, random);
      CAPTURE(element.text(), closed, i, x.transpose(), outward.transpose());
      const double expected = brute.proximity(x, outward);
      const Target<D> t = unbounded.find(s, {x, outward}, {}), u = search.find(s, {x, outward}, {});
      REQUIRE((t.facet >= 0) == std::isfinite(expected));
      REQUIRE((u.facet >= 0) == (expected <= 0.2));
      if (u.facet >= 0)
        REQUIRE(u.facet == t.facet);
      (u.facet >= 0 ? near : far)++;
      if (t.facet < 0)
        continue;
      const FacetPoint<D> p = FacetProjection<D>(s, t.facet).at(t.xi, false);
      REQUIRE(std::abs((x - p.x).norm() - expected) <= 1e-9); // of the compass search
      REQUIRE(FacetProjection<D>(s, t.facet).normal(p).dot(outward) >= 0);
      check_closest<D>(s, t, x);
      clamped += t.clamp != Clamp::none;

      // a warm start, from anywhere, finds no other distance (but for the margin: here none)
      SearchOptions<D> strict = o;
      strict.margin = 0;
      Target<D> former;
      former.facet = random() % s.size();
      former.xi.setConstant(0.3);
      const Target<D> warm = Search<D>(s, strict).find(s, {x, outward}, former);
      REQUIRE(warm.facet >= 0);
      const Vector<D> y = FacetProjection<D>(s, warm.facet).at(warm.xi, false).x;
      REQUIRE(std::abs((x - y).norm() - expected) <= 1e-9);
    }
    REQUIRE(near > 100);
    REQUIRE(far > 10);
    REQUIRE(clamped > 10);
  }
}

template <int D>
void direction_like_brute_force(bool closed)
{
  for (const Element& element : elements<D>())
  {
    std::mt19937 random(22);
    const Surface s = test_surface<D>(element, closed, random);
    const Brute<D> brute(s);
    int hits = 0, misses = 0;
    for (int i = 0; i < 400; ++i)
    {
      const auto [x, outward] = particle<D>(s, random);
      SearchOptions<D> o;
      o.rule = TargetRule::direction;
      Vector<D> e = (outward + uniform_vector<D>(random, -0.8, 0.8)).normalized();
      if (i % 2)
        e *= -1; // (F5) looks both ways
      const double expected = brute.direction(x, e, outward);
      const Target<D> t = Search<D>(s, o).find(s, {x, outward, e}, {});
      CAPTURE(element.text(), closed, i, x.transpose(), outward.transpose(), expected, t.facet);
      if (std::isfinite(expected))
      {
        ++hits;
        REQUIRE(t.facet >= 0);
        REQUIRE(t.clamp == Clamp::none);
        const Vector<D> r = x - FacetProjection<D>(s, t.facet).at(t.xi, false).x;
        REQUIRE((r - r.dot(e) * e).norm() <= 1e-12);
        REQUIRE(std::abs(r.norm() - expected) <= 1e-9);
      }
      else // no target but, a little beside the surface, its end
      {
        ++misses;
        if (t.facet >= 0)
        {
          REQUIRE(t.clamp != Clamp::none);
          REQUIRE(s.ends[t.facet] != 0); // closed surfaces have none
        }
      }
    }
    REQUIRE(hits > 100);
    REQUIRE(misses > 5);
  }
}

} // namespace

TEST_CASE("search: closest points like brute force")
{
  const bool closed = GENERATE(false, true);
  proximity_like_brute_force<2>(closed);
  proximity_like_brute_force<3>(closed);
}

TEST_CASE("search: seek directions like brute force")
{
  const bool closed = GENERATE(false, true);
  direction_like_brute_force<2>(closed);
  direction_like_brute_force<3>(closed);
}
