// SPDX-License-Identifier: MIT
//
// First variations of a target, a normal, a gap and a slip: (F4'), (F5'), (F6'), (F4c), (F7'),
// (F8'), (F11) and (F12).
//
// All of them are linear in a few local vectors, whatever the elements:
//
//   z = (⟦δu⟧, ∂_1 δu² [, ∂_2 δu²])  the jump and the tangential derivatives of the master's
//                                    displacement at the target, D numbers each;
//   m = Σ_A N_A δn_A                 the variation of the master's normal field M at fixed ξ, for
//                                    interpolated normals;
//   δe                               that of a seek direction that turns with the slave.
//
// δξ, δn, δd_n and δ⟦Δu⟧ are small matrices that act on z, on m and on δe. Only the assembly knows
// which degrees of freedom they stand for.
#pragma once

#include "facet_projection.h"
#include "search.h"
#include "slip.h"

#include <Eigen/LU>
#include <array>

namespace dolfinx_contact
{

/// The terms of the tangent, as bits. Tests leave single terms out to show that each is needed;
/// the default keeps them all and costs nothing.
enum Term : unsigned
{
  all_terms = 0,
  target_curvature = 1u << 0,     // (F4') (x¹ − x²)·∂²_αβ x²
  target_gradient = 1u << 1,      // (F4') (x¹ − x²)·∂_α δu²
  edge_curvature = 1u << 2,       // (F4c) r·T_m ∂²_EE x²
  edge_gradient = 1u << 3,        // (F4c) r·T_m ∂_E δu²
  normal_gradient = 1u << 4,      // (F7') ∂_α δu² in δτ_α
  normal_curvature = 1u << 5,     // (F7') ∂²_αβ x² δξ^β in δτ_α
  gap_sliding = 1u << 6,          // (F12) τ_α δξ^α
  gap_turning = 1u << 7,          // (F12) (x¹ − x²)·δn
  traction_turning = 1u << 8,     // (F9) λ δn
  traction_multiplier = 1u << 9,  // (F9) δλ n
  moving_target = 1u << 10,       // (F9) t·∂_α w² δξ^α
  gap_row = 1u << 11,             // (F13) δd_n λ*
  open_row = 1u << 12,            // (F13) δλ λ*/ρ_n
  smooth_offset = 1u << 13,       // (F6') d ∂_α n̄
  smooth_field = 1u << 14,        // (F6') d δn̄ at fixed ξ
  edge_turning = 1u << 15,        // (F4c) ∂_E m
  edge_field = 1u << 16,          // (F4c) δm at fixed ξ
  normal_field = 1u << 17,        // (F8') δn̄ at fixed ξ
  normal_sliding = 1u << 18,      // (F8') ∂_α n̄ δξ^α
  seek_turning = 1u << 19,        // (F5') s δe
  seek_edge = 1u << 20,           // (F4c) δm = δe
  seek_normal = 1u << 21,         // δn = ±δe
  slip_gradient = 1u << 22,       // (F11) ∂_α δu² in δ⟦Δu⟧
  slip_sliding = 1u << 23,        // (F11) δξ in δ⟦Δu⟧
  friction_slip = 1u << 24,       // (F11) ρ_τ T δ⟦Δu⟧
  friction_turning = 1u << 25,    // (F11) (n·q) δn + n (δn·q)
  friction_multiplier = 1u << 26, // (F9) δλ μ p
  friction_row = 1u << 27,        // (F13) λ (δ(TΛ) − δp)
  row_turning = 1u << 28,         // (F13) δn (n·Λ) + n (δn·Λ)
  row_multiplier = 1u << 29,      // (F13) δλ (TΛ − p)
  last_term = row_multiplier,
  slip_field = 1u << 30 // (F8') δn̄ at fixed ξ in δ⟦Δu⟧
};

/// Which normal enters the gap and the traction (formulation, section 5).
enum class NormalRule : std::int8_t
{
  facet,        ///< (F7)
  interpolated, ///< (F8)
  direction     ///< n = sign(e·n_f) e
};

/// A linear map of C numbers, its rows in one piece each.
template <int R, int C>
using LinearMap = Eigen::Matrix<double, R, C, C == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

/// A v, row by row: processors then take two columns at a time, also where their number is odd (for
/// which Eigen's product takes single ones).
template <int R, int K, int C>
LinearMap<R, C> times(const Eigen::Matrix<double, R, K>& A, const LinearMap<K, C>& v)
{
  static_assert(1 <= K and K <= 3);
  LinearMap<R, C> out;
  for (int i = 0; i < R; ++i)
    if constexpr (K == 1)
      out.row(i) = A(i, 0) * v.row(0);
    else if constexpr (K == 2)
      out.row(i) = A(i, 0) * v.row(0) + A(i, 1) * v.row(1);
    else
      out.row(i) = A(i, 0) * v.row(0) + A(i, 1) * v.row(1) + A(i, 2) * v.row(2);
  return out;
}

/// δξ, δn, δd_n and δ⟦Δu⟧ as linear maps of C numbers.
template <int D, int C>
struct Variation
{
  LinearMap<D - 1, C> xi = LinearMap<D - 1, C>::Zero();
  LinearMap<D, C> n = LinearMap<D, C>::Zero();
  Eigen::Matrix<double, 1, C> gap = Eigen::Matrix<double, 1, C>::Zero();
  LinearMap<D, C> slip = LinearMap<D, C>::Zero();
};

/// Normal, gap, slip and their variations at one particle.
template <int D>
struct Kinematics
{
  static constexpr int Q = D - 1;
  static constexpr int Z = D + Q * D; ///< size of z

