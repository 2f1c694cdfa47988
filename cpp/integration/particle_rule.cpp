// SPDX-License-Identifier: MIT
#include "particle_rule.h"

#include <map>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace dolfinx_contact
{

namespace
{

// Simpson's weights at the 2^(n+1) + 1 points of [0, 1], in units of the point spacing / 3
std::vector<double> simpson_line(int n)
{
  const int parts = 1 << n;
  std::vector<double> w(2 * parts + 1, 0.0);
  for (int i = 0; i < parts; ++i)
  {
    w[2 * i] += 1.0 / (6 * parts);
    w[2 * i + 1] += 4.0 / (6 * parts);
    w[2 * i + 2] += 1.0 / (6 * parts);
  }
  return w;
}

// The 7-point rule on 4ⁿ similar triangles. Points are counted in sixths of a part, so that merging
// compares integers.
ParticleRule simpson_triangle(int n)
{
  const int parts = 1 << n;
  std::map<std::pair<int, int>, double> merged; // (η, ξ): rows along ξ
  auto add = [&](int i, int j, double w) { merged[{j, i}] += w / (2 * parts * parts); };
  auto part = [&](const int(&v)[3][2])
  {
    int cx = 0, cy = 0;
    for (int k = 0; k < 3; ++k)
    {
      const auto& a = v[k];
      const auto& b = v[(k + 1) % 3];
      add(6 * a[0], 6 * a[1], 1.0 / 20);
      add(3 * (a[0] + b[0]), 3 * (a[1] + b[1]), 2.0 / 15);
      cx += 2 * a[0];
      cy += 2 * a[1];
    }
    add(cx, cy, 9.0 / 20);
  };
  for (int i = 0; i < parts; ++i)
    for (int j = 0; i + j < parts; ++j)
    {
      part({{i, j}, {i + 1, j}, {i, j + 1}});
      if (i + j + 1 < parts)
        part({{i + 1, j}, {i + 1, j + 1}, {i, j + 1}});
    }
  ParticleRule rule;
  for (auto& [point, w] : merged)
  {
    rule.points.push_back(point.second / (6.0 * parts));
    rule.points.push_back(point.first / (6.0 * parts));
    rule.weights.push_back(w);
  }
  return rule;
}

template <int D>
double measure(const Surface& s, int f, const BasisValues& b, bool axisymmetric)
{
  const FacetPoint<D> p = evaluate<D>(s.facet_X(f), s.np(), b, false);
  return p.area_vector().norm() * (axisymmetric ? 2 * std::numbers::pi * p.x[0] : 1.0);
}

} // namespace

double reference_measure(const Surface& s, int f, const BasisValues& b, bool axisymmetric)
{
  return s.dim == 2 ? measure<2>(s, f, b, axisymmetric) : measure<3>(s, f, b, axisymmetric);
}

ParticleRule simpson(Shape shape, int n)
{
  if (n < 0 or n > 6)
    throw std::invalid_argument("Simpson(" + std::to_string(n) + "): n must be from 0 to 6");
  if (shape == Shape::triangle)
    return simpson_triangle(n);

  const std::vector<double> w = simpson_line(n);
  const int m = static_cast<int>(w.size());
  ParticleRule rule;
  if (shape == Shape::interval)
  {
    rule.weights = w;
    for (int i = 0; i < m; ++i)
      rule.points.push_back(i / double(m - 1));
  }
  else
  {
    for (int j = 0; j < m; ++j)
      for (int i = 0; i < m; ++i)
      {
        rule.points.push_back(i / double(m - 1));
        rule.points.push_back(j / double(m - 1));
        rule.weights.push_back(w[i] * w[j]);
      }
  }
  return rule;
}

std::vector<double> particle_weights(const Surface& surface, const ParticleRule& rule,
                                     bool axisymmetric)
{
  const int q = facet_dim(surface.ref.shape), n = rule.size();
  std::vector<double> out(static_cast<std::size_t>(surface.size()) * n);
  BasisValues b;
  for (int p = 0; p < n; ++p)
  {
    surface.ref.position.tabulate(&rule.points[p * q], b);
    for (int f = 0; f < surface.size(); ++f)
      out[static_cast<std::size_t>(f) * n + p]
          = rule.weights[p] * reference_measure(surface, f, b, axisymmetric);
  }
  return out;
}

std::vector<double> lumped_weights(const Surface& surface, const TraceBasis& psi,
                                   const ParticleRule& fine, bool axisymmetric)
{
  const int q = facet_dim(surface.ref.shape), n = psi.nodes();
  const std::vector<double> w = particle_weights(surface, fine, axisymmetric);
  std::vector<double> out(static_cast<std::size_t>(surface.size()) * n, 0.0);
  std::vector<double> values(n);
  for (int p = 0; p < fine.size(); ++p)
  {
    psi.values(&fine.points[p * q], values.data());
    for (int f = 0; f < surface.size(); ++f)
      for (int a = 0; a < n; ++a)
        out[static_cast<std::size_t>(f) * n + a]
            += values[a] * w[static_cast<std::size_t>(f) * fine.size() + p];
  }
  return out;
}

} // namespace dolfinx_contact
