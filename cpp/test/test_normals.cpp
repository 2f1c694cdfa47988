// SPDX-License-Identifier: MIT
//
// Interpolated normals (F8) and smooth targets (F6): one particle's tangent, with the columns of
// the whole star of its target, against differences; and the same with one term left out at a time.
#include "../geometry/normals.h"
#include "../mechanics/coupling.h"
#include "../targets/smooth_projection.h"
#include "facets.h"

#include <catch2/catch.hpp>
#include <numbers>
#include <utility>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr double tol = 1e-8; // truncation and round-off of `central`, relative
constexpr double weight = 0.37, scale = 3.7;
constexpr unsigned first_bit = 13, num_bits = 6; // smooth_offset … normal_sliding
static_assert(smooth_offset == 1u << first_bit and last_term == 1u << (first_bit + num_bits - 1));

/// A particle (a slave with one node and one multiplier) and its target on a curved plate.
template <int D>
struct StarScene
{
  static constexpr int Q = D - 1;
  Element element;
  TargetRule rule;
  Clamp clamp;
  Surface master;
  NodalNormals<D> normals;
  Eigen::VectorXd U; // particle (D), multiplier / scale, all nodes of the master
  Vector<D> e = Vector<D>::Zero();
  Target<D> target = {};
  ContactLaw law{2.3, false};

  int size() const { return static_cast<int>(U.size()); }
  int node(int n) const { return D + 1 + n * D; }

  void move(const Eigen::VectorXd& V, Surface& m, NodalNormals<D>& n) const
  {
    m.displace(std::span(V.data() + D + 1, m.node_table.size() * D));
    n.update(m);
  }

  /// The target on the same facet with the same clamp.
  bool solve(const Surface& m, const NodalNormals<D>& n, const Vector<D>& x, Target<D>& t) const
  {
    t = target;
    const FacetProjection<D> facet(m, t.facet);
    const SmoothProjection<D> along(m, t.facet, n);
    double s;
    if (clamp == Clamp::edge)
    {
      if (rule == TargetRule::smooth)
        along.clamp(x, target.edge, t);
      else
        facet.clamp(x, e, target.edge, t);
    }
    else if (clamp == Clamp::none)
      return rule == TargetRule::smooth      ? along.solve(x, t.xi, s)
             : rule == TargetRule::proximity ? facet.closest(x, t.xi)
                                             : facet.intersect(x, e, t.xi, s);
    return t.clamp == clamp and t.edge == target.edge;
  }

  CouplingBasis basis(const BasisValues& M) const
  {
    static constexpr double one = 1;
    CouplingBasis B;
    B.N = B.psi = &one;
    B.slave = B.multiplier = 1;
    B.M = &M;
    B.master = master.nu();
    return B;
  }

  /// Where the unknowns of the pair (slave, multiplier, master facet) are in U.
  std::vector<int> places() const
  {
    std::vector<int> out;
    for (int i = 0; i <= D; ++i)
      out.push_back(i);
    for (int a = 0; a < master.nu(); ++a)
      for (int i = 0; i < D; ++i)
        out.push_back(node(master.local[target.facet * master.nu() + a]) + i);
    return out;
  }

  Eigen::VectorXd residual(const Eigen::VectorXd& V) const
  {
    Surface m = master;
    NodalNormals<D> n = normals;
    move(V, m, n);
    const Vector<D> x = V.template head<D>();
    Target<D> t;
    if (not solve(m, n, x, t))
      throw std::logic_error("the target was lost");
    const NormalField<D> field = n.at(m, t.facet, t.xi.data());
    Kinematics<D> k;
    place<D>(m, t, x, FacetProjection<D>(m, t.facet).at(t.xi, false), NormalRule::interpolated, e,
             k, &field);
    BasisValues M;
    m.ref.displacement.tabulate(t.xi.data(), M);
    const double lambda = scale * V[D];
    PairVector<D> b = PairVector<D>::Zero(places().size());
    add_residual<D>(basis(M), law, true, lambda, k.gap, traction<D>(law, true, lambda, k.n, k.gap),
                    weight, scale, b);
    Eigen::VectorXd out = Eigen::VectorXd::Zero(size());
    const std::vector<int> rows = places();
    for (std::size_t i = 0; i < rows.size(); ++i)
      out[rows[i]] += b[i];
    return out;
  }

