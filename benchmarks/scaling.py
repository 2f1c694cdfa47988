# SPDX-License-Identifier: MIT
"""What contact costs: per particle, beside the bulk, and how it grows.

The problem is that of plates.py: two plates of hexahedra of degree 1, 1-Simpson with 25 particles a
slave facet, about 8 of which share a target, all of them in contact. On one core. Times are CPU
times of this process, the least of 5 runs, and the spread is by how much the slowest run exceeds it.

A Newton iteration's contact work is one search from the last one's targets, with the slave moved by
2 % of a facet, residual, and tangent with insertion into PETSc's matrix. Four tables:

* cost: microseconds of that a particle, and a pair of facets that share particles;
* finer: the same for masters with facets 1, 2 and 4 times finer;
* beside: 1,024 slave facets on a body of 200,000 dofs; all contact work in percent of the assembly of
  residual and Jacobian of the bulk (neo-Hookean, quadrature degree 2) in the same matrix;
* growth: thin plates with 1e3 to 1e5 slave facets. The exponent q, time ∝ facets^q, is that of the
  least squares. Direct solves are left out above 80,000 dofs.

    python3 benchmarks/scaling.py --output docs/scaling.md    # writes the page and its picture
    python3 benchmarks/scaling.py --only cost finer           # some tables
    python3 benchmarks/scaling.py --check                     # error if a limit is not met
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Sequence

import numpy as np

from plates import VARIANTS, Plates, Times, clock, clock_insertion

PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "scaling.png"
PER_PARTICLE = dict(zip(VARIANTS, (2.0, 4.0, 4.0, 4.0)))  # µs
OF_BULK = {"facet normals": 6.0, "smooth": 12.0, "smooth, friction": 15.0}  # %
COLD, OTHERS = 1.15, 1.05  # exponents
LARGEST_SOLVE = 80_000  # dofs

Row = list[Any]
Check = tuple[str, float, float]  # what, value, limit


def iteration(plates: Plates, runs: int) -> dict[str, Times]:
    """The contact work of a Newton iteration; the insertion is a part of the tangent."""
    return {
        "warm search": clock(plates.search, runs, plates.move),
        "residual": clock(plates.residual, runs),
        "tangent": clock(plates.tangent, runs),
        "insertion": clock_insertion(plates, runs),
    }


def total(parts: dict[str, Times]) -> Times:
    return parts["warm search"] + parts["residual"] + parts["tangent"]


def bulk(plates: Plates, runs: int) -> dict[str, Times]:
    return {
        "bulk residual": clock(plates.bulk_residual, runs),
        "bulk Jacobian": clock(plates.bulk_jacobian, runs),
    }


def pressed(facets: int, layers: int, variant: str, finer: float = 1) -> Plates:
    plates = Plates(facets, layers, VARIANTS[variant], finer=finer)
    plates.press()
    return plates


# -- the tables: rows, and what is checked ------------------------------------------------------


def cost(facets: int, runs: int) -> tuple[list[Row], list[Check]]:
    rows: list[Row] = []
    checks: list[Check] = []
    for variant in VARIANTS:
        plates = pressed(facets, 1, variant)
        parts = {"cold search": clock(plates.cold_search, runs, plates.exchanged)}
        parts |= iteration(plates, runs)
        all_of_it, micro = total(parts), 1e6 / plates.particles
        value = micro * all_of_it.least
        rows.append(
            [variant]
            + [f"{micro * t.least:.2f}" for t in parts.values()]
            + [f"{value:.2f}", f"{1e6 * all_of_it.least / plates.pairs:.1f}"]
            + [f"{100 * all_of_it.spread:.0f} %"]
        )
        checks.append((f"µs a particle, {variant}", value, PER_PARTICLE[variant]))
    return rows, checks


def finer(facets: int, runs: int) -> tuple[list[Row], list[Check]]:
    rows: list[Row] = []
    for variant in VARIANTS:
        for times in (1, 2, 4):
            plates = pressed(facets, 1, variant, times)
            all_of_it = total(iteration(plates, runs))
            rows.append(
                [variant, times, f"{plates.particles / plates.pairs:.1f}"]
                + [f"{1e6 * all_of_it.least / n:.2f}" for n in (plates.particles, plates.pairs)]
                + [f"{100 * all_of_it.spread:.0f} %"]
            )
    return rows, []


def beside(facets: int, layers: int, runs: int) -> tuple[list[Row], list[Check]]:
    rows: list[Row] = []
    checks: list[Check] = []
    for variant, limit in OF_BULK.items():
        plates = pressed(facets, layers, variant)
        of_bulk, parts = bulk(plates, runs), iteration(plates, runs)
        reference = of_bulk["bulk residual"] + of_bulk["bulk Jacobian"]
        percent = {name: 100 * t.least / reference.least for name, t in parts.items()}
        value = 100 * total(parts).least / reference.least
        spread = max(total(parts).spread, reference.spread)
        alone = clock(plates.dolfinx_alone(), runs)
        rows.append(
            [variant, plates.dofs, f"{1e3 * alone.least:.0f}"]
            + [f"{1e3 * t.least:.0f}" for t in of_bulk.values()]
            + [f"{p:.1f}" for p in percent.values()]
            + [f"**{value:.1f}**", f"{100 * spread:.0f} %"]
        )
        checks.append((f"percent of the bulk, {variant}", value, limit))
    return rows, checks


def growth(
    sides: Sequence[int], variant: str, runs: int
) -> tuple[list[Row], list[Check], dict[str, dict[int, float]]]:
    """And the least seconds of each part, by the number of slave facets."""
    seconds: dict[str, dict[int, float]] = {}
    for side in sides:
        plates = pressed(side, 1, variant)
        parts = bulk(plates, runs)
        parts["exchange"] = clock(plates.exchange, min(runs, 3), plates.fresh)
        parts["cold search"] = clock(plates.cold_search, min(runs, 3), plates.exchanged)
        parts |= iteration(plates, runs)
        parts["preallocation"] = clock(plates.preallocation, 1)
        if plates.dofs < LARGEST_SOLVE:
            plates.assemble()
            parts["linear solve"] = clock(plates.linear_solve, 1)
        for name, t in parts.items():
            seconds.setdefault(name, {})[side**2] = t.least
        del plates
    rows: list[Row] = []
    checks: list[Check] = []
    for name, by_size in seconds.items():
        q = exponent(by_size)
        rows.append(
            [name]
            + [f"{1e3 * by_size[s**2]:.1f}" if s**2 in by_size else "" for s in sides]
            + [f"{q:.2f}"]
        )
        if not name.startswith("bulk") and name != "linear solve":
            limit = COLD if name == "cold search" else OTHERS
            checks.append((f"growth exponent, {name}", q, limit))
    return rows, checks, seconds


def exponent(by_size: dict[int, float]) -> float:
    if len(by_size) < 2:
        return float("nan")
    return float(np.polyfit(np.log(list(by_size)), np.log(list(by_size.values())), 1)[0])


# -- the page and the picture -------------------------------------------------------------------


def table(head: Sequence[Any], rows: Sequence[Row]) -> str:
    lines = [list(head), ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)


def draw(seconds: dict[str, dict[int, float]], picture: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.5), constrained_layout=True)
    for name, by_size in seconds.items():
        dashed = name.startswith("bulk") or name in ("linear solve", "preallocation", "exchange")
        label = name if len(by_size) < 2 else f"{name}, exponent {exponent(by_size):.2f}"
        axes.loglog(list(by_size), list(by_size.values()), "o--" if dashed else "o-", label=label)
    axes.set_xlabel("slave facets, 25 particles each")
    axes.set_ylabel("CPU time, s")
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1, 0.5))
    axes.grid(alpha=0.3)
    picture.parent.mkdir(exist_ok=True)
    figure.savefig(picture, dpi=110)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tables = ("cost", "finer", "beside", "growth")
    parser.add_argument("--only", nargs="+", choices=tables, default=tables, help="some tables")
    parser.add_argument("--check", action="store_true", help="error if a limit is not met")
    parser.add_argument("--small", action="store_true", help="small sizes, for the tests")
    parser.add_argument("--runs", type=int, default=5, help="runs of which the least counts (5)")
    parser.add_argument(
        "--variant", choices=VARIANTS, default="smooth, friction", help="of growth"
    )
    parser.add_argument("--sides", type=int, nargs="+", help="facets along a side, for growth")
    parser.add_argument("--output", type=Path, help="page to write; its picture is written too")
    options = parser.parse_args(arguments)
    runs = 1 if options.small else options.runs
    sides = options.sides or ((4, 8) if options.small else (32, 100, 316))
    page: list[str] = []
    checks: list[Check] = []

    def show(title: str, text: str, head: Sequence[Any], result: tuple[Any, ...]) -> None:
        page.extend([f"\n## {title}\n\n{text}\n\n", table(head, result[0])])
        print("".join(page[-2:]), flush=True)
        checks.extend(result[1])

    iteration_head = ["warm search", "residual", "tangent", "of it insertion"]
    if "cost" in options.only:
        n = 6 if options.small else 40
        head = ["", "cold search", *iteration_head, "warm + residual + tangent"]
        show(
            "A particle",
            f"Microseconds a particle, {n}² slave facets; the last but one a pair of facets.",
            [*head, "a pair", "spread"],
            cost(n, runs),
        )
    if "finer" in options.only:
        n = 4 if options.small else 32
        show(
            "Finer masters",
            f"Warm search, residual and tangent, {n}² slave facets; microseconds.",
            ["", "finer", "particles a pair", "a particle", "a pair", "spread"],
            finer(n, runs),
        )
    if "beside" in options.only:
        n, layers = (4, 2) if options.small else (32, 38)
        head = [
            "",
            "dofs",
            "DOLFINx alone, ms",
            "bulk residual, ms",
            "bulk Jacobian, ms",
            *iteration_head,
        ]
        show(
            "Beside the bulk",
            f"{n}² slave facets with 25 particles each; contact in percent of the bulk's residual and"
            " Jacobian in the matrix of both. DOLFINx alone: the same by its own functions.",
            [*head, "contact", "spread"],
            beside(n, layers, runs),
        )
    if "growth" in options.only:
        result = growth(sides, options.variant, runs)
        show(
            "Growth",
            f"Milliseconds, one layer of cells a plate; {options.variant}.",
            ["slave facets", *[s**2 for s in sides], "exponent"],
            result,
        )
        if options.output:
            draw(result[2], PICTURE)
    missed = [check for check in checks if not check[1] <= check[2]]
    for what, value, limit in checks:
        print(f"{what:48} {value:8.2f}  {'≤' if value <= limit else 'ABOVE'} {limit}")
    if options.output:
        head = (
            "# What contact costs\n\nBy `benchmarks/scaling.py`, on one core; see docs/speed.md.\n"
        )
        options.output.write_text(head + "".join(page))
    if options.check and missed:
        raise SystemExit(f"{len(missed)} of {len(checks)} limits are not met")


if __name__ == "__main__":
    main()
