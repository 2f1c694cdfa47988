// SPDX-License-Identifier: MIT
// Every rank builds the whole surface, so brute force on it says what the exchange must bring.
#include "../parallel/exchange.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <mpi.h>
#include <numbers>
#include <set>
#include <string>

using namespace dolfinx_contact;

namespace
{

int comm_rank()
{
  int rank;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank;
}

int comm_size()
{
  int size;
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  return size;
}

// A REQUIRE that fails on one rank only would leave the others waiting: decide together.
bool everywhere(bool here)
{
  int all = here;
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
  return all;
}

// Numbers that are neither contiguous nor in the order of the facets
std::int64_t facet_id(int f)
{
  return (f * 37LL) % 1009 + 5000000000LL;
}
std::int64_t vertex_number(int v)
{
  return 3 * v + 1;
}
std::int64_t node_number(int v)
{
  return (v * 61LL) % 2003;
}

// nx × ny bilinear quadrilaterals on [0, nx] × [0, ny], z = 0
Surface grid(int nx, int ny)
{
  Surface s;
  s.dim = 3;
  s.ref.shape = Shape::quadrilateral;
  const std::vector<std::int32_t> powers = {0, 0, 1, 0, 0, 1, 1, 1};
  const std::vector<double> c = {1, -1, -1, 1, 0, 1, 0, -1, 0, 0, 1, -1, 0, 0, 0, 1};
  s.ref.position = s.ref.displacement = TraceBasis(2, powers, c);
  for (int f = 0; f < nx * ny; ++f)
  {
    s.id.push_back(facet_id(f));
    s.sigma.push_back(f % 3 == 0 ? -1 : 1);
    for (int k = 0; k < 4; ++k)
    {
      const int i = f % nx + k % 2, j = f / nx + k / 2, v = j * (nx + 1) + i;
      s.vertices.push_back(vertex_number(v));
      s.nodes.push_back(node_number(v));
      s.X.insert(s.X.end(), {double(i), double(j), 0});
    }
  }
  return s;
}

// n arcs of the unit circle, quadratic in position and linear in displacement (np ≠ nu), every
// second one reversed; closed, or open at angle 0: a quarter of the circle is left out
Surface ring_of_arcs(int n, bool closed)
{
  Surface s;
  s.dim = 2;
  s.ref.shape = Shape::interval;
  const std::vector<std::int32_t> linear = {0, 1}, quadratic = {0, 1, 2};
  s.ref.displacement = TraceBasis(1, linear, std::vector<double>{1, -1, 0, 1});
  s.ref.position = TraceBasis(1, quadratic, std::vector<double>{1, -3, 2, 0, -1, 2, 0, 4, -4});
  s.ref.interpolation = {1, 0, 0, 1, 0.5, 0.5};
  s.ref.hull = {1, 0, 0, 0, 1, 0, -0.5, -0.5, 2};
  const double step = 2 * std::numbers::pi * (closed ? 1 : 0.75) / n;
  for (int f = 0; f < n; ++f)
  {
    const int a = f % 2 ? f + 1 : f, b = f % 2 ? f : f + 1;
    s.id.push_back(facet_id(f));
    s.sigma.push_back(f % 2 ? -1 : 1);
    for (const int v : {a, b})
    {
      s.vertices.push_back(vertex_number(closed ? v % n : v));
      s.nodes.push_back(node_number(closed ? v % n : v));
    }
    for (const double angle : {step * a, step * b, step * (f + 0.5)})
      s.X.insert(s.X.end(), {std::cos(angle), std::sin(angle)});
  }
  return s;
}

struct Case
{
  std::string name;
  Surface whole;
};

std::vector<Case> cases()
{
  return {{"grid", grid(9, 7)},
          {"closed polygon", ring_of_arcs(24, true)},
          {"open polyline", ring_of_arcs(20, false)}};
}

// Which rank owns item i of n
struct Distribution
{
  std::string name;
  std::function<int(int, int)> owner;
};

std::vector<Distribution> distributions()
{
  const int size = comm_size();
  return {{"stripes", [=](int i, int n) { return int(i * std::int64_t(size) / n); }},
          {"round robin", [=](int i, int) { return i % size; }},
          {"scattered", [=](int i, int) { return (i * 7919 / 16) % size; }},
          {"all on the last", [=](int, int) { return size - 1; }}};
}

Surface part(const Surface& s, const std::vector<int>& facets)
{
  Surface out;
  out.dim = s.dim;
  out.ref = s.ref;
  for (const int f : facets)
  {
    out.id.push_back(s.id[f]);
    out.sigma.push_back(s.sigma[f]);
    for (int v = 0; v < s.nv(); ++v)
      out.vertices.push_back(s.vertices[f * s.nv() + v]);
    for (int v = 0; v < s.nu(); ++v)
      out.nodes.push_back(s.nodes[f * s.nu() + v]);
    out.X.insert(out.X.end(), s.facet_X(f), s.facet_X(f) + s.np() * s.dim);
  }
  return out;
}

std::vector<int> owned(int n, const Distribution& d)
{
  std::vector<int> facets;
  for (int f = 0; f < n; ++f)
    if (d.owner(f, n) == comm_rank())
      facets.push_back(f);
  return facets;
}

bool share_vertex(const Surface& s, int f, int g)
{
  for (int i = 0; i < s.nv(); ++i)
    for (int j = 0; j < s.nv(); ++j)
      if (s.vertices[f * s.nv() + i] == s.vertices[g * s.nv() + j])
        return true;
  return false;
}

// The facets and those that share a vertex with one of them
std::set<int> with_neighbours(const Surface& s, const std::vector<int>& facets)
{
  std::set<int> out;
  for (const int f : facets)
    for (int g = 0; g < s.size(); ++g)
      if (share_vertex(s, f, g))
        out.insert(g);
  return out;
}

std::set<std::int64_t> ids(const Surface& s, const std::set<int>& facets)
{
  std::set<std::int64_t> out;
  for (const int f : facets)
    out.insert(s.id[f]);
  return out;
}

// By brute force: all other facets are asked
std::vector<std::uint8_t> ends_of(const Surface& s)
{
  std::vector<std::uint8_t> ends(s.size(), 0);
  for (int f = 0; f < s.size(); ++f)
    for (int e = 0; e < num_edges(s.ref.shape); ++e)
    {
      const auto [i, j] = reference_edge(s.ref.shape, e);
      int facets = 0;
      for (int g = 0; g < s.size(); ++g)
      {
        const auto begin = s.vertices.begin() + g * s.nv(), end = begin + s.nv();
        facets += std::find(begin, end, s.vertices[f * s.nv() + i]) != end
                  and std::find(begin, end, s.vertices[f * s.nv() + j]) != end;
      }
      if (facets == 1)
        ends[f] |= 1 << e;
    }
  return ends;
}

// Facet f of `s` is the facet of `whole` with its id, in all that travels
bool is_faithful(const Surface& s, const Surface& whole, const std::vector<std::uint8_t>& ends)
{
  std::map<std::int64_t, int> position;
  for (int g = 0; g < whole.size(); ++g)
    position[whole.id[g]] = g;
  for (int f = 0; f < s.size(); ++f)
  {
    const auto found = position.find(s.id[f]);
    if (found == position.end())
      return false;
    const int g = found->second, nv = s.nv(), nu = s.nu(), nx = s.np() * s.dim;
    if (s.sigma[f] != whole.sigma[g] or s.ends[f] != ends[g]
        or not std::equal(&s.vertices[f * nv], &s.vertices[f * nv] + nv, &whole.vertices[g * nv])
        or not std::equal(&s.nodes[f * nu], &s.nodes[f * nu] + nu, &whole.nodes[g * nu])
        or not std::equal(&s.X[f * nx], &s.X[f * nx] + nx, &whole.X[g * nx]))
      return false;
  }
  return s.x == s.X and s.local.size() == s.nodes.size();
}

// A displacement that depends on the node's number only, so on no partition
void move(Surface& s)
{
  std::vector<double> u(s.node_table.size() * s.dim);
  for (std::size_t i = 0; i < s.node_table.size(); ++i)
    for (int k = 0; k < s.dim; ++k)
      u[i * s.dim + k] = 0.2 * std::sin(1.3 * s.node_table[i] + k);
  s.displace(u);
}

// Small boxes over a part of the surface, so that some facets are far from all of them
std::vector<double> slave_boxes_near(const Surface& whole)
{
  std::vector<double> boxes;
  for (int i = 0; i < 11; ++i)
    if (whole.dim == 3)
    {
      const double x = 0.35 * i, y = 1.5 + 0.3 * (i % 5), z = 0.5;
      boxes.insert(boxes.end(), {x, y, z, x + 0.3, y + 0.2, z + 0.1});
    }
    else
    {
      const double x = 0.9 * std::cos(0.2 * i), y = 0.9 * std::sin(0.2 * i);
      boxes.insert(boxes.end(), {x, y, x + 0.02, y + 0.02});
    }
  return boxes;
}

std::vector<double> owned_boxes(const std::vector<double>& boxes, int dim, const Distribution& d)
{
  const int n = static_cast<int>(boxes.size()) / (2 * dim);
  std::vector<double> out;
  for (const int i : owned(n, d))
    out.insert(out.end(), &boxes[i * 2 * dim], &boxes[i * 2 * dim] + 2 * dim);
  return out;
}

// Squared distance of the boxes of facet f and of a slave
double distance2(const std::vector<double>& boxes, int f, const double* slave, int dim)
{
  double d2 = 0;
  for (int k = 0; k < dim; ++k)
  {
    const double lo = boxes[f * 2 * dim + k], hi = boxes[(f * 2 + 1) * dim + k];
    const double d = std::max({lo - slave[dim + k], slave[k] - hi, 0.0});
    d2 += d * d;
  }
  return d2;
}

// Facets of `whole` (in its current position) whose box is within reach of a slave box
std::vector<int> targets(const Surface& whole, const std::vector<double>& slaves,
                         const std::vector<double>& reach)
{
  const std::vector<double> boxes = whole.boxes();
  std::vector<int> out;
  for (int f = 0; f < whole.size(); ++f)
  {
    bool near = false;
    for (std::size_t s = 0; s < reach.size(); ++s)
      near = near
             or distance2(boxes, f, &slaves[s * 2 * whole.dim], whole.dim) <= reach[s] * reach[s];
    if (near)
      out.push_back(f);
  }
  return out;
}

// A reach for each slave box, that depends on where it is only
std::vector<double> reaches(const std::vector<double>& slaves, int dim, double radius)
{
  std::vector<double> out;
  for (std::size_t s = 0; s < slaves.size(); s += 2 * dim)
    out.push_back(radius * (std::isinf(radius) ? 1 : 1 + 0.2 * std::sin(5 * slaves[s])));
  return out;
}

} // namespace

