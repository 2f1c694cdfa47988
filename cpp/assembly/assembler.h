// SPDX-License-Identifier: MIT
#pragma once

#include "../integration/segments.h"
#include "../mechanics/coupling.h"
#include "../targets/rigid_tool.h"
#include "block_adder.h"
#include "pattern.h"

#include <array>
#include <optional>
#include <petscmat.h>

namespace dolfinx_contact
{

/// Particles of the slave surface: fixed points of its facets, or those of its common refinement
/// with the master, which move on the slave while the surfaces do.
struct Particles
{
  ParticleRule rule;          ///< on the reference facet; if `refined` on the reference simplex
  std::vector<double> weight; ///< reference measure of each, (facets, particles); none if `refined`
  TraceBasis multiplier;      ///< basis ψ of the multiplier on a facet
  std::vector<double> nodes;  ///< of the multipliers, on the reference facet, (nodes, D − 1)
  /// Unit direction e of (F5) at the particles and at `nodes`, (facets, particles + nodes, D);
  /// empty where there is none, or where it is the slave's normal. If `refined` at the nodes of the
  /// position basis in place of the particles, which interpolates it
  std::vector<double> direction;
  bool refined = false;
  bool axisymmetric = false; ///< if `refined`: weights have a factor 2πR
};

/// Bases at a particle.
struct Sample
{
  BasisValues position, displacement;                  ///< of the slave
  std::array<double, BasisValues::max_nodes> psi, phi; ///< of the multiplier and of friction
};

/// Friction unknowns of a pair: Λ = Σ_a φ_a t_aα Λ_aα.
template <int D>
struct FrictionSpace
{
  TraceBasis basis;                ///< φ on a facet
  std::vector<std::int32_t> local; ///< local node numbers of the facets, (facets, nodes of φ)
  std::vector<PetscInt> dofs;      ///< system dofs, (local nodes, D − 1), −1 if held
  std::vector<Vector<D>> tangent;  ///< t_aα, (local nodes, D − 1)

  int nodes() const { return local.empty() ? 0 : basis.nodes(); }
};

/// Settings of a pair that the particles share.
template <int D>
struct PairOptions
{
  SearchOptions<D> search; ///< its rule is that of `rules`
  Rules rules;
  bool slave_facets = false; ///< if e turns: it is the slave facet's normal, not the interpolated
  double crease = 1;         ///< angle beyond which interpolated normals are not averaged
  bool convected = true;     ///< measure of the slip
  bool rubbing = false;      ///< with friction
  ContactLaw law;
  Scales scale;
};

/// What stays as it is while Newton iterates: the loops of the paper outside of Newton.
struct Frozen
{
  bool geometry = false;  ///< targets and normals; gaps and slips are linear in ⟦u⟧ then
  bool threshold = false; ///< λ in the friction's limit μ λ
  bool status = false;    ///< open or closed, stick or slip
};

/// Particles that changed their status in one update.
struct Changes
{
  int opened = 0, closed = 0;
  int slid = 0, stuck = 0; ///< began to slip, to stick
  int reversals = 0;       ///< slip on, in another direction (by more than 90°)

  int contact() const { return opened + closed; }
  int slip() const { return slid + stuck; }
};

/// Displacements of the node tables and multipliers of one evaluation.
struct Unknowns
{
  std::span<const double> slave, master; ///< (nodes, D)
  std::span<const double> lambda;        ///< local multipliers [pressure], negative in compression
  std::span<const double> Lambda;        ///< local friction unknowns, (local nodes, D − 1)
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
  /// @param slave this rank's own slave facets, then their ring (with_ring)
  /// @param own number of its own facets
  /// @param slave_dofs system dofs of its node table, (nodes, D), −1 if held
  /// @param multiplier_local local multiplier numbers of the own facets, (facets, nodes of ψ)
  /// @param multiplier_dofs system dofs of the local multipliers, −1 if held
  /// @throws std::invalid_argument if sizes do not match
  Assembler(Surface slave, int own, Particles particles, PairOptions<D> options,
            std::vector<PetscInt> slave_dofs, std::vector<std::int32_t> multiplier_local,
            std::vector<PetscInt> multiplier_dofs);

  /// New master facets after an exchange; targets are carried over by their global numbers.
  /// @param dofs system dofs of its node table, (nodes, D), −1 if held
  /// @param reach all master facets within this distance of a slave facet are among these, for each
  /// of the own ones; infinite: all within the search radius. None: everywhere infinite
  void set_master(Surface master, std::vector<PetscInt> dofs, std::vector<double> reach = {});

