// SPDX-License-Identifier: MIT
#include "../mechanics/coupling.h"
#include "scenes.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// P_B, by its definition.
template <int D>
Vector<D> on_ball(const Vector<D>& g)
{
  return g.norm() > 1 ? Vector<D>(g / g.norm()) : g;
}

/// Numbers of a particle, and their variations at random.
template <int D>
struct Sample
{
  static constexpr int Z = Kinematics<D>::Z;
  ContactLaw law;
  double lambda = -1.4;
  Kinematics<D> k;
  Vector<D> Lambda;
  std::optional<double> threshold = {}; ///< frozen
  std::optional<bool> held = {};        ///< true: it slips

  /// @param size of g_τ
  Sample(bool augmented, double size, std::mt19937& random)
      : law{.rho_n = 2.3, .augmented = augmented, .friction = 0.6, .rho_t = 1.7}
      , Lambda(uniform_vector<D>(random, -0.4, 0.4))
  {
    k.n = uniform_vector<D>(random, -1, 1).normalized();
    k.gap = 0.17;
    k.slip = uniform_vector<D>(random, -1, 1);
    // a multiple of the slip that gives g_τ that size, its normal part at will
    const Vector<D> g = (beside<D>(k.n) * k.slip).normalized() * size;
    k.slip = (g - beside<D>(k.n) * R_Lambda()) / law.rho_t + 0.3 * k.n;
    for (int j = 0; j < Z; ++j)
    {
      k.z.n.col(j) = uniform_vector<D>(random, -1, 1);
      k.z.slip.col(j) = uniform_vector<D>(random, -1, 1);
      k.z.gap[j] = uniform(random, -1, 1);
    }
  }

  Vector<D> R_Lambda() const { return turned<D>(before<D>(k.n), k.n, Lambda); }

  Friction<D> friction(const Vector<D>& n, double gap, const Vector<D>& L,
                       const Vector<D>& slip) const
  {
    const double limit = law.continuous ? pressed(law, lambda, gap) : lambda;
    Friction<D> f(law, threshold.value_or(limit), before<D>(k.n), n, L, slip, held);
    f.frozen = threshold.has_value();
    return f;
  }
  Friction<D> friction() const { return friction(k.n, k.gap, Lambda, k.slip); }

  /// Traction and (F3) with n, d_n, slip and Λ changed. T = I − n⊗n also where n is no unit vector.
  Eigen::Matrix<double, 2 * D, 1> at(const Vector<D>& dn, double dgap, const Vector<D>& dslip,
                                     const Vector<D>& dLambda, bool rubs) const
  {
    const Vector<D> n = k.n + dn;
    const Vector<D> L = Lambda + dLambda;
    const Friction<D> f = rubs ? friction(n, k.gap + dgap, L, k.slip + dslip) : Friction<D>();
    Eigen::Matrix<double, 2 * D, 1> out;
    out << traction<D>(law, lambda, n, k.gap + dgap, f),
        law.friction * f.limit / law.rho_t * f.turned_defect() - f.rest * L;
    return out;
  }
};

} // namespace

TEST_CASE("ContactLaw: status and traction")
{
  const ContactLaw law{10, false}, augmented{10, true};
  REQUIRE(closed(law, -1, 0));
  REQUIRE(closed(law, 0, 0.1));
  REQUIRE(closed(law, -1, -0.099));
  REQUIRE_FALSE(closed(law, -1, -0.101));
  REQUIRE_FALSE(closed(law, 0, 0));          // χ is the indicator of the negative reals
  REQUIRE_FALSE(closed(law, -1, -INFINITY)); // no target
  const Vector<2> n(0.6, 0.8);
  REQUIRE(traction<2>(law, -2, n, 0.1, {}) == Vector<2>(-2 * n));
  REQUIRE(traction<2>(augmented, -2, n, 0.1, {}) == Vector<2>(-3 * n));

  // with friction, which keeps λ
  ContactLaw rough = augmented;
  rough.friction = 0.5;
  const Vector<2> t(-0.8, 0.6);
  const Friction<2> sticks(rough, -2, n, n, Vector<2>(0.25 * t), Vector<2>(0.5 * t + 3 * n));
  REQUIRE((traction<2>(rough, -2, n, 0.1, sticks) - (-3 * n - 0.75 * t)).norm() <= 8 * eps);
  const Friction<2> slips(rough, -2, n, n, Vector<2>::Zero(), Vector<2>(4 * t + 3 * n));
  REQUIRE((traction<2>(rough, -2, n, 0.1, slips) - (-3 * n - t)).norm() <= 8 * eps);
  REQUIRE_FALSE(sticks.slips);
  REQUIRE(slips.slips);
}

