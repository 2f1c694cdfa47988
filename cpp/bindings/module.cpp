// SPDX-License-Identifier: MIT
//
// The folder bindings/ is the only place that knows pybind11. Arrays are row-major; PETSc objects
// arrive as petsc4py's handles.
#include "../assembly/events.h"
#include "../assembly/pattern.h"
#include "../integration/particle_rule.h"
#include "../parallel/exchange.h"
#include "../parallel/watchdog.h"
#include "../targets/kinematics.h"
#include "arrays.h"
#include "assembler.h"
#include "material.h"
#include "tools.h"

#include <pybind11/stl.h>

using namespace dolfinx_contact;

namespace
{
MPI_Comm communicator(std::int64_t fortran)
{
  return MPI_Comm_f2c(static_cast<MPI_Fint>(fortran));
}

void declare_geometry(py::module_& m)
{
  py::enum_<Shape>(m, "Shape")
      .value("interval", Shape::interval)
      .value("triangle", Shape::triangle)
      .value("quadrilateral", Shape::quadrilateral);

  py::class_<TraceBasis>(m, "TraceBasis")
      .def(py::init([](int dim, const array<std::int32_t>& powers, const array<double>& c)
                    { return TraceBasis(dim, span(powers), span(c)); }),
           py::arg("facet_dim"), py::arg("powers"), py::arg("coefficients"))
      .def_property_readonly("nodes", &TraceBasis::nodes)
      .def_property_readonly("degree", &TraceBasis::degree)
      .def("values",
           [](const TraceBasis& b, const array<double>& xi)
           {
             std::vector<double> N(b.nodes());
             b.values(xi.data(), N.data());
             return N;
           });

  py::class_<Surface>(m, "Surface")
      .def(py::init(
               [](int dim, Shape shape, const TraceBasis& position, const TraceBasis& displacement,
                  const array<double>& interpolation, const array<double>& hull,
                  const array<double>& area, const array<std::int64_t>& id,
                  const array<std::int64_t>& vertices, const array<std::int64_t>& nodes,
                  const array<double>& X, const array<std::int8_t>& sigma)
               {
                 Surface s;
                 s.dim = dim;
                 s.ref = {shape,        position,    displacement, vector(interpolation),
                          vector(hull), vector(area)};
                 s.id = vector(id);
                 s.vertices = vector(vertices);
                 s.nodes = vector(nodes);
                 s.X = vector(X);
                 s.sigma = vector(sigma);
                 s.ends.assign(s.id.size(), 0);
                 s.candidate.assign(s.id.size(), 1);
                 s.number_nodes();
                 return s;
               }),
           py::arg("dim"), py::arg("shape"), py::arg("position"), py::arg("displacement"),
           py::arg("interpolation"), py::arg("hull"), py::arg("area"), py::arg("id"),
           py::arg("vertices"), py::arg("nodes"), py::arg("X"), py::arg("sigma"))
      .def("__len__", &Surface::size)
      .def_property_readonly("id", [](const Surface& s) { return as_array(s.id, {s.size()}); })
      .def_property_readonly("ends", [](const Surface& s) { return as_array(s.ends, {s.size()}); })
      .def_property_readonly("sigma",
                             [](const Surface& s) { return as_array(s.sigma, {s.size()}); })
      .def_property_readonly("candidate",
                             [](const Surface& s) { return as_array(s.candidate, {s.size()}); })
      .def_property_readonly("nodes",
                             [](const Surface& s) {
                               return as_array(s.nodes, {s.size(), s.nu()});
                             })
      .def_property_readonly("X",
                             [](const Surface& s) {
                               return as_array(s.X, {s.size(), s.np(), s.dim});
                             })
      .def_property_readonly("x",
                             [](const Surface& s) {
                               return as_array(s.x, {s.size(), s.np(), s.dim});
                             })
      .def_property_readonly(
          "node_table", [](const Surface& s)
          { return as_array(s.node_table, {static_cast<py::ssize_t>(s.node_table.size())}); })
      .def("displace", [](Surface& s, const array<double>& u) { s.displace(span(u)); })
      .def("boxes",
           [](const Surface& s) {
             return as_array(s.boxes(), {s.size(), 2, s.dim});
           })
      .def("diameters",
           [](const Surface& s)
           {
             std::vector<double> d(s.size());
             for (int f = 0; f < s.size(); ++f)
               d[f] = s.diameter(f);
             return as_array(d, {s.size()});
           });

  m.def("with_ring",
        [](std::int64_t comm, const Surface& own) { return with_ring(communicator(comm), own); });
  m.def("with_targets", [](std::int64_t comm, const Surface& ringed, int num_own,
                           const array<double>& boxes, const array<double>& reach)
        { return with_targets(communicator(comm), ringed, num_own, span(boxes), span(reach)); });
  m.def("distances",
        [](std::int64_t comm, const Surface& ringed, int num_own, const array<double>& boxes,
           const array<double>& reach)
        {
          const std::vector<double> d
              = distances(communicator(comm), ringed, num_own, span(boxes), span(reach));
          return as_array(d, {static_cast<py::ssize_t>(d.size())});
        });
  m.def("bytes_received", &bytes_received);
}

void declare_particles(py::module_& m)
{
  py::class_<ParticleRule>(m, "ParticleRule")
      .def(py::init(
               [](const array<double>& points, const array<double>& weights) {
                 return ParticleRule{vector(points), vector(weights)};
               }),
           py::arg("points"), py::arg("weights"))
      .def_property_readonly("points",
                             [](const ParticleRule& r)
                             {
                               const py::ssize_t n = r.size(), q = n ? r.points.size() / n : 0;
                               return as_array(r.points, {n, q});
                             })
      .def_property_readonly("weights",
                             [](const ParticleRule& r) { return as_array(r.weights, {r.size()}); });
  m.def("simpson", &simpson);
  m.def("particle_weights",
        [](const Surface& s, const ParticleRule& r, bool axisymmetric) {
          return as_array(particle_weights(s, r, axisymmetric), {s.size(), r.size()});
        });
  m.def("lumped_weights",
        [](const Surface& s, const TraceBasis& psi, const ParticleRule& r, bool axisymmetric) {
          return as_array(lumped_weights(s, psi, r, axisymmetric), {s.size(), psi.nodes()});
        });

  m.def("reference_positions",
        [](const Surface& s, const array<double>& points)
        {
          // X at points of all facets, (facets, points, dim)
          const py::ssize_t n = points.shape(0), np = s.np();
          py::array_t<double> out({py::ssize_t(s.size()), n, py::ssize_t(s.dim)});
          for (int f = 0; f < s.size(); ++f)
            for (py::ssize_t i = 0; i < n; ++i)
            {
              double N[BasisValues::max_nodes];
              s.ref.position.values(points.data() + i * points.shape(1), N);
              for (int k = 0; k < s.dim; ++k)
              {
                double X = 0;
                for (py::ssize_t a = 0; a < np; ++a)
                  X += N[a] * s.facet_X(f)[a * s.dim + k];
                out.mutable_at(f, i, k) = X;
              }
            }
          return out;
        });

  py::enum_<TargetRule>(m, "TargetRule")
      .value("proximity", TargetRule::proximity)
      .value("direction", TargetRule::direction)
      .value("smooth", TargetRule::smooth);
  py::enum_<NormalRule>(m, "NormalRule")
      .value("facet", NormalRule::facet)
      .value("interpolated", NormalRule::interpolated)
      .value("direction", NormalRule::direction);
}

} // namespace