  /// A rigid tool for the master; the caller may move it later.
  /// @param dofs system dofs of its pieces' translations, (pieces, D), −1 if prescribed
  /// @throws std::invalid_argument if sizes do not match
  void set_tool(std::shared_ptr<const RigidTool<D>> tool, std::vector<PetscInt> dofs);

  /// Friction unknowns, or others than before.
  /// @throws std::invalid_argument if sizes do not match
  void set_friction(FrictionSpace<D> friction);

  /// The displacements of the last accepted step: slips are measured from there. To be given again
  /// after `set_master`.
  void remember(std::span<const double> u_slave, std::span<const double> u_master);

  /// Move both surfaces, search all targets and decide all statuses.
  /// @param close open particles with d_n > −close × facet diameter count as closed ("initial
  /// contact"); negative: none
  /// @param again only particles that are not settled, after `set_master` has brought more facets
  Changes update(const Unknowns& u, double close, bool again = false);

  /// For each own facet how far away the last search of its particles was decided; infinite if one
  /// has found nothing. Where it exceeds the reach some particles are not settled: facets that are
  /// not here may be nearer, and the particles have kept the status they had before.
  std::vector<double> decided() const;

  /// Freeze some things as the last `update` left them, and let go of the others.
  void freeze(Frozen frozen);

  /// All closed particles stick, with a limit of μ times a pressure, as long as the status and the
  /// threshold are frozen.
  void glue(double pressure);

  /// Add (F1)–(F3) to a vector of the system (VecSetValues; the caller assembles it).
  void residual(::Vec b) const;

  /// Add (F9) and (F13) to a matrix of the system (BlockAdder; the caller assembles it, if it can
  /// also before).
  /// @param remote takes what is for rows of other ranks, and the caller sends it; null: PETSc does
  void tangent(Mat A, RemoteRows* remote = nullptr) const;

  /// Places of all blocks wherever particles may couple: with their targets and the neighbours of
  /// these.
  void add_pattern(Pattern& pattern);

  /// True if all targets are within the pattern added last.
  bool pattern_holds() const;

  /// What may move at a node of a multiplier.
  struct Node
  {
    bool has_target = false;
    double decided = 0;              ///< see `decided`
    Vector<D> n = Vector<D>::Zero(); ///< normal at its target
    /// Component i of the slave or of its target is free. (A tool does not count, though a force
    /// may drive it: two held nodes on one tool would be dependent.)
    std::array<bool, D> free_to_move{};
  };

  /// All of Particles::nodes of all own facets, where the surfaces are now: (own facets, nodes).
  std::vector<Node> nodes() const;

  /// System dofs of the local multipliers, −1 if held.
  void set_multiplier_dofs(std::vector<PetscInt> dofs);

  /// Parameters of the law, and units; the counts of status changes begin anew.
  void set_law(const ContactLaw& law, const Scales& scale);

  const PairOptions<D>& options() const { return _options; }
  const Surface& slave() const { return _slave; }
  const Surface& master() const { return _master; }
  int own() const { return _own; }
  const RigidTool<D>* tool() const { return _tool.get(); }

  /// Interpolated normals of the slave's surface where it is now, inward to the slave.
  const NodalNormals<D>& slave_normals() const { return _slave_normals; }

  /// State of one particle after `update`.
  struct State
  {
    int facet = 0; ///< of the slave
    int cell = -1; ///< if the particles move: the master facet its cell lies on, or −1
    Vector<D - 1> xi = Vector<D - 1>::Zero(); ///< where on the slave's facet
    double weight = 0;                        ///< its part of the reference measure
    bool settled = true;                      ///< no facet held elsewhere can be its target
    bool closed = false;
    int changes = 0; ///< between open and closed since `begin_step`
    Target<D> target;
    int piece = -1;                       ///< of the tool that the target is on
    double lambda = 0;                    ///< multiplier, negative in compression
    double gap = -INFINITY;               ///< d_n, negative if open; −∞ without a target
    Vector<D> n = Vector<D>::Zero();      ///< normal, inward to the master
    Vector<D> Lambda = Vector<D>::Zero(); ///< friction semi-multiplier
    Friction<D> friction;

    // what a residual does not read
    std::int64_t away = -1;             ///< id of its last target if that is not held here
    Vector<D> x = Vector<D>::Zero();    ///< current position
    Vector<D> e = Vector<D>::Zero();    ///< direction of (F5)
    Vector<D> n0 = Vector<D>::Zero();   ///< outward normal of the slave as the step began
    Vector<D> slip = Vector<D>::Zero(); ///< ⟦Δu⟧ since the last accepted step; 0 if open
    bool touched = false;  ///< it touched at the last accepted step: friction acts since then
    double dissipated = 0; ///< by friction, up to the last accepted step [energy/area]

