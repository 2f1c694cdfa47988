// SPDX-License-Identifier: MIT
//
// One particle's tangent against differences of its residual, for all unknowns of the pair; and
// the same with one term left out at a time, which the differences must notice.
#include "../mechanics/coupling.h"
#include "facets.h"

#include <catch2/catch.hpp>
#include <utility>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double tol = 1e-8; // truncation and round-off of `central`, relative: 2e-9 was seen
constexpr double weight = 0.37, scale = 3.7;
constexpr unsigned num_terms = 13; // those of interpolated normals are in test_normals.cpp
static_assert(last_term == 1u << (num_terms + 5), "test the new terms too");

/// A pair: the scene's master facet and a slave facet of the same kind, whose particle is x1.
template <int D>
struct Pair
{
  const Scene<D>& scene;
  ContactLaw law;
  bool closed;
  std::vector<double> N, psi; // slave and multiplier bases at the particle
  Eigen::VectorXd U;          // slave u, multiplier / scale, master u

  Pair(const Scene<D>& s, bool augmented, bool closed)
      : scene(s)
      , law{2.3, augmented}
      , closed(closed)
      , N(s.master.nu())
      , psi(N.size())
  {
    // displacement and multiplier by the same basis, at a point that favours no node
    const double xi[2] = {0.21, 0.37};
    s.master.ref.displacement.values(xi, N.data());
    psi = N;
    std::mt19937 random(5);
    U.resize(size());
    for (double& v : U)
      v = uniform(random, -0.2, 0.2);
    U.segment(multiplier(), psi.size()).array() -= 0.5; // λ near −1.9
    for (int a = 0; closed and a < s.master.nu(); ++a)
      for (int i = 0; i < D; ++i)
        U[master() + a * D + i] = s.u[s.master.local[a] * D + i];
  }

  int multiplier() const { return static_cast<int>(N.size()) * D; }
  int master() const { return multiplier() + static_cast<int>(psi.size()); }
  int size() const { return closed ? master() + scene.master.nu() * D : master(); }

  double lambda(const Eigen::VectorXd& V) const
  {
    return scale
           * Eigen::Map<const Eigen::VectorXd>(psi.data(), psi.size())
                 .dot(V.segment(multiplier(), psi.size()));
  }

  CouplingBasis basis(const BasisValues& M) const
  {
    CouplingBasis B;
    B.N = N.data();
    B.psi = psi.data();
    B.slave = static_cast<int>(N.size());
    B.multiplier = static_cast<int>(psi.size());
    if (closed)
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
    BasisValues M{};
    if (closed)
    {
      for (std::size_t a = 0; a < N.size(); ++a)
        x += N[a] * (V - U).template segment<D>(a * D);
      Surface m = scene.master;
      std::vector<double> u = scene.u;
      for (int a = 0; a < m.nu(); ++a)
        for (int i = 0; i < D; ++i)
          u[m.local[a] * D + i] = V[master() + a * D + i];
      m.displace(u);
      Target<D> target;
      if (not scene.solve(m, x, target))
        throw std::logic_error("the target was lost: " + scene.text());
      Kinematics<D> k;
      place<D>(m, target, x, FacetProjection<D>(m, 0).at(target.xi, false), scene.normals, scene.e,
               k);
      gap = k.gap;
      t = traction<D>(law, true, lambda(V), k.n, gap);
      m.ref.displacement.tabulate(target.xi.data(), M);
    }
    PairVector<D> b = PairVector<D>::Zero(size());
    add_residual<D>(basis(M), law, closed, lambda(V), gap, t, weight, scale, b);
    return b;
  }

  Eigen::MatrixXd differences() const
  {
    Eigen::MatrixXd K(size(), size());
    for (int j = 0; j < size(); ++j)
      K.col(j)
          = central([&](double h) { return residual(U + h * Eigen::VectorXd::Unit(size(), j)); });
    return K;
  }

  template <unsigned Drop = all_terms>
  Eigen::MatrixXd tangent() const
  {
    PairMatrix<D> K = PairMatrix<D>::Zero(size(), size());
    BasisValues P, M{};
    if (not closed)
      add_open_tangent<D, Drop>(basis(M), law, weight, scale, K);
    else
    {
      const Surface& m = scene.master;
      const double* xi = scene.target.xi.data();
      m.ref.position.tabulate(xi, P, true);
      m.ref.displacement.tabulate(xi, M);
      const Kinematics<D> k = linearise<D, Drop>(m, scene.target, scene.x1,
                                                 evaluate<D>(m.facet_x(0), m.np(), P, true),
                                                 scene.rule, scene.normals, scene.e);
      const Traction<D> t = linearised_traction<D, Drop>(law, lambda(U), k);
      add_closed_tangent<D, Drop>(basis(M), k, t, weight, scale, K);
    }
    return K;
  }
};

double relative(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
  return (a - b).norm() / b.norm();
}

