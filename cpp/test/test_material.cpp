// SPDX-License-Identifier: MIT
#include "../material/j2_plasticity.h"

#include <Eigen/Dense>
#include <catch2/catch.hpp>
#include <random>
#include <unsupported/Eigen/MatrixFunctions>

using namespace dolfinx_contact;

namespace
{
using Matrix3 = Eigen::Matrix3d;
using Matrix = Eigen::MatrixXd;

// aluminium sheet, MPa
const Elasticity elastic = {.lambda = 39810, .mu = 26540};
const Hardening swift = Swift{589, 1e-4, 0.216};
const Hardening never = Voce{1e9, 0, 0, 0}; // yields nowhere

const std::vector<std::pair<const char*, Hardening>> laws
    = {{"Swift", swift},
       {"nearly vertical Swift", Swift{589, 1e-14, 0.02}},
       {"linear", Voce{80, 0, 0, 500}},
       {"perfect", Voce{80, 0, 0, 0}},
       {"Voce", Voce{80, 200, 15, 30}},
       {"table", Tabulated{{0, 0.01, 0.1, 1}, {80, 120, 200, 400}}}};

/// One point, or what a step gives there.
struct Point
{
  std::array<double, 6> cp = {1, 1, 1, 0, 0, 0}, tau = {};
  double ep = 0;
  std::vector<double> P, A;
  int bad = 0;

  /// A step of the components of F from here.
  Point step(const Hardening& law, const std::vector<double>& F) const
  {
    const int k = F.size();
    Point p;
    p.P.resize(k);
    p.A.resize(k * k);
    p.bad = update(elastic, law, k, F, {cp, {&ep, 1}}, {{p.cp, {&p.ep, 1}}, p.tau, p.P, p.A});
    return p;
  }

  Point step(const Hardening& law, const Matrix3& F) const { return step(law, flat(F)); }

  static std::vector<double> flat(const Matrix3& F)
  {
    const Matrix3 rows = F.transpose();
    return {rows.data(), rows.data() + 9};
  }

  /// F of its 4, 5 or 9 components.
  static Matrix3 embed(const std::vector<double>& f)
  {
    Matrix3 F = Matrix3::Identity();
    if (f.size() == 9)
      F << f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8];
    else
      F.topLeftCorner<2, 2>() << f[0], f[1], f[2], f[3];
    if (f.size() == 5)
      F(2, 2) = f[4];
    return F;
  }

  static Matrix3 symmetric(const std::array<double, 6>& s)
  {
    return (Matrix3() << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2]).finished();
  }

  Matrix3 stress() const { return Eigen::Map<const Matrix3>(P.data()).transpose(); }
  Matrix3 kirchhoff() const { return symmetric(tau); }

  double mises() const
  {
    const Matrix3 t = kirchhoff();
    return std::sqrt(1.5) * (t - t.trace() / 3 * Matrix3::Identity()).norm();
  }
};

Matrix3 random_matrix(std::mt19937& random, double size)
{
  std::uniform_real_distribution<double> d(-size, size);
  return Matrix3::NullaryExpr([&] { return d(random); });
}

Matrix3 rotation(std::mt19937& random)
{
  return Eigen::HouseholderQR<Matrix3>(random_matrix(random, 1)).householderQ();
}

/// Relative error of A against central differences of fourth order.
double tangent_error(const Point& old, const Hardening& law, const std::vector<double>& F)
{
  const int k = F.size();
  const double h = 2e-5; // truncation and round-off are both about 1e-11
  Matrix A(k, k), difference(k, k);
  const Point p = old.step(law, F);
  REQUIRE(p.bad == 0);
  for (int j = 0; j < k; ++j)
  {
    auto P = [&](double d)
    {
      std::vector<double> moved = F;
      moved[j] += d;
      const std::vector<double> P = old.step(law, moved).P;
      return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(P.data(), k));
    };
    difference.col(j) = (8 * (P(h) - P(-h)) - (P(2 * h) - P(-2 * h))) / (12 * h);
    for (int i = 0; i < k; ++i)
      A(i, j) = p.A[k * i + j];
  }
  return (A - difference).norm() / difference.norm();
}

} // namespace

TEST_CASE("Plasticity: elastic stress is the derivative of Hencky's energy")
{
  std::mt19937 random(1);
  for (int trial = 0; trial < 20; ++trial)
  {
    const Matrix3 F = Matrix3::Identity() + random_matrix(random, 0.3);
    auto energy = [&](const Matrix3& F)
    {
      const Matrix3 E = 0.5 * Matrix3(F.transpose() * F).log();
      return elastic.lambda / 2 * E.trace() * E.trace() + elastic.mu * E.squaredNorm();
    };
    Matrix3 P;
    const double h = 1e-4;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
      {
        auto at = [&](double d)
        {
          Matrix3 moved = F;
          moved(i, j) += d;
          return energy(moved);
        };
        P(i, j) = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h);
      }
    const Point p = Point().step(never, F);
    CHECK((p.stress() - P).norm() < 1e-8 * P.norm());
    CHECK((p.kirchhoff() - p.stress() * F.transpose()).norm() < 1e-13 * P.norm());
    CHECK(p.ep == 0);
  }
}

