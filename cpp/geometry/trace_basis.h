// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Shapes of facets: the facets of 2D cells, of tetrahedra and of hexahedra.
enum class Shape : std::int8_t
{
  interval,
  triangle,
  quadrilateral
};

/// Number of vertices of a facet shape.
constexpr int num_vertices(Shape s)
{
  return s == Shape::interval ? 2 : s == Shape::triangle ? 3 : 4;
}

/// Dimension of a facet shape's reference domain.
constexpr int facet_dim(Shape s)
{
  return s == Shape::interval ? 1 : 2;
}

/// Values and derivatives of a basis at one point.
struct BasisValues
{
  static constexpr int max_nodes = 9;
  double N[max_nodes];      ///< values
  double dN[2][max_nodes];  ///< first derivatives, [α][node]
  double ddN[3][max_nodes]; ///< second derivatives: 11, 22, 12
};

/// A scalar Lagrange basis on a reference facet, as polynomials
/// N_a(ξ) = Σ_k C_ak ξ_1^{p_k1} ξ_2^{p_k2}.
///
/// Every trace of a Lagrange space is a polynomial: Python tabulates it once with Basix and passes
/// the coefficients, so the degree is data and the kernels need neither Basix nor allocation.
class TraceBasis
{
public:
  TraceBasis() = default;

  /// @param facet_dim dimension of the reference facet, 1 or 2
  /// @param powers exponents of the monomials, shape (monomials, facet_dim), row-major
  /// @param coefficients shape (nodes, monomials), row-major
  /// @throws std::invalid_argument if sizes do not match or exceed 9 nodes or degree 2
  TraceBasis(int facet_dim, std::span<const std::int32_t> powers,
             std::span<const double> coefficients);

  int nodes() const { return _nodes; }
  int degree() const { return _degree; }

  /// Values and first derivatives (second ones too if `second`) at ξ (facet_dim numbers).
  void tabulate(const double* xi, BasisValues& out, bool second = false) const
  {
    if (_linear)
      tabulate_linear(xi, out, second);
    else
      tabulate_any(xi, out, second);
  }

  /// Values only, N has room for `nodes()` numbers.
  void values(const double* xi, double* N) const;

private:
  // The basis of degree 1 in closed form: searches spend much of their time on it
  void tabulate_linear(const double* xi, BasisValues& out, bool second) const
  {
    const double x = xi[0];
    if (_nodes == 4)
    {
      const double y = xi[1], u = 1 - x, v = 1 - y;
      const double N[] = {u * v, x * v, u * y, x * y}, d0[] = {-v, v, -y, y}, d1[] = {-u, -x, u, x};
      for (int a = 0; a < 4; ++a)
      {
        out.N[a] = N[a];
        out.dN[0][a] = d0[a];
        out.dN[1][a] = d1[a];
        out.ddN[0][a] = out.ddN[1][a] = 0;
        out.ddN[2][a] = a == 0 or a == 3 ? 1 : -1;
      }
      return;
    }
    const bool triangle = _nodes == 3;
    const double y = triangle ? xi[1] : 0, N[] = {1 - x - y, x, y}, d0[] = {-1, 1, 0},
                 d1[] = {-1, 0, 1};
    for (int a = 0; a < (triangle ? 3 : 2); ++a)
    {
      out.N[a] = N[a];
      out.dN[0][a] = d0[a];
      out.dN[1][a] = triangle ? d1[a] : 0;
      for (int i = 0; second and i < 3; ++i)
        out.ddN[i][a] = 0;
    }
  }
  void tabulate_any(const double* xi, BasisValues& out, bool second) const;
  bool is_linear() const;

  bool _linear = false; // the basis of degree 1 in Basix's order
  int _dim = 0, _nodes = 0, _monomials = 0, _degree = 0;
  std::vector<std::int32_t> _powers; // (monomials, 2)
  std::vector<double> _c;            // (monomials, nodes): summed along contiguous nodes
};

} // namespace dolfinx_contact
