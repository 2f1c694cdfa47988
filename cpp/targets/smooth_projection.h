// SPDX-License-Identifier: MIT
//
// Smooth targets (F6): x¹ = x² + g M with M = Σ_A N_A n_A, not normalised. Neighbours share the
// n_A, so the prisms over the facets fit together without gap or overlap. d = g ‖M‖.
#pragma once

#include "../geometry/normals.h"
#include "facet_cells.h"

#include <Eigen/LU>

namespace dolfinx_contact
{

/// Projection of a point on one facet along the interpolated normals.
template <int D>
class SmoothProjection
{
public:
  static constexpr int Q = D - 1;

  SmoothProjection(const Surface& s, int facet, const NodalNormals<D>& normals)
      : _s(s)
      , _f(facet)
      , _projection(s, facet)
      , _normals(normals)
  {
  }

  /// Solve (F6) on the facet's extension. Straight segments: a quadratic in g; others: Newton on
  /// (ξ, g) from `xi`, at most half a facet at a time, ξ kept in [−1, 2].
  /// @param d the signed distance, positive in penetration
  /// @returns false if there is no solution that faces the right way
  bool solve(const Vector<D>& x, Vector<Q>& xi, double& d) const
  {
    if constexpr (D == 2)
      if (_s.ref.position.degree() == 1)
        return segment(x, xi, d);
    return newton(x, xi, d);
  }

  /// Clamp to edge e (2D: its vertex): the point with r·T_m τ_E = 0, m = n̄ (F4c).
  /// @returns ‖T_m r‖ there
  double clamp(const Vector<D>& x, int e, Target<D>& t) const
  {
    t.facet = _f;
    if constexpr (D == 2)
      return beside(x, e, Clamp::vertex, t);
    else
    {
      const auto v = reference_edge(_s.ref.shape, e);
      const Vector<Q> a = vertex(v[0]), E = vertex(v[1]) - a;
      double eta = 0.5;
      for (int it = 0; it < 30; ++it)
      {
        const Vector<Q> xi = a + eta * E;
        const FacetPoint<D> p = _projection.at(xi, true);
        const NormalField<D> field = _normals.at(_s, _f, xi.data());
        const Vector<D> m = field.M.normalized(), tau = p.tau * E, r = x - p.x;
        const Vector<D> dm = (field.dM * E - m * m.dot(field.dM * E)) / field.M.norm();
        Vector<D> c = Vector<D>::Zero();
        for (int i = 0; i < Q; ++i)
          for (int j = 0; j < Q; ++j)
            c += E[i] * E[j] * p.d2(i, j);
        const Vector<D> b = tau - m.dot(tau) * m, rm = r - m.dot(r) * m;
        double A = tau.dot(b) - rm.dot(c) + tau.dot(m) * r.dot(dm) + r.dot(m) * dm.dot(tau);
        if (A <= 1e-3 * tau.dot(b))
          A = tau.dot(b);
        const double change = std::clamp(r.dot(b) / A, -0.5, 0.5);
        eta = std::clamp(eta + change, -0.5, 1.5);
        if (std::abs(change) < resolution)
          break;
      }
      if (eta <= 0 or eta >= 1)
        return beside(x, v[eta <= 0 ? 0 : 1], Clamp::vertex, t);
      t.xi = a + eta * E;
      t.clamp = Clamp::edge;
      t.edge = static_cast<std::int8_t>(e);
      return offset(x, t.xi);
    }
  }

  /// True if x is farther than `limit` beside every point of the straight edge e, so that
  /// ‖T_m r‖ exceeds it there: Newton's method of `clamp` is spared. With y on the edge of length L
  /// and y_A, n_A at its first corner, ‖T_m r‖ ≥ ‖T_A (x − y_A)‖ − L − sin∠(m, n_A) ‖x − y‖.
  bool far_beside(const Vector<D>& x, int e, double limit) const
  {
    if (D == 2 or not _projection.straight())
      return false;
    const auto v = reference_edge(_s.ref.shape, e);
    const Eigen::Map<const Vector<D>> a(_s.facet_x(_f) + D * v[0]), b(_s.facet_x(_f) + D * v[1]);
    const Vector<D>&nA = _normals.normal(_s, _f, v[0]), &nB = _normals.normal(_s, _f, v[1]);
    const Vector<D> r = x - a;
    const double length = (b - a).norm(), turn = (nB - nA).norm(); // at least the sine, up to 90°
    return turn < 1 and (r - nA.dot(r) * nA).norm() - length - turn * (r.norm() + length) > limit;
  }

