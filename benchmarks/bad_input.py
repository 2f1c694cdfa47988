# SPDX-License-Identifier: MIT
"""A thousand bad inputs through the public API: each must end in our own error, on all ranks.

An input is *survived* if every rank gets the same class of dolfinx_contact's errors, whose message says
what to do and names its page. It is *lost* if it ends in another error, in no error at all, in a crash
or in a hang. Inputs are in bad_inputs/; those that work do not belong there.

Each kind of input runs in processes of its own, which go on with the next case where they end.

    python3 benchmarks/bad_input.py                       # on 1 and 2 ranks
    python3 benchmarks/bad_input.py --output docs/faults.md
    mpirun -n 2 python3 benchmarks/bad_input.py --kind ranks --verbose
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import re
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

from mpi4py import MPI

COMM = MPI.COMM_WORLD
SECONDS = 60  # for one case
MENDING = re.compile(  # a message says what to do
    r"\b(add|choose|drive|give|hold|leave|let|make|move|please report|put|read|remove|resume|return|"
    r"save|solve|tag|take|turn|use|write)\b",
    re.IGNORECASE,
)
FOREIGN = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI")  # children are jobs of their own
KEPT = ("OMPI_ALLOW", "OMPI_MCA_rmaps", "OMPI_MCA_btl", "PRTE_MCA_")


def outcome(call):
    """(class, message) of the error of a call on this rank; None without one."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call()
    except Exception as error:
        return type(error), str(error)
    return None


def judged(result, comm=COMM):
    """What is wrong with an outcome, in words; empty if it is survived. Collective."""
    import dolfinx_contact as dc

    results = comm.allgather(result and (result[0].__name__, result[1]))
    if None in results:
        missing = [rank for rank, one in enumerate(results) if one is None]
        return f"no error on ranks {missing} of {comm.size}"
    names = {name for name, _ in results}
    if len(names) > 1:
        return f"different errors: {results}"
    if not issubclass(result[0], dc.ContactError):
        return comm.bcast(f"{result[0].__name__}: {result[1][:200]}")
    for _, message in results:
        said, _, page = message.rpartition("\nSee docs/failures.md#")
        if not said or page != result[0].__name__.lower():
            return f"no page: {message}"
        if len(said) < 40 or not MENDING.search(said):
            return f"no help: {message}"
        if "Error: " in said.splitlines()[0]:
            return f"another error within: {message}"
    return ""


def run(kinds, progress=None, first=0, every=1, verbose=False):
    """Try cases of some kinds. Collective.

    Args:
        kinds: their names
        progress: file in which rank 0 notes each case before and after it
        first, every: cases first, first + every, … of them all

    Returns:
        for each case its kind, its name and what is wrong
    """
    import bad_inputs

    tried = []
    all_cases = [(kind, *case) for kind in kinds for case in bad_inputs.cases(kind)]
    for number, (kind, name, call) in enumerate(all_cases):
        if number < first or (number - first) % every:
            continue
        note(progress, [number, name, None, ""])
        result = outcome(call)
        wrong = judged(result)
        note(progress, [number, name, wrong, result[0].__name__ if result else ""])
        tried.append((kind, name, wrong))
        if COMM.rank == 0 and (verbose or wrong):
            print(f"{kind}: {name}: {wrong or 'survived'}", flush=True)
    return tried


def note(progress, line):
    if progress is not None:
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        if COMM.rank == 0:
            with open(progress, "a") as file:
                file.write(json.dumps(line) + "\n")


# -- the whole campaign, in children ------------------------------------------------------------------


