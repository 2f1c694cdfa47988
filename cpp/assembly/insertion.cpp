// SPDX-License-Identifier: MIT
//
// What an Assembler writes into PETSc's vectors and matrices.
#include "assembler.h"
#include "events.h"
#include "petsc_check.h"

#include <algorithm>
#include <array>
#include <numeric>

namespace dolfinx_contact
{

namespace
{
// A tool driven by forces is a master facet with one node, its translation.
const BasisValues& rigid_basis()
{
  static const BasisValues one = {.N = {1}, .dN = {}, .ddN = {}};
  return one;
}

// Fetch what a residual reads of a state. There are more states than caches hold, and a residual
// does so little with each that it would wait for most.
template <typename State>
void fetch(const std::vector<State>& states, std::size_t i)
{
  if (i >= states.size())
    return;
  constexpr int line = 64; // bytes of the cache
  const char *p = reinterpret_cast<const char*>(&states[i]),
             *end = reinterpret_cast<const char*>(&states[i].away);
  for (; p < end; p += line)
    __builtin_prefetch(p);
}
} // namespace

// t_aα of the friction's nodes of a facet, null without friction.
template <int D>
const Vector<D>* Assembler<D>::tangents(int facet, std::vector<Vector<D>>& out) const
{
  constexpr int Q = D - 1;
  const int nf = _friction.nodes();
  out.resize(nf * Q);
  for (int a = 0; a < nf; ++a)
    for (int i = 0; i < Q; ++i)
      out[a * Q + i] = _friction.tangent[_friction.local[facet * nf + a] * Q + i];
  return nf > 0 ? out.data() : nullptr;
}

template <int D>
CouplingBasis<D> Assembler<D>::basis(const Sample& sample, const Vector<D>* tangents) const
{
  CouplingBasis<D> b;
  b.N = sample.displacement.N;
  b.slave = _slave.nu();
  b.multiplier = _particles.multiplier.nodes();
  b.psi = sample.psi.data();
  b.friction = _friction.nodes();
  if (b.friction > 0)
  {
    b.phi = sample.phi.data();
    b.tangent = tangents;
  }
  return b;
}

// System dofs of a pair, in the order of the coupling: slave, multiplier, friction, master (if
// any).
template <int D>
void Assembler<D>::dofs_of(int facet, int target, std::vector<PetscInt>& dofs) const
{
  constexpr int Q = D - 1;
  dofs.clear();
  auto add_nodes = [&](const Surface& s, int f, const std::vector<PetscInt>& table)
  {
    for (int a = 0; a < s.nu(); ++a)
      for (int i = 0; i < D; ++i)
        dofs.push_back(table[s.local[f * s.nu() + a] * D + i]);
  };
  add_nodes(_slave, facet, _slave_dofs);
  const int nl = _particles.multiplier.nodes(), nf = _friction.nodes();
  for (int a = 0; a < nl; ++a)
    dofs.push_back(_multiplier_dofs[_multiplier_local[facet * nl + a]]);
  for (int a = 0; a < nf; ++a)
    for (int i = 0; i < Q; ++i)
      dofs.push_back(_friction.dofs[_friction.local[facet * nf + a] * Q + i]);
  if (target >= 0 and not _tool)
    add_nodes(_master, target, _master_dofs);
  else if (target >= 0 and not _tool_dofs.empty())
    for (int i = 0; i < D; ++i)
      dofs.push_back(_tool_dofs[target * D + i]);
}

// Visit the particles of a slave facet grouped by target (a facet, or a piece of the tool):
// visit(target, particles). Open particles are grouped as target −1: nothing couples them to a
// master.
template <int D>
template <typename Visit>
void Assembler<D>::for_each_pair(int facet, Groups& work, Visit visit) const
{
  const std::span<const State> states = _now.of(facet);
  const int np = static_cast<int>(states.size());
  auto& order = work.order;
  order.resize(np);
  work.particles.resize(np);
  for (int p = 0; p < np; ++p)
    order[p] = {target_of(states[p]), p};
  std::sort(order.begin(), order.end());
  for (int p = 0; p < np; ++p)
    work.particles[p] = order[p][1];
  for (int begin = 0, end; begin < np; begin = end)
  {
    for (end = begin; end < np and order[end][0] == order[begin][0];)
      ++end;
    visit(order[begin][0], std::span<const int>(work.particles).subspan(begin, end - begin));
  }
}

template <int D>
void Assembler<D>::residual(::Vec b) const
{
  const Logged logged(Event::residual);
  check(VecSetOption(b, VEC_IGNORE_NEGATIVE_INDICES, PETSC_TRUE), "VecSetOption");
  Sample buffer;
  Groups work;
  std::vector<PetscInt> dofs;
  std::vector<Vector<D>> tangents;
  PairVector<D> block;
  BasisValues M;
  for (int f = 0; f < _own; ++f)
  {
    const Vector<D>* const tangent = this->tangents(f, tangents);
    for_each_pair(f, work,
                  [&](int target, std::span<const int> particles)
                  {
                    dofs_of(f, target, dofs);
                    block.setZero(dofs.size());
                    for (int p : particles)
                    {
                      // of the next facet
                      fetch(_now.states, _now.offset[f + 1] + p);
                      const State& s = _now.of(f)[p];
                      CouplingBasis<D> B = basis(sample(s, buffer), tangent);
                      if (target >= 0 and not _tool)
                      {
                        _master.ref.displacement.tabulate(s.target.xi.data(), M);
                        B.M = &M;
                        B.master = _master.nu();
                      }
                      else if (target >= 0 and not _tool_dofs.empty())
                      {
                        B.M = &rigid_basis();
                        B.master = 1;
                      }
                      add_residual<D>(B, law(s), s.closed, s.lambda, s.gap, traction_at(s),
                                      s.Lambda, s.friction, s.weight, _options.scale, block);
                    }
                    check(VecSetValues(b, dofs.size(), dofs.data(), block.data(), ADD_VALUES),
                          "VecSetValues");
                  });
  }
}

// Columns of a pair's tangent that stand for the nodal normals n_A at the corners of a facet (F8').
// They are summed over the particles of the pair, and multiplied by ∂n_A/∂u once.
template <int D>
struct Assembler<D>::FieldSums
{
  const Surface& surface;
  const NodalNormals<D>& normals;
  CornerColumns<D> columns;
  std::vector<int> known; // of each facet: its place in `derivatives`, or −1
  std::vector<NormalDerivative<D>> derivatives; // of the facets met so far
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> values;

