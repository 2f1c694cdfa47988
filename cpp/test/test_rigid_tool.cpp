// SPDX-License-Identifier: MIT
#include "../mechanics/coupling.h"
#include "../targets/rigid_tool.h"
#include "scenes.h"

#include <catch2/catch.hpp>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

template <int D>
RigidMotion<D> random_motion(std::mt19937& random)
{
  return {random_rotation<D>(random), uniform_vector<D>(random, -1, 1)};
}

template <int D>
RigidPlane<D> random_plane(std::mt19937& random)
{
  return {uniform_vector<D>(random, -1, 1), uniform_vector<D>(random, -1, 1).normalized(),
          random_motion<D>(random), random_motion<D>(random)};
}

/// A particle of a slave with two nodes, one multiplier and one friction node against a tool.
template <int D>
struct ToolPair
{
  static constexpr int Q = D - 1, size = 2 * D + 1 + Q;
  static constexpr double N[2] = {0.3, 0.7}, one = 1, phi = 0.8;
  static constexpr Scales scale{3.7, 0.6};
  RigidPlane<D> tool;
  ContactLaw law;
  std::vector<Vector<D>> tangent;
  Vector<D> x1, x1_old;
  Eigen::VectorXd U = Eigen::VectorXd::Zero(size); // increment of u, multiplier, friction

  /// @param rho_t slip if it is large, stick if it is small
  ToolPair(bool augmented, double rho_t, std::mt19937& random)
      : tool(random_plane<D>(random))
      , law{.rho_n = 2.3, .augmented = augmented, .friction = 0.4, .rho_t = rho_t}
      , tangent(random_tangents<D>(random))
      , x1(uniform_vector<D>(random, -1, 1))
      , x1_old(x1)
  {
    // about where the tool has carried it to
    x1 = tool.old.carry(x1_old, tool.now) + uniform_vector<D>(random, 0.1, 0.3);
    U[2 * D] = -0.5;
    for (int i = 0; i < Q; ++i)
      U[2 * D + 1 + i] = uniform(random, -0.5, 0.5);
  }

  CouplingBasis<D> basis() const
  {
    CouplingBasis<D> B;
    B.N = N;
    B.psi = &one;
    B.phi = &phi;
    B.tangent = tangent.data();
    B.slave = 2;
    B.multiplier = B.friction = 1;
    return B;
  }

  Vector<D> Lambda(const Eigen::VectorXd& V) const
  {
    Vector<D> out = Vector<D>::Zero();
    for (int i = 0; i < Q; ++i)
      out += scale.friction * phi * V[2 * D + 1 + i] * tangent[i];
    return out;
  }

  Kinematics<D> kinematics(const Eigen::VectorXd& V) const
  {
    return tool.linearise(x1 + N[0] * V.template head<D>() + N[1] * V.template segment<D>(D),
                          x1_old);
  }

  Friction<D> friction(const Eigen::VectorXd& V, const Kinematics<D>& k) const
  {
    return Friction<D>(law, scale.pressure * V[2 * D], before<D>(k.n), k.n, Lambda(V), k.slip);
  }

  PairVector<D> residual(const Eigen::VectorXd& V) const
  {
    const Kinematics<D> k = kinematics(V);
    const Friction<D> f = friction(V, k);
    const double lambda = scale.pressure * V[2 * D];
    PairVector<D> b = PairVector<D>::Zero(size);
    add_residual<D>(basis(), law, true, lambda, k.gap, traction<D>(law, lambda, k.n, k.gap, f),
                    Lambda(V), f, 0.37, scale, b);
    return b;
  }

  Eigen::MatrixXd derivative() const
  {
    const Kinematics<D> k = kinematics(U);
    PairMatrix<D> K = PairMatrix<D>::Zero(size, size);
    add_closed_tangent<D, true>(basis(), law, scale.pressure * U[2 * D], k,
                                FrictionTangent<D>(friction(U, k)), 0.37, scale, K);
    return K;
  }
};

} // namespace

TEST_CASE("RigidPlane: gaps by hand")
{
  // the half-space y < 1, then turned by 90 degrees and shifted: the half-space x > −1 + 3
  RigidPlane<2> tool{{5, 1}, {0, 1}};
  Kinematics<2> k;
  tool.place({0.3, 1.25}, k);
  REQUIRE(k.gap == -0.25); // open
  REQUIRE(k.n == Vector<2>(0, -1));
  REQUIRE(k.r == Vector<2>(0, 0.25));
  tool.place({-7, 0.5}, k);
  REQUIRE(k.gap == 0.5); // penetrates
  tool.now.R << 0, -1, 1, 0;
  tool.now.c << 3, 0;
  tool.place({2.5, 40}, k);
  REQUIRE(k.gap == 0.5);
  REQUIRE(k.n == Vector<2>(1, 0));
}

