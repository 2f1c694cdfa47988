// SPDX-License-Identifier: MIT
//
// NumPy arrays as the C++ library takes and gives them, row-major, and PETSc objects.
#pragma once

#include <cstdint>
#include <pybind11/numpy.h>
#include <span>
#include <vector>

namespace dolfinx_contact
{

namespace py = pybind11;

template <typename T>
using array = py::array_t<T, py::array::c_style | py::array::forcecast>;

template <typename T>
std::span<const T> span(const array<T>& a)
{
  return {a.data(), static_cast<std::size_t>(a.size())};
}

template <typename T>
std::vector<T> vector(const array<T>& a)
{
  return {a.data(), a.data() + a.size()};
}

template <typename T>
py::array_t<T> as_array(const std::vector<T>& v, std::vector<py::ssize_t> shape)
{
  py::array_t<T> out(std::move(shape));
  std::copy(v.begin(), v.end(), out.mutable_data());
  return out;
}

/// A matrix or vector, borrowed for the time of the call.
/// @param handle of petsc4py: its address
template <typename Object>
Object petsc(std::uintptr_t handle)
{
  return reinterpret_cast<Object>(handle); // NOLINT(performance-no-int-to-ptr)
}

} // namespace dolfinx_contact
