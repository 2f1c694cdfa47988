// SPDX-License-Identifier: MIT
//
// Random particles around closed surfaces, also exactly on edges and corners: no rule may miss a
// target that brute force over all facets finds. DOLFINX_CONTACT_CAMPAIGN sets the number of
// particles of each case; then the figures are printed.
#include "../targets/search.h"
#include "facets.h"

#include <Eigen/LU>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <iostream>
#include <numbers>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// Cost of the best target. Points whose facet only just faces the slave, or is only just not
/// grazed, may count or not: the cost with them and without.
struct Cost
{
  double loose = INFINITY, strict = INFINITY;

  void add(double cost, double clearance)
  {
    if (clearance >= -1e-5)
      loose = std::min(loose, cost);
    if (clearance >= 1e-5)
      strict = std::min(strict, cost);
  }
};

/// Local methods from dense starts on all facets that are not too far.
template <int D>
class Brute
{
public:
  static constexpr int Q = D - 1;

  Brute(const Surface& s, const NodalNormals<D>& normals, double radius)
      : _s(s)
      , _normals(normals)
      , _radius(radius)
  {
    for (int j = 0; j <= (Q == 2 ? n : 0); ++j)
      for (int i = 0; i <= (s.ref.shape == Shape::triangle ? n - j : n); ++i)
        _xi.push_back(Eigen::Vector2d(i / double(n), j / double(n)).head<Q>());
    for (int f = 0; f < s.size(); ++f)
    {
      double longest = 0;
      Vector<D> centre = Vector<D>::Zero();
      for (const Vector<Q>& p : _xi)
      {
        const FacetPoint<D> point = at(f, p);
        _x.push_back(point.x);
        centre += point.x / _xi.size();
        longest = std::max(longest, point.tau.colwise().norm().sum());
      }
      _reach.push_back(0.6 * longest / n); // half a cell, and a little more: τ varies
      _centre.push_back(centre);
      double size = 0;
      for (std::size_t k = 0; k < _xi.size(); ++k)
        size = std::max(size, (sample(f, k) - centre).norm());
      _size.push_back(size + _reach[f]);
    }
  }

  Cost proximity(const Vector<D>& y, const Vector<D>& outward) const
  {
    Cost cost;
    visit(y, cost,
          [&](int f)
          {
            double best = INFINITY;
            Vector<Q> xi = _xi[0];
            for (std::size_t k = 0; k < _xi.size(); ++k)
              if (const double d = (y - sample(f, k)).norm(); d < best)
              {
                best = d;
                xi = _xi[k];
              }
            best = compass(f, y, xi, 0.5 / n, 1e-12);
            for (std::size_t k = 0; k < _xi.size(); ++k)
              if ((y - sample(f, k)).norm() - _reach[f] < best)
              {
                Vector<Q> other = _xi[k]; // roughly first: most often it leads to the same point
                const double rough = compass(f, y, other, 0.5 / n, 1e-3);
                if (rough > best + 1e-3 * _size[f] or (other - xi).norm() < 1e-2)
                  continue;
                if (const double d = compass(f, y, other, 1e-3, 1e-12); d < best - 1e-12)
                {
                  best = d;
                  xi = other;
                }
              }
            cost.add(best, normal(f, xi).dot(outward));
          });
    return cost;
  }

  Cost direction(const Vector<D>& y, const Vector<D>& outward, const Vector<D>& e) const
  {
    Cost cost;
    for (int f = 0; f < _s.size(); ++f)
    {
      const Vector<D> r = y - _centre[f];
      if ((r - r.dot(e) * e).norm() > _size[f])
        continue;
      for (std::size_t k = 0; k < _xi.size(); ++k)
      {
        const Vector<D> rk = y - sample(f, k);
        if ((rk - rk.dot(e) * e).norm() > _reach[f])
          continue;
        Vector<Q> xi = _xi[k];
        double s = 0;
        auto system = [&](Eigen::Matrix<double, D, D>& A) -> Vector<D>
        {
          const FacetPoint<D> p = at(f, xi);
          A << p.tau, -e;
          return y + s * e - p.x;
        };
        if (not newton(system, xi, s) or not inside(xi) or std::abs(s) > _radius)
          continue;
        const Vector<D> normal = this->normal(f, xi);
        cost.add(std::abs(s), std::min(normal.dot(outward), std::abs(normal.dot(e)) - 0.1));
      }
    }
    return cost;
  }

