// SPDX-License-Identifier: MIT
//
// Particles with their targets on strongly curved facets, and how to differentiate what they do.
#pragma once

#include "../targets/kinematics.h"
#include "facets.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <optional>
#include <stdexcept>

namespace dolfinx_contact::test
{

/// Step of `central`. Facets have unit size and derivatives of order one (the fifth: below 1e5), so
/// that truncation and round-off are both near 1e-11.
constexpr double step = 1e-4;

/// Derivative of f at 0 by central differences of fourth order.
template <typename F>
auto central(F f)
{
  return ((8 * (f(step) - f(-step)) - (f(2 * step) - f(-2 * step))) / (12 * step)).eval();
}

/// ‖a − b‖/‖b‖.
inline double relative(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  return (a - b).norm() / b.norm();
}

/// (I − v⊗v): how the direction of a unit vector v may change.
template <int D>
Eigen::Matrix<double, D, D> beside(const Vector<D>& v)
{
  return Eigen::Matrix<double, D, D>::Identity() - v * v.transpose();
}

/// n_0 of a particle whose normal n is now: turned by some 20 degrees.
template <int D>
Vector<D> before(const Vector<D>& n)
{
  return (n + 0.5 * Vector<D>::UnitX()).normalized();
}

/// D − 1 orthonormal vectors in no particular direction.
template <int D>
std::vector<Vector<D>> random_tangents(std::mt19937& random)
{
  std::vector<Vector<D>> t = {uniform_vector<D>(random, -1, 1).normalized()};
  if (D == 3)
    t.push_back((beside<D>(t[0]) * uniform_vector<D>(random, -1, 1)).normalized());
  return t;
}

/// A rotation by 0.3 to 1.5 rad.
template <int D>
Eigen::Matrix<double, D, D> random_rotation(std::mt19937& random)
{
  const double angle = uniform(random, 0.3, 1.5);
  if constexpr (D == 2)
    return Eigen::Rotation2D<double>(angle).toRotationMatrix();
  else
    return Eigen::AngleAxis<double>(angle, uniform_vector<D>(random, -1, 1).normalized())
        .toRotationMatrix();
}

/// Interpolated normals of the master, now and in the old configuration.
template <int D>
struct BothNormals
{
  const NodalNormals<D>&now, &old;
};

/// ⟦Δu⟧ at ξ of facet f by its definitions: τ_α (c^α − c^α_old) with least squares r = τ_α c^α, or
/// for interpolated normals r = τ_α c^α + d n̄; or r − r_old; r = x¹ − x².
template <int D>
Vector<D> slip_of(const Surface& m, int f, const Vector<D - 1>& xi, const Vector<D>& x1,
                  const Vector<D>& x1_old, bool convected,
                  std::optional<BothNormals<D>> normals = {})
{
  BasisValues b;
  m.ref.position.tabulate(xi.data(), b);
  const FacetPoint<D> p = evaluate<D>(m.facet_x(f), m.np(), b, false),
                      old = evaluate<D>(m.facet_x_old(f), m.np(), b, false);
  const Vector<D> r = x1 - p.x, r_old = x1_old - old.x;
  if (not convected)
    return r - r_old;
  if (normals)
  {
    const auto c = [&](const FacetPoint<D>& at, const Vector<D>& r, const NodalNormals<D>& n)
    {
      Eigen::Matrix<double, D, D> A;
      A << at.tau, n.at(m, f, xi.data()).M.normalized();
      return Vector<D - 1>(A.colPivHouseholderQr().solve(r).template head<D - 1>());
    };
    return p.tau * (c(p, r, normals->now) - c(old, r_old, normals->old));
  }
  const Vector<D - 1> c = p.tau.colPivHouseholderQr().solve(r),
                      c_old = old.tau.colPivHouseholderQr().solve(r_old);
  return p.tau * (c - c_old);
}

/// The same as the library has it, with its derivatives.
template <int D>
Slip<D> library_slip(const Surface& m, const Target<D>& t, const Vector<D>& x1,
                     const Vector<D>& x1_old, bool convected,
                     std::optional<BothNormals<D>> normals = {})
{
  BasisValues b;
  m.ref.position.tabulate(t.xi.data(), b, true);
  const FacetPoint<D> p = evaluate<D>(m.facet_x(t.facet), m.np(), b, true),
                      old = evaluate<D>(m.facet_x_old(t.facet), m.np(), b, true);
  const Vector<D> r = x1 - p.x, r_old = x1_old - old.x;
  if (not convected)
    return Slip<D>::increment(p, old, r, r_old);
  if (not normals)
    return Slip<D>::convected(p, old, r, r_old);
  const auto at = [&](const NodalNormals<D>& n)
  { return InterpolatedNormal<D>(n.at(m, t.facet, t.xi.data())); };
  return Slip<D>::convected(p, old, r, r_old, at(normals->now), at(normals->old));
}

/// A particle and its target on one strongly curved facet of unit size.
template <int D>
struct Scene
{
  Element element;
  Rules rules;
  Surface master;                  ///< in its present and its old position
  std::vector<double> u;           ///< present displacement of its nodes
  Vector<D> e = Vector<D>::Zero(); ///< zero for proximity
  Target<D> target = {};
  Vector<D> x1 = Vector<D>::Zero(), x1_old = x1; ///< the particle