TEST_CASE("ContactLaw: where friction acts")
{
  ContactLaw law;
  law.friction = 0.3;
  REQUIRE(rubs(law, true, -1e-300));
  REQUIRE_FALSE(rubs(law, true, 0));
  REQUIRE_FALSE(rubs(law, true, 1)); // tension would reverse it
  REQUIRE_FALSE(rubs(law, false, -1));
  law.least = 1e-3;
  REQUIRE(rubs(law, true, -1.1e-3));
  REQUIRE_FALSE(rubs(law, true, -1e-3));
  law.friction = 0;
  REQUIRE_FALSE(rubs(law, true, -1));
  REQUIRE_FALSE(Friction<3>().acts);
  const Vector<3> n = Vector<3>::UnitX(), none = Vector<3>::Zero();
  REQUIRE(Friction<3>(law, -1, n, n, none, none).acts);
}

TEST_CASE("ContactLaw: (F2) vanishes where Signorini's conditions hold, and only there")
{
  // one multiplier with ψ = 1: λ ≤ 0, d_n ≤ 0, λ d_n = 0
  const ContactLaw law{.rho_n = 2};
  const double one = 1;
  CouplingBasis<2> B;
  B.N = B.psi = &one;
  B.multiplier = 1;
  int solutions = 0;
  for (double lambda : {-3.0, -1.0, -0.1, 0.0, 0.1, 2.0})
    for (double gap : {-1.0, -0.5, -0.05, 0.0, 0.05, 1.0})
    {
      PairVector<2> b = PairVector<2>::Zero(1);
      add_residual<2>(B, law, closed(law, lambda, gap), lambda, gap, Vector<2>::Zero(),
                      Vector<2>::Zero(), {}, 1.0, {}, b);
      const bool holds = lambda <= 0 and gap <= 0 and lambda * gap == 0;
      CAPTURE(lambda, gap);
      REQUIRE((b[0] == 0) == holds);
      solutions += holds;
    }
  REQUIRE(solutions == 7);
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: (F3) vanishes where Coulomb's law holds, and only there", "",
                       ((int D), D), 2, 3)
{
  // ‖TΛ‖ ≤ 1; no slip, or ‖TΛ‖ = 1 and the slip along it; then friction dissipates
  std::mt19937 random(4);
  const ContactLaw law{.friction = 0.4, .rho_t = 1.3};
  int solutions = 0;
  for (int i = 0; i < 50; ++i)
  {
    const Vector<D> n = uniform_vector<D>(random, -1, 1).normalized(),
                    d = (beside<D>(n) * uniform_vector<D>(random, -1, 1)).normalized();
    for (double size : {0.0, 0.3, 0.9, 1.0, 1.1, 2.0})
      for (double along : {-2.0, -0.1, 0.0, 0.1, 2.0})
      {
        const Vector<D> Lambda = size * d + uniform(random, -1, 1) * n; // TΛ alone counts
        const Vector<D> slip = along * d;
        const Friction<D> f(law, -2, n, n, Lambda, slip);
        const bool holds = size <= 1 and (along == 0 or (size == 1 and along > 0));
        CAPTURE(size, along);
        REQUIRE((f.defect.norm() <= 20 * eps) == holds);
        REQUIRE(f.p.norm() <= 1 + 4 * eps);
        REQUIRE(std::abs(f.p.dot(n)) <= 4 * eps);
        if (holds)
          REQUIRE(traction<D>(law, -2, n, 0, f).dot(slip)
                  == Approx(-2 * 0.4 * std::abs(along)).margin(20 * eps));
        solutions += holds;
      }
  }
  REQUIRE(solutions == 50 * 6);
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: Λ turns with the normal", "", ((int D), D), 2, 3)
{
  std::mt19937 random(8);
  for (int i = 0; i < 20; ++i)
  {
    const Vector<D> n0 = uniform_vector<D>(random, -1, 1).normalized(),
                    n = (n0 + uniform_vector<D>(random, -0.7, 0.7)).normalized(),
                    Lambda = uniform_vector<D>(random, -1, 1);
    const Vector<D> slip = uniform_vector<D>(random, -1, 1);
    const ContactLaw law{.friction = 0.3};
    const FrictionTangent<D> f(Friction<D>(law, -1, n0, n, Lambda, slip));
    REQUIRE((f.R * n0 - n).norm() <= 20 * eps);
    REQUIRE((f.R.transpose() * f.R - beside<D>(Vector<D>::Zero())).norm() <= 20 * eps);
    REQUIRE((turned<D>(n0, n, Lambda) - f.R * Lambda).norm() <= 20 * eps);
    REQUIRE((turned<D>(n, n0, Lambda) - f.R.transpose() * Lambda).norm() <= 20 * eps);
    REQUIRE((turned<D>(n0, n0, Lambda) - Lambda).norm() <= 20 * eps);
    REQUIRE((f.turned_defect() - f.R.transpose() * f.defect).norm() <= 20 * eps);
    REQUIRE(f.defect.norm() > 1e-3);
    for (int j = 0; j < D; ++j)
    {
      // T = I − n⊗n also where n is no unit vector
      auto there = [&](double h) { return Vector<D>(n + h * Vector<D>::Unit(j)); };
      auto T = [&](const Vector<D>& at, const Vector<D>& v) -> Vector<D>
      { return v - at.dot(v) * at; };
      const Vector<D> of_n
          = central([&](double h) { return T(there(h), turned<D>(n0, there(h), Lambda)); }),
          test = central([&](double h) { return turned<D>(there(h), n0, f.defect); });
      REQUIRE((f.Lambda_of_n.col(j) - of_n).norm() <= 1e-9);
      REQUIRE((f.test_of_n.col(j) - test).norm() <= 1e-9);
    }
  }
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: P_B and its derivative", "", ((int D), D), 2, 3)
{
  std::mt19937 random(5);
  for (double size : {0.0, 0.4, 0.95, 1.05, 3.0, 40.0})
    for (int i = 0; i < 10; ++i)
    {
      const Sample<D> s(false, size, random);
      const FrictionTangent<D> f(s.friction());
      const Vector<D> g = beside<D>(s.k.n) * (s.R_Lambda() + s.law.rho_t * s.k.slip);
      CAPTURE(size);
      REQUIRE(g.norm() == Approx(size).margin(20 * eps));
      REQUIRE((f.p - on_ball<D>(g)).norm() <= 20 * eps);
      REQUIRE(f.slips == (size > 1));
      REQUIRE((f.defect - (beside<D>(s.k.n) * s.R_Lambda() - f.p)).norm() <= 20 * eps);
      for (int j = 0; j < D; ++j) // (F10), in all directions
      {
        const Vector<D> dp
            = central([&](double h) { return on_ball<D>(g + h * Vector<D>::Unit(j)); });
        REQUIRE((f.DP.col(j) - dp).norm() <= 1e-10);
      }
    }
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: at the edge of the ball the derivative is that of slip", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(6);
  const ContactLaw law{.friction = 0.3};
  const Vector<D> n = uniform_vector<D>(random, -1, 1).normalized(),
                  d = (beside<D>(n) * uniform_vector<D>(random, -1, 1)).normalized();
  for (double size : {1 - 1e-12, 1 - eps, 1.0, 1 + eps, 1 + 1e-12})
  {
    const FrictionTangent<D> f(Friction<D>(law, -1, n, n, size * d, Vector<D>::Zero()));
    CAPTURE(size - 1);
    REQUIRE(f.slips);
    REQUIRE((f.DP - beside<D>(d)).norm() <= 1e-11);
    REQUIRE((f.p - d).norm() <= 2e-12); // P_B itself is continuous
    REQUIRE(f.p.norm() <= 1 + 4 * eps);
  }
  REQUIRE_FALSE(Friction<D>(law, -1, n, n, (1 - 1e-7) * d, Vector<D>::Zero()).slips);
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: the linearised traction is the traction's derivative", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(3);
  const Vector<D> none = Vector<D>::Zero();
  for (bool augmented : {false, true})
    for (double size : {0.0, 0.4, 0.9, 1.1, 3.0}) // of g_τ; 0: no friction
    {
      const Sample<D> s(augmented, size, random);
      const bool rubs = size > 0;
      const auto out = respond<D, all_terms>(
          s.law, s.lambda, s.k, s.k.z, FrictionTangent<D>(rubs ? s.friction() : Friction<D>()));
      CAPTURE(augmented, size);
      for (int j = 0; j < s.Z; ++j)
      {
        const Vector<D> dn = s.k.z.n.col(j), dslip = s.k.z.slip.col(j);
        const double dgap = s.k.z.gap[j];
        auto at = [&](double h) { return s.at(h * dn, h * dgap, h * dslip, none, rubs); };
        Eigen::Matrix<double, 2 * D, 1> expected = central(at), found;
        found << out.t.col(j), out.row.col(j);
        REQUIRE((found - expected).norm() <= 1e-9);
        if (not rubs)
        {
          // quadratic in (n, d_n): central differences have no truncation, hence a large step
          const double h = 0.5, tol = 20 * eps / h;
          expected = (at(h) - at(-h)) / (2 * h);
          REQUIRE((found - expected).norm() <= tol);
        }
      }
      REQUIRE(out.t.norm() > 1);
      REQUIRE((out.row.norm() > 0) == rubs);
      if (rubs and (D == 3 or size < 1)) // slip in 2D: ±n turned by 90°, and so is Λ*
        REQUIRE(out.row.norm() > 0.1);
    }
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: the derivative of the continuous law, with what is left of κ",
                       "", ((int D), D), 2, 3)
{
  std::mt19937 random(9);
  const Vector<D> none = Vector<D>::Zero();
  for (bool rest : {false, true})
    for (bool frozen : {false, true})
      for (double size : {0.4, 0.9, 1.1, 3.0})
      {
        Sample<D> s(false, size, random);
        s.law.continuous = true;
        s.law.kappa = (rest ? 2 : 0.5) * s.law.friction / s.law.rho_t
                      * std::abs(pressed(s.law, s.lambda, s.k.gap));
        if (frozen)
          s.threshold = 0.9 * pressed(s.law, s.lambda, s.k.gap);
        const FrictionTangent<D> f(s.friction());
        CAPTURE(rest, frozen, size, f.rest);
        REQUIRE((f.rest > 0.1) == rest);
        REQUIRE((rest or f.rest == 0));
        REQUIRE(f.slips == (size > 1));
        auto differences = [&](int j)
        {
          const Vector<D> dn = s.k.z.n.col(j), dslip = s.k.z.slip.col(j);
          const double dgap = s.k.z.gap[j];
          return central([&](double h) { return s.at(h * dn, h * dgap, h * dslip, none, true); });
        };
        const auto out = respond<D, all_terms>(s.law, s.lambda, s.k, s.k.z, f);
        ContactLaw other = s.law; // as if the limit did not vary, which differences must notice
        other.continuous = false;
        other.augmented = true;
        const auto wrong = respond<D, all_terms>(other, s.lambda, s.k, s.k.z, f);
        double noticed = 0;
        for (int j = 0; j < s.Z; ++j)
        {
          Eigen::Matrix<double, 2 * D, 1> found, without;
          found << out.t.col(j), out.row.col(j);
          without << wrong.t.col(j), wrong.row.col(j);
          REQUIRE((found - differences(j)).norm() <= 1e-9);
          noticed = std::max(noticed, (without - differences(j)).norm());
        }
        REQUIRE((noticed > 1e-3) == not frozen);
      }
}

TEMPLATE_TEST_CASE_SIG("ContactLaw: a held status, and its derivative", "", ((int D), D), 2, 3)
{
  std::mt19937 random(10);
  const Vector<D> none = Vector<D>::Zero();
  for (bool slips : {false, true})
    for (double size : {0.4, 0.9, 1.1, 3.0})
    {
      Sample<D> s(false, size, random);
      s.held = slips;
      const FrictionTangent<D> f(s.friction());
      CAPTURE(slips, size);
      REQUIRE(f.slips == slips);
      // it sticks beyond 1, and slips below 1
      REQUIRE(f.p.norm() == Approx(slips ? 1 : size));
      const auto out = respond<D, all_terms>(s.law, s.lambda, s.k, s.k.z, f);
      for (int j = 0; j < s.Z; ++j)
      {
        const Vector<D> dn = s.k.z.n.col(j), dslip = s.k.z.slip.col(j);
        const double dgap = s.k.z.gap[j];
        const Eigen::Matrix<double, 2 * D, 1> fd
            = central([&](double h) { return s.at(h * dn, h * dgap, h * dslip, none, true); });
        Eigen::Matrix<double, 2 * D, 1> found;
        found << out.t.col(j), out.row.col(j);
        REQUIRE((found - fd).norm() <= 1e-8);
      }
    }
}