  Cost smooth(const Vector<D>& y, const Vector<D>& outward) const
  {
    Cost cost;
    visit(y, cost,
          [&](int f)
          {
            for (const Vector<Q>& start : _xi)
            {
              Vector<Q> xi = start;
              double g = 0;
              Eigen::Matrix<double, D, D> last;
              auto system = [&](Eigen::Matrix<double, D, D>& A) -> Vector<D>
              {
                const FacetPoint<D> p = at(f, xi);
                const NormalField<D> field = _normals.at(_s, f, xi.data());
                A << p.tau + g * field.dM, field.M;
                last = A;
                return y - p.x - g * field.M;
              };
              if (not newton(system, xi, g) or not inside(xi))
                continue;
              const Vector<D> M = _normals.at(_s, f, xi.data()).M;
              const double side = _s.sigma[f] * (D == 2 ? -1 : 1), d = std::abs(g) * M.norm();
              if (side * last.determinant() > 0 and d <= _radius)
                cost.add(d, M.normalized().dot(outward));
            }
          });
    return cost;
  }

private:
  static constexpr int n = D == 2 ? 16 : 6; // samples per direction

  FacetPoint<D> at(int f, const Vector<Q>& xi) const
  {
    return FacetProjection<D>(_s, f).at(xi, false);
  }
  Vector<D> normal(int f, const Vector<Q>& xi) const
  {
    return FacetProjection<D>(_s, f).normal(at(f, xi));
  }
  const Vector<D>& sample(int f, std::size_t k) const { return _x[f * _xi.size() + k]; }

  bool inside(const Vector<Q>& p, double tolerance = 1e-8) const
  {
    return p.minCoeff() >= -tolerance and p.maxCoeff() <= 1 + tolerance
           and (_s.ref.shape != Shape::triangle or p.sum() <= 1 + tolerance);
  }

  // All facets that may come nearer than the cost so far, the nearest ones first
  template <typename Visit>
  void visit(const Vector<D>& y, const Cost& cost, Visit visit) const
  {
    std::vector<std::pair<double, int>> order;
    for (int f = 0; f < _s.size(); ++f)
      if (const double d = (y - _centre[f]).norm() - _size[f]; d <= _radius)
        order.push_back({d, f});
    std::sort(order.begin(), order.end());
    for (const auto& [d, f] : order)
      if (d <= cost.strict)
        visit(f);
  }

  // Closest point by compass search, with directions along all edges
  double compass(int f, const Vector<D>& y, Vector<Q>& p, double h, double least) const
  {
    static const Eigen::Vector2d all[]
        = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, -1}, {-1, 1}, {1, 1}, {-1, -1}};
    auto distance = [&](const Vector<Q>& xi)
    {
      double N[BasisValues::max_nodes];
      _s.ref.position.values(xi.data(), N);
      const Eigen::Map<const Eigen::Matrix<double, D, Eigen::Dynamic>> X(_s.facet_x(f), D, _s.np());
      Vector<D> r = y;
      for (int a = 0; a < _s.np(); ++a)
        r -= N[a] * X.col(a);
      return r.norm();
    };
    double d = distance(p);
    while (h > least)
    {
      bool better = false;
      for (int k = 0; k < (Q == 1 ? 2 : 8); ++k)
      {
        const Vector<Q> trial = p + h * all[k].head<Q>();
        if (not inside(trial, 0))
          continue;
        if (const double e = distance(trial); e < d)
        {
          d = e;
          p = trial;
          better = true;
        }
      }
      if (not better)
        h *= 0.5;
    }
    return d;
  }

  // Undamped on D unknowns, ξ and one more
  template <typename System>
  static bool newton(System system, Vector<Q>& xi, double& s)
  {
    Eigen::Matrix<double, D, D> A;
    for (int it = 0; it < 20; ++it)
    {
      const Vector<D> residual = system(A), step = A.inverse() * residual;
      if (not step.allFinite() or xi.template lpNorm<Eigen::Infinity>() > 5)
        return false;
      xi += step.template head<Q>();
      s += step[Q];
      if (step.norm() < 1e-13)
        return system(A).norm() <= 1e-11;
    }
    return false;
  }

  const Surface& _s;
  const NodalNormals<D>& _normals;
  double _radius;
  std::vector<Vector<Q>> _xi;
  std::vector<Vector<D>> _x, _centre; // (facets, samples), (facets)
  std::vector<double> _reach, _size;  // of the cell around a sample, of the whole facet
};

/// A circle or sphere of radius one, its nodes a little displaced; or one with bumps.
template <int D>
Surface closed_surface(const Element& element, bool bumpy, std::mt19937& random)
{
  const int n = element.position == 1 ? 4 : 3;
  Surface s = build<D>(
      element.ref(), D == 2 ? line_cells(7 * n) : cube_cells(element.shape, n),
      [&](const Eigen::Vector3d& p)
      {
        const double angle = 2 * std::numbers::pi * p[0];
        const Eigen::Vector3d x
            = D == 2 ? Eigen::Vector3d(std::cos(angle), std::sin(angle), 0) : p.normalized().eval();
        const double bump = bumpy ? 0.1 * std::sin(3 * x[0] + 1) * std::cos(3 * x[1] + x[2]) : 0.0;
        return Vector<D>((1 + bump) * x.head<D>());
      },
      [](const Vector<D>& x) { return Vector<D>(-x); }, random);
  s.displace(random_displacement(s, 0.01, random));
  return s;
}

