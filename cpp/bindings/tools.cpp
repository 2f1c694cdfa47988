// SPDX-License-Identifier: MIT
//
// Rigid tools as Python fills them: piece by piece, each moved by its number.
#include "tools.h"

#include "../targets/rigid_tool.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

namespace py = pybind11;
using namespace dolfinx_contact;

namespace
{
template <int D>
using Numbers = std::array<double, D>;
template <int D>
using Rows = std::array<std::array<double, D + 1>, D>; // R and c

template <int D>
Vector<D> vector(const Numbers<D>& v)
{
  return Eigen::Map<const Vector<D>>(v.data());
}

template <int D>
RigidMotion<D> motion(const Rows<D>& rows)
{
  RigidMotion<D> m;
  for (int i = 0; i < D; ++i)
  {
    m.c[i] = rows[i][D];
    for (int j = 0; j < D; ++j)
      m.R(i, j) = rows[i][j];
  }
  return m;
}

template <int D>
void declare_tool(py::module_& m, const char* name)
{
  using Tool = RigidTool<D>;
  auto add = [](Tool& t, typename RigidPiece<D>::Shape shape)
  { t.pieces.push_back({std::move(shape)}); };
  py::class_<Tool, std::shared_ptr<Tool>> tool(m, name);
  tool.def(py::init<>())
      .def("__len__", [](const Tool& t) { return t.pieces.size(); })
      .def("move",
           [](Tool& t, int piece, const Rows<D>& now, const Rows<D>& old)
           {
             t.pieces.at(piece).now = motion<D>(now);
             t.pieces.at(piece).old = motion<D>(old);
           })
      .def("add_plane",
           [add](Tool& t, const Numbers<D>& point, const Numbers<D>& outward, double inner,
                 double outer) {
             add(t, Plane<D>{vector<D>(point), vector<D>(outward), inner, outer});
           })
      .def("add_sphere",
           [add](Tool& t, const Numbers<D>& center, double radius, bool inside) {
             add(t, Sphere<D>{vector<D>(center), radius, inside});
           })
      .def("add_mesh",
           [add](Tool& t, const Surface& surface, TargetRule target, NormalRule normals,
                 double radius, double end_tolerance, double crease)
           {
             add(t,
                 std::make_shared<RigidMesh<D>>(
                     surface, Rules{target, normals, false},
                     SearchOptions<D>{.radius = radius, .end_tolerance = end_tolerance}, crease));
           });
  if constexpr (D == 3)
    tool.def("add_cylinder",
             [add](Tool& t, const Numbers<3>& point, const Numbers<3>& axis, double radius,
                   bool inside, double length) {
               add(t, Cylinder{vector<3>(point), vector<3>(axis), radius, inside, length});
             })
        .def("add_torus",
             [add](Tool& t, const Numbers<3>& center, const Numbers<3>& axis, double ring,
                   double radius, bool inside) {
               add(t, Torus{vector<3>(center), vector<3>(axis), ring, radius, inside});
             });
}
} // namespace

void declare_tools(py::module_& m)
{
  declare_tool<2>(m, "RigidTool2");
  declare_tool<3>(m, "RigidTool3");
}
