// SPDX-License-Identifier: MIT
//
// What the assembly costs: all of it through the assembler, and its parts: the arithmetic of the
// tangent without PETSc, and the insertion of finished blocks without arithmetic.
#include "../assembly/assembler.h"
#include "../assembly/petsc_check.h"
#include "surfaces.h"

#include <map>

using namespace dolfinx_contact;
using namespace dolfinx_contact::bench;

namespace
{

/// What a problem is made of beside its elements.
struct Setup
{
  bool friction = false;
  bool smooth = false;   ///< smooth targets, interpolated normals; else proximity, facet normals
  bool segments = false; ///< particles of the common refinement, 6 on each of its triangles
  int simpson_n = 1;
};

/// A contact problem without its bulk: everything closed, rows numbered at random. Friction acts
/// everywhere.
template <int D>
class Problem
{
public:
  Problem(const Element& element, int facets, const Setup& setup)
      : _pair(bench::pair<D>(element, facets, setup.simpson_n))
      , _dofs(_pair.slave, _pair.master, setup.friction)
      , _assembler(_pair.slave, _pair.slave.size(), particles(setup.segments), options(setup),
                   _dofs.slave, _pair.slave.local, _dofs.multiplier)
      , _u_master(_dofs.master.size(), 0.0)
      , _lambda(_dofs.multiplier.size(), -1.0)
      , _Lambda(_dofs.friction.size(), 0.1)
  {
    for (double fraction : {0.0, 0.02})
      _u_slave.push_back(_pair.slide(fraction));
    _assembler.set_master(_pair.master, _dofs.master);
    if (setup.friction)
      _assembler.set_friction(friction_space());
    _assembler.remember(_u_slave[0], _u_master);
    update();
    _assembler.begin_step(0); // everything touches: friction acts from the next update on
    if (setup.segments)
      _assembler.accept();
    update();
    allocate();
  }
  Problem(const Problem&) = delete;
  ~Problem()
  {
    VecDestroy(&b);
    MatDestroy(&A);
  }

  /// Search anew after a slide by 2 % of a facet, to and fro.
  void update()
  {
    std::swap(_u_slave[0], _u_slave[1]);
    _assembler.update({_u_slave[0], _u_master, _lambda, _Lambda}, -1);
  }

  int size() const { return static_cast<int>(_assembler.states().size()); }
  const Pair<D>& pair() const { return _pair; }
  const Assembler<D>& assembler() const { return _assembler; }

  /// Particles of a slave facet that share a target facet, and the system dofs of both.
  struct Block
  {
    int facet, target;
    std::vector<int> particles;
    std::vector<PetscInt> dofs;
  };
  std::vector<Block> blocks() const
  {
    std::vector<Block> out;
    const Surface &slave = _assembler.slave(), &master = _assembler.master();
    for (int f = 0; f < slave.size(); ++f)
    {
      std::map<int, std::vector<int>> groups;
      for (int p = 0; p < _pair.rule.size(); ++p)
        groups[_assembler.states()[f * _pair.rule.size() + p].target.facet].push_back(p);
      for (const auto& [target, particles] : groups)
      {
        Block block{f, target, particles, {}};
        for (int a = 0; a < slave.nu() * D; ++a)
          block.dofs.push_back(_dofs.slave[slave.local[f * slave.nu() + a / D] * D + a % D]);
        for (int a = 0; a < slave.nu(); ++a)
          block.dofs.push_back(_dofs.multiplier[slave.local[f * slave.nu() + a]]);
        for (int a = 0; a < master.nu() * D; ++a)
          block.dofs.push_back(
              _dofs.master[master.local[target * master.nu() + a / D] * D + a % D]);
        out.push_back(block);
      }
    }
    return out;
  }

  Mat A = nullptr; ///< with the pattern of the contact terms
  Vec b = nullptr;

private:
  /// Dofs of all nodes in random order, then the multipliers likewise, then friction.
  struct Dofs
  {
    std::vector<PetscInt> slave, master, multiplier, friction;
    PetscInt size;

