// SPDX-License-Identifier: MIT
#pragma once

#include "../geometry/surface.h"
#include "real_roots.h"

#include <cmath>
#include <limits>

namespace dolfinx_contact
{

/// How a target is held on its facet (formulation, section 4, "Clamping").
enum class Clamp : std::int8_t
{
  none,  ///< inside the facet (or extrapolated by a small margin)
  edge,  ///< on an edge of a 3D facet
  vertex ///< on a corner; in 2D the only clamp there is
};

/// A point of a facet in its local coordinates.
template <int D>
struct Target
{
  static constexpr int Q = D - 1;
  int facet = -1; ///< position in the master surface, −1: no target
  Vector<Q> xi = Vector<Q>::Zero();
  Clamp clamp = Clamp::none;
  std::int8_t edge = 0; ///< which edge or vertex (2D: end vertex)
  /// Facets farther away than this have no say in the search that found it, or found nothing
  double decided = INFINITY;
};

/// Projections of a point on one facet in its current position.
template <int D>
class FacetProjection
{
public:
  static constexpr int Q = D - 1;

  FacetProjection(const Surface& s, int facet)
      : _s(s)
      , _f(facet)
      , _shape(s.ref.shape)
  {
  }

  /// True if the edges are straight.
  bool straight() const { return _s.ref.position.degree() == 1; }

  /// True if ∂²x² vanishes.
  bool affine() const { return straight() and _shape != Shape::quadrilateral; }

  /// True if ξ is beyond edge e.
  bool beyond(const Vector<Q>& xi, int e) const
  {
    if constexpr (D == 2)
      return e == 0 ? xi[0] < 0 : xi[0] > 1;
    else if (_shape == Shape::triangle)
      return e == 0 ? xi.sum() > 1 : xi[e - 1] < 0;
    else
      return e == 0 ? xi[1] < 0 : e == 1 ? xi[0] < 0 : e == 2 ? xi[0] > 1 : xi[1] > 1;
  }

  /// Position, tangents and, if wanted, curvature at ξ.
  FacetPoint<D> at(const Vector<Q>& xi, bool second) const
  {
    BasisValues b;
    _s.ref.position.tabulate(xi.data(), b, second);
    return evaluate<D>(_s.facet_x(_f), _s.np(), b, second);
  }

  /// Unit normal, inward to the master.
  Vector<D> normal(const FacetPoint<D>& p) const
  {
    return double(_s.sigma[_f]) * p.area_vector().normalized();
  }

  /// By how much ξ leaves the facet: 0 inside, else the largest violation; `edge` tells where.
  double outside(const Vector<Q>& xi, int& edge) const
  {
    double worst = 0;
    auto test = [&](double violation, int e)
    {
      if (violation > worst)
      {
        worst = violation;
        edge = e;
      }
    };
    if (_shape == Shape::interval)
    {
      test(-xi[0], 0);
      test(xi[0] - 1, 1);
    }
    else if (_shape == Shape::triangle)
    {
      test(xi[0] + xi[Q - 1] - 1, 0);
      test(-xi[0], 1);
      test(-xi[Q - 1], 2);
    }
    else
    {
      test(-xi[Q - 1], 0);
      test(-xi[0], 1);
      test(xi[0] - 1, 2);
      test(xi[Q - 1] - 1, 3);
    }
    return worst;
  }
  double outside(const Vector<Q>& xi) const
  {
    int edge;
    return outside(xi, edge);
  }

  /// True if ξ leaves the facet across a physical end of the surface by more than `tolerance`.
  bool beyond_end(const Vector<Q>& xi, double tolerance) const
  {
    int edge = 0;
    return outside(xi, edge) > tolerance and is_end(edge);
  }

  bool is_end(int edge) const { return (_s.ends[_f] >> edge) & 1; }

  /// Direction of edge e in the reference facet, from its first to its second vertex.
  static Vector<Q> edge_direction(Shape shape, int e)
  {
    const auto v = reference_edge(shape, e);
    return vertex(shape, v[1]) - vertex(shape, v[0]);
  }

  static Vector<Q> vertex(Shape shape, int v)
  {
    return Eigen::Map<const Vector<Q>>(reference_vertex(shape, v));
  }

  /// Stationary point of ‖x − x²(ξ)‖, not clamped (F4); Newton from `xi`.
  /// @returns false if it left the neighbourhood of the facet or did not settle
  bool closest(const Vector<D>& x, Vector<Q>& xi) const
  {
    const bool affine = this->affine();
    double last = INFINITY;
    for (int it = 0; it < max_it; ++it)
    {
      const FacetPoint<D> p = at(xi, not affine);
      const Vector<D> r = x - p.x;
      const Eigen::Matrix<double, Q, Q> metric = p.tau.transpose() * p.tau;
      Eigen::Matrix<double, Q, Q> A = metric;
      if (not affine)
      {
        for (int a = 0; a < Q; ++a)
          for (int b = 0; b < Q; ++b)
            A(a, b) -= r.dot(p.d2(a, b));
        // far from the surface the exact Hessian may point uphill: then Gauss-Newton
        if (A(0, 0) <= 0 or A.determinant() <= 1e-3 * metric.determinant())
          A = metric;
      }
      const Vector<Q> dxi = A.inverse() * (p.tau.transpose() * r);
      if (not step(xi, dxi))
        return false;
      if (affine or settled(dxi, last))
        return true;
    }
    return false;
  }

