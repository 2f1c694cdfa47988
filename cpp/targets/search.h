// SPDX-License-Identifier: MIT
#pragma once

#include "bounding_volumes.h"
#include "facet_targets.h"
#include "normal_bounds.h"
#include "smooth_projection.h"

namespace dolfinx_contact
{

/// Where a particle looks for its target (formulation, section 4).
enum class TargetRule : std::int8_t
{
  proximity, ///< (F4) closest point
  direction, ///< (F5) along a fixed direction
  smooth     ///< (F6) along the interpolated normal
};

/// Settings of a search. Lengths are relative to the facet's diameter where so marked.
template <int D>
struct SearchOptions
{
  TargetRule rule = TargetRule::proximity;
  double radius = INFINITY;   ///< d_max: farther points are no targets
  double end_tolerance = 0.5; ///< overshoot of a physical end that is still clamped, relative
  double margin = 1e-2;       ///< the former facet is kept while ξ is so near to it
};

/// A particle in search of its target.
template <int D>
struct Seeker
{
  Vector<D> x;                     ///< its position
  Vector<D> outward;               ///< unit outward normal of the slave there
  Vector<D> e = Vector<D>::Zero(); ///< unit direction of (F5), zero for the other rules
};

/// Search of targets on the whole current master surface (the application A of the formulation).
template <int D>
class Search
{
public:
  static constexpr int Q = D - 1;

  Search() = default;
  Search(const Surface& master, const SearchOptions<D>& options);

  /// The master has moved: refit the tree.
  /// @param normals of the master where it is now: with them smooth targets are looked for only
  /// where the normals may lead to the particle
  void refit(const Surface& master, const NodalNormals<D>* normals = nullptr);

  /// Target of one particle. Facets that do not face the slave are refused.
  /// @param former the target of the last evaluation, kept within the margin (no facet flipping)
  /// @param normals of the master, for smooth targets
  Target<D> find(const Surface& master, const Seeker<D>& seeker, const Target<D>& former,
                 const NodalNormals<D>* normals = nullptr) const
  {
    return find(Query{master, seeker.x, seeker.outward, seeker.e, normals}, former);
  }

  /// Append the facets whose boxes overlap a box.
  void near(const Box<D>& box, std::vector<int>& out) const
  {
    _tree.overlaps(box, [&](int f) { out.push_back(f); });
  }

private:
  struct Found
  {
    Target<D> target;
    double cost = INFINITY; // distance (F4) or |s| (F5)
  };

  struct Query
  {
    const Surface& master;
    const Vector<D>&x, &outward, &e;
    const NodalNormals<D>* normals;
  };

  Target<D> find(const Query& q, const Target<D>& former) const;
  Found on_facet(const Query& q, int f, double limit, const Vector<Q>* start = nullptr) const;
  Found at_end(const Query& q, int f) const;
  Found keep(const Query& q, const Target<D>& former, double cost) const;
  bool faces(const Query& q, const FacetProjection<D>& facet, const Target<D>& t) const;
  bool on_end(const FacetProjection<D>& facet, const Target<D>& t) const;
  bool within_end(const Query& q, const Target<D>& t) const;
  Vector<D> direction(const Query& q, const Target<D>& t) const;
  double bound(const Box<D>& box, const Query& q, double reach) const;
  void best_of(const Query& q, const Found& found, Found& best) const;
  std::vector<double> end_boxes(std::span<const double> boxes) const;

  SearchOptions<D> _options;
  BoxTree<D> _tree;
  BoxTree<D> _end_tree;                       // of the facets at physical ends, for (F5) and (F6)
  std::vector<Box<D>> _normals, _end_normals; // of M in the nodes of the trees; may be empty
  std::vector<int> _at_end;                   // these facets
  std::vector<double> _diameter;              // of the facets, reference configuration
  double _largest = 0, _typical = 0;          // of them
  std::vector<std::uint8_t> _end_corners;     // bit v: corner v is at a physical end
};

extern template class Search<2>;
extern template class Search<3>;

} // namespace dolfinx_contact