TEST_CASE("with_ring brings exactly the facets that share a vertex", "[exchange]")
{
  for (const auto& [name, whole] : cases())
    for (const auto& d : distributions())
    {
      INFO(name << ", " << d.name);
      const std::vector<int> mine = owned(whole.size(), d);
      const Surface own = part(whole, mine);
      const Surface s = with_ring(MPI_COMM_WORLD, own);

      REQUIRE(everywhere(s.size() >= own.size()));
      CHECK(std::equal(own.id.begin(), own.id.end(), s.id.begin()));
      for (int f = 0; f < s.size(); ++f)
        CHECK(int(s.candidate[f]) == (f < own.size()));
      const std::set<std::int64_t> here(s.id.begin(), s.id.end());
      CHECK(here.size() == s.id.size()); // nothing twice
      CHECK(here == ids(whole, with_neighbours(whole, mine)));
      CHECK(is_faithful(s, whole, ends_of(whole)));
    }
}

TEST_CASE("with_ring finds the physical ends", "[exchange]")
{
  // Analytically: the four sides of the grid, none of the closed polygon, two of the polyline
  auto expected = [](const std::string& name, int f)
  {
    if (name == "grid")
      return (f / 9 == 0 ? 1 : 0) | (f % 9 == 0 ? 2 : 0) | (f % 9 == 8 ? 4 : 0)
             | (f / 9 == 6 ? 8 : 0);
    if (name == "open polyline") // its last facet, 19, is reversed: the end is its vertex 0
      return f == 0 or f == 19 ? 1 : 0;
    return 0;
  };
  for (const auto& [name, whole] : cases())
    for (const auto& d : distributions())
    {
      INFO(name << ", " << d.name);
      const std::vector<int> mine = owned(whole.size(), d);
      const Surface s = with_ring(MPI_COMM_WORLD, part(whole, mine));
      for (std::size_t f = 0; f < mine.size(); ++f)
        CHECK(int(s.ends[f]) == expected(name, mine[f]));
    }
}

