// SPDX-License-Identifier: MIT
//
// One particle's contribution to the residual (F1), (F2) and to the tangent (F9), (F13).
//
// Unknowns of a pair of facets, in this order: slave displacement (nodes × D), multiplier, master
// displacement (nodes × D).
#pragma once

#include "contact_law.h"

#include <array>

namespace dolfinx_contact
{

/// Bases at a particle and at its target.
struct CouplingBasis
{
  const double* N = nullptr;      ///< slave displacement, `slave` values
  const double* psi = nullptr;    ///< multiplier, `multiplier` values
  const BasisValues* M = nullptr; ///< master displacement, `master` values and derivatives
  int slave = 0, multiplier = 0, master = 0;

  template <int D>
  int size() const
  {
    return (slave + master) * D + multiplier;
  }
};

/// Largest number of unknowns of a pair.
template <int D>
constexpr int max_unknowns = (D == 2 ? 3 : 9) * (2 * D + 1);

template <int D>
using PairVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_unknowns<D>, 1>;
template <int D>
using PairMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor,
                                 max_unknowns<D>, max_unknowns<D>>;

/// Residual of (F1): −w t·⟦w⟧, and of (F2): −w/ρ_n (λ − χ g_n) λ*, added to b.
/// @param scale factor of the multiplier rows (block scaling of the system)
template <int D>
void add_residual(const CouplingBasis& B, const ContactLaw& law, bool closed, double lambda,
                  double gap, const Vector<D>& t, double w, double scale, PairVector<D>& b)
{
  const int multiplier = B.slave * D, master = multiplier + B.multiplier;
  const double g = closed ? gap : lambda / law.rho_n;
  for (int a = 0; a < B.multiplier; ++a)
    b[multiplier + a] -= w * scale * g * B.psi[a];
  if (not closed)
    return;
  for (int a = 0; a < B.slave; ++a)
    b.template segment<D>(a * D) -= w * B.N[a] * t;
  for (int a = 0; a < B.master; ++a)
    b.template segment<D>(master + a * D) += w * B.M->N[a] * t;
}

/// Tangent of an open particle: only δλ λ*/ρ_n.
template <int D, unsigned Drop = all_terms>
void add_open_tangent(const CouplingBasis& B, const ContactLaw& law, double w, double scale,
                      PairMatrix<D>& K)
{
  if constexpr (Drop & open_row)
    return;
  const int multiplier = B.slave * D;
  for (int a = 0; a < B.multiplier; ++a)
    for (int b = 0; b < B.multiplier; ++b)
      K(multiplier + a, multiplier + b) -= w * scale * scale / law.rho_n * B.psi[a] * B.psi[b];
}

/// Tangent of a closed particle.
template <int D, unsigned Drop = all_terms>
void add_closed_tangent(const CouplingBasis& B, const Kinematics<D>& k, const Traction<D>& t,
                        double w, double scale, PairMatrix<D>& K)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  const int multiplier = B.slave * D, master = multiplier + B.multiplier;

  // Small matrix of the particle: rows (⟦w⟧, ∂_α w², λ*), columns (z, δλ).
  // (F9) −w (δt·⟦w⟧ − t·∂_α w² δξ^α), (F13) −w δd_n λ*
  Eigen::Matrix<double, Z + 1, Z + 1> k0;
  k0.setZero();
  k0.template topLeftCorner<D, Z>() = -w * t.dz;
  k0.template topRightCorner<D, 1>() = -w * scale * t.dlambda;
  if constexpr (not(Drop & moving_target))
    for (int a = 0; a < Q; ++a)
      k0.template block<D, Z>(D + a * D, 0) = w * t.t * k.dxi.row(a);
  if constexpr (not(Drop & gap_row))
    k0.template bottomLeftCorner<1, Z>() = -w * scale * k.dgap;

  // columns: z = N_a on the slave, −M_b and ∂_α M_b on the master
  Eigen::Matrix<double, Z + 1, Eigen::Dynamic, 0, Z + 1, max_unknowns<D>> C(Z + 1, B.size<D>());
  for (int a = 0; a < B.slave; ++a)
    C.template middleCols<D>(a * D) = B.N[a] * k0.template leftCols<D>();
  for (int a = 0; a < B.multiplier; ++a)
    C.col(multiplier + a) = B.psi[a] * k0.col(Z);
  for (int a = 0; a < B.master; ++a)
  {
    auto column = C.template middleCols<D>(master + a * D);
    column = -B.M->N[a] * k0.template leftCols<D>();
    for (int i = 0; i < Q; ++i)
      column += B.M->dN[i][a] * k0.template middleCols<D>(D + i * D);
  }

  // rows likewise
  for (int a = 0; a < B.slave; ++a)
    K.template middleRows<D>(a * D) += B.N[a] * C.template topRows<D>();
  for (int a = 0; a < B.multiplier; ++a)
    K.row(multiplier + a) += B.psi[a] * C.row(Z);
  for (int a = 0; a < B.master; ++a)
  {
    auto row = K.template middleRows<D>(master + a * D);
    row -= B.M->N[a] * C.template topRows<D>();
    for (int i = 0; i < Q; ++i)
      row += B.M->dN[i][a] * C.template middleRows<D>(D + i * D);
  }
}

/// Columns of a closed particle's tangent that stand for the nodal normals n_A at the corners of
/// the target (F8'): one (unknowns, D) block for each corner. They are summed over the particles of
/// a pair, and multiplied by ∂n_A/∂u once.
template <int D>
struct NormalColumns
{
  using Block = Eigen::Matrix<double, Eigen::Dynamic, D, 0, max_unknowns<D>, D>;
  std::array<Block, 4> corner;

  void reset(int corners, int size)
  {
    for (int c = 0; c < corners; ++c)
      corner[c].setZero(size, D);
  }
};

/// @param N linear basis of the target facet's corners at ξ, `corners` values
template <int D, unsigned Drop = all_terms>
void add_normal_columns(const CouplingBasis& B, const Kinematics<D>& k, const Traction<D>& t,
                        double w, double scale, const double* N, int corners,
                        NormalColumns<D>& columns)
{
  constexpr int Q = D - 1, Z = Kinematics<D>::Z;
  const int multiplier = B.slave * D, master = multiplier + B.multiplier;
  // rows (⟦w⟧, ∂_α w², λ*) of the particle, as in add_closed_tangent, for m = Σ_A N_A δn_A
  Eigen::Matrix<double, Z + 1, D> k0;
  k0.template topRows<D>() = -w * t.dm;
  for (int a = 0; a < Q; ++a)
    if constexpr (not(Drop & moving_target))
      k0.template middleRows<D>(D + a * D) = w * t.t * k.dxi_m.row(a);
    else
      k0.template middleRows<D>(D + a * D).setZero();
  k0.template bottomRows<1>() = -w * scale * k.dgap_m;

  typename NormalColumns<D>::Block rows(B.size<D>(), D);
  for (int a = 0; a < B.slave; ++a)
    rows.template middleRows<D>(a * D) = B.N[a] * k0.template topRows<D>();
  for (int a = 0; a < B.multiplier; ++a)
    rows.row(multiplier + a) = B.psi[a] * k0.row(Z);
  for (int a = 0; a < B.master; ++a)
  {
    auto row = rows.template middleRows<D>(master + a * D);
    row = -B.M->N[a] * k0.template topRows<D>();
    for (int i = 0; i < Q; ++i)
      row += B.M->dN[i][a] * k0.template middleRows<D>(D + i * D);
  }
  for (int c = 0; c < corners; ++c)
    columns.corner[c] += N[c] * rows;
}

} // namespace dolfinx_contact
