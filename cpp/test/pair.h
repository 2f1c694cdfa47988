// SPDX-License-Identifier: MIT
//
// One particle's residual and tangent for all unknowns of a pair of facets.
#pragma once

#include "../mechanics/coupling.h"
#include "scenes.h"

#include <catch2/catch.hpp>

namespace dolfinx_contact::test
{

constexpr double weight = 0.37; ///< of the particle
constexpr Scales scales{3.7, 0.6};

/// What a particle does.
enum class Status
{
  open,
  closed, ///< without friction, or with too little pressure for it
  stick,
  slip
};

inline std::string name(Status s)
{
  constexpr const char* text[] = {"open", "closed", "stick", "slip"};
  return text[static_cast<int>(s)];
}

/// A tangent K without one term: where the term matters, differences must notice that it is
/// missing; elsewhere it is zero.
/// @param full, fd with the term, and by differences
/// @param least relative error that counts as noticed
/// @returns whether it matters
inline bool compare_without(unsigned term, const Eigen::MatrixXd& K, const Eigen::MatrixXd& full,
                            const Eigen::MatrixXd& fd, bool matters, double least = 1e-4)
{
  CAPTURE(term, relative(K, fd), relative(K, full));
  if (matters)
    REQUIRE(relative(K, fd) > least);
  else
    REQUIRE(relative(K, full) <= 1e-12); // zero up to the target's accuracy
  return matters;
}

/// ρ_τ for which ‖T(Λ + ρ_τ s)‖ is 0.7 (stick) or 1.8 (slip), where ‖TΛ‖ is less.
template <int D>
double choose_rho(const Vector<D>& n, const Vector<D>& Lambda, const Vector<D>& s, Status status)
{
  const double size = status == Status::slip ? 1.8 : 0.7;
  const Vector<D> a = beside<D>(n) * Lambda, b = beside<D>(n) * s;
  const double ab = a.dot(b), bb = b.squaredNorm();
  return (std::sqrt(ab * ab + bb * (size * size - a.squaredNorm())) - ab) / bb;
}

/// A pair: the scene's master facet and a slave facet of the same kind, whose particle is x1.
template <int D>
struct Pair
{
  static constexpr int Q = D - 1;
  const Scene<D>& scene;
  Vector<D> n0 = Vector<D>::Zero(); ///< see turned()
  Status status;
  bool convected; ///< measure of the slip
  ContactLaw law;
  std::optional<double> threshold; ///< frozen
  std::optional<bool> held;        ///< status of friction: true if it slips
  std::vector<double> N, psi, phi; // slave, multiplier and friction bases at the particle
  std::vector<Vector<D>> tangent;
  Eigen::VectorXd U; // slave u, multiplier and friction in their scales, master u, e if it turns

  /// @param friction with friction unknowns
  Pair(const Scene<D>& s, bool augmented, Status status, bool friction = false,
       bool convected = true)
      : scene(s)
      , status(status)
      , convected(convected)
      , law{.rho_n = 2.3,
            .augmented = augmented,
            .friction = friction ? 0.4 : 0,
            .kappa = 0.9,
            .least = rubs() ? 0.0 : 100.0}
      , N(s.master.nu())
  {
    // displacement and multiplier by the same basis, at a point that favours no node
    const double xi[2] = {0.21, 0.37}, other[2] = {0.44, 0.17};
    s.master.ref.displacement.values(xi, N.data());
    psi = N;
    std::mt19937 random(5), for_tangents(6); // the rest of U is the same without friction
    if (friction)
    {
      phi.resize(N.size());
      s.master.ref.displacement.values(other, phi.data());
    }
    for (std::size_t a = 0; a < phi.size(); ++a)
      for (const Vector<D>& t : random_tangents<D>(for_tangents))
        tangent.push_back(t);
    U.resize(columns());
    for (double& v : U)
      v = uniform(random, -0.2, 0.2);
    U.segment(multiplier(), psi.size()).array() -= 0.5; // λ near −1.9
    for (int a = 0; closed() and a < s.master.nu(); ++a)
      for (int i = 0; i < D; ++i)
        U[master() + a * D + i] = s.u[s.master.local[a] * D + i];
    U.tail(columns() - size()).setZero(); // e is the scene's
    if (rubs())
    {
      const Kinematics<D> k = s.placed(s.master, s.x1, s.e, s.target);
      n0 = before<D>(k.n);
      auto turned = [&] { return dolfinx_contact::turned<D>(n0, k.n, Lambda(U)); };
      const double share = (beside<D>(k.n) * turned()).norm();
      U.segment(first_friction(), tangent.size()) *= 0.4 / share;
      law.rho_t = choose_rho<D>(k.n, turned(), slip(s.master, s.x1, s.target.xi), status);
    }
  }

  bool closed() const { return status != Status::open; }
  bool rubs() const { return status == Status::stick or status == Status::slip; }
  bool turns() const { return closed() and scene.rules.turning; }

