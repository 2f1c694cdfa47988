// SPDX-License-Identifier: MIT
//
// Surfaces for the tests, built without Basix or DOLFINx: bases by inverting a Vandermonde matrix,
// facets by mapping cells of a parameter domain.
#pragma once

#include "../targets/search.h"

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

namespace dolfinx_contact::test
{

constexpr double eps = std::numeric_limits<double>::epsilon();
using Points = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Uniform on [a, b], the same numbers everywhere.
inline double uniform(std::mt19937& random, double a, double b)
{
  return a + (b - a) * random() / 4294967296.0;
}

template <int N>
Vector<N> uniform_vector(std::mt19937& random, double a, double b)
{
  Vector<N> v;
  for (int i = 0; i < N; ++i)
    v[i] = uniform(random, a, b);
  return v;
}

inline std::string name(Shape shape)
{
  return shape == Shape::interval ? "interval" : shape == Shape::triangle ? "triangle" : "quad";
}

// --- reference facets -----------------------------------------------------------------------

/// Vertices of a reference facet, (nv, facet dimension).
inline Points corners(Shape shape)
{
  Points v(num_vertices(shape), facet_dim(shape));
  for (int a = 0; a < v.rows(); ++a)
    for (int i = 0; i < v.cols(); ++i)
      v(a, i) = reference_vertex(shape, a)[i];
  return v;
}

/// Lagrange nodes in Basix's order: vertices, mid-edges, centre (quadrilaterals).
inline Points lagrange_nodes(Shape shape, int degree)
{
  const Points v = corners(shape);
  std::vector<Eigen::RowVectorXd> rows;
  for (int a = 0; a < v.rows(); ++a)
    rows.push_back(v.row(a));
  if (degree == 2 and shape == Shape::interval)
    rows.push_back(0.5 * (v.row(0) + v.row(1)));
  else if (degree == 2)
  {
    for (int e = 0; e < num_edges(shape); ++e)
    {
      const auto [a, b] = reference_edge(shape, e);
      rows.push_back(0.5 * (v.row(a) + v.row(b)));
    }
    if (shape == Shape::quadrilateral)
      rows.push_back(v.colwise().mean());
  }
  Points nodes(rows.size(), v.cols());
  for (std::size_t a = 0; a < rows.size(); ++a)
    nodes.row(a) = rows[a];
  return nodes;
}

/// Exponents of the monomials: total degree on triangles, degree per direction otherwise.
inline std::vector<std::int32_t> powers(Shape shape, int degree)
{
  std::vector<std::int32_t> p;
  if (shape == Shape::interval)
    for (int i = 0; i <= degree; ++i)
      p.push_back(i);
  else
    for (int j = 0; j <= degree; ++j)
      for (int i = 0; i <= (shape == Shape::triangle ? degree - j : degree); ++i)
        p.insert(p.end(), {i, j});
  return p;
}

/// Σ_k C_ak m_k(x_b) = δ_ab at the nodes x_b: C = V⁻ᵀ with V_bk = m_k(x_b).
inline TraceBasis lagrange(Shape shape, int degree)
{
  const Points x = lagrange_nodes(shape, degree);
  const std::vector<std::int32_t> p = powers(shape, degree);
  const int q = facet_dim(shape), n = static_cast<int>(x.rows());
  Eigen::MatrixXd V = Eigen::MatrixXd::Ones(n, n);
  for (int b = 0; b < n; ++b)
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < q; ++i)
        V(b, k) *= std::pow(x(b, i), p[k * q + i]);
  const Points C = V.inverse().transpose();
  return TraceBasis(q, p, std::span(C.data(), n * n));
}

