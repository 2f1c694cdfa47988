// SPDX-License-Identifier: MIT
//
// Signorini's and Coulomb's law at one particle, and their derivatives (F9)–(F11), (F13).
#pragma once

#include "../targets/kinematics.h"

#include <optional>

namespace dolfinx_contact
{

/// Parameters of the law.
struct ContactLaw
{
  double rho_n = 1;       ///< augmentation ρ_n, pressure per length
  bool augmented = false; ///< variant with χ g_n in place of χ λ in (F1)
  /// Variant for a particle that opens and closes again and again: as augmented, and friction is
  /// limited by g_n, too, so that all of (F1) and (F3) is continuous where it opens.
  bool continuous = false;
  double friction = 0; ///< Coulomb's coefficient μ
  double rho_t = 1;    ///< augmentation ρ_τ, per length
  double kappa = 1;    ///< κ of (F3), pressure times length
  double least = 0;    ///< friction acts where λ < −least (ε p_ref)
};

/// χ(g_n) with g_n = λ − ρ_n d_n: true in contact.
inline bool closed(const ContactLaw& law, double lambda, double gap)
{
  return std::isfinite(gap) and lambda - law.rho_n * gap < 0;
}

/// The normal part of the traction.
inline double pressed(const ContactLaw& law, double lambda, double gap)
{
  return law.augmented or law.continuous ? lambda - law.rho_n * gap : lambda;
}

/// χ_τ: true where friction acts.
inline bool rubs(const ContactLaw& law, bool closed, double lambda)
{
  return closed and law.friction > 0 and lambda < -law.least;
}

/// Λ turned with the surface: R Λ, R the shortest rotation that takes n_0, the slave's outward
/// normal at the start of the step, to n; likewise the test functions Λ* of (F3). The nodes'
/// tangents are those of n_0. Turned with n, Λ stays tangential in a rotation of any size, and a
/// rigid rotation changes no traction. (About n itself nothing turns: Λ is an unknown and finds its
/// direction.) The formulation has T in place of R, which is R for small rotations.
///
/// R v = v − s (s·v)/(1 + n_0·n) + 2 n (n_0·v), s = n_0 + n
template <int D>
Vector<D> turned(const Vector<D>& n0, const Vector<D>& n, const Vector<D>& v)
{
  const Vector<D> s = n0 + n;
  return v - s * (s.dot(v) / (1 + n0.dot(n))) + 2 * n0.dot(v) * n;
}

/// P_B(g_τ) of a particle where friction acts (F3).
template <int D>
struct Friction
{
  bool acts = false;                    ///< χ_τ
  bool slips = false;                   ///< ‖g_τ‖ ≥ 1 up to round-off, or slip is held
  double limit = 0;                     ///< friction is at most μ times this: λ, g_n or frozen
  bool frozen = false;                  ///< the limit does not vary
  double rest = 0;                      ///< what is left of κ, if the law is continuous
  Vector<D> p = Vector<D>::Zero();      ///< P_B(g_τ)
  Vector<D> defect = Vector<D>::Zero(); ///< TΛ − P_B(g_τ), the residual of (F3)
  Vector<D> q = Vector<D>::Zero();      ///< Λ + ρ_τ ⟦Δu⟧, thus g_τ = T q
  Vector<D> n0 = Vector<D>::Zero(), n = Vector<D>::Zero(), Lambda = Vector<D>::Zero();

  Friction() = default;

  /// @param n0 see turned()
  /// @param Lambda the semi-multiplier, a vector; only its tangential part counts
  /// @param held the status if it is held: true if it slips
  Friction(const ContactLaw& law, double limit, const Vector<D>& n0, const Vector<D>& n,
           const Vector<D>& Lambda, const Vector<D>& slip, std::optional<bool> held = {})
      : acts(true)
      , limit(limit)
      , rest(law.continuous ? std::max(0.0, law.kappa + law.friction * limit / law.rho_t) : 0)
      , n0(n0)
      , n(n)
      , Lambda(Lambda)
  {
    // A particle that slipped in the last step begins the next one at ‖g_τ‖ = 1, up to round-off:
    // both derivatives of P_B are right there, and that of slip is the better guess.
    constexpr double edge = 1 - 1e-8;
    const Vector<D> R_Lambda = turned<D>(n0, n, Lambda);
    q = R_Lambda + law.rho_t * slip;
    const Vector<D> g = tangential(q);
    const double size = g.norm();
    slips = held.value_or(size > edge);
    p = held.value_or(size > 1) and size > 0 ? Vector<D>(g / size) : g;
    defect = tangential(R_Lambda) - p;
  }

  /// The residual of (F3) for the unturned test functions, Rᵀ (TΛ − P_B).
  Vector<D> turned_defect() const { return turned<D>(n, n0, defect); }

  /// Derivative of the row of (F3) with the limit.
  Vector<D> row_of_limit(const ContactLaw& law) const
  {
    const Vector<D> with = rest > 0 ? Vector<D>(turned_defect() - Lambda) : turned_defect();
    return law.friction / law.rho_t * with;
  }

