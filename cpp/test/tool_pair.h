// SPDX-License-Identifier: MIT
//
// One particle against a rigid tool, for the unknowns of the slave and of the tool's translation.
#pragma once

#include "../targets/rigid_tool.h"
#include "pair.h"

namespace dolfinx_contact::test
{

template <int D>
RigidMotion<D> random_motion(std::mt19937& random)
{
  return {random_rotation<D>(random), uniform_vector<D>(random, -1, 1)};
}

/// Differences of gap, n and point have errors of about 1e-11 from the step and, on meshes, of the
/// target's accuracy over the step.
constexpr double tool_tol = 1e-7;

/// A tool, a particle of a slave with two nodes, one multiplier and one friction node; the tool's
/// translation is a master with one node.
template <int D>
struct ToolPair
{
  static constexpr int Q = D - 1, translation = 2 * D + 1 + Q, size = translation + D;
  static constexpr double N[2] = {0.3, 0.7}, one = 1, phi = 0.8;
  RigidTool<D> tool;
  Vector<D> x1, outward, x1_old;
  RigidTarget<D> found;
  ContactLaw law = {.rho_n = 2.3, .friction = 0.4};
  std::vector<Vector<D>> tangent;
  Eigen::VectorXd U = Eigen::VectorXd::Zero(size); // increments, multiplier and friction

  /// @param x1 a particle that has a target; the slave faces the tool there
  ToolPair(const RigidTool<D>& tool, const Vector<D>& x1, const Vector<D>& outward,
           std::mt19937& random)
      : tool(tool)
      , x1(x1)
      , outward(outward)
      , found(tool.find(x1, outward, 10, -1, {}))
      , tangent(random_tangents<D>(random))
  {
    if (found.piece < 0)
      return;
    // 0.1 to 0.3 from where the tool would have carried it
    const RigidPiece<D>& piece = tool.pieces[found.piece];
    x1_old = piece.now.carry(x1 + uniform_vector<D>(random, 0.1, 0.3), piece.old);
    U[2 * D] = -0.5;
    for (int i = 0; i < Q; ++i)
      U[2 * D + 1 + i] = uniform(random, -0.5, 0.5);
    const double share = (beside<D>(found.n) * turned()).norm();
    U.segment(2 * D + 1, Q) *= 0.4 / share;
  }

  Vector<D> turned() const
  {
    return dolfinx_contact::turned<D>(before<D>(found.n), found.n, Lambda(U));
  }

  Vector<D> slip() const { return tool.slip(found.piece, x1, x1_old); }

  /// All pieces moved by the increment of the translation.
  RigidTool<D> moved(const Vector<D>& dc) const
  {
    RigidTool<D> t = tool;
    for (RigidPiece<D>& p : t.pieces)
      p.now.c += dc;
    return t;
  }

  /// Does it slide, and has it the same piece and facet after small motions of it and the tool?
  bool regular() const
  {
    if ((beside<D>(found.n) * slip()).norm() < 0.05)
      return false;
    for (int i = 0; i < D; ++i)
      for (double h : {-3 * step, 3 * step})
        for (const RigidTool<D>& t : {tool, moved(h * Vector<D>::Unit(i))})
        {
          const RigidTarget<D> f
              = t.find(x1 + h * Vector<D>::Unit(i), outward, 10, found.piece, found.target);
          if (f.piece != found.piece or f.target.facet != found.target.facet
              or f.target.clamp != found.target.clamp)
            return false;
        }
    return true;
  }

  CouplingBasis<D> basis() const
  {
    static const BasisValues rigid = {.N = {1}, .dN = {}, .ddN = {}};
    CouplingBasis<D> B;
    B.N = N;
    B.psi = &one;
    B.phi = &phi;
    B.tangent = tangent.data();
    B.M = &rigid;
    B.slave = 2;
    B.multiplier = B.friction = B.master = 1;
    return B;
  }

  Vector<D> Lambda(const Eigen::VectorXd& V) const
  {
    Vector<D> out = Vector<D>::Zero();
    for (int i = 0; i < Q; ++i)
      out += scales.friction * phi * V[2 * D + 1 + i] * tangent[i];
    return out;
  }

