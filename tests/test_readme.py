# SPDX-License-Identifier: MIT
"""The README's script runs as it is written."""

import re
from pathlib import Path

import numpy as np
from mpi4py import MPI


def test_first_script(tmp_path, monkeypatch):
    """It solves, finds the blocks in contact over their whole interface, and draws its picture."""
    folder = Path(MPI.COMM_WORLD.bcast(str(tmp_path), root=0))
    monkeypatch.chdir(folder)
    text = (Path(__file__).parent.parent / "README.md").read_text()
    script = re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1)
    names: dict = {}
    exec(compile(script, "README.md", "exec"), names)

    pair = names["pair"]
    force = pair.resultant()
    # the top moves by (0.1, −0.1): the force is upwards, and friction holds against the motion
    assert force[1] > 0 and -0.3 * force[1] < force[0] < -0.05 * force[1]
    assert np.isclose(pair.friction_resultant()[0], force[0], rtol=0.2)
    assert 1.8 < pair.contact_area() < 2.0 + 1e-12
    area = MPI.COMM_WORLD.allreduce(pair.particles.weight.sum())
    assert np.isclose(area, 2.0, rtol=1e-14)
    MPI.COMM_WORLD.Barrier()
    assert (folder / "pressure.png").stat().st_size > 1000


def test_tools_page():
    """The code of docs/tools.md runs, one block after the other."""
    text = (Path(__file__).parent.parent / "docs" / "tools.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict = {}
    for block in blocks:
        exec(compile(block, "tools.md", "exec"), names)
    assert len(blocks) == 3 and names["holder"].driven
    assert np.allclose(names["punch"].translation, (0, 0, -10))