/// Bernstein polynomials at ξ, in any order (only their hull counts).
inline Eigen::RowVectorXd bernstein(Shape shape, int degree, const Eigen::RowVectorXd& xi)
{
  auto line = [degree](double t)
  {
    Eigen::RowVectorXd b(degree + 1);
    if (degree == 1)
      b << 1 - t, t;
    else
      b << (1 - t) * (1 - t), 2 * t * (1 - t), t * t;
    return b;
  };
  if (shape == Shape::interval)
    return line(xi[0]);
  const int d = degree + 1;
  Eigen::RowVectorXd b(shape == Shape::triangle ? d * (d + 1) / 2 : d * d);
  if (shape == Shape::triangle)
  {
    const double s = xi[0], t = xi[1], r = 1 - s - t;
    if (degree == 1)
      b << r, s, t;
    else
      b << r * r, s * s, t * t, 2 * r * s, 2 * r * t, 2 * s * t;
  }
  else
    for (int j = 0, k = 0; j <= degree; ++j)
      for (int i = 0; i <= degree; ++i)
        b[k++] = line(xi[0])[i] * line(xi[1])[j];
  return b;
}

/// ∫ (∂_1 N_a ∂_2 N_b − ∂_2 N_a ∂_1 N_b) dξ by 4 × 4 Gauss points (collapsed on triangles).
inline std::vector<double> area_weights(Shape shape, const TraceBasis& basis)
{
  const double a = std::sqrt(3.0 / 7 - 2.0 / 7 * std::sqrt(1.2)),
               b = std::sqrt(3.0 / 7 + 2.0 / 7 * std::sqrt(1.2));
  const double point[4] = {(1 - b) / 2, (1 - a) / 2, (1 + a) / 2, (1 + b) / 2};
  const double heavy = (18 + std::sqrt(30.0)) / 72, light = (18 - std::sqrt(30.0)) / 72;
  const double weight[4] = {light, heavy, heavy, light};
  const int n = basis.nodes();
  std::vector<double> W(n * n, 0.0);
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
    {
      const bool triangle = shape == Shape::triangle;
      const double rest = triangle ? 1 - point[j] : 1.0, xi[2] = {point[i] * rest, point[j]};
      BasisValues v;
      basis.tabulate(xi, v);
      for (int p = 0; p < n; ++p)
        for (int q = 0; q < n; ++q)
          W[p * n + q]
              += weight[i] * weight[j] * rest * (v.dN[0][p] * v.dN[1][q] - v.dN[1][p] * v.dN[0][q]);
    }
  return W;
}

inline ReferenceFacet reference_facet(Shape shape, int position, int displacement)
{
  ReferenceFacet ref{shape, lagrange(shape, position), lagrange(shape, displacement), {}, {}, {}};
  const Points nodes = lagrange_nodes(shape, position);
  const int np = ref.position.nodes(), nu = ref.displacement.nodes();
  Points at(np, nu);
  Eigen::MatrixXd B(np, np);
  for (int a = 0; a < np; ++a)
  {
    const Eigen::RowVectorXd xi = nodes.row(a);
    ref.displacement.values(xi.data(), at.row(a).data());
    B.row(a) = bernstein(shape, position, xi);
  }
  const Points hull = B.inverse();
  ref.interpolation.assign(at.data(), at.data() + at.size());
  ref.hull.assign(hull.data(), hull.data() + hull.size());
  if (facet_dim(shape) == 2)
    ref.area = area_weights(shape, ref.position);
  return ref;
}

/// Shape with the degrees of its position and its displacement basis.
struct Element
{
  Shape shape;
  int position, displacement;

  int dim() const { return facet_dim(shape) + 1; }
  ReferenceFacet ref() const { return reference_facet(shape, position, displacement); }
  std::string text() const
  {
    return name(shape) + ", degrees " + std::to_string(position) + " and "
           + std::to_string(displacement);
  }
};

/// All elements of space dimension D.
template <int D>
std::vector<Element> elements()
{
  std::vector<Element> out;
  for (Shape shape : {Shape::interval, Shape::triangle, Shape::quadrilateral})
    if (facet_dim(shape) == D - 1)
      for (auto [p, u] : {std::array{1, 1}, {2, 2}, {2, 1}})
        out.push_back({shape, p, u});
  return out;
}

// --- surfaces -------------------------------------------------------------------------------

/// Cells of a parameter domain, each by its corners in R³ (Basix's order).
using Cells = std::vector<std::vector<Eigen::Vector3d>>;