    // as they were at `freeze`
    bool acts = false, slips = false;    ///< status of friction
    double threshold = 0;                ///< λ
    Vector<D> r0 = Vector<D>::Zero();    ///< x¹ − x²
    Vector<D> y0 = Vector<D>::Zero();    ///< x² on a tool, in its reference position
    Vector<D> slip0 = Vector<D>::Zero(); ///< slip
  };

  /// A step begins, with the surfaces at the last accepted displacements (one `update` there
  /// before): forget the status changes of the last one, freeze nothing. Friction acts on the
  /// particles that touch now. A particle that closes later in the step has no slip before it does,
  /// and where it has come from says nothing about friction.
  /// @param close as for `update`
  /// @returns the number of particles on which friction acts; 0 without friction
  int begin_step(double close);
  const std::vector<State>& states() const { return _now.states; }

  /// Numbers of closed particles on the pieces of the tool.
  std::vector<int> touching() const
  {
    std::vector<int> out(_tool ? _tool->pieces.size() : 0, 0);
    for (const State& s : _now.states)
      if (s.closed)
        ++out[s.piece];
    return out;
  }

  /// Energy that friction has dissipated on this rank, up to the last accepted step.
  double dissipated() const { return _dissipated; }

  /// The step is done: add what friction has dissipated, and keep the states to come back to after
  /// a failed solve. Once for each accepted step, before `remember`.
  void accept();

  /// Keep the present states for `recall`: evaluations in between leave no trace.
  void mark() { _marked = _now; }
  void recall() { _now = _marked; }

  /// The states of the last `accept`.
  void restore()
  {
    _now = _accepted;
    _frozen = {};
  }

  /// Go on from an accepted step of another run. Of its particles count where they are, whether
  /// they are closed, their targets (a tool's, or the global numbers in `away`), friction's status
  /// and what it has dissipated.
  /// @param states in the order of the facets
  /// @param dissipated see `dissipated`
  /// @throws std::invalid_argument if fixed particles are not as many as the rule's
  void resume(std::vector<State> states, double dissipated);

  const Particles& particles() const { return _particles; }

  /// The law of one particle. Where λ ≠ 0 at the switch between open and closed (a gap inside a
  /// facet whose mean is closed), the residual of (F1) jumps: there may be no solution, and Newton
  /// cycles between the two. A particle that has changed its status more than `patience` times in a
  /// step gets the continuous variant.
  ContactLaw law(const State& s) const
  {
    constexpr int patience = 3;
    ContactLaw law = _options.law;
    if (s.changes > patience)
    {
      law.continuous = true;
      law.kappa *= 1e-2; // Λ only has to be held where there is no pressure
    }
    return law;
  }

  /// x², the place of a particle's target; it must have one.
  Vector<D> target_point(const State& s) const;

  /// Contact traction on the slave per reference area.
  Vector<D> traction_at(const State& s) const
  {
    if (not s.closed)
      return Vector<D>::Zero();
    return traction<D>(law(s), s.lambda, s.n, s.gap, s.friction);
  }

private:
  /// Particles facet by facet: those of f are states[offset[f]] to states[offset[f + 1] − 1].
  struct Cloud
  {
    std::vector<int> offset;
    std::vector<State> states;
    std::span<const State> of(int f) const
    {
      return std::span(states).subspan(offset[f], offset[f + 1] - offset[f]);
    }
    std::span<State> of(int f)
    {
      return std::span(states).subspan(offset[f], offset[f + 1] - offset[f]);
    }
  };

