# SPDX-License-Identifier: MIT
"""Prints the row of docs/versions.md: `versions_row.py RELEASE LOGS`, run in the release's root.

LOGS holds, for each stage, its output in NAME.log and "passed" or "FAILED" in NAME.result.
"""

import datetime
import platform
import re
import subprocess
import sys
from pathlib import Path

from dolfinx import __version__ as dolfinx
from petsc4py import PETSc

release, logs = sys.argv[1], Path(sys.argv[2])
NUMBERS = {"bookworm": "12", "trixie": "13", "sid": "unstable"}


def output(stage):
    file = logs / f"{stage}.log"
    return file.read_text() if file.exists() else ""


def passed(stage):
    file = logs / f"{stage}.result"
    return file.read_text().strip() if file.exists() else "–"


def cpp_tests():
    """Catch2's own count on one rank: ctest shows no output of what passes, but keeps it."""
    log = Path("/contact-build/Testing/Temporary/LastTest.log").read_text(errors="replace")
    found = re.findall(r"All tests passed \((\d+) assertions? in (\d+) test cases?\)", log)
    if passed("ctest") != "passed" or not found:
        return "FAILED"
    return f"{int(found[0][0]):,} assertions in {found[0][1]} cases"


def python_tests(ranks):
    """Numbers that pytest prints last: `720 passed`, or `3 failed, 717 passed`."""
    found = re.findall(
        r"^=*\s*((?:\d+ \w+,? ?)+) in [\d.]+s", output(f"pytest-{ranks}"), re.MULTILINE
    )
    counts = found[-1].strip() if found else ""
    counts = ", ".join(c for c in counts.split(", ") if "warning" not in c)
    if passed(f"pytest-{ranks}") == "passed":
        return counts
    return f"FAILED {counts}".strip()


def demos():
    count = len(re.findall(r"^/usr/bin/python3 demos/\w+\.py", output("demos"), re.MULTILINE))
    return f"{count} passed" if passed("demos") == "passed" else "FAILED"


gcc = subprocess.run(["g++", "-dumpfullversion"], capture_output=True, text=True, check=True)
cells = [
    f"{NUMBERS[release]} ({release})",
    dolfinx,
    ".".join(map(str, PETSc.Sys.getVersion())),
    platform.python_version(),
    gcc.stdout.strip(),
    cpp_tests(),
    *(python_tests(n) for n in (1, 2, 3)),
    demos(),
    passed("pip"),
    datetime.date.today().isoformat(),
]
print("| " + " | ".join(cells) + " |")
