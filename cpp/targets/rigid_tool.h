// SPDX-License-Identifier: MIT
//
// Rigid tools: masters without degrees of freedom, moved by a prescribed motion. The target is the
// closest point of the tool's surface, found in closed form.
#pragma once

#include "kinematics.h"

namespace dolfinx_contact
{

/// y = R Y + c, Y the place of a material point of the tool in its reference position.
template <int D>
struct RigidMotion
{
  Eigen::Matrix<double, D, D> R = Eigen::Matrix<double, D, D>::Identity(); ///< a rotation
  Vector<D> c = Vector<D>::Zero();

  /// Where the material point that was at y is after the motion `next`.
  Vector<D> carry(const Vector<D>& y, const RigidMotion& next) const
  {
    return next.R * (R.transpose() * (y - c)) + next.c;
  }
};

/// The half-space behind a plane.
template <int D>
struct RigidPlane
{
  Vector<D> point;   ///< of the plane, in the reference position
  Vector<D> outward; ///< unit normal away from the tool's material
  RigidMotion<D> now = {}, old = {};

  /// Normal, gap and closest point of a particle (no variations).
  void place(const Vector<D>& x1, Kinematics<D>& k) const
  {
    k.n = -(now.R * outward);
    k.gap = (x1 - (now.R * point + now.c)).dot(k.n);
    k.r = k.gap * k.n;
  }

  /// ⟦Δu⟧ (F11): x¹ less the place where the tool would have carried it since the last accepted
  /// step.
  Vector<D> slip(const Vector<D>& x1, const Vector<D>& x1_old) const
  {
    return x1 - old.carry(x1_old, now);
  }

  /// All variations, (F11) and (F12) with δn = 0: the unknowns do not move the tool, thus only
  /// ⟦δu⟧ = δu¹ counts.
  Kinematics<D> linearise(const Vector<D>& x1, const Vector<D>& x1_old) const
  {
    Kinematics<D> k;
    place(x1, k);
    return Kinematics<D>::fixed(k.n, k.gap, slip(x1, x1_old));
  }
};

} // namespace dolfinx_contact
