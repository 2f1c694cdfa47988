// SPDX-License-Identifier: MIT
#include "surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace dolfinx_contact
{

void Surface::number_nodes()
{
  node_table = nodes;
  std::sort(node_table.begin(), node_table.end());
  node_table.erase(std::unique(node_table.begin(), node_table.end()), node_table.end());
  local.resize(nodes.size());
  std::transform(nodes.begin(), nodes.end(), local.begin(),
                 [this](std::int64_t n)
                 {
                   auto it = std::lower_bound(node_table.begin(), node_table.end(), n);
                   return static_cast<std::int32_t>(it - node_table.begin());
                 });
  x = x_old = X;
}

void Surface::place(std::span<const double> u, std::vector<double>& positions) const
{
  if (u.size() != node_table.size() * dim)
    throw std::invalid_argument("Surface: the displacement must have one row for each node");
  if (not std::all_of(u.begin(), u.end(), [](double v) { return std::isfinite(v); }))
    throw std::domain_error("the displacement of a contact surface is not finite");
  const int np = this->np(), nu = this->nu(), n = size();
  positions = X;
  for (int f = 0; f < n; ++f)
  {
    double* xf = &positions[static_cast<std::size_t>(f) * np * dim];
    const std::int32_t* row = &local[static_cast<std::size_t>(f) * nu];
    if (ref.isoparametric())
    {
      for (int a = 0; a < np; ++a)
        for (int i = 0; i < dim; ++i)
          xf[a * dim + i] += u[static_cast<std::size_t>(row[a]) * dim + i];
    }
    else
    {
      for (int a = 0; a < np; ++a)
        for (int b = 0; b < nu; ++b)
          for (int i = 0; i < dim; ++i)
            xf[a * dim + i]
                += ref.interpolation[a * nu + b] * u[static_cast<std::size_t>(row[b]) * dim + i];
    }
  }
}

std::vector<double> Surface::boxes(double margin) const
{
  std::vector<double> out(static_cast<std::size_t>(size()) * 2 * dim);
  for (int f = 0; f < size(); ++f)
    box(f, margin, &out[static_cast<std::size_t>(f) * 2 * dim]);
  return out;
}

void Surface::box(int f, double margin, double* out) const
{
  const int np = this->np();
  const bool straight = ref.position.degree() == 1;
  const double* xf = facet_x(f);
  for (int i = 0; i < dim; ++i)
  {
    double lo = INFINITY, hi = -INFINITY;
    for (int a = 0; a < np; ++a)
    {
      double c = 0; // Bernstein control point a
      if (straight)
        c = xf[a * dim + i];
      else
        for (int b = 0; b < np; ++b)
          c += ref.hull[a * np + b] * xf[b * dim + i];
      lo = std::min(lo, c);
      hi = std::max(hi, c);
    }
    out[i] = lo - margin;
    out[dim + i] = hi + margin;
  }
}

double Surface::diameter(int f) const
{
  double d2 = 0;
  std::array<double, 3> corner[4];
  for (int v = 0; v < nv(); ++v)
  {
    BasisValues b;
    ref.position.values(reference_vertex(ref.shape, v), b.N);
    corner[v] = {0, 0, 0};
    for (int a = 0; a < np(); ++a)
      for (int i = 0; i < dim; ++i)
        corner[v][i] += b.N[a] * facet_X(f)[a * dim + i];
    for (int w = 0; w < v; ++w)
    {
      double s = 0;
      for (int i = 0; i < dim; ++i)
        s += (corner[v][i] - corner[w][i]) * (corner[v][i] - corner[w][i]);
      d2 = std::max(d2, s);
    }
  }
  return std::sqrt(d2);
}

const double* reference_vertex(Shape shape, int v)
{
  static constexpr double interval[2][1] = {{0}, {1}};
  static constexpr double triangle[3][2] = {{0, 0}, {1, 0}, {0, 1}};
  static constexpr double quadrilateral[4][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  switch (shape)
  {
  case Shape::interval:
    return interval[v];
  case Shape::triangle:
    return triangle[v];
  default:
    return quadrilateral[v];
  }
}

std::array<int, 2> reference_edge(Shape shape, int e)
{
  static constexpr std::array<int, 2> interval[2] = {{0, 0}, {1, 1}};
  static constexpr std::array<int, 2> triangle[3] = {{1, 2}, {0, 2}, {0, 1}};
  static constexpr std::array<int, 2> quadrilateral[4] = {{0, 1}, {0, 2}, {1, 3}, {2, 3}};
  switch (shape)
  {
  case Shape::interval:
    return interval[e];
  case Shape::triangle:
    return triangle[e];
  default:
    return quadrilateral[e];
  }
}

} // namespace dolfinx_contact
