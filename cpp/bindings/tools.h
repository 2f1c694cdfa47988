// SPDX-License-Identifier: MIT
#pragma once

#include <pybind11/pybind11.h>

/// Rigid tools and their pieces: RigidTool2, RigidTool3.
void declare_tools(pybind11::module_& m);
