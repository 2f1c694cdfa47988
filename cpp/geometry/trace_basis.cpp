// SPDX-License-Identifier: MIT
#include "trace_basis.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace dolfinx_contact
{

namespace
{
constexpr int max_degree = 2;

// ξ^p, its first and its second derivative for p = 0..max_degree
struct Powers
{
  double v[3][max_degree + 1];
  explicit Powers(double x)
      : v{{1, x, x * x}, {0, 1, 2 * x}, {0, 0, 2}}
  {
  }
};
} // namespace

TraceBasis::TraceBasis(int facet_dim, std::span<const std::int32_t> powers,
                       std::span<const double> coefficients)
    : _dim(facet_dim)
{
  if (facet_dim != 1 and facet_dim != 2)
    throw std::invalid_argument("TraceBasis: the facet dimension must be 1 or 2");
  _monomials = static_cast<int>(powers.size()) / facet_dim;
  if (_monomials == 0 or powers.size() % facet_dim != 0 or coefficients.empty()
      or coefficients.size() % _monomials != 0)
    throw std::invalid_argument("TraceBasis: coefficients must have shape (nodes, monomials)");
  _nodes = static_cast<int>(coefficients.size()) / _monomials;
  _degree = *std::max_element(powers.begin(), powers.end());
  if (_nodes > BasisValues::max_nodes or _degree > max_degree
      or *std::min_element(powers.begin(), powers.end()) < 0)
    throw std::invalid_argument("TraceBasis: Lagrange bases of degree 1 and 2 are supported");

  _powers.assign(2 * _monomials, 0);
  _c.resize(coefficients.size());
  for (int k = 0; k < _monomials; ++k)
  {
    for (int i = 0; i < facet_dim; ++i)
      _powers[2 * k + i] = powers[facet_dim * k + i];
    for (int a = 0; a < _nodes; ++a)
      _c[k * _nodes + a] = coefficients[a * _monomials + k];
  }
  _linear = is_linear();
}

// N_a(vertex b) = δ_ab, with no other monomials than 1, x, y and xy
bool TraceBasis::is_linear() const
{
  constexpr double vertex[4][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  if (_degree != 1 or _nodes != (_dim == 1 ? 2 : _monomials) or _nodes == 1)
    return false;
  BasisValues b;
  for (int v = 0; v < _nodes; ++v)
  {
    tabulate_any(vertex[v], b, false);
    for (int a = 0; a < _nodes; ++a)
      if (std::abs(b.N[a] - (a == v)) > 1e-12)
        return false;
  }
  return true;
}

void TraceBasis::values(const double* xi, double* N) const
{
  if (_linear)
  {
    BasisValues b;
    tabulate_linear(xi, b, false);
    std::copy_n(b.N, _nodes, N);
    return;
  }
  const Powers p(xi[0]), q(_dim == 2 ? xi[1] : 0.0);
  std::fill_n(N, _nodes, 0.0);
  for (int k = 0; k < _monomials; ++k)
  {
    const double m = p.v[0][_powers[2 * k]] * q.v[0][_powers[2 * k + 1]];
    for (int a = 0; a < _nodes; ++a)
      N[a] += m * _c[k * _nodes + a];
  }
}

void TraceBasis::tabulate_any(const double* xi, BasisValues& out, bool second) const
{
  const Powers p(xi[0]), q(_dim == 2 ? xi[1] : 0.0);
  std::fill_n(out.N, _nodes, 0.0);
  for (int i = 0; i < 2; ++i)
    std::fill_n(out.dN[i], _nodes, 0.0);
  for (int i = 0; i < 3; ++i)
    std::fill_n(out.ddN[i], _nodes, 0.0);

  for (int k = 0; k < _monomials; ++k)
  {
    const int i = _powers[2 * k], j = _powers[2 * k + 1];
    const double m = p.v[0][i] * q.v[0][j];
    const double m1 = p.v[1][i] * q.v[0][j], m2 = p.v[0][i] * q.v[1][j];
    const double* c = &_c[k * _nodes];
    for (int a = 0; a < _nodes; ++a)
    {
      out.N[a] += m * c[a];
      out.dN[0][a] += m1 * c[a];
      out.dN[1][a] += m2 * c[a];
    }
    if (second)
    {
      const double m11 = p.v[2][i] * q.v[0][j], m22 = p.v[0][i] * q.v[2][j];
      const double m12 = p.v[1][i] * q.v[1][j];
      for (int a = 0; a < _nodes; ++a)
      {
        out.ddN[0][a] += m11 * c[a];
        out.ddN[1][a] += m22 * c[a];
        out.ddN[2][a] += m12 * c[a];
      }
    }
  }
}

} // namespace dolfinx_contact
