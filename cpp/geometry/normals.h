// SPDX-License-Identifier: MIT
//
// Interpolated normals (F8): at each corner A of a facet n_A = Σ_f S_f/‖Σ_f S_f‖ over the facets f
// that meet there, S_f = σ_f ∫ τ_1 × τ_2 dξ their area vectors, inward to the body. Over a facet
// M(ξ) = Σ_A N_A(ξ) n_A with the linear (bilinear) N_A, and n̄ = M/‖M‖: continuous on the surface.
#pragma once

#include "surface.h"

namespace dolfinx_contact
{

/// M of one point of a facet and its derivatives.
template <int D>
struct NormalField
{
  Vector<D> M = Vector<D>::Zero();
  Eigen::Matrix<double, D, D - 1> dM = Eigen::Matrix<double, D, D - 1>::Zero(); ///< ∂_α M
};

/// Values (and first derivatives) of the linear basis of the corners at ξ: N and dN[α] have room
/// for 4 numbers.
void corner_basis(Shape shape, const double* xi, double* N, double (*dN)[4]);

/// How the nodal normals of one facet depend on displacements.
template <int D>
struct NormalDerivative
{
  std::vector<std::int32_t> nodes; ///< of the surface's node table: the facet's star
  /// ∂n_A/∂u of all corners A: (corners × D, D × nodes)
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> dn;
};

/// Nodal normals of a surface in its current position.
template <int D>
class NodalNormals
{
public:
  NodalNormals() = default;

  /// @param surface facets with their rings: only facets marked `candidate` get their true normals
  /// @param crease angle in radians; facets whose reference normals differ by more are not averaged
  NodalNormals(const Surface& surface, double crease);

  /// The surface has moved.
  void update(const Surface& surface);

  /// M and ∂_α M on facet f.
  NormalField<D> at(const Surface& surface, int f, const double* xi) const;

  /// n_A at corner c of facet f.
  const Vector<D>& normal(const Surface& surface, int f, int c) const
  {
    return _normal[f * surface.nv() + c];
  }

  /// Nodes (of the surface's node table) that the normals of facet f depend on: those of its star.
  std::vector<std::int32_t> nodes(const Surface& surface, int f) const;

  /// ∂n_A/∂u of all corners of facet f.
  NormalDerivative<D> derivative(const Surface& surface, int f) const;

private:
  Vector<D> area_vector(const Surface& surface, const double* x, int f) const;

  std::vector<std::int32_t> _offset, _star; // facets averaged at each corner of each facet
  std::vector<Vector<D>> _area;             // S_f
  std::vector<Vector<D>> _normal;           // n_A, (facets, corners)
  std::vector<double> _length;              // ‖Σ S_f‖, (facets, corners)
};

extern template class NodalNormals<2>;
extern template class NodalNormals<3>;

} // namespace dolfinx_contact
