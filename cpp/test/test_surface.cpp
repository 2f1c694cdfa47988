// SPDX-License-Identifier: MIT
#include "facets.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <limits>
#include <numbers>
#include <set>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

// Positions are sums of at most 9 terms of size 1
constexpr double tol = 20 * eps;

template <int D>
FacetPoint<D> point(const Surface& s, int f, const Vector<D - 1>& xi)
{
  BasisValues b;
  s.ref.position.tabulate(xi.data(), b);
  return evaluate<D>(s.facet_x(f), s.np(), b, false);
}

template <int D>
Vector<D - 1> random_xi(Shape shape, std::mt19937& random)
{
  Vector<D - 1> xi = uniform_vector<D - 1>(random, 0, 1);
  if (shape == Shape::triangle and xi.sum() > 1)
    xi = Vector<D - 1>::Ones() - xi;
  return xi;
}

/// A graph over [0, 1]^(D−1) of a few facets, body below.
template <int D>
Surface graph(const Element& element, std::mt19937& random)
{
  return build<D>(
      element.ref(), D == 2 ? line_cells(3) : square_cells(element.shape, 2),
      [](const Eigen::Vector3d& p)
      {
        Vector<D> x = p.head<D>();
        x[D - 1] = 0.2 * std::sin(3 * p[0] + 2 * p[1]);
        return x;
      },
      [](const Vector<D>&) { return Vector<D>(-Vector<D>::Unit(D - 1)); }, random);
}

template <int D>
void displaced_by_a_field(const Element& element)
{
  CAPTURE(element.text());
  std::mt19937 random(2);
  Surface s = graph<D>(element, random);
  REQUIRE(s.x == s.X);

  const std::vector<double> u = random_displacement(s, 0.3, random);
  s.displace(u);
  BasisValues P, M;
  for (int f = 0; f < s.size(); ++f)
    for (int k = 0; k < 20; ++k)
    {
      const Vector<D - 1> xi = random_xi<D>(element.shape, random);
      s.ref.position.tabulate(xi.data(), P);
      s.ref.displacement.tabulate(xi.data(), M);
      Vector<D> x = evaluate<D>(s.facet_X(f), s.np(), P, false).x;
      for (int a = 0; a < s.nu(); ++a)
      {
        // nodes by their global numbers, not by `local`
        const auto it
            = std::find(s.node_table.begin(), s.node_table.end(), s.nodes[f * s.nu() + a]);
        REQUIRE(it != s.node_table.end());
        x += M.N[a] * Eigen::Map<const Vector<D>>(&u[(it - s.node_table.begin()) * D]);
      }
      REQUIRE((point<D>(s, f, xi).x - x).norm() <= tol);
    }

  // the old position keeps to itself
  REQUIRE(s.x_old == s.X);
  const std::vector<double> x = s.x;
  s.remember(u);
  REQUIRE(s.x_old == x);
  s.displace(std::vector<double>(u.size(), 0.0)); // displacements do not accumulate
  REQUIRE(s.x == s.X);
  REQUIRE(s.x_old == x);
  for (int f = 0; f < s.size(); ++f)
    REQUIRE(s.facet_x_old(f) - s.x_old.data() == s.facet_x(f) - s.x.data());
}

template <int D>
void boxes_hold_their_facets(const Element& element)
{
  CAPTURE(element.text());
  std::mt19937 random(3);
  Surface s = graph<D>(element, random);
  s.displace(random_displacement(s, 0.2, random));
  const double margin = 0.05;
  const std::vector<double> box = s.boxes(), grown = s.boxes(margin);
  REQUIRE(box.size() == static_cast<std::size_t>(s.size()) * 2 * D);
  for (int f = 0; f < s.size(); ++f)
  {
    Vector<D> lo = Vector<D>::Constant(INFINITY), hi = -lo;
    for (int k = 0; k < 1000; ++k)
    {
      const Vector<D> x = point<D>(s, f, random_xi<D>(element.shape, random)).x;
      lo = lo.cwiseMin(x);
      hi = hi.cwiseMax(x);
    }
    Vector<D> corner_lo = Vector<D>::Constant(INFINITY), corner_hi = -corner_lo;
    for (int v = 0; v < s.nv(); ++v)
    {
      const Eigen::Map<const Vector<D>> x(s.facet_x(f) + v * D);
      corner_lo = corner_lo.cwiseMin(x);
      corner_hi = corner_hi.cwiseMax(x);
    }
    for (int i = 0; i < D; ++i)
    {
      const double a = box[(f * 2) * D + i], b = box[(f * 2 + 1) * D + i];
      REQUIRE(a <= lo[i] + tol);
      REQUIRE(hi[i] <= b + tol);
      if (element.position == 1) // exact
      {
        REQUIRE(a == corner_lo[i]);
        REQUIRE(b == corner_hi[i]);
      }
      REQUIRE(std::abs(grown[(f * 2) * D + i] - (a - margin)) <= tol);
      REQUIRE(std::abs(grown[(f * 2 + 1) * D + i] - (b + margin)) <= tol);
    }
  }
}

// A quadratic facet that happens to be flat: its control points lie on it
template <int D>
void boxes_of_flat_quadratic_facets_are_tight(Shape shape)
{
  CAPTURE(name(shape));
  std::mt19937 random(4);
  const Surface s = single_facet<D>({shape, 2, 2}, 0.0, random);
  const std::vector<double> box = s.boxes();
  for (int i = 0; i < D; ++i)
  {
    REQUIRE(std::abs(box[i]) <= tol);
    REQUIRE(std::abs(box[D + i] - (i < D - 1)) <= tol);
  }
}

} // namespace

TEST_CASE("Surface: displace gives X + u")
{
  for (const Element& e : elements<2>())
    displaced_by_a_field<2>(e);
  for (const Element& e : elements<3>())
    displaced_by_a_field<3>(e);
}

