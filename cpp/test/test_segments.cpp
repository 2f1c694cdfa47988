// SPDX-License-Identifier: MIT
//
// The common refinement of a slave facet with the master facets that face it.
#include "../integration/segments.h"
#include "facets.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <catch2/catch.hpp>
#include <numeric>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

/// Gauss's rule with n points on [0, 1]: eigenvalues of the Jacobi matrix (Golub and Welsch).
ParticleRule gauss_line(int n)
{
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(n, n);
  for (int i = 1; i < n; ++i)
    J(i, i - 1) = J(i - 1, i) = i / std::sqrt(4.0 * i * i - 1);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(J);
  ParticleRule rule;
  for (int i = 0; i < n; ++i)
  {
    rule.points.push_back(0.5 * (1 + solver.eigenvalues()[i]));
    rule.weights.push_back(std::pow(solver.eigenvectors()(0, i), 2));
  }
  return rule;
}

/// On the reference simplex of dimension D − 1, exact for degree 2 n − 2; collapsed on the
/// triangle.
template <int D>
ParticleRule gauss(int n)
{
  const ParticleRule line = gauss_line(n);
  if constexpr (D == 2)
    return line;
  ParticleRule rule;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const double rest = 1 - line.points[j];
      rule.points.insert(rule.points.end(), {line.points[i] * rest, line.points[j]});
      rule.weights.push_back(line.weights[i] * line.weights[j] * rest);
    }
  return rule;
}

std::vector<int> all(const Surface& s)
{
  std::vector<int> f(s.size());
  std::iota(f.begin(), f.end(), 0);
  return f;
}

double measure_of(Shape shape)
{
  return shape == Shape::triangle ? 0.5 : 1;
}

/// A plate at height z over [lower, upper]^{D−1}, its body above (up = 1) or below it; nodes inside
/// are moved at random in the plane, facets of degree 1 stay plane.
template <int D>
Surface tile(const Element& element, int n, double lower, double upper, double up, double z,
             double disorder, std::mt19937& random)
{
  std::map<std::array<long, 2>, Vector<D>> moved;
  Surface s = build<D>(
      element.ref(), D == 2 ? line_cells(n) : square_cells(element.shape, n),
      [&](const Eigen::Vector3d& q)
      {
        const std::array<long, 2> key = {std::lround(1e7 * q[0]), std::lround(1e7 * q[1])};
        auto [it, fresh] = moved.try_emplace(key);
        if (fresh)
        {
          const auto inside = q.head<D - 1>().array();
          it->second = (lower + (upper - lower) * q.array()).matrix().template head<D>();
          if ((inside > 1e-9).all() and (inside < 1 - 1e-9).all())
            it->second.template head<D - 1>()
                += uniform_vector<D - 1>(random, -disorder, disorder) * (upper - lower) / n;
          it->second[D - 1] = z;
        }
        return it->second;
      },
      [&](const Vector<D>&) { return Vector<D>(up * Vector<D>::Unit(D - 1)); }, random);
  std::iota(s.id.begin(), s.id.end(), 0);
  return s;
}

} // namespace

TEMPLATE_TEST_CASE_SIG("segments: the parametric plane of a facet", "", ((int D), D), 2, 3)
{
  constexpr int Q = D - 1;
  std::mt19937 random(1);
  for (const Element& element : elements<D>())
    for (int i = 0; i < 20; ++i)
    {
      const bool plane = element.position == 1 and i < 10;
      const Surface s = plane ? tile<D>(element, 2, 0, 1, 1, 0, 0.2, random)
                              : single_facet<D>(element, 0.1, random);
      const Chart<D> chart(s, 0);
      if constexpr (D == 3)
        REQUIRE(chart.whole().convex());
      for (int k = 0; k < 20; ++k)
      {
        Vector<Q> xi = uniform_vector<Q>(random, 0, 1);
        if (element.shape == Shape::triangle and xi.sum() > 1)
          xi = Vector<Q>::Ones() - xi;
        if (plane)
        {
          // c from ξ is what the projection says, and |∂c/∂ξ| is the ratio of areas
          const FacetPoint<D> p = FacetProjection<D>(s, 0).at(xi, false);
          const Vector<D> at = chart.project(p.x, chart.normal());
          REQUIRE(std::abs(at[D - 1]) < 10 * eps);
          const Vector<Q> c = at.template head<Q>();
          REQUIRE((chart.xi(c) - xi).norm() < 100 * eps);
          const FacetPoint<D> centre
              = FacetProjection<D>(s, 0).at(FacetProjection<D>::centre(element.shape), false);
          REQUIRE(chart.gradient(xi).determinant()
                  == Approx(p.area_vector().norm() / centre.area_vector().norm()).epsilon(1e-13));
        }
      }
    }
}