  template <unsigned Drop = all_terms>
  Eigen::MatrixXd tangent() const
  {
    const double* xi = target.xi.data();
    BasisValues P, M;
    master.ref.position.tabulate(xi, P, true);
    master.ref.displacement.tabulate(xi, M);
    const NormalField<D> field = normals.at(master, target.facet, xi);
    const FacetPoint<D> p = evaluate<D>(master.facet_x(target.facet), master.np(), P, true);
    const Kinematics<D> k = linearise<D, Drop>(master, target, U.template head<D>(), p, rule,
                                               NormalRule::interpolated, e, &field);
    const Traction<D> t = linearised_traction<D, Drop>(law, scale * U[D], k);
    const std::vector<int> rows = places();
    PairMatrix<D> K = PairMatrix<D>::Zero(rows.size(), rows.size());
    add_closed_tangent<D, Drop>(basis(M), k, t, weight, scale, K);
    NormalColumns<D> columns;
    columns.reset(master.nv(), static_cast<int>(rows.size()));
    double N[4], dN[2][4];
    corner_basis(master.ref.shape, xi, N, dN);
    add_normal_columns<D, Drop>(basis(M), k, t, weight, scale, N, master.nv(), columns);

    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(size(), size());
    for (std::size_t i = 0; i < rows.size(); ++i)
      for (std::size_t j = 0; j < rows.size(); ++j)
        out(rows[i], rows[j]) += K(i, j);
    const NormalDerivative<D> d = normals.derivative(master, target.facet);
    for (int c = 0; c < master.nv(); ++c)
    {
      const Eigen::MatrixXd block = columns.corner[c] * d.dn[c];
      for (std::size_t i = 0; i < rows.size(); ++i)
        for (std::size_t n = 0; n < d.nodes.size(); ++n)
          for (int l = 0; l < D; ++l)
            out(rows[i], node(d.nodes[n]) + l) += block(i, D * n + l);
    }
    return out;
  }
};