def job(arguments, ranks, **variables):
    """Exit status and output of a Python job of its own, also from inside one of MPI.

    Args:
        arguments: of Python
        ranks: number of them
        variables: of the environment, beside this process's
    """
    env = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(FOREIGN) or key.startswith(KEPT)
    }
    command = [sys.executable, *map(str, arguments)]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    done = subprocess.run(
        command,
        env={**env, **variables},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    return done.returncode, done.stdout


def child(kind, ranks, first, progress):
    """Run cases in another process, or in several."""
    return job([__file__, "--kind", kind, "--first", first, "--progress", progress], ranks)


def batch(kind, ranks):
    """Outcomes of all cases of a kind: name → what is wrong, and the class of the error."""
    found, first = {}, 0
    with tempfile.TemporaryDirectory() as folder:
        progress = Path(folder) / "progress"
        while True:
            progress.write_text("")
            status, text = child(kind, ranks, first, progress)
            lines = [json.loads(line) for line in progress.read_text().splitlines()]
            done = [line[1:] for line in lines if line[2] is not None]
            found.update({name: (wrong, error) for name, wrong, error in done})
            if status == 0:
                return found
            open_ = [line for line in lines if line[1] not in found]
            if not open_:
                raise RuntimeError(f"{kind} on {ranks} ranks ends with {status}:\n{text}")
            number, name, *_ = open_[-1]
            hang = "Timeout" in text
            wrong = "a hang" if hang else f"a crash, with status {status}: {text[-300:]}"
            found[name] = wrong, ""
            print(f"{kind}: {name}: {wrong}", flush=True)
            first = number + 1


PAGE = """# Bad inputs

`benchmarks/bad_input.py` gives the public API {total} wrong inputs, on one rank and on two: unknown tags,
tags of cells, meshes with nan, flat, folded or inverted cells, spaces of other families and degrees,
numbers that are none, negative, complex or infinite, tools without axis or radius, broken `.msh` files,
options that PETSc does not know, functions that return rubbish, checkpoints that are cut or changed,
folders that are files, and ranks that give different values.

An input is survived if it ends on all ranks together in one of dolfinx_contact's own errors, with a
message that says what to do and ends with the place on [the page of failures](failures.md) that helps.
Any other error, none, a crash, or no end within {seconds} s is a loss. Inputs that turned out to work are not
counted.

| kind | inputs | ranks | tried | survived, with the error and its page | lost |
|---|---|---|---|---|---|
{rows}

`make faults` runs them all, in about five minutes, and writes this page; every tenth is a test.
"""

TITLES = {
    "surfaces": "displacements, tags, spaces",
    "geometry": "meshes with wrong nodes or cells",
    "pairs": "arguments of `ContactPair`",
    "rules": "targets and rules",
    "tools": "rigid tools",
    "rigid_meshes": "rigid meshes and their files",
    "grids": "grids, `.msh` files, tags, partitions",
    "problems": "forms, conditions, solver options",
    "solves": "solves, and results before them",
    "steps": "load steps and checkpoints",
    "output": "output, tables, pictures",
    "laws": "material laws",
    "ranks": "ranks that do not agree",
}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", help="run the cases of a kind in this process")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--every", type=int, default=1, help="only every n-th case")
    parser.add_argument("--progress", help=argparse.SUPPRESS)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--small", action="store_true", help="every tenth case, in this process")
    parser.add_argument("--output", help="page to write")
    given = parser.parse_args(arguments)
    if given.kind or given.small:
        kinds, every = (list(TITLES), 10) if given.small else ([given.kind], given.every)
        tried = run(kinds, given.progress, given.first, every, given.verbose)
        assert len(tried) > 0
        lost = [case for case in tried if case[2]]
        if given.progress is None:
            if COMM.rank == 0:
                print(f"{len(tried)} tried, {len(lost)} lost")
            assert not lost, lost
        return

    rows, sums, inputs = [], [0, 0], 0
    for kind, title in TITLES.items():
        for ranks in (1, 2):
            if kind == "ranks" and ranks == 1:
                continue
            found = batch(kind, ranks)
            lost = sum(bool(wrong) for wrong, _ in found.values())
            errors = Counter(error for wrong, error in found.values() if not wrong)
            pages = ", ".join(
                f"[{name}](failures.md#{name.lower()}) {n}" for name, n in errors.most_common()
            )
            inputs += len(found) if ranks == 2 else 0
            sums = [sums[0] + len(found), sums[1] + lost]
            row = (kind, title, ranks, len(found), pages, lost)
            rows.append("| " + " | ".join(map(str, row)) + " |")
            print(rows[-1], flush=True)
    tried, lost = sums
    rows.append(f"| all |  |  | {tried} | {tried - lost} | {lost} |")
    print(rows[-1])
    if given.output:
        text = PAGE.format(total=inputs, rows="\n".join(rows), seconds=SECONDS)
        Path(given.output).write_text(text)
    if lost:
        sys.exit(1)


if __name__ == "__main__":
    main()