TEMPLATE_TEST_CASE_SIG("segments: weights are positive and make up the reference facet", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(2);
  int refined = 0, uncovered = 0;
  for (const Element& element : elements<D>())
    for (const Element& other : elements<D>())
      for (int i = 0; i < 20; ++i)
      {
        // wavy, bent and folded surfaces, far ends, none at all
        Surface slave = tile<D>(element, 2, 0, 1, 1, 0, 0.2, random);
        Surface master = tile<D>(other, 3, uniform(random, -1, 0.4), uniform(random, 0.6, 2), -1,
                                 -0.01, 0.2, random);
        slave.displace(random_displacement(slave, 0.05, random));
        master.displace(random_displacement(master, i % 4 == 3 ? 0.4 : 0.05, random));
        const std::vector<int> near = i % 10 == 9 ? std::vector<int>() : all(master);
        const Vector<D> direction
            = i % 3 == 0
                  ? Vector<D>(Vector<D>::Unit(D - 1) + 0.3 * uniform_vector<D>(random, -1, 1))
                  : Vector<D>(Vector<D>::Zero());
        const Segments<D> segments(gauss<D>(3));
        for (int f = 0; f < slave.size(); ++f)
        {
          double sum = 0;
          const auto points = segments.points(slave, f, master, near, direction, 1).points;
          for (const CellPoint<D>& p : points)
          {
            REQUIRE(p.weight > 0);
            REQUIRE(FacetProjection<D>(slave, f).outside(p.xi) <= 1e-12);
            sum += p.weight;
            ++(p.master < 0 ? uncovered : refined);
          }
          // distorted quadrilaterals: 1/|∂c/∂ξ| is no polynomial, but the sum is not far off
          const bool affine = element.shape != Shape::quadrilateral;
          REQUIRE(sum == Approx(measure_of(element.shape)).epsilon(affine ? 1e-12 : 1e-3));
        }
      }
  REQUIRE(refined > 0);
  REQUIRE(uncovered > 0);
}

