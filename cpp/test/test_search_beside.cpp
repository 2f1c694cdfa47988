// SPDX-License-Identifier: MIT
//
// Smooth targets of particles above a surface and beside it: bounds of the normals hide no target,
// and particles on no normal cost no search of the whole surface.
#include "../targets/search.h"
#include "facets.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// Part of the unit ball's surface (2D: circle) around a direction, its nodes moved at random.
/// @param opening of the parameters, 1 is a quarter of it or so
template <int D>
Surface cap(const Element& element, int n, double opening, std::mt19937& random)
{
  const Vector<D> axis = uniform_vector<D>(random, -1, 1).normalized();
  Eigen::Matrix<double, D, D> turn;
  for (int i = 0; i < D; ++i)
    for (int j = 0; j < D; ++j)
      turn(i, j) = uniform(random, -1, 1);
  turn.col(0) = axis;
  turn = Eigen::HouseholderQR<Eigen::Matrix<double, D, D>>(turn).householderQ();
  Surface s = build<D>(
      element.ref(), D == 2 ? line_cells(n) : square_cells(element.shape, n),
      [&](const Eigen::Vector3d& p)
      {
        Vector<D> x = Vector<D>::Ones();
        for (int i = 1; i < D; ++i)
          x[i] = opening * (2 * p[i - 1] - 1);
        return Vector<D>(turn * x.normalized());
      },
      [](const Vector<D>& x) { return Vector<D>(-x); }, random);
  s.displace(random_displacement(s, 0.15 * opening / n, random));
  return s;
}

/// A particle above the surface, below it, often near its ends, or somewhere.
template <int D>
Vector<D> place(const Surface& s, const NodalNormals<D>& normals, std::mt19937& random)
{
  if (random() % 4 == 0)
    return 1.5 * uniform_vector<D>(random, -1, 1);
  const bool near_end = random() % 2;
  int f = 0;
  do
    f = random() % s.size();
  while (near_end and s.ends[f] == 0);
  Vector<D - 1> xi = uniform_vector<D - 1>(random, -0.5, 1.5);
  if (random() % 3 == 0) // exactly on edges too
    xi = xi.cwiseMax(0).cwiseMin(1);
  return FacetProjection<D>(s, f).at(xi, false).x
         + uniform(random, -0.3, 0.3) * normals.at(s, f, xi.data()).M;
}

// With bounds of the normals the same targets are found as without, when the tree is searched by
// distance alone; and the nearest one of all facets, one by one
template <int D>
void same_as_without(const Element& element, double opening)
{
  std::mt19937 random(7);
  int inside = 0, at_ends = 0, none = 0;
  for (int sample = 0; sample < 10; ++sample)
  {
    Surface s = cap<D>(element, D == 2 ? 12 : 6, opening, random);
    s.candidate[random() % s.size()] = 0;
    const NodalNormals<D> normals(s, 3.1);
    SearchOptions<D> o = options<D>(TargetRule::smooth);
    o.radius = sample % 2 ? 0.25 : 10.0;
    o.end_tolerance = sample % 3 ? 0.5 : 0.01;
    const Search<D> plain(s, o);
    Search<D> bounded = plain;
    bounded.refit(s, &normals);
    Target<D> former;
    for (int i = 0; i < 100; ++i)
    {
      const Vector<D> x = place<D>(s, normals, random), noise = uniform_vector<D>(random, -1, 1);
      const Seeker<D> seeker{x, (-x + (i % 4 ? 0.3 : 2.0) * noise).normalized()};
      CAPTURE(element.text(), opening, sample, i, x.transpose());
      for (const Target<D>& start : {Target<D>(), former})
      {
        const Target<D> t = bounded.find(s, seeker, start, &normals),
                        u = plain.find(s, seeker, start, &normals);
        REQUIRE(t.facet == u.facet);
        REQUIRE(t.xi == u.xi);
        REQUIRE(t.clamp == u.clamp);
        REQUIRE(t.edge == u.edge);
        REQUIRE(t.decided == u.decided);
        former = t;
      }
      if (former.facet < 0)
        ++none;
      else
        ++(former.clamp == Clamp::none ? inside : at_ends);

      double nearest = INFINITY;
      for (int f = 0; f < s.size(); ++f)
        if (s.candidate[f])
          SmoothProjection<D>(s, f, normals)
              .solutions(x, FacetProjection<D>(s, f).start(x), o.radius,
                         [&](const Vector<D - 1>& xi, double d)
                         {
                           if (FacetProjection<D>(s, f).outside(xi) <= 1e-8
                               and std::abs(d) <= o.radius
                               and normals.at(s, f, xi.data()).M.dot(seeker.outward) >= 0)
                             nearest = std::min(nearest, std::abs(d));
                         });
      const Target<D> cold = bounded.find(s, seeker, {}, &normals);
      const bool unclamped = cold.facet >= 0 and cold.clamp == Clamp::none;
      CAPTURE(nearest);
      REQUIRE(unclamped == std::isfinite(nearest));
      if (unclamped)
        REQUIRE(std::abs((x - position(s, cold)).norm() - nearest) <= 1e-9);
    }
  }
  CAPTURE(element.text(), opening, inside, at_ends, none);
  CHECK(inside > 100);
  CHECK(at_ends > 20);
  CHECK(none > 100);
}