  /// Intersection of the line x + s e with the facet's extension (F5); Newton from `xi`.
  bool intersect(const Vector<D>& x, const Vector<D>& e, Vector<Q>& xi, double& s) const
  {
    const bool affine = this->affine();
    double last = INFINITY;
    for (int it = 0; it < max_it; ++it)
    {
      const FacetPoint<D> p = at(xi, false);
      Eigen::Matrix<double, D, D> A;
      A << p.tau, -e;
      const double det = A.determinant(), size = p.tau.squaredNorm();
      if (std::abs(det) < 1e-8 * (D == 2 ? std::sqrt(size) : size))
        return false;
      const Vector<D> d = A.inverse() * (x - p.x);
      s = d[D - 1];
      const Vector<Q> dxi = d.template head<Q>();
      if (not step(xi, dxi))
        return false;
      if (affine or settled(dxi, last))
        return true;
    }
    return false;
  }

  /// Clamp to edge e (2D: its vertex): minimise ‖T_m (x − x²)‖ along it, T_m = I − m⊗m (F4c).
  /// @param m unit direction of the rule; zero for proximity
  /// @returns the minimum squared
  double clamp(const Vector<D>& x, const Vector<D>& m, int e, Target<D>& t) const
  {
    t.facet = _f;
    auto distance2 = [&](const Vector<D>& y)
    {
      const Vector<D> r = x - y;
      return (r - m.dot(r) * m).squaredNorm();
    };
    if constexpr (D == 2)
    {
      t.xi = vertex(_shape, e);
      t.clamp = Clamp::vertex;
      t.edge = static_cast<std::int8_t>(e);
      return distance2(at(t.xi, false).x);
    }
    else
    {
      const auto v = reference_edge(_shape, e);
      const Vector<Q> a = vertex(_shape, v[0]), E = vertex(_shape, v[1]) - a;
      const Curve curve = along(a, E);
      double eta = 0, least = distance2(curve.at(0));
      auto offer = [&](double t)
      {
        if (const double d2 = distance2(curve.at(t)); d2 < least)
        {
          least = d2;
          eta = t;
        }
      };
      offer(1);
      curve.orthogonal(x, m).roots(0, 1, offer);
      if (eta > 0 and eta < 1)
      {
        t.xi = a + eta * E;
        t.clamp = Clamp::edge;
        t.edge = static_cast<std::int8_t>(e);
      }
      else
      {
        t.edge = static_cast<std::int8_t>(eta <= 0 ? v[0] : v[1]);
        t.xi = vertex(_shape, t.edge);
        t.clamp = Clamp::vertex;
      }
      return distance2(at(t.xi, false).x);
    }
  }

  static Vector<Q> centre(Shape shape)
  {
    return Vector<Q>::Constant(shape == Shape::triangle ? 1.0 / 3 : 0.5);
  }

  /// A good place to start Newton from: the centre, or the nearest node of a curved facet.
  Vector<Q> start(const Vector<D>& x) const
  {
    const Vector<Q> centre = this->centre(_shape);
    if (_s.ref.position.degree() == 1)
      return centre;
    Vector<Q> best = centre;
    double d2 = (x - at(centre, false).x).squaredNorm();
    for (int v = 0; v < num_vertices(_shape); ++v)
    {
      const Vector<Q> xi = 0.5 * (centre + vertex(_shape, v));
      const double d2v = (x - at(xi, false).x).squaredNorm();
      if (d2v < d2)
      {
        d2 = d2v;
        best = xi;
      }
    }
    return best;
  }

  /// A line of constant direction in ξ, mapped to space: x₀ + x₁ t + x₂ t².
  struct Curve
  {
    Vector<D> x0, x1, x2;

    Vector<D> at(double t) const { return x0 + t * (x1 + t * x2); }

    /// (T_m (x − x²(t)))·∂_t x²: vanishes at the points nearest to x, seen along m.
    Cubic orthogonal(const Vector<D>& x, const Vector<D>& m) const
    {
      auto flat = [&](const Vector<D>& v) { return Vector<D>(v - m.dot(v) * m); };
      const Vector<D> r = flat(x - x0), a = flat(x1), b = flat(x2);
      return {{r.dot(a), 2 * r.dot(b) - a.dot(a), -3 * a.dot(b), -2 * b.dot(b)}};
    }
  };

  /// The curve ξ = a + t E: the whole facet in 2D, an edge in 3D.
  Curve along(const Vector<Q>& a, const Vector<Q>& E) const
  {
    const FacetPoint<D> p = at(a, not straight());
    Curve c{p.x, p.tau * E, Vector<D>::Zero()};
    if (not straight())
      for (int i = 0; i < Q; ++i)
        for (int j = 0; j < Q; ++j)
          c.x2 += 0.5 * E[i] * E[j] * p.d2(i, j);
    return c;
  }

private:
  static constexpr int max_it = 25;
  static constexpr double resolution = 1e-13;

  // ξ += Δξ, at most half a facet at a time, within [−1, 2]; affine facets take the step whole
  bool step(Vector<Q>& xi, const Vector<Q>& dxi) const
  {
    if (not dxi.allFinite())
      return false;
    if (affine())
    {
      xi += dxi;
      return true;
    }
    const double size = dxi.template lpNorm<Eigen::Infinity>();
    xi += size > 0.5 ? Vector<Q>(dxi * (0.5 / size)) : dxi;
    const Vector<Q> kept = xi.cwiseMax(-1.0).cwiseMin(2.0);
    const bool inside = kept == xi;
    xi = kept;
    return inside or size > resolution;
  }

  // Newton's method has done what round-off permits: far from the origin its steps stop shrinking
  // before they reach the resolution
  static bool settled(const Vector<Q>& dxi, double& last)
  {
    const double size = dxi.template lpNorm<Eigen::Infinity>();
    const bool done = size < resolution or (size < 1e-9 and size >= 0.5 * last);
    last = size;
    return done;
  }

  const Surface& _s;
  int _f;
  Shape _shape;
};

} // namespace dolfinx_contact
