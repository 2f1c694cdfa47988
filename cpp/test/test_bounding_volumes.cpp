// SPDX-License-Identifier: MIT
#include "../targets/bounding_volumes.h"
#include "facets.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

template <int D>
std::vector<double> random_boxes(int n, std::mt19937& random)
{
  std::vector<double> boxes;
  for (int i = 0; i < n; ++i)
  {
    const Vector<D> lo = uniform_vector<D>(random, 0, 1), size = uniform_vector<D>(random, 0, 0.1);
    for (int k = 0; k < 2 * D; ++k)
      boxes.push_back(k < D ? lo[k] : lo[k - D] + size[k - D]);
  }
  return boxes;
}

template <int D>
void finds_what_overlaps(const BoxTree<D>& tree, const std::vector<double>& boxes,
                         std::mt19937& random)
{
  const int n = static_cast<int>(boxes.size()) / (2 * D);
  int hits = 0;
  for (int q = 0; q < 200; ++q)
  {
    const std::vector<double> one = random_boxes<D>(1, random);
    const Box<D> query = BoxTree<D>::item_box(one, 0);
    std::multiset<int> found, expected;
    tree.overlaps(query, [&](int item) { found.insert(item); });
    for (int i = 0; i < n; ++i)
      if (BoxTree<D>::item_box(boxes, i).overlaps(query))
        expected.insert(i);
    hits += expected.size();
    REQUIRE(std::includes(found.begin(), found.end(), expected.begin(), expected.end()));
    // once each, and no more than one neighbour in its leaf for each item found
    REQUIRE(std::set<int>(found.begin(), found.end()).size() == found.size());
  }
  REQUIRE((n < 500 or hits > 100));
}

// The nearest box, and how many boxes were looked at
template <int D>
void finds_the_nearest(const BoxTree<D>& tree, const std::vector<double>& boxes,
                       std::mt19937& random)
{
  const int n = static_cast<int>(boxes.size()) / (2 * D), queries = 200;
  long visits = 0;
  for (int q = 0; q < queries; ++q)
  {
    const Eigen::Array<double, D, 1> p = uniform_vector<D>(random, -0.5, 1.5).array();
    // 0 inside: the distance to the centre makes it unique
    auto cost = [&](int i)
    {
      const Box<D> b = BoxTree<D>::item_box(boxes, i);
      return std::sqrt((p - 0.5 * (b.lo + b.hi)).square().sum());
    };
    int nearest = -1;
    double best = INFINITY, expected = INFINITY;
    for (int i = 0; i < n; ++i)
      expected = std::min(expected, cost(i));
    tree.descend([&](const Box<D>& b, int) { return std::sqrt(b.distance2(p)); },
                 [&](int i)
                 {
                   ++visits;
                   if (cost(i) < best)
                   {
                     best = cost(i);
                     nearest = i;
                   }
                   return best;
                 },
                 INFINITY);
    REQUIRE(nearest >= 0);
    REQUIRE(best == expected);

    // no item is better than a bound below the optimum: leaves beyond it are not touched
    tree.descend([&](const Box<D>& b, int) { return std::sqrt(b.distance2(p)) + 10; },
                 [&](int) -> double { throw std::logic_error("beyond the bound"); }, 9.0);
  }
  REQUIRE((n < 500 or visits < 0.2 * queries * n)); // a tree, not a list
}

// From a known item, all items near a ball and not many more, with fewer boxes looked at
template <int D>
void finds_what_is_near(BoxTree<D>& tree, const std::vector<double>& boxes, std::mt19937& random)
{
  tree.link();
  const int n = static_cast<int>(boxes.size()) / (2 * D);
  int root = 0, near = 0;
  for (int q = 0; q < 200; ++q)
  {
    const int item = random() % n;
    const Box<D> b = BoxTree<D>::item_box(boxes, item);
    const double radius = 0.01 * (q % 4); // also balls that reach beyond the neighbourhood
    const Eigen::Array<double, D, 1> p
        = 0.5 * (b.lo + b.hi) + (q % 8) * uniform_vector<D>(random, -0.02, 0.02).array();
    std::set<int> expected, found;
    auto key = [&](int& looks)
    {
      return [&](const Box<D>& box, int)
      {
        ++looks;
        return std::sqrt(box.distance2(p));
      };
    };
    auto into = [&](std::set<int>& items)
    {
      return [&](int i)
      {
        items.insert(i);
        return radius;
      };
    };
    tree.descend(key(root), into(expected), radius);
    tree.descend_near(item, p, radius, key(near), into(found), radius);
    REQUIRE(std::includes(found.begin(), found.end(), expected.begin(), expected.end()));
    for (const int i : found)
      REQUIRE(BoxTree<D>::item_box(boxes, i).distance2(p) <= 1.001 * D * radius * radius + 1e-6);
  }
  REQUIRE((n < 500 or near < root));
}