namespace
{
void declare_matrices(py::module_& m)
{
  using Dofs = array<PetscInt>;
  py::class_<Pattern>(m, "Pattern")
      .def(py::init([](std::int64_t comm, PetscInt owned)
                    { return Pattern(communicator(comm), owned); }),
           py::arg("comm"), py::arg("owned"))
      .def("add", [](Pattern& p, const Dofs& rows, const Dofs& columns)
           { p.add(span(rows), span(columns)); })
      .def("add_sparse",
           [](Pattern& p, PetscInt first, PetscInt block_rows, const array<std::int64_t>& offset,
              const Dofs& columns, PetscInt block_columns)
           { p.add_sparse(first, block_rows, span(offset), span(columns), block_columns); })
      .def("finish", &Pattern::finish)
      .def("allocate", [](const Pattern& p, std::uintptr_t mat) { p.allocate(petsc<Mat>(mat)); })
      .def("fill", [](const Pattern& p, std::uintptr_t mat) { p.fill(petsc<Mat>(mat)); })
      .def("remote_rows", &Pattern::remote_rows);
  py::class_<RemoteRows>(m, "RemoteRows")
      .def("zero", &RemoteRows::zero)
      .def("send", [](RemoteRows& r, std::uintptr_t mat) { r.send(petsc<Mat>(mat)); });
  m.def("largest_in_rows",
        [](std::uintptr_t mat)
        {
          const std::vector<double> v = largest_in_rows(petsc<Mat>(mat));
          return as_array(v, {static_cast<py::ssize_t>(v.size())});
        });
}
} // namespace

PYBIND11_MODULE(_cpp, m)
{
  m.doc() = "C++ kernels of dolfinx_contact";
  declare_geometry(m);
  declare_particles(m);
  declare_matrices(m);
  // The first one registers all, under PETSc's class "dolfinx_contact".
  m.def("register_log_events", [] { log_event(Event::search); });
  m.def("watch", &watch, py::arg("seconds"), py::arg("text"), py::arg("signal"), py::arg("file"),
        py::arg("grace"));
  declare_tools(m);
  declare_assemblers(m);
  declare_material(m);
}
