// SPDX-License-Identifier: MIT
#include "segments.h"

#include <Eigen/LU>
#include <array>
#include <numeric>

namespace dolfinx_contact
{

namespace
{

// A master facet in the slave facet's plane.
template <int D>
struct Shadow
{
  typename Chart<D>::Set set;
  double height; // how far its corners are on average
  int master;
  int first;      // number of its first corner among all projected ones
  Few<int, 4> at; // which of them follow each other around the set
};

// Append the set of the projected corners c of a master facet, if it faces the slave: σ σ' τ·τ' <
// 0.
void append(const Few<Vector<1>, 4>& c, double facing, Shadow<2> shadow,
            std::vector<Shadow<2>>& out)
{
  const int low = c[0][0] < c[1][0] ? 0 : 1;
  if ((c[1][0] - c[0][0]) * facing < 0)
  {
    shadow.set = {c[low][0], c[1 - low][0]};
    shadow.at = {low, 1 - low};
    out.push_back(shadow);
  }
}

void append(const Few<Vector<2>, 4>& c, double facing, Shadow<3> shadow,
            std::vector<Shadow<3>>& out)
{
  Polygon whole;
  for (const Vector<2>& x : c)
    whole.corners.push_back(x);
  const double area = whole.signed_area();
  if (not(area * facing < 0))
    return;
  Few<int, 4> order;
  for (std::size_t i = 0; i < c.size(); ++i)
    order.push_back(static_cast<int>(i));
  if (area < 0)
    std::reverse(order.begin(), order.end());
  auto add = [&](const Few<int, 4>& at)
  {
    shadow.at = at;
    shadow.set.clear();
    for (int i : at)
      shadow.set.corners.push_back(c[i]);
    return shadow.set.convex();
  };
  if (add(order))
    out.push_back(shadow);
  else if (c.size() == 4)
    for (int i : {0, 1}) // one of the diagonals divides it into two triangles
    {
      const Few<int, 4>&o = order, a = {o[i], o[i + 1], o[i + 2]},
                     b = {o[i + 2], o[(i + 3) % 4], o[i]};
      if (not add(a) or not add(b))
        continue;
      out.push_back(shadow);
      add(a);
      out.push_back(shadow);
      break;
    }
}

// Lines and ends of cells are numbered by the points they go through: first the corners of the
// slave facet, in the order of `whole`, then all projected corners.
struct Lines
{
  std::vector<std::array<int, 2>> through;

  void number(Interval& set, const Few<int, 4>& at, int first)
  {
    set.lo_from = first + at[0];
    set.hi_from = first + at[1];
  }