/// Where a term must be felt; elsewhere it is zero.
template <int D>
bool matters(unsigned term, const Pair<D>& pair)
{
  const Scene<D>& s = pair.scene;
  const bool proximity = s.rule == TargetRule::proximity, facet = s.normals == NormalRule::facet;
  const bool vertex = s.target.clamp == Clamp::vertex, edge = s.target.clamp == Clamp::edge;
  if (not pair.closed)
    return term == open_row;
  switch (term)
  {
  case target_curvature:
    return proximity and s.free() and s.curved();
  case target_gradient:
    return proximity and s.free();
  case edge_curvature:
    return edge and s.element.position == 2;
  case edge_gradient:
    return edge;
  case normal_gradient:
  case traction_turning:
    return facet;
  case normal_curvature:
    return facet and not vertex and s.curved();
  case gap_sliding:
    return not facet and not vertex; // facet normals are orthogonal to all τ_α
  case gap_turning:
    return facet and not(proximity and s.free()); // there r is along n
  case moving_target:
    return not vertex;
  case traction_multiplier:
  case gap_row:
    return true;
  default:
    return false;
  }
}

template <unsigned Term, int D>
int compare_without(const Pair<D>& pair, const Eigen::MatrixXd& full, const Eigen::MatrixXd& fd)
{
  const Eigen::MatrixXd K = pair.template tangent<Term>();
  CAPTURE(Term, relative(K, fd), relative(K, full));
  if (not matters<D>(Term, pair))
  {
    REQUIRE(relative(K, full) <= 1e-12); // zero up to the target's accuracy
    return 0;
  }
  REQUIRE(relative(K, fd) > 1e-4);
  return 1;
}

/// How often each term mattered.
template <int D, unsigned... Bit>
void compare_all(const Pair<D>& pair, std::array<int, num_terms>& count,
                 std::integer_sequence<unsigned, Bit...>)
{
  const Eigen::MatrixXd fd = pair.differences(), K = pair.tangent();
  CAPTURE(pair.scene.text(), pair.law.augmented, pair.closed, relative(K, fd));
  REQUIRE(fd.norm() > 0.01);
  REQUIRE(relative(K, fd) <= tol);
  ((count[Bit] += compare_without<(1u << Bit), D>(pair, K, fd)), ...);
}

template <int D>
std::array<int, num_terms> compare_scenes()
{
  std::array<int, num_terms> count{};
  for (const Scene<D>& s : scenes<D>())
    for (bool augmented : {false, true})
      for (bool closed : {true, false})
        compare_all<D>(Pair<D>(s, augmented, closed), count,
                       std::make_integer_sequence<unsigned, num_terms>());
  return count;
}

double asymmetry(const Eigen::MatrixXd& K)
{
  return relative(K.transpose(), K);
}

} // namespace

TEST_CASE("coupling: the tangent is the derivative of the residual, and needs all its terms (2D)")
{
  const std::array<int, num_terms> count = compare_scenes<2>();
  for (unsigned bit = 0; bit < num_terms; ++bit)
  {
    CAPTURE(bit);
    const bool edge = (1u << bit) & (edge_curvature | edge_gradient); // none in 2D
    REQUIRE((count[bit] > 0) == not edge);
  }
}

TEST_CASE("coupling: the tangent is the derivative of the residual, and needs all its terms (3D)")
{
  const std::array<int, num_terms> count = compare_scenes<3>();
  for (unsigned bit = 0; bit < num_terms; ++bit)
  {
    CAPTURE(bit);
    REQUIRE(count[bit] > 0);
  }
}

TEMPLATE_TEST_CASE_SIG(
    "coupling: symmetric for free closest points and fixed corners with a fixed normal only", "",
    ((int D), D), 2, 3)
{
  int symmetric = 0, others = 0;
  for (const Scene<D>& s : scenes<D>())
    for (bool augmented : {false, true})
    {
      const Eigen::MatrixXd K = Pair<D>(s, augmented, true).tangent();
      CAPTURE(s.text(), augmented);
      const bool fixed = s.target.clamp == Clamp::vertex and s.normals == NormalRule::direction;
      if (fixed or (s.rule == TargetRule::proximity and s.free()))
      {
        ++symmetric;
        REQUIRE(asymmetry(K) <= 1e-12); // round-off and the target's accuracy
      }
      else
      {
        ++others;
        REQUIRE(asymmetry(K) > 1e-4);
      }
    }
  REQUIRE(symmetric > 0);
  REQUIRE(others > symmetric);
}

TEST_CASE("coupling: action and reaction, and no traction where open")
{
  for (const Scene<3>& s : scenes<3>())
  {
    CAPTURE(s.text());
    const Pair<3> pair(s, false, true);
    const PairVector<3> b = pair.residual(pair.U);
    Vector<3> slave = Vector<3>::Zero(), master = slave;
    for (int a = 0; a < s.master.nu(); ++a)
    {
      slave += b.segment<3>(3 * a);
      master += b.segment<3>(pair.master() + 3 * a);
    }
    const Vector<3> force = weight * pair.lambda(pair.U) *
                            [&]
    {
      Kinematics<3> k;
      place<3>(s.master, s.target, s.x1, FacetProjection<3>(s.master, 0).at(s.target.xi, false),
               s.normals, s.e, k);
      return k.n;
    }();
    REQUIRE(force.norm() > 0.1);
    REQUIRE((slave + force).norm() <= 50 * eps); // −∫ t·⟦w⟧ with partitions of unity
    REQUIRE((master - force).norm() <= 50 * eps);

    const Pair<3> open(s, false, false);
    const PairVector<3> b0 = open.residual(open.U);
    REQUIRE(b0.head(open.multiplier()).norm() == 0);
    // Σ ψ_a = 1: −w/ρ_n λ, scaled
    REQUIRE(b0.tail(open.psi.size()).sum()
            == Approx(-weight * scale / open.law.rho_n * open.lambda(open.U)).epsilon(50 * eps));
  }
}
