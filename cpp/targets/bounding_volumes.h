// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
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

  /// Largest distance of its points from p.
  double farthest(const Eigen::Array<double, D, 1>& p) const
  {
    return std::sqrt((p - lo).abs().max((hi - p).abs()).square().sum());
  }

  /// True if it holds the ball around p.
  bool holds(const Eigen::Array<double, D, 1>& p, double radius) const
  {
    return (lo <= p - radius).all() and (p + radius <= hi).all();
  }

  /// Squared distance of another box, 0 if they overlap.
  double distance2(const Box& b) const
  {
    return (lo - b.hi).max(b.lo - hi).max(0.0).square().sum();
  }

  /// True if the other box is not farther away than a distance; for an empty box never.
  bool within(const Box& b, double distance) const
  {
    return (lo <= hi).all() and distance2(b) <= distance * distance;
  }

  /// Squared distance of a point, 0 inside.
  double distance2(const Eigen::Array<double, D, 1>& p) const
  {
    return ((lo - p).max(p - hi).max(0.0)).square().sum();
  }
};

/// A box in single precision, not smaller than the given one: half the memory.
template <int D>
struct CoarseBox
{
  std::array<float, D> lo, hi;

  explicit CoarseBox(const Box<D>& b)
  {
    for (int k = 0; k < D; ++k)
    {
      lo[k] = std::nextafter(static_cast<float>(b.lo[k]), -INFINITY);
      hi[k] = std::nextafter(static_cast<float>(b.hi[k]), INFINITY);
    }
  }

  bool overlaps(const CoarseBox& b) const
  {
    bool all = true;
    for (int k = 0; k < D; ++k)
      all &= (lo[k] <= b.hi[k]) & (b.lo[k] <= hi[k]);
    return all;
  }
};

/// A binary tree of bounding boxes, split at the median centre along the longest side.
///
/// It is built once and refitted while the boxes move. Small subtrees, the groups, may know which
/// other groups are near: a query that starts from a good guess then costs the same in a large tree
/// as in a small one, since all that it reads lies together.
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
    _group_of.resize(n);
    split(boxes, items, 0, n, -1);
    refit(boxes);
  }

  bool empty() const { return _nodes.empty(); }

  /// Box around everything.
  Box<D> root() const { return empty() ? Box<D>() : _nodes[0].box; }

  /// New boxes for the same items.
  void refit(std::span<const double> boxes)
  {
    unite(boxes, [this](int node) -> Box<D>& { return _nodes[node].box; });
  }

  /// Boxes of something else that the items have: for each node the one around its items'.
  std::vector<Box<D>> bounds(std::span<const double> boxes) const
  {
    std::vector<Box<D>> out(_nodes.size());
    unite(boxes, [&](int node) -> Box<D>& { return out[node]; });
    return out;
  }

  /// Note which groups are near each other, for `descend_near`; to be repeated after `refit`.
  void link()
  {
    _offset.assign(1, 0);
    _near.clear();
    _group_box.clear();
    _item_box.clear();
    std::vector<int> stack;
    for (const Group& group : _groups)
    {
      const Box<D>& box = _nodes[group.root].box;
      const Box<D> reach = neighbourhood(box);
      _group_box.emplace_back(box);
      for (stack.assign(1, 0); not stack.empty();)
      {
        const int me = stack.back();
        stack.pop_back();
        const Node& node = _nodes[me];
        if (not node.box.overlaps(reach))
          continue;
        if (node.group >= 0)
          _near.push_back(node.group);
        else
        {
          stack.push_back(node.second);
          stack.push_back(me + 1);
        }
      }
      _offset.push_back(static_cast<int>(_near.size()));
    }
    for (const Node& node : _nodes)
      if (node.item >= 0)
        _item_box.emplace_back(node.box);
  }

  /// As `descend`, for queries that concern items near a ball only.
  /// @param item where the ball is expected: if it is, few other boxes are looked at, and `leaf`
  /// gets all items that reach the box around the ball, in any order
  template <typename Key, typename Leaf>
  void descend_near(int item, const Eigen::Array<double, D, 1>& centre, double radius, Key key,
                    Leaf leaf, double best) const
  {
    const int g = _group_of[item];
    if (not neighbourhood(_nodes[_groups[g].root].box).holds(centre, radius))
      return descend(key, leaf, best);
    const CoarseBox<D> ball(Box<D>{centre - radius, centre + radius});
    for (int k = _offset[g]; k < _offset[g + 1]; ++k)
      if (const int h = _near[k]; _group_box[h].overlaps(ball))
        for (int i = _groups[h].first; i < _groups[h].last; ++i)
          if (_item_box[i].overlaps(ball))
            leaf(_item[i]);
  }

  /// Call `leaf(item)` on all items that may improve on a bound, the most promising first.
  /// @param key key(box, node) is a lower bound of the cost of all items in the box of a node;
  /// infinite: none
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
    stack[top++] = {key(_nodes[0].box, 0), 0};
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
      const double ka = key(_nodes[a].box, a), kb = key(_nodes[b].box, b);
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
    descend([&](const Box<D>& b, int)
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
  static constexpr int group_size = 8; // items at most

  struct Node
  {
    Box<D> box;
    int second; // second child of an inner node; the first one follows its parent
    int item;   // of a leaf, else −1
    int group;  // that it is the root of, else −1
  };

  // A subtree; its items follow each other in `_item`
  struct Group
  {
    int root, first, last;
  };

  // Where a group knows all others: its box, grown by a quarter of its size on all sides
  static Box<D> neighbourhood(const Box<D>& box)
  {
    const double margin = 0.25 * (box.hi - box.lo).maxCoeff();
    return {box.lo - margin, box.hi + margin};
  }

  // Boxes of all nodes from those of the items.
  // @param at at(node) is where its box goes
  template <typename At>
  void unite(std::span<const double> boxes, At at) const
  {
    for (int i = static_cast<int>(_nodes.size()) - 1; i >= 0; --i) // children follow parents
    {
      const Node& node = _nodes[i];
      if (node.item >= 0)
        at(i) = item_box(boxes, node.item);
      else
      {
        at(i) = at(i + 1);
        at(i).add(at(node.second));
      }
    }
  }

  // The items from `begin` to `end` are sorted into the subtree that starts with the next node.
  // @param group that they are in, −1: none yet
  void split(std::span<const double> boxes, std::vector<int>& items, int begin, int end, int group)
  {
    const int me = static_cast<int>(_nodes.size());
    const bool leaf = end - begin == 1, is_group = group < 0 and end - begin <= group_size;
    if (is_group)
    {
      group = static_cast<int>(_groups.size());
      _groups.push_back({me, begin, end});
    }
    _nodes.push_back({{}, -1, leaf ? items[begin] : -1, is_group ? group : -1});
    if (leaf)
    {
      _group_of[items[begin]] = group;
      _item.push_back(items[begin]);
      return;
    }
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
    split(boxes, items, begin, middle, group);
    _nodes[me].second = static_cast<int>(_nodes.size());
    split(boxes, items, middle, end, group);
  }

  std::vector<Node> _nodes;
  std::vector<int> _item;     // as the leaves follow each other
  std::vector<int> _group_of; // of each item
  std::vector<Group> _groups;
  std::vector<int> _offset, _near;                 // groups near each group, itself among them
  std::vector<CoarseBox<D>> _group_box, _item_box; // the latter as _item
};

} // namespace dolfinx_contact