  FieldSums(const Surface& s, const NodalNormals<D>& n, bool used)
      : surface(s)
      , normals(n)
      , known(used ? s.size() : 0, -1)
  {
  }

  // Σ_A columns_A ∂n_A/∂u in `values`, and the nodes that its columns stand for
  const std::vector<std::int32_t>& finish(int f)
  {
    if (known[f] < 0)
    {
      known[f] = static_cast<int>(derivatives.size());
      derivatives.push_back(normals.derivative(surface, f));
    }
    const NormalDerivative<D>& d = derivatives[known[f]];
    values.noalias() = columns * d.dn;
    return d.nodes;
  }
};

template <int D>
void Assembler<D>::tangent(Mat A, RemoteRows* remote) const
{
  const Logged logged(Event::tangent);
  _adder.open(A, remote);
  try
  {
    if (_friction.nodes() > 0)
      add_tangent<true>();
    else
      add_tangent<false>();
  }
  catch (...)
  {
    _adder.close();
    throw;
  }
  _adder.close();
}

template <int D>
template <bool F>
void Assembler<D>::add_tangent() const
{
  const int Q = D - 1;
  const bool moves = not _tool and not _frozen.geometry;
  const bool field = interpolated() and moves, turns = turns_smoothly() and moves;
  Groups work;
  std::vector<PetscInt> dofs, ring;
  std::vector<Vector<D>> tangents;
  PairMatrix<D> block;
  BasisValues P, M;
  Sample buffer;
  const bool same = _tool or _master.ref.isoparametric();
  FieldSums of_master(_master, _normals, field), of_slave(_slave, _slave_normals, turns);
  FrictionTangent<D> friction{Friction<D>()};
  const bool motion = _particles.refined and moves;
  MotionSums of_cells;
  for (int f = 0; f < _own; ++f)
  {
    if (motion)
      of_cells.cells = cells(f, true);
    const Vector<D>* const tangent = this->tangents(f, tangents);
    auto add_pair = [&](int target, std::span<const int> particles)
    {
      dofs_of(f, target, dofs);
      block.setZero(dofs.size(), dofs.size());
      if (field and target >= 0)
        of_master.columns.setZero(dofs.size(), _master.nv() * D);
      if (turns and target >= 0)
        of_slave.columns.setZero(dofs.size(), _slave.nv() * D);
      if (motion)
        of_cells.reset(*this, f, dofs.size());
      for (int p : particles)
      {
        const State& s = _now.of(f)[p];
        const Sample& here = sample(s, buffer);
        const double w = s.weight;
        const ContactLaw law = this->law(s);
        CouplingBasis<D> B = basis(here, tangent);
        if (target < 0)
        {
          add_open_tangent<D>(B, law, w, _options.scale, block);
          if (motion)
            add_motion<F>(s, p, here, B, law, {}, friction, nullptr, of_cells);
          continue;
        }
        if (not _tool)
        {
          _master.ref.position.tabulate(s.target.xi.data(), P, true);
          if (not same)
            _master.ref.displacement.tabulate(s.target.xi.data(), M);
          B.M = same ? &P : &M;
          B.master = _master.nu();
        }
        else if (not _tool_dofs.empty())
        {
          B.M = &rigid_basis();
          B.master = 1;
        }
        const Kinematics<D> k = kinematics(s, here.position, P);
        if constexpr (F)
          friction = FrictionTangent<D>(s.friction);
        const ClosedParticle<D, F> small
            = closed_particle<D, F>(law, s.lambda, k, friction, w, _options.scale);
        add_closed_tangent<D, F>(B, small, block);
        if (motion)
          add_motion<F>(s, p, here, B, law, k, friction, &small, of_cells);
        double N[4], dN[2][4];
        if (field)
        {
          corner_basis(_master.ref.shape, s.target.xi.data(), N, dN);
          add_corner_columns<D, F>(B, law, s.lambda, k, k.m, friction, w, _options.scale,
                                   Eigen::Matrix<double, D, D>::Identity(), N, of_master.columns);
        }
        if (turns)
        {
          // e = −M/‖M‖ with the slave's M
          const InterpolatedNormal<D> nbar(_slave_normals.at(_slave, f, s.xi.data()));
          corner_basis(_slave.ref.shape, s.xi.data(), N, dN);
          add_corner_columns<D, F>(B, law, s.lambda, k, k.e, friction, w, _options.scale,
                                   -nbar.of_m, N, of_slave.columns);
        }
        else if (_options.rules.turning and moves)
        {
          // the slave facet's own normal: δe = Σ_α (∂e/∂τ_α) ∂_α δu¹
          const FacetPoint<D> own
              = evaluate<D>(_slave.facet_x(f), _slave.np(), here.position, false);
          const FieldColumns<D> e
              = field_columns<D, F>(B, law, s.lambda, k, k.e, friction, w, _options.scale);
          const auto of_tangent = normal_of_tangents<D>(own, -_slave.sigma[f]);
          for (int i = 0; i < Q; ++i)
          {
            const FieldColumns<D> with = e * of_tangent[i];
            for (int a = 0; a < B.slave; ++a)
              block.template middleCols<D>(a * D) += here.displacement.dN[i][a] * with;
          }
        }
      }
      _adder.add({f, target, all_unknowns}, dofs, dofs, block.data());
      if (field and target >= 0)
      {
        node_dofs(of_master.finish(target), _master_dofs, ring);
        _adder.add({f, target, master_ring}, dofs, ring, of_master.values.data());
      }
      if (turns and target >= 0)
      {
        node_dofs(of_slave.finish(f), _slave_dofs, ring);
        _adder.add({f, target, slave_ring}, dofs, ring, of_slave.values.data());
      }
      if (motion)
        insert_motion(f, target, dofs, of_cells);
    };
    for_each_pair(f, work, add_pair);
  }
}

template <int D>
void Assembler<D>::node_dofs(const std::vector<std::int32_t>& nodes,
                             const std::vector<PetscInt>& table, std::vector<PetscInt>& dofs) const
{
  dofs.clear();
  for (const std::int32_t node : nodes)
    for (int i = 0; i < D; ++i)
      dofs.push_back(table[node * D + i]);
}

// the members of this file; assembler.cpp instantiates the others
template const Vector<2>* Assembler<2>::tangents(int, std::vector<Vector<2>>&) const;
template const Vector<3>* Assembler<3>::tangents(int, std::vector<Vector<3>>&) const;
template CouplingBasis<2> Assembler<2>::basis(const Sample&, const Vector<2>*) const;
template CouplingBasis<3> Assembler<3>::basis(const Sample&, const Vector<3>*) const;
template void Assembler<2>::dofs_of(int, int, std::vector<PetscInt>&) const;
template void Assembler<3>::dofs_of(int, int, std::vector<PetscInt>&) const;
template void Assembler<2>::node_dofs(const std::vector<std::int32_t>&,
                                      const std::vector<PetscInt>&, std::vector<PetscInt>&) const;
template void Assembler<3>::node_dofs(const std::vector<std::int32_t>&,
                                      const std::vector<PetscInt>&, std::vector<PetscInt>&) const;
template void Assembler<2>::residual(::Vec) const;
template void Assembler<3>::residual(::Vec) const;
template void Assembler<2>::tangent(Mat, RemoteRows*) const;
template void Assembler<3>::tangent(Mat, RemoteRows*) const;

} // namespace dolfinx_contact
