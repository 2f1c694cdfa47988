// SPDX-License-Identifier: MIT
//
// Random convex polygons cut out of each other, degenerate ones among them.
// DOLFINX_CONTACT_CAMPAIGN sets the number of pairs.
#include "../integration/convex.h"
#include "facets.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <iostream>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

using Point = Eigen::Vector2d;

int campaign(int usual)
{
  const char* number = std::getenv("DOLFINX_CONTACT_CAMPAIGN");
  return number ? std::atoi(number) : usual;
}

/// Corners of the convex hull, counter-clockwise; `collinear` keeps points on its edges.
Polygon hull(std::vector<Point> p, bool collinear)
{
  auto before = [](const Point& a, const Point& b)
  { return a[0] < b[0] or (a[0] == b[0] and a[1] < b[1]); };
  std::sort(p.begin(), p.end(), before);
  p.erase(std::unique(p.begin(), p.end()), p.end());
  std::vector<Point> lower, upper;
  auto walk = [&](std::vector<Point>& side, const Point& q)
  {
    auto turns = [&]
    {
      const std::size_t n = side.size();
      const double c = Polygon::cross(side[n - 1] - side[n - 2], q - side[n - 1]);
      return collinear ? c >= 0 : c > 0;
    };
    while (side.size() >= 2 and not turns())
      side.pop_back();
    side.push_back(q);
  };
  for (const Point& q : p)
    walk(lower, q);
  for (auto q = p.rbegin(); q != p.rend(); ++q)
    walk(upper, *q);
  lower.pop_back();
  upper.pop_back();
  lower.insert(lower.end(), upper.begin(), upper.end());
  return {lower};
}

/// Generic ones, corners on a small lattice (common edges and corners), needles, tiny ones.
Polygon draw(std::mt19937& random)
{
  const int kind = random() % 5, n = 3 + random() % 5;
  const bool collinear = random() % 2;
  const Point o = uniform_vector<2>(random, -1, 1), a = uniform_vector<2>(random, -1, 1);
  const double thin = std::pow(10, uniform(random, -12, 0)),
               tiny = std::pow(10, uniform(random, -6, 0));
  std::vector<Point> p;
  for (int i = 0; i < n; ++i)
    switch (kind)
    {
    case 0:
    case 1:
      p.push_back(Point(random() % 5, random() % 5) / 4 - Point(0.5, 0.5));
      break;
    case 2: // along a line
      p.push_back(o + uniform(random, -1, 1) * a + thin * uniform_vector<2>(random, -1, 1));
      break;
    case 3:
      p.push_back(0.3 * o + tiny * uniform_vector<2>(random, -1, 1));
      break;
    default:
      p.push_back(0.3 * o + uniform_vector<2>(random, -1, 1));
    }
  return hull(p, collinear);
}

/// A neighbour of p: the same one, its mirror image beyond one of its edges, one corner moved by
/// about round-off, or anything else.
Polygon neighbour(const Polygon& p, std::mt19937& random)
{
  const int kind = random() % 6;
  if (p.corners.size() < 3 or kind > 2)
    return draw(random);
  Polygon q = p;
  if (kind == 1)
  {
    const std::size_t i = random() % p.corners.size();
    const Point a = p.corners[i], b = p.corners[(i + 1) % p.corners.size()];
    const Point t = (b - a).normalized();
    for (Point& x : q.corners)
      x = 2 * (a + t * t.dot(x - a)) - x;
    std::reverse(q.corners.begin(), q.corners.end());
  }
  else if (kind == 2)
  {
    q.corners[random() % q.corners.size()] += std::pow(10, uniform(random, -17, -10)) * Point(1, 1);
    q = hull({q.corners.begin(), q.corners.end()}, true);
  }
  return q;
}

/// Area of the intersection, by integrating its height over x between all corners and crossings.
double overlap(const Polygon& P, const Polygon& Q)
{
  using real = long double;
  std::vector<real> at;
  auto edges = [](const Polygon& p, auto visit)
  {
    for (std::size_t i = 0; i < p.corners.size(); ++i)
      visit(p.corners[i], p.corners[(i + 1) % p.corners.size()]);
  };
  for (const Polygon* p : {&P, &Q})
    for (const Point& x : p->corners)
      at.push_back(x[0]);
  edges(P,
        [&](const Point& a, const Point& b)
        {
          edges(Q,
                [&](const Point& c, const Point& d)
                {
                  const real u0 = real(b[0]) - a[0], u1 = real(b[1]) - a[1], v0 = real(d[0]) - c[0],
                             v1 = real(d[1]) - c[1];
                  const real det = u0 * v1 - u1 * v0;
                  if (det == 0)
                    return;
                  const real t = ((real(c[0]) - a[0]) * v1 - (real(c[1]) - a[1]) * v0) / det;
                  if (t > 0 and t < 1)
                    at.push_back(a[0] + t * u0);
                });
        });
  std::sort(at.begin(), at.end());
  // bottom and top of a polygon at x
  auto range = [&](const Polygon& p, real x)
  {
    real lo = INFINITY, hi = -INFINITY;
    edges(p,
          [&](const Point& a, const Point& b)
          {
            if ((a[0] <= x) == (b[0] <= x))
              return;
            const real y = a[1] + (x - a[0]) / (real(b[0]) - a[0]) * (real(b[1]) - a[1]);
            lo = std::min(lo, y);
            hi = std::max(hi, y);
          });
    return std::pair(lo, hi);
  };
  real area = 0;
  for (std::size_t i = 1; i < at.size(); ++i)
  {
    const real x = (at[i - 1] + at[i]) / 2;
    const auto [a, b] = range(P, x);
    const auto [c, d] = range(Q, x);
    const real height = std::min(b, d) - std::max(a, c);
    if (height > 0)
      area += (at[i] - at[i - 1]) * height;
  }
  return static_cast<double>(area);
}

