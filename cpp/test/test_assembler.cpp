// SPDX-License-Identifier: MIT
//
// An Assembler on two small curved surfaces: its tangent against differences of its residual, while
// geometry, threshold and status are held or not, and what holding them means.
#include "../assembly/assembler.h"
#include "../assembly/petsc_check.h"
#include "scenes.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <numeric>

using namespace dolfinx_contact;
using namespace dolfinx_contact::test;

namespace
{

constexpr Scales scales{3.7, 0.6};

/// A surface over [lower, upper]^{D−1} with its body above (up = 1) or below it.
template <int D>
Surface wavy(const Element& element, double lower, double upper, double up, std::mt19937& random)
{
  Surface s = build<D>(
      element.ref(), D == 2 ? line_cells(2) : square_cells(element.shape, 2),
      [&](const Eigen::Vector3d& q)
      {
        Vector<D> x = (lower + (upper - lower) * q.array()).matrix().template head<D>();
        x[D - 1] = 0.1 * std::sin(2 * x[0] + 1) * (D == 2 ? 1 : std::cos(1.5 * x[D - 2]));
        return x;
      },
      [&](const Vector<D>&) { return Vector<D>(up * Vector<D>::Unit(D - 1)); }, random);
  std::iota(s.id.begin(), s.id.end(), 0);
  return s;
}

/// Four laws of contact with the same surfaces.
struct Setting
{
  Rules rules;
  bool convected;
};
const Setting settings[] = {{{TargetRule::proximity, NormalRule::facet, false}, true},
                            {{TargetRule::proximity, NormalRule::facet, false}, false},
                            {{TargetRule::smooth, NormalRule::interpolated, false}, true},
                            {{TargetRule::direction, NormalRule::direction, true}, true}};

/// Half of the particles touch, and half of these slip. Unknowns: displacements of the slave and of
/// the master, λ and Λ in their scales.
template <int D>
class Problem
{
public:
  static constexpr int Q = D - 1;

  explicit Problem(const Setting& setting)
      : _element(D == 2 ? Element{Shape::interval, 2, 2} : Element{Shape::quadrilateral, 1, 1})
      , _slave(wavy<D>(_element, 0, 1, 1, _random))
      , _master(wavy<D>(_element, -0.3, 1.47, -1, _random))
      , _ns(_slave.node_table.size() * D)
      , _nm(_master.node_table.size() * D)
      , _nl(_slave.node_table.size())
      , size(_ns + _nm + _nl * D)
      , assembler(_slave, _slave.size(), particles(), options(setting), dofs(0, _ns), _slave.local,
                  dofs(_ns + _nm, _nl))
      , U(size)
  {
    assembler.set_master(_master, dofs(_ns, _nm));
    FrictionSpace<D> space{
        _slave.ref.displacement, _slave.local, dofs(_ns + _nm + _nl, _nl * Q), {}};
    for (int i = 0; i < _nl * Q; ++i)
      space.tangent.push_back(Vector<D>::Unit(i % Q));
    assembler.set_friction(space);

    for (double& v : U) // the last accepted step
      v = uniform(_random, -0.02, 0.02);
    assembler.remember(slave(U), master(U));
    assembler.update(unknowns(U), -1);
    assembler.begin_step(1); // friction acts on all particles
    for (int i = 0; i < _ns; ++i)
      U[i] += i % D == 0 ? 0.18 - 0.17 * x_of(i / D)
                         : uniform(_random, -0.05, 0.01) - 0.015 * x_of(i / D);
    for (int i = 0; i < _nl; ++i)
      U[_ns + _nm + i] = uniform(_random, -0.2, 0);
    for (int i = 0; i < _nl * Q; ++i)
      U[_ns + _nm + _nl + i] = uniform(_random, -0.6, 0.6);
    update(U);
    VecCreateSeq(PETSC_COMM_SELF, size, &_b);
    MatCreateSeqDense(PETSC_COMM_SELF, size, size, nullptr, &_A);
  }
  Problem(const Problem&) = delete;
  ~Problem()
  {
    VecDestroy(&_b);
    MatDestroy(&_A);
  }

  Changes update(const Eigen::VectorXd& V)
  {
    const Unknowns u = unknowns(V);
    return assembler.update(u, -1);
  }

