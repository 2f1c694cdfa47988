// SPDX-License-Identifier: MIT
//
// Rigid tools: masters whose only unknown is their translation, if forces drive them. A tool is
// made of pieces, each with a surface and a motion of its own; the target of a particle is on the
// nearest piece (inside the material: on the one it is deepest in).
#pragma once

#include "rigid_mesh.h"
#include "rigid_shapes.h"

#include <memory>
#include <type_traits>
#include <variant>

namespace dolfinx_contact
{

/// y = R Y + c, Y the place of a material point of the tool in its reference position.
template <int D>
struct RigidMotion
{
  Eigen::Matrix<double, D, D> R = Eigen::Matrix<double, D, D>::Identity(); ///< a rotation
  Vector<D> c = Vector<D>::Zero();

  Vector<D> to(const Vector<D>& Y) const { return R * Y + c; }
  Vector<D> back(const Vector<D>& y) const { return R.transpose() * (y - c); }

  /// Where the material point that was at y is after the motion `next`.
  Vector<D> carry(const Vector<D>& y, const RigidMotion& next) const { return next.to(back(y)); }
};

/// A piece of a tool.
template <int D>
struct RigidPiece
{
  using Mesh = std::shared_ptr<const RigidMesh<D>>;
  using Shape = std::conditional_t<D == 2, std::variant<Plane<D>, Sphere<D>, Mesh>,
                                   std::variant<Plane<D>, Sphere<D>, Mesh, Cylinder, Torus>>;
  Shape shape;
  RigidMotion<D> now = {}, old = {}; ///< old: at the last accepted step

  /// Signed distance of a place in the tool's frame (shapes in closed form only).
  Distance<D> distance(const Vector<D>& X) const
  {
    return std::visit(
        [&](const auto& s) -> Distance<D>
        {
          if constexpr (std::is_same_v<std::decay_t<decltype(s)>, Mesh>)
            return {};
          else
            return s.at(X);
        },
        shape);
  }

  const RigidMesh<D>* mesh() const
  {
    const Mesh* m = std::get_if<Mesh>(&shape);
    return m ? m->get() : nullptr;
  }
};

/// Where a particle is against a tool.
template <int D>
struct RigidTarget
{
  int piece = -1;         ///< −1: no target
  Target<D> target;       ///< on a mesh; else only facet = 0
  double gap = -INFINITY; ///< d_n
  Vector<D> n = Vector<D>::Zero();
};

template <int D>
struct RigidTool
{
  std::vector<RigidPiece<D>> pieces;

  /// The target of a particle.
  /// @param outward unit outward normal of the slave: a surface that does not face it has no target
  /// @param radius farther points are no targets
  /// @param former piece and target of the last evaluation
  RigidTarget<D> find(const Vector<D>& x1, const Vector<D>& outward, double radius, int former,
                      const Target<D>& before) const
  {
    RigidTarget<D> best;
    for (int i = 0; i < static_cast<int>(pieces.size()); ++i)
    {
      const RigidPiece<D>& piece = pieces[i];
      const Vector<D> X = piece.now.back(x1), facing = piece.now.R.transpose() * outward;
      RigidTarget<D> t;
      if (const RigidMesh<D>* mesh = piece.mesh())
      {
        t.target = mesh->find(X, facing, i == former ? before : Target<D>());
        if (t.target.facet < 0)
          continue;
        const Kinematics<D> k = mesh->kinematics(X, t.target, false);
        t.gap = k.gap;
        t.n = k.n;
      }
      else
      {
        const Distance<D> d = piece.distance(X);
        t.target.facet = 0;
        t.gap = -d.d;
        t.n = -d.outward;
      }
      if (not(t.gap > best.gap and std::abs(t.gap) <= radius and t.n.dot(facing) >= 0))
        continue;
      t.piece = i;
      t.n = piece.now.R * t.n;
      best = t;
    }
    return best;
  }

  /// Place of a target of the particle at x1.
  Vector<D> point(int piece, const Target<D>& t, const Vector<D>& x1) const
  {
    const RigidPiece<D>& p = pieces[piece];
    if (const RigidMesh<D>* mesh = p.mesh())
      return p.now.to(mesh->at(t));
    const Distance<D> d = p.distance(p.now.back(x1));
    return x1 - d.d * (p.now.R * d.outward);
  }

  /// ⟦Δu⟧ (F11): x¹ less the place where the tool would have carried it since the last accepted
  /// step; on a curved surface, too, only its tangential part counts.
  Vector<D> slip(int piece, const Vector<D>& x1, const Vector<D>& x1_old) const
  {
    return x1 - pieces[piece].old.carry(x1_old, pieces[piece].now);
  }

  /// All variations. ⟦δu⟧ = δu¹ − δc, c the tool's translation; (F11) δ⟦Δu⟧ = ⟦δu⟧.
  Kinematics<D> linearise(int piece, const Target<D>& t, const Vector<D>& x1,
                          const Vector<D>& x1_old) const
  {
    const RigidPiece<D>& p = pieces[piece];
    const auto& R = p.now.R;
    const Vector<D> X = p.now.back(x1);
    Kinematics<D> k;
    if (const RigidMesh<D>* mesh = p.mesh())
    {
      const Kinematics<D> own = mesh->kinematics(X, t, true);
      k = Kinematics<D>::fixed(R * own.n, own.gap, slip(piece, x1, x1_old));
      k.r = R * own.r;
      k.z.gap.template leftCols<D>() = own.z.gap.template leftCols<D>() * R.transpose();
      k.z.n.template leftCols<D>() = R * own.z.n.template leftCols<D>() * R.transpose();
    }
    else
    {
      // (F12): x¹ − x² is along n, so that δn does not change the gap
      const Distance<D> d = p.distance(X);
      k = Kinematics<D>::fixed(-R * d.outward, -d.d, slip(piece, x1, x1_old));
      k.r = k.gap * k.n;
      k.z.n.template leftCols<D>() = -R * d.turning * R.transpose();
    }
    return k;
  }
};

} // namespace dolfinx_contact
