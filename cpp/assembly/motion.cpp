// SPDX-License-Identifier: MIT
//
// The particles of a common refinement move on the slave while the surfaces do. What that adds to
// the tangent: with r(ξ) the residual of a particle of weight w,
//     δ(w r) = w r δ(log w) + w ∂_β r δξ^β,
// where δ(log w) and δξ^β depend on the corners of the slave facet and of the master facets that
// its cells are cut by.
#include "assembler.h"

namespace dolfinx_contact
{

namespace
{

// ∂_β log(‖τ_1 × τ_2‖ 2πR) in the reference configuration
template <int D>
double measure_rate(const FacetPoint<D>& p, int beta, bool axisymmetric)
{
  const Vector<D> area = p.area_vector();
  Vector<D> change;
  if constexpr (D == 2)
    change << p.d2(0, 0)[1], -p.d2(0, 0)[0];
  else
    change = p.d2(0, beta).cross(p.tau.col(1)) + p.tau.col(0).cross(p.d2(1, beta));
  return area.dot(change) / area.squaredNorm() + (axisymmetric ? p.tau(0, beta) / p.x[0] : 0);
}

} // namespace

// @param along ∂_β of the slave's bases, as values
template <int D>
Rates<D> Assembler<D>::rates(const State& s, const Sample& along, int beta) const
{
  constexpr int Q = D - 1;
  const int f = s.facet, np = _slave.np();
  const int nl = _particles.multiplier.nodes(), nf = _friction.nodes();
  Rates<D> out;
  out.x = evaluate<D>(_slave.facet_x(f), np, along.position, false).x;
  out.x_old = evaluate<D>(_slave.facet_x_old(f), np, along.position, false).x;
  for (int a = 0; a < nl; ++a)
    out.lambda += along.psi[a] * _lambda[_multiplier_local[f * nl + a]];
  for (int a = 0; a < nf; ++a)
    for (int i = 0; i < Q; ++i)
    {
      const int dof = _friction.local[f * nf + a] * Q + i;
      out.Lambda += along.phi[a] * _semi_multiplier[dof] * _friction.tangent[dof];
    }
  if (turns_smoothly()) // e = −n̄ of the slave
    out.e = -InterpolatedNormal<D>(_slave_normals.at(_slave, f, s.xi.data())).dn.col(beta);
  else if (_options.rules.turning)
  {
    const FacetPoint<D> own = FacetProjection<D>(_slave, f).at(s.xi, true);
    const auto of_tangent = normal_of_tangents<D>(own, -_slave.sigma[f]);
    for (int i = 0; i < Q; ++i)
      out.e += of_tangent[i] * own.d2(i, beta);
  }
  return out;
}

// The columns of a pair: those of the slave facet's corners, then of one master facet after the
// other.
template <int D>
void Assembler<D>::MotionSums::reset(const Assembler& a, int f, std::size_t rows)
{
  columns.clear();
  auto add_corners = [&](const Surface& s, int facet, const std::vector<PetscInt>& table)
  {
    for (int v = 0; v < s.nv(); ++v) // the first nodes are the corners
      for (int i = 0; i < D; ++i)
        columns.push_back(table[s.local[facet * s.nu() + v] * D + i]);
  };
  add_corners(a._slave, f, a._slave_dofs);
  for (int g : cells.facets)
    add_corners(a._master, g, a._master_dofs);
  block.setZero(rows, columns.size());
}

// visit(first, n) of the columns of each facet
template <int D>
template <typename Visit>
void Assembler<D>::MotionSums::for_facets(const Assembler& a, Visit visit) const
{
  for (Eigen::Index first = 0, n; first < block.cols(); first += n)
    visit(first, n = D * (first == 0 ? a._slave.nv() : a._master.nv()));
}

// @param p number of the particle on its facet
// @param small null for an open particle, like k
template <int D>
template <bool F>
void Assembler<D>::add_motion(const State& s, int p, const Sample& here, const CouplingBasis<D>& B,
                              const ContactLaw& law, const Kinematics<D>& k,
                              const FrictionTangent<D>& friction, const ClosedParticle<D, F>* small,
                              MotionSums& sums) const
{
  constexpr int Q = D - 1;
  PairVector<D> r = PairVector<D>::Zero(B.size());
  add_residual<D>(B, law, s.closed, s.lambda, s.gap, traction_at(s), s.Lambda, s.friction, s.weight,
                  _options.scale, r);
  BasisValues second, psi, phi;
  _slave.ref.position.tabulate(s.xi.data(), second, true);
  const FacetPoint<D> X = evaluate<D>(_slave.facet_X(s.facet), _slave.np(), second, true);
  _particles.multiplier.tabulate(s.xi.data(), psi);
  if (B.friction > 0)
    _friction.basis.tabulate(s.xi.data(), phi);

  FieldColumns<D> with(B.size(), D); // with log w and ξ
  with.col(0) = r;
  Sample& along = sums.along;
  for (int b = 0; b < Q; ++b)
  {
    std::copy_n(here.position.dN[b], BasisValues::max_nodes, along.position.N);
    std::copy_n(here.displacement.dN[b], BasisValues::max_nodes, along.displacement.N);
    std::copy_n(psi.dN[b], BasisValues::max_nodes, along.psi.begin());
    std::copy_n(phi.dN[b], BasisValues::max_nodes, along.phi.begin());
    const CouplingBasis<D> Bb = basis(along, B.tangent);
    const Rates<D> rate = rates(s, along, b);
    const PairVector<D> d
        = small ? closed_rate<D, F>(B, Bb, law, s.lambda, k, s.Lambda, friction, *small, rate,
                                    s.weight, _options.scale)
                : open_rate<D>(B, Bb, law, s.lambda, s.Lambda, rate, s.weight, _options.scale);
    with.col(1 + b) = d + measure_rate<D>(X, b, _particles.axisymmetric) * r;
  }

  const auto motion = sums.cells.motion.template middleRows<D>(D * p);
  auto add = [&]<int N>(Eigen::Index first)
  {
    const auto moved = motion.template middleCols<N>(first);
    if (moved.isZero(0))
      return;
    for (Eigen::Index i = 0; i < with.rows(); ++i)
    {
      auto row = sums.block.row(i).template segment<N>(first);
      if constexpr (D == 2)
        row += with(i, 0) * moved.row(0) + with(i, 1) * moved.row(1);
      else
        row += with(i, 0) * moved.row(0) + with(i, 1) * moved.row(1) + with(i, 2) * moved.row(2);
    }
  };
  sums.for_facets(*this,
                  [&](Eigen::Index first, Eigen::Index n)
                  {
                    if (D == 3 and n == 12) // quadrilaterals
                      add.template operator()<D == 3 ? 12 : D * D>(first);
                    else // intervals, triangles
                      add.template operator()<D * D>(first);
                  });
}

template <int D>
void Assembler<D>::insert_motion(int f, int target, const std::vector<PetscInt>& dofs,
                                 MotionSums& sums) const
{
  // cells depend on few of the facets around, and the pattern has no place for the others
  sums.for_facets(*this,
                  [&](Eigen::Index first, Eigen::Index n)
                  {
                    if (sums.block.middleCols(first, n).isZero(0))
                      return;
                    sums.part = sums.block.middleCols(first, n);
                    const int kind
                        = first == 0
                              ? slave_corners
                              : master_corners + sums.cells.facets[(first - D * _slave.nv()) / n];
                    _adder.add({f, target, kind}, dofs, std::span(sums.columns).subspan(first, n),
                               sums.part.data());
                  });
}

// the members of this file; assembler.cpp instantiates the others
template Rates<2> Assembler<2>::rates(const State&, const Sample&, int) const;
template Rates<3> Assembler<3>::rates(const State&, const Sample&, int) const;
template void Assembler<2>::MotionSums::reset(const Assembler&, int, std::size_t);
template void Assembler<3>::MotionSums::reset(const Assembler&, int, std::size_t);
template void Assembler<2>::insert_motion(int, int, const std::vector<PetscInt>&,
                                          MotionSums&) const;
template void Assembler<3>::insert_motion(int, int, const std::vector<PetscInt>&,
                                          MotionSums&) const;
template void Assembler<2>::add_motion<false>(const State&, int, const Sample&,
                                              const CouplingBasis<2>&, const ContactLaw&,
                                              const Kinematics<2>&, const FrictionTangent<2>&,
                                              const ClosedParticle<2, false>*, MotionSums&) const;
template void Assembler<2>::add_motion<true>(const State&, int, const Sample&,
                                             const CouplingBasis<2>&, const ContactLaw&,
                                             const Kinematics<2>&, const FrictionTangent<2>&,
                                             const ClosedParticle<2, true>*, MotionSums&) const;
template void Assembler<3>::add_motion<false>(const State&, int, const Sample&,
                                              const CouplingBasis<3>&, const ContactLaw&,
                                              const Kinematics<3>&, const FrictionTangent<3>&,
                                              const ClosedParticle<3, false>*, MotionSums&) const;
template void Assembler<3>::add_motion<true>(const State&, int, const Sample&,
                                             const CouplingBasis<3>&, const ContactLaw&,
                                             const Kinematics<3>&, const FrictionTangent<3>&,
                                             const ClosedParticle<3, true>*, MotionSums&) const;

} // namespace dolfinx_contact