/// Anywhere around the surface; every fourth on an edge or a corner, or above it along a normal,
/// where two or more facets are equally far.
template <int D>
Vector<D> place(const Surface& s, const NodalNormals<D>& normals, int i, std::mt19937& random)
{
  if (i % 4)
    return uniform(random, 0.7, 1.3) * uniform_vector<D>(random, -1, 1).normalized();
  const int f = random() % s.size();
  const auto v = reference_edge(s.ref.shape, random() % num_edges(s.ref.shape));
  Vector<D - 1> xi = FacetProjection<D>::vertex(s.ref.shape, v[0]);
  if (i % 8)
    xi = 0.5 * (xi + FacetProjection<D>::vertex(s.ref.shape, v[1]));
  const Vector<D> x = FacetProjection<D>(s, f).at(xi, false).x;
  const double above[] = {0, -0.2, 0.2};
  return x + above[random() % 3] * normals.at(s, f, xi.data()).M.normalized();
}

template <int D>
void none_is_missed(const Element& element, TargetRule rule, bool bumpy, int particles, bool print)
{
  std::mt19937 random(31);
  const Surface s = closed_surface<D>(element, bumpy, random);
  const NodalNormals<D> normals(s, 3.1);
  SearchOptions<D> options;
  options.rule = rule;
  options.radius = 0.5;
  options.margin = 0;
  Search<D> search(s, options);
  search.refit(s, &normals);
  const Brute<D> brute(s, normals, options.radius);
  int missed = 0, hits = 0, first = -1;
  double worst = 0, residual = 0;
  Target<D> former;
  for (int i = 0; i < particles; ++i)
  {
    const Vector<D> x = place<D>(s, normals, i, random);
    Seeker<D> seeker{x, (-x + uniform_vector<D>(random, -1, 1)).normalized()};
    Cost cost;
    if (rule == TargetRule::direction)
    {
      seeker.e = (x.normalized() + uniform_vector<D>(random, -1, 1)).normalized();
      cost = brute.direction(x, seeker.outward, seeker.e);
    }
    else
      cost = rule == TargetRule::smooth ? brute.smooth(x, seeker.outward)
                                        : brute.proximity(x, seeker.outward);
    if (cost.loose > options.radius)
      cost.loose = INFINITY;
    if (cost.strict > options.radius)
      cost.strict = INFINITY;
    const Target<D> cold = search.find(s, seeker, {}, &normals),
                    warm = search.find(s, seeker, former, &normals);
    for (const Target<D>& t : {cold, warm})
    {
      double distance = INFINITY;
      if (t.facet >= 0)
      {
        const FacetPoint<D> p = FacetProjection<D>(s, t.facet).at(t.xi, false);
        const Vector<D> r = x - p.x;
        distance = r.norm();
        ++hits;
        if (rule != TargetRule::proximity)
        {
          const Vector<D> m = rule == TargetRule::direction
                                  ? seeker.e
                                  : normals.at(s, t.facet, t.xi.data()).M.normalized();
          residual = std::max(residual, (r - r.dot(m) * m).norm());
        }
        else if (t.clamp == Clamp::none)
          residual = std::max(residual, (p.tau.transpose() * r).norm());
      }
      const bool same = distance >= cost.loose - 1e-10 and distance <= cost.strict + 1e-10;
      if (not same)
      {
        first = missed++ == 0 ? i : first;
        if (std::isfinite(distance) and std::isfinite(cost.strict))
          worst = std::max(worst, std::abs(distance - cost.strict));
      }
    }
    former = cold;
  }
  const std::string text = element.text() + (bumpy ? ", bumpy" : ", round");
  if (print)
    std::cout << text << ", rule " << static_cast<int>(rule) << ": " << particles << " particles, "
              << hits << " targets, " << missed << " missed\n"
              << std::flush;
  CAPTURE(text, static_cast<int>(rule), first, worst);
  CHECK(missed == 0);
  CHECK(hits > particles / 2);
  CHECK(residual <= 1e-10);
}

} // namespace

TEMPLATE_TEST_CASE_SIG("search: a campaign of random particles misses no target", "", ((int D), D),
                       2, 3)
{
  const char* number = std::getenv("DOLFINX_CONTACT_CAMPAIGN");
  const int particles = number ? std::atoi(number) : 300;
  for (const Element& element : elements<D>())
    if (element.position == element.displacement)
      for (const TargetRule rule :
           {TargetRule::proximity, TargetRule::direction, TargetRule::smooth})
        for (const bool bumpy : {false, true})
          none_is_missed<D>(element, rule, bumpy, particles, number != nullptr);
}
