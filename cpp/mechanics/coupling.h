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
// Rows of a particle's small matrices: ⟦w⟧ at a fixed target, δξ (of ∂_α w² δξ^α, which are times
// w t), λ* and, with friction, Λ*.
template <int D, bool F>
constexpr int rows = F ? 3 * D : 2 * D;

// Of C columns for each of these rows.
template <int D, bool F, int C>
using Small = Eigen::Matrix<double, rows<D, F>, C, C == 1 ? Eigen::ColMajor : Eigen::RowMajor>;

// Small matrix for the C numbers of a variation:
// (F9) −w (δt·⟦w⟧ − t·∂_α w² δξ^α), (F13) −w δd_n λ* and the friction row
template <int D, bool F, unsigned Drop, int C>
Small<D, F, C> small_matrix(const ContactLaw& law, double lambda, const Kinematics<D>& k,
                            const Variation<D, C>& v, const FrictionTangent<D>& f, double w,
                            const Scales& scale)
{
  const Response<D, C> response = respond<D, Drop>(law, lambda, k, v, f);
  Small<D, F, C> out;
  out.template topRows<D>() = -w * response.t;
  out.template middleRows<D - 1>(D) = v.xi;
  out.row(2 * D - 1) = -w * scale.pressure * v.gap;
  if constexpr (F)
    out.template bottomRows<D>() = w * scale.friction * response.row;
  if constexpr (Drop & moving_target)
    out.template middleRows<D - 1>(D).setZero();
  if constexpr (Drop & gap_row)
    out.row(2 * D - 1).setZero();
  return out;
}

// Call expand<n>() with n the number of nodes of all bases if they have equally many and it is one
// of the common numbers, else with 0: numbers known to the compiler make short loops fast.
template <int D, bool F, typename Expand>
void with_nodes(const CouplingBasis<D>& B, Expand expand)
{
  const int n = B.slave;
  const bool equal = B.multiplier == n and B.master == n and B.friction == (F ? n : 0);
  if (equal and n == D) // intervals, triangles
    expand.template operator()<D>();
  else if (D == 3 and equal and n == 4)
    expand.template operator()<D == 3 ? 4 : 0>();
  else
    expand.template operator()<0>();
}

