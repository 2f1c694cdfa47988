// SPDX-License-Identifier: MIT
#pragma once

#include "../geometry/surface.h"
#include "convex.h"

#include <type_traits>

namespace dolfinx_contact
{

/// Corners of a facet in the order in which they follow each other around it.
std::span<const int> around(Shape shape);

/// Current position of a corner.
template <int D>
Vector<D> corner(const Surface& s, int f, int v)
{
  return Eigen::Map<const Vector<D>>(s.facet_x(f) + v * D); // the first nodes are the corners
}

/// The parametric plane of a facet, in its current position: x = o + a_α c^α + s m, with a_α the
/// tangents at the centre of the facet that has straight edges and the same corners.
///
/// Straight edges of space stay straight in it, and the facet is the convex hull of its corners
/// (convex facets): c = ξ but on quadrilaterals that are no parallelograms, where
/// c = ξ + κ (ξ_1 − ½)(ξ_2 − ½).
template <int D>
class Chart
{
public:
  static constexpr int Q = D - 1;
  using Set = std::conditional_t<D == 2, Interval, Polygon>;

  Chart(const Surface& s, int f);

  /// The facet itself.
  Set whole() const;

  /// Unit normal of the plane: a_1 × a_2, normalised.
  const Vector<D>& normal() const { return _normal; }

  /// Coordinates (c, s) of a point x, seen along m.
  Vector<D> project(const Vector<D>& x, const Vector<D>& m) const;

  /// ξ of a point c of the facet.
  Vector<Q> xi(const Vector<Q>& c) const;

  /// ∂c/∂ξ
  Eigen::Matrix<double, Q, Q> gradient(const Vector<Q>& xi) const;

  /// How a projected point (c, s) varies with the facet's corners: (Q, D × corners). The point's
  /// own share is `dual(m)`.
  /// @param free true for a point of space, false for a vector (κ is the projection of one)
  /// @param turns true if m is the plane's normal
  Eigen::Matrix<double, Q, Eigen::Dynamic> variation(const Vector<D>& at, const Vector<D>& m,
                                                     bool free, bool turns) const;

  /// ∂c/∂x of a point seen along m.
  Eigen::Matrix<double, Q, D> dual(const Vector<D>& m) const;

  const Vector<Q>& kappa() const { return _kappa; }

  /// True if the facet may have a κ ≠ 0, though a parallelogram has none now.
  bool curves() const { return _curves; }

  /// How κ varies with the facet's corners: (Q, D × corners); zero unless it `curves`.
  Eigen::Matrix<double, Q, Eigen::Dynamic> kappa_variation() const;

private:
  Shape _shape;
  int _nv;
  Vector<D> _origin, _normal;
  Eigen::Matrix<double, D, Q> _a;
  Vector<Q> _kappa = Vector<Q>::Zero();
  bool _curves = false;
  double _warp = 0; // component of the hourglass along the normal
};

extern template class Chart<2>;
extern template class Chart<3>;

} // namespace dolfinx_contact
