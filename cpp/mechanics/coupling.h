// SPDX-License-Identifier: MIT
//
// One particle's contribution to the residual (F1)–(F3) and to the tangent (F9), (F13).
//
// Unknowns of a pair of facets, in this order: slave displacement (nodes × D), multiplier, friction
// (nodes × (D − 1), along the nodes' tangents), master displacement (nodes × D).
#pragma once

#include "contact_law.h"

#include <array>

namespace dolfinx_contact
{

/// Bases at a particle and at its target.
template <int D>
struct CouplingBasis
{
  const double* N = nullptr;          ///< slave displacement, `slave` values
  const double* psi = nullptr;        ///< multiplier, `multiplier` values
  const double* phi = nullptr;        ///< friction, `friction` values
  const Vector<D>* tangent = nullptr; ///< t_aα of the friction's nodes, (friction, D − 1)
  const BasisValues* M = nullptr;     ///< master displacement, `master` values and derivatives
  int slave = 0, multiplier = 0, friction = 0, master = 0;

  int first_multiplier() const { return slave * D; }
  int first_friction() const { return slave * D + multiplier; }
  int first_master() const { return first_friction() + friction * (D - 1); }
  int size() const { return first_master() + master * D; }
};

/// Units of the unknowns and of their rows: the system has λ/pressure and Λ/friction for unknowns.
struct Scales
{
  double pressure = 1, friction = 1;
};

/// Largest number of unknowns of a pair.
template <int D>
constexpr int max_unknowns = (D == 2 ? 3 : 9) * (3 * D);

template <int D>
using PairVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_unknowns<D>, 1>;
template <int D>
using PairMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                                 max_unknowns<D>, max_unknowns<D>>;

/// Residual of (F1): −w t·⟦w⟧, of (F2): −w/ρ_n (λ − χ g_n) λ*, and of (F3), added to b.
/// @param t traction
/// @param Lambda the friction semi-multiplier
template <int D>
void add_residual(const CouplingBasis<D>& B, const ContactLaw& law, bool closed, double lambda,
                  double gap, const Vector<D>& t, const Vector<D>& Lambda, const Friction<D>& f,
                  double w, const Scales& scale, PairVector<D>& b)
{
  const double g = closed ? gap : lambda / law.rho_n;
  for (int a = 0; a < B.multiplier; ++a)
    b[B.first_multiplier() + a] -= w * scale.pressure * g * B.psi[a];
  if (B.friction > 0)
  {
    const Vector<D> row
        = f.acts
              ? Vector<D>(law.friction * f.limit / law.rho_t * f.turned_defect() - f.rest * Lambda)
              : Vector<D>(-law.kappa * Lambda);
    for (int a = 0; a < B.friction * (D - 1); ++a)
      b[B.first_friction() + a] += w * scale.friction * B.phi[a / (D - 1)] * B.tangent[a].dot(row);
  }
  if (not closed)
    return;
  for (int a = 0; a < B.slave; ++a)
    b.template segment<D>(a * D) -= w * B.N[a] * t;
  for (int a = 0; a < B.master; ++a)
    b.template segment<D>(B.first_master() + a * D) += w * B.M->N[a] * t;
}

namespace impl
{
// Rows of a particle's small matrices: ⟦w⟧, ∂_α w², λ* and, with friction, Λ*.
template <int D, bool F>
constexpr int rows = Kinematics<D>::Z + 1 + (F ? D : 0);

// Small matrix for the C numbers of a variation:
// (F9) −w (δt·⟦w⟧ − t·∂_α w² δξ^α), (F13) −w δd_n λ* and the friction row
template <int D, bool F, unsigned Drop, int C>
Eigen::Matrix<double, rows<D, F>, C>
small_matrix(const ContactLaw& law, double lambda, const Kinematics<D>& k, const Variation<D, C>& v,
             const FrictionTangent<D>& f, const Vector<D>& t, double w, const Scales& scale)
{
  constexpr int Z = Kinematics<D>::Z;
  const Response<D, C> response = respond<D, Drop>(law, lambda, k, v, f);
  Eigen::Matrix<double, rows<D, F>, C> out;
  out.setZero();
  out.template topRows<D>() = -w * response.t;
  if constexpr (not(Drop & moving_target))
    for (int a = 0; a < D - 1; ++a)
      out.template middleRows<D>(D + a * D) = w * t * v.xi.row(a);
  if constexpr (not(Drop & gap_row))
    out.row(Z) = -w * scale.pressure * v.gap;
  if constexpr (F)
    out.template bottomRows<D>() = w * scale.friction * response.row;
  return out;
}

// Rows of the pair's unknowns from those of the particle: Σ over its basis functions.
template <int D, bool F, typename Small, typename Out>
void expand_rows(const CouplingBasis<D>& B, const Small& k0, Out& out)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  for (int a = 0; a < B.slave; ++a)
    out.template middleRows<D>(a * D) += B.N[a] * k0.template topRows<D>();
  for (int a = 0; a < B.multiplier; ++a)
    out.row(B.first_multiplier() + a) += B.psi[a] * k0.row(Z);
  if constexpr (F)
    for (int a = 0; a < B.friction * Q; ++a)
      out.row(B.first_friction() + a)
          += B.phi[a / Q] * (B.tangent[a].transpose() * k0.template bottomRows<D>());
  for (int a = 0; a < B.master; ++a)
  {
    auto row = out.template middleRows<D>(B.first_master() + a * D);
    row -= B.M->N[a] * k0.template topRows<D>();
    for (int i = 0; i < Q; ++i)
      row += B.M->dN[i][a] * k0.template middleRows<D>(D + i * D);
  }
}

// The same for all columns of a pair's tangent; plain loops along rows, which compilers vectorise.
template <int D, bool F, typename Small>
void add_rows(const CouplingBasis<D>& B, const Small& C, PairMatrix<D>& K)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  static_assert(Small::IsRowMajor);
  const Eigen::Index n = K.cols();
  auto from = [&](int i) { return C.data() + i * n; };
  auto to = [&](int i) { return K.data() + i * n; };
  auto add = [n](double w, const double* __restrict c, double* __restrict k)
  {
    for (Eigen::Index j = 0; j < n; ++j)
      k[j] += w * c[j];
  };
  for (int a = 0; a < B.slave; ++a)
    for (int i = 0; i < D; ++i)
      add(B.N[a], from(i), to(a * D + i));
  for (int a = 0; a < B.multiplier; ++a)
    add(B.psi[a], from(Z), to(B.first_multiplier() + a));
  if constexpr (F)
    for (int a = 0; a < B.friction * Q; ++a)
      for (int i = 0; i < D; ++i)
        add(B.phi[a / Q] * B.tangent[a][i], from(Z + 1 + i), to(B.first_friction() + a));
  for (int a = 0; a < B.master; ++a)
    for (int i = 0; i < D; ++i)
    {
      const double m = B.M->N[a], m1 = B.M->dN[0][a], m2 = B.M->dN[Q - 1][a];
      const double *c = from(i), *c1 = from(D + i), *c2 = from(Q * D + i);
      double* k = to(B.first_master() + a * D + i);
      for (Eigen::Index j = 0; j < n; ++j)
        k[j] += (Q == 1 ? 0.0 : m2 * c2[j]) + m1 * c1[j] - m * c[j];
    }
}
} // namespace impl

