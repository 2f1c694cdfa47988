// SPDX-License-Identifier: MIT
//
// Derivatives of target, normal, gap and slip against central differences of the nonlinear
// solution: the particle, every node of the master and a seek direction that turns move, the target
// is solved for again.
#include "scenes.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

// Truncation and round-off of `central`, relative: 7e-10 was seen
constexpr double tol = 1e-8;

/// Relative errors of δξ, δn, δd_n and of δ⟦Δu⟧, convected and as the plain increment.
using Errors = Eigen::Matrix<double, 5, 1>;

template <int D>
struct Perturbed
{
  static constexpr int Q = D - 1, size = Q + D + 1 + 2 * D;
  using Values = Eigen::Matrix<double, size, 1>; // ξ, n, d_n and both slips
  const Scene<D>& scene;

  Values at(const Surface& m, const Vector<D>& x, const Vector<D>& e) const
  {
    Target<D> t;
    if (not scene.solve(m, x, e, t))
      throw std::logic_error("the target was lost: " + scene.text());
    const Kinematics<D> k = scene.placed(m, x, e, t);
    Values v;
    v << t.xi, k.n, k.gap, slip_of<D>(m, 0, t.xi, x, scene.x1_old, true),
        slip_of<D>(m, 0, t.xi, x, scene.x1_old, false);
    return v;
  }

  /// Values after moving the particle (node −1) or a node of the master by `change`.
  Values moved(int node, const Vector<D>& change) const
  {
    if (node < 0)
      return at(scene.master, scene.x1 + change, scene.e);
    Surface m = scene.master;
    std::vector<double> u = scene.u;
    for (int i = 0; i < D; ++i)
      u[m.local[node] * D + i] += change[i];
    m.displace(u);
    return at(m, scene.x1, scene.e);
  }

  /// Values with another direction e.
  Values turned(const Vector<D>& change) const
  {
    return at(scene.master, scene.x1, (scene.e + change).normalized());
  }

  /// The values' variation, from those with the convected slip and with the increment.
  template <int C>
  static Values predict(const Variation<D, C>& v, const Variation<D, C>& w,
                        const Eigen::Matrix<double, C, 1>& c)
  {
    Values out;
    out << v.xi * c, v.n * c, v.gap * c, v.slip * c, w.slip * c;
    return out;
  }

  /// Squares of the norms of ξ, n, d_n and the slips.
  static Errors squares(const Values& v)
  {
    Errors out;
    out << v.template head<Q>().squaredNorm(), v.template segment<D>(Q).squaredNorm(),
        v[Q + D] * v[Q + D], v.template segment<D>(Q + D + 1).squaredNorm(),
        v.template tail<D>().squaredNorm();
    return out;
  }
};

/// Relative errors over all motions of the particle and of the master's nodes.
template <int D, unsigned Drop = all_terms>
Errors errors(const Scene<D>& s)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  const Kinematics<D> k = s.template linearised<Drop>(true), l = s.template linearised<Drop>(false);
  BasisValues M;
  s.master.ref.displacement.tabulate(s.target.xi.data(), M);

  const Perturbed<D> perturbed{s};
  Errors difference = Errors::Zero(), size = difference;
  for (int node = -1; node < s.master.nu(); ++node)
    for (int i = 0; i < D; ++i)
    {
      const auto fd
          = central([&](double h) { return perturbed.moved(node, h * Vector<D>::Unit(i)); });
      Eigen::Matrix<double, Z, 1> z = Eigen::Matrix<double, Z, 1>::Zero();
      z[i] = node < 0 ? 1 : -M.N[node]; // ⟦δu⟧
      for (int a = 0; a < Q and node >= 0; ++a)
        z[D + a * D + i] = M.dN[a][node]; // ∂_α δu²
      difference += perturbed.squares(fd - perturbed.predict(k.z, l.z, z));
      size += perturbed.squares(fd);
    }
  // what cannot change must not: then its size is zero, and so must be the difference
  Errors out;
  for (int i = 0; i < out.size(); ++i)
    out[i] = size[i] > 0 ? std::sqrt(difference[i] / size[i]) : difference[i];
  return out;
}

