// SPDX-License-Identifier: MIT
//
// A particle whose target's normal, and perhaps the target itself, depends on the whole star of
// facets around it: interpolated normals (F8) and smooth targets (F6).
#pragma once

#include "../targets/smooth_projection.h"
#include "pair.h"

namespace dolfinx_contact::test
{

/// A particle (a slave with one node, one multiplier and one friction node) and its target on a
/// curved plate.
template <int D>
struct StarScene
{
  static constexpr int Q = D - 1;
  Element element;
  Rules rules;
  Clamp clamp;
  Surface master;
  NodalNormals<D> normals, old_normals;
  Eigen::VectorXd U; // particle (D), multiplier and friction (1, Q) in their scales, all nodes of
                     // the master, change of e
  Vector<D> e = Vector<D>::Zero();
  Target<D> target = {};
  std::vector<Vector<D>> tangent = {};
  Vector<D> x1_old = Vector<D>::Zero();
  bool augmented = false, convected = true;

  static constexpr std::array cases = {Status::closed, Status::stick, Status::slip};
  static constexpr int friction = D + 1, first_node = friction + Q;
  int size() const { return static_cast<int>(U.size()); }
  int node(int n) const { return first_node + n * D; }
  int rows() const { return size() - D; }

  /// ρ_τ decides whether the particle sticks.
  ContactLaw law(Status status) const
  {
    const double rho_t = status == Status::slip ? 20 : 0.6;
    return {.rho_n = 2.3, .augmented = augmented, .friction = 0.4, .rho_t = rho_t, .kappa = 0.9};
  }

  Friction<D> rub(Status status, const Eigen::VectorXd& V, const Vector<D>& n,
                  const Vector<D>& slip) const
  {
    if (status == Status::closed)
      return {};
    const auto now = normals.at(master, target.facet, target.xi.data()).M.normalized();
    return Friction<D>(law(status), scales.pressure * V[D], before<D>(now), n, Lambda(V), slip);
  }

  Vector<D> Lambda(const Eigen::VectorXd& V) const
  {
    Vector<D> out = Vector<D>::Zero();
    for (int i = 0; i < Q; ++i)
      out += scales.friction * V[friction + i] * tangent[i];
    return out;
  }

  void move(const Eigen::VectorXd& V, Surface& m, NodalNormals<D>& n) const
  {
    m.displace(std::span(V.data() + first_node, m.node_table.size() * D));
    n.update(m);
  }

  /// The target on the same facet with the same clamp.
  bool solve(const Surface& m, const NodalNormals<D>& n, const Vector<D>& x,
             const Vector<D>& along_e, Target<D>& t) const
  {
    t = target;
    const FacetProjection<D> facet(m, t.facet);
    const SmoothProjection<D> along(m, t.facet, n);
    double s;
    if (clamp == Clamp::edge)
    {
      if (rules.target == TargetRule::smooth)
        along.clamp(x, target.edge, t);
      else
        facet.clamp(x, along_e, target.edge, t);
    }
    else if (clamp == Clamp::none)
      return rules.target == TargetRule::smooth      ? along.solve(x, t.xi, s)
             : rules.target == TargetRule::proximity ? facet.closest(x, t.xi)
                                                     : facet.intersect(x, along_e, t.xi, s);
    return t.clamp == clamp and t.edge == target.edge;
  }

  CouplingBasis<D> basis(Status status, const BasisValues& M) const
  {
    static constexpr double one = 1;
    CouplingBasis<D> B;
    B.N = B.psi = B.phi = &one;
    B.tangent = tangent.data();
    B.slave = B.multiplier = 1;
    B.friction = status == Status::closed ? 0 : 1;
    B.M = &M;
    B.master = master.nu();
    return B;
  }

  /// Where the unknowns of the pair (slave, multiplier, friction, master facet) are in U.
  std::vector<int> places(Status status) const
  {
    std::vector<int> out;
    for (int i = 0; i < (status == Status::closed ? friction : first_node); ++i)
      out.push_back(i);
    for (int a = 0; a < master.nu(); ++a)
      for (int i = 0; i < D; ++i)
        out.push_back(node(master.local[target.facet * master.nu() + a]) + i);
    return out;
  }

  /// Residuals of all cases, one below the other.
  Eigen::VectorXd residual(const Eigen::VectorXd& V) const
  {
    Surface m = master;
    NodalNormals<D> n = normals;
    move(V, m, n);
    const Vector<D> x = V.template head<D>();
    const Vector<D> direction
        = rules.turning ? Vector<D>((e + V.template tail<D>()).normalized()) : e;
    Target<D> t;
    if (not solve(m, n, x, direction, t))
      throw std::logic_error("the target was lost");
    const NormalField<D> field = n.at(m, t.facet, t.xi.data());
    Kinematics<D> k;
    place<D>(m, t, x, FacetProjection<D>(m, t.facet).at(t.xi, false), NormalRule::interpolated,
             direction, k, &field);
    BasisValues M;
    m.ref.displacement.tabulate(t.xi.data(), M);
    const double lambda = scales.pressure * V[D];
    const Vector<D> slip
        = slip_of<D>(m, t.facet, t.xi, x, x1_old, convected, BothNormals<D>{n, old_normals});
    Eigen::VectorXd out = Eigen::VectorXd::Zero(cases.size() * rows());
    for (std::size_t c = 0; c < cases.size(); ++c)
    {
      const Status status = cases[c];
      const std::vector<int> places = this->places(status);
      const ContactLaw law = this->law(status);
      const Friction<D> f = rub(status, V, k.n, slip);
      PairVector<D> b = PairVector<D>::Zero(places.size());
      add_residual<D>(basis(status, M), law, true, lambda, k.gap,
                      traction<D>(law, lambda, k.n, k.gap, f), Lambda(V), f, weight, scales, b);
      for (std::size_t i = 0; i < places.size(); ++i)
        out[c * rows() + places[i]] += b[i];
    }
    return out;
  }

