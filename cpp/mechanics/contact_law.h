// SPDX-License-Identifier: MIT
#pragma once

#include "../targets/kinematics.h"

namespace dolfinx_contact
{

/// Parameters of the law.
struct ContactLaw
{
  double rho_n = 1;       ///< augmentation, pressure per length
  bool augmented = false; ///< variant with χ g_n in place of χ λ in (F1)
};

/// χ(g_n) with g_n = λ − ρ_n d_n: true in contact.
inline bool closed(const ContactLaw& law, double lambda, double gap)
{
  return std::isfinite(gap) and lambda - law.rho_n * gap < 0;
}

/// The traction on the slave, t = λ χ n, and its variation (F9), as one linear map of (z, δλ).
///
/// Friction adds λ χ_τ μ P_B(g_τ) here, and nothing elsewhere.
template <int D>
struct Traction
{
  Vector<D> t = Vector<D>::Zero();
  Eigen::Matrix<double, D, Kinematics<D>::Z> dz;                        ///< ∂t/∂z
  Eigen::Matrix<double, D, D> dm = Eigen::Matrix<double, D, D>::Zero(); ///< ∂t/∂m (F8')
  Vector<D> dlambda = Vector<D>::Zero();                                ///< ∂t/∂λ
};

/// Value only.
template <int D>
Vector<D> traction(const ContactLaw& law, bool closed, double lambda, const Vector<D>& n,
                   double gap)
{
  if (not closed)
    return Vector<D>::Zero();
  return (law.augmented ? lambda - law.rho_n * gap : lambda) * n;
}

/// Value and variation of a closed particle's traction.
template <int D, unsigned Drop = all_terms>
Traction<D> linearised_traction(const ContactLaw& law, double lambda, const Kinematics<D>& k)
{
  Traction<D> out;
  const double p = law.augmented ? lambda - law.rho_n * k.gap : lambda;
  out.t = p * k.n;
  out.dz.setZero();
  if constexpr (not(Drop & traction_multiplier))
    out.dlambda = k.n;
  if constexpr (not(Drop & traction_turning))
  {
    out.dz += p * k.dn;
    out.dm += p * k.dn_m;
  }
  if (law.augmented)
  {
    out.dz -= law.rho_n * k.n * k.dgap;
    out.dm -= law.rho_n * k.n * k.dgap_m;
  }
  return out;
}

} // namespace dolfinx_contact
