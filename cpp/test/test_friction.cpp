// SPDX-License-Identifier: MIT
//
// One particle's tangent with friction against differences of its residual, for all unknowns of the
// pair; and the same with one term left out at a time, which the differences must notice.
#include "pair.h"

#include <catch2/catch.hpp>
#include <utility>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double tol = 1e-8; // truncation and round-off of `central`, relative

// the terms of a direction that turns, and of friction
constexpr unsigned num_terms = 11;
constexpr unsigned term(unsigned i)
{
  return 1u << (19 + i);
}
static_assert(term(0) == seek_turning and term(num_terms - 1) == last_term,
              "test the new terms too");

/// Where a term must be felt by a particle that rubs; elsewhere it is zero.
template <int D>
bool matters(unsigned term, const Pair<D>& pair)
{
  const Scene<D>& s = pair.scene;
  const bool vertex = s.target.clamp == Clamp::vertex;
  // a particle that slips in 2D: P_B = ±t depends on n alone
  const bool given = D == 2 and pair.status == Status::slip;
  switch (term)
  {
  case seek_turning:
    return pair.turns() and s.free();
  case seek_edge:
    return pair.turns() and s.target.clamp == Clamp::edge;
  case seek_normal:
    return pair.turns() and s.rules.normal == NormalRule::direction;
  case slip_gradient:
    return pair.convected and not given;
  case slip_sliding: // on affine facets the convected slip is the same for all ξ
    return not vertex and not given and not(pair.convected and not s.curved());
  case friction_slip:
    return not given;
  case friction_turning:
  case row_turning:
    return s.normal_turns();
  case friction_row:
    return s.normal_turns() or not given;
  case friction_multiplier:
  case row_multiplier:
    return true;
  default:
    return false;
  }
}

/// How often each term mattered.
template <int D, unsigned... I>
void compare_all(const Pair<D>& pair, std::array<int, num_terms>& count,
                 std::integer_sequence<unsigned, I...>)
{
  const Eigen::MatrixXd fd = pair.differences(), K = pair.template derivative<true>();
  CAPTURE(pair.scene.text(), name(pair.status), pair.convected, pair.law.augmented);
  CAPTURE(pair.law.rho_t, relative(K, fd));
  REQUIRE(relative(K, fd) <= tol);
  ((count[I] += compare_without(term(I), pair.template derivative<true, term(I)>(), K, fd,
                                matters<D>(term(I), pair))),
   ...);
}

template <int D>
std::array<int, num_terms> compare_scenes()
{
  std::array<int, num_terms> count{};
  bool augmented = false;
  for (const Scene<D>& s : scenes<D>())
  {
    for (Status status : {Status::stick, Status::slip})
      for (bool convected : {false, true})
      {
        compare_all<D>(Pair<D>(s, augmented, status, true, convected), count,
                       std::make_integer_sequence<unsigned, num_terms>());
        augmented = not augmented;
      }
    augmented = not augmented; // both with both measures
  }
  return count;
}

} // namespace

TEST_CASE("friction: the tangent is the derivative of the residual, and needs all its terms (2D)")
{
  const std::array<int, num_terms> count = compare_scenes<2>();
  for (unsigned i = 0; i < num_terms; ++i)
  {
    CAPTURE(i);
    REQUIRE((count[i] > 0) == (term(i) != seek_edge)); // no edges in 2D
  }
}

TEST_CASE("friction: the tangent is the derivative of the residual, and needs all its terms (3D)")
{
  const std::array<int, num_terms> count = compare_scenes<3>();
  for (unsigned i = 0; i < num_terms; ++i)
  {
    CAPTURE(i);
    REQUIRE(count[i] > 0);
  }
}

TEMPLATE_TEST_CASE_SIG("friction: where it does not act its unknowns are held at zero", "",
                       ((int D), D), 2, 3)
{
  for (const Scene<D>& s : scenes<D>())
    for (Status status : {Status::closed, Status::open})
    {
      const Pair<D> pair(s, false, status, true), without(s, false, status);
      CAPTURE(s.text(), name(status));
      // λ > −least, however hard the particle slides
      REQUIRE_FALSE(rubs(pair.law, true, pair.lambda(pair.U)));
      const Eigen::MatrixXd K = pair.template derivative<true>();
      REQUIRE(relative(K, pair.differences()) <= tol);

      // (F3): −κ Λ·Λ*, and (F1), (F2) are those without friction
      const int first = pair.first_friction(), n = static_cast<int>(pair.tangent.size());
      const PairVector<D> b = pair.residual(pair.U);
      const Vector<D> Lambda = pair.Lambda(pair.U);
      for (int a = 0; a < n; ++a)
        REQUIRE(b[first + a]
                == Approx(-weight * scales.friction * pair.law.kappa * pair.phi[a / (D - 1)]
                          * pair.tangent[a].dot(Lambda))
                       .margin(50 * eps));
      const Eigen::MatrixXd block = K.block(first, first, n, n);
      REQUIRE(block.norm() > 0.01);
      REQUIRE((block - block.transpose()).norm() <= 50 * eps);
      REQUIRE(K.middleRows(first, n).norm() == Approx(block.norm()));
      REQUIRE(K.middleCols(first, n).norm() == Approx(block.norm()));
      std::vector<int> others; // all unknowns but those of friction
      for (int i = 0; i < pair.columns(); ++i)
        if (i < first or i >= first + n)
          others.push_back(i);
      const std::vector<int> rows(others.begin(), others.begin() + without.size());
      const Eigen::MatrixXd same = K(rows, others);
      REQUIRE(relative(same, without.template derivative<false>()) <= 50 * eps);
    }
}

TEST_CASE("friction: the traction opposes the slip, acts and reacts")
{
  for (const Scene<3>& s : scenes<3>())
    for (Status status : {Status::stick, Status::slip})
    {
      const Pair<3> pair(s, false, status, true);
      CAPTURE(s.text(), name(status));
      const PairVector<3> b = pair.residual(pair.U);
      Vector<3> slave = Vector<3>::Zero(), master = slave;
      for (int a = 0; a < s.master.nu(); ++a)
      {
        slave += b.segment<3>(3 * a);
        master += b.segment<3>(pair.master() + 3 * a);
      }
      const Vector<3> n = s.placed(s.master, s.x1, s.e, s.target).n;
      const Vector<3> g
          = beside<3>(n)
            * (turned<3>(pair.n0, n, pair.Lambda(pair.U))
               + pair.law.rho_t * slip_of<3>(s.master, 0, s.target.xi, s.x1, s.x1_old, true));
      REQUIRE(g.norm() == Approx(status == Status::slip ? 1.8 : 0.7));
      const double lambda = pair.lambda(pair.U);
      const Vector<3> p = status == Status::slip ? Vector<3>(g.normalized()) : g;
      const Vector<3> t = lambda * (n + pair.law.friction * p);
      REQUIRE((slave + weight * t).norm() <= 100 * eps); // −∫ t·⟦w⟧ with partitions of unity
      REQUIRE((master - weight * t).norm() <= 100 * eps);
    }
}
