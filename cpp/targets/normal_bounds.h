// SPDX-License-Identifier: MIT
//
// Where the interpolated normals of a part of the surface can lead (F6). A particle beside the
// surface is near many facets, and on the normal of none: bounds of the normals tell so for whole
// subtrees of the search, where distances do not.
#pragma once

#include "../geometry/normals.h"
#include "bounding_volumes.h"

namespace dolfinx_contact
{

/// Boxes around M on each facet, those of its corners' n_A: (n, 2, D), lower then upper corner.
/// Facets that are no candidates have empty ones.
template <int D>
std::vector<double> normal_boxes(const Surface& surface, const NodalNormals<D>& normals)
{
  std::vector<double> boxes;
  boxes.reserve(static_cast<std::size_t>(surface.size()) * 2 * D);
  for (int f = 0; f < surface.size(); ++f)
  {
    Box<D> box;
    bool finite = true; // else the facets around a corner have no area
    if (surface.candidate[f])
      for (int v = 0; v < surface.nv(); ++v)
      {
        const Vector<D>& n = normals.normal(surface, f, v);
        box.add({n, n});
        finite = finite and n.allFinite();
      }
    if (not finite)
    {
      box.lo.setConstant(-1);
      box.hi.setConstant(1);
    }
    boxes.insert(boxes.end(), box.lo.data(), box.lo.data() + D);
    boxes.insert(boxes.end(), box.hi.data(), box.hi.data() + D);
  }
  return boxes;
}

/// False only if x = x² + g M + w has no solution with x² and M in their boxes, ‖g M‖ ≤ `limit` and
/// w orthogonal to M, ‖w‖ ≤ `aside`. The component of M that is farthest from 0 bounds g, and by
/// the intervals of x − x² − w and g M all others must agree.
template <int D>
bool may_lead_to(const Vector<D>& x, const Box<D>& position, const Box<D>& normal, double aside,
                 double limit)
{
  using Array = Eigen::Array<double, D, 1>;
  if ((normal.lo > normal.hi).any())
    return false;
  // ξ may be 1e-8 outside of its facet
  const double slack = 1e-7;
  const double far = aside + slack * (position.hi - position.lo).maxCoeff()
                     + 1e-13 * x.template lpNorm<Eigen::Infinity>();
  const Array below = x.array() - position.hi - far, above = x.array() - position.lo + far;
  const Array lo = normal.lo - slack, hi = normal.hi + slack;
  int k;
  const double least = lo.max(-hi).maxCoeff(&k); // of |M_k|
  if (not(least > 0.1))                          // normals of all directions bound nothing
    return true;
  const bool turned = lo[k] < 0; // g and M
  const Array n0 = turned ? Array(-hi) : lo, n1 = turned ? Array(-lo) : hi;
  const double g_max = (limit + far) / least;
  const double g0 = std::max(below[k] / (below[k] > 0 ? n1[k] : n0[k]), -g_max),
               g1 = std::min(above[k] / (above[k] > 0 ? n0[k] : n1[k]), g_max);
  const Array a = g0 * n0, b = g0 * n1, c = g1 * n0, d = g1 * n1;
  return g0 <= g1 and (a.min(b).min(c.min(d)) <= above).all()
         and (a.max(b).max(c.max(d)) >= below).all();
}

} // namespace dolfinx_contact
