// SPDX-License-Identifier: MIT
#include "normals.h"

#include <algorithm>
#include <cmath>

namespace dolfinx_contact
{

void corner_basis(Shape shape, const double* xi, double* N, double (*dN)[4])
{
  const double x = xi[0], y = shape == Shape::interval ? 0.0 : xi[1];
  if (shape == Shape::interval)
  {
    N[0] = 1 - x, N[1] = x;
    dN[0][0] = -1, dN[0][1] = 1;
  }
  else if (shape == Shape::triangle)
  {
    N[0] = 1 - x - y, N[1] = x, N[2] = y;
    dN[0][0] = -1, dN[0][1] = 1, dN[0][2] = 0;
    dN[1][0] = -1, dN[1][1] = 0, dN[1][2] = 1;
  }
  else
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 2; ++i)
      {
        const double a = i ? x : 1 - x, b = j ? y : 1 - y;
        N[2 * j + i] = a * b;
        dN[0][2 * j + i] = (i ? 1 : -1) * b;
        dN[1][2 * j + i] = a * (j ? 1 : -1);
      }
}

// S_f. In 2D the chord, turned as τ; in 3D Σ_ab W_ab x_a × x_b / 2 with the skew matrix
// W_ab = ∫ (∂_1 N_a ∂_2 N_b − ∂_2 N_a ∂_1 N_b) dξ.
template <int D>
Vector<D> NodalNormals<D>::area_vector(const Surface& s, const double* x, int f) const
{
  const double sigma = s.sigma[f];
  if constexpr (D == 2)
    return sigma * Vector<2>(x[3] - x[1], -(x[2] - x[0]));
  else
  {
    const int np = s.np();
    const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> X(x, 3, np);
    Vector<3> S = Vector<3>::Zero();
    for (int a = 0; a < np; ++a)
      for (int b = 0; b < a; ++b)
        S += s.ref.area[a * np + b] * X.col(a).cross(X.col(b));
    return sigma * S;
  }
}

template <int D>
NodalNormals<D>::NodalNormals(const Surface& s, double crease)
{
  const int n = s.size(), nv = s.nv();
  std::vector<Vector<D>> reference(n);
  for (int f = 0; f < n; ++f)
    reference[f] = area_vector(s, s.facet_X(f), f).normalized();
  const FacetsAtNodes facets(s);
  // facets are in the order of their global numbers: the sums are the same on every partition
  const double least = std::cos(crease) - 1e-12;
  _offset.assign(1, 0);
  for (int f = 0; f < n; ++f)
    for (int v = 0; v < nv; ++v)
    {
      // the first nodes are those of the vertices
      for (const std::int32_t g : facets.at(s.local[static_cast<std::size_t>(f) * s.nu() + v]))
        if (g == f or reference[f].dot(reference[g]) >= least)
          _star.push_back(g);
      _offset.push_back(static_cast<std::int32_t>(_star.size()));
    }
  _area.resize(n);
  _normal.resize(n * nv);
  _length.resize(n * nv);
  update(s);
}

template <int D>
void NodalNormals<D>::update(const Surface& s)
{
  for (int f = 0; f < s.size(); ++f)
    _area[f] = area_vector(s, s.facet_x(f), f);
  for (std::size_t c = 0; c < _normal.size(); ++c)
  {
    Vector<D> S = Vector<D>::Zero();
    for (int k = _offset[c]; k < _offset[c + 1]; ++k)
      S += _area[_star[k]];
    _length[c] = S.norm();
    _normal[c] = S / _length[c];
  }
}

template <int D>
NormalField<D> NodalNormals<D>::at(const Surface& s, int f, const double* xi) const
{
  double N[4] = {}, dN[2][4] = {};
  corner_basis(s.ref.shape, xi, N, dN);
  const int nv = s.nv();
  NormalField<D> out;
  for (int v = 0; v < nv; ++v)
  {
    const Vector<D>& n = _normal[f * nv + v];
    out.M += N[v] * n;
    for (int a = 0; a < D - 1; ++a)
      out.dM.col(a) += dN[a][v] * n;
  }
  return out;
}

template <int D>
std::vector<std::int32_t> NodalNormals<D>::nodes(const Surface& s, int f) const
{
  const int nv = s.nv(), nu = s.nu();
  std::vector<std::int32_t> out;
  for (int k = _offset[f * nv]; k < _offset[(f + 1) * nv]; ++k)
    out.insert(out.end(), s.local.begin() + _star[k] * nu, s.local.begin() + (_star[k] + 1) * nu);
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

// (F8') δn_A = (I − n_A⊗n_A) Σ_f δS_f / ‖Σ_f S_f‖, and with S_f = σ_f Σ_ab W_ab x_a × x_b / 2:
// δS_f = −σ_f Σ_a (Σ_b W_ab x_b) × δx_a
template <int D>
NormalDerivative<D> NodalNormals<D>::derivative(const Surface& s, int f) const
{
  const int nv = s.nv(), np = s.np(), nu = s.nu();
  NormalDerivative<D> out;
  out.nodes = nodes(s, f);
  const int n_nodes = static_cast<int>(out.nodes.size());
  out.dn.setZero(nv * D, D * n_nodes);
  for (int v = 0; v < nv; ++v)
  {
    const int c = f * nv + v;
    auto dS = out.dn.template middleRows<D>(v * D);
    for (int k = _offset[c]; k < _offset[c + 1]; ++k)
    {
      const int g = _star[k];
      const double* x = s.facet_x(g);
      for (int a = 0; a < np; ++a)
      {
        Eigen::Matrix<double, D, D> P; // δS_g = P δx_a
        if constexpr (D == 2)
        {
          if (a > 1) // the chord knows its ends only
            continue;
          P << 0, 1, -1, 0;
          P *= a == 0 ? -1 : 1;
        }
        else
        {
          Vector<3> y = Vector<3>::Zero();
          for (int b = 0; b < np; ++b)
            y += s.ref.area[a * np + b] * Eigen::Map<const Vector<3>>(x + 3 * b);
          P << 0, y[2], -y[1], -y[2], 0, y[0], y[1], -y[0], 0; // −y × δx_a
        }
        P *= s.sigma[g];
        for (int b = 0; b < nu; ++b) // δx_a = Σ_b I_ab δu_b
        {
          const double I = s.ref.isoparametric() ? double(a == b) : s.ref.interpolation[a * nu + b];
          if (I == 0)
            continue;
          const auto it = std::lower_bound(out.nodes.begin(), out.nodes.end(), s.local[g * nu + b]);
          dS.template middleCols<D>(D * (it - out.nodes.begin())) += I * P;
        }
      }
    }
    const Vector<D>& n = _normal[c];
    const Eigen::Matrix<double, D, D> T
        = (Eigen::Matrix<double, D, D>::Identity() - n * n.transpose()) / _length[c];
    for (int k = 0; k < n_nodes; ++k)
      dS.template middleCols<D>(D * k) = (T * dS.template middleCols<D>(D * k)).eval();
  }
  return out;
}

template class NodalNormals<2>;
template class NodalNormals<3>;

} // namespace dolfinx_contact