  /// Work space of a loop over pairs.
  struct Groups
  {
    std::vector<std::array<int, 2>> order; // target, particle
    std::vector<int> particles;
  };
  template <typename Visit>
  void for_each_pair(int facet, Groups& work, Visit visit) const;
  const Vector<D>* tangents(int facet, std::vector<Vector<D>>& out) const;
  CouplingBasis<D> basis(const Sample& sample, const Vector<D>* tangents) const;
  void lay_out();
  CellPoints<D> cells(int facet, bool motion) const;
  void refine();
  Vector<D> first_normal(const State& s) const;
  static const State* nearest(const Cloud& cloud, const State& s);
  const Sample& sample(const State& s, Sample& buffer) const;
  void tabulate(const double* xi, Sample& out) const;
  void dofs_of(int facet, int target, std::vector<PetscInt>& dofs) const;
  void neighbours();
  std::vector<std::int32_t> target_nodes(int target) const;
  std::vector<std::int32_t> nodes_around(int target) const;
  int num_nodes() const { return static_cast<int>(_particles.nodes.size()) / (D - 1); }
  int num_directions() const;
  Vector<D> given_direction(int facet, const BasisValues& position, int point) const;
  Seeker<D> seeker(int facet, const BasisValues& position, const double* xi, int point) const;
  void seek(const Seeker<D>& seeker, State& s) const;
  void stay(const BasisValues& position, State& s) const;
  double near(int facet, double close) const;
  double reach(int facet) const { return _reach.empty() ? INFINITY : _reach[facet]; }
  Vector<D> slip(const State& s, const BasisValues& position) const;
  int target_of(const State& s) const
  {
    return not s.closed ? -1 : _tool ? s.piece : s.target.facet;
  }
  Slip<D> slip_at(const State& s, const FacetPoint<D>& target, const BasisValues& b,
                  const Vector<D>& x_old) const;
  Friction<D> friction(const State& s) const;
  Vector<D> old_position(const State& s, const BasisValues& position) const;

  Kinematics<D> kinematics(const State& s, const BasisValues& position, const BasisValues& b) const;
  bool interpolated() const { return _options.rules.normal == NormalRule::interpolated; }
  bool turns_smoothly() const { return _options.rules.turning and not _options.slave_facets; }
  const NodalNormals<D>* normals() const { return interpolated() ? &_normals : nullptr; }

  struct FieldSums;
  /// Kinds of blocks of a pair (BlockAdder::Name), by their columns; the last with a master facet's
  /// number added.
  enum
  {
    all_unknowns,
    master_ring,
    slave_ring,
    slave_corners,
    master_corners
  };
  template <bool F>
  void add_tangent() const;
  /// Columns of a pair's tangent that stand for the corners of cells: what the motion of its
  /// particles adds.
  struct MotionSums
  {
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    CellPoints<D> cells;           ///< of the slave facet
    std::vector<PetscInt> columns; ///< their system dofs
    Matrix block, part;
    Sample along; ///< work space

    void reset(const Assembler& a, int facet, std::size_t rows);
    template <typename Visit>
    void for_facets(const Assembler& a, Visit visit) const;
  };
  template <bool F>
  void add_motion(const State& s, int p, const Sample& here, const CouplingBasis<D>& B,
                  const ContactLaw& law, const Kinematics<D>& k, const FrictionTangent<D>& friction,
                  const ClosedParticle<D, F>* small, MotionSums& sums) const;
  void insert_motion(int facet, int target, const std::vector<PetscInt>& dofs,
                     MotionSums& sums) const;
  Rates<D> rates(const State& s, const Sample& along, int beta) const;
  void node_dofs(const std::vector<std::int32_t>& nodes, const std::vector<PetscInt>& table,
                 std::vector<PetscInt>& dofs) const;
  void carry_over(std::vector<State>& states, const Surface& master) const;

  Surface _slave, _master;
  bool _met = false;          // whether states may have targets, here or elsewhere
  std::vector<double> _reach; // of each own facet, none: infinite
  int _own;
  std::shared_ptr<const RigidTool<D>> _tool;
  std::vector<PetscInt> _tool_dofs; // none if no force drives the tool
  Particles _particles;
  PairOptions<D> _options;
  Frozen _frozen;
  std::vector<PetscInt> _slave_dofs, _master_dofs, _multiplier_dofs;
  std::vector<std::int32_t> _multiplier_local;
  FrictionSpace<D> _friction;

  std::vector<Sample> _samples; // at the particles of a facet, unless they move
  Search<D> _search;
  NodalNormals<D> _normals, _slave_normals; // of the master if interpolated, of the slave
  NodalNormals<D> _old_normals;             // of the master at the last accepted step, for slips
  NodalNormals<D> _first_normals;           // of the slave as the step began
  Cloud _now, _accepted, _marked;
  mutable BlockAdder _adder; // keeps the places of the blocks
  std::vector<double> _lambda,
      _semi_multiplier; // multipliers of the last update, if the particles move
  double _dissipated = 0;
  std::vector<std::int32_t> _near_offset,
      _near; // facets that share a vertex with each master facet
  std::vector<std::vector<std::int64_t>> _pattern; // global numbers of targets in the pattern
};

extern template class Assembler<2>;
extern template class Assembler<3>;

} // namespace dolfinx_contact
