// SPDX-License-Identifier: MIT
//
// A rigid tool given by a mesh of its surface. The facets stay where they are: the tool moves by
// its frame, in which particles search their targets as on a deformable master (F4), (F6).
#pragma once

#include "kinematics.h"
#include "search.h"

namespace dolfinx_contact
{

template <int D>
struct RigidMesh
{
  Surface surface; ///< all of its facets
  Search<D> search;
  NodalNormals<D> normals; ///< if interpolated
  Rules rules;

  /// @param surface facets of the whole tool, with their physical ends
  /// @param crease angle beyond which interpolated normals are not averaged
  RigidMesh(Surface facets, const Rules& rules, SearchOptions<D> options, double crease)
      : surface(std::move(facets))
      , rules(rules)
  {
    options.rule = rules.target;
    if (interpolated())
    {
      options.margin = 0; // no normals that could flip between facets
      normals = NodalNormals<D>(surface, crease);
    }
    search = Search<D>(surface, options);
    search.refit(surface, interpolated() ? &normals : nullptr);
  }

  bool interpolated() const { return rules.normal == NormalRule::interpolated; }

  Target<D> find(const Vector<D>& X, const Vector<D>& outward, const Target<D>& former) const
  {
    return search.find(surface, {X, outward}, former, interpolated() ? &normals : nullptr);
  }

  /// The target's place.
  Vector<D> at(const Target<D>& t) const
  {
    return FacetProjection<D>(surface, t.facet).at(t.xi, false).x;
  }

  /// Normal and gap without variations, or with them.
  Kinematics<D> kinematics(const Vector<D>& X, const Target<D>& t, bool variations) const
  {
    const FacetPoint<D> p = FacetProjection<D>(surface, t.facet).at(t.xi, true);
    NormalField<D> field;
    if (interpolated())
      field = normals.at(surface, t.facet, t.xi.data());
    const Vector<D> none = Vector<D>::Zero();
    if (variations)
      return linearise<D>(surface, t, X, p, rules, none, &field);
    Kinematics<D> k;
    place<D>(surface, t, X, p, rules.normal, none, k, &field);
    return k;
  }
};

} // namespace dolfinx_contact