/// Tangent of an open particle: δλ λ*/ρ_n, and κ δΛ·Λ*.
template <int D, unsigned Drop = all_terms>
void add_open_tangent(const CouplingBasis<D>& B, const ContactLaw& law, double w,
                      const Scales& scale, PairMatrix<D>& K)
{
  if constexpr (Drop & open_row)
    return;
  const double wn = w * scale.pressure * scale.pressure / law.rho_n;
  for (int a = 0; a < B.multiplier; ++a)
    for (int b = 0; b < B.multiplier; ++b)
      K(B.first_multiplier() + a, B.first_multiplier() + b) -= wn * B.psi[a] * B.psi[b];
  constexpr int Q = D - 1;
  const double wt = w * scale.friction * scale.friction * law.kappa;
  for (int a = 0; a < B.friction * Q; ++a)
    for (int b = 0; b < B.friction * Q; ++b)
      K(B.first_friction() + a, B.first_friction() + b)
          -= wt * B.phi[a / Q] * B.phi[b / Q] * B.tangent[a].dot(B.tangent[b]);
}

/// Small matrices of a closed particle: its rows with z, and with δλ and δΛ in units of the system.
template <int D, bool F>
struct ClosedParticle
{
  static constexpr int R = impl::rows<D, F>;
  Eigen::Matrix<double, R, Kinematics<D>::Z> z;
  Eigen::Matrix<double, R, 1> lambda = Eigen::Matrix<double, R, 1>::Zero();
  Eigen::Matrix<double, R, D> Lambda = Eigen::Matrix<double, R, D>::Zero(); ///< if F
};

