# SPDX-License-Identifier: MIT
"""Contact forces on slave and master: action and reaction, and what is left of moments."""

from __future__ import annotations

import numpy as np
import pytest
from operators import INTERPOLATED, TARGETS, case
from two_bodies import CELLS, model

import dolfinx_contact as dc

EPS = np.finfo(float).eps
PARALLEL = ("proximity-facet", "direction-direction", "smooth-interpolated")  # r ∥ n


@pytest.mark.parametrize("configuration", ("deformed", "sliding", "clamped"))
@pytest.mark.parametrize("target", (*TARGETS, *INTERPOLATED))
@pytest.mark.parametrize("cell", CELLS)
def test_balance(cell, target, configuration):
    """Forces on slave and master cancel, and so do their moments where r = x¹ − x² lies along the
    traction; elsewhere (targets clamped to an end, a search that is not along the normal) the
    moment left is ∫ −r × t dΓ at any gap."""
    c = case(model(cell, "columns"), target, dc.Simpson(1), configuration)
    dim, bulk = c.pair.slave.dim, ~c.multiplier
    residual = c.residual()[1][bulk].reshape(-1, dim)
    reference = c.numbering.points[bulk][::dim, :dim]
    position = reference + c.x[bulk].reshape(-1, dim)
    table = c.particles()
    size = np.abs(residual).sum()
    assert size > 0.1
    resultant = table["weight"] @ table["traction"]
    slave = c.slave[bulk][::dim]
    # round-off of some 100 terms
    assert np.abs(residual.sum(axis=0)).max() < 100 * EPS * size
    assert np.allclose(residual[slave].sum(axis=0), -resultant, rtol=0, atol=100 * EPS * size)

    moment = _moment(position, residual).sum(axis=0)
    closed = table["closed"]
    arm, n = (table["x"] - table["target"])[closed], table["normal"][closed]
    left = -table["weight"][closed] @ _moment(arm, table["traction"][closed])
    assert np.allclose(moment, left, rtol=0, atol=1000 * EPS * size)
    beside = arm - np.sum(arm * n, axis=1, keepdims=True) * n
    along = np.linalg.norm(beside, axis=1).max() < 1e-8
    assert along == (target in PARALLEL and configuration != "clamped")
    if along:
        # targets are solved to 1e-13 of a facet
        assert np.abs(moment).max() < 1e-12 * size
    else:
        # gap × force × angle of n and r, which is small between facet and interpolated normals
        assert np.abs(moment).max() > (1e-4 if "facet" in target else 1e-6) * size


def _moment(x, f):
    """x × f; in 2D its third component, as a column."""
    if x.shape[1] == 3:
        return np.cross(x, f)
    return (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])[:, None]
