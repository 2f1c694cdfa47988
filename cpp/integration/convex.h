// SPDX-License-Identifier: MIT
//
// Convex sets of a facet's parametric plane, and how one is cut out of another: intervals in 2D,
// polygons in 3D. A set is cut by one straight edge after the other, and both sides of each cut
// share its end points: the measures of all parts add up to that of the whole, whatever is cut out.
#pragma once

#include "few.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Parts smaller than this fraction of the whole are nothing.
constexpr double sliver = 1e-14;

/// An interval of the line.
struct Interval
{
  double lo = 0, hi = 0;
  int lo_from = -1, hi_from = -1; ///< numbers that the ends keep when they are cut

  double measure() const { return std::max(0.0, hi - lo); }
  bool empty() const { return hi <= lo; }

  /// The part inside of `other`; parts on its two sides are appended to `rest`.
  Interval cut(const Interval& other, std::vector<Interval>& rest) const
  {
    const Interval inside{std::max(lo, other.lo), std::min(hi, other.hi),
                          lo >= other.lo ? lo_from : other.lo_from,
                          hi <= other.hi ? hi_from : other.hi_from};
    for (const Interval& out : {Interval{lo, inside.lo, lo_from, inside.lo_from},
                                Interval{inside.hi, hi, inside.hi_from, hi_from}})
      if (not out.empty())
        rest.push_back(out);
    return inside;
  }
};

/// A convex polygon, its corners counter-clockwise.
struct Polygon
{
  Few<Eigen::Vector2d, 8> corners; ///< two quadrilaterals have no more in common
  Few<int, 8> lines = {}; ///< if any, numbers that the edges keep when they are cut: that of the
                          ///< line from each corner to the next

  static double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b)
  {
    return a[0] * b[1] - a[1] * b[0];
  }

  /// Area, negative if the corners run clockwise.
  double signed_area() const
  {
    double twice = 0;
    for (std::size_t i = 2; i < corners.size(); ++i)
      twice += cross(corners[i - 1] - corners[0], corners[i] - corners[0]);
    return 0.5 * twice;
  }
  double measure() const { return std::max(0.0, signed_area()); }
  bool empty() const { return corners.size() < 3; }
  void clear()
  {
    corners.clear();
    lines.clear();
  }

  /// True if it nowhere turns to the right.
  bool convex() const
  {
    const std::size_t n = corners.size();
    const double area = signed_area();
    for (std::size_t i = 0; i < n; ++i)
    {
      const Eigen::Vector2d &a = corners[i], &b = corners[(i + 1) % n], &c = corners[(i + 2) % n];
      if (cross(b - a, c - b) < -sliver * area)
        return false;
    }
    return area > 0;
  }

  /// Cut along the line through a and b.
  /// @param line its number
  /// @param left, right the two sides, seen from a to b; maybe empty
  void split(const Eigen::Vector2d& a, const Eigen::Vector2d& b, int line, Polygon& left,
             Polygon& right) const
  {
    left.clear();
    right.clear();
    const bool numbered = not lines.empty();
    auto add = [&](Polygon& side, const Eigen::Vector2d& x, int next)
    {
      side.corners.push_back(x);
      if (numbered)
        side.lines.push_back(next);
    };
    const Eigen::Vector2d edge = (b - a).normalized();
    double size = 0;
    for (const Eigen::Vector2d& p : corners)
      size = std::max(size, (p - a).lpNorm<1>());
    // corners as near to the line as round-off brings them are on it, and belong to both sides
    auto height = [&](const Eigen::Vector2d& p)
    {
      const double d = cross(edge, p - a);
      return std::abs(d) <= 4e-16 * size ? 0.0 : d;
    };
    const std::size_t n = corners.size();
    for (std::size_t i = 0; i < n; ++i)
    {
      const Eigen::Vector2d &p = corners[i], &q = corners[(i + 1) % n];
      const double dp = height(p), dq = height(q);
      const int own = numbered ? lines[i] : -1;
      if (dp >= 0)
        add(left, p, dp == 0 and dq < 0 ? line : own);
      if (dp <= 0)
        add(right, p, dp == 0 and dq > 0 ? line : own);
      if ((dp < 0 and dq > 0) or (dp > 0 and dq < 0))
      {
        const Eigen::Vector2d x = p + dp / (dp - dq) * (q - p);
        add(left, x, dq > 0 ? own : line);
        add(right, x, dq > 0 ? line : own);
      }
    }
    for (Polygon* side : {&left, &right})
      if (side->signed_area() <= 0) // a corner or an edge of the polygon
        side->clear();
  }

  /// The part inside of `other`; the parts outside are appended to `rest`.
  Polygon cut(const Polygon& other, std::vector<Polygon>& rest) const
  {
    Polygon inside = *this, left, right;
    const std::size_t n = other.corners.size();
    for (std::size_t i = 0; i < n and not inside.empty(); ++i)
    {
      const Eigen::Vector2d &a = other.corners[i], &b = other.corners[(i + 1) % n];
      if (a == b)
        continue;
      inside.split(a, b, other.lines.empty() ? -1 : other.lines[i], left, right);
      if (not right.empty())
        rest.push_back(right);
      inside = left;
    }
    return inside;
  }
};

/// A part of a set, and which of several others covers it (−1: none).
template <typename Set>
struct Part
{
  Set set;
  int other;
};

/// Divide a set along others: parts within each of them, and what none covers.
///
/// The parts add up to the whole, whether the others fit together, overlap (the first one counts)
/// or leave gaps. Where they fit together the parts are the plain intersections.
template <typename Set>
void divide(const Set& whole, std::span<const Set> others, std::vector<Part<Set>>& parts)
{
  const int n = static_cast<int>(others.size());
  const double all = whole.measure(), least = sliver * all;

  // each takes its part from what the former ones have left
  parts.clear();
  std::vector<Set> left = {whole}, next;
  for (int j = 0; j < n; ++j)
  {
    next.clear();
    for (Set& piece : left)
    {
      const std::size_t before = next.size();
      Set inside = piece.cut(others[j], next);
      if (inside.measure() > least)
        parts.push_back({std::move(inside), j});
      else
      {
        next.resize(before);
        next.push_back(std::move(piece));
      }
    }
    std::swap(left, next);
  }
  double rest = 0;
  for (Set& piece : left)
    if (piece.measure() > least)
    {
      rest += piece.measure();
      parts.push_back({std::move(piece), -1});
    }

  // What is left has been cut again and again. If they cover the whole, and once, there is no need:
  if (rest > 1e-13 * all)
    return;
  std::vector<Part<Set>> plain;
  double covered = 0;
  for (int j = 0; j < n; ++j)
  {
    next.clear();
    Set inside = whole.cut(others[j], next);
    covered += inside.measure();
    if (inside.measure() > least)
      plain.push_back({std::move(inside), j});
  }
  if (std::abs(covered - all) <= 1e-13 * all)
    std::swap(parts, plain);
}

} // namespace dolfinx_contact
