// SPDX-License-Identifier: MIT
#include "chart.h"

#include <Eigen/LU>
#include <array>

namespace dolfinx_contact
{

std::span<const int> around(Shape shape)
{
  static constexpr std::array<int, 4> quadrilateral = {0, 1, 3, 2};
  static constexpr std::array<int, 3> others = {0, 1, 2};
  if (shape == Shape::quadrilateral)
    return quadrilateral;
  return std::span(others).first(num_vertices(shape));
}

template <int D>
Chart<D>::Chart(const Surface& s, int f)
    : _shape(s.ref.shape)
    , _nv(s.nv())
{
  std::array<Vector<D>, 4> x;
  for (int v = 0; v < s.nv(); ++v)
    x[v] = corner<D>(s, f, v);
  _origin = x[0];
  _a.col(0) = x[1] - x[0];
  if constexpr (D == 3)
    _a.col(1) = x[2] - x[0];
  Vector<D> hourglass = Vector<D>::Zero();
  if (_shape == Shape::quadrilateral)
  {
    // x(ξ) = centre + a_α (ξ_α − ½) + h (ξ_1 − ½)(ξ_2 − ½)
    hourglass = x[0] - x[1] - x[2] + x[3];
    for (int i = 0; i < Q; ++i)
      _a.col(i) += 0.5 * hourglass;
    _origin = 0.25 * (x[0] + x[1] + x[2] + x[3]) - 0.5 * _a.rowwise().sum();
  }
  if constexpr (D == 2)
    _normal = Vector<2>(_a(1, 0), -_a(0, 0)).normalized();
  else
  {
    _normal = _a.col(0).cross(_a.col(1)).normalized();
    if (_shape == Shape::quadrilateral)
    {
      const Vector<D> h = project(_origin + hourglass, _normal);
      _kappa = h.template head<Q>();
      _warp = h[D - 1];
      // a facet that folds has no such plane; its cells are then those of straight lines in ξ
      _curves = _kappa.template lpNorm<1>() < 1.9;
      if (not _curves)
        _kappa.setZero();
    }
  }
}

template <int D>
auto Chart<D>::whole() const -> Set
{
  if constexpr (D == 2)
    return {0, 1};
  else
  {
    Polygon p;
    for (int v : around(_shape))
    {
      const Eigen::Map<const Vector<2>> xi(reference_vertex(_shape, v));
      p.corners.push_back(xi + (xi[0] - 0.5) * (xi[1] - 0.5) * _kappa);
    }
    return p;
  }
}

template <int D>
Vector<D> Chart<D>::project(const Vector<D>& x, const Vector<D>& m) const
{
  Eigen::Matrix<double, D, D> A;
  A << _a, m;
  return A.inverse() * (x - _origin);
}

template <int D>
auto Chart<D>::xi(const Vector<Q>& c) const -> Vector<Q>
{
  if constexpr (D == 3)
    if (_shape == Shape::quadrilateral)
    {
      // with C = c − ½ and w = (ξ_1 − ½)(ξ_2 − ½): ξ − ½ = C − κ w, thus
      // κ_1 κ_2 w² − (1 + κ_1 C_2 + κ_2 C_1) w + C_1 C_2 = 0, and w = 0 where C_1 C_2 = 0
      const Vector<2> C = c.array() - 0.5;
      const double b = 1 + _kappa[0] * C[1] + _kappa[1] * C[0], p = C[0] * C[1];
      const double root = std::sqrt(std::max(0.0, b * b - 4 * _kappa[0] * _kappa[1] * p));
      return c - 2 * p / (b + root) * _kappa;
    }
  return c;
}

template <int D>
auto Chart<D>::gradient(const Vector<Q>& xi) const -> Eigen::Matrix<double, Q, Q>
{
  Eigen::Matrix<double, Q, Q> J = Eigen::Matrix<double, Q, Q>::Identity();
  if constexpr (D == 3)
  {
    J.col(0) += (xi[1] - 0.5) * _kappa;
    J.col(1) += (xi[0] - 0.5) * _kappa;
  }
  return J;
}

template <int D>
auto Chart<D>::dual(const Vector<D>& m) const -> Eigen::Matrix<double, Q, D>
{
  Eigen::Matrix<double, D, D> A;
  A << _a, m;
  return A.inverse().template topRows<Q>();
}

// x = o + a_α c^α + s m: δc^α = a^α·(δx − δo − δa_β c^β − s δm), and for m = N
// a^α·δN = −G^αβ N·δa_β with G^αβ = a^α·a^β
template <int D>
auto Chart<D>::variation(const Vector<D>& at, const Vector<D>& m, bool free, bool turns) const
    -> Eigen::Matrix<double, Q, Eigen::Dynamic>
{
  const Eigen::Matrix<double, Q, D> a = dual(m);
  const Eigen::Matrix<double, Q, Q> G = a * a.transpose();
  Eigen::Matrix<double, Q, Eigen::Dynamic> out(Q, D * _nv);
  const bool quadrilateral = _shape == Shape::quadrilateral;
  for (int v = 0; v < _nv; ++v)
  {
    // o = Σ_v origin x_v, a_β = Σ_v tangent_β x_v
    Vector<Q> tangent;
    for (int i = 0; i < Q; ++i)
      tangent[i] = v == 0 ? -1 : v == i + 1 ? 1 : 0;
    double origin = v == 0;
    if (quadrilateral)
    {
      tangent.array() += v == 0 or v == 3 ? 0.5 : -0.5;
      origin = 0.25 - 0.5 * tangent.sum();
    }
    const double with = (free ? origin : 0) + tangent.dot(at.template head<Q>());
    out.template middleCols<D>(v * D) = -with * a;
    if (turns)
      out.template middleCols<D>(v * D) += at[D - 1] * (G * tangent) * _normal.transpose();
  }
  return out;
}

template <int D>
auto Chart<D>::kappa_variation() const -> Eigen::Matrix<double, Q, Eigen::Dynamic>
{
  if (not _curves)
    return Eigen::Matrix<double, Q, Eigen::Dynamic>::Zero(Q, D * _nv);
  Vector<D> at;
  at << _kappa, _warp;
  Eigen::Matrix<double, Q, Eigen::Dynamic> out = variation(at, _normal, false, true);
  const Eigen::Matrix<double, Q, D> a = dual(_normal);
  for (int v = 0; v < _nv; ++v) // h = x_0 − x_1 − x_2 + x_3
    out.template middleCols<D>(v * D) += (v == 0 or v == 3 ? 1 : -1) * a;
  return out;
}

template class Chart<2>;
template class Chart<3>;

} // namespace dolfinx_contact
