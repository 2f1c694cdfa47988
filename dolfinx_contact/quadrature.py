# SPDX-License-Identifier: MIT
"""Materials outside UFL: laws P(F) with a history, evaluated at the quadrature points.

A law sees arrays: F at all points of this rank in, P and dP/dF out. The form has P as a coefficient,
and its derivative is completed with dP/dF : δF, so that Newton converges as with a UFL energy.
"""

from __future__ import annotations

from typing import Any, Protocol, Sequence

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives, extract_coefficients

from . import compat
from .checks import whole
from .errors import InputError, together

Array = npt.NDArray[np.float64]


class Law(Protocol):
    """What a law at points has to have.

    Several updates may follow one another before the step is accepted or given up: each starts from
    the state of the last commit.
    """

    def update(self, F: Array) -> tuple[Array, Array]:
        """P and dP/dF at n points, from the state of the last commit. The arrays are copied.

        P that is not finite says that F is out of reach (an inverted cell, say): Newton then
        shortens its step.

        Args:
            F: (n, *s), with the shape s of the law's F

        Returns:
            P, (n, *s), and dP/dF, (n, *s, *s), in units of stress
        """

    def commit(self) -> None:
        """The state of the last update is that of an accepted step."""

    def restore(self) -> None:
        """Back to the state of the last commit."""

    # Two more for LoadStepping.save and load; other laws have no need of them.

    def state(self) -> Sequence[Array]:
        """The state of the last commit: arrays with one row a point, in axes that do not depend on
        the mesh's numbering; none for a law without history."""

    def set_state(self, state: Sequence[Array]) -> None:
        """Go on from what ``state`` has returned, maybe in another run.

        Args:
            state: these arrays, of this rank's points
        """