  template <unsigned Drop = all_terms>
  Kinematics<D> linearised() const
  {
    const Vector<D> x = U.template head<D>();
    const NormalField<D> field = normals.at(master, target.facet, target.xi.data());
    const FacetPoint<D> p = FacetProjection<D>(master, target.facet).at(target.xi, true);
    const Slip<D> slip = library_slip<D>(master, target, x, x1_old, convected,
                                         BothNormals<D>{normals, old_normals});
    return linearise<D, Drop>(master, target, x, p, rules, e, &field, &slip);
  }

  /// The library's tangent of one case: (rows, size).
  /// @tparam F with friction unknowns
  template <bool F, unsigned Drop = all_terms>
  Eigen::MatrixXd derivative(Status status) const
  {
    const double* xi = target.xi.data();
    BasisValues M;
    master.ref.displacement.tabulate(xi, M);
    const Kinematics<D> k = linearised<Drop>();
    const FrictionTangent<D> f(rub(status, U, k.n, k.slip));
    const ContactLaw law = this->law(status);
    const double lambda = scales.pressure * U[D];
    const std::vector<int> places = this->places(status);
    PairMatrix<D> K = PairMatrix<D>::Zero(places.size(), places.size());
    add_closed_tangent<D, F, Drop>(basis(status, M), law, lambda, k, f, weight, scales, K);
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows(), size());
    for (std::size_t i = 0; i < places.size(); ++i)
      for (std::size_t j = 0; j < places.size(); ++j)
        out(places[i], places[j]) += K(i, j);

    const FieldColumns<D> of_m
        = field_columns<D, F, Drop>(basis(status, M), law, lambda, k, k.m, f, weight, scales);
    double N[4], dN[2][4];
    corner_basis(master.ref.shape, xi, N, dN);
    const NormalDerivative<D> d = normals.derivative(master, target.facet);
    for (int c = 0; c < master.nv(); ++c)
    {
      const Eigen::MatrixXd block = N[c] * of_m * d.dn.template middleRows<D>(c * D);
      for (std::size_t i = 0; i < places.size(); ++i)
        for (std::size_t n = 0; n < d.nodes.size(); ++n)
          for (int l = 0; l < D; ++l)
            out(places[i], node(d.nodes[n]) + l) += block(i, D * n + l);
    }
    if (rules.turning)
    {
      const Eigen::MatrixXd of_e
          = field_columns<D, F, Drop>(basis(status, M), law, lambda, k, k.e, f, weight, scales)
            * beside<D>(e);
      for (std::size_t i = 0; i < places.size(); ++i)
        out.row(places[i]).template tail<D>() += of_e.row(i);
    }
    return out;
  }
};

template <int D>
StarScene<D> draw_star(const Element& element, const Rules& rules, Clamp clamp,
                       std::mt19937& random)
{
  const TargetRule rule = rules.target;
  for (int attempt = 0; attempt < 2000; ++attempt)
  {
    const int n = 3;
    StarScene<D> s{element,
                   rules,
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
                   {},
                   {}};
    s.augmented = random() % 2;
    s.convected = random() % 2;
    s.tangent = random_tangents<D>(random);
    s.normals = NodalNormals<D>(s.master, 3.1);
    s.U = Eigen::VectorXd::Zero(s.node(s.master.node_table.size()) + D);
    const std::vector<double> u = random_displacement(s.master, 0.06, random);
    for (std::size_t i = 0; i < u.size(); ++i)
      s.U[s.first_node + i] = u[i];
    s.U[D] = -0.6;
    s.U.template segment<D - 1>(s.friction) = uniform_vector<D - 1>(random, -0.5, 0.5);
    s.master.remember(random_displacement(s.master, 0.06, random));
    Surface old = s.master;
    old.x = old.x_old;
    s.old_normals = s.normals;
    s.old_normals.update(old);
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
    if (not s.solve(s.master, s.normals, s.U.template head<D>(), s.e, t))
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
    s.x1_old = s.U.template head<D>() + uniform_vector<D>(random, -0.3, 0.3);
    // well within stick and slip
    const Kinematics<D> k = s.linearised();
    auto size = [&](Status status)
    {
      const Vector<D> Lambda = turned<D>(before<D>(k.n), k.n, s.Lambda(s.U));
      return (beside<D>(k.n) * (Lambda + s.law(status).rho_t * k.slip)).norm();
    };
    if (size(Status::stick) < 0.9 and size(Status::slip) > 1.2)
      return s;
  }
  throw std::logic_error("no scene found: " + element.text());
}

} // namespace dolfinx_contact::test