    Dofs(const Surface& s, const Surface& m, bool rough)
    {
      std::mt19937 random(6);
      const PetscInt ns = s.node_table.size(), nm = m.node_table.size();
      std::vector<PetscInt> node(ns + nm);
      std::iota(node.begin(), node.end(), 0);
      std::shuffle(node.begin(), node.end(), random);
      for (PetscInt i = 0; i < (ns + nm) * D; ++i)
        (i < ns * D ? slave : master).push_back(node[i / D] * D + i % D);
      multiplier.resize(ns);
      std::iota(multiplier.begin(), multiplier.end(), (ns + nm) * D);
      std::shuffle(multiplier.begin(), multiplier.end(), random);
      size = (ns + nm) * D + ns;
      for (PetscInt i = 0; rough and i < ns * (D - 1); ++i)
        friction.push_back(size++);
    }
  };

  Particles particles(bool segments) const
  {
    if (segments)
      return {triangle(), {}, _pair.slave.ref.displacement, {}, {}, true};
    return {_pair.rule,
            particle_weights(_pair.slave, _pair.rule, false),
            _pair.slave.ref.displacement,
            {},
            {}};
  }

  /// Exact to degree 4 on the reference triangle.
  static ParticleRule triangle()
  {
    ParticleRule rule;
    for (const auto& [a, w] : {std::pair{0.445948490915965, 0.223381589678011 / 2},
                               std::pair{0.091576213509771, 0.109951743655322 / 2}})
      for (const auto& [x, y] : {std::pair{a, a}, std::pair{1 - 2 * a, a}, std::pair{a, 1 - 2 * a}})
      {
        rule.points.insert(rule.points.end(), {x, y});
        rule.weights.push_back(w);
      }
    return rule;
  }

  /// Nodes of the displacements, tangents along the axes.
  FrictionSpace<D> friction_space() const
  {
    FrictionSpace<D> space{_pair.slave.ref.displacement, _pair.slave.local, _dofs.friction, {}};
    for (std::size_t i = 0; i < _dofs.friction.size(); ++i)
      space.tangent.push_back(Vector<D>::Unit(i % (D - 1)));
    return space;
  }

  static PairOptions<D> options(const Setup& setup)
  {
    PairOptions<D> o;
    o.search.radius = 0.5;
    o.rubbing = setup.friction;
    o.law.friction = setup.friction ? 0.3 : 0;
    if (setup.smooth)
      o.rules = {TargetRule::smooth, NormalRule::interpolated};
    return o;
  }

  void allocate()
  {
    const PetscInt n = _dofs.size;
    Pattern pattern(PETSC_COMM_SELF, n);
    _assembler.add_pattern(pattern);
    pattern.finish();
    check(MatCreate(PETSC_COMM_SELF, &A), "MatCreate");
    check(MatSetSizes(A, n, n, n, n), "MatSetSizes");
    check(MatSetType(A, MATAIJ), "MatSetType");
    pattern.allocate(A);
    pattern.fill(A);
    check(MatSetOption(A, MAT_NEW_NONZERO_LOCATION_ERR, PETSC_TRUE), "MatSetOption");
    check(VecCreateSeq(PETSC_COMM_SELF, n, &b), "VecCreateSeq");
  }