TEMPLATE_TEST_CASE_SIG("segments: master loads of a uniform pressure are exact on a plane", "",
                       ((int D), D), 2, 3)
{
  // ∫ M_b dΓ over the refinement of a slave plate that holds the master plate, against the
  // integral over the master's facets
  std::mt19937 random(3);
  Eigen::Matrix<double, D, D> turn; // orthogonal
  turn.setRandom();
  turn = turn.householderQr().householderQ();
  for (const Element& element : elements<D>())
    for (const Element& other : elements<D>())
    {
      if (element.position != element.displacement or other.position != other.displacement)
        continue;
      for (const double disorder : {0.0, 0.15})
      {
        if (disorder > 0 and (element.position == 2 or other.position == 2))
          continue; // bent edges: the cells are those of their chords
        Surface slave = tile<D>(element, 3, -0.13, 1.21, 1, 0, disorder, random);
        Surface master = tile<D>(other, 4, 0, 1, -1, 0, disorder, random);
        for (Surface* s : {&slave, &master})
        {
          for (std::size_t a = 0; a < s->X.size(); a += D)
          {
            Eigen::Map<Vector<D>> x(&s->X[a]);
            x = (turn * x).eval();
          }
          s->x = s->X;
        }
        const Segments<D> segments(gauss<D>(9));
        Eigen::VectorXd loads = Eigen::VectorXd::Zero(master.node_table.size()), exact = loads;
        double area = 0;
        for (int f = 0; f < slave.size(); ++f)
          for (const CellPoint<D>& p :
               segments.points(slave, f, master, all(master), Vector<D>::Zero(), 1).points)
          {
            if (p.master < 0)
              continue;
            const FacetPoint<D> at = FacetProjection<D>(slave, f).at(p.xi, false);
            const double w = p.weight * at.area_vector().norm();
            area += w;
            Vector<D - 1> xi = FacetProjection<D>::centre(other.shape);
            const FacetProjection<D> facet(master, p.master);
            REQUIRE(facet.closest(at.x, xi));
            REQUIRE(facet.outside(xi) <= 1e-12); // no cell crosses an edge of the master
            double M[BasisValues::max_nodes];
            master.ref.displacement.values(xi.data(), M);
            for (int b = 0; b < master.nu(); ++b)
              loads[master.local[p.master * master.nu() + b]] += w * M[b];
          }
        const ParticleRule rule = gauss<D>(5);
        double whole = 0;
        for (int g = 0; g < master.size(); ++g)
          for (int half = 0; half < (other.shape == Shape::quadrilateral ? 2 : 1); ++half)
            for (int p = 0; p < rule.size(); ++p)
            {
              Vector<D - 1> xi = Eigen::Map<const Vector<D - 1>>(&rule.points[p * (D - 1)]);
              if (half)
                xi = Vector<D - 1>::Ones() - xi;
              const double w = rule.weights[p]
                               * FacetProjection<D>(master, g).at(xi, false).area_vector().norm();
              double M[BasisValues::max_nodes];
              master.ref.displacement.values(xi.data(), M);
              for (int b = 0; b < master.nu(); ++b)
                exact[master.local[g * master.nu() + b]] += w * M[b];
              whole += w;
            }
        const bool polynomial = disorder == 0 or other.shape != Shape::quadrilateral;
        CAPTURE(element.text(), other.text(), disorder);
        // the area of the refinement is that of the overlap
        REQUIRE(area == Approx(whole).epsilon(1e-12));
        const double error = (loads - exact).template lpNorm<Eigen::Infinity>()
                             / exact.template lpNorm<Eigen::Infinity>();
        // elsewhere basis functions are no polynomials of the position: 9² points to a triangle
        REQUIRE(error <= (polynomial ? 1e-12 : 1e-8));
      }
    }
}

TEST_CASE("segments: facets that face away, far ones and nearer ones")
{
  std::mt19937 random(6);
  const Element quad{Shape::quadrilateral, 1, 1};
  const Surface slave = tile<3>(quad, 1, 0, 1, 1, 0, 0, random);
  const Segments<3> segments(gauss<3>(2));
  auto masters = [&](const Surface& master, double reach)
  {
    std::vector<int> out;
    for (const auto& p :
         segments.points(slave, 0, master, all(master), Vector<3>::Zero(), reach).points)
      out.push_back(p.master);
    return out;
  };
  const Surface below = tile<3>(quad, 2, 0, 1, -1, -0.1, 0, random);
  const std::vector<int> cells = masters(below, 1);
  for (int g = 0; g < 4; ++g)
    REQUIRE(std::count(cells.begin(), cells.end(), g) == 8); // two triangles of four points
  REQUIRE(masters(below, 0.05) == std::vector<int>(8, -1));
  REQUIRE(masters(tile<3>(quad, 2, 0, 1, 1, -0.1, 0, random), 1) == std::vector<int>(8, -1));

  // two plates, one behind the other: the nearer one counts
  const Surface both = build<3>(
      quad.ref(),
      [&]
      {
        Cells two;
        add_square(two, Shape::quadrilateral, 1, {0, 0, -0.3}, {1, 0, 0}, {0, 1, 0});
        add_square(two, Shape::quadrilateral, 1, {0.5, 0, -0.1}, {1, 0, 0}, {0, 1, 0});
        return two;
      }(),
      [](const Eigen::Vector3d& p) { return p; },
      [](const Vector<3>&) { return Vector<3>(0, 0, -1); }, random);
  double near = 0, far = 0;
  for (const auto& p : segments.points(slave, 0, both, all(both), Vector<3>::Zero(), 1).points)
    (p.master == 1 ? near : far) += p.weight;
  REQUIRE(near == Approx(0.5).epsilon(1e-14));
  REQUIRE(far == Approx(0.5).epsilon(1e-14));
}

