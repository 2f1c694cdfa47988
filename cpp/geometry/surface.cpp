// SPDX-License-Identifier: MIT
#include "surface.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace dolfinx_contact
{

namespace
{

/// Distinct numbers in order, and the place of each of `numbers` among them: with a bit for each
/// number from the least to the largest, in linear time, unless they lie too far apart.
void enumerate(std::span<const std::int64_t> numbers, std::vector<std::int64_t>& distinct,
               std::vector<std::int32_t>& place)
{
  distinct.clear();
  place.resize(numbers.size());
  if (numbers.empty())
    return;
  const auto [least, largest] = std::minmax_element(numbers.begin(), numbers.end());
  const auto from_least = [first = *least](std::int64_t n)
  { return static_cast<std::uint64_t>(n) - static_cast<std::uint64_t>(first); };
  const std::uint64_t words = from_least(*largest) / 64 + 1;
  if (words > 4 * numbers.size())
  {
    distinct.assign(numbers.begin(), numbers.end());
    std::sort(distinct.begin(), distinct.end());
    distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
    std::transform(numbers.begin(), numbers.end(), place.begin(),
                   [&](std::int64_t n)
                   {
                     auto it = std::lower_bound(distinct.begin(), distinct.end(), n);
                     return static_cast<std::int32_t>(it - distinct.begin());
                   });
    return;
  }
  std::vector<std::uint64_t> bits(words, 0);
  for (const std::int64_t n : numbers)
    bits[from_least(n) / 64] |= std::uint64_t(1) << from_least(n) % 64;
  std::vector<std::int32_t> before(words); // numbers in the words before
  std::int32_t count = 0;
  for (std::uint64_t w = 0; w < words; ++w)
  {
    before[w] = count;
    count += std::popcount(bits[w]);
  }
  distinct.reserve(count);
  for (std::uint64_t w = 0; w < words; ++w)
    for (std::uint64_t rest = bits[w]; rest != 0; rest &= rest - 1)
      distinct.push_back(*least + static_cast<std::int64_t>(64 * w + std::countr_zero(rest)));
  std::transform(numbers.begin(), numbers.end(), place.begin(),
                 [&](std::int64_t n)
                 {
                   const std::uint64_t w = from_least(n) / 64, bit = from_least(n) % 64;
                   const std::uint64_t lower = (std::uint64_t(1) << bit) - 1;
                   return before[w] + std::popcount(bits[w] & lower);
                 });
}

} // namespace

void Surface::number_nodes()
{
  enumerate(nodes, node_table, local);
  x = x_old = X;
}

FacetsAtNodes::FacetsAtNodes(const Surface& s)
    : _offset(s.node_table.size() + 1, 0)
    , _facets(s.local.size())
{
  for (const std::int32_t node : s.local)
    ++_offset[node + 1];
  std::partial_sum(_offset.begin(), _offset.end(), _offset.begin());
  std::vector<std::int32_t> end(_offset.begin(), _offset.end() - 1); // of what is filled
  for (std::size_t i = 0; i < s.local.size(); ++i)
    _facets[end[s.local[i]]++] = static_cast<std::int32_t>(i / s.nu());
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
