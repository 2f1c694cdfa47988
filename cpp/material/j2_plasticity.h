// SPDX-License-Identifier: MIT
//
// Finite-strain J2 plasticity at points: F = F_e F_p, Hencky's elastic energy, isotropic hardening,
// associated flow integrated with the exponential map (Simo, Comput. Methods Appl. Mech. Engrg. 99
// (1992) 61–112; de Souza Neto, Perić and Owen, Computational Methods for Plasticity, 2008, ch.
// 14).
//
// In the principal axes n_a of b = F C_p⁻¹ Fᵀ, C_p⁻¹ of the last step, with ε_a = ½ log b_a and its
// deviator e_a, the step is that of small strains:
//
//     q = √(3/2) 2μ ‖e‖,   q − 3μ Δε_p = σ_y(ε_p + Δε_p),   r = 1 − 3μ Δε_p/q          (1)
//     τ_a = (λ + 2μ/3) tr ε + 2μ r e_a,   P = τ F⁻ᵀ                                    (2)
//     C_p⁻¹ = F⁻¹ (Σ_a exp(2 (tr ε/3 + r e_a)) n_a ⊗ n_a) F⁻ᵀ                          (3)
#pragma once

#include "hardening.h"

#include <span>
#include <variant>

namespace dolfinx_contact
{

using Hardening = std::variant<Swift, Voce, Tabulated>;

/// Lamé's constants λ, μ.
struct Elasticity
{
  double lambda, mu;
};

/// State of n points at the end of a step. Symmetric tensors have the components 00, 11, 22, 01,
/// 12, 02.
template <typename T>
struct PlasticState
{
  std::span<T> cp; ///< C_p⁻¹, shape (n, 6)
  std::span<T> ep; ///< accumulated plastic strain ε_p, shape (n,)
};

/// What a step gives at n points with k components of F and P each (see ``update``).
struct PlasticResponse
{
  PlasticState<double> state;
  std::span<double> tau; ///< Kirchhoff stress τ, shape (n, 6)
  std::span<double> P;   ///< first Piola–Kirchhoff stress, shape (n, k)
  std::span<double> A;   ///< dP/dF of the algorithm, shape (n, k, k)
};

/// One step of n points.
///
/// k is 9 for all components of F, row by row; 5 for 00, 01, 10, 11, 22 (axial symmetry); 4 for 00,
/// 01, 10, 11 (plane strain). Components of F that are not given are those of the identity.
///
/// @param F shape (n, k)
/// @returns number of points where F is not finite or det F ≤ 0; there P, A and τ are nan and the
/// state is the old one
/// @throws std::invalid_argument if the sizes do not fit
int update(const Elasticity& elasticity, const Hardening& hardening, int k,
           std::span<const double> F, const PlasticState<const double>& old,
           const PlasticResponse& out);

/// The same with Δε_p of each point as it is given; the yield surface is not looked at.
/// @param flow shape (n, 2): Δε_p, and dσ_y/dε_p at its end, infinite in elastic steps
int update_given(const Elasticity& elasticity, std::span<const double> flow, int k,
                 std::span<const double> F, const PlasticState<const double>& old,
                 const PlasticResponse& out);

/// Von Mises' trial stress q of (1), shape (n,); nan where F is not finite or det F ≤ 0.
void trial_stress(const Elasticity& elasticity, int k, std::span<const double> F,
                  std::span<const double> cp, std::span<double> q);

} // namespace dolfinx_contact
