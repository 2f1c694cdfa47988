// SPDX-License-Identifier: MIT
#pragma once

#include "facet_projection.h"

namespace dolfinx_contact
{

/// How much the tangents of a facet may change along its parameters, relative to their least
/// stretch, for Newton's method to find its only solution from anywhere on it.
constexpr double flat = 1;

/// Least ‖τ_α v^α‖ over unit v.
inline double least_stretch(const FacetPoint<3>& p)
{
  const double a = p.tau.col(0).squaredNorm(), b = p.tau.col(1).squaredNorm(),
               c = p.tau.col(0).dot(p.tau.col(1));
  return std::sqrt(std::max(0.5 * (a + b) - std::hypot(0.5 * (a - b), c), 0.0));
}

/// Relative change of the tangents over a facet: a bound of ‖∂²x‖ over their least stretch.
inline double bend(const FacetPoint<3>& p)
{
  const double largest
      = std::sqrt(std::max(p.curvature.col(0).squaredNorm(), p.curvature.col(1).squaredNorm()));
  return (largest + p.curvature.col(2).norm()) / least_stretch(p);
}

/// A square of a facet's parameters. (Triangles are cut into squares too.)
struct FacetCell
{
  Vector<2> xi;    ///< its centre
  double width;    ///< half of its side
  FacetPoint<3> p; ///< the centre in space
  double radius;   ///< of a ball around p.x that holds the cell
  double bend;     ///< relative change of the tangents over it
  int level;       ///< how often the facet was cut; 0 is the whole of it

  static constexpr int deepest = 4;
  bool smallest() const { return level == deepest; }
};

/// Visit the cells of a curved facet: where one Newton iteration cannot be trusted to find what
/// there is on the whole facet, each small enough cell gets its own.
/// @param visit visit(cell) returns true if the cell shall be cut in four
template <typename Visit>
void visit_cells(const FacetProjection<3>& facet, Shape shape, Visit visit,
                 const Vector<2>& xi = {0.5, 0.5}, double width = 0.5, int level = 0)
{
  if (shape == Shape::triangle and xi.sum() - 2 * width >= 1)
    return;
  FacetCell cell{xi, width, facet.at(xi, true), 0, 0, level};
  const FacetPoint<3>& p = cell.p;
  const double first
      = std::max((p.tau.col(0) + p.tau.col(1)).norm(), (p.tau.col(0) - p.tau.col(1)).norm());
  const double second
      = p.curvature.col(0).norm() + p.curvature.col(1).norm() + 2 * p.curvature.col(2).norm();
  // twice the second-order term of Taylor's formula: biquadratic facets have more terms, and at the
  // root these may be large
  const bool biquadratic = shape == Shape::quadrilateral and not facet.straight();
  cell.radius = level == 0 and biquadratic ? INFINITY : width * first + width * width * second;
  cell.radius *= 1 + 1e-7; // corners lie on its surface, and ξ may be 1e-8 outside of its facet
  cell.bend = 2 * width * bend(p);
  if (not visit(cell) or cell.smallest())
    return;
  for (const double i : {-0.5, 0.5})
    for (const double j : {-0.5, 0.5})
      visit_cells(facet, shape, visit, xi + width * Vector<2>(i, j), 0.5 * width, level + 1);
}

} // namespace dolfinx_contact
