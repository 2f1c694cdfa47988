// SPDX-License-Identifier: MIT
//
// Friction where a particle turns far in a step, under the continuous law, and with a limit or a
// status that is held.
#include "pair.h"

#include <Eigen/SVD>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// A particle of one slave node with one multiplier and one friction node, its target and normal
/// held.
template <int D>
struct Particle
{
  static constexpr int Q = D - 1, row = D + 1; // the first one of friction
  static constexpr double one = 1;
  ContactLaw law{.rho_n = 2, .friction = 0.4, .rho_t = 1.3, .kappa = 0.9};
  double lambda = -1.5, gap = 0.2;
  Vector<D> n0 = Vector<D>::Unit(D - 1), n = n0, slip = Vector<D>::Zero();
  std::vector<Vector<D>> tangent; // of n0
  Vector<Q> at_node = Vector<Q>::Zero();

  Particle()
  {
    for (int i = 0; i < Q; ++i)
      tangent.push_back(Vector<D>::Unit(i));
  }

  Vector<D> Lambda() const
  {
    Vector<D> out = Vector<D>::Zero();
    for (int i = 0; i < Q; ++i)
      out += scales.friction * at_node[i] * tangent[i];
    return out;
  }

  CouplingBasis<D> basis() const
  {
    CouplingBasis<D> B;
    B.N = B.psi = B.phi = &one;
    B.tangent = tangent.data();
    B.slave = B.multiplier = B.friction = 1;
    return B;
  }

  Friction<D> friction() const
  {
    const double limit = law.continuous ? pressed(law, lambda, gap) : lambda;
    if (not rubs(law, closed(law, lambda, gap), limit))
      return {};
    return Friction<D>(law, limit, n0, n, Lambda(), slip);
  }

  PairVector<D> residual() const
  {
    const bool in_contact = closed(law, lambda, gap);
    const Friction<D> f = friction();
    PairVector<D> b = PairVector<D>::Zero(basis().size());
    const Vector<D> t
        = in_contact ? traction<D>(law, lambda, n, gap, f) : Vector<D>(Vector<D>::Zero());
    add_residual<D>(basis(), law, in_contact, lambda, gap, t, Lambda(), f, weight, scales, b);
    return b;
  }

  Eigen::MatrixXd derivative() const
  {
    PairMatrix<D> K = PairMatrix<D>::Zero(basis().size(), basis().size());
    add_closed_tangent<D, true>(basis(), law, lambda, Kinematics<D>::fixed(n, gap, slip),
                                FrictionTangent<D>(friction()), weight, scales, K);
    return K;
  }
};

/// The shortest rotation of n0 = e_D by an angle.
template <int D>
Eigen::Matrix<double, D, D> tilt(double angle)
{
  if constexpr (D == 2)
    return Eigen::Rotation2D<double>(angle).toRotationMatrix();
  else
    return Eigen::AngleAxis<double>(angle, Vector<3>(0.6, -0.8, 0)).toRotationMatrix();
}

Eigen::VectorXd singular_values(const Eigen::MatrixXd& A)
{
  return Eigen::JacobiSVD<Eigen::MatrixXd>(A).singularValues();
}

/// Ways to limit friction other than by λ, and to hold its status.
constexpr unsigned num_variants = 6;
template <int D>
void choose_variant(unsigned variant, Pair<D>& pair)
{
  const Scene<D>& s = pair.scene;
  pair.law.continuous = variant < 3;
  const double gap = s.placed(s.master, s.x1, s.e, s.target).gap,
               spent = -pair.law.friction / pair.law.rho_t * pair.limit(pair.U, gap);
  REQUIRE(spent > 0);
  pair.law.kappa = (variant == 0 ? 0.5 : 2) * spent; // nothing is left of it, or one half
  if (variant == 2 or variant == 3 or variant == 5)
    pair.threshold = 0.8 * pair.limit(pair.U, gap);
  if (variant >= 4)
    pair.held = pair.status == Status::stick; // it slips below 1, and sticks beyond 1
}

template <int D>
void compare_variants()
{
  std::array<int, num_variants> count{};
  unsigned next = 0;
  for (const Scene<D>& s : scenes<D>())
    for (Status status : {Status::stick, Status::slip})
      for (bool convected : {false, true})
      {
        const unsigned variant = next++ % num_variants;
        Pair<D> pair(s, false, status, true, convected);
        choose_variant<D>(variant, pair);
        const Eigen::MatrixXd fd = pair.differences(), K = pair.template derivative<true>();
        CAPTURE(s.text(), name(status), convected, variant, relative(K, fd));
        REQUIRE(relative(K, fd) <= 1e-8);

        const Kinematics<D> k = s.placed(s.master, s.x1, s.e, s.target);
        const Friction<D> f
            = pair.friction(pair.U, k.n, k.gap, pair.slip(s.master, s.x1, s.target.xi));
        REQUIRE((f.rest > 1e-3) == (variant == 1 or variant == 2));
        REQUIRE(f.p.norm()
                == Approx((status == Status::slip) != (variant >= 4) ? 1
                          : status == Status::stick                  ? 0.7
                                                                     : 1.8));
        const Eigen::MatrixXd with_lambda = K.block(pair.first_friction(), pair.multiplier(),
                                                    pair.tangent.size(), pair.psi.size());
        if (pair.threshold)
          REQUIRE(with_lambda.norm() == 0);
        else
          REQUIRE(with_lambda.norm() > 1e-3);

        // the same without (or with) what varies the limit, which differences must notice
        Pair<D> other = pair;
        if (not pair.threshold)
          other.threshold = pair.limit(pair.U, k.gap);
        else
          other.threshold.reset();
        REQUIRE(relative(other.template derivative<true>(), fd) > 1e-4);
        if (pair.held)
        {
          Pair<D> free = pair;
          free.held.reset();
          REQUIRE(relative(free.template derivative<true>(), fd) > 1e-4);
        }
        ++count[variant];
      }
  for (int c : count)
    REQUIRE(c > 10);
}

} // namespace

