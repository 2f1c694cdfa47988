// SPDX-License-Identifier: MIT
//
// Where targets stop: at physical ends, at the search radius and at facets that are refused.
#include "../targets/search.h"
#include "facets.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

// The overshoot at which targets are lost is the tolerance times the facet's diameter
template <int D>
void lets_go_beyond_ends(const Element& element, TargetRule rule)
{
  CAPTURE(element.text(), static_cast<int>(rule));
  const int n = 4;
  const Surface s = plate<D>(element, n);
  const Search<D> search(s, options<D>(rule));
  const double reach = 0.5 * s.diameter(0); // all facets alike
  const Vector<D> outward = -Vector<D>::Unit(D - 1);
  for (double gap : {-0.07, 0.0, 0.07})
    for (double side : {-1.0, 1.0}) // the ends x = 0 and x = 1, not at a node
    {
      Vector<D> end = Vector<D>::Constant(0.45);
      end[0] = 0.5 + 0.5 * side;
      end[D - 1] = 0;
      auto find = [&](double overshoot)
      {
        Vector<D> x = end;
        x[0] += side * overshoot;
        x[D - 1] = gap;
        return search.find(s, seeker<D>(rule, x, outward), {});
      };
      CAPTURE(gap, side);
      for (double overshoot : {1e-3, 0.5 * reach, (1 - 1e-9) * reach})
      {
        const Target<D> t = find(overshoot);
        REQUIRE(t.facet >= 0);
        REQUIRE(t.clamp == (D == 2 ? Clamp::vertex : Clamp::edge));
        REQUIRE((position(s, t) - end).norm() <= 10 * eps);
      }
      for (double overshoot : {(1 + 1e-9) * reach, 2 * reach, 10.0})
        REQUIRE(find(overshoot).facet == -1);
      const Target<D> inner = find(-0.1 / n);
      REQUIRE(inner.facet >= 0);
      REQUIRE(inner.clamp == Clamp::none);
    }
}

// A convex rim: beyond its corners every facet of the corner holds the closest point, also those
// that touch the rim with that corner only
void lets_go_beyond_corners(const Element& element)
{
  CAPTURE(element.text());
  const int n = 3;
  for (unsigned seed = 1; seed <= 10; ++seed)
  {
    // the square, swollen to a disc of radius 1/2 around (1/2, 1/2)
    const Surface s = plate<3>(element, n, seed,
                               [](const Eigen::Vector3d& p)
                               {
                                 const Eigen::Vector3d q(p[0] - 0.5, p[1] - 0.5, 0);
                                 const double l = q.norm();
                                 const double m = q.lpNorm<Eigen::Infinity>();
                                 const Eigen::Vector3d c(0.5, 0.5, 0);
                                 return Vector<3>(l > 0 ? Eigen::Vector3d(c + m / l * q) : c);
                               });
    const Search<3> search(s, options<3>(TargetRule::proximity));
    int corners = 0;
    for (int f = 0; f < s.size(); ++f)
      for (int v = 0; v < s.nv(); ++v)
      {
        const Eigen::Map<const Vector<3>> corner(s.facet_x(f) + 3 * v);
        const Vector<3> radius = corner - Vector<3>(0.5, 0.5, 0);
        if (radius.norm() < 0.5 - 1e-9)
          continue;
        ++corners;
        const Vector<3> outward(0, 0, -1);
        const Vector<3> up(0, 0, 0.01);
        const Target<3> near = search.find(s, {corner + 0.1 * radius + up, outward}, {});
        REQUIRE(near.facet >= 0);
        REQUIRE((position(s, near) - corner).norm() <= 10 * eps);
        for (double overshoot : {3.0, 10.0}) // facets are smaller than 1/2
          REQUIRE(search.find(s, {corner + overshoot * radius + up, outward}, {}).facet == -1);
      }
    REQUIRE(corners >= 4 * n);
  }
}

} // namespace

TEMPLATE_TEST_CASE_SIG("search: clamped a little beyond an end, no target farther out", "",
                       ((int D), D), 2, 3)
{
  for (const Element& element : elements<D>())
    for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
      lets_go_beyond_ends<D>(element, rule);
}

TEST_CASE("search: corners of a rim are ends for all facets that touch them")
{
  for (Shape shape : {Shape::triangle, Shape::quadrilateral}) // a curved rim has no corners
    lets_go_beyond_corners({shape, 1, 1});
}

TEST_CASE("search: directions that graze all facets, candidates and radius")
{
  Surface s = plate<2>({Shape::interval, 1, 1}, 4);
  SearchOptions<2> o = options<2>(TargetRule::direction);
  Seeker<2> grazing{{0.4, 0.01}, {0, -1}, Vector<2>(1, -0.09).normalized()}; // |e·n| < 0.1
  REQUIRE(Search<2>(s, o).find(s, grazing, {}).facet == -1);
  grazing.e = Vector<2>(1, -0.11).normalized();
  REQUIRE(Search<2>(s, o).find(s, grazing, {}).facet >= 0);

  for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
  {
    o = options<2>(rule);
    o.radius = 0.1;
    const Search<2> search(s, o);
    for (double side : {-1.0, 1.0})
    {
      REQUIRE(search.find(s, seeker<2>(rule, {0.4, side * 0.0999}, {0, -1}), {}).facet >= 0);
      REQUIRE(search.find(s, seeker<2>(rule, {0.4, side * 0.1001}, {0, -1}), {}).facet == -1);
    }
    Target<2> former;
    former.facet = 0; // a warm start does not reach farther
    REQUIRE(search.find(s, seeker<2>(rule, {0.4, 0.1001}, {0, -1}), former).facet == -1);
  }

  // facets whose ring is not here are no targets
  const Search<2> search(s, options<2>(TargetRule::proximity));
  const int first = search.find(s, {{0.4, 0.01}, {0, -1}}, {}).facet;
  s.candidate[first] = 0;
  const int second = search.find(s, {{0.4, 0.01}, {0, -1}}, {}).facet;
  REQUIRE(second >= 0);
  REQUIRE(second != first);
}

TEST_CASE("search: targets follow a moving master after refit")
{
  for (TargetRule rule : {TargetRule::proximity, TargetRule::direction})
  {
    Surface s = plate<3>({Shape::quadrilateral, 2, 2}, 5);
    Search<3> search(s, options<3>(rule));
    std::vector<double> u(s.node_table.size() * 3);
    for (std::size_t i = 0; i < u.size(); i += 3)
      u[i + 1] = 3; // away from where its boxes were
    s.displace(u);
    search.refit(s);
    const Vector<3> x(0.43, 3.28, 0.2), foot(0.43, 3.28, 0);
    const Target<3> t = search.find(s, seeker<3>(rule, x, {0, 0, -1}), {});
    REQUIRE(t.facet >= 0);
    REQUIRE((position(s, t) - foot).norm() <= 20 * eps);
  }
}
