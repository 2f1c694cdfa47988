// SPDX-License-Identifier: MIT
//
// Which facet holds the target where several could: at junctions, ridges and vertices, and on the
// two sides of a thin body.
#include "../targets/search.h"
#include "facets.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <numbers>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// The same facets in another order.
Surface reordered(const Surface& s, std::mt19937& random)
{
  std::vector<int> order(s.size());
  for (int f = 0; f < s.size(); ++f)
    order[f] = f;
  for (int f = s.size() - 1; f > 0; --f)
    std::swap(order[f], order[random() % (f + 1)]);
  Surface out = s;
  auto move = [&](auto& to, const auto& from)
  {
    const std::size_t width = from.size() / s.size();
    for (int f = 0; f < s.size(); ++f)
      std::copy_n(from.begin() + order[f] * width, width, to.begin() + f * width);
  };
  move(out.id, s.id);
  move(out.vertices, s.vertices);
  move(out.nodes, s.nodes);
  move(out.X, s.X);
  move(out.sigma, s.sigma);
  move(out.ends, s.ends);
  out.number_nodes();
  return out;
}

// Sliding over a junction of flat facets: the former facet is kept within the margin
template <int D>
void keeps_the_former_facet(const Element& element, TargetRule rule)
{
  CAPTURE(element.text(), static_cast<int>(rule));
  const Surface s = plate<D>(element, 2);
  SearchOptions<D> o = options<D>(rule);
  o.margin = 0.02;
  const Search<D> search(s, o);
  const Vector<D> outward = -Vector<D>::Unit(D - 1);
  const double h = 0.5; // size of a facet: ξ runs over it
  for (double direction : {1.0, -1.0})
  {
    auto at = [&](double overshoot, const Target<D>& former)
    {
      Vector<D> x = Vector<D>::Constant(0.2);
      x[0] = 0.5 + direction * overshoot * h;
      x[D - 1] = 0.05;
      return search.find(s, seeker<D>(rule, x, outward), former);
    };
    const Target<D> former = at(-0.1, {}), other = at(0.1, {});
    REQUIRE(former.facet >= 0);
    REQUIRE(other.facet >= 0);
    REQUIRE(former.facet != other.facet);
    Target<D> sliding = former;
    for (double overshoot : {-0.01, 0.0, 0.01, 0.0199})
    {
      CAPTURE(direction, overshoot);
      sliding = at(overshoot, sliding);
      REQUIRE(sliding.facet == former.facet);
      REQUIRE(sliding.clamp == Clamp::none); // extrapolated
      Vector<D> foot = Vector<D>::Constant(0.2);
      foot[0] = 0.5 + direction * overshoot * h;
      foot[D - 1] = 0;
      REQUIRE((position(s, sliding) - foot).norm() <= 20 * eps);
    }
    REQUIRE(at(0.01, {}).facet == other.facet); // without a former one it is the right one
    sliding = at(0.0201, sliding);
    REQUIRE(sliding.facet == other.facet);
    REQUIRE(at(-0.0199, sliding).facet == other.facet); // and back, likewise
    REQUIRE(at(-0.0201, sliding).facet == former.facet);
  }
}

} // namespace

TEMPLATE_TEST_CASE_SIG("search: the former facet is kept within the margin", "", ((int D), D), 2, 3)
{
  for (const Element& element : elements<D>())
    for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
      keeps_the_former_facet<D>(element, rule);
}