  Pair<D> _pair;
  Dofs _dofs;
  Assembler<D> _assembler;
  std::vector<std::vector<double>> _u_slave;
  std::vector<double> _u_master, _lambda, _Lambda;
};

template <int D>
void update(benchmark::State& state, Problem<D>& problem)
{
  for (auto _ : state)
    problem.update();
  per(state, "particle", problem.size());
}

template <int D>
void residual(benchmark::State& state, Problem<D>& problem)
{
  for (auto _ : state)
    problem.assembler().residual(problem.b);
  per(state, "particle", problem.size());
}

template <int D>
void tangent(benchmark::State& state, Problem<D>& problem)
{
  for (auto _ : state)
    problem.assembler().tangent(problem.A);
  per(state, "particle", problem.size());
}

/// The arithmetic of `Assembler::tangent`. Without `product` only up to the variations of target,
/// normal and gap, which know nothing of degrees of freedom.
template <int D>
void arithmetic(benchmark::State& state, Problem<D>& problem, bool product)
{
  const std::vector<typename Problem<D>::Block> blocks = problem.blocks();
  const ParticleRule& rule = problem.pair().rule;
  const Surface &slave = problem.assembler().slave(), &master = problem.assembler().master();
  const std::vector<double>& weight = problem.assembler().particles().weight;
  std::vector<BasisValues> N(rule.size());
  for (int p = 0; p < rule.size(); ++p)
    slave.ref.displacement.tabulate(&rule.points[p * (D - 1)], N[p]);

  const ContactLaw law;
  const FrictionTangent<D> none{Friction<D>()};
  const Vector<D> e = Vector<D>::Zero();
  PairMatrix<D> K;
  BasisValues M;
  for (auto _ : state)
    for (const auto& block : blocks)
    {
      K.setZero(block.dofs.size(), block.dofs.size());
      for (int p : block.particles)
      {
        const int i = block.facet * rule.size() + p;
        const auto& s = problem.assembler().states()[i];
        master.ref.position.tabulate(s.target.xi.data(), M, true);
        const FacetPoint<D> point = evaluate<D>(master.facet_x(block.target), master.np(), M, true);
        const Kinematics<D> k = linearise<D>(master, s.target, s.x, point, {}, e);
        if (product)
        {
          const CouplingBasis<D> B{.N = N[p].N,
                                   .psi = N[p].N,
                                   .M = &M,
                                   .slave = slave.nu(),
                                   .multiplier = slave.nu(),
                                   .master = master.nu()};
          add_closed_tangent<D, false>(B, law, s.lambda, k, none, weight[i], {}, K);
        }
        else
          benchmark::DoNotOptimize(k);
      }
      benchmark::DoNotOptimize(K.data());
    }
  per(state, "particle", problem.size());
}

/// MatSetValues of the summed blocks alone.
template <int D>
void insertion(benchmark::State& state, Problem<D>& problem)
{
  const std::vector<typename Problem<D>::Block> blocks = problem.blocks();
  const PairMatrix<D> K = PairMatrix<D>::Ones(blocks[0].dofs.size(), blocks[0].dofs.size());
  for (auto _ : state)
    for (const auto& block : blocks)
      check(MatSetValues(problem.A, block.dofs.size(), block.dofs.data(), block.dofs.size(),
                         block.dofs.data(), K.data(), ADD_VALUES),
            "MatSetValues");
  per(state, "particle", problem.size());
}

template <int D>
void add_all()
{
  using Function = void (*)(benchmark::State&, Problem<D>&);
  const std::pair<std::string, Function> parts[]
      = {{"  its variations", [](auto& s, auto& p) { arithmetic<D>(s, p, false); }},
         {"  its arithmetic", [](auto& s, auto& p) { arithmetic<D>(s, p, true); }},
         {"  its MatSetValues", insertion<D>}};
  for (const Element& e : elements<D>())
  {
    auto add_each = [&](const std::string& what, const Setup& setup, int facets = 0)
    {
      if (facets == 0)
        facets = e.position == 1 ? 1000 : 300;
      const Once<Problem<D>> problem([=]
                                     { return std::make_unique<Problem<D>>(e, facets, setup); });
      auto add_one = [&](const std::string& name, Function function)
      { add(name, [=](benchmark::State& s) { function(s, problem()); }); };
      const bool plain = what.empty();
      add_one(plain ? "update: move, warm search, status, " + name(e)
                    : "update" + what + ", " + name(e),
              update<D>);
      add_one("residual" + (plain ? " with insertion" : what) + ", " + name(e), residual<D>);
      add_one("tangent" + (plain ? " with insertion" : what) + ", " + name(e), tangent<D>);
      if (plain)
        for (const auto& [part, function] : parts)
          add_one(part + ", " + name(e), function);
    };
    add_each("", {});
    add_each(" with friction", {.friction = true});
    add_each(" smooth", {.smooth = true});
    add_each(" smooth, friction", {.friction = true, .smooth = true});
    if (D == 3 and e.displacement == 1)
      add_each(" segments", {.segments = true}, 300);
  }
}

/// Bilinear quadrilaterals, 10³ to 10⁵ slave facets with Simpson's rule.
void add_sizes()
{
  auto problems = std::make_shared<std::map<int, Once<Problem<3>>>>();
  for (int facets : {1000, 10000, 100000})
    problems->emplace(facets,
                      [=]
                      {
                        return std::make_unique<Problem<3>>(Element{Shape::quadrilateral, 1, 1},
                                                            facets, Setup{.simpson_n = 0});
                      });
  auto add_family = [&](const std::string& name, auto run)
  { add_sizes_of(name, [=](benchmark::State& s) { run(s, problems->at(s.range(0))()); }); };
  add_family("update", update<3>);
  add_family("residual", residual<3>);
  add_family("tangent", tangent<3>);
}

const bool registered = (add_all<3>(), add_all<2>(), add_sizes(), true);

} // namespace
