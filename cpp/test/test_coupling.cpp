// SPDX-License-Identifier: MIT
//
// One particle's tangent without friction against differences of its residual, for all unknowns of
// the pair; and the same with one term left out at a time, which the differences must notice.
#include "pair.h"

#include <catch2/catch.hpp>
#include <utility>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double tol = 1e-8; // truncation and round-off of `central`, relative

// target_curvature … open_row, and a direction that turns; the terms of interpolated normals are in
// test_normals.cpp, those of friction in test_friction.cpp
constexpr unsigned num_terms = 16;
constexpr unsigned term(unsigned i)
{
  return 1u << (i < 13 ? i : i + 6);
}
static_assert(term(12) == open_row and term(13) == seek_turning and term(15) == seek_normal);

/// Where a term must be felt; elsewhere it is zero.
template <int D>
bool matters(unsigned term, const Pair<D>& pair)
{
  const Scene<D>& s = pair.scene;
  const bool proximity = s.rules.target == TargetRule::proximity,
             facet = s.rules.normal == NormalRule::facet;
  const bool vertex = s.target.clamp == Clamp::vertex, edge = s.target.clamp == Clamp::edge;
  if (not pair.closed())
    return term == open_row;
  switch (term)
  {
  case target_curvature:
    return proximity and s.free() and s.curved();
  case target_gradient:
    return proximity and s.free();
  case edge_curvature:
    return edge and s.element.position == 2;
  case edge_gradient:
    return edge;
  case normal_gradient:
    return facet;
  case normal_curvature:
    return facet and not vertex and s.curved();
  case gap_sliding:
    return not facet and not vertex; // facet normals are orthogonal to all τ_α
  case gap_turning: // r is along n at free closest points, and along e at free targets of (F5)
    return s.normal_turns() and not(s.free() and (proximity or not facet));
  case traction_turning:
    return s.normal_turns();
  case moving_target:
    return not vertex;
  case traction_multiplier:
  case gap_row:
    return true;
  case seek_turning:
    return pair.turns() and s.free();
  case seek_edge:
    return pair.turns() and edge;
  case seek_normal:
    return pair.turns() and not facet;
  default:
    return false;
  }
}

/// How often each term mattered.
template <int D, unsigned... I>
void compare_all(const Pair<D>& pair, std::array<int, num_terms>& count,
                 std::integer_sequence<unsigned, I...>)
{
  const Eigen::MatrixXd fd = pair.differences(), K = pair.template derivative<false>();
  CAPTURE(pair.scene.text(), pair.law.augmented, name(pair.status), relative(K, fd));
  REQUIRE(fd.norm() > 0.01);
  REQUIRE(relative(K, fd) <= tol);
  ((count[I] += compare_without(term(I), pair.template derivative<false, term(I)>(), K, fd,
                                matters<D>(term(I), pair))),
   ...);
}

template <int D>
std::array<int, num_terms> compare_scenes()
{
  std::array<int, num_terms> count{};
  for (const Scene<D>& s : scenes<D>())
    for (bool augmented : {false, true})
      for (Status status : {Status::closed, Status::open})
        compare_all<D>(Pair<D>(s, augmented, status), count,
                       std::make_integer_sequence<unsigned, num_terms>());
  return count;
}

double asymmetry(const Eigen::MatrixXd& K)
{
  return relative(K.transpose(), K);
}

} // namespace

TEST_CASE("coupling: the tangent is the derivative of the residual, and needs all its terms (2D)")
{
  const std::array<int, num_terms> count = compare_scenes<2>();
  for (unsigned i = 0; i < num_terms; ++i)
  {
    CAPTURE(i);
    const bool edge = term(i) & (edge_curvature | edge_gradient | seek_edge); // none in 2D
    REQUIRE((count[i] > 0) == not edge);
  }
}

TEST_CASE("coupling: the tangent is the derivative of the residual, and needs all its terms (3D)")
{
  const std::array<int, num_terms> count = compare_scenes<3>();
  for (unsigned i = 0; i < num_terms; ++i)
  {
    CAPTURE(i);
    REQUIRE(count[i] > 0);
  }
}

TEMPLATE_TEST_CASE_SIG(
    "coupling: symmetric for free closest points and fixed corners with a fixed normal only", "",
    ((int D), D), 2, 3)
{
  int symmetric = 0, others = 0;
  for (const Scene<D>& s : scenes<D>())
    for (bool augmented : {false, true})
    {
      const Pair<D> pair(s, augmented, Status::closed);
      const Eigen::MatrixXd K = pair.template derivative<false>().leftCols(pair.size());
      CAPTURE(s.text(), augmented);
      const bool fixed
          = s.target.clamp == Clamp::vertex and s.rules.normal == NormalRule::direction;
      if (fixed or (s.rules.target == TargetRule::proximity and s.free()))
      {
        ++symmetric;
        REQUIRE(asymmetry(K) <= 1e-12); // round-off and the target's accuracy
      }
      else
      {
        ++others;
        REQUIRE(asymmetry(K) > 1e-4);
      }
    }
  REQUIRE(symmetric > 0);
  REQUIRE(others > symmetric);
}

TEST_CASE("coupling: action and reaction, and no traction where open")
{
  for (const Scene<3>& s : scenes<3>())
  {
    CAPTURE(s.text());
    const Pair<3> pair(s, false, Status::closed);
    const PairVector<3> b = pair.residual(pair.U);
    Vector<3> slave = Vector<3>::Zero(), master = slave;
    for (int a = 0; a < s.master.nu(); ++a)
    {
      slave += b.segment<3>(3 * a);
      master += b.segment<3>(pair.master() + 3 * a);
    }
    const Vector<3> force
        = weight * pair.lambda(pair.U) * s.placed(s.master, s.x1, s.e, s.target).n;
    REQUIRE(force.norm() > 0.1);
    REQUIRE((slave + force).norm() <= 50 * eps); // −∫ t·⟦w⟧ with partitions of unity
    REQUIRE((master - force).norm() <= 50 * eps);

    const Pair<3> open(s, false, Status::open);
    const PairVector<3> b0 = open.residual(open.U);
    REQUIRE(b0.head(open.multiplier()).norm() == 0);
    // Σ ψ_a = 1: −w/ρ_n λ, scaled
    REQUIRE(b0.tail(open.psi.size()).sum()
            == Approx(-weight * scales.pressure / open.law.rho_n * open.lambda(open.U))
                   .epsilon(50 * eps));
  }
}