TEMPLATE_TEST_CASE_SIG("segments: places and weights vary with the corners as differences say", "",
                       ((int D), D), 2, 3)
{
  std::mt19937 random(7);
  int compared = 0;
  for (const Element& element : elements<D>())
    for (const Element& other : elements<D>())
      for (int i = 0; i < 8; ++i)
      {
        if (element.position != 1 or other.position != 1)
          continue;                  // cells know corners only
        const bool regular = i >= 6; // parallelograms where κ = 0, but not δκ
        Surface slave = tile<D>(element, 2, 0, 1, 1, 0, regular ? 0 : 0.2, random);
        Surface master = tile<D>(other, 3, i % 2 ? 0.2 : -0.3, 1.2, -1, -0.01, 0.2, random);
        const Vector<D> direction
            = i % 3 == 0
                  ? Vector<D>(Vector<D>::Unit(D - 1) + 0.3 * uniform_vector<D>(random, -1, 1))
                  : Vector<D>(Vector<D>::Zero());
        const std::vector<double> us = random_displacement(slave, regular ? 0 : 0.05, random),
                                  um = random_displacement(master, 0.05, random),
                                  vs = random_displacement(slave, 1, random),
                                  vm = random_displacement(master, 1, random);
        const Segments<D> segments(gauss<D>(2));
        auto at = [&](int f, double size, bool motion)
        {
          auto moved = [&](const std::vector<double>& u, const std::vector<double>& v)
          {
            std::vector<double> w(u);
            for (std::size_t k = 0; k < w.size(); ++k)
              w[k] += size * v[k];
            return w;
          };
          slave.displace(moved(us, vs));
          master.displace(moved(um, vm));
          return segments.points(slave, f, master, all(master), direction, 1, motion);
        };
        for (int f = 0; f < slave.size(); ++f)
        {
          constexpr double h = 1e-6;
          const auto low = at(f, -h, false).points, high = at(f, h, false).points;
          const CellPoints<D> here = at(f, 0, true);
          REQUIRE(here.motion.rows() == D * static_cast<int>(here.points.size()));
          if (low.size() != here.points.size() or high.size() != here.points.size())
            continue; // a cell appears or goes
          std::vector<double> v;
          auto add = [&](const Surface& s, int g, const std::vector<double>& values)
          {
            for (int c = 0; c < s.nv(); ++c)
              v.insert(v.end(), values.begin() + s.local[g * s.nu() + c] * D,
                       values.begin() + (s.local[g * s.nu() + c] + 1) * D);
          };
          add(slave, f, vs);
          for (int g : here.facets)
            add(master, g, vm);
          const Eigen::Map<const Eigen::VectorXd> along(v.data(), v.size());
          for (std::size_t p = 0; p < here.points.size(); ++p)
          {
            const Eigen::VectorXd change = here.motion.template middleRows<D>(D * p) * along;
            Eigen::VectorXd fd(D);
            fd[0] = (high[p].weight - low[p].weight) / (2 * h * here.points[p].weight);
            fd.tail(D - 1) = (high[p].xi - low[p].xi) / (2 * h);
            // slivers are ill-conditioned; jumps tell that a cell has other corners than before
            if (here.points[p].weight < 1e-4 or fd.norm() > 1e3)
              continue;
            REQUIRE((change - fd).norm() <= 1e-5 * (1 + fd.norm()));
            ++compared;
          }
        }
      }
  REQUIRE(compared > 40);
}