template <int D, bool F, unsigned Drop = all_terms>
ClosedParticle<D, F> closed_particle(const ContactLaw& law, double lambda, const Kinematics<D>& k,
                                     const FrictionTangent<D>& f, double w, const Scales& scale)
{
  ClosedParticle<D, F> out;
  const Vector<D> t = traction<D>(law, lambda, k.n, k.gap, f);
  out.z = impl::small_matrix<D, F, Drop>(law, lambda, k, k.z, f, t, w, scale);
  auto& kl = out.lambda;
  if constexpr (not(Drop & traction_multiplier))
    kl.template head<D>() -= w * scale.pressure * k.n;
  if constexpr (F)
  {
    if constexpr (not(Drop & friction_multiplier))
      if (not f.frozen)
        kl.template head<D>() -= w * scale.pressure * law.friction * f.p;
    if constexpr (not(Drop & row_multiplier))
      if (not f.frozen)
        kl.template tail<D>() = w * scale.friction * scale.pressure * f.row_of_limit(law);

    // with δΛ: δ(TΛ) = T R δΛ, δp = DP δ(TΛ); where friction does not act only −κ δΛ
    auto& kt = out.Lambda;
    if (f.acts)
    {
      const Eigen::Matrix<double, D, D> dp = f.DP * f.of_Lambda;
      const double limit = law.friction * f.limit;
      kt.template topRows<D>() = -w * scale.friction * limit * dp;
      kt.template bottomRows<D>() = w * scale.friction * scale.friction * limit / law.rho_t
                                    * f.R.transpose() * (f.of_Lambda - dp);
    }
    kt.template bottomRows<D>().diagonal().array()
        -= w * scale.friction * scale.friction * (f.acts ? f.rest : law.kappa);
  }
  return out;
}

/// Tangent of a closed particle.
/// @tparam F with friction unknowns
template <int D, bool F, unsigned Drop = all_terms>
void add_closed_tangent(const CouplingBasis<D>& B, const ContactLaw& law, double lambda,
                        const Kinematics<D>& k, const FrictionTangent<D>& f, double w,
                        const Scales& scale, PairMatrix<D>& K)
{
  constexpr int Q = D - 1, R = impl::rows<D, F>;
  const ClosedParticle<D, F> small = closed_particle<D, F, Drop>(law, lambda, k, f, w, scale);
  const auto& kz = small.z;

  // columns: z = N_a on the slave, −M_b and ∂_α M_b on the master; by rows, which are then added
  // to those of the pair
  Eigen::Matrix<double, R, Eigen::Dynamic, Eigen::RowMajor, R, max_unknowns<D>> C(R, B.size());
  for (int a = 0; a < B.slave; ++a)
    C.template middleCols<D>(a * D) = B.N[a] * kz.template leftCols<D>();
  for (int a = 0; a < B.multiplier; ++a)
    C.col(B.first_multiplier() + a) = B.psi[a] * small.lambda;
  if constexpr (F)
    for (int a = 0; a < B.friction * Q; ++a)
      C.col(B.first_friction() + a) = B.phi[a / Q] * (small.Lambda * B.tangent[a]);
  for (int a = 0; a < B.master; ++a)
  {
    auto column = C.template middleCols<D>(B.first_master() + a * D);
    column = -B.M->N[a] * kz.template leftCols<D>();
    for (int i = 0; i < Q; ++i)
      column += B.M->dN[i][a] * kz.template middleCols<D>(D + i * D);
  }
  impl::add_rows<D, F>(B, C, K);
}