  /// n̄ at ξ.
  Vector<D> normal(const Vector<Q>& xi) const
  {
    return _normals.at(_s, _f, xi.data()).M.normalized();
  }

  /// All solutions of (F6) on the facet.
  /// @param start where Newton starts from on curved facets
  /// @param limit of |d|
  /// @param offer called as offer(ξ, d), also with solutions a little outside the facet
  template <typename Offer>
  void solutions(const Vector<D>& x, const Vector<Q>& start, double limit, Offer offer) const
  {
    if constexpr (D == 2)
      curve(x, offer);
    else if (_projection.affine())
      triangle(x, limit, offer);
    else
      curved(x, start, limit, offer);
  }

private:
  static constexpr double resolution = 1e-13;

  Vector<Q> vertex(int v) const { return FacetProjection<D>::vertex(_s.ref.shape, v); }

  double offset(const Vector<D>& x, const Vector<Q>& xi) const
  {
    const Vector<D> m = normal(xi), r = x - _projection.at(xi, false).x;
    return (r - m.dot(r) * m).norm();
  }

  double beside(const Vector<D>& x, int v, Clamp clamp, Target<D>& t) const
  {
    t.xi = vertex(v);
    t.clamp = clamp;
    t.edge = static_cast<std::int8_t>(v);
    return offset(x, t.xi);
  }

  // det[τ_α + g ∂_α M, M] keeps the sign of the facet's own orientation up to the focal points
  bool regular(const FacetPoint<D>& p, const NormalField<D>& field, double g) const
  {
    Eigen::Matrix<double, D, D> A;
    A << p.tau + g * field.dM, field.M;
    // 2D: det[τ, n] with n = σ (τ_y, −τ_x) is −σ; 3D: det[τ_1, τ_2, n] is +σ
    return A.determinant() * _s.sigma[_f] * (D == 2 ? -1 : 1) > 0;
  }

  // (x_B − x_A + g (n_B − n_A)) × (x − x_A − g n_A) = 0
  bool segment(const Vector<D>& x, Vector<Q>& xi, double& d) const
  {
    const double* X = _s.facet_x(_f);
    const Vector<D> xA(X[0], X[1]), e(X[2] - X[0], X[3] - X[1]), r = x - xA;
    const Vector<D>&nA = _normals.normal(_s, _f, 0), &nB = _normals.normal(_s, _f, 1);
    const Vector<D> dn = nB - nA;
    auto cross = [](const Vector<D>& a, const Vector<D>& b) { return a[0] * b[1] - a[1] * b[0]; };
    const double a = -cross(dn, nA), b = cross(dn, r) - cross(e, nA), c = cross(e, r);
    const double discriminant = b * b - 4 * a * c;
    if (discriminant < 0)
      return false;
    // both roots without cancellation; a → 0 leaves the linear one
    const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
    const double roots[2] = {q != 0 ? c / q : 0.0, a != 0 ? q / a : INFINITY};
    bool found = false;
    double least = INFINITY;
    for (const double g : roots)
    {
      if (not std::isfinite(g))
        continue;
      const Vector<D> side = e + g * dn;
      const double along = (r - g * nA).dot(side) / side.squaredNorm();
      const Vector<Q> at(along);
      const NormalField<D> field = _normals.at(_s, _f, at.data());
      const double distance = g * field.M.norm();
      FacetPoint<D> p;
      p.tau.col(0) = e;
      // of two solutions the one inside counts, else the nearer one
      const double cost
          = std::abs(distance) + (_projection.outside(at) > 1e-8 ? 1e3 * e.norm() : 0.0);
      if (std::isfinite(along) and regular(p, field, g) and cost < least)
      {
        least = cost;
        xi = at;
        d = distance;
        found = true;
      }
    }
    return found;
  }

