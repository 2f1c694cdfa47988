// SPDX-License-Identifier: MIT
#include "../integration/particle_rule.h"
#include "facets.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <numbers>
#include <numeric>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

const double pi = std::numbers::pi;
const std::vector<Shape> shapes = {Shape::interval, Shape::triangle, Shape::quadrilateral};

void same(const std::vector<double>& a, const std::vector<double>& b)
{
  REQUIRE(a.size() == b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    REQUIRE(std::abs(a[i] - b[i]) <= 4 * eps); // numbers below 1, sums of a few
}

// ∫ ξ_1^i ξ_2^j over the reference facet: i! j!/(i + j + 2)! on the triangle
double monomial(Shape shape, int i, int j)
{
  if (shape == Shape::triangle)
    return std::tgamma(i + 1) * std::tgamma(j + 1) / std::tgamma(i + j + 3);
  return 1.0 / (i + 1) / (j + 1);
}

double integral(const ParticleRule& rule, int q, int i, int j)
{
  double sum = 0;
  for (int p = 0; p < rule.size(); ++p)
    sum += rule.weights[p] * std::pow(rule.points[p * q], i)
           * (q == 2 ? std::pow(rule.points[p * q + 1], j) : 1.0);
  return sum;
}

/// A facet with the given nodes, straight unless `middle` says otherwise.
Surface segment(int degree, Vector<2> a, Vector<2> b, Vector<2> middle)
{
  std::mt19937 random(1);
  return build<2>(
      reference_facet(Shape::interval, degree, degree), line_cells(1),
      [&](const Eigen::Vector3d& p)
      {
        const double t = p[0];
        const Vector<2> x = (1 - t) * a + t * b;
        return Vector<2>(x + 4 * t * (1 - t) * (middle - 0.5 * (a + b)));
      },
      [](const Vector<2>&) { return Vector<2>(0, -1); }, random);
}

double sum(const std::vector<double>& v)
{
  return std::accumulate(v.begin(), v.end(), 0.0);
}

} // namespace

TEST_CASE("ParticleRule: Simpson's tables on intervals")
{
  const ParticleRule r0 = simpson(Shape::interval, 0), r1 = simpson(Shape::interval, 1),
                     r2 = simpson(Shape::interval, 2);
  REQUIRE(r0.points == std::vector<double>{0, 0.5, 1});
  same(r0.weights, {1. / 6, 2. / 3, 1. / 6});
  REQUIRE(r1.points == std::vector<double>{0, 0.25, 0.5, 0.75, 1});
  same(r1.weights, {1. / 12, 1. / 3, 1. / 6, 1. / 3, 1. / 12});
  REQUIRE(r2.points == std::vector<double>{0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1});
  same(r2.weights, {1. / 24, 1. / 6, 1. / 12, 1. / 6, 1. / 12, 1. / 6, 1. / 12, 1. / 6, 1. / 24});
}

TEST_CASE("ParticleRule: tensor products on quadrilaterals")
{
  const int n = GENERATE(0, 1, 2);
  const ParticleRule line = simpson(Shape::interval, n), rule = simpson(Shape::quadrilateral, n);
  std::vector<double> points, weights;
  for (int j = 0; j < line.size(); ++j)
    for (int i = 0; i < line.size(); ++i)
    {
      points.insert(points.end(), {line.points[i], line.points[j]});
      weights.push_back(line.weights[i] * line.weights[j]);
    }
  REQUIRE(rule.points == points);
  same(rule.weights, weights);
}

TEST_CASE("ParticleRule: the seven-point rule on triangles")
{
  const ParticleRule rule = simpson(Shape::triangle, 0);
  REQUIRE(rule.size() == 7);
  int vertices = 0, edges = 0, centroids = 0;
  for (int p = 0; p < 7; ++p)
  {
    const double x = rule.points[2 * p], y = rule.points[2 * p + 1], z = 1 - x - y;
    const double area = 0.5;
    if (std::max({x, y, z}) == 1)
    {
      ++vertices;
      REQUIRE(rule.weights[p] == Approx(area / 20).epsilon(4 * eps));
    }
    else if (std::max({x, y, z}) == 0.5)
    {
      ++edges;
      REQUIRE(std::min({x, y, z}) == 0);
      REQUIRE(rule.weights[p] == Approx(area * 2 / 15).epsilon(4 * eps));
    }
    else
    {
      ++centroids;
      REQUIRE(std::max(std::abs(x - 1. / 3), std::abs(y - 1. / 3)) <= eps);
      REQUIRE(rule.weights[p] == Approx(area * 9 / 20).epsilon(4 * eps));
    }
  }
  REQUIRE(std::array{vertices, edges, centroids} == std::array{3, 3, 1});

  // merged: vertices, mid-edges and centroids of the 4ⁿ triangles
  REQUIRE(simpson(Shape::triangle, 1).size() == 6 + 9 + 4);
  REQUIRE(simpson(Shape::triangle, 2).size() == 15 + 30 + 16);
  // an inner vertex at n = 2 belongs to six triangles of area 1/32
  const ParticleRule fine = simpson(Shape::triangle, 2);
  int found = 0;
  for (int p = 0; p < fine.size(); ++p)
    if (fine.points[2 * p] == 0.25 and fine.points[2 * p + 1] == 0.25)
    {
      ++found;
      REQUIRE(fine.weights[p] == Approx(6. / 20 / 32).epsilon(4 * eps));
    }
  REQUIRE(found == 1);
}

