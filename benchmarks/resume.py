# SPDX-License-Identifier: MIT
"""Runs that are killed at a random moment and resumed on another number of ranks.

Small versions of demos/ironing.py and demos/sheet.py run with `--checkpoint`, on 1, 2 or 3 ranks. At a
random moment after the first checkpoint all their processes get SIGKILL; then the demo runs with
`--resume` on another number of ranks, to its end. The forces of all steps are compared with those of a
run that nobody has stopped. Prints a table, and fails if a force differs by more than 1e-9 of the
largest, or if there are other steps.

    python3 benchmarks/resume.py                          # both demos, ten times each
    python3 benchmarks/resume.py --demo sheet --times 3 --seed 5
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

DEMOS = Path(__file__).resolve().parent.parent / "demos"
# arguments, and the columns of the demo's rows that are forces, by the rows' name
CASES = {
    "ironing": ("--slab 40 --way 1", {"first": (2, 3), "rows": (2, 3)}),
    "sheet": ("--facets 30 --travel 20", {"friction rows": (1, 2), "frictionless rows": (1, 2)}),
}
LARGEST = 1e-9


def start(demo, folder, ranks, *options):
    """The demo as processes of its own; pictures go to its folder."""
    script = folder / f"{demo}.py"
    script.write_text((DEMOS / script.name).read_text())
    command = [sys.executable, str(script), *CASES[demo][0].split()]
    if ranks > 1:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), *command]
    return subprocess.Popen(
        [*command, "--checkpoint", str(folder / "run.h5"), *options],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process):
    output, _ = process.communicate()
    if process.returncode != 0:
        sys.exit(output)


def kill(process):
    """SIGKILL to all of its processes."""
    family = [process.pid]
    for pid in family:  # grows
        try:
            family += map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())
        except OSError:
            pass  # it has ended
    for pid in family:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
    process.communicate()


def results(demo, folder):
    """Rows of all steps, by name."""
    with h5py.File(folder / "run.h5") as file:
        return {name: file[f"arrays/{name}"][()] for name in CASES[demo][1]}


def steps_in(file):
    """Number of steps in a checkpoint."""
    with h5py.File(file) as checkpoint:
        names = [n for n in checkpoint["arrays"] if n in ("rows", "first") or n.endswith(" rows")]
        return sum(len(checkpoint["arrays"][name]) - 1 for name in names)


def difference(demo, rows, others):
    """Largest difference of the forces over the largest force, by name."""
    out = []
    for name, columns in CASES[demo][1].items():
        a, b = rows[name][:, columns], others[name][:, columns]
        if a.shape != b.shape:
            sys.exit(f"{demo}, {name}: {len(a) - 1} steps, uninterrupted {len(b) - 1}")
        out.append(np.abs(a - b).max() / np.abs(b).max())
    return max(out)


def once(demo, moment, first, second, uninterrupted, seconds):
    """Kill and resume.

    Args:
        moment: when to kill, between the first checkpoint (0) and the last (1)
        first, second: numbers of ranks

    Returns:
        steps that were saved, and the difference of the forces
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process, file = start(demo, folder, first), folder / "run.h5"
        while not file.exists() and process.poll() is None:
            time.sleep(0.001)
        try:
            process.wait(moment * seconds[first])
        except subprocess.TimeoutExpired:
            pass
        kill(process)
        saved = steps_in(file)
        finish(start(demo, folder, second, "--resume"))
        return saved, difference(demo, results(demo, folder), uninterrupted)


def whole(demo, ranks):
    """A run that nobody stops: its results, and seconds from the first checkpoint to the last."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = start(demo, folder, ranks)
        while not (folder / "run.h5").exists() and process.poll() is None:
            time.sleep(0.001)
        begin = time.time()
        finish(process)
        return results(demo, folder), (folder / "run.h5").stat().st_mtime - begin


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--demo", choices=CASES, action="append", help="default: both")
    parser.add_argument("--times", type=int, default=10, help="kills of each demo")
    parser.add_argument("--seed", type=int, default=0, help="of the random moments")
    args = parser.parse_args()
    worst = 0.0
    for demo in args.demo or CASES:
        chance = random.Random(f"{demo} {args.seed}")
        runs = {ranks: whole(demo, ranks) for ranks in (1, 2, 3)}
        uninterrupted, seconds = runs[1][0], {ranks: t for ranks, (_, t) in runs.items()}
        total = sum(len(rows) - 1 for rows in uninterrupted.values())
        print(f"demos/{demo}.py {CASES[demo][0]}: {total} steps")
        for ranks in (2, 3):
            apart = difference(demo, runs[ranks][0], uninterrupted)
            print(f"  uninterrupted, {ranks} ranks against 1: forces differ by {apart:.1e}")
        print("  killed at  of ranks  steps saved  resumed on  forces differ by", flush=True)
        for _ in range(args.times):
            moment = chance.random()
            first, second = chance.sample((1, 2, 3), 2)
            saved, apart = once(demo, moment, first, second, uninterrupted, seconds)
            worst = max(worst, apart)
            print(
                f"  {100 * moment:7.1f} %  {first:8d}  {saved:11d}  {second:10d}  {apart:16.1e}",
                flush=True,
            )
    print(f"largest difference {worst:.1e} of the largest force")
    if worst > LARGEST:
        sys.exit(f"more than {LARGEST}")


if __name__ == "__main__":
    main()