template <int D>
void like_brute_force()
{
  std::mt19937 random(8);
  for (int n : {1, 2, 3, 7, 50, 1000})
  {
    CAPTURE(D, n);
    std::vector<double> boxes = random_boxes<D>(n, random);
    BoxTree<D> tree(boxes);
    REQUIRE_FALSE(tree.empty());
    for (int pass = 0; pass < 2; ++pass)
    {
      finds_what_overlaps(tree, boxes, random);
      finds_the_nearest(tree, boxes, random);
      finds_what_is_near(tree, boxes, random);
      Box<D> all;
      for (int i = 0; i < n; ++i)
        all.add(BoxTree<D>::item_box(boxes, i));
      REQUIRE((tree.root().lo == all.lo).all());
      REQUIRE((tree.root().hi == all.hi).all());

      // everything moves, a little or to somewhere else
      const std::vector<double> elsewhere = random_boxes<D>(n, random);
      for (int i = 0; i < n; ++i)
        for (int k = 0; k < 2 * D; ++k)
          if (i % 10 == 0)
            boxes[i * 2 * D + k] = elsewhere[i * 2 * D + k];
          else
            boxes[i * 2 * D + k] += 0.02 * (i % 5);
      tree.refit(boxes);
    }
  }
}

template <int D>
void nothing_in_an_empty_tree()
{
  std::mt19937 random(9);
  for (BoxTree<D> tree : {BoxTree<D>(), BoxTree<D>(std::span<const double>())})
  {
    REQUIRE(tree.empty());
    tree.refit({});
    int calls = 0;
    Box<D> everywhere;
    everywhere.lo.setConstant(-INFINITY);
    everywhere.hi.setConstant(INFINITY);
    tree.overlaps(everywhere, [&](int) { ++calls; });
    tree.descend([](const Box<D>&, int) { return 0.0; }, [&](int) { return double(++calls); },
                 INFINITY);
    REQUIRE(calls == 0);
    REQUIRE_FALSE(tree.root().overlaps(BoxTree<D>::item_box(random_boxes<D>(1, random), 0)));
  }
}

} // namespace

TEST_CASE("BoxTree: overlaps and nearest items like brute force, also after refitting")
{
  like_brute_force<2>();
  like_brute_force<3>();
}

TEST_CASE("BoxTree: coincident boxes")
{
  std::vector<double> boxes;
  for (int i = 0; i < 100; ++i)
    boxes.insert(boxes.end(), {0, 0, 1, 1});
  const BoxTree<2> tree(boxes);
  std::set<int> found;
  tree.overlaps(BoxTree<2>::item_box(boxes, 0), [&](int i) { found.insert(i); });
  REQUIRE(found.size() == 100);
}

TEST_CASE("BoxTree: nothing in an empty tree")
{
  nothing_in_an_empty_tree<2>();
  nothing_in_an_empty_tree<3>();
}

TEST_CASE("Box: touching boxes overlap, distances are those of the nearest point")
{
  const Box<2> a{{0, 0}, {1, 1}}, b{{1, 1}, {2, 2}}, c{{1.5, 0}, {2, 0.5}};
  REQUIRE(a.overlaps(b));
  REQUIRE_FALSE(a.overlaps(c));
  REQUIRE(a.distance2({0.5, 0.2}) == 0);
  REQUIRE(a.distance2({4, 5}) == 25);
  REQUIRE(a.distance2({-2, 0.5}) == 4);
}
