# SPDX-License-Identifier: MIT
"""Spaces that only tests need, in all versions of DOLFINx; what the package needs is in compat.py."""

from __future__ import annotations

from typing import Any

import ufl
from dolfinx import fem


def space(mesh: Any, *parts: tuple[Any, ...]) -> Any:
    """Space of one element, or a mixed one of several.

    Args:
        parts: family and degree of each; a third number makes a vector of so many components
    """
    if hasattr(fem, "functionspace"):
        import basix.ufl

        cell = mesh.topology.cell_name()
        elements = [basix.ufl.element(f, cell, k, shape=tuple(n) or None) for f, k, *n in parts]
        mixed = basix.ufl.mixed_element
    else:
        cell, mixed = mesh.ufl_cell(), ufl.MixedElement
        elements = [
            ufl.VectorElement(f, cell, k, dim=n[0]) if n else ufl.FiniteElement(f, cell, k)
            for f, k, *n in parts
        ]
    make = getattr(fem, "functionspace", fem.FunctionSpace)
    return make(mesh, elements[0] if len(parts) == 1 else mixed(elements))
