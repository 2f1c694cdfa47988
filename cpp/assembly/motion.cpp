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
      out.Lambda += along.phi[a] * _Lambda[dof] * _friction.tangent[dof];
    }
  if (turns_smoothly()) // e = −n̄ of the slave
    out.e = -InterpolatedNormal<D>(_slave_normals.at(_slave, f, s.xi.data())).dn.col(beta);
  else if (_options.rules.turning)
  {
    const FacetPoint<D> own = FacetProjection<D>(_slave, f).at(s.xi, true);
    for (int i = 0; i < Q; ++i)
      out.e += normal_of_tangent<D>(own, i, -_slave.sigma[f]) * own.d2(i, beta);
  }
  return out;
}

template <int D>
template <bool F>
void Assembler<D>::motion_tangent(int f, int target, std::span<const int> particles,
                                  const Vector<D>* tangents, const std::vector<PetscInt>& dofs,
                                  const CellPoints<D>& cells) const
{
  constexpr int Q = D - 1;
  std::vector<PetscInt> columns;
  auto add_corners = [&](const Surface& s, int facet, const std::vector<PetscInt>& table)
  {
    for (int v = 0; v < s.nv(); ++v) // the first nodes are the corners
      for (int i = 0; i < D; ++i)
        columns.push_back(table[s.local[facet * s.nu() + v] * D + i]);
  };
  add_corners(_slave, f, _slave_dofs);
  for (int g : cells.facets)
    add_corners(_master, g, _master_dofs);

  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> block
      = Eigen::MatrixXd::Zero(dofs.size(), columns.size());
  // columns of the slave facet, then of one master facet after the other
  auto for_groups = [&](auto visit)
  {
    for (Eigen::Index first = 0, n; first < block.cols(); first += n)
      visit(first, n = D * (first == 0 ? _slave.nv() : _master.nv()));
  };
  BasisValues P, M;
  Sample here, along;
  for (int p : particles)
  {
    const State& s = _now.of(f)[p];
    const ContactLaw law = this->law(s);
    tabulate(s.xi.data(), here);
    CouplingBasis<D> B = basis(here, tangents);
    Kinematics<D> k;
    if (s.closed)
    {
      _master.ref.position.tabulate(s.target.xi.data(), P, true);
      _master.ref.displacement.tabulate(s.target.xi.data(), M);
      B.M = &M;
      B.master = _master.nu();
      k = kinematics(s, here.position, P);
    }
    const FrictionTangent<D> friction(s.friction);
    PairVector<D> r = PairVector<D>::Zero(dofs.size());
    add_residual<D>(B, law, s.closed, s.lambda, s.gap, traction_at(s), s.Lambda, s.friction,
                    s.weight, _options.scale, r);
    BasisValues second;
    _slave.ref.position.tabulate(s.xi.data(), second, true);
    const FacetPoint<D> X = evaluate<D>(_slave.facet_X(f), _slave.np(), second, true);
    BasisValues psi, phi;
    _particles.multiplier.tabulate(s.xi.data(), psi);
    if (B.friction > 0)
      _friction.basis.tabulate(s.xi.data(), phi);

    const auto& motion = cells.motion[p];
    Eigen::Matrix<double, Eigen::Dynamic, D> with(dofs.size(), D); // with log w and ξ
    with.col(0) = r;
    for (int b = 0; b < Q; ++b)
    {
      std::copy_n(here.position.dN[b], BasisValues::max_nodes, along.position.N);
      std::copy_n(here.displacement.dN[b], BasisValues::max_nodes, along.displacement.N);
      std::copy_n(psi.dN[b], BasisValues::max_nodes, along.psi.begin());
      std::copy_n(phi.dN[b], BasisValues::max_nodes, along.phi.begin());
      CouplingBasis<D> Bb = basis(along, tangents);
      const Rates<D> rate = rates(s, along, b);
      const PairVector<D> d
          = s.closed ? closed_rate<D, F>(B, Bb, law, s.lambda, k, s.Lambda, friction, rate,
                                         s.weight, _options.scale)
                     : open_rate<D>(B, Bb, law, s.lambda, s.Lambda, rate, s.weight, _options.scale);
      with.col(1 + b) = d + measure_rate<D>(X, b, _particles.axisymmetric) * r;
    }
    for_groups(
        [&](Eigen::Index first, Eigen::Index n)
        {
          if (not motion.middleCols(first, n).isZero(0))
            block.middleCols(first, n).noalias() += with.lazyProduct(motion.middleCols(first, n));
        });
  }

  // cells depend on few of the facets around, and the pattern has no place for the others
  for_groups(
      [&](Eigen::Index first, Eigen::Index n)
      {
        if (block.middleCols(first, n).isZero(0))
          return;
        const decltype(block) part = block.middleCols(first, n);
        const int kind = first == 0 ? slave_corners
                                    : master_corners + cells.facets[(first - D * _slave.nv()) / n];
        _adder.add({f, target, kind}, dofs, std::span(columns).subspan(first, n), part.data());
      });
}

// the members of this file; assembler.cpp instantiates the others
template Rates<2> Assembler<2>::rates(const State&, const Sample&, int) const;
template Rates<3> Assembler<3>::rates(const State&, const Sample&, int) const;
template void Assembler<2>::motion_tangent<false>(int, int, std::span<const int>, const Vector<2>*,
                                                  const std::vector<PetscInt>&,
                                                  const CellPoints<2>&) const;
template void Assembler<2>::motion_tangent<true>(int, int, std::span<const int>, const Vector<2>*,
                                                 const std::vector<PetscInt>&,
                                                 const CellPoints<2>&) const;
template void Assembler<3>::motion_tangent<false>(int, int, std::span<const int>, const Vector<3>*,
                                                  const std::vector<PetscInt>&,
                                                  const CellPoints<3>&) const;
template void Assembler<3>::motion_tangent<true>(int, int, std::span<const int>, const Vector<3>*,
                                                 const std::vector<PetscInt>&,
                                                 const CellPoints<3>&) const;

} // namespace dolfinx_contact
