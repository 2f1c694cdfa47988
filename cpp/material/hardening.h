// SPDX-License-Identifier: MIT
//
// Laws of isotropic hardening σ_y(ε_p), and the return to the yield surface.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace dolfinx_contact
{

/// Yield stress and its slope at an accumulated plastic strain.
struct YieldStress
{
  double stress, slope;
};

/// σ_y = K (ε_0 + ε_p)^n, ε_0 > 0
struct Swift
{
  double K, eps0, n;

  YieldStress operator()(double ep) const
  {
    const double stress = K * std::pow(eps0 + ep, n);
    return {stress, n * stress / (eps0 + ep)};
  }
};

/// σ_y = σ_0 + Q (1 − exp(−b ε_p)) + H ε_p; with Q = 0 linear hardening
struct Voce
{
  double yield, Q, b, H;

  YieldStress operator()(double ep) const
  {
    const double rest = Q == 0 ? 0 : std::exp(-b * ep);
    return {yield + Q * (1 - rest) + H * ep, Q * b * rest + H};
  }
};

/// Linear between points of a table, constant after the last. The slope at a point of the table is
/// that to its right.
struct Tabulated
{
  std::vector<double> strain; ///< from 0, increasing
  std::vector<double> stress;

  YieldStress operator()(double ep) const
  {
    const std::size_t i = std::upper_bound(strain.begin(), strain.end(), ep) - strain.begin();
    if (i == strain.size())
      return {stress.back(), 0};
    const std::size_t j = std::max<std::size_t>(i, 1);
    const double slope = (stress[j] - stress[j - 1]) / (strain[j] - strain[j - 1]);
    return {stress[j - 1] + slope * (ep - strain[j - 1]), slope};
  }
};

/// Plastic flow in a step.
struct Flow
{
  double amount = 0; ///< increment Δε_p ≥ 0
  /// dσ_y/dε_p at its end; infinite in elastic steps, where nothing can flow
  double slope = std::numeric_limits<double>::infinity();
};

/// Solves q − 3μ Δε_p − σ_y(ε_p + Δε_p) = 0 by Newton's method in a bracket: the left side is
/// positive at 0 and negative at q/(3μ), and σ_y may be as steep as it likes in between.
///
/// A point that flowed in the last step begins the next one on the yield surface, up to round-off.
/// Both derivatives are right there, and that of flow is the better guess.
/// @param q von Mises' trial stress
/// @param ep accumulated plastic strain before the step
template <typename Law>
Flow flow(const Law& law, double mu, double q, double ep)
{
  constexpr double eps = std::numeric_limits<double>::epsilon();
  YieldStress yield = law(ep);
  double g = q - yield.stress;
  if (not(g > 0))
    return g > -1e-8 * q ? Flow{0, yield.slope} : Flow{};
  double x = 0, low = 0, high = q / (3 * mu);
  // bisection alone would end before that
  for (int i = 0; i < 100 and std::abs(g) > 4 * eps * q; ++i)
  {
    (g > 0 ? low : high) = x;
    double next = x + g / (3 * mu + yield.slope);
    if (not(next > low and next < high))
      next = 0.5 * (low + high);
    if (next == x)
      break;
    x = next;
    yield = law(ep + x);
    g = q - 3 * mu * x - yield.stress;
  }
  return {x, yield.slope};
}

} // namespace dolfinx_contact
