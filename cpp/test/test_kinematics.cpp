// SPDX-License-Identifier: MIT
//
// Derivatives of target, normal and gap against central differences of the nonlinear solution:
// the particle and every node of the master move, the target is solved for again.
#include "../targets/kinematics.h"
#include "facets.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

// Truncation and round-off of `central`, relative: 2e-9 was seen
constexpr double tol = 1e-8;

template <int D>
struct Perturbed
{
  static constexpr int Q = D - 1;
  using Values = Eigen::Matrix<double, Q + D + 1, 1>; // ξ, n, d_n
  const Scene<D>& scene;

  /// Values after moving the particle (node −1) or a node of the master by `change`.
  Values operator()(int node, const Vector<D>& change) const
  {
    Surface m = scene.master;
    Vector<D> x = scene.x1;
    if (node < 0)
      x += change;
    else
    {
      std::vector<double> u = scene.u;
      for (int i = 0; i < D; ++i)
        u[m.local[node] * D + i] += change[i];
      m.displace(u);
    }
    Target<D> t;
    if (not scene.solve(m, x, t))
      throw std::logic_error("the target was lost: " + scene.text());
    Kinematics<D> k;
    place<D>(m, t, x, FacetProjection<D>(m, 0).at(t.xi, false), scene.normals, scene.e, k);
    Values v;
    v << t.xi, k.n, k.gap;
    return v;
  }
};

/// Relative errors of δξ, δn and δd_n, over all directions.
template <int D, unsigned Drop = all_terms>
Eigen::Vector3d errors(const Scene<D>& s)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  const FacetPoint<D> p = FacetProjection<D>(s.master, 0).at(s.target.xi, true);
  const Kinematics<D> k = linearise<D, Drop>(s.master, s.target, s.x1, p, s.rule, s.normals, s.e);
  BasisValues M;
  s.master.ref.displacement.tabulate(s.target.xi.data(), M);

  const Perturbed<D> perturbed{s};
  Eigen::Vector3d difference = Eigen::Vector3d::Zero(), size = difference;
  for (int node = -1; node < s.master.nu(); ++node)
    for (int i = 0; i < D; ++i)
    {
      const auto fd = central([&](double h) { return perturbed(node, h * Vector<D>::Unit(i)); });
      Eigen::Matrix<double, Z, 1> z = Eigen::Matrix<double, Z, 1>::Zero();
      z[i] = node < 0 ? 1 : -M.N[node]; // ⟦δu⟧
      for (int a = 0; a < Q and node >= 0; ++a)
        z[D + a * D + i] = M.dN[a][node]; // ∂_α δu²
      const Vector<Q> dxi = k.dxi * z;
      const Vector<D> dn = k.dn * z;
      const double dgap = k.dgap * z;
      difference += Eigen::Vector3d((fd.template head<Q>() - dxi).squaredNorm(),
                                    (fd.template segment<D>(Q) - dn).squaredNorm(),
                                    std::pow(fd[Q + D] - dgap, 2));
      size += Eigen::Vector3d(fd.template head<Q>().squaredNorm(),
                              fd.template segment<D>(Q).squaredNorm(), std::pow(fd[Q + D], 2));
    }
  // what cannot change must not: then its size is zero, and so must be the difference
  Eigen::Vector3d out;
  for (int i = 0; i < 3; ++i)
    out[i] = size[i] > 0 ? std::sqrt(difference[i] / size[i]) : difference[i];
  return out;
}

template <int D>
void like_differences()
{
  for (const Scene<D>& s : scenes<D>())
  {
    const Eigen::Vector3d error = errors<D>(s);
    CAPTURE(s.text(), error.transpose());
    REQUIRE(error.maxCoeff() <= tol);
  }
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
    Kinematics<D> k;
    place<D>(s.master, s.target, s.x1, p, s.normals, s.e, k);
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

} // namespace

TEST_CASE("kinematics: target, normal and gap move as differences say")
{
  like_differences<2>();
  like_differences<3>();
}

TEST_CASE("kinematics: curved facets, open and penetrating")
{
  are_hard_enough<2>();
  are_hard_enough<3>();
}

TEST_CASE("kinematics: the differences notice a missing term")
{
  // (F4') without r·∂²x² and without r·∂δu², where ‖r‖ is 0.1 to 0.3 of a facet
  int seen = 0;
  for (const Scene<3>& s : scenes<3>())
    if (s.rule == TargetRule::proximity and s.free() and s.curved())
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
    if (s.rule == TargetRule::proximity and s.free())
    {
      const FacetPoint<3> p = FacetProjection<3>(s.master, 0).at(s.target.xi, true);
      const Kinematics<3> k = linearise<3>(s.master, s.target, s.x1, p, s.rule, s.normals, s.e);
      CAPTURE(s.text());
      REQUIRE((k.dgap.head<3>() - k.n.transpose()).norm() <= 1e-12); // r·τ: the target's accuracy
      REQUIRE(k.dgap.tail<6>().norm() <= 1e-12);
    }
}
