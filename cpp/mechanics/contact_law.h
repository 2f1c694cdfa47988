// SPDX-License-Identifier: MIT
//
// Signorini's and Coulomb's law at one particle, and their derivatives (F9)–(F11), (F13).
#pragma once

#include "../targets/kinematics.h"

namespace dolfinx_contact
{

/// Parameters of the law.
struct ContactLaw
{
  double rho_n = 1;       ///< augmentation ρ_n, pressure per length
  bool augmented = false; ///< variant with χ g_n in place of χ λ in (F1)
  double friction = 0;    ///< Coulomb's coefficient μ
  double rho_t = 1;       ///< augmentation ρ_τ, per length
  double kappa = 1;       ///< κ of (F3), pressure times length
  double least = 0;       ///< friction acts where λ < −least (ε p_ref)
};

/// χ(g_n) with g_n = λ − ρ_n d_n: true in contact.
inline bool closed(const ContactLaw& law, double lambda, double gap)
{
  return std::isfinite(gap) and lambda - law.rho_n * gap < 0;
}

/// χ_τ: true where friction acts.
inline bool rubs(const ContactLaw& law, bool closed, double lambda)
{
  return closed and law.friction > 0 and lambda < -law.least;
}

/// P_B(g_τ) of a particle where friction acts, and what its derivative needs.
template <int D>
struct Friction
{
  using Matrix = Eigen::Matrix<double, D, D>;
  bool acts = false;                    ///< χ_τ
  bool slips = false;                   ///< ‖g_τ‖ ≥ 1 up to round-off
  Vector<D> p = Vector<D>::Zero();      ///< P_B(g_τ)
  Vector<D> defect = Vector<D>::Zero(); ///< TΛ − P_B(g_τ), the residual of (F3)
  Vector<D> Lambda = Vector<D>::Zero(), q = Vector<D>::Zero(); ///< Λ and q = Λ + ρ_τ⟦Δu⟧
  Matrix T = Matrix::Zero(), DP = Matrix::Zero();              ///< I − n⊗n and DP_B(g_τ) (F10)

  Friction() = default;

  /// @param Lambda the semi-multiplier, a vector; only its tangential part counts
  Friction(const ContactLaw& law, const Vector<D>& n, const Vector<D>& Lambda,
           const Vector<D>& slip)
      : acts(true)
      , Lambda(Lambda)
      , q(Lambda + law.rho_t * slip)
      , T(Matrix::Identity() - n * n.transpose())
  {
    // A particle that slipped in the last step begins the next one at ‖g_τ‖ = 1, up to round-off:
    // both derivatives of P_B are right there, and that of slip is the better guess.
    constexpr double edge = 1 - 1e-8;
    const Vector<D> g = T * q;
    const double size = g.norm();
    slips = size > edge;
    p = size > 1 ? Vector<D>(g / size) : g;
    defect = T * Lambda - p;
    DP.setIdentity();
    if (slips)
      DP = (DP - g * g.transpose() / (size * size)) / size;
  }
};

/// The traction on the slave, t = λ (χ n + χ_τ μ P_B(g_τ)), of a closed particle.
template <int D>
Vector<D> traction(const ContactLaw& law, double lambda, const Vector<D>& n, double gap,
                   const Friction<D>& friction)
{
  return (law.augmented ? lambda - law.rho_n * gap : lambda) * n
         + law.friction * lambda * friction.p;
}

/// δt (F9) and the variation of (F3) without that of λ, for the C numbers of a Variation.
template <int D, int C>
struct Response
{
  Eigen::Matrix<double, D, C> t, row;
};

template <int D, unsigned Drop, int C>
Response<D, C> respond(const ContactLaw& law, double lambda, const Kinematics<D>& k,
                       const Variation<D, C>& v, const Friction<D>& f)
{
  using Matrix = Eigen::Matrix<double, D, D>;
  Response<D, C> out;
  out.t.setZero();
  out.row.setZero();
  if constexpr (not(Drop & traction_turning))
    out.t += (law.augmented ? lambda - law.rho_n * k.gap : lambda) * v.n;
  if (law.augmented)
    out.t -= law.rho_n * k.n * v.gap;
  if (not f.acts)
    return out;

  // (F11) δg_τ = T(δΛ + ρ_τ δ⟦Δu⟧) − (n·q) δn − n (δn·q)
  Eigen::Matrix<double, D, C> dg = Eigen::Matrix<double, D, C>::Zero();
  if constexpr (not(Drop & friction_slip))
    dg += law.rho_t * f.T * v.slip;
  auto turned = [&](const Vector<D>& w) -> Eigen::Matrix<double, D, C>
  { return (k.n.dot(w) * Matrix::Identity() + k.n * w.transpose()) * v.n; };
  if constexpr (not(Drop & friction_turning))
    dg -= turned(f.q);
  const Eigen::Matrix<double, D, C> dp = f.DP * dg;
  out.t += law.friction * lambda * dp;

  // (F13) (μ/ρ_τ) λ (δ(TΛ) − δp)
  const double scale = law.friction * lambda / law.rho_t;
  if constexpr (not(Drop & friction_row))
    out.row -= scale * dp;
  if constexpr (not(Drop & row_turning))
    out.row -= scale * turned(f.Lambda);
  return out;
}

} // namespace dolfinx_contact