  std::string text() const
  {
    return element.text() + (rules.target == TargetRule::proximity ? ", proximity" : ", direction")
           + (rules.turning ? " that turns" : "")
           + (rules.normal == NormalRule::facet ? ", facet normal" : ", direction as normal")
           + (target.clamp == Clamp::none   ? ""
              : target.clamp == Clamp::edge ? ", edge"
                                            : ", vertex");
  }

  bool free() const { return target.clamp == Clamp::none; }

  /// True if ∂²x² does not vanish (bilinear facets: only the mixed one).
  bool curved() const { return element.position == 2 or element.shape == Shape::quadrilateral; }

  /// True if the normal is not fixed in space.
  bool normal_turns() const { return rules.normal == NormalRule::facet or rules.turning; }

  /// The target of the particle x on the surface m along `direction`, clamped as `target` is.
  bool solve(const Surface& m, const Vector<D>& x, const Vector<D>& direction, Target<D>& t) const
  {
    t = target;
    const FacetProjection<D> facet(m, 0);
    double s;
    if (t.clamp == Clamp::edge)
      facet.clamp(x, direction, target.edge, t);
    else if (free())
      return rules.target == TargetRule::proximity ? facet.closest(x, t.xi)
                                                   : facet.intersect(x, direction, t.xi, s);
    return t.clamp == target.clamp and t.edge == target.edge;
  }

  /// Normal and gap there.
  Kinematics<D> placed(const Surface& m, const Vector<D>& x, const Vector<D>& direction,
                       const Target<D>& t) const
  {
    Kinematics<D> k;
    place<D>(m, t, x, FacetProjection<D>(m, 0).at(t.xi, false), rules.normal, direction, k);
    return k;
  }