/// Absolute errors (facets have unit size) over all turns of the direction, and the size of the
/// variations.
template <int D>
std::pair<Errors, Errors> turning_errors(const Scene<D>& s)
{
  const Kinematics<D> k = s.linearised(true), l = s.linearised(false);
  const Perturbed<D> perturbed{s};
  Errors difference = Errors::Zero(), size = difference;
  for (int i = 0; i < D; ++i)
  {
    const auto fd = central([&](double h) { return perturbed.turned(h * Vector<D>::Unit(i)); });
    const Vector<D> change = beside<D>(s.e).col(i);
    difference += perturbed.squares(fd - perturbed.predict(k.e, l.e, change));
    size += perturbed.squares(fd);
  }
  return {difference.cwiseSqrt(), size.cwiseSqrt()};
}

template <int D>
void like_differences()
{
  for (const Scene<D>& s : scenes<D>())
  {
    const Errors error = errors<D>(s);
    CAPTURE(s.text(), error.transpose());
    REQUIRE(error.maxCoeff() <= tol);
  }
}

template <int D>
void turn_like_differences()
{
  int seen = 0;
  for (const Scene<D>& s : scenes<D>())
    if (s.rules.turning)
    {
      const auto [error, size] = turning_errors<D>(s);
      CAPTURE(s.text(), error.transpose(), size.transpose());
      REQUIRE(error.maxCoeff() <= tol);
      // what must change, else the comparison would be easier than it looks
      const bool moves = s.target.clamp != Clamp::vertex;
      REQUIRE((size[0] > 0.01) == moves);
      REQUIRE((size[1] > 0.01)
              == (s.rules.normal == NormalRule::direction or (moves and s.curved())));
      REQUIRE((size[4] > 1e-3) == moves);
      ++seen;
    }
    else
    {
      const Kinematics<D> k = s.linearised(true);
      REQUIRE(k.e.xi.norm() + k.e.n.norm() + k.e.gap.norm() + k.e.slip.norm() == 0);
    }
  REQUIRE(seen == 3 * (D - 1) * 2 * (D == 2 ? 2 : 3)); // elements, normals, clamps
}

// The scenes are what they are meant to be, else the comparison would be easier than it looks
template <int D>
void are_hard_enough()
{
  int open = 0, penetrating = 0;
  for (const Scene<D>& s : scenes<D>())
  {
    const FacetProjection<D> facet(s.master, 0);
    const FacetPoint<D> p = facet.at(s.target.xi, true);
    const Kinematics<D> k = s.placed(s.master, s.x1, s.e, s.target);
    CAPTURE(s.text());
    REQUIRE(k.r.norm() >= 0.1 - 1e-9); // 1e-9: `draw`
    REQUIRE(k.r.norm() <= 0.3 + 1e-9);
    REQUIRE(std::abs(k.n.norm() - 1) <= 4 * eps);
    REQUIRE(s.curved() == (p.curvature.norm() > 1e-3));
    (k.gap > 0 ? penetrating : open)++;
    if (s.free())
      REQUIRE(facet.outside(s.target.xi) == 0);
  }
  REQUIRE(std::min(open, penetrating) > 10);
}

// The old configuration becomes the present one turned and shifted
template <int D>
void no_slip_if_rigid()
{
  std::mt19937 random(8);
  for (const Scene<D>& s : scenes<D>())
  {
    const Eigen::Matrix<double, D, D> R = random_rotation<D>(random);
    const Vector<D> c = uniform_vector<D>(random, -1, 1);
    Surface m = s.master;
    m.x_old = m.x;
    for (std::size_t i = 0; i < m.x.size(); i += D)
    {
      Eigen::Map<Vector<D>> x(&m.x[i]);
      x = (R * x + c).eval();
    }
    const Vector<D> x1 = R * s.x1 + c;
    Target<D> t;
    CAPTURE(s.text());
    REQUIRE(s.solve(m, x1, R * s.e, t));
    const Slip<D> slip = library_slip<D>(m, t, x1, s.x1, true);
    REQUIRE(slip.value.norm() <= 50 * eps); // of numbers up to 3
    // the paper's measure does slip: by about the rotation times the gap
    REQUIRE(library_slip<D>(m, t, x1, s.x1, false).value.norm() > 1e-3);
  }
}