  Kinematics<D> kinematics(const Eigen::VectorXd& V) const
  {
    const RigidTool<D> t = moved(V.template tail<D>());
    const Vector<D> x = x1 + N[0] * V.template head<D>() + N[1] * V.template segment<D>(D);
    const RigidTarget<D> f = t.find(x, outward, 10, found.piece, found.target);
    Kinematics<D> k = t.linearise(f.piece, f.target, x, x1_old);
    k.n = f.n; // what the search says counts
    k.gap = f.gap;
    return k;
  }

  Friction<D> friction(const Eigen::VectorXd& V, const Kinematics<D>& k) const
  {
    return Friction<D>(law, scales.pressure * V[2 * D], before<D>(found.n), k.n, Lambda(V), k.slip);
  }

  PairVector<D> residual(const Eigen::VectorXd& V) const
  {
    const Kinematics<D> k = kinematics(V);
    const Friction<D> f = friction(V, k);
    const double lambda = scales.pressure * V[2 * D];
    PairVector<D> b = PairVector<D>::Zero(size);
    add_residual<D>(basis(), law, true, lambda, k.gap, traction<D>(law, lambda, k.n, k.gap, f),
                    Lambda(V), f, weight, scales, b);
    return b;
  }

  Eigen::MatrixXd differences() const
  {
    Eigen::MatrixXd fd(size, size);
    for (int j = 0; j < size; ++j)
      fd.col(j)
          = central([&](double h) { return residual(U + h * Eigen::VectorXd::Unit(size, j)); });
    return fd;
  }

  Eigen::MatrixXd derivative() const
  {
    const Kinematics<D> k = kinematics(U);
    PairMatrix<D> K = PairMatrix<D>::Zero(size, size);
    add_closed_tangent<D, true>(basis(), law, scales.pressure * U[2 * D], k,
                                FrictionTangent<D>(friction(U, k)), weight, scales, K);
    return K;
  }

  /// All that a particle's derivatives have to satisfy.
  void check()
  {
    // what the search finds is what is linearised, and the target is along n
    const Kinematics<D> k = tool.linearise(found.piece, found.target, x1, x1_old);
    REQUIRE(k.gap == Approx(found.gap).margin(1e-13));
    REQUIRE((k.n - found.n).norm() <= 50 * eps);
    REQUIRE(std::abs(k.n.norm() - 1) <= 20 * eps);
    const Vector<D> y = tool.point(found.piece, found.target, x1);
    REQUIRE((k.r - (x1 - y)).norm() <= 50 * eps);

    // gap, n and slip with x¹, and with −c; here c moves the particle's own target
    for (int i = 0; i < D; ++i)
      for (bool particle : {true, false})
      {
        const double sign = particle ? 1 : -1;
        const Eigen::VectorXd e = Eigen::VectorXd::Unit(size, particle ? i : translation + i);
        auto derivative = [&](auto value)
        { return central([&](double h) { return value(kinematics(U + h * e)); }); };
        // node 0 moves the particle by N_0
        const double by = particle ? N[0] : 1;
        const auto gap
            = derivative([](const Kinematics<D>& k) { return Eigen::Matrix<double, 1, 1>(k.gap); });
        REQUIRE(std::abs(gap[0] - sign * by * k.z.gap[i]) <= tool_tol);
        const Vector<D> n = derivative([](const Kinematics<D>& k) { return k.n; });
        REQUIRE((n - sign * by * k.z.n.col(i)).norm() <= tool_tol * (1 + k.z.n.norm()));
        const Vector<D> slip = derivative([](const Kinematics<D>& k) { return k.slip; });
        REQUIRE((slip - sign * by * k.z.slip.col(i)).norm() <= tool_tol);
      }

    // the whole tangent, stick and slip
    for (bool augmented : {false, true})
      for (Status status : {Status::stick, Status::slip})
      {
        law.augmented = augmented;
        law.rho_t = choose_rho<D>(found.n, turned(), slip(), status);
        CAPTURE(augmented, name(status));
        REQUIRE(friction(U, kinematics(U)).slips == (status == Status::slip));
        const Eigen::MatrixXd fd = differences(), K = derivative();
        REQUIRE(fd.norm() > 0.1);
        REQUIRE(relative(K, fd) <= tool_tol);
        // the tool takes what the slave gives: rows of c are minus the sum of those of the nodes
        const Eigen::MatrixXd sum = K.topRows(D) + K.middleRows(D, D) + K.bottomRows(D);
        REQUIRE(sum.norm() <= 100 * eps * K.norm());
      }
  }
};

} // namespace dolfinx_contact::test
