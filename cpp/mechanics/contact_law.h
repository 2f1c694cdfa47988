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

/// Λ turned with the surface: R Λ, R the shortest rotation that takes n_0, the slave's outward
/// normal at the start of the step, to n. The nodes' tangents are those of n_0; turned with them, Λ
/// stays tangential in a rotation of any size, and a rigid rotation changes no traction.
template <int D>
struct Turned
{
  using Matrix = Eigen::Matrix<double, D, D>;
  Vector<D> value;
  Matrix R;  ///< derivative with Λ
  Matrix dn; ///< derivative with n

  /// R v = v − s (s·v)/(1 + n_0·n) + 2 n (n_0·v), s = n_0 + n
  Turned(const Vector<D>& n0, const Vector<D>& n, const Vector<D>& Lambda)
  {
    const Vector<D> s = n0 + n;
    const double c = 1 + n0.dot(n), a = s.dot(Lambda);
    R = Matrix::Identity() - s * s.transpose() / c + 2 * n * n0.transpose();
    value = R * Lambda;
    dn = -(s * Lambda.transpose() + a * Matrix::Identity()) / c + a / (c * c) * s * n0.transpose()
         + 2 * n0.dot(Lambda) * Matrix::Identity();
  }
};

/// P_B(g_τ) of a particle where friction acts, and what its derivative needs.
template <int D>
struct Friction
{
  using Matrix = Eigen::Matrix<double, D, D>;
  bool acts = false;                              ///< χ_τ
  bool slips = false;                             ///< ‖g_τ‖ ≥ 1 up to round-off
  Vector<D> p = Vector<D>::Zero();                ///< P_B(g_τ)
  Vector<D> defect = Vector<D>::Zero();           ///< TΛ − P_B(g_τ), the residual of (F3)
  Matrix T = Matrix::Zero(), DP = Matrix::Zero(); ///< I − n⊗n and DP_B(g_τ) (F10)
  Matrix of_Lambda = Matrix::Zero();              ///< ∂(TΛ)/∂Λ
  Matrix Lambda_of_n = Matrix::Zero();            ///< ∂(TΛ)/∂n
  Matrix g_of_n = Matrix::Zero();                 ///< ∂g_τ/∂n at a constant slip

  Friction() = default;

  /// @param n0 see Turned
  /// @param Lambda the semi-multiplier, a vector; only its tangential part counts
  Friction(const ContactLaw& law, const Vector<D>& n0, const Vector<D>& n, const Vector<D>& Lambda,
           const Vector<D>& slip)
      : acts(true)
      , T(Matrix::Identity() - n * n.transpose())
  {
    // A particle that slipped in the last step begins the next one at ‖g_τ‖ = 1, up to round-off:
    // both derivatives of P_B are right there, and that of slip is the better guess.
    constexpr double edge = 1 - 1e-8;
    const Turned<D> turned(n0, n, Lambda);
    const Vector<D> q = turned.value + law.rho_t * slip, g = T * q;
    const double size = g.norm();
    slips = size > edge;
    p = size > 1 ? Vector<D>(g / size) : g;
    defect = T * turned.value - p;
    DP.setIdentity();
    if (slips)
      DP = (DP - g * g.transpose() / (size * size)) / size;

    // (F11) δ(T v) = T δv − (n·v) δn − n (δn·v)
    of_Lambda = T * turned.R;
    auto of_n = [&](const Vector<D>& v) -> Matrix
    { return T * turned.dn - n.dot(v) * Matrix::Identity() - n * v.transpose(); };
    Lambda_of_n = of_n(turned.value);
    g_of_n = of_n(q);
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
  Response<D, C> out;
  out.t.setZero();
  out.row.setZero();
  if constexpr (not(Drop & traction_turning))
    out.t += (law.augmented ? lambda - law.rho_n * k.gap : lambda) * v.n;
  if (law.augmented)
    out.t -= law.rho_n * k.n * v.gap;
  if (not f.acts)
    return out;

  // (F11) δg_τ = T(δΛ + ρ_τ δ⟦Δu⟧) − (n·q) δn − n (δn·q), with Λ turned
  Eigen::Matrix<double, D, C> dg = Eigen::Matrix<double, D, C>::Zero();
  if constexpr (not(Drop & friction_slip))
    dg += law.rho_t * f.T * v.slip;
  if constexpr (not(Drop & friction_turning))
    dg += f.g_of_n * v.n;
  const Eigen::Matrix<double, D, C> dp = f.DP * dg;
  out.t += law.friction * lambda * dp;

  // (F13) (μ/ρ_τ) λ (δ(TΛ) − δp)
  const double scale = law.friction * lambda / law.rho_t;
  if constexpr (not(Drop & friction_row))
    out.row -= scale * dp;
  if constexpr (not(Drop & row_turning))
    out.row += scale * f.Lambda_of_n * v.n;
  return out;
}

} // namespace dolfinx_contact
