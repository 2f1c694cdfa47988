// SPDX-License-Identifier: MIT
//
// Segments: exact integration on the common refinement of a slave facet and the master facets that
// face it (formulation, section 3). The integrand is smooth where neither mesh has a node or an
// edge, so each cell of the refinement gets a Gauss rule: one that is exact for the polynomials of
// affine facets makes the integral exact.
#pragma once

#include "chart.h"
#include "particle_rule.h"

namespace dolfinx_contact
{

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
  /// D rows for each point: δ(log weight), then δξ. Columns: the slave facet's corners, then those
  /// of `facets`, one facet after the other
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> motion;
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

extern template class Segments<2>;
extern template class Segments<3>;

} // namespace dolfinx_contact
