// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cmath>
#include <utility>

namespace dolfinx_contact
{

/// c₀ + c₁t + c₂t² + c₃t³; leading coefficients may vanish.
struct Cubic
{
  std::array<double, 4> c;

  double value(double t) const { return c[0] + t * (c[1] + t * (c[2] + t * c[3])); }
  double slope(double t) const { return c[1] + t * (2 * c[2] + t * 3 * c[3]); }

  /// Call `found(t)` for the real roots in [lo, hi], in rising order.
  ///
  /// Between two stationary points there is one root at most, which Newton's method finds while
  /// bisection guards it: no case of Cardano's formula loses digits.
  template <typename Found>
  void roots(double lo, double hi, Found found) const
  {
    std::array<double, 4> knot = {lo};
    int n = 1;
    // 3c₃t² + 2c₂t + c₁ = 0 without cancellation; c₃ → 0 leaves the linear one
    const double a = 3 * c[3], b = 2 * c[2], discriminant = b * b - 4 * a * c[1];
    if (discriminant >= 0)
    {
      const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
      double first = q / a, second = c[1] / q; // not finite: not there
      if (first > second)
        std::swap(first, second);
      for (const double t : {first, second})
        if (t > knot[n - 1] and t < hi)
          knot[n++] = t;
    }
    knot[n] = hi;
    double left = value(lo);
    for (int k = 0; k < n; ++k)
    {
      const double right = value(knot[k + 1]);
      if (left == 0 or (left < 0 and right > 0) or (left > 0 and right < 0))
        found(between(knot[k], knot[k + 1], left));
      left = right;
    }
    if (left == 0)
      found(hi);
  }

private:
  double between(double a, double b, double at_a) const
  {
    if (at_a == 0)
      return a;
    double t = 0.5 * (a + b);
    for (int it = 0; it < 100; ++it)
    {
      const double f = value(t), change = f / slope(t);
      if (f == 0 or std::abs(change) <= 4e-16 * std::abs(t))
        break;
      ((f < 0) == (at_a < 0) ? a : b) = t;
      t -= change;
      if (not(t > a and t < b))
        t = 0.5 * (a + b);
      if (t == a or t == b)
        break;
    }
    return t;
  }
};

} // namespace dolfinx_contact