  /// T v, T = I − n⊗n
  Vector<D> tangential(const Vector<D>& v) const { return v - n.dot(v) * n; }
};

/// Derivatives of Friction (F10), (F11).
template <int D>
struct FrictionTangent : Friction<D>
{
  using Matrix = Eigen::Matrix<double, D, D>;
  Matrix T = Matrix::Zero(), DP = Matrix::Zero(); ///< I − n⊗n and DP_B(g_τ) (F10)
  Matrix R = Matrix::Zero();                      ///< of turned()
  Matrix of_Lambda = Matrix::Zero();              ///< ∂(TΛ)/∂Λ
  Matrix Lambda_of_n = Matrix::Zero();            ///< ∂(TΛ)/∂n
  Matrix test_of_n = Matrix::Zero();              ///< ∂(Rᵀy)/∂n at y = TΛ − P_B
  Matrix g_of_n = Matrix::Zero();                 ///< ∂g_τ/∂n at a constant slip

  FrictionTangent(const Friction<D>& f)
      : Friction<D>(f)
  {
    if (not f.acts)
      return;
    const Vector<D>&n0 = f.n0, &n = f.n, &Lambda = f.Lambda;
    T = Matrix::Identity() - n * n.transpose();
    DP.setIdentity();
    const Vector<D> g = f.tangential(f.q);
    const double size = g.norm();
    if (f.slips and size > 0)
      DP = (Matrix::Identity() - g * g.transpose() / (size * size)) / size;

    const Vector<D> s = n0 + n;
    const double c = 1 + n0.dot(n);
    R = Matrix::Identity() - s * s.transpose() / c + 2 * n * n0.transpose();
    // ∂(Rv)/∂n; for Rᵀ all but the last term is the same
    auto of_s = [&](const Vector<D>& v) -> Matrix
    {
      const double a = s.dot(v);
      return -(s * v.transpose() + a * Matrix::Identity()) / c + a / (c * c) * s * n0.transpose();
    };
    const Matrix turning = of_s(Lambda) + 2 * n0.dot(Lambda) * Matrix::Identity();
    test_of_n = of_s(f.defect) + 2 * n0 * f.defect.transpose();
    // (F11) δ(T v) = T δv − (n·v) δn − n (δn·v)
    of_Lambda = T * R;
    auto of_n = [&](const Vector<D>& v) -> Matrix
    { return T * turning - n.dot(v) * Matrix::Identity() - n * v.transpose(); };
    Lambda_of_n = of_n(turned<D>(n0, n, Lambda));
    g_of_n = of_n(f.q);
  }
};

/// The traction on the slave, t = λ (χ n + χ_τ μ P_B(g_τ)), of a closed particle.
template <int D>
Vector<D> traction(const ContactLaw& law, double lambda, const Vector<D>& n, double gap,
                   const Friction<D>& friction)
{
  return pressed(law, lambda, gap) * n + law.friction * friction.limit * friction.p;
}

/// δt (F9) and the variation of (F3) without that of λ, for the C numbers of a Variation.
template <int D, int C>
struct Response
{
  LinearMap<D, C> t, row;
};

template <int D, unsigned Drop, int C>
Response<D, C> respond(const ContactLaw& law, double lambda, const Kinematics<D>& k,
                       const Variation<D, C>& v, const FrictionTangent<D>& f)
{
  Response<D, C> out;
  out.t.setZero();
  out.row.setZero();
  if constexpr (not(Drop & traction_turning))
    out.t += pressed(law, lambda, k.gap) * v.n;
  if (law.augmented or law.continuous)
    out.t -= law.rho_n * k.n * v.gap;
  if (not f.acts)
    return out;

  // (F11) δg_τ = T(δΛ + ρ_τ δ⟦Δu⟧) − (n·q) δn − n (δn·q), with Λ turned
  using Matrix = typename FrictionTangent<D>::Matrix;
  LinearMap<D, C> dg = LinearMap<D, C>::Zero();
  if constexpr (not(Drop & friction_slip))
    dg += times(Matrix(law.rho_t * f.T), v.slip);
  if constexpr (not(Drop & friction_turning))
    dg += times(f.g_of_n, v.n);
  const LinearMap<D, C> dp = f.slips ? times(f.DP, dg) : dg; // (F10)
  const double limit = law.friction * f.limit;
  out.t += limit * dp;

  // (F13) (μ/ρ_τ) λ (δ(TΛ) − δp)·RΛ*
  const double scale = limit / law.rho_t;
  if constexpr (not(Drop & friction_row))
    out.row -= times(Matrix(scale * f.R.transpose()), dp);
  if constexpr (not(Drop & row_turning))
    out.row += times(Matrix(scale * (f.R.transpose() * f.Lambda_of_n + f.test_of_n)), v.n);
  if (law.continuous and not f.frozen) // the limit is g_n
  {
    out.t -= law.friction * law.rho_n * f.p * v.gap;
    out.row -= law.rho_n * f.row_of_limit(law) * v.gap;
  }
  return out;
}

} // namespace dolfinx_contact
