# SPDX-License-Identifier: MIT
"""The same contact problem by GetFEM (Debian's python3-getfem) and by this project, side by side.

Two neo-Hookean plates of hexahedra of degree 1, the lower one larger by two facets all around. The
upper one's top moves by (0.03, 0.02, −0.01): the interface slides by about half of that, by half a
facet and more. No friction. All particles are in contact at the solution.

What is the same: meshes, energy, 8 points of integration a cell, multipliers of degree 1 on the
slave's facets, 25 contact points a facet, augmented Lagrangian and semi-smooth Newton, targets and
forces along the normal of the slave's deformed facet (``SlaveNormal(interpolated=False)`` here), MUMPS
of one version with the system's BLAS on one thread.

What is not: GetFEM's brick (``integral_large_sliding_contact_brick_raytracing``, which its weak-form
language evaluates) has vector-valued multipliers and Gauss points, this project scalar ones and
1-Simpson. This project's default, smooth targets with interpolated normals, is given as well;
GetFEM has nothing like it. GetFEM's MUMPS is the sequential one, PETSc's the parallel one on one
rank. Their libraries would clash in one process: each side runs in its own, one after the other.

Asserted is that both solve it, contact forces agree within 0.5 % and displacements within 1 % of the
largest; and, of the times at the solution,

* residual and tangent of contact, per contact point: 30 times faster here,
* residual and Jacobian of the whole, at 7e4 displacement dofs: 5 times faster.

Times are CPU times, the least of 5 runs. Residual and Jacobian are called one after the other, as the
Newton iterations of both do. GetFEM searches inside of both of them; contact alone is its assembly
with the bulk's brick disabled, and here the search with both assemblies and insertion.

    python3 benchmarks/getfem_comparison.py           # 32² slave facets, 11 layers a plate
    python3 benchmarks/getfem_comparison.py --small   # asserts nothing of the times
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Callable, Sequence

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

OVERHANG = 2  # facets of the master around the slave
MOVE = (0.03, 0.02, -0.01)  # of the top
MU, LAMBDA = 400.0, 600.0  # plates.neo_hookean
FASTER = {"contact": 30.0, "whole": 5.0}
SAME = {"force": 5e-3, "displacement": 1e-2}  # relative
NORMAL = "slave's normal"  # GetFEM's direction
PARTS = {
    "search": "contact: search, µs a point",
    "residual": "contact: residual, µs a point",
    "tangent": "contact: tangent, µs a point",
    "contact": "contact: all of it, µs a point",
    "whole": "whole: residual and Jacobian, s",
    "solve": "direct solve, s",
}


def clock(run: Callable[[], object], runs: int) -> list[float]:
    """CPU seconds of several runs."""
    seconds = []
    for _ in range(runs):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return seconds


def by_getfem(lines: Sequence[np.ndarray], runs: int) -> dict[str, Any]:
    """Times, contact force, displacements of the slave's plate, Newton iterations.

    Args:
        lines: coordinates of the grids' lines, three of the slave's plate and three of the other
    """
    import getfem as gf

    gf.util_trace_level(0)
    mesh, lower = gf.Mesh("cartesian", *lines[:3]), gf.Mesh("cartesian", *lines[3:])
    cells, points, apart = mesh.nbcvs(), mesh.nbpts(), 1.0
    lower.translate([0, 0, -apart])  # `merge` would make one point of two in one place
    mesh.merge(lower)
    x = mesh.pts()
    x[2, points:] += apart
    mesh.set_pts(x)
    outer = mesh.outer_faces()
    up = mesh.normal_of_faces(outer)[2]
    slave, master, top, bottom = range(1, 5)
    for region, in_upper, side in ((slave, 1, -1), (master, 0, 1), (top, 1, 1), (bottom, 0, -1)):
        mesh.set_region(region, outer[:, ((outer[0] < cells) == in_upper) & (side * up > 0.5)])

    fem = gf.MeshFem(mesh, 3)
    fem.set_classical_fem(1)
    multipliers = gf.MeshFem("partial", fem, fem.basic_dof_on_region(slave))
    of_bulk = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3, 2)"))
    of_contact = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3, 8)"))  # 5² on a face
    facets = len(lines[0]) - 1
    model = gf.Model("real")
    model.add_fem_variable("u", fem)
    model.add_fem_variable("l", multipliers)
    model.add_initialized_data("parameters", [LAMBDA, MU])
    model.add_initialized_data("r", [2.5 * MU])
    model.add_initialized_data("move", MOVE)
    bulk = model.add_finite_strain_elasticity_brick(
        of_bulk, "Compressible_Neo_Hookean_Bonet", "u", "parameters"
    )
    contact = model.add_integral_large_sliding_contact_brick_raytracing("r", 1.0 / facets)
    model.add_slave_contact_boundary_to_large_sliding_contact_brick(
        contact, of_contact, slave, "u", "l"
    )
    model.add_master_contact_boundary_to_large_sliding_contact_brick(
        contact, of_contact, master, "u"
    )
    model.add_Dirichlet_condition_with_simplification("u", top, "move")
    model.add_Dirichlet_condition_with_simplification("u", bottom)
    pressed = np.zeros((multipliers.nbdof() // 3, 3))
    pressed[:, 2] = 20.0  # from nothing its Newton iterations do not converge
    model.set_variable("l", pressed.ravel())
    iterations, converged = model.solve("max_res", 1e-9, "max_iter", 50, "lsolver", "mumps")
    assert converged, "GetFEM's Newton iterations have not converged"
    out: dict[str, Any] = {"iterations": int(iterations)}

    residual = lambda: model.assembly("build_rhs")  # noqa: E731
    tangent = lambda: model.assembly("build_matrix")  # noqa: E731
    both = lambda: (residual(), tangent())  # noqa: E731
    out["whole"] = clock(both, runs)
    K, b = model.tangent_matrix(), model.rhs()
    out["solve"] = clock(lambda: gf.linsolve_mumps(K, b), 1)
    model.disable_bricks(bulk)
    out["residual"], out["tangent"] = clock(residual, runs), clock(tangent, runs)
    out["contact"] = clock(both, runs)
    out["force"] = gf.asm_generic(of_contact, 0, "l", slave, model)
    nodes = fem.basic_dof_from_cvid(np.arange(cells))[0]
    nodes = np.unique(nodes // 3)
    out["x"] = fem.basic_dof_nodes()[:, ::3].T[nodes]
    out["u"] = model.variable("u").reshape(-1, 3)[nodes]
    out["dofs"] = fem.nbdof()
    out["unknowns"] = fem.nbdof() + multipliers.nbdof()
    return out


def by_us(plates: Any, runs: int) -> dict[str, Any]:
    """Likewise."""
    from dolfinx_contact import compat

    report = plates.problem.solve()
    plates.assemble()
    plates.count()

    def contact() -> None:
        plates.search()
        plates.residual()
        plates.tangent()

    V = plates.u.function_space
    nodes = np.unique(compat.dof_list(V)[plates.body == 0])
    return {
        "iterations": report.iterations,
        "search": clock(plates.search, runs),
        "residual": clock(plates.residual, runs),
        "tangent": clock(plates.tangent, runs),
        "contact": clock(contact, runs),
        "whole": clock(plates.assemble, runs),
        "solve": clock(plates.linear_solve, 1),
        "force": plates.pair.resultant(),
        "x": V.tabulate_dof_coordinates()[nodes],
        "u": plates.u.x.array.reshape(-1, 3)[nodes],
        "dofs": plates.dofs,
        "unknowns": plates.system.b.getSize(),
    }


def in_a_process_of_its_own(bodies: Sequence[Any], runs: int) -> dict[str, Any]:
    """``by_getfem`` on the grids of plates.grids."""
    with tempfile.TemporaryDirectory() as folder:
        given, result = Path(folder) / "lines.npz", Path(folder) / "result.npz"
        lines = [np.unique(np.round(body.points[:, k], 12)) for body in bodies for k in range(3)]
        np.savez(given, *lines)
        command = [sys.executable, __file__, "--getfem", str(given), str(result)]
        subprocess.run([*command, "--runs", str(runs)], check=True, stdout=subprocess.DEVNULL)
        return dict(np.load(result))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--facets", type=int, default=32, help="slave facets along a side (32)")
    parser.add_argument("--layers", type=int, default=11, help="layers of cells a plate (11)")
    parser.add_argument("--runs", type=int, default=5, help="runs of which the least counts (5)")
    parser.add_argument("--small", action="store_true", help="a small problem, for the tests")
    parser.add_argument("--getfem", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.getfem:
        with np.load(options.getfem[0]) as lines:
            result = by_getfem([lines[name] for name in lines.files], options.runs)
        np.savez(options.getfem[1], **result)
        return

    import dolfinx_contact as dc
    from plates import Plates, grids
    from scipy.spatial import cKDTree

    size = (8, 2) if options.small else (options.facets, options.layers)
    sides = {}
    for name, target in (
        (NORMAL, dc.SlaveNormal(interpolated=False)),
        ("smooth", dc.Smooth()),
    ):
        plates = Plates(*size, {"target": target}, overhang=OVERHANG, move=MOVE)
        sides[name] = by_us(plates, options.runs)
    theirs = in_a_process_of_its_own(grids(*size, overhang=OVERHANG), options.runs)

    points = 25 * size[0] ** 2
    print(
        f"{size[0]}² slave facets, {points} contact points; {theirs['dofs']} displacement dofs;"
        f" least CPU time of {options.runs} runs, and by how much the slowest exceeds it"
    )
    print(f"{'':34}{'GetFEM':>18}" + "".join(f"{name:>18}{'ratio':>8}" for name in sides))
    for part, text in PARTS.items():
        scale = 1e6 / points if text.startswith("contact") else 1.0
        line = f"{text:34}" + column(theirs.get(part), scale)
        for side in sides.values():
            line += column(side[part], scale)
            line += f"{min(theirs[part]) / min(side[part]):8.1f}" if part in theirs else 8 * " "
        print(line)
    print(f"{'unknowns':34}{theirs['unknowns']:18d}" + counts(sides, "unknowns"))
    print(f"{'Newton iterations':34}{theirs['iterations']:18d}" + counts(sides, "iterations"))

    for name, side in sides.items():
        _, at = cKDTree(theirs["x"]).query(side["x"])
        u = theirs["u"][at]
        apart = np.abs(side["u"] - u).max() / np.abs(u).max()
        force = np.linalg.norm(side["force"] - theirs["force"]) / np.linalg.norm(theirs["force"])
        print(
            f"{name}: contact force apart by {100 * force:.3f} %, displacements {100 * apart:.3f} %"
        )
        assert force < SAME["force"] and apart < SAME["displacement"], "not the same problem"
    if not options.small:
        side = sides[NORMAL]
        for part, factor in FASTER.items():
            ratio = min(theirs[part]) / min(side[part])
            assert ratio >= factor, f"{PARTS[part]}: {ratio:.1f} times faster, not {factor}"


def column(seconds: Sequence[float] | None, scale: float) -> str:
    if seconds is None:
        return 18 * " "
    return f"{scale * min(seconds):10.3f} + {100 * (max(seconds) / min(seconds) - 1):3.0f} %"


def counts(sides: dict[str, Any], key: str) -> str:
    return "".join(f"{side[key]:18d}        " for side in sides.values())


if __name__ == "__main__":
    main()
