# SPDX-License-Identifier: MIT
"""Bad inputs of the campaign in bad_input.py, by kind; each is a name and a call that must fail.

Every call runs on all ranks, on meshes of a few cells that are made anew for it. Cases of the kind
"ranks" give each rank something else, and are none on one rank.
"""

from . import grids, laws, output, pairs, problems, ranks, steps, surfaces, tools  # noqa: F401
from .scene import cases  # noqa: F401