  /// All variations; those of the slip by either measure.
  template <unsigned Drop = all_terms>
  Kinematics<D> linearised(bool convected) const
  {
    const FacetPoint<D> p = FacetProjection<D>(master, 0).at(target.xi, true);
    const Slip<D> slip = library_slip<D>(master, target, x1, x1_old, convected);
    return linearise<D, Drop>(master, target, x1, p, rules, e, nullptr, &slip);
  }
};

/// Choose an old position of a scene's facet and particle, at random like the present one; the
/// particle is 0.1 to 0.3 from where its target was.
/// @returns false if the facet is badly shaped there, or the slip is hardly tangential
template <int D>
bool draw_old(Scene<D>& s, std::mt19937& random)
{
  s.master.remember(random_displacement(s.master, 0.1, random));
  BasisValues b;
  s.master.ref.position.tabulate(s.target.xi.data(), b);
  const FacetPoint<D> old = evaluate<D>(s.master.facet_x_old(0), s.master.np(), b, false);
  s.x1_old = old.x + uniform(random, 0.1, 0.3) * uniform_vector<D>(random, -1, 1).normalized();
  const Vector<D> n = s.placed(s.master, s.x1, s.e, s.target).n;
  auto slides = [&](bool convected)
  {
    const Vector<D> slip = slip_of<D>(s.master, 0, s.target.xi, s.x1, s.x1_old, convected);
    return (beside<D>(n) * slip).norm() > 0.1;
  };
  return old.area_vector().squaredNorm() > 0.1 and slides(true) and slides(false);
}

/// Draw until the problem is well-posed: (F4), (F4c) at least 0.3 times as stiff as if flat, e at
/// most 60 degrees from the normal, curvature at least 0.05 where it enters, r not along n by
/// chance. ‖x¹ − x²‖ is 0.1 to 0.3, in penetration or open.
template <int D>
Scene<D> draw(const Element& element, const Rules& rules, Clamp clamp, std::mt19937& random)
{
  constexpr int Q = D - 1;
  const bool proximity = rules.target == TargetRule::proximity;
  for (int attempt = 0; attempt < 1000; ++attempt)
  {
    Scene<D> s{element, rules, single_facet<D>(element, 0.2, random), {}};
    s.u = random_displacement(s.master, 0.1, random);
    s.master.displace(s.u);
    const FacetProjection<D> facet(s.master, 0);
    s.target = {0, uniform_vector<Q>(random, 0.2, 0.45), clamp, 0};
    const int corner = random() % num_vertices(element.shape);
    Vector<Q> E = Vector<Q>::Zero();
    if (clamp != Clamp::none)
    {
      s.target.edge = static_cast<std::int8_t>(corner);
      s.target.xi = facet.vertex(element.shape, corner);
    }
    if (clamp == Clamp::edge)
    {
      E = facet.edge_direction(element.shape, corner);
      s.target.xi = facet.vertex(element.shape, reference_edge(element.shape, corner)[0])
                    + uniform(random, 0.2, 0.8) * E;
    }

    const FacetPoint<D> p = facet.at(s.target.xi, true);
    const Vector<D> n = facet.normal(p), tau = p.tau * E;
    if (not proximity)
    {
      s.e = (n + uniform_vector<D>(random, -1, 1)).normalized();
      if (random() % 2)
        s.e = -s.e;
    }
    Vector<D> r = uniform_vector<D>(random, -1, 1);
    if (clamp == Clamp::none)
      r = proximity ? n : s.e;
    else if (clamp == Clamp::edge)
    {
      const Vector<D> b = tau - s.e.dot(tau) * s.e; // (F4c): r·b = 0
      r -= r.dot(b) / b.squaredNorm() * b;
    }
    r *= uniform(random, 0.1, 0.3) / r.norm();
    if (random() % 2)
      r = -r;
    s.x1 = p.x + r;

    if (not proximity and std::abs(s.e.dot(n)) < 0.5)
      continue;
    const bool along_n = proximity and clamp == Clamp::none;
    if (not along_n and std::abs(r.dot(n)) > 0.95 * r.norm())
      continue;
    const Eigen::Matrix<double, Q, Q> metric = p.tau.transpose() * p.tau;
    Eigen::Matrix<double, Q, Q> bend; // r·∂²x²
    const Vector<D> rm = r - s.e.dot(r) * s.e;
    for (int a = 0; a < Q; ++a)
      for (int b = 0; b < Q; ++b)
        bend(a, b) = rm.dot(p.d2(a, b));
    const Eigen::Matrix<double, Q, Q> A = metric - bend;
    if (metric.determinant() < 0.1)
      continue;
    if (clamp == Clamp::none and proximity
        and (A.determinant() < 0.3 * metric.determinant() or A(0, 0) < 0
             or (s.curved() and bend.norm() < 0.05)))
      continue;
    if (clamp == Clamp::edge
        and (E.dot(A * E) - std::pow(s.e.dot(tau), 2) < 0.3 * E.dot(metric * E)
             or (element.position == 2 and std::abs(E.dot(bend * E)) < 0.05)))
      continue;
    Target<D> again;
    if (not s.solve(s.master, s.x1, s.e, again) or (again.xi - s.target.xi).norm() > 1e-9)
      continue;
    s.target = again;
    if (draw_old(s, random))
      return s;
  }
  throw std::logic_error("no well-posed scene found: " + element.text());
}

/// Two draws of all elements × rules × clamps; in the first one a direction turns.
template <int D>
std::vector<Scene<D>> scenes()
{
  std::mt19937 random(11);
  std::vector<Scene<D>> out;
  for (const Element& element : elements<D>())
    for (auto [rule, normals] : {std::pair(TargetRule::proximity, NormalRule::facet),
                                 std::pair(TargetRule::direction, NormalRule::facet),
                                 std::pair(TargetRule::direction, NormalRule::direction)})
      for (Clamp clamp : {Clamp::none, Clamp::edge, Clamp::vertex})
        for (int i = 0; i < 2 and not(D == 2 and clamp == Clamp::edge); ++i)
        {
          const bool turning = rule == TargetRule::direction and i == 0;
          out.push_back(draw<D>(element, {rule, normals, turning}, clamp, random));
        }
  return out;
}

} // namespace dolfinx_contact::test
