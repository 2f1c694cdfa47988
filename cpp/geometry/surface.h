// SPDX-License-Identifier: MIT
#pragma once

#include "trace_basis.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace dolfinx_contact
{

template <int D>
using Vector = Eigen::Matrix<double, D, 1>;

/// What all facets of a surface share.
///
/// Positions live in the `position` basis, whose degree is the larger of the geometry's and the
/// displacement's, displacements in the `displacement` basis of their own degree.
struct ReferenceFacet
{
  Shape shape = Shape::interval;
  TraceBasis position;
  TraceBasis displacement;
  std::vector<double> interpolation; ///< displacement basis at the position nodes, (np, nu)
  std::vector<double> hull;          ///< position nodes to Bernstein control points, (np, np)
  std::vector<double> area; ///< ∫ (∂_1 N_a ∂_2 N_b − ∂_2 N_a ∂_1 N_b) dξ, (np, np); 3D only

  /// True if both bases are the same one.
  bool isoparametric() const { return position.degree() == displacement.degree(); }
};

/// Facets of one contact surface as one rank sees them.
///
/// All tables are row-major, one row a facet. Facets are numbered independently of the partition.
struct Surface
{
  int dim = 0; ///< space dimension, 2 or 3
  ReferenceFacet ref;

  std::vector<std::int64_t> id;        ///< global facet number, (n)
  std::vector<std::int64_t> vertices;  ///< global numbers of the corners, (n, nv)
  std::vector<std::int64_t> nodes;     ///< global numbers of the displacement nodes, (n, nu)
  std::vector<double> X;               ///< reference positions of the position nodes, (n, np, dim)
  std::vector<std::int8_t> sigma;      ///< τ_1 × τ_2 points sigma × inward, (n)
  std::vector<std::uint8_t> ends;      ///< bit e: edge e (2D: vertex e) is a physical end, (n)
  std::vector<std::uint8_t> candidate; ///< 1 if its whole ring is here: it may be a target, (n)

  // derived by `number_nodes` and `displace`
  std::vector<std::int64_t> node_table; ///< distinct entries of `nodes`, sorted
  std::vector<std::int32_t> local;      ///< position of `nodes` in `node_table`, (n, nu)
  std::vector<double> x;                ///< current positions, (n, np, dim)
  std::vector<double> x_old;            ///< those at the last accepted step, (n, np, dim)

  int size() const { return static_cast<int>(id.size()); }
  int np() const { return ref.position.nodes(); }
  int nu() const { return ref.displacement.nodes(); }
  int nv() const { return num_vertices(ref.shape); }

  const double* facet_x(int f) const { return &x[static_cast<std::size_t>(f) * np() * dim]; }
  const double* facet_X(int f) const { return &X[static_cast<std::size_t>(f) * np() * dim]; }

  const double* facet_x_old(int f) const
  {
    return &x_old[static_cast<std::size_t>(f) * np() * dim];
  }

  /// Fill `node_table` and `local` from `nodes`, and set x = x_old = X.
  void number_nodes();

  /// x = X + u.
  /// @param u displacement of the nodes of `node_table`, (nodes, dim)
  /// @throws std::invalid_argument on a wrong size, std::domain_error if u is not finite
  void displace(std::span<const double> u) { place(u, x); }

  /// x_old = X + u; as `displace`.
  void remember(std::span<const double> u) { place(u, x_old); }

  /// Boxes that hold each facet in its current position (control points of its Bernstein form),
  /// grown by `margin`: (n, 2, dim), lower then upper corner.
  std::vector<double> boxes(double margin = 0.0) const;

  /// That of one facet: 2 × dim numbers.
  void box(int f, double margin, double* out) const;

  /// Largest distance between two corners of facet f in the reference configuration.
  double diameter(int f) const;

private:
  void place(std::span<const double> u, std::vector<double>& positions) const;
};

/// Which facets have each node of a surface. Those that share a vertex share its node, since the
/// displacement is continuous.
class FacetsAtNodes
{
public:
  /// @param s numbered by `number_nodes`
  explicit FacetsAtNodes(const Surface& s);

  /// Facets, ascending, at a node of `node_table`.
  std::span<const std::int32_t> at(int node) const
  {
    return std::span(_facets).subspan(_offset[node], _offset[node + 1] - _offset[node]);
  }

private:
  std::vector<std::int32_t> _offset, _facets;
};

/// Position and derivatives on a current (or reference) facet at one ξ.
template <int D>
struct FacetPoint
{
  static constexpr int Q = D - 1;
  Vector<D> x;
  Eigen::Matrix<double, D, Q> tau;                    ///< τ_α, columns
  Eigen::Matrix<double, D, D == 2 ? 1 : 3> curvature; ///< ∂²x: 11, 22, 12, columns

  /// ∂²_αβ x
  auto d2(int a, int b) const { return curvature.col(a == b ? a : 2); }

  /// τ_1 × τ_2 (2D: τ turned by −90 degrees, so that τ × e_3), not normalised.
  Vector<D> area_vector() const
  {
    if constexpr (D == 2)
      return {tau(1, 0), -tau(0, 0)};
    else
      return tau.col(0).cross(tau.col(1));
  }
};

namespace impl
{
template <int D>
inline FacetPoint<D> evaluate(const double* x, int np, const BasisValues& b, bool second)
{
  FacetPoint<D> p;
  p.x.setZero();
  p.tau.setZero();
  p.curvature.setZero();
  for (int a = 0; a < np; ++a)
  {
    const Eigen::Map<const Vector<D>> xa(x + a * D);
    p.x += b.N[a] * xa;
    for (int i = 0; i < D - 1; ++i)
      p.tau.col(i) += b.dN[i][a] * xa;
    if (second)
      for (int i = 0; i < (D == 2 ? 1 : 3); ++i)
        p.curvature.col(i) += b.ddN[i][a] * xa;
  }
  return p;
}
} // namespace impl

/// Evaluate a facet from its node positions `x` ((np, D), row-major) and tabulated basis.
template <int D>
inline FacetPoint<D> evaluate(const double* x, int np, const BasisValues& b, bool second)
{
  // loops of known length for facets of degree 1
  return np == 4   ? impl::evaluate<D>(x, 4, b, second)
         : np == 3 ? impl::evaluate<D>(x, 3, b, second)
         : np == 2 ? impl::evaluate<D>(x, 2, b, second)
                   : impl::evaluate<D>(x, np, b, second);
}

/// Vertex of a reference facet, facet_dim(shape) numbers (Basix's numbering).
const double* reference_vertex(Shape shape, int v);

/// Edges of a triangle or quadrilateral: the two vertices (Basix's numbering). In 2D the "edges"
/// of an interval are its end vertices: both entries are the vertex.
std::array<int, 2> reference_edge(Shape shape, int e);

/// Number of edges (2D: end vertices).
constexpr int num_edges(Shape s)
{
  return num_vertices(s);
}

} // namespace dolfinx_contact