  void number(Polygon& set, const Few<int, 4>& at, int first)
  {
    for (std::size_t i = 0; i < at.size(); ++i)
    {
      set.lines.push_back(static_cast<int>(through.size()));
      through.push_back({first + at[i], first + at[(i + 1) % at.size()]});
    }
  }
};

// Variations, one number a row.
using Motion = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The points that the corners of cells are made of, and how they vary: D − 1 rows each.
template <int D>
struct Bases
{
  std::vector<Vector<D - 1>> c;
  Motion of;
};

// visit(number) of the points that the corners of a cell are made of.
template <typename Visit>
void for_points(const Interval& cell, const Lines&, Visit visit)
{
  visit(cell.lo_from);
  visit(cell.hi_from);
}

template <typename Visit>
void for_points(const Polygon& cell, const Lines& lines, Visit visit)
{
  for (const int line : cell.lines)
    for (const int point : lines.through[line])
      visit(point);
}

// How the corners of a cell vary, D − 1 rows each.
void corners_of(const Interval& cell, const Lines&, const Bases<2>& bases, Motion& out)
{
  out.resize(2, bases.of.cols());
  out.row(0) = bases.of.row(cell.lo_from);
  out.row(1) = bases.of.row(cell.hi_from);
}

void corners_of(const Polygon& cell, const Lines& lines, const Bases<3>& bases, Motion& out)
{
  const std::size_t n = cell.corners.size();
  out.setZero(2 * n, bases.of.cols());
  for (std::size_t i = 0; i < n; ++i)
  {
    // on two lines: n_1·δx = n_1·((1 − t) δA + t δB), likewise the other
    const Eigen::Vector2d& x = cell.corners[i];
    Eigen::Matrix2d normals;
    std::array<std::array<int, 2>, 2> ends;
    std::array<double, 2> t;
    for (int k : {0, 1})
    {
      ends[k] = lines.through[cell.lines[k == 0 ? (i + n - 1) % n : i]];
      const auto [a, b] = ends[k];
      const Eigen::Vector2d edge = bases.c[b] - bases.c[a];
      t[k] = edge.dot(x - bases.c[a]) / edge.squaredNorm();
      normals.row(k) << -edge[1], edge[0];
      normals.row(k).normalize();
    }
    // δx += P ((1 − t) δA + t δB)
    auto add = [&](const Eigen::Matrix2d& P, int k)
    {
      for (int end : {0, 1})
      {
        const Eigen::Matrix2d of = (end == 0 ? 1 - t[k] : t[k]) * P;
        const auto base = bases.of.middleRows<2>(2 * ends[k][end]);
        for (int r : {0, 1})
          out.row(2 * i + r) += of(r, 0) * base.row(0) + of(r, 1) * base.row(1);
      }
    };
    if (std::abs(normals.determinant()) < 1e-6) // it lies inside an edge
    {
      add(Eigen::Matrix2d::Identity(), 0);
      continue;
    }
    const Eigen::Matrix2d inverse = normals.inverse();
    for (int k : {0, 1})
      add(inverse.col(k) * normals.row(k), k);
  }
}

// Simplices of a cell: visit(its corners' numbers, their points, measure in units of the reference
// simplex).
template <typename Visit>
void simplices(const Interval& cell, Visit visit)
{
  const std::array<Vector<1>, 2> c = {Vector<1>(cell.lo), Vector<1>(cell.hi)};
  visit(std::array<std::size_t, 2>{0, 1}, c, cell.hi - cell.lo);
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
      visit(std::array<std::size_t, 3>{0, i - 1, i}, c, twice);
  }
}

// δ of the measure in `simplices`, whose corners are rows `at` of `of`.
Eigen::RowVectorXd measure_variation(const std::array<Vector<1>, 2>&, const Motion& of,
                                     const std::array<std::size_t, 2>& at)
{
  return of.row(at[1]) - of.row(at[0]);
}

Eigen::RowVectorXd measure_variation(const std::array<Vector<2>, 3>& c, const Motion& of,
                                     const std::array<std::size_t, 3>& at)
{
  const Eigen::Vector2d a = c[1] - c[0], b = c[2] - c[0];
  const auto d0 = of.middleRows<2>(2 * at[0]), d1 = of.middleRows<2>(2 * at[1]),
             d2 = of.middleRows<2>(2 * at[2]);
  return b[1] * (d1.row(0) - d0.row(0)) - b[0] * (d1.row(1) - d0.row(1))
         + a[0] * (d2.row(1) - d0.row(1)) - a[1] * (d2.row(0) - d0.row(0));
}

} // namespace