double size_of(const Polygon& p)
{
  double d = 0;
  for (const Point& a : p.corners)
    for (const Point& b : p.corners)
      d = std::max(d, (a - b).norm());
  return d;
}

double extent(const Polygon& p)
{
  double d = 0;
  for (const Point& a : p.corners)
    d = std::max(d, a.norm());
  return d;
}

} // namespace

TEST_CASE("convex: parts of random polygon pairs add up, and overlap as they should")
{
  std::mt19937 random(3);
  const int pairs = campaign(3000);
  int overlapping = 0;
  double worst_sum = 0, worst_overlap = 0;
  for (int i = 0; i < pairs; ++i)
  {
    const Polygon P = draw(random), Q = neighbour(P, random);
    if (P.empty() or Q.empty())
      continue;
    std::vector<Polygon> rest, other;
    const Polygon inside = P.cut(Q, rest);
    double sum = inside.measure();
    for (const Polygon& r : rest)
    {
      sum += r.measure();
      REQUIRE(r.signed_area() > 0);
    }
    const double area = overlap(P, Q);
    // coordinates have an error of ε × extent: areas one of ε × extent × size
    const double unit = eps * std::max(extent(P), extent(Q)) * std::max(size_of(P), size_of(Q));
    worst_sum = std::max(worst_sum, std::abs(sum - P.measure()) / unit);
    worst_overlap = std::max({worst_overlap, std::abs(inside.measure() - area) / unit,
                              std::abs(Q.cut(P, other).measure() - area) / unit});
    overlapping += area > 1e-12;
    CAPTURE(i);
    REQUIRE(std::abs(sum - P.measure()) / unit <= 50);
    REQUIRE(std::abs(inside.measure() - area) / unit <= 50);
    REQUIRE(std::abs(Q.cut(P, other).measure() - area) / unit <= 50);
  }
  REQUIRE(overlapping > pairs / 4);
  if (std::getenv("DOLFINX_CONTACT_CAMPAIGN"))
    std::cout << pairs << " pairs: worst error of the sum " << worst_sum << ", of the overlap "
              << worst_overlap << " (units of round-off)\n";
}

TEST_CASE("convex: a polygon is divided along any others")
{
  std::mt19937 random(4);
  for (int i = 0; i < campaign(3000) / 10; ++i)
  {
    const Polygon P = draw(random);
    if (P.measure() < 1e-6)
      continue;
    std::vector<Polygon> others(random() % 6);
    for (Polygon& q : others)
      q = neighbour(P, random);
    std::erase_if(others, [](const Polygon& q) { return not(q.measure() > 1e-12); });
    std::vector<Part<Polygon>> parts;
    divide<Polygon>(P, others, parts);
    double sum = 0;
    for (const auto& [set, other] : parts)
    {
      sum += set.measure();
      Point centre = Point::Zero();
      for (const Point& x : set.corners)
        centre += x / set.corners.size();
      // where the part is thicker than round-off, its centre is in one of the others or in none
      if (set.measure() < 1e-9)
        continue;
      auto inside = [&](const Polygon& q, double margin)
      {
        for (std::size_t k = 0; k < q.corners.size(); ++k)
        {
          const Point &a = q.corners[k], &b = q.corners[(k + 1) % q.corners.size()];
          if (Polygon::cross((b - a).normalized(), centre - a) < margin)
            return false;
        }
        return true;
      };
      for (int k = 0; k < static_cast<int>(others.size()); ++k)
        if (k == other)
          REQUIRE(inside(others[k], -1e-12));
        else if (other < 0 or k < other) // the first one counts
          REQUIRE(not inside(others[k], 1e-12));
    }
    CAPTURE(i, parts.size());
    REQUIRE(std::abs(sum - P.measure()) <= 1e-13 * std::max(1.0, size_of(P)));
  }
}

TEST_CASE("convex: an interval is divided along any others")
{
  std::mt19937 random(5);
  for (int i = 0; i < 2000; ++i)
  {
    std::vector<Interval> others(random() % 5);
    for (Interval& o : others)
    {
      o = {uniform(random, -0.5, 1), uniform(random, 0, 1.5)};
      if (random() % 3 == 0)
        o.lo = random() % 5 / 4.0;
      if (random() % 3 == 0)
        o.hi = o.lo + random() % 5 / 4.0;
    }
    std::erase_if(others, [](const Interval& o) { return o.empty(); });
    std::vector<Part<Interval>> parts;
    divide<Interval>({0, 1}, others, parts);
    double sum = 0;
    for (const auto& [set, other] : parts)
    {
      REQUIRE(set.measure() > 0);
      REQUIRE((set.lo >= 0 and set.hi <= 1));
      sum += set.measure();
      const double centre = 0.5 * (set.lo + set.hi);
      for (int k = 0; k < static_cast<int>(others.size()); ++k)
      {
        const bool in = others[k].lo < centre and centre < others[k].hi;
        if (k == other)
          REQUIRE(in);
        else if (k < other or other < 0)
          REQUIRE(not in);
      }
    }
    REQUIRE(std::abs(sum - 1) <= 10 * eps);
  }
}
