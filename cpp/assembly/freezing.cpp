// SPDX-License-Identifier: MIT
//
// What an Assembler holds while Newton iterates inside of the paper's loops, and the friction that
// follows from it.
#include "assembler.h"

namespace dolfinx_contact
{

// Where a particle is against its target if targets and normals are held: what has happened since
// then is the difference of positions.
template <int D>
void Assembler<D>::stay(const BasisValues& position, State& s) const
{
  s.x = evaluate<D>(_slave.facet_x(s.facet), _slave.np(), position, false).x;
  s.slip.setZero();
  s.gap = -INFINITY;
  if (s.target.facet < 0)
    return;
  const Vector<D> y = _tool ? _tool->pieces[s.piece].now.to(s.y0) : target_point(s);
  const Vector<D> r = s.x - y;
  s.gap = r.dot(s.n);
  if (_friction.nodes() > 0)
    s.slip = s.slip0 + r - s.r0; // if it is closed
}

template <int D>
void Assembler<D>::freeze(Frozen frozen)
{
  Sample buffer;
  for (State& s : _now.states)
  {
    if (frozen.threshold and not _frozen.threshold)
      s.threshold = s.lambda;
    if (frozen.status and not _frozen.status)
    {
      s.acts = s.friction.acts;
      s.slips = s.friction.slips;
    }
    if (frozen.geometry and not _frozen.geometry and s.target.facet >= 0)
    {
      const Vector<D> y = target_point(s);
      s.r0 = s.x - y;
      if (_tool)
        s.y0 = _tool->pieces[s.piece].now.back(y);
      s.slip0 = _friction.nodes() > 0 ? slip(s, sample(s, buffer).position)
                                      : Vector<D>(Vector<D>::Zero());
    }
  }
  _frozen = frozen;
}

template <int D>
void Assembler<D>::glue(double pressure)
{
  for (State& s : _now.states)
  {
    s.threshold = -pressure;
    s.acts = s.closed;
    s.slips = false;
  }
}

// (F3) at a particle, with the status and the limit that are held.
template <int D>
Friction<D> Assembler<D>::friction(const State& s) const
{
  const ContactLaw law = this->law(s);
  const double limit = _frozen.threshold ? s.threshold
                       : law.continuous  ? pressed(law, s.lambda, s.gap)
                                         : s.lambda;
  if (not s.closed or not(_frozen.status ? s.acts : s.touched and rubs(law, s.closed, limit)))
    return {};
  std::optional<bool> status;
  if (_frozen.status)
    status = s.slips;
  Friction<D> f(law, limit, s.n0, s.n, s.Lambda, s.slip, status);
  f.frozen = _frozen.threshold;
  return f;
}

// the members of this file; assembler.cpp instantiates the others
template void Assembler<2>::stay(const BasisValues&, State&) const;
template void Assembler<3>::stay(const BasisValues&, State&) const;
template void Assembler<2>::freeze(Frozen);
template void Assembler<3>::freeze(Frozen);
template void Assembler<2>::glue(double);
template void Assembler<3>::glue(double);
template Friction<2> Assembler<2>::friction(const State&) const;
template Friction<3> Assembler<3>::friction(const State&) const;

} // namespace dolfinx_contact
