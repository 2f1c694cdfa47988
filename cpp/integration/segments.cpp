// SPDX-License-Identifier: MIT
#include "segments.h"

#include <Eigen/LU>
#include <array>
#include <numeric>

namespace dolfinx_contact
{

namespace
{

// Corners of a facet in the order in which they follow each other around it.
std::span<const int> around(Shape shape)
{
  static constexpr std::array<int, 4> quadrilateral = {0, 1, 3, 2};
  static constexpr std::array<int, 3> others = {0, 1, 2};
  if (shape == Shape::quadrilateral)
    return quadrilateral;
  return std::span(others).first(num_vertices(shape));
}

template <int D>
Vector<D> corner(const Surface& s, int f, int v)
{
  return Eigen::Map<const Vector<D>>(s.facet_x(f) + v * D); // the first nodes are the corners
}

// A master facet in the slave facet's plane.
template <int D>
struct Shadow
{
  typename Chart<D>::Set set;
  double height; // how far its corners are on average
  int master;
};

// Append the set of the projected corners c of master facet g, if it faces the slave: σ σ' τ·τ' <
// 0.
void append(const std::vector<Vector<1>>& c, double facing, double height, int g,
            std::vector<Shadow<2>>& out)
{
  const double lo = c[0][0], hi = c[1][0];
  if ((hi - lo) * facing < 0)
    out.push_back({{std::min(lo, hi), std::max(lo, hi)}, height, g});
}

void append(const std::vector<Vector<2>>& c, double facing, double height, int g,
            std::vector<Shadow<3>>& out)
{
  Polygon p{c};
  const double area = p.signed_area();
  if (not(area * facing < 0))
    return;
  if (area < 0)
    std::reverse(p.corners.begin(), p.corners.end());
  if (p.convex())
    out.push_back({p, height, g});
  else if (c.size() == 4)
    for (int first : {0, 1}) // one of the diagonals divides it into two triangles
    {
      const auto& v = p.corners;
      const Polygon a{{v[first], v[first + 1], v[first + 2]}};
      const Polygon b{{v[first + 2], v[(first + 3) % 4], v[first]}};
      if (a.signed_area() > 0 and b.signed_area() > 0)
      {
        out.push_back({a, height, g});
        out.push_back({b, height, g});
        break;
      }
    }
}

// Simplices of a cell: visit(corners c, measure in units of the reference simplex).
template <typename Visit>
void simplices(const Interval& cell, Visit visit)
{
  const std::array<Vector<1>, 2> c = {Vector<1>(cell.lo), Vector<1>(cell.hi)};
  visit(c, cell.hi - cell.lo);
}

template <typename Visit>
void simplices(const Polygon& cell, Visit visit)
{
  const auto& v = cell.corners;
  for (std::size_t i = 2; i < v.size(); ++i)
  {
    const std::array<Vector<2>, 3> c = {v[0], v[i - 1], v[i]};
    const double twice = Polygon::cross(c[1] - c[0], c[2] - c[0]);
    if (twice > 0)
      visit(c, twice);
  }
}

} // namespace

template <int D>
Chart<D>::Chart(const Surface& s, int f)
    : _shape(s.ref.shape)
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
      _kappa = project(_origin + hourglass, _normal).template head<Q>();
      // a facet that folds has no such plane; its cells are then those of straight lines in ξ
      if (not(_kappa.template lpNorm<1>() < 1.9))
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
double Chart<D>::stretch(const Vector<Q>& xi) const
{
  if constexpr (D == 3)
    return 1 + _kappa[0] * (xi[1] - 0.5) + _kappa[1] * (xi[0] - 0.5);
  return 1;
}

template <int D>
std::vector<CellPoint<D>> Segments<D>::points(const Surface& slave, int f, const Surface& master,
                                              std::span<const int> near, const Vector<D>& direction,
                                              const NodalNormals<D>* normals, double reach) const
{
  constexpr int Q = D - 1;
  constexpr double grazing = 0.1; // facets seen at less than 6 degrees are left out
  using Set = typename Chart<D>::Set;
  const Chart<D> chart(slave, f);

  std::vector<Shadow<D>> shadows;
  std::vector<Vector<Q>> c;
  for (int g : near)
  {
    c.clear();
    double height = 0, nearest = INFINITY;
    bool seen = true;
    const double facing = double(slave.sigma[f]) * master.sigma[g];
    for (int v : around(master.ref.shape))
    {
      Vector<D> m = direction;
      if (m.isZero())
        m = normals ? normals->normal(master, g, v) : chart.normal();
      seen = seen and std::abs(m.dot(chart.normal())) >= grazing;
      if (not seen)
        break;
      const Vector<D> at = chart.project(corner<D>(master, g, v), m.normalized());
      c.push_back(at.template head<Q>());
      height += std::abs(at[D - 1]) / master.nv();
      nearest = std::min(nearest, std::abs(at[D - 1]));
    }
    if (seen and nearest <= reach)
      append(c, facing, height, g, shadows);
  }
  // where several facets overlap the nearest one counts
  std::stable_sort(shadows.begin(), shadows.end(),
                   [](const auto& a, const auto& b) { return a.height < b.height; });

  std::vector<Set> sets;
  for (const Shadow<D>& s : shadows)
    sets.push_back(s.set);
  std::vector<Part<Set>> cells;
  divide<Set>(chart.whole(), sets, cells);

  std::vector<CellPoint<D>> out;
  for (const Part<Set>& cell : cells)
    simplices(cell.set,
              [&](const auto& corners, double measure)
              {
                for (int p = 0; p < _cell.size(); ++p)
                {
                  Vector<Q> at = corners[0];
                  for (int i = 0; i < Q; ++i)
                    at += _cell.points[p * Q + i] * (corners[i + 1] - corners[0]);
                  const Vector<Q> xi = chart.xi(at);
                  out.push_back({xi, _cell.weights[p] * measure / chart.stretch(xi),
                                 cell.other < 0 ? -1 : shadows[cell.other].master});
                }
              });
  return out;
}

template class Chart<2>;
template class Chart<3>;
template class Segments<2>;
template class Segments<3>;

} // namespace dolfinx_contact