TEST_CASE("Plasticity: small strains keep their digits")
{
  std::mt19937 random(2);
  const Matrix3 e = random_matrix(random, 1);
  for (double size : {1e-6, 1e-9, 1e-12})
  {
    const Matrix3 F = Matrix3::Identity() + size * e, H = F - Matrix3::Identity();
    const Matrix3 s = 0.5 * (H + H.transpose());
    const Matrix3 P = elastic.lambda * s.trace() * Matrix3::Identity() + 2 * elastic.mu * s;
    CHECK((Point().step(never, F).stress() - P).norm() < (10 * size + 1e-14) * P.norm());
  }
  CHECK(Point().step(swift, Matrix3::Identity()).stress().norm() == 0);
}

TEST_CASE("Plasticity: the return ends on the yield surface")
{
  std::mt19937 random(3);
  for (const auto& [name, law] : laws)
  {
    CAPTURE(name);
    Point p;
    Matrix3 F = Matrix3::Identity();
    for (int step = 0; step < 40; ++step)
    {
      F += random_matrix(random, step < 20 ? 0.003 : 0.1);
      const Point next = p.step(law, F);
      REQUIRE(next.bad == 0);
      const double yield = std::visit([&](const auto& l) { return l(next.ep).stress; }, law);
      CHECK(next.ep >= p.ep);
      if (next.ep > p.ep)
        CHECK(next.mises() == Approx(yield).epsilon(1e-11));
      else
        CHECK(next.mises() <= yield * (1 + 1e-11));
      p = next;
    }
    CHECK(p.ep > 0.1);
    CHECK(std::abs(Point::symmetric(p.cp).determinant() - 1) < 1e-12);
    // volume is elastic: log det F = tr τ/(3κ)
    const double volume = p.kirchhoff().trace() / (3 * elastic.lambda + 2 * elastic.mu);
    CHECK(volume == Approx(std::log(F.determinant())).margin(1e-12));
  }
}

TEST_CASE("Plasticity: the return finds its root however large the step")
{
  for (const auto& [name, law] : laws)
    for (double q : {1e-3, 1.0, 200.0, 1e4, 1e7})
      for (double ep : {0.0, 1e-8, 0.3})
      {
        CAPTURE(name, q, ep);
        std::visit(
            [&](const auto& l)
            {
              const Flow f = flow(l, elastic.mu, q, ep);
              if (q <= l(ep).stress)
                CHECK(f.amount == 0);
              else
                // a step of Δε_p by round-off changes the right side by as much
                CHECK(std::abs(q - 3 * elastic.mu * f.amount - l(ep + f.amount).stress)
                      < 1e-14 * (q + (3 * elastic.mu + f.slope) * (ep + f.amount)));
            },
            law);
      }
}

TEST_CASE("Plasticity: the tangent is the derivative of the stress")
{
  std::mt19937 random(4);
  const int k = GENERATE(4, 5, 9);
  const std::vector<int> kept = k == 9   ? std::vector{0, 1, 2, 3, 4, 5, 6, 7, 8}
                                : k == 5 ? std::vector{0, 1, 3, 4, 8}
                                         : std::vector{0, 1, 3, 4};
  auto components = [&](const Matrix3& F)
  {
    const std::vector<double> all = Point::flat(F);
    std::vector<double> some;
    for (int i : kept)
      some.push_back(all[i]);
    return some;
  };
  for (const auto& [name, law] : laws)
    for (int trial = 0; trial < 10; ++trial)
    {
      CAPTURE(name, k, trial);
      const Matrix3 F = Matrix3::Identity() + random_matrix(random, 0.2);
      CHECK(tangent_error(Point(), never, components(F)) < 1e-8);
      const Point p = Point().step(law, components(F));
      CHECK(p.ep > 1e-3);
      CHECK(tangent_error(Point(), law, components(F)) < 1e-8);
      // from there on: plastic flow, or unloading to half the elastic strain
      const Matrix3 G = F + random_matrix(random, 0.2);
      CHECK(tangent_error(p, law, components(G)) < 1e-8);
      const Matrix3 V = Point::embed(components(F));
      const Matrix3 b = V * Point::symmetric(p.cp) * V.transpose();
      const Matrix3 back = b.sqrt().sqrt().inverse() * V;
      if (k > 4) // plane strain could not go there
        CHECK(p.step(law, components(back)).ep == p.ep);
      CHECK(tangent_error(p, law, components(back)) < 1e-8);
    }
}

