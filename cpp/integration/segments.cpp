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
  int first;           // number of its first corner among all projected ones
  std::vector<int> at; // which of them follow each other around the set
};

// Append the set of the projected corners c of a master facet, if it faces the slave: σ σ' τ·τ' <
// 0.
void append(const std::vector<Vector<1>>& c, double facing, Shadow<2> shadow,
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

void append(const std::vector<Vector<2>>& c, double facing, Shadow<3> shadow,
            std::vector<Shadow<3>>& out)
{
  const Polygon p{c};
  const double area = p.signed_area();
  if (not(area * facing < 0))
    return;
  std::vector<int> order(c.size());
  std::iota(order.begin(), order.end(), 0);
  if (area < 0)
    std::reverse(order.begin(), order.end());
  auto add = [&](const std::vector<int>& at)
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
      const std::vector<int>&o = order, a = {o[i], o[i + 1], o[i + 2]},
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

  void number(Interval& set, const std::vector<int>& at, int first)
  {
    set.lo_from = first + at[0];
    set.hi_from = first + at[1];
  }

  void number(Polygon& set, const std::vector<int>& at, int first)
  {
    for (std::size_t i = 0; i < at.size(); ++i)
    {
      set.lines.push_back(static_cast<int>(through.size()));
      through.push_back({first + at[i], first + at[(i + 1) % at.size()]});
    }
  }
};

template <int D>
using Motion = Eigen::Matrix<double, D - 1, Eigen::Dynamic, Eigen::RowMajor>;

// A point that the corners of cells are made of, and how it varies.
template <int D>
struct Base
{
  Vector<D - 1> c;
  Motion<D> of;
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

// How the corners of a cell vary.
std::vector<Motion<2>> corners_of(const Interval& cell, const Lines&,
                                  const std::vector<Base<2>>& bases)
{
  return {bases[cell.lo_from].of, bases[cell.hi_from].of};
}

std::vector<Motion<3>> corners_of(const Polygon& cell, const Lines& lines,
                                  const std::vector<Base<3>>& bases)
{
  std::vector<Motion<3>> out;
  const std::size_t n = cell.corners.size();
  for (std::size_t i = 0; i < n; ++i)
  {
    // on two lines: n_1·δx = n_1·((1 − t) δA + t δB), likewise the other
    const Eigen::Vector2d& x = cell.corners[i];
    Eigen::Matrix2d normals;
    std::array<Motion<3>, 2> on;
    for (int k : {0, 1})
    {
      const auto [a, b] = lines.through[cell.lines[k == 0 ? (i + n - 1) % n : i]];
      const Eigen::Vector2d edge = bases[b].c - bases[a].c;
      const double t = edge.dot(x - bases[a].c) / edge.squaredNorm();
      on[k] = (1 - t) * bases[a].of + t * bases[b].of;
      normals.row(k) << -edge[1], edge[0];
      normals.row(k).normalize();
    }
    if (std::abs(normals.determinant()) < 1e-6) // it lies inside an edge
    {
      out.push_back(on[0]);
      continue;
    }
    Motion<3> rhs(2, on[0].cols());
    for (int k : {0, 1})
      rhs.row(k) = normals.row(k) * on[k];
    out.push_back(normals.inverse() * rhs);
  }
  return out;
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

// δ of the measure in `simplices`.
Motion<2>::RowXpr::PlainObject measure_variation(const std::array<Vector<1>, 2>&,
                                                 const std::array<Motion<2>, 2>& dc)
{
  return dc[1].row(0) - dc[0].row(0);
}

Motion<3>::RowXpr::PlainObject measure_variation(const std::array<Vector<2>, 3>& c,
                                                 const std::array<Motion<3>, 3>& dc)
{
  const Eigen::Vector2d a = c[1] - c[0], b = c[2] - c[0];
  const Motion<3> da = dc[1] - dc[0], db = dc[2] - dc[0];
  return da.row(0) * b[1] - da.row(1) * b[0] + a[0] * db.row(1) - a[1] * db.row(0);
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
    std::vector<Vector<Q>> c;
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
    std::vector<int> own(nv);
    std::iota(own.begin(), own.end(), 0);
    lines.number(whole, own, 0);
    for (Shadow<D>& s : shadows)
      lines.number(s.set, s.at, nv + s.first);
  }
  std::vector<Set> sets;
  for (const Shadow<D>& s : shadows)
    sets.push_back(s.set);
  std::vector<Part<Set>> cells;
  divide<Set>(whole, sets, cells);

  CellPoints<D> out;
  std::vector<Base<D>> bases;
  Motion<D> of_kappa;
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
    of_kappa = Motion<D>::Zero(Q, columns);
    of_kappa.leftCols(D * nv) = chart.kappa_variation();
    const auto corner_order = around(slave.ref.shape);
    for (int i = 0; i < nv; ++i)
    {
      const Eigen::Map<const Vector<Q>> xi(reference_vertex(slave.ref.shape, corner_order[i]));
      const double w = D == 2 ? 0 : (xi[0] - 0.5) * (xi[Q - 1] - 0.5);
      bases.push_back({xi + w * chart.kappa(), w * of_kappa});
    }
    bases.resize(nv + projected.size());
    for (const Shadow<D>& s : shadows)
    {
      if (not is_used(s))
        continue;
      const auto g = std::lower_bound(out.facets.begin(), out.facets.end(), s.master);
      const int first = nv + static_cast<int>(g - out.facets.begin()) * master.nv();
      for (int i = 0; i < master.nv(); ++i)
      {
        const Vector<D>& at = projected[s.first + i];
        Base<D>& base = bases[nv + s.first + i];
        base.c = at.template head<Q>();
        base.of.setZero(Q, columns);
        base.of.leftCols(D * nv) = chart.variation(at, m, true, turns);
        base.of.template middleCols<D>(D * (first + around(master.ref.shape)[i])) = chart.dual(m);
      }
    }
  }
  Motion<D> d;
  for (const Part<Set>& cell : cells)
  {
    std::vector<Motion<D>> of_corners;
    if (motion)
      of_corners = corners_of(cell.set, lines, bases);
    simplices(cell.set,
              [&](const auto& at, const auto& corners, double measure)
              {
                std::array<Motion<D>, D> dc;
                typename Motion<D>::RowXpr::PlainObject of_measure;
                if (motion)
                {
                  for (int i = 0; i < D; ++i)
                    dc[i] = of_corners[at[i]];
                  of_measure = measure_variation(corners, dc) / measure;
                }
                for (int p = 0; p < _cell.size(); ++p)
                {
                  Vector<Q> c = corners[0];
                  for (int i = 0; i < Q; ++i)
                    c += _cell.points[p * Q + i] * (corners[i + 1] - corners[0]);
                  const Vector<Q> xi = chart.xi(c);
                  const Eigen::Matrix<double, Q, Q> J = chart.gradient(xi);
                  out.points.push_back({xi, _cell.weights[p] * measure / J.determinant(),
                                        cell.other < 0 ? -1 : shadows[cell.other].master});
                  if (not motion)
                    continue;
                  // c = ξ + κ w(ξ): δξ = J⁻¹ (δc − w δκ)
                  double first = 1;
                  for (int i = 0; i < Q; ++i)
                    first -= _cell.points[p * Q + i];
                  d = first * dc[0];
                  for (int i = 0; i < Q; ++i)
                    d += _cell.points[p * Q + i] * dc[i + 1];
                  const double w = D == 2 ? 0 : (xi[0] - 0.5) * (xi[Q - 1] - 0.5);
                  const bool curved = not chart.kappa().isZero(0);
                  if (curved)
                    d -= w * of_kappa;
                  auto& row = out.motion.emplace_back(D, d.cols());
                  row.row(0) = of_measure;
                  row.bottomRows(Q).noalias() = J.inverse().lazyProduct(d);
                  if constexpr (D == 3)
                    if (curved)
                      row.row(0)
                          -= (of_kappa.row(0) * (xi[1] - 0.5) + of_kappa.row(1) * (xi[0] - 0.5)
                              + chart.kappa()[0] * row.row(2) + chart.kappa()[1] * row.row(1))
                             / J.determinant();
                }
              });
  }
  return out;
}

template class Segments<2>;
template class Segments<3>;

} // namespace dolfinx_contact
