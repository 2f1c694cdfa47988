// SPDX-License-Identifier: MIT
//
// Interpolated normals (F8) at a target, and the slip of a particle there with its first
// derivatives for (F11).
#pragma once

#include "../geometry/normals.h"
#include "../geometry/surface.h"

#include <Eigen/LU>
#include <array>

namespace dolfinx_contact
{

/// n̄ = M/‖M‖ at a point of a facet, and how it varies.
template <int D>
struct InterpolatedNormal
{
  Vector<D> n = Vector<D>::Zero();
  Eigen::Matrix<double, D, D - 1> dn = Eigen::Matrix<double, D, D - 1>::Zero(); ///< ∂_α n̄
  Eigen::Matrix<double, D, D> of_m
      = Eigen::Matrix<double, D, D>::Zero(); ///< δn̄ at fixed ξ: (I − n̄⊗n̄)/‖M‖ m

  InterpolatedNormal() = default;
  explicit InterpolatedNormal(const NormalField<D>& field)
  {
    const double length = field.M.norm();
    n = field.M / length;
    of_m = (Eigen::Matrix<double, D, D>::Identity() - n * n.transpose()) / length;
    dn = of_m * field.dM;
  }
};

/// The slip ⟦Δu⟧ of a particle since the last accepted step ("old"), and its first derivatives.
template <int D>
struct Slip
{
  static constexpr int Q = D - 1;
  using Matrix = Eigen::Matrix<double, D, D>;
  Vector<D> value = Vector<D>::Zero();
  Matrix jump = Matrix::Zero();                                         ///< with ⟦u⟧
  Matrix old = Matrix::Zero();                                          ///< with x¹_old
  Matrix normal = Matrix::Zero();                                       ///< with n̄ at fixed ξ
  std::array<Matrix, Q> gradient;                                       ///< with ∂_α u²
  Eigen::Matrix<double, D, Q> xi = Eigen::Matrix<double, D, Q>::Zero(); ///< with ξ

  /// Convected: ⟦Δu⟧ = τ_α (c^α − c^α_old), c^α = τ^α·(x¹ − x²) and c^α_old likewise in the old
  /// configuration, at the same target. A rigid motion changes neither, whatever the normals and
  /// also at a clamped target; where x¹ − x² is normal to the facet, c^α = 0 and this is the
  /// measure of the formulation, section 6.
  /// @param p, old the target now and in the old configuration, both with curvature
  /// @param r, r_old x¹ − x² now and in the old configuration
  static Slip convected(const FacetPoint<D>& p, const FacetPoint<D>& old, const Vector<D>& r,
                        const Vector<D>& r_old)
  {
    return difference(p, Tangential(p, r), Tangential(old, r_old));
  }

  /// As `convected`, for interpolated normals: c^α of x¹ − x² = τ_α c^α + d n̄. Where facets meet at
  /// an angle, τ jumps but n̄ does not: along n̄, a particle that a gap parts from the master has
  /// the slip of its target from both sides, while τ^α·(x¹ − x²) differs by the gap times the
  /// angle.
  /// @param now, then n̄ at the target, now and in the old configuration
  static Slip convected(const FacetPoint<D>& p, const FacetPoint<D>& old, const Vector<D>& r,
                        const Vector<D>& r_old, const InterpolatedNormal<D>& now,
                        const InterpolatedNormal<D>& then)
  {
    const Oblique at(p, r, now);
    Slip s = difference(p, at, Oblique(old, r_old, then));
    s.normal = -at.d * s.jump;
    return s;
  }

  /// The paper's measure, ⟦Δu⟧ = Δu¹(X) − Δu²(Ȳ).
  static Slip increment(const FacetPoint<D>& p, const FacetPoint<D>& old, const Vector<D>& r,
                        const Vector<D>& r_old)
  {
    Slip s;
    s.value = r - r_old;
    s.jump.setIdentity();
    s.old = -Matrix::Identity();
    s.gradient.fill(Matrix::Zero());
    s.xi = old.tau - p.tau;
    return s;
  }

private:
  using Rows = Eigen::Matrix<double, Q, D>;

  // ∂_b τ_a, columns a
  static Eigen::Matrix<double, D, Q> bend(const FacetPoint<D>& p, int b)
  {
    Eigen::Matrix<double, D, Q> out;
    for (int a = 0; a < Q; ++a)
      out.col(a) = p.d2(a, b);
    return out;
  }

  // c = (τᵀτ)⁻¹ τᵀ r
  struct Tangential
  {
    const FacetPoint<D>& p;
    Eigen::Matrix<double, Q, Q> inverse; // of the metric
    Rows of_r;                           // ∂c/∂r
    Vector<Q> c;
    Vector<D> rest; // r − τ c

    Tangential(const FacetPoint<D>& p, const Vector<D>& r)
        : p(p)
        , inverse((p.tau.transpose() * p.tau).inverse())
        , of_r(inverse * p.tau.transpose())
        , c(of_r * r)
        , rest(r - p.tau * c)
    {
    }

    // ∂c/∂τ_a at fixed r
    Rows with_tau(int a) const { return inverse.col(a) * rest.transpose() - c[a] * of_r; }

    // ∂c/∂ξ^b, with ∂_b r = −τ_b
    Vector<Q> with_xi(int b) const
    {
      const Eigen::Matrix<double, D, Q> dtau = bend(p, b);
      return inverse * (dtau.transpose() * rest) - of_r * (dtau * c) - Vector<Q>::Unit(b);
    }
  };

  // c and d of r = τ_α c^α + d n̄
  struct Oblique
  {
    const FacetPoint<D>& p;
    const InterpolatedNormal<D>& normal;
    Rows of_r; // ∂c/∂r
    Vector<Q> c;
    double d;

    Oblique(const FacetPoint<D>& p, const Vector<D>& r, const InterpolatedNormal<D>& normal)
        : p(p)
        , normal(normal)
    {
      Matrix A;
      A << p.tau, normal.n;
      const Matrix inverse = A.inverse();
      of_r = inverse.template topRows<Q>();
      c = of_r * r;
      d = inverse.row(Q) * r;
    }

    Rows with_tau(int a) const { return -c[a] * of_r; }

    Vector<Q> with_xi(int b) const
    {
      return -of_r * (bend(p, b) * c + d * normal.dn.col(b)) - Vector<Q>::Unit(b);
    }
  };

  template <typename Coefficients>
  static Slip difference(const FacetPoint<D>& p, const Coefficients& now, const Coefficients& then)
  {
    const Vector<Q> c = now.c - then.c;
    Slip s;
    s.value = p.tau * c;
    s.jump = p.tau * now.of_r;
    s.old = -p.tau * then.of_r;
    for (int a = 0; a < Q; ++a)
      s.gradient[a] = c[a] * Matrix::Identity() + p.tau * now.with_tau(a);
    for (int b = 0; b < Q; ++b)
      s.xi.col(b) = bend(p, b) * c + p.tau * (now.with_xi(b) - then.with_xi(b));
    return s;
  }
};

} // namespace dolfinx_contact