// Rows of the pair's unknowns from those of the particle: Σ over its basis functions.
// @tparam Nodes see with_nodes
// @param wt weight × traction
// @param out (unknowns, columns of k), row-major
template <int D, bool F, int Nodes, typename Rows, typename Out>
void expand_rows(const CouplingBasis<D>& B, const Vector<D>& wt, const Rows& k, Out& out)
{
  constexpr int Q = D - 1;
  auto count = [](int n) { return Nodes > 0 ? Nodes : n; };
  int first = 0;
  for (int a = 0; a < count(B.slave); ++a, first += D)
    for (int i = 0; i < D; ++i)
      out.row(first + i) += B.N[a] * k.row(i);
  for (int a = 0; a < count(B.multiplier); ++a, ++first)
    out.row(first) += B.psi[a] * k.row(2 * D - 1);
  if constexpr (F)
    for (int a = 0; a < count(B.friction); ++a)
      for (int i = 0; i < Q; ++i, ++first)
      {
        const Vector<D> t = B.phi[a] * B.tangent[a * Q + i];
        if constexpr (D == 2)
          out.row(first) += t[0] * k.row(4) + t[1] * k.row(5);
        else
          out.row(first) += t[0] * k.row(6) + t[1] * k.row(7) + t[2] * k.row(8);
      }
  if constexpr (Nodes == 0)
    first = B.first_master();
  for (int a = 0; a < count(B.master); ++a, first += D)
  {
    typename Rows::ConstRowXpr::PlainObject along = B.M->dN[0][a] * k.row(D); // ∂_α M_a δξ^α
    if constexpr (D == 3)
      along += B.M->dN[1][a] * k.row(D + 1);
    for (int i = 0; i < D; ++i)
      out.row(first + i) += wt[i] * along - B.M->N[a] * k.row(i);
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
  impl::Small<D, F, Kinematics<D>::Z> z;
  impl::Small<D, F, 1> lambda = impl::Small<D, F, 1>::Zero();
  impl::Small<D, F, D> Lambda = impl::Small<D, F, D>::Zero(); ///< if F
  Vector<D> wt;                                               ///< weight × traction
};

template <int D, bool F, unsigned Drop = all_terms>
ClosedParticle<D, F> closed_particle(const ContactLaw& law, double lambda, const Kinematics<D>& k,
                                     const FrictionTangent<D>& f, double w, const Scales& scale)
{
  ClosedParticle<D, F> out;
  out.wt = w * traction<D>(law, lambda, k.n, k.gap, f);
  out.z = impl::small_matrix<D, F, Drop>(law, lambda, k, k.z, f, w, scale);
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

namespace impl
{
// Rows and columns of the pair's unknowns.
template <int D, bool F, int Nodes>
void expand(const CouplingBasis<D>& B, const ClosedParticle<D, F>& small, PairMatrix<D>& K)
{
  constexpr int Q = D - 1, R = rows<D, F>;
  constexpr int size = Nodes > 0 ? Nodes * (2 * D + 1 + (F ? Q : 0)) : Eigen::Dynamic;
  constexpr int most = Nodes > 0 ? size : max_unknowns<D>;
  auto count = [](int n) { return Nodes > 0 ? Nodes : n; };
  const auto& kz = small.z;

  // columns: z = N_a on the slave, −M_b and ∂_α M_b on the master
  Eigen::Matrix<double, R, size, Eigen::RowMajor, R, most> C(R, B.size());
  for (int r = 0; r < R; ++r)
  {
    double* c = &C(r, 0);
    for (int a = 0; a < count(B.slave); ++a)
      for (int i = 0; i < D; ++i)
        *c++ = B.N[a] * kz(r, i);
    for (int a = 0; a < count(B.multiplier); ++a)
      *c++ = B.psi[a] * small.lambda[r];
    if constexpr (F)
      for (int a = 0; a < count(B.friction); ++a)
        for (int i = 0; i < Q; ++i)
          *c++ = B.phi[a] * small.Lambda.row(r).dot(B.tangent[a * Q + i]);
    if constexpr (Nodes == 0)
      c = B.master > 0 ? &C(r, B.first_master()) : nullptr;
    for (int a = 0; a < count(B.master); ++a)
      for (int i = 0; i < D; ++i, ++c)
      {
        *c = B.M->dN[0][a] * kz(r, D + i) - B.M->N[a] * kz(r, i);
        if constexpr (D == 3)
          *c += B.M->dN[1][a] * kz(r, 2 * D + i);
      }
  }
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, size, Eigen::RowMajor>> out(K.data(), K.rows(),
                                                                               K.cols());
  expand_rows<D, F, Nodes>(B, small.wt, C, out);
}
} // namespace impl

/// Tangent of a closed particle.
/// @tparam F with friction unknowns
template <int D, bool F>
void add_closed_tangent(const CouplingBasis<D>& B, const ClosedParticle<D, F>& small,
                        PairMatrix<D>& K)
{
  impl::with_nodes<D, F>(B, [&]<int Nodes>() { impl::expand<D, F, Nodes>(B, small, K); });
}

template <int D, bool F, unsigned Drop = all_terms>
void add_closed_tangent(const CouplingBasis<D>& B, const ContactLaw& law, double lambda,
                        const Kinematics<D>& k, const FrictionTangent<D>& f, double w,
                        const Scales& scale, PairMatrix<D>& K)
{
  add_closed_tangent<D, F>(B, closed_particle<D, F, Drop>(law, lambda, k, f, w, scale), K);
}

/// Columns of a closed particle's tangent for the D numbers of a variation, Kinematics::m or ::e:
/// (unknowns, D). The caller knows how they depend on degrees of freedom.
template <int D>
using FieldColumns = Eigen::Matrix<double, Eigen::Dynamic, D, Eigen::RowMajor, max_unknowns<D>, D>;

template <int D, bool F, unsigned Drop = all_terms>
FieldColumns<D> field_columns(const CouplingBasis<D>& B, const ContactLaw& law, double lambda,
                              const Kinematics<D>& k, const Variation<D, D>& v,
                              const FrictionTangent<D>& f, double w, const Scales& scale)
{
  const Vector<D> wt = w * traction<D>(law, lambda, k.n, k.gap, f);
  FieldColumns<D> out = FieldColumns<D>::Zero(B.size(), D);
  const auto small = impl::small_matrix<D, F, Drop>(law, lambda, k, v, f, w, scale);
  impl::expand_rows<D, F, 0>(B, wt, small, out);
  return out;
}

/// Such columns for the nodal normals n_A at the corners of a facet, (unknowns, corners × D).
template <int D>
using CornerColumns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                                    max_unknowns<D>, 4 * D>;

/// Add those of a closed particle, for M = Σ_A N_A n_A.
/// @param of_m δ of what `v` is a variation of, with M
/// @param N values at the corners
template <int D, bool F>
void add_corner_columns(const CouplingBasis<D>& B, const ContactLaw& law, double lambda,
                        const Kinematics<D>& k, const Variation<D, D>& v,
                        const FrictionTangent<D>& f, double w, const Scales& scale,
                        const Eigen::Matrix<double, D, D>& of_m, const double* N,
                        CornerColumns<D>& out)
{
  constexpr int R = impl::rows<D, F>;
  const Vector<D> wt = w * traction<D>(law, lambda, k.n, k.gap, f);
  const impl::Small<D, F, D> small
      = impl::small_matrix<D, F, all_terms>(law, lambda, k, v, f, w, scale) * of_m;
  auto expand = [&]<int Nodes>()
  {
    constexpr int size = Nodes > 0 ? Nodes * D : Eigen::Dynamic;
    constexpr int most = Nodes > 0 ? size : 4 * D;
    const int corners = Nodes > 0 ? Nodes : static_cast<int>(out.cols()) / D;
    Eigen::Matrix<double, R, size, Eigen::RowMajor, R, most> C(R, D * corners);
    for (int r = 0; r < R; ++r)
      for (int c = 0; c < corners; ++c)
        for (int i = 0; i < D; ++i)
          C(r, c * D + i) = N[c] * small(r, i);
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, size, Eigen::RowMajor>> rows(
        out.data(), out.rows(), out.cols());
    impl::expand_rows<D, F, Nodes>(B, wt, C, rows);
  };
  if (out.cols() == B.slave * D)
    impl::with_nodes<D, F>(B, expand);
  else
    expand.template operator()<0>();
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
/// @param small the particle's small matrices
template <int D, bool F>
PairVector<D> closed_rate(const CouplingBasis<D>& B, const CouplingBasis<D>& along,
                          const ContactLaw& law, double lambda, const Kinematics<D>& k,
                          const Vector<D>& Lambda, const FrictionTangent<D>& f,
                          const ClosedParticle<D, F>& small, const Rates<D>& rate, double w,
                          const Scales& scale)
{
  const Vector<D> t = traction<D>(law, lambda, k.n, k.gap, f);
  PairVector<D> out = PairVector<D>::Zero(B.size());
  add_residual<D>(along, law, true, lambda, k.gap, t, Lambda, f, w, scale, out);

  impl::Small<D, F, 1> column
      = small.z.template leftCols<D>() * rate.x + small.lambda * (rate.lambda / scale.pressure);
  if (not rate.e.isZero(0))
    column += impl::small_matrix<D, F, all_terms>(law, lambda, k, k.e, f, w, scale) * rate.e;
  if constexpr (F)
  {
    column += small.Lambda * (rate.Lambda / scale.friction);
    Variation<D, 1> slip;
    slip.slip = k.slip_of_old * rate.x_old;
    column += impl::small_matrix<D, F, all_terms>(law, lambda, k, slip, f, w, scale);
  }
  impl::expand_rows<D, F, 0>(B, small.wt, column, out);
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
