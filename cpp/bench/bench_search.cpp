// SPDX-License-Identifier: MIT
//
// What a search costs: from nothing through the tree, warm from the last iteration's target, and
// the tree itself; and how the cost grows with the number of facets.
#include "surfaces.h"

#include <map>

using namespace dolfinx_contact;
using namespace dolfinx_contact::bench;

namespace
{

/// A pair, its searchable master, and particles with their normals and targets.
template <int D>
struct Scene
{
  Pair<D> pair;
  Search<D> search;
  NodalNormals<D> normals;
  std::vector<Seeker<D>> seekers;
  std::vector<Target<D>> former; ///< targets before a slide by 2 % of a facet

  Scene(const Element& element, TargetRule rule, int facets, int simpson_n)
      : pair(bench::pair<D>(element, facets, simpson_n))
      , normals(pair.master, 1.0)
  {
    SearchOptions<D> options;
    options.rule = rule;
    options.radius = 0.5;
    search = Search<D>(pair.master, options);
    place(0);
    for (const Seeker<D>& seeker : seekers)
      former.push_back(search.find(pair.master, seeker, {}, &normals));
    place(0.02);
  }

  void place(double fraction)
  {
    pair.slave.displace(pair.slide(fraction));
    seekers.clear();
    for (int f = 0; f < pair.slave.size(); ++f)
      for (int p = 0; p < pair.rule.size(); ++p)
      {
        BasisValues b;
        pair.slave.ref.position.tabulate(&pair.rule.points[p * (D - 1)], b);
        const auto point = evaluate<D>(pair.slave.facet_x(f), pair.slave.np(), b, false);
        const double sigma = pair.slave.sigma[f];
        seekers.push_back(
            {point.x, -sigma * point.area_vector().normalized(), -Vector<D>::Unit(D - 1)});
      }
  }
};

/// All particles once, each from its former target or from nothing.
template <int D>
void find_all(benchmark::State& state, const Scene<D>& scene, bool warm)
{
  const int n = scene.pair.particles();
  for (auto _ : state)
    for (int i = 0; i < n; ++i)
      benchmark::DoNotOptimize(scene.search.find(scene.pair.master, scene.seekers[i],
                                                 warm ? scene.former[i] : Target<D>(),
                                                 &scene.normals));
  per(state, "particle", n);
}

void build_tree(benchmark::State& state, const Scene<3>& scene)
{
  const Surface& master = scene.pair.master;
  for (auto _ : state)
    benchmark::DoNotOptimize(Search<3>(master, {}));
  per(state, "facet", master.size());
}

void refit_tree(benchmark::State& state, const Scene<3>& scene)
{
  const Surface& master = scene.pair.master;
  Search<3> search(master, {});
  for (auto _ : state)
    search.refit(master);
  per(state, "facet", master.size());
}

const std::pair<TargetRule, std::string> rules[] = {{TargetRule::proximity, "proximity"},
                                                    {TargetRule::direction, "direction"},
                                                    {TargetRule::smooth, "smooth"}};

/// Cold and warm, all elements and rules, 1,000 slave facets with 1-Simpson.
template <int D>
void add_elements()
{
  for (const Element& e : elements<D>())
    for (const auto& [rule, text] : rules)
    {
      const Once<Scene<D>> scene([=, rule = rule]
                                 { return std::make_unique<Scene<D>>(e, rule, 1000, 1); });
      for (bool warm : {false, true})
        add(std::string("search, ") + (warm ? "warm, " : "cold, ") + text + ", " + name(e),
            [=](benchmark::State& s) { find_all<D>(s, scene(), warm); });
    }
}

/// Bilinear quadrilaterals, 10³ to 10⁵ slave facets with Simpson's rule.
void add_sizes()
{
  for (const auto& [rule, text] : rules)
  {
    std::map<int, Once<Scene<3>>> scenes;
    for (int facets : {1000, 10000, 100000})
      scenes.emplace(
          facets,
          [=, rule = rule] {
            return std::make_unique<Scene<3>>(Element{Shape::quadrilateral, 1, 1}, rule, facets, 0);
          });
    auto add_family = [&](const std::string& name, auto run)
    { add_sizes_of(name, [=](benchmark::State& s) { run(s, scenes.at(s.range(0))()); }); };
    for (bool warm : {false, true})
      add_family(std::string("search, ") + (warm ? "warm, " : "cold, ") + text,
                 [=](benchmark::State& s, const Scene<3>& scene) { find_all<3>(s, scene, warm); });
    if (rule == TargetRule::proximity)
    {
      add_family("tree build", build_tree);
      add_family("tree refit", refit_tree);
    }
  }
}

const bool registered = (add_elements<3>(), add_elements<2>(), add_sizes(), true);

} // namespace
