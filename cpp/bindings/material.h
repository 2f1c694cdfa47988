// SPDX-License-Identifier: MIT
#pragma once

#include <pybind11/pybind11.h>

/// Adds the materials to the module.
void declare_material(pybind11::module_& m);
