// SPDX-License-Identifier: MIT
#pragma once

#include <pybind11/pybind11.h>

/// One contact pair on one rank: Assembler2, Assembler3.
void declare_assemblers(pybind11::module_& m);
