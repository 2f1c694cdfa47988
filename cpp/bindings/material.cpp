// SPDX-License-Identifier: MIT
//
// Materials: arrays are row-major, one row a point; results are written into the arrays given.
#include "material.h"

#include "../material/j2_plasticity.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

namespace py = pybind11;
using namespace dolfinx_contact;

namespace
{
using Array = py::array_t<double, py::array::c_style>;

std::span<const double> in(const Array& a)
{
  return {a.data(), std::size_t(a.size())};
}

std::span<double> out(Array& a)
{
  return {a.mutable_data(), std::size_t(a.size())};
}

template <typename Law>
py::class_<Law> declare_law(py::module_& m, const char* name)
{
  return py::class_<Law>(m, name).def(
      "__call__",
      [](const Law& law, const Array& ep)
      {
        Array stress(std::vector<py::ssize_t>(ep.shape(), ep.shape() + ep.ndim())),
            slope(std::vector<py::ssize_t>(ep.shape(), ep.shape() + ep.ndim()));
        for (py::ssize_t i = 0; i < ep.size(); ++i)
        {
          const YieldStress y = law(ep.data()[i]);
          stress.mutable_data()[i] = y.stress;
          slope.mutable_data()[i] = y.slope;
        }
        return py::make_tuple(stress, slope);
      },
      py::arg("plastic_strain"));
}

// `step` of ``update`` or ``update_given``, with the arrays of the old state and of the response
template <typename Law, typename Step>
void declare_update(py::module_& m, const char* name, Step step)
{
  m.def(
      name,
      [step](double lambda, double mu, const Law& law, int k, const Array& F, const Array& cp_old,
             const Array& ep_old, Array& cp, Array& ep, Array& tau, Array& P, Array& A)
      {
        return step({lambda, mu}, law, k, in(F), {in(cp_old), in(ep_old)},
                    {{out(cp), out(ep)}, out(tau), out(P), out(A)});
      },
      py::arg("lmbda"), py::arg("mu"), py::arg("law"), py::arg("k"), py::arg("F").noconvert(),
      py::arg("cp_old").noconvert(), py::arg("ep_old").noconvert(), py::arg("cp").noconvert(),
      py::arg("ep").noconvert(), py::arg("tau").noconvert(), py::arg("P").noconvert(),
      py::arg("A").noconvert());
}

} // namespace

void declare_material(py::module_& m)
{
  declare_law<Swift>(m, "Swift")
      .def(py::init(
          [](double K, double eps0, double n) {
            return Swift{K, eps0, n};
          }));
  declare_law<Voce>(m, "Voce").def(py::init(
      [](double yield, double Q, double b, double H) {
        return Voce{yield, Q, b, H};
      }));
  declare_law<Tabulated>(m, "Tabulated")
      .def(py::init(
          [](std::vector<double> strain, std::vector<double> stress) {
            return Tabulated{std::move(strain), std::move(stress)};
          }));

  using Old = const PlasticState<const double>&;
  using Out = const PlasticResponse&;
  declare_update<Hardening>(m, "j2_update",
                            [](const Elasticity& e, const Hardening& law, int k,
                               std::span<const double> F, Old old, Out response)
                            { return update(e, law, k, F, old, response); });
  declare_update<Array>(m, "j2_update_given",
                        [](const Elasticity& e, const Array& flow, int k, std::span<const double> F,
                           Old old, Out response)
                        { return update_given(e, in(flow), k, F, old, response); });
  m.def(
      "j2_trial_stress",
      [](double lambda, double mu, int k, const Array& F, const Array& cp)
      {
        Array q(cp.shape(0));
        trial_stress({lambda, mu}, k, in(F), in(cp), out(q));
        return q;
      },
      py::arg("lmbda"), py::arg("mu"), py::arg("k"), py::arg("F").noconvert(),
      py::arg("cp").noconvert());
}
