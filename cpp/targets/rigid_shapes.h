// SPDX-License-Identifier: MIT
//
// Surfaces of rigid tools in closed form: planes, spheres, cylinders and tori. A point knows its
// signed distance d to each of them, n = ∂d/∂X and ∂n/∂X. Curved ones are at the distance `radius`
// of a point, a line or a circle; with `inside` the material is outside of that and the slave
// within.
#pragma once

#include "../geometry/surface.h"

#include <cmath>

namespace dolfinx_contact
{

/// A point against a surface.
template <int D>
struct Distance
{
  using Matrix = Eigen::Matrix<double, D, D>;

  /// Positive away from the material; infinite where there is no closest point, or it is not the
  /// only one.
  double d = INFINITY;
  Vector<D> outward = Vector<D>::Zero(); ///< ∂d/∂X, unit normal away from the material
  Matrix turning = Matrix::Zero();       ///< ∂outward/∂X

  /// At a distance of `radius` from a set whose closest point is X − v.
  /// @param without the part of ∂v/∂X that is not the identity
  static Distance around(const Vector<D>& v, double radius, bool inside,
                         const Matrix& without = Matrix::Zero())
  {
    const double rho = v.norm(), sign = inside ? -1 : 1;
    if (not(rho > 1e-12 * radius))
      return {};
    const Vector<D> m = v / rho;
    return {sign * (rho - radius), sign * m,
            sign / rho * (Matrix::Identity() - m * m.transpose() - without)};
  }
};

/// The half-space behind a plane, or a ring of it around `point`.
template <int D>
struct Plane
{
  Vector<D> point;
  Vector<D> outward;                  ///< unit normal
  double inner = 0, outer = INFINITY; ///< distances from `point` between which it extends

  Distance<D> at(const Vector<D>& X) const
  {
    const double d = (X - point).dot(outward), from = (X - point - d * outward).norm();
    if (from < inner or from > outer)
      return {};
    return {d, outward};
  }
};

/// A sphere; in 2D a circle.
template <int D>
struct Sphere
{
  Vector<D> center;
  double radius;
  bool inside = false;

  Distance<D> at(const Vector<D>& X) const
  {
    return Distance<D>::around(X - center, radius, inside);
  }
};

/// A circular cylinder, or its part from `point` to `point` + length × axis.
struct Cylinder
{
  Vector<3> point, axis; ///< unit axis
  double radius;
  bool inside = false;
  double length = INFINITY; ///< infinite: without ends to either side

  Distance<3> at(const Vector<3>& X) const
  {
    const double s = (X - point).dot(axis);
    if (std::isfinite(length) and (s < 0 or s > length))
      return {};
    return Distance<3>::around(X - point - s * axis, radius, inside, axis * axis.transpose());
  }
};

/// A torus: at the distance `radius` of a circle around an axis.
struct Torus
{
  Vector<3> center, axis; ///< unit axis
  double ring;            ///< radius of the circle
  double radius;          ///< of the tube
  bool inside = false;

  Distance<3> at(const Vector<3>& X) const
  {
    const Vector<3> v = X - center, flat = v - v.dot(axis) * axis;
    const double p = flat.norm();
    if (not(p > 1e-12 * ring)) // on the axis all of the circle is equally near
      return {};
    const Vector<3> e = flat / p, b = axis.cross(e);
    return Distance<3>::around(v - ring * e, radius, inside, ring / p * b * b.transpose());
  }
};

} // namespace dolfinx_contact