/// n equal parts of [0, 1].
inline Cells line_cells(int n)
{
  Cells cells;
  for (int i = 0; i < n; ++i)
    cells.push_back({{i / double(n), 0, 0}, {(i + 1) / double(n), 0, 0}});
  return cells;
}

/// A square with corner `o` and sides `a`, `b`, cut into n × n quadrilaterals or 2 n² triangles.
inline void add_square(Cells& cells, Shape shape, int n, const Eigen::Vector3d& o,
                       const Eigen::Vector3d& a, const Eigen::Vector3d& b)
{
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i)
    {
      const Eigen::Vector3d v[4]
          = {o + (i * a + j * b) / n, o + ((i + 1) * a + j * b) / n, o + (i * a + (j + 1) * b) / n,
             o + ((i + 1) * a + (j + 1) * b) / n};
      if (shape == Shape::quadrilateral)
        cells.push_back({v[0], v[1], v[2], v[3]});
      else
      {
        cells.push_back({v[0], v[1], v[2]});
        cells.push_back({v[3], v[2], v[1]});
      }
    }
}

inline Cells square_cells(Shape shape, int n)
{
  Cells cells;
  add_square(cells, shape, n, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  return cells;
}

/// The six sides of the cube [−1, 1]³.
inline Cells cube_cells(Shape shape, int n)
{
  Cells cells;
  for (int k = 0; k < 3; ++k)
    for (double side : {-1.0, 1.0})
    {
      Eigen::Vector3d o = Eigen::Vector3d::Constant(-1), a = o, b = o;
      o[k] = side;
      a = 2 * Eigen::Vector3d::Unit((k + 1) % 3);
      b = 2 * Eigen::Vector3d::Unit((k + 2) % 3);
      add_square(cells, shape, n, o, a, b);
    }
  return cells;
}

/// A surface over `cells`, whose corners come in any order that keeps the cell.
///
/// Nodes with the same position get the same number; facets are numbered neither contiguously nor
/// in their order; edges with one facet only are physical ends.
/// @param map parameters to space
/// @param inward the side of the body, not normal to the surface
template <int D>
Surface build(const ReferenceFacet& ref, const Cells& cells,
              const std::function<Vector<D>(const Eigen::Vector3d&)>& map,
              const std::function<Vector<D>(const Vector<D>&)>& inward, std::mt19937& random)
{
  Surface s;
  s.dim = D;
  s.ref = ref;
  const Shape shape = ref.shape;
  const int q = D - 1, nv = num_vertices(shape), nu = ref.displacement.nodes();
  const TraceBasis linear = lagrange(shape, 1);
  const Points nodes = lagrange_nodes(shape, ref.position.degree());
  std::map<std::array<long, D>, std::int64_t> numbers;            // rounded position -> node
  std::map<std::pair<std::int64_t, std::int64_t>, int> facets_at; // edge -> facets
  auto edge = [&](int f, int e)
  {
    const auto v = reference_edge(shape, e);
    return std::minmax({s.vertices[f * nv + v[0]], s.vertices[f * nv + v[1]]});
  };
  for (std::size_t f = 0; f < cells.size(); ++f)
  {
    std::vector<Eigen::Vector3d> corner = cells[f];
    if (random() % 2) // mirror
      std::swap(corner[shape == Shape::interval ? 0 : 1], corner[shape == Shape::interval ? 1 : 2]);
    for (int turn = random() % nv; turn > 0 and q == 2; --turn)
      corner = nv == 3 ? std::vector{corner[1], corner[2], corner[0]}
                       : std::vector{corner[1], corner[3], corner[0], corner[2]};
    for (int a = 0; a < nodes.rows(); ++a)
    {
      double N[4];
      const Eigen::RowVectorXd xi = nodes.row(a);
      linear.values(xi.data(), N);
      Eigen::Vector3d parameter = Eigen::Vector3d::Zero();
      for (int v = 0; v < nv; ++v)
        parameter += N[v] * corner[v];
      const Vector<D> x = map(parameter);
      s.X.insert(s.X.end(), x.data(), x.data() + D);
      std::array<long, D> key;
      for (int i = 0; i < D; ++i)
        key[i] = std::lround(1e7 * x[i]);
      const std::int64_t n = static_cast<std::int64_t>(numbers.size());
      const std::int64_t node = 3 * numbers.emplace(key, n).first->second + 5;
      if (a < nv)
        s.vertices.push_back(node);
      if (a < nu)
        s.nodes.push_back(node);
    }
    s.id.push_back(static_cast<std::int64_t>(f * 389 % 1009 + 1000));
    s.candidate.push_back(1);
    for (int e = 0; e < num_edges(shape); ++e)
      ++facets_at[edge(f, e)];
  }
  s.number_nodes();
  const Eigen::VectorXd centre = corners(shape).colwise().mean();
  for (int f = 0; f < s.size(); ++f)
  {
    std::uint8_t ends = 0;
    for (int e = 0; e < num_edges(shape); ++e)
      ends |= (facets_at[edge(f, e)] == 1) << e;
    s.ends.push_back(ends);
    BasisValues b;
    ref.position.tabulate(centre.data(), b);
    const FacetPoint<D> p = evaluate<D>(s.facet_X(f), s.np(), b, false);
    s.sigma.push_back(p.area_vector().dot(inward(p.x)) > 0 ? 1 : -1);
  }
  return s;
}

/// Displacement of all nodes, uniform in [−amplitude, amplitude].
inline std::vector<double> random_displacement(const Surface& s, double amplitude,
                                               std::mt19937& random)
{
  std::vector<double> u(s.node_table.size() * s.dim);
  for (double& v : u)
    v = uniform(random, -amplitude, amplitude);
  return u;
}

/// One facet of unit size, its nodes moved at random by up to `amplitude`, all its edges ends.
template <int D>
Surface single_facet(const Element& element, double amplitude, std::mt19937& random)
{
  const Cells cells = {[&]
                       {
                         const Points v = corners(element.shape);
                         std::vector<Eigen::Vector3d> c(v.rows(), Eigen::Vector3d::Zero());
                         for (int a = 0; a < v.rows(); ++a)
                           c[a].head<D - 1>() = v.row(a).transpose();
                         return c;
                       }()};
  const double side = random() % 2 ? 1 : -1;
  return build<D>(
      element.ref(), cells,
      [&](const Eigen::Vector3d& p)
      {
        const Vector<D> flat = p.head<D>();
        return Vector<D>(flat + uniform_vector<D>(random, -amplitude, amplitude));
      },
      [&](const Vector<D>&) { return Vector<D>(side * Vector<D>::Unit(D - 1)); }, random);
}

/// The unit interval or square in n × n cells (triangles: halves of them), the body below.
template <int D>
Surface plate(
    const Element& element, int n, unsigned seed = 1,
    const std::function<Vector<D>(const Eigen::Vector3d&)>& map
    = [](const Eigen::Vector3d& p) { return Vector<D>(p.head<D>()); })
{
  std::mt19937 random(seed);
  return build<D>(
      element.ref(), D == 2 ? line_cells(n) : square_cells(element.shape, n), map,
      [](const Vector<D>&) { return Vector<D>(-Vector<D>::Unit(D - 1)); }, random);
}

/// Settings of the search with the rule alone.
template <int D>
SearchOptions<D> options(TargetRule rule)
{
  SearchOptions<D> o;
  o.rule = rule;
  return o;
}

/// A particle that looks down where a direction is asked for.
template <int D>
Seeker<D> seeker(TargetRule rule, const Vector<D>& x, const Vector<D>& outward)
{
  if (rule == TargetRule::direction)
    return {x, outward, -Vector<D>::Unit(D - 1)};
  return {x, outward};
}

/// Where a target is.
template <int D>
Vector<D> position(const Surface& s, const Target<D>& t)
{
  return FacetProjection<D>(s, t.facet).at(t.xi, false).x;
}

} // namespace dolfinx_contact::test
