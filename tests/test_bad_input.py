# SPDX-License-Identifier: MIT
"""Every tenth bad input of the campaign (docs/faults.md) ends in our own error on all ranks."""

import sys
from pathlib import Path

import pytest
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))

import bad_input  # noqa: E402

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("kind", bad_input.TITLES)
def test_bad_inputs(kind):
    tried = bad_input.run([kind], every=10)
    assert len(tried) >= 3 or (kind == "ranks" and COMM.size == 1)
    assert not [(name, wrong) for _, name, wrong in tried if wrong]


def test_what_counts_as_lost():
    """The judge itself: no error, a foreign one, one without help, and different ones are losses."""
    import dolfinx_contact as dc

    def fail(error):
        raise error

    good = "friction is -1; give Coulomb's coefficient, a finite number"
    assert bad_input.judged(bad_input.outcome(lambda: fail(dc.InputError(good)))) == ""
    for call, words in (
        (lambda: None, "no error"),
        (lambda: fail(ValueError(good)), "ValueError"),
        (lambda: fail(dc.InputError("friction is -1, which is quite a wrong number")), "no help"),
        (lambda: fail(dc.InputError("TypeError: 'int'; " + good)), "another error"),
    ):
        assert words in bad_input.judged(bad_input.outcome(call))
    if COMM.size > 1:
        mixed = lambda: fail(
            dc.InputError(good) if COMM.rank else dc.ContactError(good)
        )  # noqa: E731
        assert "different errors" in bad_input.judged(bad_input.outcome(mixed))
        assert "no error on ranks [0]" in bad_input.judged(
            bad_input.outcome(lambda: COMM.rank and fail(dc.InputError(good)))
        )
