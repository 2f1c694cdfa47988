# SPDX-License-Identifier: MIT
"""Events that PETSc's -log_view shows, under the class "dolfinx_contact" (docs/speed.md).

Those of contact itself are in cpp/assembly/events.h. Here are the others; each is a context manager.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

from . import _cpp

# all ranks register in one order: PETSc compares events by their numbers
_cpp.register_log_events()


def _event(name: str) -> Any:
    return PETSc.Log.Event(name, PETSc.Log.Class("dolfinx_contact"))


BULK_RESIDUAL = _event("BulkResidual")
BULK_JACOBIAN = _event("BulkJacobian")
MATERIAL = _event("MaterialUpdate")
ALLOCATE = _event("ContactAllocate")
EXCHANGE = _event("ContactExchange")