TEMPLATE_TEST_CASE_SIG("friction: a rotation changes neither the rank of (F3) nor anything else",
                       "", ((int D), D), 2, 3)
{
  // Tested with Λ* unturned, the rows of (F3) would vanish (2D) or lose their rank (3D) at 90°
  for (bool slips : {false, true})
  {
    Particle<D> before;
    before.at_node.setConstant(0.5);
    before.slip = (slips ? 3 : 0.2) * Vector<D>::Unit(0) + 0.1 * Vector<D>::Ones();
    const PairVector<D> b0 = before.residual();
    const Eigen::MatrixXd K0 = before.derivative();
    constexpr int Q = D - 1, row = Particle<D>::row;
    const Eigen::VectorXd with_u = singular_values(K0.block(row, 0, Q, D)),
                          with_Lambda = singular_values(K0.block(row, row, Q, Q));
    REQUIRE(before.friction().slips == slips);
    if (not slips)
      REQUIRE(with_u.minCoeff() > 0.1);
    else
      REQUIRE(with_Lambda.minCoeff() > 0.01);
    for (double degrees : {30.0, 90.0, 120.0, 170.0})
    {
      const Eigen::Matrix<double, D, D> R = tilt<D>(degrees * M_PI / 180);
      Particle<D> now = before;
      now.n = R * before.n;
      now.slip = R * before.slip;
      const Eigen::MatrixXd K = now.derivative();
      const double tol = 100 * eps / (1 + now.n.dot(now.n0)); // R is ill-conditioned at 180°
      CAPTURE(slips, degrees);
      REQUIRE((singular_values(K.block(row, 0, Q, D)) - with_u).norm() <= tol);
      REQUIRE((singular_values(K.block(row, row, Q, Q)) - with_Lambda).norm() <= tol);

      Eigen::MatrixXd turn = Eigen::MatrixXd::Identity(K.rows(), K.rows());
      turn.topLeftCorner(D, D) = R;
      REQUIRE((K - turn * K0 * turn.transpose()).norm() <= tol);
      REQUIRE((now.residual() - turn * b0).norm() <= tol);
    }
  }
}

TEMPLATE_TEST_CASE_SIG("friction: the continuous law does not jump where a particle opens", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(12);
  for (bool slips : {false, true})
    for (int i = 0; i < 10; ++i)
    {
      Particle<D> p;
      p.n = (p.n0 + uniform_vector<D>(random, -0.4, 0.4)).normalized();
      p.at_node = uniform_vector<D - 1>(random, 0.3, 0.6);
      p.slip = (slips ? 4 : 0.1) * beside<D>(p.n) * Vector<D>::Ones();
      auto at = [&](double pressure)
      {
        Particle<D> q = p;
        q.gap = (p.lambda + pressure) / p.law.rho_n; // g_n = −pressure
        return q;
      };
      // relative to the terms that a law without continuity has there
      auto jump = [&](const ContactLaw& law)
      {
        p.law = law;
        const Particle<D> closed = at(1e-13), open = at(-1e-13);
        REQUIRE(closed.friction().acts);
        REQUIRE(closed.friction().slips == slips);
        REQUIRE_FALSE(open.friction().acts);
        const PairVector<D> a = closed.residual(), b = open.residual();
        REQUIRE(b.tail(D - 1).norm() > 0.01);
        REQUIRE(std::abs(a[D] - b[D]) <= 1e-12 * std::abs(b[D]));
        return std::max((a - b).head(D).norm() / std::abs(p.lambda),
                        (a - b).tail(D - 1).norm() / b.tail(D - 1).norm());
      };
      const ContactLaw plain = p.law;
      ContactLaw augmented = plain, continuous = plain;
      augmented.augmented = true;
      continuous.continuous = true;
      CAPTURE(slips);
      REQUIRE(jump(continuous) <= 1e-12);
      REQUIRE(jump(plain) > 0.1);
      REQUIRE(jump(augmented) > 0.1);
    }
}

TEST_CASE("friction: the tangent of other laws, limits and statuses (2D)")
{
  compare_variants<2>();
}

TEST_CASE("friction: the tangent of other laws, limits and statuses (3D)")
{
  compare_variants<3>();
}
