# SPDX-License-Identifier: MIT
"""Rigid tools that forces drive: their translations are unknowns of the system.

A tool has two vectors of unknowns on rank 0: its translation c, and the reactions r that hold it in
the directions e_k in which it is not free. With the tractions t on the slave (F1) and the load f,

    ∫ t dΓ − f − Σ_k r_k e_k = 0                    (the tool in equilibrium)
    e_k·(c − c_prescribed) = 0  or, where it is free,  r_k = 0

The assembler adds the integral, and couples c with the slave. Rows of the second kind are multiplied
by a stiffness s [force/length], and r/s is the unknown, so that all rows are forces.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from .checks import agreed
from .errors import InputError, UnheldError
from .layout import Layout
from .tools import RigidTool


def driven_tools(pairs: Sequence[Any]) -> list[RigidTool]:
    """The tools of some pairs that forces drive, each once."""
    tools = {id(tool): tool for pair in pairs for tool in pair.tools if tool.driven}
    return list(tools.values())


class DrivenTools:
    """Unknowns of tools in the numbering of a system; (tools, 2, dim): translations and reactions.

    Args:
        tools: those that forces drive
        layout: numbering of the system; its scalars are these unknowns
        block: of them
    """

    def __init__(self, tools: Sequence[RigidTool], layout: Layout, block: int):
        self.tools, self._layout, self._comm = list(tools), layout, layout.comm
        self.block = block
        dim = tools[0].dim if tools else 0
        count = len(tools) * 2 * dim
        self.dofs = layout.system_dofs(block, np.arange(count)).astype(PETSc.IntType)
        self.dofs = self.dofs.reshape(len(tools), 2, dim)
        self.stiffness = 1.0
        self.approached = False  # in the present step: it says little about the next one
        self._prescribed = [tool.translation.copy() for tool in self.tools]
        self._reactions = np.zeros((len(tools), dim))

    def dofs_of(self, tools: Sequence[RigidTool], dim: int) -> npt.NDArray[Any]:
        """System dofs of the translations of tools, (tools, dim), −1 if prescribed."""
        out = np.full((len(tools), dim), -1, dtype=PETSc.IntType)
        for i, tool in enumerate(tools):
            if tool in self.tools:
                out[i] = self.dofs[self.tools.index(tool), 0]
        return out

    # -- unknowns -------------------------------------------------------------------------------

    def state(self) -> list[Any]:
        """Copies of the translations and reactions."""
        return [tool.translation.copy() for tool in self.tools] + [self._reactions.copy()]

    def set_state(self, state: Sequence[Any]) -> None:
        for tool, c in zip(self.tools, state):
            tool.translation = c.copy()
        self._reactions = state[-1].copy()

    def go_to(self, state: Sequence[Any]) -> None:
        """As ``set_state``, but only in the directions in which the tools move freely."""
        for tool, c in zip(self.tools, state):
            E = tool.directions
            tool.translation = tool.translation + E.T @ (E @ (c - tool.translation))

    def read(self, x: Any) -> None:
        """Fill the system's vector from the tools."""
        if self._comm.rank == 0 and self.tools:
            values = np.stack(
                [[t.translation for t in self.tools], self._reactions / self.stiffness], axis=1
            )
            x.array[self._layout.slice(self.block)] = values.ravel()

    def write(self, x: Any) -> None:
        """Fill the tools from the system's vector. Collective."""
        if not self.tools:
            return
        values = None
        if self._comm.rank == 0:
            values = x.array_r[self._layout.slice(self.block)].copy()
        values = self._comm.bcast(values, root=0).reshape(self.dofs.shape)
        for tool, (c, _) in zip(self.tools, values):
            tool.translation = c.copy()
        self._reactions = self.stiffness * values[:, 1]

    def check(self, pairs: Sequence[Any], comm: Any) -> None:
        """Raises InputError if a tool of the pairs is driven, but has no unknowns, or is not at the same
        place on all ranks, or under the same load. Collective."""
        for tool in {id(t): t for pair in pairs for t in pair.tools}.values():
            place = {name: getattr(tool, name) for name in _PLACE}
            agreed(comm, f"A {type(tool).__name__}", **place)
        for tool in driven_tools(pairs):
            if tool not in self.tools:
                raise InputError(
                    f"A {type(tool).__name__} was pushed for the first time after the"
                    " ContactProblem was made; push it before (a force of zero will do, with"
                    " along=...), or make a new problem."
                )

    # -- a step ---------------------------------------------------------------------------------

    def begin(self, contacts: Sequence[Any]) -> None:
        """Where the tools are prescribed to be as a step begins, and how far they may go at once.
        Collective."""
        sizes = [(c.facet_size(), c.pair.tools) for c in contacts if c.pair.tools]
        self._reach = np.array(
            [min(size for size, tools in sizes if tool in tools) for tool in self.tools]
        )
        self.approached = False
        self._prescribed = [tool.translation.copy() for tool in self.tools]

    def approach(self, contacts: Sequence[Any]) -> None:
        """Bring tools that touch nothing to the slaves, along their loads. Collective.

        The gap to the closest point bounds how far a tool can go without touching: it is taken
        again and again, until particles are within the initial contact.

        Raises:
            UnheldError: a tool with a load meets no slave
        """
        for tool in self.tools:
            size = np.linalg.norm(tool.load)
            near = [c for c in contacts if tool in c.pair.tools]
            if not near or not size > 0:
                continue
            direction, start = tool.load / size, tool.translation.copy()
            for _ in range(200):
                gap, enough, far = np.min([c.clearance(tool) for c in near], axis=0)
                if gap <= enough:
                    break
                tool.translation = tool.translation + min(gap, far) * direction
                self.approached = True
                for c in near:
                    c.update()
            else:
                travel = np.linalg.norm(tool.translation - start)
                tool.translation = start
                raise UnheldError(
                    f"A {type(tool).__name__} that a force drives touches nothing within {travel:.4g}"
                    f" along its load {tool.load.tolist()}. Place it nearer to the slave (move), or"
                    " turn the load towards it."
                )

    def longest(self, step: Any) -> float:
        """Part of a Newton step that moves no tool by more than a facet of a slave. Collective.

        When a tool comes into contact a few particles seem to carry all of its load, and Newton would
        send it far into the slave.
        """
        if not self.tools:
            return 1.0
        far = 0.0
        if self._comm.rank == 0:
            c = step.array_r[self._layout.slice(self.block)].reshape(self.dofs.shape)[:, 0]
            far = float(np.max(np.linalg.norm(c, axis=1) / self._reach))
        return 1.0 / max(1.0, self._comm.bcast(far, root=0))

    def adrift(self, contacts: Sequence[Any]) -> bool:
        """Whether some tool with a load touches nothing. Collective."""
        if not self.tools:
            return False
        loaded = [bool(np.any(tool.load)) for tool in self.tools]
        return bool(np.any((self._touching(contacts) == 0) & loaded))

    def _touching(self, contacts: Sequence[Any]) -> npt.NDArray[np.int64]:
        """Number of closed particles on each tool. Collective."""
        counts = [sum(c.touching(tool) for c in contacts) for tool in self.tools]
        return self._comm.allreduce(np.array(counts, dtype=np.int64))

    # -- residual and matrix --------------------------------------------------------------------

    def residual(self, b: Any) -> None:
        """Add all but the integrals of the tractions."""
        if self._comm.rank != 0:
            return
        s = self.stiffness
        for tool, dofs, r, at in zip(self.tools, self.dofs, self._reactions, self._prescribed):
            E, m = _frame(tool), len(tool.directions)
            rows = np.concatenate([r[:m], s * E[m:] @ (tool.translation - at)])
            b.setValues(dofs.ravel(), np.concatenate([-tool.load - E.T @ r, rows]), addv=_ADD)

    def lack(self, b: Any, round_off: float) -> float:
        """Largest part of its load that a tool's rows of the residual b leave, above round-off.
        Collective."""
        if not self.tools:
            return 0.0
        most = 0.0
        if self._comm.rank == 0:
            rows = b.array_r[self._layout.slice(self.block)].reshape(self.dofs.shape)[:, 0]
            left = np.maximum(np.linalg.norm(rows, axis=1) - round_off, 0.0)
            loads = np.array([np.linalg.norm(tool.load) for tool in self.tools])
            most = float(np.max(left / np.where(loads > 0, loads, np.inf)))
        return self._comm.bcast(most, root=0)

    def tangent(self, A: Any, contacts: Sequence[Any]) -> None:
        """Add its derivative. Collective.

        A tool that has lost all its contacts gets a stiffness: it then comes back in steps.
        """
        if not self.tools:
            return
        touching = self._touching(contacts)
        if self._comm.rank != 0:
            return
        for tool, dofs, closed in zip(self.tools, self.dofs, touching):
            E, m, dim = _frame(tool), len(tool.directions), tool.dim
            block = np.zeros((2 * dim, 2 * dim))
            if closed == 0:
                block[:dim, :dim] = np.eye(dim)
            block[:dim, dim:] = -E.T
            block[dim:, :dim] = np.where(np.arange(dim)[:, None] < m, 0.0, E)
            block[dim : dim + m, dim : dim + m] = np.eye(m)
            A.setValues(dofs.ravel(), dofs.ravel(), self.stiffness * block, addv=_ADD)

    def add_pattern(self, pattern: Any) -> None:
        """Places of the entries of the tangent."""
        if self._comm.rank == 0:
            for dofs in self.dofs:
                pattern.add(dofs.ravel(), dofs.ravel())


_PLACE = (
    "rotation",
    "translation",
    "directions",
    "load",
    "driven",
)  # what ``move`` and ``push`` set
_ADD = PETSc.InsertMode.ADD_VALUES


def _frame(tool: RigidTool) -> npt.NDArray[np.float64]:
    """Orthonormal directions, rows: the free ones first."""
    return np.linalg.qr(np.vstack([tool.directions, np.eye(tool.dim)]).T)[0].T
