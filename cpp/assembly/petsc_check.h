// SPDX-License-Identifier: MIT
#pragma once

#include <petscsys.h>
#include <stdexcept>
#include <string>

namespace dolfinx_contact
{

/// Turn PETSc's error codes into exceptions. DOLFINx's release builds ignore them on insertion, and
/// with too small a pattern entries vanish silently; here they must not.
inline void check(PetscErrorCode code, const char* what)
{
  if (code == 0)
    return;
  const char* text = nullptr;
  PetscErrorMessage(code, &text, nullptr);
  throw std::runtime_error(std::string(what) + " failed with PETSc error " + std::to_string(code)
                           + (text ? std::string(" (") + text + ")" : std::string()));
}

} // namespace dolfinx_contact