TEST_CASE("an edge of three facets is no end", "[exchange]")
{
  // A third facet stands on the edge between facets 0 and 1 of a 2 × 1 grid
  Surface whole = grid(2, 1);
  whole.id.push_back(facet_id(2));
  whole.sigma.push_back(1);
  for (const int v : {1, 4, 6, 7})
  {
    whole.vertices.push_back(vertex_number(v));
    whole.nodes.push_back(node_number(v));
  }
  whole.X.insert(whole.X.end(), {1, 0, 0, 1, 1, 0, 1, 0, 1, 1, 1, 1});
  const std::vector<int> expected = {1 | 2 | 8, 1 | 4 | 8, 2 | 4 | 8};
  for (const auto& d : distributions())
  {
    INFO(d.name);
    const std::vector<int> mine = owned(3, d);
    const Surface s = with_ring(MPI_COMM_WORLD, part(whole, mine));
    for (std::size_t f = 0; f < mine.size(); ++f)
      CHECK(int(s.ends[f]) == expected[mine[f]]);
  }
}

TEST_CASE("with_targets brings exactly the targets and their rings", "[exchange]")
{
  for (auto& [name, whole] : cases())
  {
    const std::vector<double> all_slaves = slave_boxes_near(whole);
    const std::vector<std::uint8_t> ends = ends_of(whole);
    whole.number_nodes();
    move(whole);
    for (const double radius : {0.32, 0.5, std::numeric_limits<double>::infinity()})
    {
      // The case is worth its name: a small radius reaches some facets, not all, with others around
      const std::vector<int> found
          = targets(whole, all_slaves, reaches(all_slaves, whole.dim, radius));
      const int all = static_cast<int>(found.size());
      const int ringed_all = static_cast<int>(with_neighbours(whole, found).size());
      INFO(name << ", radius " << radius);
      if (std::isinf(radius))
        REQUIRE(all == whole.size());
      else
      {
        REQUIRE(all > 3);
        REQUIRE(all < ringed_all);
        REQUIRE(ringed_all < whole.size());
      }

      for (const auto& d : distributions())
        for (const auto& slave_d : distributions())
        {
          INFO("masters " << d.name << ", slaves " << slave_d.name);
          const std::vector<int> mine = owned(whole.size(), d);
          Surface ringed = with_ring(MPI_COMM_WORLD, part(whole, mine));
          move(ringed);
          const std::vector<double> slaves = owned_boxes(all_slaves, whole.dim, slave_d);
          const std::vector<double> reach = reaches(slaves, whole.dim, radius);
          const Surface s
              = with_targets(MPI_COMM_WORLD, ringed, static_cast<int>(mine.size()), slaves, reach);

          // `expected` knows nothing of d: the same for all distributions of the masters
          const std::vector<int> expected = targets(whole, slaves, reach);
          const std::set<std::int64_t> near = ids(whole, {expected.begin(), expected.end()});
          const std::set<std::int64_t> both = ids(whole, with_neighbours(whole, expected));
          CHECK(s.id == std::vector<std::int64_t>(both.begin(), both.end())); // sorted, once each
          for (int f = 0; f < s.size(); ++f)
            CHECK(bool(s.candidate[f]) == near.contains(s.id[f]));

          CHECK(is_faithful(s, whole, ends));

          // and how far away the nearest one is
          const std::vector<double> d
              = distances(MPI_COMM_WORLD, ringed, static_cast<int>(mine.size()), slaves, reach);
          const std::vector<double> boxes = whole.boxes();
          for (std::size_t i = 0; i < reach.size(); ++i)
          {
            double least = INFINITY;
            for (int f = 0; f < whole.size(); ++f)
              least = std::min(least, distance2(boxes, f, &slaves[i * 2 * whole.dim], whole.dim));
            if (not(least <= reach[i] * reach[i]))
              least = INFINITY;
            CHECK(d[i] == std::sqrt(least));
          }
        }
    }
  }
}

