# SPDX-License-Identifier: MIT
"""What contact costs through the Python face, beside the bulk it belongs to.

Two neo-Hookean plates of hexahedra, pressed together over a whole side: N × N slave facets meet
0.77 N × 0.77 N master facets, so that with 1-Simpson about 8 of the 25 particles of a slave facet
share a target. Normals are those of the facets, targets are closest points, all particles are in
contact.

Times are CPU time of this process, the least of several runs (the machine may be shared); the spread
is how far the slowest run is above it. Contact is also given per particle, the bulk per dof, and
all of it as a part of assembling the bulk's Jacobian and residual once.

    python3 benchmarks/contact_cost.py --facets 40 --layers 10 --runs 5
"""

import argparse
import time
from typing import Callable

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

import dolfinx_contact as dc
from dolfinx_contact import compat, meshes


def plates(facets: int, layers: int) -> tuple[dc.ContactProblem, dc.ContactPair]:
    """The problem, slave on top; `facets` along a side of it, `layers` of cells in each plate."""
    on_master = max(1, int(0.77 * facets))
    upper = meshes.grid((facets, facets, layers), (0, 0, 0), (1, 1, 0.2), cell="hexahedron")
    lower = meshes.grid((on_master, on_master, layers), (0, 0, -0.2), (1, 1, 0), cell="hexahedron")
    mesh, body = meshes.create(MPI.COMM_SELF, [upper, lower])
    touching = lambda x: np.isclose(x[2], 0)  # noqa: E731
    tags = meshes.tag_facets(mesh, {1: (touching, 0), 2: (touching, 1)}, body)

    V = compat.vector_space(mesh, 1)
    u, w = fem.Function(V), ufl.TestFunction(V)
    mu, lmbda = 400.0, 600.0
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    J = ufl.det(F)
    psi = mu / 2 * (ufl.tr(F.T * F) - 3 - 2 * ufl.ln(J)) + lmbda / 2 * ufl.ln(J) ** 2
    dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 2})
    pair = dc.ContactPair(
        dc.Surface(u, tags, 1),
        dc.Surface(u, tags, 2),
        target=dc.Proximity(),
        integration=dc.Simpson(1),
    )
    problem = dc.ContactProblem(ufl.derivative(psi * dx, u, w), u, [pair])
    # warped, so that facets are bilinear; below the interface as above it
    wave = lambda x: np.sin(2 * x[0]) * np.cos(x[1])  # noqa: E731
    u.interpolate(lambda x: np.stack([1e-3 * np.sin(3 * x[0]), 1e-3 * x[1], 2e-3 * wave(x)]))
    return problem, pair


def clock(run: Callable[[], object], runs: int) -> tuple[float, float]:
    """Least CPU time of several runs, and the excess of the slowest over it, relative."""
    times = []
    for _ in range(runs):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times), max(times) / min(times) - 1


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=40, help="slave facets along a side (40)")
    parser.add_argument("--layers", type=int, default=10, help="layers of cells a plate (10)")
    parser.add_argument("--runs", type=int, default=5, help="runs of which the least counts (5)")
    options = parser.parse_args()

    problem, pair = plates(options.facets, options.layers)
    system = problem.system
    system.start()
    pair._multiplier.x.array[:] = -1.0  # pressure everywhere: all particles are in contact
    system.read()
    system.residual(system.x, system.b)
    A, assembler = system.A, system.contacts[0].assembler
    system.jacobian(system.x, A)

    particles = assembler.particles()
    number, dofs = len(particles["gap"]), system.layout.owned
    pairs = len(set(zip(particles["facet"], particles["target_facet"])))
    if not particles["closed"].all():
        raise RuntimeError(f"{(~particles['closed']).sum()} of {number} particles are open")

    def add_bulk() -> None:
        A.zeroEntries()
        system._add_bulk(A, [])
        A.assemble()

    def add_contact() -> None:
        assembler.tangent(A.handle)
        A.assemble()

    slave, master = system.contacts[0]._slave_values(), system.contacts[0]._master_values()
    multiplier = pair._multiplier.x.array
    steps = {
        "bulk: residual": (lambda: compat.assemble_vector_local(system._F[0]), dofs, "dof"),
        "bulk: Jacobian": (add_bulk, dofs, "dof"),
        "contact: search": (
            lambda: assembler.update(slave, master, multiplier, -1.0),
            number,
            "particle",
        ),
        "contact: residual": (lambda: assembler.residual(system.b.handle), number, "particle"),
        "contact: tangent with insertion": (add_contact, number, "particle"),
    }
    print(
        f"{options.facets}² slave facets, {number} particles, {number / pairs:.1f} a pair of facets; "
        f"{dofs} dofs; least of {options.runs} runs"
    )
    print(f"{'':32} {'CPU, ms':>9} {'µs':>9} {'':13} {'of the bulk':>12} {'spread':>8}")
    rows = [(name, *clock(run, options.runs), n, of) for name, (run, n, of) in steps.items()]
    bulk = sum(least for name, least, *_ in rows if name.startswith("bulk"))
    for name, least, spread, n, of in rows:
        print(
            f"{name:32} {1e3 * least:9.2f} {1e6 * least / n:9.3f} per {of:9}"
            f" {100 * least / bulk:10.1f} % {100 * spread:6.0f} %"
        )


if __name__ == "__main__":
    main()
