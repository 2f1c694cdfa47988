// SPDX-License-Identifier: MIT
//
// Smooth targets (F6): x¹ = x² + g M with M = Σ_A N_A n_A, not normalised. Neighbours share the
// n_A, so the prisms over the facets fit together without gap or overlap. d = g ‖M‖.
#pragma once

#include "../geometry/normals.h"
#include "facet_projection.h"

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
        if (std::abs(change) < settled)
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

  /// n̄ at ξ.
  Vector<D> normal(const Vector<Q>& xi) const
  {
    return _normals.at(_s, _f, xi.data()).M.normalized();
  }

private:
  static constexpr double settled = 1e-13;

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

  bool newton(const Vector<D>& x, Vector<Q>& xi, double& d) const
  {
    double g = 0;
    bool first = true;
    for (int it = 0; it < 30; ++it)
    {
      const FacetPoint<D> p = _projection.at(xi, false);
      const NormalField<D> field = _normals.at(_s, _f, xi.data());
      if (first)
        g = (x - p.x).dot(field.M) / field.M.squaredNorm();
      first = false;
      Eigen::Matrix<double, D, D> A;
      A << p.tau + g * field.dM, field.M;
      const Vector<D> step = A.inverse() * (x - p.x - g * field.M);
      if (not step.allFinite())
        return false;
      const double size = step.template head<Q>().template lpNorm<Eigen::Infinity>();
      const double damping = size > 0.5 ? 0.5 / size : 1.0;
      const Vector<Q> wanted = xi + damping * step.template head<Q>();
      xi = wanted.cwiseMax(-1.0).cwiseMin(2.0);
      g += damping * step[Q];
      if (size < settled)
      {
        const FacetPoint<D> q = _projection.at(xi, false);
        const NormalField<D> here = _normals.at(_s, _f, xi.data());
        d = g * here.M.norm();
        return regular(q, here, g);
      }
      if (xi != wanted and it > 8) // it stays at the limits: it leaves the facet
        return false;
    }
    return false;
  }

  const Surface& _s;
  int _f;
  FacetProjection<D> _projection;
  const NodalNormals<D>& _normals;
};

} // namespace dolfinx_contact