  Vector<D> n = Vector<D>::Zero();    ///< inward to the master
  Vector<D> r = Vector<D>::Zero();    ///< x¹ − x²
  double gap = -INFINITY;             ///< d_n, positive in penetration
  Vector<D> slip = Vector<D>::Zero(); ///< ⟦Δu⟧
  Eigen::Matrix<double, D, D> slip_of_old = Eigen::Matrix<double, D, D>::Zero(); ///< ∂⟦Δu⟧/∂x¹_old

  Variation<D, Z> z;
  Variation<D, D> m, e;

  /// Of a target and a normal that do not move, (F11), (F12): δd_n = n·⟦δu⟧, δ⟦Δu⟧ = ⟦δu⟧.
  static Kinematics fixed(const Vector<D>& n, double gap, const Vector<D>& slip)
  {
    Kinematics k;
    k.n = n;
    k.gap = gap;
    k.slip = slip;
    k.z.gap.template leftCols<D>() = n.transpose();
    k.z.slip.template leftCols<D>().setIdentity();
    return k;
  }
};

/// How a pair finds its targets and normals.
struct Rules
{
  TargetRule target = TargetRule::proximity;
  NormalRule normal = NormalRule::facet;
  bool turning = false; ///< e is the slave's own normal and turns with it
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

/// ∂n/∂τ_α of the unit normal n = ± τ_1 × τ_2/‖·‖ of a facet (F7').
/// @param sigma the sign
template <int D>
std::array<Eigen::Matrix<double, D, D>, D - 1> normal_of_tangents(const FacetPoint<D>& p,
                                                                  double sigma)
{
  using Matrix = Eigen::Matrix<double, D, D>;
  const Vector<D> area = p.area_vector();
  const double length = area.norm();
  const Vector<D> n = area / length;
  std::array<Matrix, D - 1> out;
  for (int a = 0; a < D - 1; ++a)
  {
    Matrix P; // of the area vector
    if constexpr (D == 2)
      P << 0, 1, -1, 0;
    else
    {
      const Vector<3> v = a == 0 ? Vector<3>(-p.tau.col(1)) : Vector<3>(p.tau.col(0));
      P << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0; // P c = v × c
    }
    const Eigen::Matrix<double, 1, D> along = n.transpose() * P;
    out[a] = sigma / length * (P - n * along);
  }
  return out;
}

namespace impl
{
// δξ of a target that is free to move on its facet
template <int D, unsigned Drop>
void free_target(const Rules& rules, const Vector<D>& e, const FacetPoint<D>& p,
                 const InterpolatedNormal<D>& nbar, Kinematics<D>& k)
{
  constexpr int Q = D - 1;
  if (rules.target == TargetRule::proximity)
  {
    // (F4') A δξ = ⟦δu⟧·τ_α + r·∂_α δu²,  A_αβ = τ_α·τ_β − r·∂²_αβ x²
    Eigen::Matrix<double, Q, Q> A = p.tau.transpose() * p.tau;
    if constexpr (not(Drop & target_curvature))
      for (int a = 0; a < Q; ++a)
        for (int b = 0; b < Q; ++b)
          A(a, b) -= k.r.dot(p.d2(a, b));
    LinearMap<Q, Kinematics<D>::Z> rhs;
    rhs.setZero();
    rhs.template leftCols<D>() = p.tau.transpose();
    if constexpr (not(Drop & target_gradient))
      for (int a = 0; a < Q; ++a)
        rhs.template block<1, D>(a, D + a * D) = k.r.transpose();
    k.z.xi = times(Eigen::Matrix<double, Q, Q>(A.inverse()), rhs);
  }
  else if (rules.target == TargetRule::smooth)
  {
    // (F6') [τ_α + d ∂_α n̄, n̄] (δξ, δd) = ⟦δu⟧ − d δn̄
    const double d = k.r.dot(nbar.n);
    Eigen::Matrix<double, D, D> A;
    A << p.tau, nbar.n;
    if constexpr (not(Drop & smooth_offset))
      A.template leftCols<Q>() += d * nbar.dn;
    k.z.xi.template leftCols<D>() = A.inverse().template topRows<Q>();
    if constexpr (not(Drop & smooth_field))
      k.m.xi = -d * k.z.xi.template leftCols<D>() * nbar.of_m;
  }
  else
  {
    // (F5') [τ_1 τ_2 −e] (δξ, δs) = ⟦δu⟧ + s δe
    Eigen::Matrix<double, D, D> A;
    A << p.tau, -e;
    k.z.xi.template leftCols<D>() = A.inverse().template topRows<Q>();
    if constexpr (not(Drop & seek_turning))
      if (rules.turning)
        k.e.xi = -k.r.dot(e) * k.z.xi.template leftCols<D>();
  }
}

// δξ of a target clamped to an edge (F4c). The rule's direction m is zero for proximity, e for a
// seek direction and n̄ for smooth targets.
template <int D, unsigned Drop>
void clamped_target(const Rules& rules, const Vector<D>& e, const Vector<D - 1>& E,
                    const FacetPoint<D>& p, const InterpolatedNormal<D>& nbar, Kinematics<D>& k)
{
  const bool smooth = rules.target == TargetRule::smooth;
  const Vector<D> m = smooth ? k.n : e;
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
  k.z.xi = E * deta;
  const Eigen::Matrix<double, D - 1, D> of_m = -E * (tau_m * k.r + r_m * tau).transpose() / A;
  if constexpr (not(Drop & edge_field))
    if (smooth)
      k.m.xi = of_m * nbar.of_m;
  if constexpr (not(Drop & seek_edge))
    if (rules.turning)
      k.e.xi = of_m;
}

// What follows from δξ: δn from ∂n/∂ξ (`dn`), (F12) δd_n = (⟦δu⟧ − τ_α δξ^α)·n + r·δn, and the
// slip. The parts at fixed ξ are there already.
template <int D, unsigned Drop, int C>
void follow(const FacetPoint<D>& p, const Eigen::Matrix<double, D, D - 1>& dn, const Slip<D>* slip,
            const Kinematics<D>& k, Variation<D, C>& v)
{
  v.n += times(dn, v.xi);
  if constexpr (not(Drop & gap_sliding))
    v.gap -= (k.n.transpose() * p.tau) * v.xi;
  if constexpr (not(Drop & gap_turning))
    v.gap += k.r.transpose() * v.n;
  if constexpr (not(Drop & slip_sliding))
    if (slip)
      v.slip += times(slip->xi, v.xi);
}
} // namespace impl

/// All variations of one particle's target.
/// @param p the target's position with its curvature
/// @param e unit direction of (F5), zero for the other rules
/// @param field normal field at the target, for interpolated normals (smooth targets have these)
/// @param slip since the last accepted step, for friction
template <int D, unsigned Drop = all_terms>
Kinematics<D> linearise(const Surface& master, const Target<D>& t, const Vector<D>& x1,
                        const FacetPoint<D>& p, const Rules& rules, const Vector<D>& e,
                        const NormalField<D>* field = nullptr, const Slip<D>* slip = nullptr)
{
  constexpr int Q = D - 1;
  Kinematics<D> k;
  place<D>(master, t, x1, p, rules.normal, e, k, field);
  const bool interpolated = rules.normal == NormalRule::interpolated;
  const InterpolatedNormal<D> nbar
      = interpolated ? InterpolatedNormal<D>(*field) : InterpolatedNormal<D>();

  if (t.clamp == Clamp::none)
    impl::free_target<D, Drop>(rules, e, p, nbar, k);
  else if (t.clamp == Clamp::edge)
    impl::clamped_target<D, Drop>(
        rules, e, FacetProjection<D>::edge_direction(master.ref.shape, t.edge), p, nbar, k);

  Eigen::Matrix<double, D, Q> dn = Eigen::Matrix<double, D, Q>::Zero(); // ∂n/∂ξ
  if (rules.normal == NormalRule::facet)
  {
    // (F7') δn = ± T (δτ_1 × τ_2 + τ_1 × δτ_2) / ‖τ_1 × τ_2‖,  δτ_α = ∂_α δu² + ∂²_αβ x² δξ^β
    const auto of_tangent = normal_of_tangents<D>(p, master.sigma[t.facet]);
    for (int a = 0; a < Q; ++a)
    {
      const Eigen::Matrix<double, D, D>& P = of_tangent[a];
      if constexpr (not(Drop & normal_gradient))
        k.z.n.template middleCols<D>(D + a * D) += P;
      if constexpr (not(Drop & normal_curvature))
        for (int b = 0; b < Q; ++b)
          dn.col(b) += P * p.d2(a, b);
    }
  }
  else if (interpolated)
  {
    // (F8') δn = δn̄|_ξ + ∂_α n̄ δξ^α
    if constexpr (not(Drop & normal_field))
      k.m.n = nbar.of_m;
    if constexpr (not(Drop & normal_sliding))
      dn = nbar.dn;
  }
  else if constexpr (not(Drop & seek_normal))
    if (rules.turning) // n = ±e
      k.e.n.diagonal().setConstant(k.n.dot(e) < 0 ? -1 : 1);

  k.z.gap.template leftCols<D>() = k.n.transpose();
  if (slip)
  {
    k.slip = slip->value;
    k.slip_of_old = slip->old;
    k.z.slip.template leftCols<D>() = slip->jump;
    if constexpr (not(Drop & slip_gradient))
      for (int a = 0; a < Q; ++a)
        k.z.slip.template middleCols<D>(D + a * D) = slip->gradient[a];
    if constexpr (not(Drop & slip_field))
      if (interpolated)
        k.m.slip = slip->normal * nbar.of_m;
  }
  impl::follow<D, Drop>(p, dn, slip, k, k.z);
  if (interpolated)
    impl::follow<D, Drop>(p, dn, slip, k, k.m);
  if (rules.turning)
    impl::follow<D, Drop>(p, dn, slip, k, k.e);
  return k;
}

} // namespace dolfinx_contact
