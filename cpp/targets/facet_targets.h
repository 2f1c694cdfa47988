// SPDX-License-Identifier: MIT
//
// What one facet offers as targets, however it bends: straight facets and those of 2D have closed
// forms. On a curved one in 3D Newton's method runs once where the facet is flat enough to hold one
// solution at most, else once in each of its cells that may hold one.
#pragma once

#include "facet_cells.h"

namespace dolfinx_contact
{

/// (F4) The closest point of a facet, clamped to its edges.
/// @param start where Newton's method starts from
/// @param limit points farther away need not be found
/// @param inside ξ counts as inside its facet up to this
/// @returns the distance
template <int D>
double closest_point(const FacetProjection<D>& facet, Shape shape, const Vector<D>& x,
                     const Vector<D - 1>& start, double limit, double inside, Target<D>& t)
{
  t.xi = start;
  t.clamp = Clamp::none;
  double best = INFINITY;
  auto offer = [&](const Vector<D - 1>& xi)
  {
    const double distance = (x - facet.at(xi, false).x).norm();
    if (facet.outside(xi) <= inside and distance < best)
    {
      best = distance;
      t.xi = xi;
      t.clamp = Clamp::none;
    }
  };
  auto clamp = [&](auto admitted)
  {
    Target<D> clamped = t;
    for (int e = 0; e < num_edges(shape); ++e)
      if (not admitted(e))
        continue;
      else if (const double d = std::sqrt(facet.clamp(x, Vector<D>::Zero(), e, clamped)); d < best)
      {
        best = d;
        t = clamped;
      }
  };
  [[maybe_unused]] auto all = [](int) { return true; };
  if (facet.affine())
  {
    // ‖x − x²‖² is convex: its minimum is inside, or on an edge that the free one is beyond
    Vector<D - 1> xi = start;
    const bool solved = facet.closest(x, xi);
    if (solved)
      offer(xi);
    if (not(best < INFINITY))
      clamp([&](int e) { return not solved or facet.beyond(xi, e); });
  }
  else if constexpr (D == 2)
  {
    // (x − x²)·τ = 0
    facet.along(Vector<1>::Zero(), Vector<1>::Ones())
        .orthogonal(x, Vector<2>::Zero())
        .roots(-inside, 1 + inside, [&](double xi) { offer(Vector<1>(xi)); });
    clamp(all);
  }
  else
  {
    bool found_inside = false, too_far = false;
    visit_cells(facet, shape,
                [&](const FacetCell& cell)
                {
                  const Vector<D> r = x - cell.p.x;
                  too_far = too_far or (cell.level == 0 and r.norm() - cell.radius > limit);
                  if (r.norm() - cell.radius >= std::min(best, limit))
                    return false;
                  // The Hessian of ½‖x − x²‖², up to its change over the cell. If it is nowhere
                  // positive there is no minimum inside, if it is everywhere there is one at most
                  const Eigen::Matrix<double, 2, 2> metric = cell.p.tau.transpose() * cell.p.tau;
                  Eigen::Matrix<double, 2, 2> hessian = metric;
                  for (int a = 0; a < 2; ++a)
                    for (int b = 0; b < 2; ++b)
                      hessian(a, b) -= r.dot(cell.p.d2(a, b));
                  auto positive = [](const Eigen::Matrix<double, 2, 2>& A)
                  { return A(0, 0) > 0 and A.determinant() > 0; };
                  if (not positive(hessian + cell.bend * metric))
                    return false;
                  const bool one = cell.bend <= flat and positive(hessian - cell.bend * metric);
                  if (not one and not cell.smallest())
                    return true;
                  Vector<2> at = cell.level == 0 ? start : cell.xi;
                  if (facet.closest(x, at))
                    offer(at);
                  found_inside = found_inside or (cell.level == 0 and best < INFINITY);
                  return false;
                });
    if (not found_inside and not too_far) // found inside, it is convex on the whole facet
      clamp(all);
  }
  return best;
}

/// (F5) The points where the line x + s e meets a facet.
/// @param start where Newton's method starts from
/// @param offer called as offer(ξ, s), also with points a little outside the facet
template <int D, typename Offer>
void crossings(const FacetProjection<D>& facet, Shape shape, const Vector<D>& x, const Vector<D>& e,
               const Vector<D - 1>& start, Offer offer)
{
  if (facet.affine())
  {
    Vector<D - 1> xi = start;
    double s;
    if (facet.intersect(x, e, xi, s))
      offer(xi, s);
  }
  else if constexpr (D == 2)
  {
    // (x − x²) × e = 0
    const auto c = facet.along(Vector<1>::Zero(), Vector<1>::Ones());
    const Vector<2> across(e[1], -e[0]);
    const Cubic p{{across.dot(x - c.x0), -across.dot(c.x1), -across.dot(c.x2), 0}};
    p.roots(-1e-8, 1 + 1e-8, [&](double t) { offer(Vector<1>(t), e.dot(c.at(t) - x)); });
  }
  else
  {
    visit_cells(facet, shape,
                [&](const FacetCell& cell)
                {
                  const Vector<D> r = x - cell.p.x, n = cell.p.area_vector().normalized();
                  if ((r - e.dot(r) * e).norm() > cell.radius)
                    return false;
                  // a cell whose normals never become orthogonal to e is met once at most
                  const bool one = cell.bend <= flat and std::abs(e.dot(n)) >= cell.bend;
                  if (not one and not cell.smallest())
                    return true;
                  Vector<2> at = cell.level == 0 ? start : cell.xi;
                  double s;
                  if (facet.intersect(x, e, at, s))
                    offer(at, s);
                  return false;
                });
  }
}

} // namespace dolfinx_contact
