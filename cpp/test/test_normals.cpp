// SPDX-License-Identifier: MIT
//
// Interpolated normals (F8) and smooth targets (F6): one particle's tangent, with the columns of
// the whole star of its target, against differences, with and without friction; and the same with
// one term left out at a time.
#include "star.h"

#include <catch2/catch.hpp>
#include <numbers>
#include <utility>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double tol = 1e-8;                     // truncation and round-off of `central`, relative
constexpr unsigned first_bit = 13, num_bits = 6; // smooth_offset … normal_sliding
static_assert(smooth_offset == 1u << first_bit
              and normal_sliding == 1u << (first_bit + num_bits - 1));

template <int D>
bool matters_here(unsigned term, const StarScene<D>& s)
{
  const bool smooth = s.rules.target == TargetRule::smooth, free = s.clamp == Clamp::none;
  switch (term)
  {
  case smooth_offset:
  case smooth_field:
    return smooth and free;
  case edge_turning:
  case edge_field:
    return smooth and s.clamp == Clamp::edge;
  case normal_field:
    return true;
  case normal_sliding:
    return s.clamp != Clamp::vertex;
  default:
    return false;
  }
}

template <int D, unsigned... Bit>
void compare_star(std::array<int, num_bits>& count, std::integer_sequence<unsigned, Bit...>)
{
  std::mt19937 random(3);
  constexpr NormalRule interpolated = NormalRule::interpolated;
  for (const Element& element : elements<D>())
    for (const Rules& rules :
         {Rules{TargetRule::smooth, interpolated}, Rules{TargetRule::proximity, interpolated},
          Rules{TargetRule::direction, interpolated},
          Rules{TargetRule::direction, interpolated, true}})
      for (Clamp clamp : {Clamp::none, Clamp::edge, Clamp::vertex})
      {
        if (D == 2 and clamp == Clamp::edge)
          continue;
        const StarScene<D> s = draw_star<D>(element, rules, clamp, random);
        Eigen::MatrixXd all(s.cases.size() * s.rows(), s.size());
        for (int j = 0; j < s.size(); ++j)
          all.col(j) = central(
              [&](double h) { return s.residual(s.U + h * Eigen::VectorXd::Unit(s.size(), j)); });
        CAPTURE(element.text(), int(rules.target), rules.turning, int(clamp));
        CAPTURE(s.augmented, s.convected);
        for (std::size_t c = 0; c < s.cases.size(); ++c)
        {
          const Status status = s.cases[c];
          const Eigen::MatrixXd fd = all.middleRows(c * s.rows(), s.rows()),
                                K = status == Status::closed ? s.template derivative<false>(status)
                                                             : s.template derivative<true>(status);
          CAPTURE(c, relative(K, fd));
          REQUIRE(fd.norm() > 0.01);
          REQUIRE(relative(K, fd) <= tol);
          if (s.convected and status == Status::stick)
            REQUIRE(relative(s.template derivative<true, slip_field>(status), fd) > 1e-5);
        }
        const Eigen::MatrixXd fd = all.topRows(s.rows()),
                              K = s.template derivative<false>(Status::closed);
        ((count[Bit] += compare_without(
              1u << (first_bit + Bit),
              s.template derivative<false, (1u << (first_bit + Bit))>(Status::closed), K, fd,
              matters_here<D>(1u << (first_bit + Bit), s), 1e-5)),
         ...);
      }
}

} // namespace

TEST_CASE("normals: the tangent is the derivative of the residual, and needs all its terms (2D)")
{
  std::array<int, num_bits> count{};
  compare_star<2>(count, std::make_integer_sequence<unsigned, num_bits>());
  for (unsigned bit = 0; bit < num_bits; ++bit)
    REQUIRE((count[bit] > 0) == (bit != 2 and bit != 3)); // no edges in 2D
}

TEST_CASE("normals: the tangent is the derivative of the residual, and needs all its terms (3D)")
{
  std::array<int, num_bits> count{};
  compare_star<3>(count, std::make_integer_sequence<unsigned, num_bits>());
  for (unsigned bit = 0; bit < num_bits; ++bit)
    REQUIRE(count[bit] > 0);
}

TEST_CASE("normals: n̄ is continuous across edges, and creases stop the averaging")
{
  std::mt19937 random(7);
  // a roof: two halves that meet at 90 degrees
  const auto roof
      = [](const Eigen::Vector3d& q) { return Vector<3>(q[0], q[1], -std::abs(q[0] - 0.5)); };
  const Element element{Shape::quadrilateral, 1, 1};
  const Surface s = plate<3>(element, 4, 2, roof);
  const NodalNormals<3> smooth(s, 1.7), creased(s, 1.0); // above and below 90 degrees
  int edges = 0;
  for (int f = 0; f < s.size(); ++f)
    for (int v = 0; v < 4; ++v)
    {
      const Vector<3> x = Eigen::Map<const Vector<3>>(s.facet_X(f) + 3 * v);
      const FacetPoint<3> p
          = FacetProjection<3>(s, f).at(FacetProjection<3>::vertex(element.shape, v), false);
      const Vector<3> own = FacetProjection<3>(s, f).normal(p);
      REQUIRE((creased.normal(s, f, v) - own).norm() <= 8 * eps); // flat halves
      if (std::abs(x[0] - 0.5) < 1e-12)
      {
        ++edges;
        REQUIRE((smooth.normal(s, f, v) - Vector<3>(0, 0, -1)).norm() <= 8 * eps);
      }
    }
  REQUIRE(edges == 16);
}

TEMPLATE_TEST_CASE_SIG("smooth targets: exactly one facet for each point around a closed surface",
                       "", ((int D), D), 2, 3)
{
  std::mt19937 random(9);
  for (const Element& element : elements<D>())
  {
    // a circle or a sphere of radius 1, the body inside
    Cells cells = D == 2 ? line_cells(24) : cube_cells(element.shape, 4);
    const Surface s = build<D>(
        element.ref(), cells,
        [](const Eigen::Vector3d& q)
        {
          if constexpr (D == 2)
            return Vector<2>(std::cos(2 * std::numbers::pi * q[0]),
                             std::sin(2 * std::numbers::pi * q[0]));
          else
            return Vector<3>(q.normalized());
        },
        [](const Vector<D>& x) { return Vector<D>(-x); }, random);
    const NodalNormals<D> normals(s, 3.1);
    for (int i = 0; i < 500; ++i)
    {
      const Vector<D> direction = uniform_vector<D>(random, -1, 1).normalized();
      const Vector<D> x = uniform(random, 0.8, 1.3) * direction;
      int hits = 0;
      for (int f = 0; f < s.size(); ++f)
      {
        const FacetProjection<D> facet(s, f);
        Vector<D - 1> xi = facet.start(x);
        double d = 0;
        if (not SmoothProjection<D>(s, f, normals).solve(x, xi, d) or facet.outside(xi) > 0
            or std::abs(d) > 0.5)
          continue;
        ++hits;
        const NormalField<D> field = normals.at(s, f, xi.data());
        // (F6), up to Newton's last step
        REQUIRE((facet.at(xi, false).x + d * field.M.normalized() - x).norm() <= 1e-10);
      }
      CAPTURE(element.text(), x.transpose());
      REQUIRE(hits == 1);
    }
  }
}
