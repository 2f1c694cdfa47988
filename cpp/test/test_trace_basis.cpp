// SPDX-License-Identifier: MIT
#include "facets.h"

#include <catch2/catch.hpp>
#include <numeric>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{
// The coefficients, at most 16, come from a Vandermonde matrix of condition below 1e3
constexpr double tol = 1e3 * eps;

struct Case
{
  Shape shape;
  int degree;
};

std::vector<Case> cases()
{
  std::vector<Case> out;
  for (Shape shape : {Shape::interval, Shape::triangle, Shape::quadrilateral})
    for (int degree : {1, 2})
      out.push_back({shape, degree});
  return out;
}

// Points inside the facet and around it: targets are extrapolated
std::vector<Eigen::Vector2d> points()
{
  std::mt19937 random(1);
  std::vector<Eigen::Vector2d> out;
  for (int i = 0; i < 20; ++i)
    out.push_back(uniform_vector<2>(random, -0.5, 1.5));
  return out;
}

std::vector<double> values(const TraceBasis& basis, const Eigen::Vector2d& xi)
{
  std::vector<double> N(basis.nodes());
  basis.values(xi.data(), N.data());
  return N;
}
} // namespace

TEST_CASE("TraceBasis: one at its own node, zero at the others")
{
  const auto [shape, degree] = GENERATE(from_range(cases()));
  CAPTURE(name(shape), degree);
  const TraceBasis basis = lagrange(shape, degree);
  const Points nodes = lagrange_nodes(shape, degree);
  const int expected[3][2] = {{2, 3}, {3, 6}, {4, 9}};
  REQUIRE(basis.nodes() == expected[static_cast<int>(shape)][degree - 1]);
  REQUIRE(basis.degree() == degree);
  for (int b = 0; b < basis.nodes(); ++b)
  {
    Eigen::Vector2d xi(0, 0);
    xi.head(nodes.cols()) = nodes.row(b).transpose();
    const std::vector<double> N = values(basis, xi);
    for (int a = 0; a < basis.nodes(); ++a)
      REQUIRE(std::abs(N[a] - (a == b)) <= tol);
  }
}

TEST_CASE("TraceBasis: a partition of unity, whose derivatives sum to zero")
{
  const auto [shape, degree] = GENERATE(from_range(cases()));
  CAPTURE(name(shape), degree);
  const TraceBasis basis = lagrange(shape, degree);
  for (const Eigen::Vector2d& xi : points())
  {
    BasisValues b;
    basis.tabulate(xi.data(), b, true);
    auto sum = [&](const double* v) { return std::accumulate(v, v + basis.nodes(), 0.0); };
    REQUIRE(std::abs(sum(b.N) - 1) <= tol);
    for (int i = 0; i < 2; ++i)
      REQUIRE(std::abs(sum(b.dN[i])) <= tol);
    for (int i = 0; i < 3; ++i)
      REQUIRE(std::abs(sum(b.ddN[i])) <= tol);
  }
}

TEST_CASE("TraceBasis: derivatives are those of central differences")
{
  const auto [shape, degree] = GENERATE(from_range(cases()));
  CAPTURE(name(shape), degree);
  const TraceBasis basis = lagrange(shape, degree);
  const int q = facet_dim(shape);
  // Central differences are exact for polynomials of degree 2 per direction: no truncation, hence
  // a large step and round-off alone
  const double h = 0.25;
  double largest = 0;
  for (const Eigen::Vector2d& xi : points())
  {
    BasisValues b;
    basis.tabulate(xi.data(), b, true);
    const std::vector<double> N = values(basis, xi);
    auto at = [&](double s, double t) { return values(basis, xi + h * Eigen::Vector2d(s, t)); };
    const auto right = at(1, 0), left = at(-1, 0), up = at(0, 1), down = at(0, -1);
    const auto pp = at(1, 1), pm = at(1, -1), mp = at(-1, 1), mm = at(-1, -1);
    for (int a = 0; a < basis.nodes(); ++a)
    {
      CAPTURE(a, xi.transpose());
      REQUIRE(b.N[a] == N[a]);
      REQUIRE(std::abs(b.dN[0][a] - (right[a] - left[a]) / (2 * h)) <= tol / h);
      REQUIRE(std::abs(b.ddN[0][a] - (right[a] - 2 * N[a] + left[a]) / (h * h)) <= tol / (h * h));
      const double d2 = q == 2 ? (up[a] - down[a]) / (2 * h) : 0;
      const double d22 = q == 2 ? (up[a] - 2 * N[a] + down[a]) / (h * h) : 0;
      const double d12 = q == 2 ? (pp[a] - pm[a] - mp[a] + mm[a]) / (4 * h * h) : 0;
      REQUIRE(std::abs(b.dN[1][a] - d2) <= tol / h);
      REQUIRE(std::abs(b.ddN[1][a] - d22) <= tol / (h * h));
      REQUIRE(std::abs(b.ddN[2][a] - d12) <= tol / (h * h));
      largest = std::max({largest, std::abs(d22), std::abs(d12), std::abs(b.ddN[0][a])});
    }
  }
  // something was compared: only linear bases on simplices have no second derivatives
  const bool affine = degree == 1 and shape != Shape::quadrilateral;
  REQUIRE((affine ? largest <= tol / (h * h) : largest >= 1));
}

TEST_CASE("TraceBasis: second derivatives only on demand")
{
  const TraceBasis basis = lagrange(Shape::quadrilateral, 2);
  BasisValues b;
  const double xi[2] = {0.3, 0.6};
  basis.tabulate(xi, b, true);
  REQUIRE(std::abs(b.ddN[0][0]) > 0.1);
  basis.tabulate(xi, b, false);
  for (int i = 0; i < 3; ++i)
    for (int a = 0; a < basis.nodes(); ++a)
      REQUIRE(b.ddN[i][a] == 0);
}

TEST_CASE("TraceBasis: wrong input")
{
  using Ints = std::vector<std::int32_t>;
  auto make = [](int dim, const Ints& powers, std::size_t coefficients)
  { return TraceBasis(dim, powers, std::vector<double>(coefficients, 1.0)); };
  REQUIRE_NOTHROW(make(1, {0, 1}, 4));
  REQUIRE_NOTHROW(make(2, {0, 0, 1, 0, 0, 1}, 9));
  REQUIRE_NOTHROW(make(1, {0}, 1)); // a constant: P0 multipliers
  auto rejected = [&](int dim, const Ints& powers, std::size_t coefficients)
  { REQUIRE_THROWS_AS(make(dim, powers, coefficients), std::invalid_argument); };
  rejected(0, {0, 1}, 4);
  rejected(3, {0, 1, 0}, 1);
  rejected(1, {}, 0);
  rejected(1, {0, 1}, 3);        // not a whole number of nodes
  rejected(1, {0, 1}, 0);        // no nodes
  rejected(2, {0, 0, 1}, 1);     // half a monomial
  rejected(1, {0, 1, 2, 3}, 16); // cubic
  rejected(1, {0, -1}, 4);       // not a polynomial
  rejected(1, {0, 1}, 20);       // ten nodes
}