template <int D>
StarScene<D> draw_star(const Element& element, TargetRule rule, Clamp clamp, bool augmented,
                       std::mt19937& random)
{
  for (int attempt = 0; attempt < 2000; ++attempt)
  {
    const int n = 3;
    StarScene<D> s{element,
                   rule,
                   clamp,
                   plate<D>(element, n, random(),
                            [](const Eigen::Vector3d& q)
                            {
                              Vector<D> x = Vector<D>(q.head<D>()) * 3.0;
                              x[D - 1] = 0.4 * std::sin(1.3 * x[0] + 0.2);
                              if (D == 3)
                                x[2] += 0.3 * std::cos(1.1 * x[1]);
                              return x;
                            }),
                   {},
                   {}};
    s.law.augmented = augmented;
    s.normals = NodalNormals<D>(s.master, 3.1);
    s.U = Eigen::VectorXd::Zero(D + 1 + s.master.node_table.size() * D);
    const std::vector<double> u = random_displacement(s.master, 0.06, random);
    for (std::size_t i = 0; i < u.size(); ++i)
      s.U[D + 1 + i] = u[i];
    s.U[D] = -0.6;
    s.move(s.U, s.master, s.normals);

    s.target.facet = random() % s.master.size();
    s.target.clamp = clamp;
    const Shape shape = element.shape;
    const int corner = random() % num_vertices(shape);
    s.target.xi = uniform_vector<D - 1>(random, 0.2, 0.45);
    const FacetProjection<D> facet(s.master, s.target.facet);
    if (clamp != Clamp::none)
    {
      s.target.edge = static_cast<std::int8_t>(corner);
      s.target.xi = facet.vertex(shape, corner);
    }
    if (clamp == Clamp::edge)
      s.target.xi = facet.vertex(shape, reference_edge(shape, corner)[0])
                    + uniform(random, 0.3, 0.7) * facet.edge_direction(shape, corner);
    const Vector<D> nbar
        = s.normals.at(s.master, s.target.facet, s.target.xi.data()).M.normalized();
    if (rule == TargetRule::direction)
      s.e = (nbar + uniform_vector<D>(random, -0.5, 0.5)).normalized();
    Vector<D> r = (random() % 2 ? 1.0 : -1.0) * uniform(random, 0.1, 0.3) * nbar;
    if (clamp != Clamp::none)
      r += uniform_vector<D>(random, -0.3, 0.3);
    s.U.template head<D>() = facet.at(s.target.xi, false).x + r;
    Target<D> t;
    if (not s.solve(s.master, s.normals, s.U.template head<D>(), t))
      continue;
    const bool inside
        = clamp == Clamp::none ? facet.outside(t.xi) == 0 : facet.outside(t.xi) < 1e-9;
    if (clamp == Clamp::edge)
    {
      const double along = (t.xi - facet.vertex(shape, reference_edge(shape, corner)[0])).norm();
      if (along < 0.1 or along > 0.9)
        continue;
    }
    if (not inside)
      continue;
    s.target = t;
    return s;
  }
  throw std::logic_error("no scene found: " + element.text());
}

template <int D>
bool matters_here(unsigned term, const StarScene<D>& s)
{
  const bool smooth = s.rule == TargetRule::smooth, free = s.clamp == Clamp::none;
  switch (term)
  {
  case smooth_offset:
  case smooth_field:
    return smooth and free;
  case edge_turning:
  case edge_field:
    return smooth and s.clamp == Clamp::edge;
  case normal_field:
    return true;
  case normal_sliding:
    return s.clamp != Clamp::vertex;
  default:
    return false;
  }
}

template <unsigned Term, int D>
int without(const StarScene<D>& s, const Eigen::MatrixXd& full, const Eigen::MatrixXd& fd)
{
  const Eigen::MatrixXd K = s.template tangent<Term>();
  const double error = (K - fd).norm() / fd.norm(), change = (K - full).norm() / full.norm();
  CAPTURE(Term, error, change);
  if (not matters_here<D>(Term, s))
  {
    REQUIRE(change <= 1e-12);
    return 0;
  }
  REQUIRE(error > 1e-5);
  return 1;
}

template <int D, unsigned... Bit>
void compare_star(std::array<int, num_bits>& count, std::integer_sequence<unsigned, Bit...>)
{
  std::mt19937 random(3);
  for (const Element& element : elements<D>())
    for (TargetRule rule : {TargetRule::smooth, TargetRule::proximity, TargetRule::direction})
      for (Clamp clamp : {Clamp::none, Clamp::edge, Clamp::vertex})
      {
        if (D == 2 and clamp == Clamp::edge)
          continue;
        const StarScene<D> s = draw_star<D>(element, rule, clamp, random() % 2, random);
        Eigen::MatrixXd fd(s.size(), s.size());
        for (int j = 0; j < s.size(); ++j)
          fd.col(j) = central([&](double h)
                              { return s.residual(s.U + h * Eigen::VectorXd::Unit(s.size(), j)); });
        const Eigen::MatrixXd K = s.tangent();
        CAPTURE(element.text(), int(rule), int(clamp), s.law.augmented);
        REQUIRE(fd.norm() > 0.01);
        REQUIRE((K - fd).norm() <= tol * fd.norm());
        ((count[Bit] += without<(1u << (first_bit + Bit)), D>(s, K, fd)), ...);
      }
}

} // namespace

