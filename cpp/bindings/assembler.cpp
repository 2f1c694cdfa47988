// SPDX-License-Identifier: MIT
//
// The assembler as Python drives it.
#include "assembler.h"

#include "../assembly/assembler.h"
#include "arrays.h"

#include <pybind11/stl.h>

using namespace dolfinx_contact;

namespace
{
// Columns of the particle table, one row a particle; "row": position of its facet among this
// rank's.
template <int D>
py::dict particle_table(const Assembler<D>& a)
{
  using State = typename Assembler<D>::State;
  const Surface& slave = a.slave();
  const std::vector<State>& states = a.states();
  const py::ssize_t n = states.size();
  const std::vector<py::ssize_t> vectors = {n, py::ssize_t(D)};
  py::array_t<double> X(vectors), x(vectors), y(vectors), normal(vectors), traction(vectors),
      slip(vectors), direction(vectors), xi({n, py::ssize_t(D - 1)}),
      target_xi({n, py::ssize_t(D - 1)}), gap(n), lambda(n), weight(n), dissipated(n);
  py::array_t<bool> closed(n), slips(n), rubs(n), clamped(n);
  py::array_t<std::int64_t> facet(n), target(n);
  py::array_t<std::int32_t> row(n), piece(n);
  for (py::ssize_t i = 0; i < n; ++i)
  {
    const State& s = states[i];
    const int f = s.facet;
    BasisValues b;
    slave.ref.position.tabulate(s.xi.data(), b);
    const Vector<D> reference = evaluate<D>(slave.facet_X(f), slave.np(), b, false).x;
    const Vector<D> t = a.traction_at(s);
    Vector<D> target_point = Vector<D>::Constant(NAN);
    if (s.target.facet >= 0)
      target_point = a.target_point(s);
    for (int k = 0; k < D; ++k)
    {
      X.mutable_at(i, k) = reference[k];
      x.mutable_at(i, k) = s.x[k];
      y.mutable_at(i, k) = target_point[k];
      normal.mutable_at(i, k) = s.target.facet >= 0 ? s.n[k] : NAN;
      traction.mutable_at(i, k) = t[k];
      direction.mutable_at(i, k) = s.e[k];
      slip.mutable_at(i, k) = s.slip[k] - s.slip.dot(s.n) * s.n[k];
    }
    std::copy_n(s.xi.data(), D - 1, xi.mutable_data(i, 0));
    std::copy_n(s.target.xi.data(), D - 1, target_xi.mutable_data(i, 0));
    row.mutable_at(i) = f;
    slips.mutable_at(i) = s.friction.slips;
    clamped.mutable_at(i) = s.target.facet >= 0 and s.target.clamp != Clamp::none;
    rubs.mutable_at(i) = s.friction.acts;
    dissipated.mutable_at(i) = s.dissipated;
    gap.mutable_at(i) = -s.gap;
    lambda.mutable_at(i) = s.lambda;
    weight.mutable_at(i) = s.weight;
    closed.mutable_at(i) = s.closed;
    facet.mutable_at(i) = slave.id[f];
    target.mutable_at(i) = s.target.facet < 0 ? -1
                           : a.tool()         ? s.target.facet
                                              : a.master().id[s.target.facet];
    piece.mutable_at(i) = s.piece;
  }
  py::dict out;
  out["row"] = row;
  out["xi"] = xi;
  out["X"] = X;
  out["x"] = x;
  out["target"] = y;
  out["normal"] = normal;
  out["traction"] = traction;
  out["gap"] = gap;
  out["direction"] = direction;
  out["slip"] = slip;
  out["slips"] = slips;
  out["clamped"] = clamped;
  out["rubs"] = rubs;
  out["dissipated"] = dissipated;
  out["lambda"] = lambda;
  out["weight"] = weight;
  out["closed"] = closed;
  out["facet"] = facet;
  out["target_facet"] = target;
  out["target_xi"] = target_xi;
  out["piece"] = piece;
  return out;
}

// Particles of an accepted step of another run: columns of `particle_table`, in the order of the
// facets.
template <int D>
void resume(Assembler<D>& a, const py::dict& table, double dissipated)
{
  auto integers = [&](const char* name) { return table[name].cast<array<std::int64_t>>(); };
  auto reals = [&](const char* name) { return table[name].cast<array<double>>(); };
  const auto row = integers("row"), closed = integers("closed"), rubs = integers("rubs"),
             slips = integers("slips"), target = integers("target_facet"),
             piece = integers("piece");
  const auto xi = reals("xi"), target_xi = reals("target_xi"), weight = reals("weight"),
             dissipation = reals("dissipated");
  std::vector<typename Assembler<D>::State> states(row.size());
  for (py::ssize_t i = 0; i < row.size(); ++i)
  {
    auto& s = states[i];
    s.facet = static_cast<int>(row.at(i));
    std::copy_n(xi.data(i, 0), D - 1, s.xi.data());
    s.weight = weight.at(i);
    s.closed = closed.at(i);
    s.friction.acts = rubs.at(i);
    s.friction.slips = slips.at(i);
    if (a.tool())
      s.target.facet = static_cast<int>(target.at(i));
    else
      s.away = target.at(i);
    std::copy_n(target_xi.data(i, 0), D - 1, s.target.xi.data());
    s.piece = static_cast<int>(piece.at(i));
    s.dissipated = dissipation.at(i);
  }
  a.resume(std::move(states), dissipated);
}

// Unit normals of the slave, inward to it, at points of all its own facets; (facets, points, D).
// interpolated: (F8), else the facets' own
template <int D>
py::array_t<double> slave_normals(const Assembler<D>& a, const array<double>& points,
                                  bool interpolated)
{
  const Surface& s = a.slave();
  const py::ssize_t n = points.shape(0);
  py::array_t<double> out({py::ssize_t(a.own()), n, py::ssize_t(D)});
  for (int f = 0; f < a.own(); ++f)
    for (py::ssize_t i = 0; i < n; ++i)
    {
      const double* xi = points.data() + i * (D - 1);
      BasisValues b;
      s.ref.position.tabulate(xi, b);
      const Vector<D> normal
          = interpolated
                ? a.slave_normals().at(s, f, xi).M.normalized().eval()
                : Vector<D>(
                    s.sigma[f]
                    * evaluate<D>(s.facet_x(f), s.np(), b, false).area_vector().normalized());
      Eigen::Map<Vector<D>>(out.mutable_data(f, i, 0)) = normal;
    }
  return out;
}

template <int D>
void declare_assembler(py::module_& m, const char* name)
{
  using A = Assembler<D>;
  py::class_<A>(m, name)
      .def(py::init(
               [](const Surface& slave, int own, const ParticleRule& rule,
                  const array<double>& weight, const TraceBasis& multiplier,
                  const array<double>& nodes, TargetRule target, NormalRule normals,
                  const array<double>& direction, bool turning, bool slave_facets, double radius,
                  double end_tolerance, double crease, bool augmented, bool convected, bool rubbing,
                  const array<PetscInt>& slave_dofs, const array<std::int32_t>& local,
                  const array<PetscInt>& dofs, bool refined, bool axisymmetric)
               {
                 PairOptions<D> o;
                 o.rules = {target, normals, turning};
                 o.slave_facets = slave_facets;
                 o.search.radius = radius;
                 o.search.end_tolerance = end_tolerance;
                 o.crease = crease;
                 o.convected = convected;
                 o.rubbing = rubbing;
                 o.law.augmented = augmented;
                 return A(slave, own,
                          {rule, vector(weight), multiplier, vector(nodes), vector(direction),
                           refined, axisymmetric},
                          o, vector(slave_dofs), vector(local), vector(dofs));
               }),
           py::arg("slave"), py::arg("own"), py::arg("rule"), py::arg("weight"),
           py::arg("multiplier"), py::arg("nodes"), py::arg("target"), py::arg("normals"),
           py::arg("direction"), py::arg("turning"), py::arg("slave_facets"), py::arg("radius"),
           py::arg("end_tolerance"), py::arg("crease"), py::arg("augmented"), py::arg("convected"),
           py::arg("rubbing"), py::arg("slave_dofs"), py::arg("multiplier_local"),
           py::arg("multiplier_dofs"), py::arg("refined") = false, py::arg("axisymmetric") = false)
      .def("set_master",
           [](A& a, const Surface& master, const array<PetscInt>& dofs, const array<double>& reach)
           { a.set_master(master, vector(dofs), vector(reach)); })
      .def("decided", [](const A& a) { return as_array(a.decided(), {py::ssize_t(a.own())}); })
      .def("set_tool", [](A& a, std::shared_ptr<RigidTool<D>> tool, const array<PetscInt>& dofs)
           { a.set_tool(std::move(tool), vector(dofs)); })
      .def("set_friction",
           [](A& a, const TraceBasis& basis, const array<std::int32_t>& local,
              const array<PetscInt>& dofs, const array<double>& tangents)
           {
             if (tangents.size() != dofs.size() * D)
               throw std::invalid_argument("set_friction: one tangent for each dof is needed");
             FrictionSpace<D> f{basis, vector(local), vector(dofs), {}};
             for (py::ssize_t i = 0; i < dofs.size(); ++i)
               f.tangent.push_back(Eigen::Map<const Vector<D>>(tangents.data() + i * D));
             a.set_friction(std::move(f));
           })
      .def("remember", [](A& a, const array<double>& us, const array<double>& um)
           { a.remember(span(us), span(um)); })
      .def(
          "set_parameters",
          [](A& a, double rho_n, double pressure, double friction, double rho_t, double scale,
             double kappa, double least)
          {
            a.set_law({rho_n, a.options().law.augmented, false, friction, rho_t, kappa, least},
                      {pressure, scale});
          },
          py::arg("rho_n"), py::arg("pressure_scale"), py::arg("friction") = 0.0,
          py::arg("rho_t") = 1.0, py::arg("friction_scale") = 1.0, py::arg("kappa") = 1.0,
          py::arg("least") = 0.0)
      .def("slave_normals", &slave_normals<D>)
      .def("set_multiplier_dofs",
           [](A& a, const array<PetscInt>& dofs) { a.set_multiplier_dofs(vector(dofs)); })
      .def("nodes",
           [](const A& a)
           {
             // has_target, normal, free components of the multipliers' nodes, and `decided`
             const auto nodes = a.nodes();
             const py::ssize_t n = a.own(), m = a.particles().nodes.size() / (D - 1);
             py::array_t<bool> found({n, m}), free({n, m, py::ssize_t(D)});
             py::array_t<double> normal({n, m, py::ssize_t(D)}), decided({n, m});
             for (std::size_t i = 0; i < nodes.size(); ++i)
             {
               found.mutable_data()[i] = nodes[i].has_target;
               decided.mutable_data()[i] = nodes[i].decided;
               std::copy_n(nodes[i].free_to_move.begin(), D, free.mutable_data() + i * D);
               std::copy_n(nodes[i].n.data(), D, normal.mutable_data() + i * D);
             }
             return py::make_tuple(found, normal, free, decided);
           })
      .def(
          "update",
          [](A& a, const array<double>& us, const array<double>& um, const array<double>& lambda,
             double close, const array<double>& Lambda, bool again)
          {
            const Changes c
                = a.update({span(us), span(um), span(lambda), span(Lambda)}, close, again);
            return std::array<int, 5>{c.opened, c.closed, c.slid, c.stuck, c.reversals};
          },
          py::arg("slave"), py::arg("master"), py::arg("multiplier"), py::arg("close") = -1.0,
          py::arg("friction") = array<double>(0), py::arg("again") = false)
      .def(
          "freeze",
          [](A& a, bool geometry, bool threshold, bool status) {
            a.freeze({geometry, threshold, status});
          },
          py::arg("geometry") = false, py::arg("threshold") = false, py::arg("status") = false)
      .def("glue", &A::glue)
      .def("mark", &A::mark)
      .def("recall", &A::recall)
      .def("residual", [](const A& a, std::uintptr_t b) { a.residual(petsc<::Vec>(b)); })
      .def(
          "tangent",
          [](const A& a, std::uintptr_t mat, RemoteRows* remote)
          { a.tangent(petsc<Mat>(mat), remote); },
          py::arg("mat"), py::arg("remote") = py::none())
      .def("add_pattern", &A::add_pattern)
      .def("pattern_holds", &A::pattern_holds)
      .def("touching",
           [](const A& a)
           {
             const std::vector<int> n = a.touching();
             return as_array(n, {static_cast<py::ssize_t>(n.size())});
           })
      .def("dissipated", &A::dissipated)
      .def("particles", [](const A& a) { return particle_table(a); })
      .def("begin_step", &A::begin_step)
      .def("accept", &A::accept)
      .def("restore", &A::restore)
      .def("resume", &resume<D>, py::arg("particles"), py::arg("dissipated"))
      .def_property_readonly("own", &A::own)
      .def_property_readonly("slave", &A::slave, py::return_value_policy::reference_internal);
}

} // namespace

void declare_assemblers(py::module_& m)
{
  declare_assembler<2>(m, "Assembler2");
  declare_assembler<3>(m, "Assembler3");
}
