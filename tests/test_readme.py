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
    # the top moves by (0.1, −0.1) and a frictionless interface lets it slide: the force is upwards
    assert force[1] > 0 and abs(force[0]) < 0.05 * force[1]
    # the slave overhangs by about 0.1 of its length 2; end particles are clamped or open
    assert 1.8 < pair.contact_area() < 2.0 + 1e-12
    area = MPI.COMM_WORLD.allreduce(pair.particles.weight.sum())
    assert np.isclose(area, 2.0, rtol=1e-14)
    MPI.COMM_WORLD.Barrier()
    assert (folder / "pressure.png").stat().st_size > 1000