TEMPLATE_TEST_CASE_SIG("RigidPlane: the target is the closest point of the plane", "", ((int D), D),
                       2, 3)
{
  std::mt19937 random(2);
  for (int i = 0; i < 20; ++i)
  {
    const RigidPlane<D> tool = random_plane<D>(random);
    const Vector<D> x1 = uniform_vector<D>(random, -2, 2);
    Kinematics<D> k;
    tool.place(x1, k);
    // back in the reference position
    const Vector<D> X1 = tool.now.R.transpose() * (x1 - tool.now.c),
                    Y = tool.now.R.transpose() * (x1 - k.r - tool.now.c);
    REQUIRE(std::abs((Y - tool.point).dot(tool.outward)) <= 50 * eps);
    REQUIRE((X1 - Y + k.gap * tool.outward).norm() <= 50 * eps);
    REQUIRE(std::abs(k.n.norm() - 1) <= 20 * eps);
  }
}

TEMPLATE_TEST_CASE_SIG("RigidPlane: gap and slip move as differences say", "", ((int D), D), 2, 3)
{
  std::mt19937 random(3);
  const RigidPlane<D> tool = random_plane<D>(random);
  const Vector<D> x1 = uniform_vector<D>(random, -1, 1), x1_old = uniform_vector<D>(random, -1, 1);
  const Kinematics<D> k = tool.linearise(x1, x1_old);
  for (int i = 0; i < D; ++i)
  {
    // all of it is linear in x1: differences have no truncation, hence a large step
    const Vector<D> h = 0.5 * Vector<D>::Unit(i);
    const Kinematics<D> a = tool.linearise(x1 + h, x1_old), b = tool.linearise(x1 - h, x1_old);
    REQUIRE(std::abs(a.gap - b.gap - k.z.gap[i]) <= 20 * eps);
    REQUIRE((a.slip - b.slip - k.z.slip.col(i)).norm() <= 20 * eps);
    REQUIRE((a.n - b.n).norm() == 0);
  }
  // ∂_α δu² does not exist, and nothing else moves
  REQUIRE(k.z.gap.template tail<D*(D - 1)>().norm() == 0);
  REQUIRE(k.z.slip.template rightCols<D*(D - 1)>().norm() == 0);
  REQUIRE(k.z.xi.norm() + k.z.n.norm() + k.m.gap.norm() + k.e.gap.norm() == 0);
}

TEMPLATE_TEST_CASE_SIG("RigidPlane: no slip if the particle moves with the tool", "", ((int D), D),
                       2, 3)
{
  std::mt19937 random(4);
  for (int i = 0; i < 20; ++i)
  {
    const RigidPlane<D> tool = random_plane<D>(random);
    const Vector<D> X = uniform_vector<D>(random, -1, 1), slide = uniform_vector<D>(random, -1, 1),
                    x1 = tool.now.R * X + tool.now.c, x1_old = tool.old.R * X + tool.old.c;
    REQUIRE(tool.linearise(x1, x1_old).slip.norm() <= 20 * eps);
    REQUIRE((tool.linearise(x1 + slide, x1_old).slip - slide).norm() <= 20 * eps);
  }
}

TEMPLATE_TEST_CASE_SIG("RigidPlane: a particle's tangent is the derivative of its residual", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(5);
  for (bool augmented : {false, true})
    for (double rho_t : {0.05, 20.0})
    {
      const ToolPair<D> pair(augmented, rho_t, random);
      Eigen::MatrixXd fd(pair.size, pair.size);
      for (int j = 0; j < pair.size; ++j)
        fd.col(j)
            = central([&](double h)
                      { return pair.residual(pair.U + h * Eigen::VectorXd::Unit(pair.size, j)); });
      CAPTURE(augmented, rho_t);
      REQUIRE(pair.friction(pair.U, pair.kinematics(pair.U)).slips == (rho_t > 1));
      REQUIRE(fd.norm() > 0.1);
      REQUIRE(relative(pair.derivative(), fd) <= 1e-8);
    }
}