TEST_CASE("with_targets reaches a slave at exactly the distance", "[exchange]")
{
  // The coarse test between ranks and the fine one between boxes must round alike
  const double height = 0.7;
  Surface whole = grid(6, 6);
  for (std::size_t i = 2; i < whole.X.size(); i += 3)
    whole.X[i] = height;
  whole.number_nodes();
  for (int i = 0; i < 20; ++i)
  {
    const double z = height + 0.1 * (i + 1);
    std::vector<double> slave, reach;
    if (comm_rank() == i % comm_size())
    {
      slave = {2.2, 2.2, z, 2.4, 2.4, z + 0.1};
      reach = {z - height};
    }
    for (const auto& d : distributions())
    {
      INFO(d.name << ", height " << z);
      const std::vector<int> own = owned(whole.size(), d);
      const Surface ringed = with_ring(MPI_COMM_WORLD, part(whole, own));
      const Surface s = with_targets(MPI_COMM_WORLD, ringed, int(own.size()), slave, reach);
      const std::vector<int> expected = targets(whole, slave, reach);
      CHECK(expected.empty() == slave.empty());
      CHECK(s.size() == int(with_neighbours(whole, expected).size()));
    }
  }
}

TEST_CASE("bytes received are counted", "[exchange]")
{
  const Surface whole = grid(8, 8);
  const std::int64_t before = bytes_received();
  const std::vector<int> mine = owned(whole.size(), distributions()[0]);
  const Surface s = with_ring(MPI_COMM_WORLD, part(whole, mine));
  const std::int64_t bytes = bytes_received() - before;
  // a ring facet is 12 integers and 12 reals; messages about vertices and counts add to it
  const int ring = s.size() - int(mine.size());
  CHECK((comm_size() > 1) == (bytes > 0));
  CHECK(bytes >= ring * 24 * 8);
  CHECK(bytes <= ring * 24 * 8 + 9 * 9 * 8 * 4 + 500 * comm_size());
}

