// SPDX-License-Identifier: MIT
#pragma once

#include "../geometry/surface.h"

#include <vector>

namespace dolfinx_contact
{

/// Points and weights on a reference facet.
struct ParticleRule
{
  std::vector<double> points;  ///< (particles, facet dimension)
  std::vector<double> weights; ///< (particles), they sum to the measure of the reference facet
  int size() const { return static_cast<int>(weights.size()); }
};

/// n-Simpson: 2ⁿ equal parts per direction, coincident points merged (formulation, section 3).
/// Intervals: Simpson's rule on each part; quadrilaterals: the tensor product; triangles: 4ⁿ
/// similar triangles, each with the 7-point rule on vertices, mid-edges and centroid.
/// @throws std::invalid_argument unless 0 ≤ n ≤ 6
ParticleRule simpson(Shape shape, int n);

/// ‖τ_1 × τ_2‖ in the reference configuration, times 2πR in axisymmetry (R = X_1).
/// @param position the position basis at a point of facet f
double reference_measure(const Surface& surface, int f, const BasisValues& position,
                         bool axisymmetric);

/// Reference measure carried by each particle: w_p ‖τ_1 × τ_2‖, times 2πR in axisymmetry
/// (R = X_1).
/// @returns (facets, particles)
std::vector<double> particle_weights(const Surface& surface, const ParticleRule& rule,
                                     bool axisymmetric);

/// Lumped weights of nodal particles: ∫ ψ_a dΓ (times 2πR), by the rule `fine`.
/// @param psi the multiplier basis
/// @returns (facets, nodes of psi)
std::vector<double> lumped_weights(const Surface& surface, const TraceBasis& psi,
                                   const ParticleRule& fine, bool axisymmetric);

} // namespace dolfinx_contact