  int multiplier() const { return static_cast<int>(N.size()) * D; }
  int first_friction() const { return multiplier() + static_cast<int>(psi.size()); }
  int master() const { return first_friction() + static_cast<int>(tangent.size()); }
  int size() const { return closed() ? master() + scene.master.nu() * D : master(); }
  int columns() const { return turns() ? size() + D : size(); }

  double lambda(const Eigen::VectorXd& V) const
  {
    return scales.pressure
           * Eigen::Map<const Eigen::VectorXd>(psi.data(), psi.size())
                 .dot(V.segment(multiplier(), psi.size()));
  }

  Vector<D> Lambda(const Eigen::VectorXd& V) const
  {
    Vector<D> out = Vector<D>::Zero();
    for (std::size_t a = 0; a < tangent.size(); ++a)
      out += scales.friction * phi[a / Q] * V[first_friction() + a] * tangent[a];
    return out;
  }

  Vector<D> slip(const Surface& m, const Vector<D>& x, const Vector<Q>& xi) const
  {
    return slip_of<D>(m, 0, xi, x, scene.x1_old, convected);
  }

  /// What limits friction.
  double limit(const Eigen::VectorXd& V, double gap) const
  {
    return threshold.value_or(law.continuous ? pressed(law, lambda(V), gap) : lambda(V));
  }

  Friction<D> friction(const Eigen::VectorXd& V, const Vector<D>& n, double gap,
                       const Vector<D>& slip) const
  {
    if (not rubs())
      return {};
    Friction<D> f(law, limit(V, gap), n0, n, Lambda(V), slip, held);
    f.frozen = threshold.has_value();
    return f;
  }

  CouplingBasis<D> basis(const BasisValues& M) const
  {
    CouplingBasis<D> B;
    B.N = N.data();
    B.psi = psi.data();
    B.phi = phi.data();
    B.tangent = tangent.data();
    B.slave = static_cast<int>(N.size());
    B.multiplier = static_cast<int>(psi.size());
    B.friction = static_cast<int>(phi.size());
    if (closed())
    {
      B.M = &M;
      B.master = scene.master.nu();
    }
    return B;
  }

  PairVector<D> residual(const Eigen::VectorXd& V) const
  {
    Vector<D> x = scene.x1, t = Vector<D>::Zero();
    double gap = -INFINITY;
    Friction<D> f;
    BasisValues M{};
    if (closed())
    {
      for (std::size_t a = 0; a < N.size(); ++a)
        x += N[a] * (V - U).template segment<D>(a * D);
      Surface m = scene.master;
      std::vector<double> u = scene.u;
      for (int a = 0; a < m.nu(); ++a)
        for (int i = 0; i < D; ++i)
          u[m.local[a] * D + i] = V[master() + a * D + i];
      m.displace(u);
      const Vector<D> e
          = turns() ? Vector<D>((scene.e + V.template tail<D>()).normalized()) : scene.e;
      Target<D> target;
      if (not scene.solve(m, x, e, target))
        throw std::logic_error("the target was lost: " + scene.text());
      const Kinematics<D> k = scene.placed(m, x, e, target);
      gap = k.gap;
      f = friction(V, k.n, gap, slip(m, x, target.xi));
      t = traction<D>(law, lambda(V), k.n, gap, f);
      m.ref.displacement.tabulate(target.xi.data(), M);
    }
    PairVector<D> b = PairVector<D>::Zero(size());
    add_residual<D>(basis(M), law, closed(), lambda(V), gap, t, Lambda(V), f, weight, scales, b);
    return b;
  }

  Eigen::MatrixXd differences() const
  {
    Eigen::MatrixXd K(size(), columns());
    for (int j = 0; j < columns(); ++j)
      K.col(j) = central([&](double h)
                         { return residual(U + h * Eigen::VectorXd::Unit(columns(), j)); });
    return K;
  }

  /// The library's tangent.
  /// @tparam F with friction unknowns
  template <bool F, unsigned Drop = all_terms>
  Eigen::MatrixXd derivative() const
  {
    PairMatrix<D> K = PairMatrix<D>::Zero(size(), size());
    BasisValues M{};
    if (not closed())
    {
      add_open_tangent<D, Drop>(basis(M), law, weight, scales, K);
      return K;
    }
    scene.master.ref.displacement.tabulate(scene.target.xi.data(), M);
    const Kinematics<D> k = scene.template linearised<Drop>(convected);
    const FrictionTangent<D> f(friction(U, k.n, k.gap, k.slip));
    add_closed_tangent<D, F, Drop>(basis(M), law, lambda(U), k, f, weight, scales, K);
    Eigen::MatrixXd out(size(), columns());
    out.leftCols(size()) = K;
    if (turns())
      out.rightCols(D)
          = field_columns<D, F, Drop>(basis(M), law, lambda(U), k, k.e, f, weight, scales)
            * beside<D>(scene.e);
    return out;
  }
};

} // namespace dolfinx_contact::test
