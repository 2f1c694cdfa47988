// SPDX-License-Identifier: MIT
//
// First variations of a target, a normal and a gap: (F4'), (F5'), (F6'), (F4c), (F7'), (F8') and
// (F12).
//
// All of them are linear in a few local vectors, whatever the elements: the jump ⟦δu⟧, the
// tangential derivatives ∂_α δu² of the master's displacement at the target, collected in
//
//     z = (⟦δu⟧, ∂_1 δu² [, ∂_2 δu²]),    D numbers each,
//
// and, for interpolated normals, m = Σ_A N_A δn_A, the variation of the normal field M at fixed ξ.
// δξ, δn and δd_n are small matrices that act on z and on m. Only the assembly knows which degrees
// of freedom they stand for.
#pragma once

#include "../geometry/normals.h"
#include "facet_projection.h"
#include "search.h"

#include <Eigen/LU>

namespace dolfinx_contact
{

/// The terms of the tangent, as bits. Tests leave single terms out to show that each is needed;
/// the default keeps them all and costs nothing.
enum Term : unsigned
{
  all_terms = 0,
  target_curvature = 1u << 0,    // (F4') (x¹ − x²)·∂²_αβ x²
  target_gradient = 1u << 1,     // (F4') (x¹ − x²)·∂_α δu²
  edge_curvature = 1u << 2,      // (F4c) r·T_m ∂²_EE x²
  edge_gradient = 1u << 3,       // (F4c) r·T_m ∂_E δu²
  normal_gradient = 1u << 4,     // (F7') ∂_α δu² in δτ_α
  normal_curvature = 1u << 5,    // (F7') ∂²_αβ x² δξ^β in δτ_α
  gap_sliding = 1u << 6,         // (F12) τ_α δξ^α
  gap_turning = 1u << 7,         // (F12) (x¹ − x²)·δn
  traction_turning = 1u << 8,    // (F9) λ δn
  traction_multiplier = 1u << 9, // (F9) δλ n
  moving_target = 1u << 10,      // (F9) t·∂_α w² δξ^α
  gap_row = 1u << 11,            // (F13) δd_n λ*
  open_row = 1u << 12,           // (F13) δλ λ*/ρ_n
  smooth_offset = 1u << 13,      // (F6') d ∂_α n̄
  smooth_field = 1u << 14,       // (F6') d δn̄ at fixed ξ
  edge_turning = 1u << 15,       // (F4c) ∂_E m
  edge_field = 1u << 16,         // (F4c) δm at fixed ξ
  normal_field = 1u << 17,       // (F8') δn̄ at fixed ξ
  normal_sliding = 1u << 18,     // (F8') ∂_α n̄ δξ^α
  last_term = normal_sliding
};

/// Which normal enters the gap and the traction (formulation, section 5).
enum class NormalRule : std::int8_t
{
  facet,        ///< (F7)
  interpolated, ///< (F8)
  direction     ///< n = sign(e·n_f) e
};

/// Normal, gap and their variations at one particle.
template <int D>
struct Kinematics
{
  static constexpr int Q = D - 1;
  static constexpr int Z = D + Q * D; ///< size of z

  Vector<D> n = Vector<D>::Zero(); ///< inward to the master
  Vector<D> r = Vector<D>::Zero(); ///< x¹ − x²
  double gap = -INFINITY;          ///< d_n, positive in penetration

  Eigen::Matrix<double, Q, Z> dxi; ///< δξ = dxi z
  Eigen::Matrix<double, D, Z> dn;  ///< δn = dn z
  Eigen::Matrix<double, 1, Z> dgap;

  /// The same for m: δξ += dxi_m m, and so on; zero without interpolated normals.
  Eigen::Matrix<double, Q, D> dxi_m = Eigen::Matrix<double, Q, D>::Zero();
  Eigen::Matrix<double, D, D> dn_m = Eigen::Matrix<double, D, D>::Zero();
  Eigen::Matrix<double, 1, D> dgap_m = Eigen::Matrix<double, 1, D>::Zero();
};

/// n̄ = M/‖M‖ at a point of a facet, and how it varies.
template <int D>
struct InterpolatedNormal
{
  Vector<D> n = Vector<D>::Zero();
  Eigen::Matrix<double, D, D - 1> dn = Eigen::Matrix<double, D, D - 1>::Zero(); ///< ∂_α n̄
  Eigen::Matrix<double, D, D> of_m
      = Eigen::Matrix<double, D, D>::Zero(); ///< δn̄ at fixed ξ: (I − n̄⊗n̄)/‖M‖ m