class QuadratureLaw:
    """A law P(F) at the quadrature points, as a coefficient of UFL forms.

    With ``P`` in the residual, and the law among ``ContactProblem(..., materials=[law])``, the
    Jacobian needs no J, and states are kept and put back with the steps. The construction is
    collective, and evaluates the law once.

    Args:
        F: UFL scalar, vector or tensor of the unknowns, of any shape s: I + grad u, for instance
        law: an object with ``update``, ``commit`` and ``restore`` (see Law)
        quadrature_degree: of the points (DOLFINx's default scheme)
        dx: measure to integrate with; by default over the whole mesh
        cells: this rank's cells where the law holds, owned ones; by default all. Elsewhere P is 0.

    Raises:
        InputError: on all ranks, if F has no dolfinx Function, the degree is not a natural number,
            cells are not owned, or what the law returns does not fit

    Attributes:
        F: as given
        P: UFL expression of F's shape, for forms; P and the measure belong together
        A: dP/dF as a quadrature Function, F's components in a row; (size, size)
        dx: measure with the law's points
        size: number of this rank's points
    """

    def __init__(
        self,
        F: Any,
        law: Law,
        quadrature_degree: int = 2,
        *,
        dx: Any = None,
        cells: npt.NDArray[np.int32] | None = None,
    ):
        expression = isinstance(F, ufl.core.expr.Expr)
        coefficients = extract_coefficients(F) if expression else []
        functions = [f for f in coefficients if isinstance(f, fem.Function)]
        if not functions:
            raise InputError(
                f"QuadratureLaw: F is {F!s:.80} and depends on no dolfinx Function; give I + grad(u)."
            )
        whole("QuadratureLaw", "quadrature_degree", quadrature_degree, 0)
        missing = [n for n in ("update", "commit", "restore") if not hasattr(law, n)]
        if missing:
            raise InputError(
                f"QuadratureLaw: the law, a {type(law).__name__}, has no {' and no '.join(missing)};"
                " give an object with these methods (see quadrature.Law)."
            )
        self.F, self.law, self.shape = F, law, tuple(F.ufl_shape)
        self.degree, self.mesh = int(quadrature_degree), functions[0].function_space.mesh
        self.comm, self._functions = self.mesh.comm, functions
        self._constants = ufl.algorithms.analysis.extract_constants(F)
        dx = ufl.Measure("dx", domain=self.mesh) if dx is None else dx
        self.dx = dx(metadata={"quadrature_degree": self.degree})

        self._flat = ufl.as_vector([F[i] for i in np.ndindex(self.shape)] if self.shape else [F])
        size = len(self._flat)
        self._expression = self._compile(self._flat)
        owned = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        self._cells = np.arange(owned, dtype=np.int32)
        with together(self.comm, "QuadratureLaw"):
            if cells is not None:
                given = np.asarray(cells)
                integers = given.ndim == 1 and (given.dtype.kind in "iu" or given.size == 0)
                if not integers or np.any((given < 0) | (given >= owned)):
                    raise InputError(
                        f"QuadratureLaw: cells is {cells!r}; this rank owns the cells from 0 and below"
                        f" {owned}, give some of these integers."
                    )
                self._cells = np.unique(given).astype(np.int32)
        self._stress = self.field((size,), "stress")
        self._stress._quadrature_law = self  # see check_materials
        self.A = self.field((size, size), "tangent")
        self.size = len(self._dofs(self.A))
        entries = np.array([self._stress[i] for i in range(size)], dtype=object)
        self.P = ufl.as_tensor(entries.reshape(self.shape).tolist()) if self.shape else entries[0]
        self._accepted = self._stress.x.array.copy()
        self._seen: list[Any] | None = None  # values at the last update
        self.update()

    def _compile(self, expression: Any) -> fem.Expression:
        cell = self.mesh.topology.cell_name()
        return fem.Expression(expression, compat.quadrature(cell, self.degree)[0])

    # -- evaluation -----------------------------------------------------------------------------

    def update(self, again: bool = False) -> None:
        """P and A for the present unknowns, from the last accepted state. Collective.

        Args:
            again: also where F has not changed since the last time
        """
        with together(self.comm, "material law"):
            values = [f.x.array for f in self._functions] + [c.value for c in self._constants]
            if again or self._seen is None or not all(map(np.array_equal, values, self._seen)):
                self._seen = None  # should the law raise
                self._evaluate()
                self._seen = [np.array(v) for v in values]

    def _evaluate(self) -> None:
        F = compat.evaluate(self._expression, self.mesh, self._cells)
        returned, n = self.law.update(F.reshape(self.size, *self.shape)), self.size
        if not isinstance(returned, (tuple, list)) or len(returned) != 2:
            raise InputError(
                f"QuadratureLaw: the law returned a {type(returned).__name__}; return two arrays, P and"
                " dP/dF."
            )
        P, A = (np.asarray(array) for array in returned)
        if P.dtype.kind not in "biuf" or A.dtype.kind not in "biuf":
            raise InputError(
                f"QuadratureLaw: the law returned arrays of {P.dtype} and {A.dtype}; return real numbers."
            )
        if P.shape != (n, *self.shape) or A.shape != (n, *self.shape, *self.shape):
            raise InputError(
                f"QuadratureLaw: at {n} points and for F of shape {self.shape} the law returned P"
                f" of shape {P.shape} and dP/dF of shape {A.shape}; return arrays of shapes"
                f" {(n, *self.shape)} and {(n, *self.shape, *self.shape)}."
            )
        self._put(self._stress, P)
        self._put(self.A, A)

    def commit(self) -> None:
        """The step is accepted with the state of the present unknowns. Collective."""
        self.update()
        with together(self.comm, "material state"):
            self.law.commit()
        self._stress.x.scatter_forward()
        self._accepted[:] = self._stress.x.array
        self._seen = None

    def restore(self) -> None:
        """Back to the last accepted state, and to its P."""
        self.law.restore()
        self._stress.x.array[:] = self._accepted
        self._seen = None

    def state(self) -> dict[str, Array]:
        """Columns with one row for each of this rank's points: the last accepted state.

        Raises:
            InputError: if the law does not give it away
        """
        missing = [n for n in ("state", "set_state") if not hasattr(self.law, n)]
        if missing:
            raise InputError(
                f"QuadratureLaw: a {type(self.law).__name__} cannot be saved, as it has no"
                f" {' and no '.join(missing)}; give it both (see quadrature.Law)."
            )
        columns = {f"state{i}": np.asarray(a) for i, a in enumerate(self.law.state())}
        for name, column in columns.items():
            if len(column) != self.size:
                raise InputError(
                    f"QuadratureLaw: {name} of a {type(self.law).__name__} has {len(column)} rows for"
                    f" {self.size} points; return one row for each point."
                )
        bs = self._stress.function_space.dofmap.index_map_bs
        columns["stress"] = self._accepted.reshape(-1, bs)[self._dofs(self._stress)]
        return columns

    def set_state(self, columns: dict[str, Array]) -> None:
        """Go on from what ``state`` has returned. Collective.

        Args:
            columns: these, one row for each of this rank's points
        """
        count = len(columns) - 1
        self.law.set_state([columns[f"state{i}"] for i in range(count)])
        self.fill(self._stress, columns["stress"])
        self._accepted[:] = self._stress.x.array
        self._seen = None

    # -- derivatives ----------------------------------------------------------------------------

    def variation(self, u: Any, v: Any) -> Any:
        """∂F/∂u v: with a test function v, P : ``variation`` is virtual work.

        Args:
            u: an unknown of F
            v: its direction, a test or trial function or a Function

        Returns:
            UFL of F's shape
        """
        return expand_derivatives(ufl.derivative(self.F, u, v))

    def tangent(self, form: Any, u: Any) -> Any:
        """What ``ufl.derivative(form, u)`` misses: the form's derivative with P, times
        dP/dF : ∂F/∂u δu.

        Args:
            form: a residual
            u: an unknown

        Returns:
            a bilinear form; None if the form has no P, or F no u
        """
        if self._stress not in form.coefficients() or u not in self._functions:
            return None
        du = ufl.TrialFunction(u.function_space)
        dF = expand_derivatives(ufl.derivative(self._flat, u, du))
        return ufl.derivative(form, self._stress, ufl.dot(self.A, dF))

    # -- values at points -----------------------------------------------------------------------

    def evaluate(self, expression: Any) -> Array:
        """A UFL expression at this rank's points, in the order of the law.

        Args:
            expression: of any shape

        Returns:
            values, (size, *shape)
        """
        values = compat.evaluate(self._compile(expression), self.mesh, self._cells)
        return values.reshape(self.size, *expression.ufl_shape)

    def positions(self) -> Array:
        """Reference positions of this rank's points, (size, dim) [length]."""
        return self.evaluate(ufl.SpatialCoordinate(self.mesh))

    def field(self, shape: tuple[int, ...] = (), name: str = "f") -> fem.Function:
        """A quadrature Function at the law's points. Collective.

        Args:
            shape: of its values: (), (n,) or (n, m)
            name: of the Function
        """
        V = compat.quadrature_space(self.mesh, self.degree, shape)
        return fem.Function(V, name=name)

    def fill(self, f: fem.Function, values: Array) -> None:
        """Give a ``field`` its values at this rank's points. Collective.

        Args:
            f: a Function that ``field`` has made
            values: (size, *shape)
        """
        self._put(f, np.asarray(values))
        f.x.scatter_forward()

    def values(self, f: fem.Function) -> Array:
        """Values of a ``field`` at this rank's points, components in a row.

        Args:
            f: a Function that ``field`` has made

        Returns:
            (size, components)
        """
        return f.x.array.reshape(-1, f.function_space.dofmap.index_map_bs)[self._dofs(f)]

    def _put(self, f: fem.Function, values: Array) -> None:
        bs = f.function_space.dofmap.index_map_bs
        f.x.array.reshape(-1, bs)[self._dofs(f)] = values.reshape(-1, bs)

    def _dofs(self, f: fem.Function) -> npt.NDArray[np.int32]:
        """Local blocks of a field at the points."""
        return compat.dof_list(f.function_space)[self._cells].ravel()


def check_materials(
    materials: Sequence[QuadratureLaw], forms: Sequence[Any], unknowns: Sequence[Any]
) -> None:
    """Whether laws, residuals and unknowns belong together.

    Raises:
        InputError: if one of the materials has no unknown or is in no form, or a form has the stress
            of another law
    """
    coefficients = [f for form in forms for f in form.coefficients()]
    for i, m in enumerate(materials):
        if not any(f is v for f in m._functions for v in unknowns):
            raise InputError(
                f"ContactProblem: material {i} depends on none of the unknowns u; make its F from"
                " an unknown."
            )
        if m._stress not in coefficients:
            raise InputError(
                f"ContactProblem: the stress P of material {i} is in no residual; use it in the form, or"
                " leave the material out."
            )
    laws = {id(m) for m in materials}
    for f in coefficients:
        if hasattr(f, "_quadrature_law") and id(f._quadrature_law) not in laws:
            raise InputError(
                "ContactProblem: a residual has the stress of a material that is not given; add it"
                " to materials=[…]."
            )