/// Columns of a closed particle's tangent for the D numbers of a variation, Kinematics::m or ::e:
/// (unknowns, D). The caller knows how they depend on degrees of freedom.
template <int D>
using FieldColumns = Eigen::Matrix<double, Eigen::Dynamic, D, 0, max_unknowns<D>, D>;

template <int D, bool F, unsigned Drop = all_terms>
FieldColumns<D> field_columns(const CouplingBasis<D>& B, const ContactLaw& law, double lambda,
                              const Kinematics<D>& k, const Variation<D, D>& v,
                              const FrictionTangent<D>& f, double w, const Scales& scale)
{
  const Vector<D> t = traction<D>(law, lambda, k.n, k.gap, f);
  FieldColumns<D> out = FieldColumns<D>::Zero(B.size(), D);
  impl::expand_rows<D, F>(B, impl::small_matrix<D, F, Drop>(law, lambda, k, v, f, t, w, scale),
                          out);
  return out;
}

/// How what a particle sees changes when it moves along ξ^β of the slave's facet.
template <int D>
struct Rates
{
  Vector<D> x = Vector<D>::Zero(), x_old = x; ///< its position, now and at the last accepted step
  Vector<D> e = Vector<D>::Zero();            ///< direction of (F5)
  double lambda = 0;
  Vector<D> Lambda = Vector<D>::Zero();
};

/// Derivative of a closed particle's residual along ξ^β, all unknowns held. (Not of n_0: that turns
/// Λ about an axis of the tangential plane, which its projection does not see to first order.)
/// @param along derivatives ∂_β of the slave's bases, without a master
template <int D, bool F>
PairVector<D> closed_rate(const CouplingBasis<D>& B, const CouplingBasis<D>& along,
                          const ContactLaw& law, double lambda, const Kinematics<D>& k,
                          const Vector<D>& Lambda, const FrictionTangent<D>& f,
                          const Rates<D>& rate, double w, const Scales& scale)
{
  const Vector<D> t = traction<D>(law, lambda, k.n, k.gap, f);
  PairVector<D> out = PairVector<D>::Zero(B.size());
  add_residual<D>(along, law, true, lambda, k.gap, t, Lambda, f, w, scale, out);

  const ClosedParticle<D, F> small = closed_particle<D, F>(law, lambda, k, f, w, scale);
  Eigen::Matrix<double, impl::rows<D, F>, 1> column
      = small.z.template leftCols<D>() * rate.x + small.lambda * (rate.lambda / scale.pressure);
  column += impl::small_matrix<D, F, all_terms>(law, lambda, k, k.e, f, t, w, scale) * rate.e;
  if constexpr (F)
  {
    column += small.Lambda * (rate.Lambda / scale.friction);
    Variation<D, 1> slip;
    slip.slip = k.slip_of_old * rate.x_old;
    column += impl::small_matrix<D, F, all_terms>(law, lambda, k, slip, f, t, w, scale);
  }
  impl::expand_rows<D, F>(B, column, out);
  return out;
}

/// The same of an open one.
template <int D>
PairVector<D> open_rate(const CouplingBasis<D>& B, const CouplingBasis<D>& along,
                        const ContactLaw& law, double lambda, const Vector<D>& Lambda,
                        const Rates<D>& rate, double w, const Scales& scale)
{
  PairVector<D> out = PairVector<D>::Zero(B.size());
  const Vector<D> zero = Vector<D>::Zero();
  add_residual<D>(along, law, false, lambda, 0, zero, Lambda, {}, w, scale, out);
  add_residual<D>(B, law, false, rate.lambda, 0, zero, rate.Lambda, {}, w, scale, out);
  return out;
}

} // namespace dolfinx_contact
