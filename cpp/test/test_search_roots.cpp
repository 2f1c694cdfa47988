// SPDX-License-Identifier: MIT
//
// Roots of cubics, and searches at odd places: far from the origin, with degenerate facets.
#include "../targets/search.h"
#include "facets.h"

#include <algorithm>
#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

std::vector<double> roots(const Cubic& p, double lo, double hi)
{
  std::vector<double> t;
  p.roots(lo, hi, [&](double r) { t.push_back(r); });
  return t;
}

} // namespace

TEST_CASE("Cubic: real roots of all degrees")
{
  std::mt19937 random(41);
  for (int i = 0; i < 1000; ++i)
  {
    const double scale = std::pow(10.0, uniform(random, -6, 6));
    std::array<double, 3> r;
    for (double& t : r)
      t = uniform(random, -1, 1);
    std::sort(r.begin(), r.end());
    if (r[1] - r[0] < 1e-3 or r[2] - r[1] < 1e-3)
      continue; // double roots are ill-posed
    const double a = r[0], b = r[1], c = r[2];
    const std::pair<Cubic, std::vector<double>> cases[]
        = {{{{-scale * a * b * c, scale * (a * b + b * c + c * a), -scale * (a + b + c), scale}},
            {a, b, c}},
           {{{scale * a * b, -scale * (a + b), scale, 0}}, {a, b}},
           {{{-scale * a, scale, 0, 0}}, {a}},
           {{{scale, 0, 0, 0}}, {}},
           {{{scale * (1 + a * a), -2 * scale * a, scale, 0}}, {}}};
    for (const auto& [p, expected] : cases)
    {
      const std::vector<double> found = roots(p, -2, 2);
      CAPTURE(i, scale, a, b, c);
      REQUIRE(found.size() == expected.size());
      for (std::size_t k = 0; k < found.size(); ++k)
        REQUIRE(std::abs(found[k] - expected[k]) <= 1e-10);
    }
  }
  REQUIRE(roots({{0, 1, 0, 0}}, 0, 1) == std::vector<double>{0}); // the ends count
  REQUIRE(roots({{-1, 1, 0, 0}}, 0, 1).size() == 1);
  // at the upper end, from below and from above, with and without stationary points before it
  for (const double sign : {-1.0, 1.0})
  {
    const double s = sign;
    REQUIRE(roots({{-s, s, 0, 0}}, 0, 1) == std::vector<double>{1});
    REQUIRE(roots({{-s, 0, s, 0}}, 0.5, 1) == std::vector<double>{1});
    REQUIRE(roots({{0, -s, s, 0}}, 0.25, 1) == std::vector<double>{1});
    REQUIRE(roots({{0, -s, 0, s}}, 0.25, 1) == std::vector<double>{1});
    REQUIRE(roots({{0, -s, s, 0}}, 0, 1) == std::vector<double>{0, 1});
    REQUIRE(roots({{0, -s, 0, s}}, -1, 1) == std::vector<double>{-1, 0, 1});
    REQUIRE(roots({{s, -2 * s, s, 0}}, 0, 1) == std::vector<double>{1}); // it touches zero there
  }
  REQUIRE(roots({{0.5, 1, 0, 0}}, 0, 1).empty());
}

TEMPLATE_TEST_CASE_SIG("search: far from the origin, and facets that have shrunk to a point", "",
                       ((int D), D), 2, 3)
{
  for (const Element& element : elements<D>())
    for (const TargetRule rule : {TargetRule::proximity, TargetRule::direction, TargetRule::smooth})
    {
      CAPTURE(element.text(), static_cast<int>(rule));
      Surface s = plate<D>(element, 4);
      SearchOptions<D> o;
      o.rule = rule;
      o.radius = 0.5;
      std::vector<double> u(s.node_table.size() * D, 1e4);
      s.displace(u);
      NodalNormals<D> normals(s, 3.1);
      Search<D> search(s, o);
      search.refit(s, &normals);
      Vector<D> foot = Vector<D>::Constant(1e4 + 0.43);
      foot[D - 1] = 1e4;
      const Vector<D> down = -Vector<D>::Unit(D - 1);
      const Seeker<D> seeker{foot - 0.1 * down, down, down};
      const Target<D> t = search.find(s, seeker, {}, &normals),
                      warm = search.find(s, seeker, t, &normals);
      REQUIRE(t.facet >= 0);
      REQUIRE((position(s, t) - foot).norm() <= 1e-10);
      REQUIRE(warm.facet == t.facet);

      std::fill(s.x.begin(), s.x.end(), 1.0);
      normals.update(s);
      Search<D> degenerate(s, o);
      for (const double x : {1.0, 1.1, std::numeric_limits<double>::quiet_NaN()})
      {
        const Seeker<D> lost{Vector<D>::Constant(x), down, down};
        REQUIRE_NOTHROW(degenerate.find(s, lost, {}, &normals));
        REQUIRE_NOTHROW(degenerate.find(s, lost, t, &normals));
      }
    }
}
