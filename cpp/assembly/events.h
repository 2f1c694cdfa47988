// SPDX-License-Identifier: MIT
#pragma once

#include "petsc_check.h"

#include <array>
#include <petsclog.h>

namespace dolfinx_contact
{

/// The parts of contact's work that PETSc's -log_view tells apart.
enum class Event
{
  search,    ///< move the surfaces, find targets, decide statuses
  residual,  ///< (F1)–(F3), with insertion into the vector
  tangent,   ///< (F9) and (F13), with insertion into the matrix
  insertion, ///< of finished blocks into the matrix, a part of `tangent`
  sending,   ///< of entries in rows of other ranks
  pattern,   ///< places in the matrix wherever particles may couple
  count
};

/// PETSc's number of an event. The first call registers all of them, under the class
/// "dolfinx_contact": PETSc must be initialised, and all ranks must come here in the same order
/// among registrations (the Python package does so when it is imported).
inline PetscLogEvent log_event(Event event)
{
  static const std::array<PetscLogEvent, std::size_t(Event::count)> events = []
  {
    const char* names[] = {"ContactSearch", "ContactResidual", "ContactTangent",
                           "ContactInsert", "ContactSend",     "ContactPattern"};
    PetscClassId contact;
    std::array<PetscLogEvent, std::size_t(Event::count)> out;
    check(PetscClassIdRegister("dolfinx_contact", &contact), "PetscClassIdRegister");
    for (std::size_t i = 0; i < out.size(); ++i)
    {
      check(PetscLogEventRegister(names[i], contact, &out[i]), "PetscLogEventRegister");
      check(PetscLogEventSetCollective(out[i], PETSC_FALSE), "PetscLogEventSetCollective");
    }
    return out;
  }();
  return events[std::size_t(event)];
}

/// Logs an event as long as it lives. Without -log_view that costs a comparison.
class Logged
{
public:
  explicit Logged(Event event)
      : _event(log_event(event))
  {
    check(PetscLogEventBegin(_event, nullptr, nullptr, nullptr, nullptr), "PetscLogEventBegin");
  }
  ~Logged() { (void)(PetscLogEventEnd(_event, nullptr, nullptr, nullptr, nullptr)); }
  Logged(const Logged&) = delete;
  Logged& operator=(const Logged&) = delete;

private:
  PetscLogEvent _event;
};

} // namespace dolfinx_contact