template <int D>
CellPoints<D> Segments<D>::points(const Surface& slave, int f, const Surface& master,
                                  std::span<const int> near, const Vector<D>& direction,
                                  double reach, bool motion) const
{
  constexpr int Q = D - 1;
  constexpr double grazing = 0.1; // facets seen at less than 6 degrees are left out
  using Set = typename Chart<D>::Set;
  const Chart<D> chart(slave, f);
  const bool turns = direction.isZero();
  const Vector<D> m = turns ? chart.normal() : Vector<D>(direction.normalized());

  std::vector<Shadow<D>> shadows;
  std::vector<Vector<D>> projected; // (c, s) of all corners, in the order around their facets
  for (int g : near)
  {
    if (std::abs(m.dot(chart.normal())) < grazing)
      break;
    Shadow<D> shadow{{}, 0, g, static_cast<int>(projected.size()), {}};
    Few<Vector<Q>, 4> c;
    double nearest = INFINITY;
    for (int v : around(master.ref.shape))
    {
      projected.push_back(chart.project(corner<D>(master, g, v), m));
      const Vector<D>& at = projected.back();
      c.push_back(at.template head<Q>());
      shadow.height += std::abs(at[D - 1]) / master.nv();
      nearest = std::min(nearest, std::abs(at[D - 1]));
    }
    if (nearest <= reach)
      append(c, double(slave.sigma[f]) * master.sigma[g], shadow, shadows);
  }
  // where several facets overlap the nearest one counts
  std::stable_sort(shadows.begin(), shadows.end(),
                   [](const auto& a, const auto& b) { return a.height < b.height; });

  const int nv = slave.nv();
  Set whole = chart.whole();
  Lines lines;
  if (motion)
  {
    Few<int, 4> own;
    for (int v = 0; v < nv; ++v)
      own.push_back(v);
    lines.number(whole, own, 0);
    for (Shadow<D>& s : shadows)
      lines.number(s.set, s.at, nv + s.first);
  }
  std::vector<Set> sets;
  sets.reserve(shadows.size());
  for (const Shadow<D>& s : shadows)
    sets.push_back(s.set);
  std::vector<Part<Set>> cells;
  divide<Set>(whole, sets, cells);

  CellPoints<D> out;
  Bases<D> bases;
  Motion of_kappa;
  if (motion)
  {
    // only some of the projected points are on the boundary of a cell
    std::vector<bool> used(nv + projected.size(), false);
    for (const Part<Set>& cell : cells)
      for_points(cell.set, lines, [&](int point) { used[point] = true; });
    auto is_used = [&](const Shadow<D>& s)
    {
      const auto first = used.begin() + nv + s.first;
      return std::find(first, first + master.nv(), true) != first + master.nv();
    };
    for (const Shadow<D>& s : shadows)
      if (is_used(s))
        out.facets.push_back(s.master);
    std::sort(out.facets.begin(), out.facets.end());
    out.facets.erase(std::unique(out.facets.begin(), out.facets.end()), out.facets.end());
    const int columns = D * (nv + static_cast<int>(out.facets.size()) * master.nv());
    of_kappa = chart.kappa_variation();
    bases.c.resize(nv + projected.size());
    bases.of.setZero(Q * bases.c.size(), columns);
    const auto corner_order = around(slave.ref.shape);
    for (int i = 0; i < nv; ++i)
    {
      const Eigen::Map<const Vector<Q>> xi(reference_vertex(slave.ref.shape, corner_order[i]));
      const double w = D == 2 ? 0 : (xi[0] - 0.5) * (xi[Q - 1] - 0.5);
      bases.c[i] = xi + w * chart.kappa();
      bases.of.template middleRows<Q>(Q * i).leftCols(D * nv) = w * of_kappa;
    }
    for (const Shadow<D>& s : shadows)
    {
      if (not is_used(s))
        continue;
      const auto g = std::lower_bound(out.facets.begin(), out.facets.end(), s.master);
      const int first = nv + static_cast<int>(g - out.facets.begin()) * master.nv();
      for (int i = 0; i < master.nv(); ++i)
      {
        const Vector<D>& at = projected[s.first + i];
        const int b = nv + s.first + i;
        bases.c[b] = at.template head<Q>();
        auto base = bases.of.template middleRows<Q>(Q * b);
        base.leftCols(D * nv) = chart.variation(at, m, true, turns);
        base.template middleCols<D>(D * (first + around(master.ref.shape)[i])) = chart.dual(m);
      }
    }
  }

  int number = 0;
  for (const Part<Set>& cell : cells)
    simplices(cell.set, [&](const auto&, const auto&, double) { number += _cell.size(); });
  out.points.reserve(number);
  if (motion)
    out.motion.resize(D * number, bases.of.cols());
  Motion of, d;
  Eigen::RowVectorXd of_measure;
  for (const Part<Set>& cell : cells)
  {
    if (motion)
      corners_of(cell.set, lines, bases, of);
    simplices(cell.set,
              [&](const auto& at, const auto& corners, double measure)
              {
                if (motion)
                  of_measure = measure_variation(corners, of, at) / measure;
                for (int p = 0; p < _cell.size(); ++p)
                {
                  const double* const x = &_cell.points[p * Q];
                  Vector<Q> c = corners[0];
                  double first = 1;
                  for (int i = 0; i < Q; ++i)
                  {
                    c += x[i] * (corners[i + 1] - corners[0]);
                    first -= x[i];
                  }
                  const Vector<Q> xi = chart.xi(c);
                  const Eigen::Matrix<double, Q, Q> J = chart.gradient(xi);
                  const int row = D * static_cast<int>(out.points.size());
                  out.points.push_back({xi, _cell.weights[p] * measure / J.determinant(),
                                        cell.other < 0 ? -1 : shadows[cell.other].master});
                  if (not motion)
                    continue;
                  auto of_weight = out.motion.row(row);
                  auto of_xi = out.motion.template middleRows<Q>(row + 1);
                  of_weight = of_measure;
                  for (int q = 0; q < Q; ++q)
                    if constexpr (D == 2)
                      of_xi.row(q) = first * of.row(at[0]) + x[0] * of.row(at[1]);
                    else
                      of_xi.row(q) = first * of.row(2 * at[0] + q) + x[0] * of.row(2 * at[1] + q)
                                     + x[1] * of.row(2 * at[2] + q);
                  if constexpr (D == 3)
                    if (chart.curves())
                    {
                      // c = ξ + κ w(ξ): δξ = J⁻¹ (δc − w δκ); κ knows the slave facet's corners
                      // only
                      const Vector<2> w = xi.array() - 0.5; // ∂_2 w, ∂_1 w
                      const double det = J.determinant();
                      of_xi.leftCols(D * nv) -= w[0] * w[1] * of_kappa;
                      of_weight.leftCols(D * nv)
                          -= (w[1] * of_kappa.row(0) + w[0] * of_kappa.row(1)) / det;
                      if (chart.kappa().isZero(0)) // J = I
                        continue;
                      d = of_xi;
                      of_xi.noalias() = J.inverse().lazyProduct(d);
                      of_weight
                          -= (chart.kappa()[0] * of_xi.row(1) + chart.kappa()[1] * of_xi.row(0))
                             / det;
                    }
                }
              });
  }
  return out;
}

template class Segments<2>;
template class Segments<3>;

} // namespace dolfinx_contact