TEST_CASE("Plasticity: the tangent where eigenvalues are equal, or nearly")
{
  std::mt19937 random(5);
  const bool plastic = GENERATE(false, true);
  const double apart = GENERATE(0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 3e-2);
  CAPTURE(plastic, apart);
  const Hardening& law = plastic ? swift : never;
  const Matrix3 R = rotation(random), Q = rotation(random);
  const Eigen::Vector3d two(1.2, 1.2 * (1 + apart), 0.8),
      three(1.1, 1.1 * (1 + apart), 1.1 + apart);
  CHECK(tangent_error(Point(), law, Point::flat(R * two.asDiagonal() * Q)) < 1e-8);
  CHECK(tangent_error(Point(), law, Point::flat(two.asDiagonal())) < 1e-8);
  CHECK(tangent_error(Point(), never, Point::flat(R * three.asDiagonal() * Q)) < 1e-8);
  CHECK(tangent_error(Point(), never, Point::flat(three.asDiagonal())) < 1e-8);
  // near F = I, elastic
  const Matrix3 F = Matrix3::Identity() + apart * random_matrix(random, 1e-2);
  CHECK(tangent_error(Point(), swift, Point::flat(F)) < 1e-8);
}

TEST_CASE("Plasticity: stresses turn with the body")
{
  std::mt19937 random(6);
  Point p;
  Matrix3 F = Matrix3::Identity();
  for (int step = 0; step < 5; ++step)
  {
    F += random_matrix(random, 0.1);
    Matrix3 Q = rotation(random);
    Q *= Q.determinant(); // proper
    const Point next = p.step(swift, F), turned = p.step(swift, Q * F);
    CHECK((turned.stress() - Q * next.stress()).norm() < 1e-11 * next.stress().norm());
    CHECK(turned.ep == Approx(next.ep).epsilon(1e-12));
    p = next;
  }
}

TEST_CASE("Plasticity: inverted and non-finite points are counted and harm no other")
{
  const Matrix3 good = Eigen::Vector3d(1.1, 1, 1).asDiagonal();
  Matrix3 inverted = good, infinite = good, undefined = good;
  inverted(0, 0) = -1;
  infinite(1, 0) = std::numeric_limits<double>::infinity();
  undefined(0, 1) = std::nan("");
  const std::vector<Matrix3> points = {good, inverted, infinite, undefined, Matrix3::Zero(), good};
  const std::size_t n = points.size();
  std::vector<double> F, cp_old, ep_old(n, 0.01), cp(6 * n), ep(n), tau(6 * n), P(9 * n), A(81 * n);
  for (const Matrix3& point : points)
  {
    const std::vector<double> f = Point::flat(point);
    F.insert(F.end(), f.begin(), f.end());
    cp_old.insert(cp_old.end(), {1, 1, 1, 0, 0, 0});
  }
  CHECK(update(elastic, swift, 9, F, {cp_old, ep_old}, {{cp, ep}, tau, P, A}) == 4);
  for (std::size_t i = 0; i < n; ++i)
  {
    const bool fine = i == 0 or i == n - 1;
    CHECK(std::isfinite(P[9 * i]) == fine);
    CHECK(std::isfinite(A[81 * i]) == fine);
    CHECK((ep[i] > 0.01) == fine);
    CHECK(std::isfinite(cp[6 * i]));
  }
  std::vector<double> q(n);
  trial_stress(elastic, 9, F, cp_old, q);
  CHECK(std::isfinite(q[0]));
  CHECK(std::isnan(q[1]));
  CHECK_THROWS_AS(update(elastic, swift, 7, F, {cp_old, ep_old}, {{cp, ep}, tau, P, A}),
                  std::invalid_argument);
  CHECK_THROWS_AS(update(elastic, swift, 9, F, {cp_old, ep}, {{cp, q}, tau, P, cp}),
                  std::invalid_argument);
}

TEST_CASE("Plasticity: flow that is given does the same as the law's")
{
  std::mt19937 random(7);
  const Matrix3 F = Matrix3::Identity() + random_matrix(random, 0.2);
  const std::vector<double> f = Point::flat(F);
  const Point start, p = start.step(swift, F);
  std::array<double, 1> q;
  trial_stress(elastic, 9, f, start.cp, q);
  const Flow solved = flow(std::get<Swift>(swift), elastic.mu, q[0], 0);
  const std::array<double, 2> given = {solved.amount, solved.slope};
  Point g = p;
  g.P.assign(9, 0);
  update_given(elastic, given, 9, f, {start.cp, {&start.ep, 1}},
               {{g.cp, {&g.ep, 1}}, g.tau, g.P, g.A});
  CHECK(g.P == p.P);
  CHECK(g.A == p.A);
  CHECK(g.cp == p.cp);
}