// Boxes and facets that a search by bounds of the normals looks at, at most, for particles beside
// the ends that no normal leads to
template <int D>
std::pair<int, int> looks_beside(const Element& element, int n)
{
  std::mt19937 random(3);
  const Surface s = cap<D>(element, n, 0.8, random);
  const NodalNormals<D> normals(s, 3.1);
  const BoxTree<D> tree(s.boxes());
  const std::vector<Box<D>> bounds = tree.bounds(normal_boxes(s, normals));
  int most_boxes = 0, most_facets = 0;
  for (int f = 0; f < s.size(); ++f)
    for (int e = 0; e < num_edges(s.ref.shape); ++e)
    {
      if (not((s.ends[f] >> e) & 1))
        continue;
      const auto v = reference_edge(s.ref.shape, e);
      const Vector<D - 1> a = FacetProjection<D>::vertex(s.ref.shape, v[0]),
                          b = FacetProjection<D>::vertex(s.ref.shape, v[1]),
                          c = FacetProjection<D>::centre(s.ref.shape),
                          out = 0.5 * (a + b) + 0.05 * (0.5 * (a + b) - c);
      const Vector<D> x
          = FacetProjection<D>(s, f).at(out, false).x + 0.02 / n * normals.at(s, f, out.data()).M;
      int boxes = 0, facets = 0;
      tree.descend(
          [&](const Box<D>& box, int node)
          {
            ++boxes;
            return may_lead_to<D>(x, box, bounds[node], 0, 1.0) ? 0.0 : INFINITY;
          },
          [&](int)
          {
            ++facets;
            return 0.0;
          },
          0.0);
      most_boxes = std::max(most_boxes, boxes);
      most_facets = std::max(most_facets, facets);
    }
  return {most_boxes, most_facets};
}

} // namespace

TEMPLATE_TEST_CASE_SIG("search: bounds of the normals hide no smooth target", "", ((int D), D), 2,
                       3)
{
  for (const Element& element : elements<D>())
    for (const double opening : {0.05, 0.6, 2.0})
      same_as_without<D>(element, opening);
}

TEMPLATE_TEST_CASE_SIG("search: particles beside a surface look at few of its facets", "",
                       ((int D), D), 2, 3)
{
  for (const Element& element : elements<D>())
    for (const int n : {8, 16, 32, 64})
    {
      const auto [boxes, facets] = looks_beside<D>(element, n);
      CAPTURE(element.text(), n, boxes, facets);
      REQUIRE(facets <= 6);
      REQUIRE(boxes <= 8 * std::log2(std::pow(n, D - 1))); // as deep as the tree
    }
}