// A flat facet in the plane x_D = 0 and a particle at a distance from it
template <int D>
void slides_by_hand()
{
  std::mt19937 random(9);
  for (const Element& element : elements<D>())
  {
    Surface m = single_facet<D>(element, 0.0, random); // flat: x = X
    const Eigen::Matrix<double, D, D> R = random_rotation<D>(random);
    Vector<D> slide = uniform_vector<D>(random, -0.2, 0.2),
              x1_old = uniform_vector<D>(random, 0, 1);
    slide[D - 1] = 0;
    for (std::size_t i = 0; i < m.x.size(); i += D)
    {
      Eigen::Map<Vector<D>> x(&m.x[i]);
      x = (R * x).eval();
    }
    const Vector<D> x1 = R * (x1_old + slide + 0.1 * Vector<D>::Unit(D - 1)); // and lifts off
    Target<D> t;
    t.facet = 0;
    t.xi.setConstant(0.3);
    const FacetProjection<D> facet(m, 0);
    CAPTURE(element.text());
    REQUIRE(facet.closest(x1, t.xi));
    REQUIRE((library_slip<D>(m, t, x1, x1_old, true).value - R * slide).norm() <= 50 * eps);
  }
}

} // namespace

TEST_CASE("kinematics: target, normal, gap and slip move as differences say")
{
  like_differences<2>();
  like_differences<3>();
}

TEST_CASE("kinematics: they follow a seek direction that turns as differences say")
{
  turn_like_differences<2>();
  turn_like_differences<3>();
}

TEST_CASE("kinematics: curved facets, open and penetrating")
{
  are_hard_enough<2>();
  are_hard_enough<3>();
}

TEMPLATE_TEST_CASE_SIG("kinematics: a rigid motion is no slip, at any gap and at clamped targets",
                       "", ((int D), D), 2, 3)
{
  no_slip_if_rigid<D>();
}

TEMPLATE_TEST_CASE_SIG("kinematics: the slip of a particle that slides along a turning plane", "",
                       ((int D), D), 2, 3)
{
  slides_by_hand<D>();
}

TEST_CASE("kinematics: the slip of a closest point is the formulation's")
{
  // there r·τ_α = 0: τ_α τ^α_old·(x²_old − x1_old)
  for (const Scene<3>& s : scenes<3>())
    if (s.rules.target == TargetRule::proximity and s.free())
    {
      BasisValues b;
      s.master.ref.position.tabulate(s.target.xi.data(), b);
      const FacetPoint<3> p = evaluate<3>(s.master.facet_x(0), s.master.np(), b, false),
                          old = evaluate<3>(s.master.facet_x_old(0), s.master.np(), b, false);
      const Vector<3> slip
          = p.tau * old.tau.colPivHouseholderQr().solve(Vector<3>(old.x - s.x1_old));
      CAPTURE(s.text());
      // r·τ: the target's accuracy
      REQUIRE((s.linearised(true).slip - slip).norm() <= 1e-12);
    }
}

TEST_CASE("kinematics: the differences notice a missing term")
{
  // (F4') without r·∂²x² and without r·∂δu², where ‖r‖ is 0.1 to 0.3 of a facet
  int seen = 0;
  for (const Scene<3>& s : scenes<3>())
    if (s.rules.target == TargetRule::proximity and s.free() and s.curved())
    {
      ++seen;
      CAPTURE(s.text());
      REQUIRE(errors<3, target_curvature>(s)[0] > 1e-3);
      REQUIRE(errors<3, target_gradient>(s)[0] > 1e-3);
    }
  REQUIRE(seen == 10);
}

TEST_CASE("kinematics: an unclamped closest point changes the gap by the normal jump alone")
{
  for (const Scene<3>& s : scenes<3>())
    if (s.rules.target == TargetRule::proximity and s.free())
    {
      const Kinematics<3> k = s.linearised(true);
      CAPTURE(s.text());
      // r·τ: the target's accuracy
      REQUIRE((k.z.gap.head<3>() - k.n.transpose()).norm() <= 1e-12);
      REQUIRE(k.z.gap.tail<6>().norm() <= 1e-12);
    }
}
