// SPDX-License-Identifier: MIT
#pragma once

#include "../integration/particle_rule.h"
#include "../mechanics/coupling.h"

#include <petscmat.h>

namespace dolfinx_contact
{

/// Particles of the slave surface: fixed points of its facets.
struct Particles
{
  ParticleRule rule;
  std::vector<double> weight; ///< reference measure of each, (facets, particles)
  TraceBasis multiplier;      ///< basis ψ of the multiplier on a facet
  std::vector<double> nodes;  ///< its nodes on the reference facet, (nodes of ψ, D − 1)
};

/// Settings of a pair that the particles share.
template <int D>
struct PairOptions
{
  SearchOptions<D> search;
  NormalRule normals = NormalRule::facet;
  double crease = 1; ///< angle beyond which normals are not averaged, for interpolated ones
  ContactLaw law;
  double scale = 1; ///< the system's unknown is λ/scale and its rows (F2) are multiplied by scale
};

/// One contact pair on one rank: its particles, their targets and its blocks.
///
/// The loop over slave facets sums all particles of a (slave facet, target facet) pair before it
/// touches PETSc. Degrees of freedom are global numbers of the system; −1 marks those that are held
/// (Dirichlet conditions, excluded multipliers): their rows and columns are dropped.
template <int D>
class Assembler
{
public:
  /// @param slave this rank's own slave facets
  /// @param slave_dofs system dofs of its node table, (nodes, D), −1 if held
  /// @param multiplier_local local multiplier numbers of the facets, (facets, nodes of ψ)
  /// @param multiplier_dofs system dofs of the local multipliers, −1 if held
  /// @throws std::invalid_argument if sizes do not match
  Assembler(Surface slave, Particles particles, PairOptions<D> options,
            std::vector<PetscInt> slave_dofs, std::vector<std::int32_t> multiplier_local,
            std::vector<PetscInt> multiplier_dofs);

  /// New master facets after an exchange; targets are carried over by their global numbers.
  /// @param dofs system dofs of its node table, (nodes, D), −1 if held
  void set_master(Surface master, std::vector<PetscInt> dofs);

  /// Move both surfaces, search all targets and decide all statuses.
  /// @param u_slave displacement of the slave's node table, (nodes, D)
  /// @param u_master displacement of the master's node table, (nodes, D)
  /// @param lambda local multipliers (pressure units, negative in compression)
  /// @param close open particles with d_n > −close × facet diameter count as closed ("initial
  /// contact"); negative: none
  /// @returns number of particles whose status changed
  int update(std::span<const double> u_slave, std::span<const double> u_master,
             std::span<const double> lambda, double close);

  /// Add (F1) and (F2) to a vector of the system (VecSetValues; the caller assembles it).
  void residual(::Vec b) const;

  /// Add (F9) and (F13) to a matrix of the system (MatSetValues; the caller assembles it).
  void tangent(Mat A) const;

  /// Insert zeros wherever particles may couple: their targets and the neighbours of these.
  /// `remember` keeps the pattern for `pattern_holds`.
  void insert_pattern(Mat A, bool remember);

  /// True if all targets are within the pattern inserted last.
  bool pattern_holds() const;

  /// Multipliers whose gap no free displacement can change: at their node the slave and its target
  /// are held in the direction of the normal. Needs `update` before.
  /// @returns (facets, nodes of ψ), 1 where the facet says so
  std::vector<std::uint8_t> fixed_multipliers() const;

  /// System dofs of the local multipliers, −1 if held.
  void set_multiplier_dofs(std::vector<PetscInt> dofs);

  PairOptions<D>& options() { return _options; }
  const Surface& slave() const { return _slave; }
  const Surface& master() const { return _master; }

  /// State of one particle after `update`.
  struct State
  {
    Target<D> target;
    double lambda = 0;               ///< multiplier, negative in compression
    double gap = -INFINITY;          ///< d_n, negative if open; −∞ without a target
    Vector<D> x = Vector<D>::Zero(); ///< current position
    Vector<D> n = Vector<D>::Zero(); ///< normal, inward to the master
    bool closed = false;
    int changes = 0; ///< of status since `begin_step`
  };

  /// A step begins: forget the status changes of the last one.
  void begin_step()
  {
    for (State& s : _states)
      s.changes = 0;
  }
  const std::vector<State>& states() const { return _states; }

  /// Keep the present states, to come back to them after a failed solve.
  void accept() { _accepted = _states; }

  /// The states of the last `accept`.
  void restore() { _states = _accepted; }

  const Particles& particles() const { return _particles; }

  /// The law of one particle. Where λ ≠ 0 at the switch between open and closed (a gap inside a
  /// facet whose mean is closed), the residual of (F1) jumps and Newton may cycle between the two
  /// for ever. A particle that has changed its status more than `patience` times in a step gets the
  /// augmented variant, whose residual is continuous.
  ContactLaw law(const State& s) const
  {
    constexpr int patience = 3;
    ContactLaw law = _options.law;
    law.augmented = law.augmented or s.changes > patience;
    return law;
  }

  /// Contact traction on the slave per reference area at particle i (facet-major numbering).
  Vector<D> traction_at(int i) const
  {
    const State& s = _states[i];
    return traction<D>(law(s), s.closed, s.lambda, s.n, s.gap);
  }

private:
  template <typename Visit>
  void for_each_pair(int facet, Visit visit) const;
  CouplingBasis basis(int particle) const;
  void dofs_of(int facet, int target, std::vector<PetscInt>& dofs) const;
  void neighbours();
  void place(State& s) const;
  bool interpolated() const { return _options.normals == NormalRule::interpolated; }
  const NodalNormals<D>* normals() const { return interpolated() ? &_normals : nullptr; }
  using RingMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  void ring_dofs(const std::vector<std::int32_t>& nodes, std::vector<PetscInt>& dofs) const;
  void carry_over(std::vector<State>& states, const Surface& master) const;

  Surface _slave, _master;
  Particles _particles;
  PairOptions<D> _options;
  std::vector<PetscInt> _slave_dofs, _master_dofs, _multiplier_dofs;
  std::vector<std::int32_t> _multiplier_local;

  std::vector<BasisValues> _position, _displacement; // slave bases at the particles
  std::vector<double> _psi;                          // (particles, nodes of ψ)
  Search<D> _search;
  NodalNormals<D> _normals;              // of the master, if interpolated
  std::vector<State> _states, _accepted; // (facets, particles)
  std::vector<std::int32_t> _near_offset,
      _near; // facets that share a vertex with each master facet
  std::vector<std::vector<std::int64_t>> _pattern; // global numbers of targets in the pattern
};

extern template class Assembler<2>;
extern template class Assembler<3>;

} // namespace dolfinx_contact