TEST_CASE("search: at an inner ridge the former facet is kept")
{
  // a roof: over its ridge the closest point is the ridge, of both slopes
  for (int degree : {1, 2})
  {
    const Surface s
        = plate<2>({Shape::interval, degree, degree}, 2, 1,
                   [](const Eigen::Vector3d& p) { return Vector<2>(p[0], -std::abs(p[0] - 0.5)); });
    const Search<2> search(s, options<2>(TargetRule::proximity));
    const Vector<2> outward(0, -1);
    const Target<2> left = search.find(s, {{0.4, 0}, outward}, {}),
                    right = search.find(s, {{0.6, 0}, outward}, {});
    REQUIRE(std::min(left.facet, right.facet) == 0);
    REQUIRE(std::max(left.facet, right.facet) == 1);
    for (double x : {0.47, 0.5, 0.53}) // normals of both facets see it: the wedge is ±0.1
    {
      const Target<2> l = search.find(s, {{x, 0.1}, outward}, left),
                      r = search.find(s, {{x, 0.1}, outward}, right);
      REQUIRE(l.facet == left.facet);
      REQUIRE(r.facet == right.facet);
      for (const Target<2>& t : {l, r})
      {
        REQUIRE(t.clamp == Clamp::vertex);
        REQUIRE((position(s, t) - Vector<2>(0.5, 0)).norm() <= 4 * eps);
      }
    }
    REQUIRE(search.find(s, {{0.65, 0.1}, outward}, left).facet == right.facet);
  }
}

TEST_CASE("search: ties go to the lowest global facet number")
{
  for (Shape shape : {Shape::triangle, Shape::quadrilateral})
  {
    // a convex polyhedron: above a vertex all its facets hold the closest point
    std::mt19937 random(5);
    const Surface s = build<3>(
        reference_facet(shape, 1, 1), cube_cells(shape, 3),
        [](const Eigen::Vector3d& p) { return Vector<3>(p.normalized()); },
        [](const Vector<3>& x) { return Vector<3>(-x); }, random);
    for (int trial = 0; trial < 5; ++trial)
    {
      const Surface t = reordered(s, random);
      const Search<3> search(t, options<3>(TargetRule::proximity));
      for (int k = 0; k < t.size() * t.nv(); ++k)
      {
        const Vector<3> corner
            = Eigen::Map<const Vector<3>>(t.facet_x(k / t.nv()) + 3 * (k % t.nv()));
        std::int64_t lowest = std::numeric_limits<std::int64_t>::max();
        int around = 0;
        for (std::size_t j = 0; j < t.vertices.size(); ++j)
          if (t.vertices[j] == t.vertices[k])
          {
            ++around;
            lowest = std::min(lowest, t.id[j / t.nv()]);
          }
        REQUIRE(around >= 3);
        const Target<3> found = search.find(t, {1.2 * corner, -corner}, {});
        REQUIRE(found.facet >= 0);
        REQUIRE((position(t, found) - corner).norm() <= 10 * eps);
        REQUIRE(t.id[found.facet] == lowest);
      }
    }
  }
}

TEST_CASE("search: the far side of a thin body is refused")
{
  // a lens, 0.02 thick, penetrated from above beyond its middle
  for (int degree : {1, 2})
    for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
    {
      std::mt19937 random(6);
      const Surface s = build<2>(
          reference_facet(Shape::interval, degree, degree), line_cells(40),
          [](const Eigen::Vector3d& p)
          {
            const double angle = 2 * std::numbers::pi * p[0];
            return Vector<2>(std::cos(angle), 0.01 * std::sin(angle));
          },
          [](const Vector<2>& x) { return Vector<2>(-x[0], -1e4 * x[1]); }, random);
      const Search<2> search(s, options<2>(rule));
      for (double x : {-0.5, 0.0, 0.3})
        for (double depth : {-0.008, -0.05})
        {
          const Target<2> top = search.find(s, seeker<2>(rule, {x, depth}, {0, -1}), {}),
                          bottom = search.find(s, seeker<2>(rule, {x, depth}, {0, 1}), {});
          CAPTURE(degree, static_cast<int>(rule), x, depth);
          REQUIRE(top.facet >= 0);
          REQUIRE(bottom.facet >= 0);
          REQUIRE(position(s, top)[1] > 0.005);
          REQUIRE(position(s, bottom)[1] < -0.005);
        }
    }
  const Surface s = plate<2>({Shape::interval, 1, 1}, 4);
  for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
  {
    const Search<2> search(s, options<2>(rule));
    REQUIRE(search.find(s, seeker<2>(rule, {0.4, 0.01}, {0, -1}), {}).facet >= 0);
    REQUIRE(search.find(s, seeker<2>(rule, {0.4, 0.01}, {0, 1}), {}).facet == -1);
  }
}
