// SPDX-License-Identifier: MIT
//
// Segments: exact integration on the common refinement of a slave facet and the master facets that
// face it (formulation, section 3). The integrand is smooth where neither mesh has a node or an
// edge, so each cell of the refinement gets a Gauss rule: one that is exact for the polynomials of
// affine facets makes the integral exact.
#pragma once

#include "../geometry/surface.h"
#include "convex.h"
#include "particle_rule.h"

#include <type_traits>

namespace dolfinx_contact
{

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

  /// How κ varies with the facet's corners: (Q, D × corners); zero where there is no κ.
  Eigen::Matrix<double, Q, Eigen::Dynamic> kappa_variation() const;

private:
  Shape _shape;
  int _nv;
  Vector<D> _origin, _normal;
  Eigen::Matrix<double, D, Q> _a;
  Vector<Q> _kappa = Vector<Q>::Zero();
  double _warp = 0; // component of the hourglass along the normal
};

/// A particle of a refined facet.
template <int D>
struct CellPoint
{
  Vector<D - 1> xi;
  double weight; ///< in the measure of the reference facet
  int master;    ///< the master facet that its cell lies on, −1: none
};

/// The particles of a facet, and how they move with the corners of both surfaces.
template <int D>
struct CellPoints
{
  std::vector<CellPoint<D>> points;

  // if asked for
  std::vector<int> facets; ///< of the master, whose corners the cells depend on
  /// Of each point: δ(log weight), then δξ; (D, D × columns), columns: the slave facet's corners,
  /// then those of `facets`, one facet after the other
  std::vector<Eigen::Matrix<double, D, Eigen::Dynamic>> motion;
};

/// Particles on the common refinement.
template <int D>
class Segments
{
public:
  /// @param cell Gauss rule on the reference interval or triangle
  explicit Segments(ParticleRule cell)
      : _cell(std::move(cell))
  {
  }

  /// Particles of slave facet f where both surfaces are now: Σ weight is the measure of the
  /// reference facet.
  /// @param master facets that may face it; may be empty
  /// @param near numbers of these facets, in an order that no partition changes
  /// @param direction along which the master's corners are projected; zero: along the normal of the
  /// slave facet's plane
  /// @param reach farther facets are left out
  /// @param motion whether to compute how they move
  CellPoints<D> points(const Surface& slave, int f, const Surface& master,
                       std::span<const int> near, const Vector<D>& direction, double reach,
                       bool motion = false) const;

private:
  ParticleRule _cell;
};

extern template class Chart<2>;
extern template class Chart<3>;
extern template class Segments<2>;
extern template class Segments<3>;

} // namespace dolfinx_contact