  InterpolatedNormal() = default;
  explicit InterpolatedNormal(const NormalField<D>& field)
  {
    const double length = field.M.norm();
    n = field.M / length;
    of_m = (Eigen::Matrix<double, D, D>::Identity() - n * n.transpose()) / length;
    dn = of_m * field.dM;
  }
};

/// Normal and gap of a target (no variations).
/// @param field normal field at the target, for interpolated normals
template <int D>
void place(const Surface& master, const Target<D>& t, const Vector<D>& x1, const FacetPoint<D>& p,
           NormalRule rule, const Vector<D>& e, Kinematics<D>& k,
           const NormalField<D>* field = nullptr)
{
  if (rule == NormalRule::interpolated)
    k.n = field->M.normalized();
  else
    k.n = FacetProjection<D>(master, t.facet).normal(p);
  if (rule == NormalRule::direction)
    k.n = e.dot(k.n) < 0 ? Vector<D>(-e) : e;
  k.r = x1 - p.x;
  k.gap = k.r.dot(k.n);
}

namespace impl
{
// δξ of a target that is free to move on its facet
template <int D, unsigned Drop>
void free_target(TargetRule rule, const Vector<D>& e, const FacetPoint<D>& p,
                 const InterpolatedNormal<D>& nbar, Kinematics<D>& k)
{
  constexpr int Q = D - 1;
  if (rule == TargetRule::proximity)
  {
    // (F4') A δξ = ⟦δu⟧·τ_α + r·∂_α δu²,  A_αβ = τ_α·τ_β − r·∂²_αβ x²
    Eigen::Matrix<double, Q, Q> A = p.tau.transpose() * p.tau;
    if constexpr (not(Drop & target_curvature))
      for (int a = 0; a < Q; ++a)
        for (int b = 0; b < Q; ++b)
          A(a, b) -= k.r.dot(p.d2(a, b));
    Eigen::Matrix<double, Q, Kinematics<D>::Z> rhs;
    rhs.setZero();
    rhs.template leftCols<D>() = p.tau.transpose();
    if constexpr (not(Drop & target_gradient))
      for (int a = 0; a < Q; ++a)
        rhs.template block<1, D>(a, D + a * D) = k.r.transpose();
    k.dxi = A.inverse() * rhs;
  }
  else if (rule == TargetRule::smooth)
  {
    // (F6') [τ_α + d ∂_α n̄, n̄] (δξ, δd) = ⟦δu⟧ − d δn̄
    const double d = k.r.dot(nbar.n);
    Eigen::Matrix<double, D, D> A;
    A << p.tau, nbar.n;
    if constexpr (not(Drop & smooth_offset))
      A.template leftCols<Q>() += d * nbar.dn;
    k.dxi.template leftCols<D>() = A.inverse().template topRows<Q>();
    if constexpr (not(Drop & smooth_field))
      k.dxi_m = -d * k.dxi.template leftCols<D>() * nbar.of_m;
  }
  else
  {
    // (F5') [τ_1 τ_2 −e] (δξ, δs) = ⟦δu⟧
    Eigen::Matrix<double, D, D> A;
    A << p.tau, -e;
    k.dxi.template leftCols<D>() = A.inverse().template topRows<Q>();
  }
}

// δξ of a target clamped to an edge (F4c). The rule's direction m is zero for proximity, constant
// for a seek direction and n̄ for smooth targets.
template <int D, unsigned Drop>
void clamped_target(const Vector<D>& m, const Vector<D - 1>& E, const FacetPoint<D>& p,
                    const InterpolatedNormal<D>& nbar, bool smooth, Kinematics<D>& k)
{
  const Vector<D> tau = p.tau * E;
  const double tau_m = m.dot(tau), r_m = m.dot(k.r);
  const Vector<D> b = tau - tau_m * m, rm = k.r - r_m * m;
  double A = tau.dot(b);
  if constexpr (not(Drop & edge_curvature))
    for (int i = 0; i < D - 1; ++i)
      for (int j = 0; j < D - 1; ++j)
        A -= E[i] * E[j] * rm.dot(p.d2(i, j));
  if constexpr (not(Drop & edge_turning))
    if (smooth)
    {
      const Vector<D> dm = nbar.dn * E; // ∂_E m
      A += tau_m * k.r.dot(dm) + r_m * dm.dot(tau);
    }
  Eigen::Matrix<double, 1, Kinematics<D>::Z> deta;
  deta.setZero();
  deta.template leftCols<D>() = b.transpose() / A;
  if constexpr (not(Drop & edge_gradient))
    for (int a = 0; a < D - 1; ++a) // ∂_E δu² = E^α ∂_α δu²
      deta.template segment<D>(D + a * D) = E[a] * rm.transpose() / A;
  k.dxi = E * deta;
  if constexpr (not(Drop & edge_field))
    if (smooth)
      k.dxi_m = -E * ((tau_m * k.r + r_m * tau).transpose() * nbar.of_m) / A;
}
} // namespace impl

/// All variations of one particle's target.
/// @param p the target's position with its curvature
/// @param e unit direction of (F5), zero for the other rules
/// @param field normal field at the target, for interpolated normals (smooth targets have these)
template <int D, unsigned Drop = all_terms>
Kinematics<D> linearise(const Surface& master, const Target<D>& t, const Vector<D>& x1,
                        const FacetPoint<D>& p, TargetRule target_rule, NormalRule normal_rule,
                        const Vector<D>& e, const NormalField<D>* field = nullptr)
{
  constexpr int Q = D - 1;
  Kinematics<D> k;
  place<D>(master, t, x1, p, normal_rule, e, k, field);
  const bool interpolated = normal_rule == NormalRule::interpolated;
  const InterpolatedNormal<D> nbar
      = interpolated ? InterpolatedNormal<D>(*field) : InterpolatedNormal<D>();

  k.dxi.setZero();
  if (t.clamp == Clamp::none)
    impl::free_target<D, Drop>(target_rule, e, p, nbar, k);
  else if (t.clamp == Clamp::edge)
  {
    const bool smooth = target_rule == TargetRule::smooth;
    impl::clamped_target<D, Drop>(smooth ? k.n : e,
                                  FacetProjection<D>::edge_direction(master.ref.shape, t.edge), p,
                                  nbar, smooth, k);
  }

  k.dn.setZero();
  if (normal_rule == NormalRule::facet)
  {
    // (F7') δn = ± T (δτ_1 × τ_2 + τ_1 × δτ_2) / ‖τ_1 × τ_2‖,  δτ_α = ∂_α δu² + ∂²_αβ x² δξ^β
    const Vector<D> area = p.area_vector();
    const double scale = master.sigma[t.facet] / area.norm();
    const Eigen::Matrix<double, D, D> T
        = Eigen::Matrix<double, D, D>::Identity() - k.n * k.n.transpose();
    for (int a = 0; a < Q; ++a)
    {
      // P δτ_a is the variation of the area vector with τ_a
      Eigen::Matrix<double, D, D> P;
      if constexpr (D == 2)
        P << 0, 1, -1, 0;
      else
      {
        const Vector<3> v = a == 0 ? Vector<3>(-p.tau.col(1)) : Vector<3>(p.tau.col(0));
        P << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0; // P c = v × c
      }
      P = scale * T * P;
      if constexpr (not(Drop & normal_gradient))
        k.dn.template middleCols<D>(D + a * D) += P;
      if constexpr (not(Drop & normal_curvature))
        for (int b = 0; b < Q; ++b)
          k.dn += P * p.d2(a, b) * k.dxi.row(b);
    }
  }

  else if (interpolated)
  {
    // (F8') δn = δn̄|_ξ + ∂_α n̄ δξ^α
    if constexpr (not(Drop & normal_field))
      k.dn_m += nbar.of_m;
    if constexpr (not(Drop & normal_sliding))
    {
      k.dn += nbar.dn * k.dxi;
      k.dn_m += nbar.dn * k.dxi_m;
    }
  }

  // (F12) δd_n = (⟦δu⟧ − τ_α δξ^α)·n + r·δn
  k.dgap.setZero();
  k.dgap.template leftCols<D>() = k.n.transpose();
  if constexpr (not(Drop & gap_sliding))
  {
    k.dgap -= (k.n.transpose() * p.tau) * k.dxi;
    k.dgap_m -= (k.n.transpose() * p.tau) * k.dxi_m;
  }
  if constexpr (not(Drop & gap_turning))
  {
    k.dgap += k.r.transpose() * k.dn;
    k.dgap_m += k.r.transpose() * k.dn_m;
  }
  return k;
}

} // namespace dolfinx_contact