TEST_CASE("ParticleRule: positive weights, cubics are integrated exactly")
{
  const Shape shape = GENERATE(from_range(shapes));
  const int n = GENERATE(0, 1, 2, 3);
  CAPTURE(name(shape), n);
  const ParticleRule rule = simpson(shape, n);
  const int q = facet_dim(shape);
  for (double w : rule.weights)
    REQUIRE(w > 0);
  const double tol = 10 * eps * std::sqrt(rule.size()); // sums of numbers below 1
  for (int i = 0; i <= 3; ++i)
    for (int j = 0; j <= (q == 1 ? 0 : shape == Shape::triangle ? 3 - i : 3); ++j)
    {
      CAPTURE(i, j);
      REQUIRE(std::abs(integral(rule, q, i, j) - monomial(shape, i, j)) <= tol);
    }
  if (n == 0) // and no more than cubics: the comparison can fail
    REQUIRE(std::abs(integral(rule, q, 4, 0) - monomial(shape, 4, 0)) > 1e-3);
}

TEST_CASE("ParticleRule: n out of range")
{
  const Shape shape = GENERATE(from_range(shapes));
  REQUIRE_THROWS_AS(simpson(shape, -1), std::invalid_argument);
  REQUIRE_THROWS_AS(simpson(shape, 7), std::invalid_argument);
}

TEST_CASE("particle_weights: they sum to the measure of straight facets")
{
  const int n = GENERATE(0, 1, 2), degree = GENERATE(1, 2);
  const Surface line = segment(degree, {1, 1}, {4, 5}, {2.5, 3});
  const std::vector<double> w = particle_weights(line, simpson(Shape::interval, n), false);
  REQUIRE(w.size() == static_cast<std::size_t>(simpson(Shape::interval, n).size()));
  REQUIRE(*std::min_element(w.begin(), w.end()) > 0);
  REQUIRE(sum(w) == Approx(5).epsilon(20 * eps));

  for (Shape shape : {Shape::triangle, Shape::quadrilateral})
  {
    std::mt19937 random(2);
    const ParticleRule rule = simpson(shape, n);
    // parallelograms and triangles with sides (2, 0, 1) and (1, 3, 0): area ‖(−3, 1, 6)‖
    const Surface s = build<3>(
        reference_facet(shape, degree, degree), square_cells(shape, 2),
        [](const Eigen::Vector3d& p) { return Vector<3>(2 * p[0] + p[1], 3 * p[1], p[0]); },
        [](const Vector<3>&) { return Vector<3>(0, 0, 1); }, random);
    const std::vector<double> w = particle_weights(s, rule, false);
    REQUIRE(w.size() == static_cast<std::size_t>(s.size() * rule.size()));
    REQUIRE(*std::min_element(w.begin(), w.end()) > 0);
    for (int f = 0; f < s.size(); ++f)
    {
      const double* first = &w[f * rule.size()];
      REQUIRE(std::accumulate(first, first + rule.size(), 0.0)
              == Approx(std::sqrt(46.0) / s.size()).epsilon(50 * eps));
    }
  }
}

TEST_CASE("particle_weights: fourth order on a curved facet")
{
  // the parabola y = a ξ (1 − ξ): length (√(1 + a²) + asinh(a)/a)/2
  const double a = 2;
  const Surface arc = segment(2, {0, 0}, {1, 0}, {0.5, a / 4});
  const double length = 0.5 * (std::sqrt(1 + a * a) + std::asinh(a) / a);
  auto error = [&](int n)
  { return std::abs(sum(particle_weights(arc, simpson(Shape::interval, n), false)) - length); };
  for (int n = 2; n < 5; ++n)
  {
    CAPTURE(n, error(n), error(n + 1));
    REQUIRE(error(n + 1) > 100 * eps); // not yet round-off
    REQUIRE(std::log2(error(n) / error(n + 1)) >= 3.8);
  }
}

