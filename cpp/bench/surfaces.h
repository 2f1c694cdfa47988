// SPDX-License-Identifier: MIT
//
// Surfaces for the benchmarks: two wavy grids on the same analytic surface, the slave pressed into
// the master by a twentieth of its facets' size. Nodes and facets are numbered at random, so that
// memory is touched as it is in an unstructured mesh.
#pragma once

#include "../integration/particle_rule.h"
#include "../targets/search.h"
#include "../test/facets.h"

#include <algorithm>
#include <benchmark/benchmark.h>
#include <functional>
#include <memory>
#include <string>

namespace dolfinx_contact::bench
{

using test::Element;

/// The elements that are measured: all shapes with degree 1 and 2.
template <int D>
std::vector<Element> elements()
{
  if constexpr (D == 2)
    return {{Shape::interval, 1, 1}, {Shape::interval, 2, 2}};
  else
    return {{Shape::quadrilateral, 1, 1},
            {Shape::triangle, 1, 1},
            {Shape::quadrilateral, 2, 2},
            {Shape::triangle, 2, 2}};
}

inline std::string name(const Element& e)
{
  return test::name(e.shape) + " P" + std::to_string(e.displacement);
}

/// Number of parts a direction of a grid that has about `facets` facets.
inline int parts(Shape shape, int facets)
{
  if (shape == Shape::interval)
    return facets;
  return std::lround(std::sqrt(shape == Shape::triangle ? 0.5 * facets : facets));
}

/// A surface over [lower, upper]^{D−1}, `height` above the analytic one.
/// @param up side of its body: +1 above, −1 below
template <int D>
Surface grid(const Element& element, int n, double lower, double upper, double height, double up,
             std::mt19937& random)
{
  test::Cells cells = D == 2 ? test::line_cells(n) : test::square_cells(element.shape, n);
  std::shuffle(cells.begin(), cells.end(), random);
  auto map = [&](const Eigen::Vector3d& parameter)
  {
    Vector<D> x = (lower + (upper - lower) * parameter.array()).matrix().template head<D>();
    x[D - 1] = height + 0.03 * std::sin(4 * x[0] + 1) * (D == 2 ? 1 : std::cos(3 * x[D - 2]));
    return x;
  };
  Surface s = test::build<D>(
      element.ref(), cells, map,
      [&](const Vector<D>&) { return Vector<D>(up * Vector<D>::Unit(D - 1)); }, random);

  std::iota(s.id.begin(), s.id.end(), 0);
  std::vector<std::int64_t> number(s.node_table.size());
  std::iota(number.begin(), number.end(), 0);
  std::shuffle(number.begin(), number.end(), random);
  auto renumber = [&](std::int64_t node)
  {
    const auto it = std::lower_bound(s.node_table.begin(), s.node_table.end(), node);
    return it == s.node_table.end() or *it != node ? node : number[it - s.node_table.begin()];
  };
  std::transform(s.nodes.begin(), s.nodes.end(), s.nodes.begin(), renumber);
  std::transform(s.vertices.begin(), s.vertices.end(), s.vertices.begin(), renumber);
  s.number_nodes();
  return s;
}

/// Slave, master and particles.
template <int D>
struct Pair
{
  Surface slave, master;
  ParticleRule rule;
  double size; ///< of a slave facet

  int particles() const { return slave.size() * rule.size(); }

  /// Displacement of the slave by `fraction` of a facet along the surface: the motion between two
  /// Newton iterations.
  std::vector<double> slide(double fraction) const
  {
    std::vector<double> u(slave.node_table.size() * D, 0.0);
    for (std::size_t i = 0; i < u.size(); i += D)
      for (int k = 0; k < D - 1; ++k)
        u[i + k] = fraction * size;
    return u;
  }
};

/// A pair with about `facets` facets on the slave and particles of n-Simpson. The master's facets
/// are larger by 1/0.77: 25 particles on a quadrilateral then meet about three targets, so that a
/// pair of facets has 8 particles.
template <int D>
Pair<D> pair(const Element& element, int facets, int simpson_n = 1)
{
  std::mt19937 random(5);
  const int n = parts(element.shape, facets), m = std::max(1, int(0.77 * n));
  const double size = 1.0 / n;
  return {grid<D>(element, n, 0, 1, -0.05 * size, 1, random),
          grid<D>(element, m, -size, 1 + size, 0, -1, random), simpson(element.shape, simpson_n),
          size};
}

/// Something made at its first use and shared by the benchmarks that hold a copy of this. Set-up
/// inside a benchmark would be repeated with each of its repetitions.
template <typename T>
class Once
{
public:
  explicit Once(std::function<std::unique_ptr<T>()> make)
      : _make(std::move(make))
      , _made(std::make_shared<std::unique_ptr<T>>())
  {
  }

  T& operator()() const
  {
    if (not *_made)
      *_made = _make();
    return **_made;
  }

private:
  std::function<std::unique_ptr<T>()> _make;
  std::shared_ptr<std::unique_ptr<T>> _made;
};

/// Report the time of one of the `n` things done in each iteration, in seconds.
inline void per(benchmark::State& state, const std::string& what, std::size_t n)
{
  using benchmark::Counter;
  state.counters["per " + what]
      = Counter(double(n), Counter::kIsIterationInvariantRate | Counter::kInvert);
}

/// Register a benchmark with five repetitions, of which main.cpp prints the fastest: the machine
/// may be shared.
inline void add(const std::string& name, const std::function<void(benchmark::State&)>& run)
{
  benchmark::RegisterBenchmark(name.c_str(), run)->Repetitions(5)->MinTime(0.1);
}

/// Likewise for 10³ to 10⁵ slave facets, state.range(0), with the exponent of the growth.
inline void add_sizes_of(const std::string& name, const std::function<void(benchmark::State&)>& run)
{
  benchmark::RegisterBenchmark(name.c_str(),
                               [=](benchmark::State& s)
                               {
                                 run(s);
                                 s.SetComplexityN(s.range(0));
                               })
      ->Arg(1000)
      ->Arg(10000)
      ->Arg(100000)
      ->Repetitions(5)
      ->MinTime(0.1)
      ->Complexity();
}

} // namespace dolfinx_contact::bench