  // 2D: (x − x²(ξ)) × M(ξ) = 0, of the third degree in ξ
  template <typename Offer>
  void curve(const Vector<D>& x, Offer offer) const
  {
    const auto c = _projection.along(Vector<Q>::Zero(), Vector<Q>::Ones());
    const Vector<D> r = x - c.x0, &nA = _normals.normal(_s, _f, 0),
                    dn = _normals.normal(_s, _f, 1) - nA;
    auto cross = [](const Vector<D>& a, const Vector<D>& b) { return a[0] * b[1] - a[1] * b[0]; };
    const Cubic p{{cross(r, nA), cross(r, dn) - cross(c.x1, nA), -cross(c.x1, dn) - cross(c.x2, nA),
                   -cross(c.x2, dn)}};
    p.roots(-1e-8, 1 + 1e-8,
            [&](double t)
            {
              double d;
              if (const Vector<Q> xi(t); accept(x, xi, offset_along(x, xi), d))
                offer(xi, d);
            });
  }

  // Straight triangle: x lies in the plane of the triangle of the x_A + g n_A, a cubic in g
  template <typename Offer>
  void triangle(const Vector<D>& x, double limit, Offer offer) const
  {
    using Matrix = Eigen::Matrix<double, 3, 3>;
    const double* X = _s.facet_x(_f);
    const Vector<D> xA(X[0], X[1], X[2]), nA = _normals.normal(_s, _f, 0);
    Matrix P, N; // sides of the triangle and the vector from x to its corner, and their slopes in g
    double least = 1, size = (x - xA).norm();
    const Vector<D> middle = normal(Vector<Q>::Constant(1.0 / 3));
    for (int k = 1; k < 3; ++k)
    {
      const Vector<D>& n = _normals.normal(_s, _f, k);
      P.col(k - 1) = Vector<D>(X[3 * k], X[3 * k + 1], X[3 * k + 2]) - xA;
      N.col(k - 1) = n - nA;
      size += P.col(k - 1).norm();
    }
    P.col(2) = xA - x;
    N.col(2) = nA;
    for (int k = 0; k < 3; ++k)
      least = std::min(least, middle.dot(_normals.normal(_s, _f, k)));
    least = std::max(least, 0.05); // of ‖M‖
    auto det = [](const auto& a, const auto& b, const auto& c) { return a.dot(b.cross(c)); };
    const Cubic p{{det(P.col(0), P.col(1), P.col(2)),
                   det(N.col(0), P.col(1), P.col(2)) + det(P.col(0), N.col(1), P.col(2))
                       + det(P.col(0), P.col(1), N.col(2)),
                   det(N.col(0), N.col(1), P.col(2)) + det(N.col(0), P.col(1), N.col(2))
                       + det(P.col(0), N.col(1), N.col(2)),
                   det(N.col(0), N.col(1), N.col(2))}};
    const double g_max = std::min(limit, size) / least;
    p.roots(-g_max, g_max,
            [&](double g)
            {
              const Matrix A = P + g * N;
              const Eigen::Matrix<double, 3, 2> sides = A.template leftCols<2>();
              Vector<Q> xi
                  = (sides.transpose() * sides).inverse() * (sides.transpose() * -A.col(2));
              double d;
              // one step of Newton's method wins the digits that the cubic has lost
              if (_projection.outside(xi) < 1e-3 and step(x, xi, g) and accept(x, xi, g, d))
                offer(xi, d);
            });
  }