  /// Of the last update.
  Eigen::VectorXd residual() const
  {
    check(VecSet(_b, 0), "VecSet");
    assembler.residual(_b);
    check(VecAssemblyBegin(_b), "VecAssemblyBegin");
    check(VecAssemblyEnd(_b), "VecAssemblyEnd");
    std::vector<PetscInt> all = dofs(0, size);
    Eigen::VectorXd out(size);
    check(VecGetValues(_b, size, all.data(), out.data()), "VecGetValues");
    return out;
  }

  Eigen::MatrixXd tangent() const
  {
    check(MatZeroEntries(_A), "MatZeroEntries");
    assembler.tangent(_A);
    check(MatAssemblyBegin(_A, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
    check(MatAssemblyEnd(_A, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
    std::vector<PetscInt> all = dofs(0, size);
    Points out(size, size);
    check(MatGetValues(_A, size, all.data(), size, all.data(), out.data()), "MatGetValues");
    return out;
  }

  /// The tangent at V by differences, from the present states, which it comes back to.
  Eigen::MatrixXd differences(const Eigen::VectorXd& V)
  {
    constexpr double smaller = 0.05; // no status changes
    Eigen::MatrixXd out(size, size);
    assembler.mark();
    for (int j = 0; j < size; ++j)
      out.col(j) = central(
                       [&](double h)
                       {
                         assembler.recall();
                         const Changes c = update(V + smaller * h * Eigen::VectorXd::Unit(size, j));
                         REQUIRE(c.contact() + c.slip() == 0);
                         return residual();
                       })
                   / smaller;
    assembler.recall();
    update(V);
    return out;
  }

  /// Somewhere else, so far that statuses and targets differ.
  Eigen::VectorXd elsewhere()
  {
    Eigen::VectorXd V = U;
    for (int i = 0; i < _ns; ++i)
      V[i] += i % D == 0 ? -0.18 - 0.12 * x_of(i / D)
                         : uniform(_random, -0.06, 0.06) + 0.2 * (x_of(i / D) - 0.6);
    for (int i = 0; i < _nl; ++i)
      V[_ns + _nm + i] *= uniform(_random, 0.1, 2);
    return V;
  }

  /// All multipliers are `value`.
  Eigen::VectorXd pressed(double value) const
  {
    Eigen::VectorXd V = U;
    V.segment(_ns + _nm, _nl).setConstant(value / scales.pressure);
    return V;
  }

  /// Number of particles that are so.
  template <typename Is>
  int count(Is is) const
  {
    return std::count_if(assembler.states().begin(), assembler.states().end(), is);
  }

private:
  static std::vector<PetscInt> dofs(int first, int n)
  {
    std::vector<PetscInt> out(n);
    std::iota(out.begin(), out.end(), first);
    return out;
  }

  /// First coordinate of a node of the slave; positions and displacements have the same nodes.
  double x_of(int node) const
  {
    const auto at = std::find(_slave.local.begin(), _slave.local.end(), node);
    return _slave.X[(at - _slave.local.begin()) * D];
  }

  Particles particles() const
  {
    const ParticleRule rule = simpson(_element.shape, D == 2 ? 2 : 1);
    return {rule, particle_weights(_slave, rule, false), _slave.ref.displacement, {}, {}};
  }

  static PairOptions<D> options(const Setting& setting)
  {
    PairOptions<D> o;
    o.search.radius = 0.5;
    o.rules = setting.rules;
    o.convected = setting.convected;
    o.crease = 3.1;
    o.rubbing = true;
    o.law = {.rho_n = 20, .friction = 0.4, .rho_t = 10, .kappa = 0.05, .least = 1e-3};
    o.scale = scales;
    return o;
  }

  std::span<const double> slave(const Eigen::VectorXd& V) const
  {
    return {V.data(), V.data() + _ns};
  }
  std::span<const double> master(const Eigen::VectorXd& V) const
  {
    return {V.data() + _ns, V.data() + _ns + _nm};
  }
  Unknowns unknowns(const Eigen::VectorXd& V)
  {
    _lambda = scales.pressure * V.segment(_ns + _nm, _nl);
    _Lambda = scales.friction * V.tail(_nl * Q);
    return {slave(V),
            master(V),
            {_lambda.data(), _lambda.data() + _nl},
            {_Lambda.data(), _Lambda.data() + _nl * Q}};
  }

  std::mt19937 _random{21};
  Element _element;
  Surface _slave, _master;
  int _ns, _nm, _nl;
  Eigen::VectorXd _lambda, _Lambda;
  ::Vec _b = nullptr;
  Mat _A = nullptr;

public:
  const int size;
  Assembler<D> assembler;
  Eigen::VectorXd U;
};

template <int D>
using State = typename Assembler<D>::State;

/// All ways to hold something.
const std::vector<Frozen> all_frozen = []
{
  std::vector<Frozen> out;
  for (int i = 0; i < 8; ++i)
    out.push_back({bool(i & 1), bool(i & 2), bool(i & 4)});
  return out;
}();

} // namespace

TEMPLATE_TEST_CASE_SIG("Assembler: inconsistent rules are refused", "", ((int D), D), 2, 3)
{
  auto refused = [](const Rules& rules) {
    REQUIRE_THROWS_AS(Problem<D>({rules, true}), std::invalid_argument);
  };
  refused({TargetRule::proximity, NormalRule::facet, true});
  refused({TargetRule::smooth, NormalRule::interpolated, true});
  refused({TargetRule::proximity, NormalRule::direction, false});
  refused({TargetRule::smooth, NormalRule::direction, false});
  refused({TargetRule::smooth, NormalRule::facet, false});
  refused({TargetRule::direction, NormalRule::facet, false}); // no directions are given
  for (const Setting& s : settings)
    REQUIRE_NOTHROW(Problem<D>(s));
}

TEMPLATE_TEST_CASE_SIG("Assembler: the tangent is the derivative of the residual, whatever is held",
                       "", ((int D), D), 2, 3)
{
  for (const Setting& setting : settings)
  {
    Eigen::VectorXd b;
    for (const Frozen& frozen : all_frozen)
    {
      CAPTURE(static_cast<int>(setting.rules.target), setting.convected);
      CAPTURE(frozen.geometry, frozen.threshold, frozen.status);
      Problem<D> p(setting);
      REQUIRE(p.count([](const State<D>& s) { return not s.closed; }) > 1);
      REQUIRE(p.count([](const State<D>& s) { return s.friction.acts and s.friction.slips; }) > 1);
      REQUIRE(p.count([](const State<D>& s) { return s.friction.acts and not s.friction.slips; })
              > 1);
      b = p.residual();
      const Eigen::MatrixXd free = p.tangent();

      // nothing has moved yet
      p.assembler.freeze(frozen);
      const Changes none = p.update(p.U);
      REQUIRE(none.contact() + none.slip() + none.reversals == 0);
      REQUIRE((p.residual() - b).norm() <= 1e-13 * b.norm());

      const Eigen::MatrixXd fd = p.differences(p.U), K = p.tangent();
      CAPTURE(relative(K, fd));
      REQUIRE(relative(K, fd) <= 1e-8);
      if (frozen.geometry or frozen.threshold)
        REQUIRE(relative(free, fd) > 1e-4);
      else
        REQUIRE(relative(free, fd) <= 1e-8);

      // away from there, what is held differs from what would be there
      const Eigen::VectorXd V = p.elsewhere();
      p.update(V);
      p.update(V);
      const Eigen::MatrixXd fd_there = p.differences(V), K_there = p.tangent();
      CAPTURE(relative(K_there, fd_there));
      REQUIRE(relative(K_there, fd_there) <= 1e-8);
    }
  }
}

TEMPLATE_TEST_CASE_SIG("Assembler: what is held, and let go of", "", ((int D), D), 2, 3)
{
  for (const Setting& setting : settings)
    for (const Frozen& frozen : all_frozen)
    {
      CAPTURE(static_cast<int>(setting.rules.target), setting.convected);
      CAPTURE(frozen.geometry, frozen.threshold, frozen.status);
      Problem<D> p(setting);
      const Eigen::VectorXd b = p.residual(), V = p.elsewhere();
      const std::vector<State<D>> then = p.assembler.states();
      p.assembler.freeze(frozen);
      p.assembler.mark();
      const Changes changes = p.update(V);
      const std::vector<State<D>> now = p.assembler.states();
      REQUIRE((p.residual() - b).norm() > 0.01 * b.norm());

      int turned = 0, opened = 0, closed = 0, slid = 0, stuck = 0, beyond = 0, below = 0,
          limits = 0;
      for (std::size_t i = 0; i < now.size(); ++i)
      {
        const State<D>&a = then[i], &c = now[i];
        turned += (c.n - a.n).norm() > 1e-3 or (c.target.xi - a.target.xi).norm() > 1e-3;
        opened += a.closed and not c.closed;
        closed += c.closed and not a.closed;
        if (not a.friction.acts or not c.friction.acts)
          continue;
        slid += c.friction.slips and not a.friction.slips;
        stuck += a.friction.slips and not c.friction.slips;
        beyond += not c.friction.slips and c.friction.p.norm() > 1.001;
        const Vector<D> g = c.friction.tangential(c.friction.q);
        below += c.friction.slips and g.norm() < 0.999;
        if (c.friction.slips)
          REQUIRE(c.friction.p.norm() == Approx(1));
        limits += std::abs(c.friction.limit - a.friction.limit) > 1e-3;
        REQUIRE(c.friction.limit == (frozen.threshold ? a.lambda : c.lambda));
        REQUIRE(c.friction.frozen == frozen.threshold);
      }
      REQUIRE((turned == 0) == frozen.geometry);
      REQUIRE((opened + closed == 0) == frozen.status);
      REQUIRE((slid + stuck == 0) == frozen.status);
      REQUIRE((beyond > 0) == frozen.status);
      REQUIRE((below > 0) == frozen.status);
      REQUIRE((limits == 0) == frozen.threshold);
      REQUIRE(changes.opened == opened);
      REQUIRE(changes.closed == closed);
      REQUIRE(changes.slid == slid);
      REQUIRE(changes.stuck == stuck);

      if (frozen.geometry) // gaps are linear, and so are slips
      {
        p.assembler.recall();
        p.update(2 * V - p.U);
        int linear = 0;
        for (std::size_t i = 0; i < now.size(); ++i)
        {
          const State<D>&a = then[i], &c = now[i], &e = p.assembler.states()[i];
          if (a.target.facet < 0)
            continue;
          REQUIRE(std::abs(a.gap - 2 * c.gap + e.gap) <= 100 * eps);
          if (a.closed and c.closed and e.closed)
            REQUIRE((a.slip - 2 * c.slip + e.slip).norm() <= 100 * eps);
          linear += std::abs(c.gap - a.gap) > 1e-3;
        }
        REQUIRE(linear > 0);
      }

      p.assembler.recall();
      p.assembler.freeze({});
      p.update(p.U);
      REQUIRE((p.residual() - b).norm() <= 1e-13 * b.norm());
      p.assembler.freeze(frozen);
      p.assembler.begin_step(1); // lets go, too
      p.update(V);
      for (const State<D>& s : p.assembler.states())
        REQUIRE((not s.friction.acts or (s.friction.limit == s.lambda and not s.friction.frozen)));
    }
}

TEMPLATE_TEST_CASE_SIG("Assembler: with targets held the residual depends on the unknowns alone",
                       "", ((int D), D), 2, 3)
{
  // also where particles close that were open
  Problem<D> p(settings[0]);
  const Eigen::VectorXd opened = p.pressed(3), closed = p.pressed(-3);
  p.update(opened);
  p.assembler.freeze({.geometry = true});
  const Changes changes = p.update(closed);
  REQUIRE(changes.contact() > 5);
  const Eigen::VectorXd b = p.residual();
  p.update(closed);
  REQUIRE((p.residual() - b).norm() <= 1e-13 * b.norm());
}

TEMPLATE_TEST_CASE_SIG("Assembler: glued particles stick at any pressure", "", ((int D), D), 2, 3)
{
  Problem<D> p(settings[0]);
  const Eigen::VectorXd V = p.pressed(-2.5);
  p.update(V);
  const int touching = p.count([](const State<D>& s) { return s.closed; });
  REQUIRE(p.count([](const State<D>& s) { return s.friction.slips; }) > 0);
  p.assembler.freeze({.threshold = true, .status = true});
  p.assembler.glue(7);
  for (const Eigen::VectorXd& at : {V, p.pressed(-0.1), p.pressed(0.1), p.elsewhere()})
  {
    p.update(at);
    REQUIRE(p.count([](const State<D>& s) { return s.closed; }) == touching);
    for (const State<D>& s : p.assembler.states())
    {
      REQUIRE(s.friction.acts == s.closed);
      REQUIRE_FALSE(s.friction.slips);
      REQUIRE((not s.closed or s.friction.limit == -7));
    }
    REQUIRE(relative(p.tangent(), p.differences(at)) <= 1e-8);
  }
  p.assembler.freeze({});
  p.update(V);
  REQUIRE(p.count([](const State<D>& s) { return s.friction.slips; }) > 0);
}

TEMPLATE_TEST_CASE_SIG("Assembler: evaluations between mark and recall leave no trace", "",
                       ((int D), D), 2, 3)
{
  Problem<D> p(settings[0]);
  const Eigen::VectorXd b = p.residual();
  const std::vector<State<D>> before = p.assembler.states();
  const auto changed = [](const State<D>& s) { return s.changes; };
  const int so_far = p.count(changed);
  p.assembler.mark();
  for (int i = 0; i < 5; ++i)
    p.update(i % 2 ? p.pressed(-3) : p.pressed(3));
  REQUIRE(p.count(changed) > so_far);
  p.assembler.recall();
  REQUIRE(p.count(changed) == so_far);
  const Changes none = p.update(p.U);
  REQUIRE(none.contact() + none.slip() + none.reversals == 0);
  REQUIRE((p.residual() - b).norm() <= 1e-13 * b.norm());
  for (std::size_t i = 0; i < before.size(); ++i)
    REQUIRE(p.assembler.states()[i].changes == before[i].changes);
}

TEMPLATE_TEST_CASE_SIG("Assembler: a slip that turns round is a reversal", "", ((int D), D), 2, 3)
{
  Problem<D> p(settings[0]);
  p.update(p.pressed(-3));
  const std::vector<State<D>> before = p.assembler.states();
  Eigen::VectorXd V = p.pressed(-3);
  for (int i = 0; i < static_cast<int>(p.assembler.slave().node_table.size()); ++i)
    V[i * D] -= 0.5;
  const Changes changes = p.update(V);
  int reversals = 0, slip = 0;
  for (std::size_t i = 0; i < before.size(); ++i)
  {
    const State<D>&a = before[i], &c = p.assembler.states()[i];
    if (not a.friction.acts or not c.friction.acts)
      continue;
    slip += a.friction.slips != c.friction.slips;
    reversals += a.friction.slips and c.friction.slips and a.friction.p.dot(c.friction.p) < 0;
  }
  REQUIRE(changes.reversals == reversals);
  REQUIRE(changes.slip() == slip);
  REQUIRE(reversals > 2);
}

TEMPLATE_TEST_CASE_SIG("Assembler: particles that open and close again and again", "", ((int D), D),
                       2, 3)
{
  for (const Setting& setting : settings)
    for (bool threshold : {false, true})
    {
      CAPTURE(static_cast<int>(setting.rules.target), setting.convected, threshold);
      Problem<D> p(setting);
      auto continuous = [&](const State<D>& s) { return p.assembler.law(s).continuous; };
      for (int i = 0; i < 6; ++i)
        p.update(i % 2 ? p.pressed(-3) : p.pressed(3));
      p.update(p.U);
      REQUIRE(p.count(continuous) > 5);
      p.assembler.freeze({.threshold = threshold});
      p.update(p.U);
      const ContactLaw& law = p.assembler.options().law;
      int rest = 0;
      for (const State<D>& s : p.assembler.states())
      {
        REQUIRE(continuous(s) == (s.changes > 3));
        REQUIRE(p.assembler.law(s).kappa == Approx(continuous(s) ? 0.01 * law.kappa : law.kappa));
        if (continuous(s) and s.friction.acts)
          REQUIRE(s.friction.limit == Approx(threshold ? s.lambda : s.lambda - law.rho_n * s.gap));
        rest += s.friction.rest > 0;
      }
      const Eigen::MatrixXd fd = p.differences(p.U);
      REQUIRE(relative(p.tangent(), fd) <= 1e-8);

      ContactLaw other = law;
      other.kappa *= 2;
      p.assembler.set_law(other, scales);
      REQUIRE(p.count(continuous) == 0);
      REQUIRE(p.assembler.options().law.kappa == other.kappa);
    }
}
