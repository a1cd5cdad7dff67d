"""Right answers that were called wrong, or wrong ones that were given, on blind cases: the kinds stay mended."""

from __future__ import annotations

import pytest

from recipes.studies.blind_rigs.judging import judge
from recipes.studies.blind_rigs.plan import Job
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.jobs import record


def judged(kind: str, seed: int) -> Judged:
    return record(Judged, judge(Job("swing", kind, seed)))


@pytest.mark.slow
def test_a_centre_that_is_off_is_not_taken_for_an_integrator() -> None:
    """Moments that follow the mass halved the error; cogging and a late sensor were named for the other half."""
    found = judged("own", 61000)
    assert found.verdict == "tie"
    assert found.accepted == ("com_offset@bob.z",)
    assert not found.missed


@pytest.mark.slow
def test_a_small_effect_that_holds_on_the_held_out_runs_is_not_doubted() -> None:
    """It lowers the error of single rows by 7 %, that of averages over many rows by far more; the fit saw these."""
    found = judged("surplus", 61002)
    assert found.verdict == "tie"
    assert not found.missed
