# SPDX-License-Identifier: MIT
"""Scales of the bulk's unknowns and rows, so that all unknowns are lengths and all rows are forces.

The rows of a mixed model have units of their own: those of a pressure are volumes, those of a
dilatation energies. Norms of the whole residual would depend on the units of the user. Displacements
keep their scale; from them scales spread along the couplings A_ij: where i has the scales r_i of its
row and c_i of its unknown, and belongs to a displacement of the stiffness ‖A_uu‖,

    c_j = ‖A_uu‖ / (r_i ‖A_ij‖),   r_j = ‖A_uu‖ / (‖A_ji‖ c_i)        (Frobenius norms)

A pressure has the scale E/h then, and a dilatation 1/h. A small or zero pressure–pressure block
(compressibility 1/κ) plays no part, nor does a coupling that is round-off beside both A_ii and A_jj. A form may be multiplied by any factor: r_j takes it out.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Sequence

import numpy as np
from petsc4py import PETSc

from .layout import Layout


def block_scales(
    A: Any, layout: Layout, blocks: Sequence[Sequence[bool]], displacements: Sequence[int]
) -> tuple[list[float], list[float], list[int]]:
    """Scales of the unknowns and rows of the bulk's blocks. Collective.

    Args:
        A: matrix of the system in which the bulk has not been scaled
        layout: its numbering; the bulk's blocks come first
        blocks: which blocks the bulk has, by rows
        displacements: blocks that move surfaces

    Returns:
        scales of the unknowns and of the rows, 1 for displacements, and the blocks that count as
        displacements: those given, and others that no coupling reaches
    """
    count = len(blocks)
    unknowns, rows, stiffness = [1.0] * count, [1.0] * count, [0.0] * count
    roots, queue = list(displacements), deque(displacements)
    known = set(roots)
    if len(known) == count:  # nothing to do, nothing to copy
        return unknowns, rows, roots
    sets = [  # no strides: with those PETSc 3.18 returns wrong submatrices on one rank
        PETSc.IS().createGeneral(
            (layout.start + np.arange(*layout.offsets[i : i + 2])).astype(PETSc.IntType),
            comm=layout.comm,
        )
        for i in range(count)
    ]

    def size(i: int, j: int) -> float:
        if not blocks[i][j]:
            return 0.0
        part = A.createSubMatrix(sets[i], sets[j])
        norm = part.norm(PETSc.NormType.FROBENIUS)
        part.destroy()
        return norm if np.isfinite(norm) else 0.0

    for i in roots:
        stiffness[i] = size(i, i)
    while len(known) < count or queue:
        if not queue:  # coupled to no displacement
            i = min(set(range(count)) - known)
            roots.append(i)
            known.add(i)
            stiffness[i] = size(i, i)
            queue.append(i)
        i = queue.popleft()
        for j in range(count):
            if j in known or stiffness[i] == 0:
                continue
            there, back = size(i, j), size(j, i)
            if there * back < 1e-16 * size(i, i) * size(j, j):  # round-off in place of 0
                there = back = 0.0
            column, row = rows[i] * there, unknowns[i] * back
            if column == row == 0:
                continue
            unknowns[j] = stiffness[i] / (column or row)
            rows[j] = stiffness[i] / (row or column)
            stiffness[j] = stiffness[i]
            known.add(j)
            queue.append(j)
    return unknowns, rows, roots