TEST_CASE("a wrong argument on one rank is an error on all", "[exchange]")
{
  const Surface whole = grid(4, 4);
  const std::vector<int> mine = owned(whole.size(), distributions()[1]);
  const Surface own = part(whole, mine);
  const bool wrong = comm_rank() == comm_size() - 1;

  Surface damaged = own;
  if (wrong)
    damaged.sigma.push_back(1);
  CHECK_THROWS_AS(with_ring(MPI_COMM_WORLD, damaged), std::invalid_argument);

  const Surface s = with_ring(MPI_COMM_WORLD, own);
  const int n = own.size();
  const std::vector<double> good(6, 0.0), bad(wrong ? 5 : 6, 0.0);
  auto call = [&](int num_own, const std::vector<double>& slaves, double radius)
  { return with_targets(MPI_COMM_WORLD, s, num_own, slaves, std::vector<double>(1, radius)); };
  CHECK_THROWS_AS(call(wrong ? s.size() + 1 : n, good, 1), std::invalid_argument);
  CHECK_THROWS_AS(call(n, bad, 1), std::invalid_argument);
  CHECK_THROWS_AS(call(n, good, wrong ? -1 : 1), std::invalid_argument);
  CHECK_THROWS_AS(call(n, good, wrong ? std::nan("") : 1), std::invalid_argument);
  CHECK(call(n, good, 1).size() > 0); // and the communicator is still in order
}