  // Newton once where the facet is so flat that it has one solution at most, else in cells
  template <typename Offer>
  void curved(const Vector<D>& x, const Vector<Q>& start, double limit, Offer offer) const
  {
    Vector<D> mixed = Vector<D>::Zero(); // ∂²_12 M
    if (_s.ref.shape == Shape::quadrilateral)
      for (int k = 0; k < 4; ++k)
        mixed += (k == 0 or k == 3 ? 1 : -1) * _normals.normal(_s, _f, k);
    visit_cells(_projection, _s.ref.shape,
                [&](const FacetCell& cell)
                {
                  const NormalField<D> field = _normals.at(_s, _f, cell.xi.data());
                  const double w = cell.width, length = field.M.norm(), slope = field.dM.norm(),
                               spread = w * (1.5 * slope + w * mixed.norm()); // of M over the cell
                  const Vector<D> r = x - cell.p.x, m = field.M / length;
                  const double along = m.dot(r), distance = r.norm();
                  if (distance - cell.radius > limit)
                    return false;
                  // |g| of a solution in the cell, and how far aside g (M − M_c) may then reach
                  const double g_max = (distance + cell.radius) / (length - spread);
                  if (length > spread and (r - along * m).norm() > cell.radius + g_max * spread)
                    return false;
                  // x² + g M is one-to-one over the cell if its tangents at x, τ + g ∂M, change
                  // little there
                  const double g = along / length, stretch = least_stretch(cell.p);
                  FacetPoint<D> offset;
                  offset.tau = cell.p.tau + g * field.dM;
                  const double change = 0.5 * cell.bend * stretch + std::abs(g) * w * mixed.norm()
                                        + w * cell.p.tau.norm() / length * slope;
                  const bool one = cell.bend <= flat and spread <= 0.5 * length
                                   and change <= 0.5 * least_stretch(offset);
                  if (not one and not cell.smallest())
                    return true;
                  Vector<Q> at = cell.level == 0 ? start : cell.xi;
                  if (double d; newton(x, at, d))
                    offer(at, d);
                  return false;
                });
  }

  // g of the point of the line along M(ξ) that is nearest to x
  double offset_along(const Vector<D>& x, const Vector<Q>& xi) const
  {
    const Vector<D> M = _normals.at(_s, _f, xi.data()).M;
    return (x - _projection.at(xi, false).x).dot(M) / M.squaredNorm();
  }

  // (ξ, g) solves (F6) to 1e-10 of the facet's size, on the right side of the focal points
  bool accept(const Vector<D>& x, const Vector<Q>& xi, double g, double& d) const
  {
    const FacetPoint<D> p = _projection.at(xi, false);
    const NormalField<D> field = _normals.at(_s, _f, xi.data());
    d = g * field.M.norm();
    const double round_off = 1e-14 * x.norm();
    return (x - p.x - g * field.M).norm() <= 1e-10 * p.tau.norm() + round_off
           and regular(p, field, g);
  }

  // One step of Newton's method on (ξ, g), at most half a facet long, ξ kept in [−1, 2]
  // @param change receives the largest of the whole Δξ
  bool step(const Vector<D>& x, Vector<Q>& xi, double& g, double* change = nullptr) const
  {
    const FacetPoint<D> p = _projection.at(xi, false);
    const NormalField<D> field = _normals.at(_s, _f, xi.data());
    Eigen::Matrix<double, D, D> A;
    A << p.tau + g * field.dM, field.M;
    const Vector<D> delta = A.inverse() * (x - p.x - g * field.M);
    if (not delta.allFinite())
      return false;
    const double size = delta.template head<Q>().template lpNorm<Eigen::Infinity>();
    const double damping = size > 0.5 ? 0.5 / size : 1.0;
    xi = (xi + damping * delta.template head<Q>()).cwiseMax(-1.0).cwiseMin(2.0);
    g += damping * delta[Q];
    if (change)
      *change = size;
    return true;
  }

  bool newton(const Vector<D>& x, Vector<Q>& xi, double& d) const
  {
    double g = offset_along(x, xi), last = INFINITY;
    for (int it = 0; it < 30; ++it)
    {
      double size;
      if (not step(x, xi, g, &size))
        return false;
      // far from the origin round-off stops the steps before they reach the resolution
      if (size < resolution or (size < 1e-9 and size >= 0.5 * last))
        return accept(x, xi, g, d);
      const bool at_limit = xi.minCoeff() == -1 or xi.maxCoeff() == 2;
      if (at_limit and it > 8) // it stays there: it leaves the facet
        return false;
      last = size;
    }
    return false;
  }

  const Surface& _s;
  int _f;
  FacetProjection<D> _projection;
  const NodalNormals<D>& _normals;
};

} // namespace dolfinx_contact
