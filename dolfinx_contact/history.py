# SPDX-License-Identifier: MIT
"""What a problem carries from one accepted step to the next: as tables and figures that do not
depend on how the ranks number things, and back.

Rows: unknowns, multipliers, tangents of friction, particles, states of materials. Figures: places of
tools, and what was measured as the first step began (stiffness, units of unknowns), which would be
measured differently on the deformed bodies. Search trees, matrices and the like are made anew.
"""

from __future__ import annotations

import itertools
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from .checkpoint import Checkpoint, Table, cell_nodes, dof_tables, smallest
from .errors import InputError, together
from .rules import basis_values

Array = npt.NDArray[Any]
# columns of the particles that the problem makes again
_MADE = ("row", "facet", "tool", "slave")


class History:
    """The history of a ContactProblem. The construction is collective.

    Args:
        problem: a ContactProblem

    Raises:
        InputError: on all ranks, for unknowns whose degrees of freedom are no values at points
    """

    def __init__(self, problem: Any):
        self._problem, self._comm = problem, problem.comm
        self._places: dict[str, Table] = {}  # without columns
        self._dofs: dict[str, list[tuple[str, Array]]] = {}  # of each Function: tables and rows
        for i, u in enumerate(problem.u):
            self._add_function(f"u{i}", u, f"u[{i}] ({u.name})")
        for i, pair in enumerate(problem.pairs):
            name, label = f"pair{i}", f"pairs[{i}]"
            self._add_function(f"{name}.pressure", pair._multiplier, f"pressure of {label}")
            if pair.frictional:
                self._add_function(
                    f"{name}.friction", pair._semi_multiplier, f"friction of {label}"
                )
            self._add_facets(f"{name}.particles", pair.slave, f"slave of {label}")
            if not pair.tools:
                self._add_facets(f"{name}.master", pair.master, f"master of {label}")
        for i, material in enumerate(problem.system.bulk.materials):
            nodes = cell_nodes(material.mesh)
            midpoints = nodes.mean(axis=1)[material._cells]
            count = material.size // max(len(midpoints), 1)
            places = np.column_stack([material.positions(), np.repeat(midpoints, count, axis=0)])
            size = smallest(material.comm, nodes)
            self._places[f"material{i}"] = Table(f"materials[{i}]", places, size)

    def _add_function(self, name: str, f: Any, label: str) -> None:
        self._dofs[name] = []
        for i, (rows, table) in enumerate(dof_tables(f.function_space, label)):
            self._dofs[name].append((f"{name}.{i}", rows))
            self._places[f"{name}.{i}"] = table

    def _add_facets(self, name: str, surface: Any, label: str) -> None:
        X = surface.X
        self._places[name] = Table(label, X.mean(axis=1), smallest(surface.comm, X))

    # -- what is compared before anything is loaded ---------------------------------------------

    def kinds(self) -> dict[str, str]:
        """What the problem is made of, in words. Collective."""
        out = {}
        for i, u in enumerate(self._problem.u):
            V = u.function_space
            dofs = V.dofmap.index_map.size_global
            out[f"u[{i}]"] = f"{V.ufl_element()}, {dofs} nodes"
        for i, pair in enumerate(self._problem.pairs):
            facets = self._comm.allreduce(len(pair.slave.id))
            master = ", ".join(type(tool).__name__ for tool in pair.tools)
            if not pair.tools:
                master = f"{self._comm.allreduce(len(pair.master.id))} facets"
            friction = (
                f"with friction ({pair.friction_space})" if pair.frictional else "no friction"
            )
            out[f"pairs[{i}]"] = (
                f"{facets} slave facets on {master}, {pair.integration!r}, pressure"
                f" {pair.pressure_space}, {friction}"
            )
        for i, material in enumerate(self._problem.system.bulk.materials):
            points = self._comm.allreduce(material.size)
            out[f"materials[{i}]"] = f"{type(material).__name__} at {points} points"
        return out

    def compare(self, path: Any, found: dict[str, str]) -> None:
        """Raises InputError, on all ranks, if a file's ``kinds`` are not those of the problem."""
        mine = self.kinds()
        lines = [
            f"{name}: the file has {found.get(name, 'none')}, the problem {mine.get(name, 'none')}"
            for name in {**found, **mine}
            if found.get(name) != mine.get(name)
        ]
        if lines:
            raise InputError(
                f"{path} is the checkpoint of another problem; {'; '.join(lines)}. Make the problem"
                " as it was when it was saved (on any number of ranks)."
            )

    # -- out ------------------------------------------------------------------------------------

    def tables(self, before: Sequence[Array] | None) -> dict[str, Table]:
        """Rows of this rank for the last accepted step.

        Args:
            before: the problem's ``state`` one accepted step earlier

        Raises:
            InputError: on all ranks, if nothing has been solved yet, or a material does not give its
                state away
        """
        problem = self._problem
        if any(pair._accepted is None for pair in problem.pairs) or problem.system.A is None:
            raise InputError("LoadStepping.save: nothing is solved yet; save after a step.")
        columns: dict[str, dict[str, Array]] = {name: {} for name in self._places}
        for i, u in enumerate(problem.u):
            for name, rows in self._dofs[f"u{i}"]:
                columns[name]["now"] = u.x.array[rows]
                if before is not None:
                    columns[name]["before"] = before[i][rows]
        for i, (pair, contact) in enumerate(zip(problem.pairs, problem.system.contacts)):
            for name, rows in self._dofs[f"pair{i}.pressure"]:
                columns[name]["multiplier"] = pair._multiplier.x.array[rows]
            if pair.frictional:
                ((name, rows),) = self._dofs[f"pair{i}.friction"]
                columns[name]["semi_multiplier"] = pair._semi_multiplier.x.array[rows]
                columns[name]["tangents"] = contact.tangents[: len(rows)]
            particles = {k: v for k, v in pair._accepted.items() if k not in _MADE}
            columns[f"pair{i}.particles"] = particles
            if not pair.tools:
                columns[f"pair{i}.master"]["id"] = pair.master.id
        with together(self._comm, "LoadStepping.save"):
            for i, material in enumerate(problem.system.bulk.materials):
                columns[f"material{i}"] = material.state()
        out = {}
        for name, table in self._places.items():
            places = table.places
            if name.endswith("particles"):
                places = places[problem.pairs[int(name[4:-10])]._accepted["row"]]
            out[name] = Table(table.label, places, table.size, columns[name])
        return out

    def figures(self, before: Sequence[Array] | None) -> dict[str, Any]:
        """What is not in rows. Collective."""
        problem, driven = self._problem, self._problem.system.driven
        return {
            "kinds": self.kinds(),
            "tools": [[t.rotation, t.translation] for t in self._tools()],
            "driven": driven.state(),
            "driven_before": None if before is None else before[len(problem.u) :],
            "dissipated": [self._comm.allreduce(pair._dissipated) for pair in problem.pairs],
            "system": problem.system.measured(),
        }

    def _tools(self) -> list[Any]:
        return list({id(t): t for pair in self._problem.pairs for t in pair.tools}.values())

    # -- back -----------------------------------------------------------------------------------

    def read(self, file: Checkpoint) -> dict[str, dict[str, Array]]:
        """All columns in the order of this rank's places; nothing is changed yet. Collective.

        Raises:
            InputError: on all ranks, if meshes, facets or points are not those of the file
        """
        out = {}
        for name, table in self._places.items():
            if not name.endswith("particles"):
                out[name] = file.columns(name, table)
                continue
            at, columns = file.rows(name, table)
            order = np.argsort(at, kind="stable")
            out[name] = {"row": at[order], **{k: v[order] for k, v in columns.items()}}
        with together(self._comm, "LoadStepping.load"):
            self._check_values(out)
        for i, pair in enumerate(self._problem.pairs):
            particles = out[f"pair{i}.particles"]
            particles["facet"] = pair.slave.id[particles["row"]]
            with together(self._comm, "LoadStepping.load"):
                self._check_particles(i, pair, particles)
            if not pair.tools:
                old = out[f"pair{i}.master"]["id"]
                particles["target_facet"] = self._renumbered(
                    particles["target_facet"], old, pair.master.id
                )
        return out

    def _check_values(self, columns: dict[str, dict[str, Array]]) -> None:
        """Values of Functions are finite."""
        for name, _ in itertools.chain(*self._dofs.values()):
            for key, values in columns[name].items():
                if not np.isfinite(values).all():
                    raise InputError(
                        f"LoadStepping.load: {self._places[name].label} has values ({key}) that are not"
                        " finite; give a checkpoint of an accepted step."
                    )

    def _check_particles(self, i: int, pair: Any, particles: dict[str, Array]) -> None:
        """The facets' particles are where the rows say: their nodes are in the same order."""
        table, basis = self._places[f"pair{i}.particles"], pair.slave.reference["position"]
        N = basis_values((basis["powers"], basis["coefficients"], None), particles["xi"])
        X = np.einsum("pa,pai->pi", N, pair.slave.X[particles["row"]])
        if np.abs(X - particles["X"]).max(initial=0.0) > 1e-6 * table.size:
            raise InputError(
                f"LoadStepping.load: {table.label}: the cells' nodes are numbered in another order than"
                " in the mesh of the checkpoint; read the mesh from the same file."
            )

    def _renumbered(self, ids: Array, old: Array, new: Array) -> Array:
        """The present numbers of master facets that had others in the file. Collective."""
        parts = self._comm.allgather(np.column_stack([old, new]))
        known = np.concatenate(parts)
        known = known[np.argsort(known[:, 0])]
        out = ids.copy()
        some = ids >= 0
        out[some] = known[np.searchsorted(known[:, 0], ids[some]), 1]
        return out

    def put(
        self, columns: dict[str, dict[str, Array]], figures: dict[str, Any]
    ) -> list[Array] | None:
        """Go on from what ``read`` has returned. Collective.

        Returns:
            the problem's ``state`` one accepted step earlier, if the file has it
        """
        problem, system = self._problem, self._problem.system
        before = None
        if figures["driven_before"] is not None:
            before = [self._filled(f"u{i}", u, columns, "before") for i, u in enumerate(problem.u)]
            before += [np.array(a) for a in figures["driven_before"]]
        for i, u in enumerate(problem.u):
            u.x.array[:] = self._filled(f"u{i}", u, columns, "now")
        for tool, (R, c) in zip(self._tools(), figures["tools"]):
            tool.rotation, tool.translation = np.array(R), np.array(c)
        system.driven.set_state([np.array(a) for a in figures["driven"]])
        system.set_measured(figures["system"])
        for i, material in enumerate(system.bulk.materials):
            material.set_state(columns[f"material{i}"])
        for i, (pair, contact) in enumerate(zip(problem.pairs, system.contacts)):
            f = pair._multiplier
            f.x.array[:] = self._filled(f"pair{i}.pressure", f, columns, "multiplier")
            tangents = None
            if pair.frictional:
                name, f = f"pair{i}.friction", pair._semi_multiplier
                f.x.array[:] = self._filled(name, f, columns, "semi_multiplier")
                tangents = columns[self._dofs[name][0][0]]["tangents"]
            # the sum is what counts, not which rank has it
            dissipated = figures["dissipated"][i] if self._comm.rank == 0 else 0.0
            contact.resume(columns[f"pair{i}.particles"], tangents, dissipated)
        return before

    def _filled(self, name: str, f: Any, columns: dict[str, dict[str, Array]], key: str) -> Array:
        """Local values of a Function, those of ghosts from their owners. Collective."""
        work = f.copy()
        for part, rows in self._dofs[name]:
            work.x.array[rows] = columns[part][key]
        work.x.scatter_forward()
        return work.x.array.copy()