TEST_CASE("particle_weights: axisymmetric weights on a facet that touches the axis")
{
  // a cone from (0, 0) to (3, 4): area π R L
  const Surface cone = segment(1, {0, 0}, {3, 4}, {1.5, 2});
  const ParticleRule rule = simpson(Shape::interval, 1);
  const std::vector<double> w = particle_weights(cone, rule, true);
  REQUIRE(sum(w) == Approx(pi * 3 * 5).epsilon(20 * eps));
  int on_axis = 0;
  for (int p = 0; p < rule.size(); ++p)
  {
    // the builder may have turned the facet
    const double R = 3 * (cone.facet_X(0)[0] == 0 ? rule.points[p] : 1 - rule.points[p]);
    REQUIRE(std::abs(w[p] - rule.weights[p] * 5 * 2 * pi * R) <= 100 * eps);
    on_axis += w[p] == 0;
  }
  REQUIRE(on_axis == 1); // why nodal particles need lumped weights
}

TEST_CASE("lumped_weights: exact, positive and non-zero on the axis")
{
  const Surface cone = segment(1, {0, 0}, {3, 4}, {1.5, 2});
  const ParticleRule fine = simpson(Shape::interval, 2);
  const bool turned = cone.facet_X(0)[0] != 0;
  // ∫ (1 − t) 2π 3t 5 dt = 5π and ∫ t 2π 3t 5 dt = 10π; plane: 5/2 each
  std::vector<double> expected = {5 * pi, 10 * pi};
  if (turned)
    std::swap(expected[0], expected[1]);
  const TraceBasis p1 = lagrange(Shape::interval, 1);
  std::vector<double> w = lumped_weights(cone, p1, fine, true);
  for (int a = 0; a < 2; ++a)
    REQUIRE(w[a] == Approx(expected[a]).epsilon(20 * eps));
  w = lumped_weights(cone, p1, fine, false);
  for (int a = 0; a < 2; ++a)
    REQUIRE(w[a] == Approx(2.5).epsilon(20 * eps));
  // quadratic: at the axis node ∫ (1 − t)(1 − 2t) t dt = 0, else ∫ t (2t − 1) t = 1/6, 4 t (1 − t)
  // t = 1/3
  w = lumped_weights(cone, lagrange(Shape::interval, 2), fine, true);
  REQUIRE(std::abs(w[turned ? 1 : 0]) <= 100 * eps);
  REQUIRE(w[turned ? 0 : 1] == Approx(30 * pi / 6).epsilon(20 * eps));
  REQUIRE(w[2] == Approx(30 * pi / 3).epsilon(20 * eps));
}

TEST_CASE("lumped_weights: shares of a facet's area")
{
  struct Share
  {
    Shape shape;
    int degree;
    double vertex, edge, centre;
  };
  const Share s = GENERATE(Share{Shape::interval, 1, 1. / 2, 0, 0},
                           Share{Shape::interval, 2, 1. / 6, 2. / 3, 0},
                           Share{Shape::triangle, 1, 1. / 3, 0, 0},
                           Share{Shape::triangle, 2, 0, 1. / 3, 0}, // vertices: zero, hence useless
                           Share{Shape::quadrilateral, 1, 1. / 4, 0, 0},
                           Share{Shape::quadrilateral, 2, 1. / 36, 1. / 9, 4. / 9});
  CAPTURE(name(s.shape), s.degree);
  std::mt19937 random(3);
  const ParticleRule fine = simpson(s.shape, 1);
  const TraceBasis psi = lagrange(s.shape, s.degree);
  const int nv = num_vertices(s.shape);
  std::vector<double> w;
  double area = s.shape == Shape::triangle ? 0.5 : 1;
  if (s.shape == Shape::interval)
    w = lumped_weights(single_facet<2>({s.shape, 1, 1}, 0, random), psi, fine, false);
  else
    w = lumped_weights(single_facet<3>({s.shape, 1, 1}, 0, random), psi, fine, false);
  REQUIRE(static_cast<int>(w.size()) == psi.nodes());
  for (int a = 0; a < psi.nodes(); ++a)
  {
    const double share = a < nv ? s.vertex : a == 8 ? s.centre : s.edge;
    REQUIRE(std::abs(w[a] - area * share) <= 50 * eps);
  }
}
