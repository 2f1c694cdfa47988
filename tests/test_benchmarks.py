# SPDX-License-Identifier: MIT
"""Benchmarks at a small size: the scripts behind the pages of docs/ run, and their assertions hold."""

import importlib
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "benchmarks"


@pytest.mark.parametrize(
    "name", ["convergence", "rules", "infsup", "material", "scaling", "solvers"]
)
def test_small(name, monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    importlib.import_module(name).main(["--small"])
