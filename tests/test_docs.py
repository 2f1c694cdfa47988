# SPDX-License-Identifier: MIT
"""The documentation is true: all code of README.md and docs/ runs as written, and all links lead on.

The Python blocks of a page run one after the other, in one namespace and in an empty folder. What a page
does not show for brevity stands before the block in a comment, `<!-- setup` … `-->`, which runs too.
"""

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

COMM = MPI.COMM_WORLD
ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "howto").glob("*.md")),
]
BLOCK = re.compile(
    r"^<!-- setup\n(?P<hidden>.*?)^-->$|^(?P<indent> *)```python\n(?P<shown>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)
FENCE = re.compile(r"^ *```(\S.*)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def blocks(page):
    """Line number and code of each block that runs, hidden ones included."""
    text = page.read_text()
    for match in BLOCK.finditer(text):
        group = "hidden" if match["hidden"] is not None else "shown"
        yield text.count("\n", 0, match.start(group)), textwrap.dedent(match[group])


def name(page):
    return str(page.relative_to(ROOT))


def readme(names):
    """The blocks touch over their whole interface, friction holds against the motion."""
    pair = names["pair"]
    force = pair.resultant()
    assert force[1] > 0 and -0.3 * force[1] < force[0] < -0.05 * force[1]
    assert np.isclose(pair.friction_resultant()[0], force[0], rtol=0.2)
    assert 1.8 < pair.contact_area() < 2.0 + 1e-12
    area = COMM.allreduce(pair.particles.weight.sum())
    assert np.isclose(area, 2.0, rtol=1e-14)
    COMM.Barrier()
    assert Path("pressure.png").stat().st_size > 1000


def tools(names):
    assert names["holder"].driven
    assert np.allclose(names["punch"].translation, (0, 0, -10))


CHECKS = {"README.md": readme, "docs/tools.md": tools}


@pytest.mark.parametrize("page", [p for p in PAGES if any(blocks(p))], ids=name)
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(COMM.bcast(str(tmp_path), root=0))
    names = {"__name__": "__main__"}
    for line, code in blocks(page):
        exec(compile("\n" * line + code, name(page), "exec"), names)
    CHECKS.get(name(page), lambda names: None)(names)
    COMM.Barrier()  # before the folder goes


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_is_one_that_runs_or_no_python(page):
    """No code hides from the test above: under another name, or since a fence does not close."""
    text = page.read_text()
    kinds = FENCE.findall(text)
    assert set(kinds) <= {"python", "sh", "text", "{toctree}", "{eval-rst}"}
    shown = [match for match in BLOCK.finditer(text) if match["shown"] is not None]
    assert kinds.count("python") == len(shown)
    assert len(re.findall("^ *```", text, re.MULTILINE)) == 2 * len(kinds)
    assert text.count("<!-- setup") == len(list(BLOCK.finditer(text))) - len(shown)


# names of DOLFINx that some of its versions lack, and our own behind them
VERSIONED = re.compile(
    r"\b(VectorFunctionSpace|FunctionSpace|functionspace|gmshio|io\.gmsh|scatter_reverse|compat)\b"
)


def test_scripts_have_one_spelling_for_all_versions():
    """Pages, demos and benchmarks run as they are on every DOLFINx of docs/versions.md."""
    code = {name(p): "\n".join(c for _, c in blocks(p)) for p in PAGES}
    code.update({name(p): p.read_text() for p in (ROOT / "demos").glob("*.py")})
    for p in (ROOT / "benchmarks").rglob("*.py"):
        code[name(p)] = p.read_text().replace("compat", "")  # these may
    found = {where: VERSIONED.findall(text) for where, text in code.items()}
    assert not {where: names for where, names in found.items() if names}


def anchors(page):
    """Of a page's headings, made as Sphinx and forges make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for link in LINK.findall(text):
        if link.startswith(("http:", "https:")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target), link


def test_every_page_is_in_the_index():
    text = (ROOT / "docs" / "index.md").read_text()
    listed = set(re.findall(r"^[\w/]+$", text, re.MULTILINE))
    pages = {name(p)[len("docs/") : -len(".md")] for p in PAGES[1:]}
    assert listed == pages - {"index"}
