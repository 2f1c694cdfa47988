// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

namespace dolfinx_contact
{

/// Axis-parallel box.
template <int D>
struct Box
{
  Eigen::Array<double, D, 1> lo = Eigen::Array<double, D, 1>::Constant(INFINITY);
  Eigen::Array<double, D, 1> hi = Eigen::Array<double, D, 1>::Constant(-INFINITY);

  void add(const Box& b)
  {
    lo = lo.min(b.lo);
    hi = hi.max(b.hi);
  }
  bool overlaps(const Box& b) const { return (lo <= b.hi).all() and (b.lo <= hi).all(); }

  /// Squared distance of a point, 0 inside.
  double distance2(const Eigen::Array<double, D, 1>& p) const
  {
    return ((lo - p).max(p - hi).max(0.0)).square().sum();
  }
};

/// A binary tree of bounding boxes, split at the median centre along the longest side.
///
/// It is built once and refitted while the boxes move.
template <int D>
class BoxTree
{
public:
  BoxTree() = default;

  /// @param boxes (n, 2, D), lower then upper corner of each
  explicit BoxTree(std::span<const double> boxes)
  {
    const int n = static_cast<int>(boxes.size()) / (2 * D);
    _items.resize(n);
    std::iota(_items.begin(), _items.end(), 0);
    _nodes.reserve(2 * n);
    if (n > 0)
    {
      split(boxes, 0, n);
      refit(boxes);
    }
  }

  bool empty() const { return _nodes.empty(); }

  /// Box around everything.
  Box<D> root() const { return empty() ? Box<D>() : _nodes[0].box; }

  /// New boxes for the same items.
  void refit(std::span<const double> boxes)
  {
    for (int i = static_cast<int>(_nodes.size()) - 1; i >= 0; --i) // children follow parents
    {
      Node& node = _nodes[i];
      node.box = Box<D>();
      if (node.count > 0)
      {
        for (int k = node.first; k < node.first + node.count; ++k)
          node.box.add(item_box(boxes, _items[k]));
      }
      else
      {
        node.box.add(_nodes[i + 1].box);
        node.box.add(_nodes[node.first].box);
      }
    }
  }

  /// Call `leaf(item)` on all items that may improve on a bound, the most promising first.
  /// @param key key(box) is a lower bound of the cost of all items in a box; infinite: none
  /// @param leaf examines an item and returns the best cost known so far
  /// @param best the cost to improve on
  template <typename Key, typename Leaf>
  void descend(Key key, Leaf leaf, double best) const
  {
    if (empty())
      return;
    struct Entry
    {
      double key;
      int node;
    };
    Entry stack[128];
    int top = 0;
    stack[top++] = {key(_nodes[0].box), 0};
    while (top > 0)
    {
      const Entry e = stack[--top];
      if (not(e.key <= best) or e.key == std::numeric_limits<double>::infinity())
        continue;
      const Node& node = _nodes[e.node];
      if (node.count > 0)
      {
        for (int k = node.first; k < node.first + node.count; ++k)
          best = leaf(_items[k]);
        continue;
      }
      const int a = e.node + 1, b = node.first;
      const double ka = key(_nodes[a].box), kb = key(_nodes[b].box);
      if (ka <= kb)
      {
        stack[top++] = {kb, b};
        stack[top++] = {ka, a};
      }
      else
      {
        stack[top++] = {ka, a};
        stack[top++] = {kb, b};
      }
    }
  }

  /// Call `found(item)` for all items in leaves whose box overlaps `box` (a superset of the items
  /// that do: test the item's own box).
  template <typename Found>
  void overlaps(const Box<D>& box, Found found) const
  {
    descend([&](const Box<D>& b)
            { return b.overlaps(box) ? 0.0 : std::numeric_limits<double>::infinity(); },
            [&](int item)
            {
              found(item);
              return 0.0;
            },
            0.0);
  }

  static Box<D> item_box(std::span<const double> boxes, int i)
  {
    Box<D> b;
    for (int k = 0; k < D; ++k)
    {
      b.lo[k] = boxes[(static_cast<std::size_t>(i) * 2) * D + k];
      b.hi[k] = boxes[(static_cast<std::size_t>(i) * 2 + 1) * D + k];
    }
    return b;
  }

private:
  struct Node
  {
    Box<D> box;
    int first; // leaf: first item; else: second child (the first one follows its parent)
    int count; // leaf: number of items; else 0
  };
  static constexpr int leaf_size = 1;

  void split(std::span<const double> boxes, int begin, int end)
  {
    const int me = static_cast<int>(_nodes.size());
    _nodes.push_back({{}, begin, end - begin});
    if (end - begin <= leaf_size)
      return;
    Box<D> centres;
    for (int k = begin; k < end; ++k)
    {
      const Box<D> b = item_box(boxes, _items[k]);
      const auto c = (0.5 * (b.lo + b.hi)).eval();
      centres.add({c, c});
    }
    int axis;
    (centres.hi - centres.lo).maxCoeff(&axis);
    auto centre = [&](int item)
    {
      const std::size_t i = static_cast<std::size_t>(item) * 2 * D + axis;
      return boxes[i] + boxes[i + D];
    };
    const int middle = (begin + end) / 2;
    std::nth_element(_items.begin() + begin, _items.begin() + middle, _items.begin() + end,
                     [&](int a, int b) { return centre(a) < centre(b); });
    split(boxes, begin, middle);
    _nodes[me].first = static_cast<int>(_nodes.size());
    _nodes[me].count = 0;
    split(boxes, middle, end);
  }

  std::vector<Node> _nodes;
  std::vector<int> _items;
};

} // namespace dolfinx_contact