TEST_CASE("Surface: displacements must be finite and one for each node")
{
  std::mt19937 random(5);
  Surface s = graph<3>({Shape::triangle, 2, 1}, random);
  std::vector<double> u(s.node_table.size() * 3, 0.1);
  const double bad = GENERATE(NAN, INFINITY, -INFINITY);
  REQUIRE_NOTHROW(s.displace(u));
  const std::vector<double> before = s.x;
  u[7] = bad;
  REQUIRE_THROWS_AS(s.displace(u), std::domain_error);
  REQUIRE(s.x == before);
  REQUIRE_THROWS_AS(s.remember(u), std::domain_error);
  REQUIRE(s.x_old == s.X);
  u[7] = 0;
  u.pop_back();
  REQUIRE_THROWS_AS(s.displace(u), std::invalid_argument);
}

TEST_CASE("Surface: boxes hold their facets")
{
  for (const Element& e : elements<2>())
    boxes_hold_their_facets<2>(e);
  for (const Element& e : elements<3>())
    boxes_hold_their_facets<3>(e);
  boxes_of_flat_quadratic_facets_are_tight<2>(Shape::interval);
  boxes_of_flat_quadratic_facets_are_tight<3>(Shape::triangle);
  boxes_of_flat_quadratic_facets_are_tight<3>(Shape::quadrilateral);
}

TEST_CASE("Surface: area vectors of known shapes")
{
  // 2D: τ × e_3 of the segment from (0, 0) to (3, 4), turned by −90 degrees
  FacetPoint<2> line;
  line.tau << 3, 4;
  REQUIRE(line.area_vector() == Vector<2>(4, -3));
  FacetPoint<3> plane;
  plane.tau << 2, 0, 0, 3, 0, 0;
  REQUIRE(plane.area_vector() == Vector<3>(0, 0, 6));

  // a polyhedron in the unit sphere: σ turns every area vector inward, and they sum to zero
  for (Shape shape : {Shape::triangle, Shape::quadrilateral})
  {
    std::mt19937 random(6);
    const Surface s = build<3>(
        reference_facet(shape, 1, 1), cube_cells(shape, 4),
        [](const Eigen::Vector3d& p) { return Vector<3>(p.normalized()); },
        [](const Vector<3>& x) { return Vector<3>(-x); }, random);
    const double area = shape == Shape::triangle ? 0.5 : 1;
    const Vector<2> centre = Vector<2>::Constant(shape == Shape::triangle ? 1.0 / 3 : 0.5);
    Vector<3> sum = Vector<3>::Zero();
    double total = 0;
    for (int f = 0; f < s.size(); ++f)
    {
      const FacetPoint<3> p = point<3>(s, f, centre);
      const Vector<3> S = area * s.sigma[f] * p.area_vector();
      REQUIRE(S.normalized().dot(-p.x.normalized()) > 0.9);
      sum += S;
      total += S.norm();
    }
    REQUIRE(sum.norm() <= 100 * eps);                            // of up to 192 facets
    REQUIRE(total == Approx(4 * std::numbers::pi).epsilon(0.1)); // 4 × 4 facets a side
    REQUIRE(total < 4 * std::numbers::pi);
  }
}

TEST_CASE("Surface: diameters, vertices and edges of known facets")
{
  std::mt19937 random(7);
  const Element element = GENERATE(from_range(elements<3>()));
  Surface s = single_facet<3>(element, 0.0, random);
  REQUIRE(s.diameter(0) == Approx(std::sqrt(2.0)).epsilon(tol));
  s.displace(random_displacement(s, 0.3, random)); // of the reference configuration
  REQUIRE(s.diameter(0) == Approx(std::sqrt(2.0)).epsilon(tol));
  REQUIRE(s.ends[0] == (1 << num_edges(element.shape)) - 1);

  // each vertex belongs to two edges
  std::vector<int> count(s.nv(), 0);
  for (int e = 0; e < num_edges(element.shape); ++e)
  {
    const auto v = reference_edge(element.shape, e);
    REQUIRE(v[0] < v[1]);
    ++count[v[0]];
    ++count[v[1]];
  }
  REQUIRE(count == std::vector<int>(s.nv(), 2));
}

TEST_CASE("Surface: nodes are counted off, however far apart their numbers are")
{
  std::mt19937_64 random(8);
  constexpr std::int64_t largest = std::numeric_limits<std::int64_t>::max();
  // 300 nodes of triangles; 300 × 4 × 64 is where numbers begin to be far apart
  for (const std::int64_t range : {std::int64_t(1), std::int64_t(64), std::int64_t(1000),
                                   std::int64_t(76799), std::int64_t(76801), largest})
    for (const std::int64_t wanted : {std::int64_t(0), std::int64_t(63), largest})
    {
      const std::int64_t first = std::min(wanted, largest - range + 1);
      CAPTURE(range, first);
      Surface s;
      s.dim = 3;
      s.ref = Element{Shape::triangle, 1, 1}.ref();
      for (int i = 0; i < 300; ++i)
        s.nodes.push_back(first + static_cast<std::int64_t>(random() % range));
      s.nodes[7] = first; // both ends of the range
      s.nodes[100] = first + (range - 1);
      s.number_nodes();
      const std::set<std::int64_t> distinct(s.nodes.begin(), s.nodes.end());
      REQUIRE(s.node_table == std::vector<std::int64_t>(distinct.begin(), distinct.end()));
      for (std::size_t i = 0; i < s.nodes.size(); ++i)
        REQUIRE(s.node_table[s.local[i]] == s.nodes[i]);
    }
  Surface none;
  none.number_nodes();
  REQUIRE(none.node_table.empty());
}
