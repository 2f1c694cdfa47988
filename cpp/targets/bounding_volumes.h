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
    if (n == 0)
      return;
    std::vector<int> items(n);
    std::iota(items.begin(), items.end(), 0);
    _nodes.reserve(2 * n);
    split(boxes, items, 0, n);
    refit(boxes);
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
      if (node.item >= 0)
        node.box = item_box(boxes, node.item);
      else
      {
        node.box = _nodes[i + 1].box;
        node.box.add(_nodes[node.second].box);
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
      if (node.item >= 0)
      {
        best = leaf(node.item);
        continue;
      }
      const int a = e.node + 1, b = node.second;
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

  /// Call `found(item)` for all items whose box overlaps `box`.
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
    int second; // second child of an inner node; the first one follows its parent
    int item;   // of a leaf, else −1
  };

  // The items from `begin` to `end` are sorted into the subtree that starts with the next node.
  void split(std::span<const double> boxes, std::vector<int>& items, int begin, int end)
  {
    const int me = static_cast<int>(_nodes.size());
    const bool leaf = end - begin == 1;
    _nodes.push_back({{}, -1, leaf ? items[begin] : -1});
    if (leaf)
      return;
    Box<D> centres;
    for (int k = begin; k < end; ++k)
    {
      const Box<D> b = item_box(boxes, items[k]);
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
    std::nth_element(items.begin() + begin, items.begin() + middle, items.begin() + end,
                     [&](int a, int b) { return centre(a) < centre(b); });
    split(boxes, items, begin, middle);
    _nodes[me].second = static_cast<int>(_nodes.size());
    split(boxes, items, middle, end);
  }

  std::vector<Node> _nodes;
};

} // namespace dolfinx_contact