TEST_CASE("normals: the tangent is the derivative of the residual, and needs all its terms (2D)")
{
  std::array<int, num_bits> count{};
  compare_star<2>(count, std::make_integer_sequence<unsigned, num_bits>());
  for (unsigned bit = 0; bit < num_bits; ++bit)
    REQUIRE((count[bit] > 0) == (bit != 2 and bit != 3)); // no edges in 2D
}

TEST_CASE("normals: the tangent is the derivative of the residual, and needs all its terms (3D)")
{
  std::array<int, num_bits> count{};
  compare_star<3>(count, std::make_integer_sequence<unsigned, num_bits>());
  for (unsigned bit = 0; bit < num_bits; ++bit)
    REQUIRE(count[bit] > 0);
}

TEST_CASE("normals: n̄ is continuous across edges, and creases stop the averaging")
{
  std::mt19937 random(7);
  // a roof: two halves that meet at 90 degrees
  const auto roof
      = [](const Eigen::Vector3d& q) { return Vector<3>(q[0], q[1], -std::abs(q[0] - 0.5)); };
  const Element element{Shape::quadrilateral, 1, 1};
  const Surface s = plate<3>(element, 4, 2, roof);
  const NodalNormals<3> smooth(s, 1.7), creased(s, 1.0); // above and below 90 degrees
  int edges = 0;
  for (int f = 0; f < s.size(); ++f)
    for (int v = 0; v < 4; ++v)
    {
      const Vector<3> x = Eigen::Map<const Vector<3>>(s.facet_X(f) + 3 * v);
      const FacetPoint<3> p
          = FacetProjection<3>(s, f).at(FacetProjection<3>::vertex(element.shape, v), false);
      const Vector<3> own = FacetProjection<3>(s, f).normal(p);
      REQUIRE((creased.normal(s, f, v) - own).norm() <= 8 * eps); // flat halves
      if (std::abs(x[0] - 0.5) < 1e-12)
      {
        ++edges;
        REQUIRE((smooth.normal(s, f, v) - Vector<3>(0, 0, -1)).norm() <= 8 * eps);
      }
    }
  REQUIRE(edges == 16);
}

TEMPLATE_TEST_CASE_SIG("smooth targets: exactly one facet for each point around a closed surface",
                       "", ((int D), D), 2, 3)
{
  std::mt19937 random(9);
  for (const Element& element : elements<D>())
  {
    // a circle or a sphere of radius 1, the body inside
    Cells cells = D == 2 ? line_cells(24) : cube_cells(element.shape, 4);
    const Surface s = build<D>(
        element.ref(), cells,
        [](const Eigen::Vector3d& q)
        {
          if constexpr (D == 2)
            return Vector<2>(std::cos(2 * std::numbers::pi * q[0]),
                             std::sin(2 * std::numbers::pi * q[0]));
          else
            return Vector<3>(q.normalized());
        },
        [](const Vector<D>& x) { return Vector<D>(-x); }, random);
    const NodalNormals<D> normals(s, 3.1);
    for (int i = 0; i < 500; ++i)
    {
      const Vector<D> direction = uniform_vector<D>(random, -1, 1).normalized();
      const Vector<D> x = uniform(random, 0.8, 1.3) * direction;
      int hits = 0;
      for (int f = 0; f < s.size(); ++f)
      {
        const FacetProjection<D> facet(s, f);
        Vector<D - 1> xi = facet.start(x);
        double d = 0;
        if (not SmoothProjection<D>(s, f, normals).solve(x, xi, d) or facet.outside(xi) > 0
            or std::abs(d) > 0.5)
          continue;
        ++hits;
        const NormalField<D> field = normals.at(s, f, xi.data());
        // (F6), up to Newton's last step
        REQUIRE((facet.at(xi, false).x + d * field.M.normalized() - x).norm() <= 1e-10);
      }
      CAPTURE(element.text(), x.transpose());
      REQUIRE(hits == 1);
    }
  }
}
