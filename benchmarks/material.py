# SPDX-License-Identifier: MIT
"""What finite-strain plasticity costs: point updates with stress and consistent tangent, all of them
plastic, and beside the assembly of the same body.

The first table is CPU time of the kernel for a million points, in batches of 100,000, least of
several runs. The second is the microseconds a point of a cube of hexahedra: deformation gradients,
kernel and storing (``update``), then DOLFINx's assembly of residual and Jacobian with the results.

    python3 benchmarks/material.py [--small]
"""

from __future__ import annotations

import argparse
import time
from typing import Any, Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import _cpp, meshes
from dolfinx_contact.plasticity import J2, Linear, Swift, Tabulated, Voce

E, NU = 69004.0, 0.3
LAMBDA, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
LAWS = {
    "Swift": Swift(589, 1e-4, 0.216),
    "Voce": Voce(80, 200, 15, 30),
    "Linear": Linear(80, 500),
    "Tabulated": Tabulated(np.linspace(0, 1, 101), 80 + 100 * np.linspace(0, 1, 101)),
}
KINDS = {"3D": 9, "axisymmetric": 5, "plane strain": 4}


def least(run: Callable[[], object], runs: int) -> float:
    """Least CPU time of several runs."""
    times = []
    for _ in range(runs):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def kernel(law: Any, k: int, n: int, runs: int) -> float:
    """Seconds for a million updates of points with k components of F."""
    rng = np.random.default_rng(0)
    identity = {9: np.eye(3).ravel(), 5: [1, 0, 0, 1, 1], 4: [1, 0, 0, 1]}[k]
    F = identity + rng.uniform(-0.1, 0.1, (n, k))
    old = np.tile([1.0, 1, 1, 0, 0, 0], (n, 1)), np.zeros(n)
    new = np.empty((n, 6)), np.empty(n), np.empty((n, 6)), np.empty((n, k)), np.empty((n, k, k))

    def run() -> None:
        assert _cpp.j2_update(LAMBDA, MU, law._kernel, k, F, *old, *new) == 0

    seconds = least(run, runs)
    assert new[1].min() > 0  # all are plastic
    return seconds * 1e6 / n


def body(cells: int, runs: int) -> tuple[int, float, float, float]:
    """Points of a cube; µs a point of ``update`` and of the assembly of Jacobian and residual."""
    mesh, _ = meshes.create(MPI.COMM_SELF, meshes.grid((cells,) * 3, cell="hexahedron"))
    u = fem.Function(dc.vector_space(mesh, 1))
    sheet = J2(u, E, NU)
    u.interpolate(lambda x: np.stack([0.1 * x[0] ** 2, 0.2 * x[0] * x[1], 0.1 * x[2]]))
    sheet.update()
    F = fem.form(sheet.work(ufl.TestFunction(u.function_space)))
    J = fem.form(sheet.J)
    A = fem.petsc.create_matrix(J)
    times = (
        least(lambda: sheet.update(again=True), runs),
        least(lambda: (A.zeroEntries(), fem.petsc.assemble_matrix(A, J)), runs),
        least(lambda: fem.petsc.assemble_vector(F), runs),
    )
    return sheet.size, *(1e6 * t / sheet.size for t in times)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--small", action="store_true", help="few points, for the tests")
    small = parser.parse_args(arguments).small
    n, runs, cells = (2000, 1, 4) if small else (100_000, 5, 24)

    print("seconds for a million plastic points with tangent")
    print(f"{'':12s}" + "".join(f"{kind:>14s}" for kind in KINDS))
    for name, law in LAWS.items():
        times = [kernel(law, k, n, runs) for k in KINDS.values()]
        print(f"{name:12s}" + "".join(f"{t:14.2f}" for t in times))

    points, update, jacobian, residual = body(cells, runs)
    print(f"\ncube of {points} points, µs a point")
    print(
        f"material {update:.2f}, assembly of the Jacobian {jacobian:.2f}, residual {residual:.2f}"
    )


if __name__ == "__main__":
    main()
