# SPDX-License-Identifier: MIT
"""Contact between deformable bodies in large transformations, beside DOLFINx.

H. Ben Dhia and M. Zarroug, Hybrid frictional contact particles-in elements, Revue européenne des
éléments finis 11 (2002).
"""

from importlib import import_module as _import_module
from typing import Any as _Any

from petsc4py import PETSc as _PETSc

if _PETSc.ScalarType is not float and "complex" in str(_PETSc.ScalarType):
    # before the extension module is loaded: it is linked to one build of PETSc only
    raise ImportError(
        "dolfinx_contact: this Python uses a PETSc with complex scalars; contact needs real ones."
        " Choose the real build (on Debian: export PETSC_DIR=/usr/lib/petscdir/petsc-real, or"
        " unset PETSC_DIR)."
    )

from . import checkpoint, infsup, materials, meshes, plasticity, solvers
from .compat import evaluate, function_space, vector_space
from .errors import ContactError, ConvergenceError, InputError, UnheldError
from .output import Writer
from .pair import ContactPair
from .particles import Particles
from .partition import repartition
from .problem import ContactProblem
from .quadrature import QuadratureLaw
from .report import Report
from .rigid_mesh import RigidMesh
from .rules import (
    Gauss,
    Lobatto,
    Nodes,
    Proximity,
    SeekDirection,
    Segments,
    Simpson,
    SlaveNormal,
    Smooth,
)
from .stepping import LoadStepping, Step
from .strategy import FixedPoint, Newton
from .surface import Surface
from .table import Table
from .tools import (
    RigidComposite,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    RigidTool,
    RigidTorus,
)
from .watch import timeout


def __getattr__(name: str) -> _Any:
    # matplotlib costs more time and memory to import than all the rest
    if name == "plot":
        return _import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__version__ = "0.1.0"
__all__ = [
    "ContactError",
    "ContactPair",
    "ContactProblem",
    "ConvergenceError",
    "FixedPoint",
    "Gauss",
    "InputError",
    "LoadStepping",
    "Lobatto",
    "Newton",
    "Nodes",
    "Particles",
    "Proximity",
    "QuadratureLaw",
    "Report",
    "RigidComposite",
    "RigidCylinder",
    "RigidMesh",
    "RigidPlane",
    "RigidSphere",
    "RigidTool",
    "RigidTorus",
    "SeekDirection",
    "Segments",
    "Simpson",
    "SlaveNormal",
    "Smooth",
    "Step",
    "Surface",
    "Table",
    "UnheldError",
    "Writer",
    "checkpoint",
    "evaluate",
    "function_space",
    "infsup",
    "materials",
    "meshes",
    "plasticity",
    "plot",
    "repartition",
    "solvers",
    "timeout",
    "vector_space",
]
