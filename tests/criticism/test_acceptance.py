"""Which of the rules lets an effect in."""

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.acceptance import Judged, judge
from onlinebayes.criticism.blocks import make_blocks
from onlinebayes.criticism.fit import fit
from onlinebayes.criticism.projection import signal_rms
from onlinebayes.criticism.results import Numerics, Selection
from onlinebayes.criticism.score import cross_validate
from onlinebayes.criticism.search import ground
from onlinebayes.criticism.stage import GROSS_MISFIT, judged_stage, leaves_noise
from onlinebayes.criticism.survey import survey
from onlinebayes.criticism.windows import make_windows
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay
from tests.criticism.rigs import measure, model

DELAY = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))


def judged(p_value: float, tried: int, delay: float = 0.006) -> Judged:
    """The verdict on a true delay that screening saw with this p among so many candidates."""
    windows = make_windows(model(), measure({DELAY: (delay,)}, runs=8), 1.0, 0.1)
    current = fit(model(), windows, torch.tensor([2.5, 1.4]).double())
    blocks = make_blocks(windows, 0.05)
    grown = fit(model().with_effect(DELAY), windows, torch.tensor([2.5, 1.4, 0.006]).double())
    scores = cross_validate(current, windows, blocks)
    return judge(DELAY, p_value, grown, scores, windows, blocks, Numerics(0.01, 0.0, True), 0.03, tried)


@pytest.mark.parametrize(("tried", "refused"), [(1, False), (10**9, True)])
def test_a_gain_in_every_block_stands_in_for_a_screening_that_saw_little(tried: int, refused: bool) -> None:
    found = judged(0.5, tried)
    assert found.gain.better == found.gain.blocks
    assert found.failed == (("may be chance: p = 0.5 is not below 0.03",) if refused else ())


def test_a_refusal_says_how_many_blocks_lose() -> None:
    found = judged(0.001, 1, delay=0.0)
    lost = found.gain.blocks - found.gain.better
    assert lost > 0
    assert any(f"{lost} of {found.gain.blocks} blocks lose" in reason for reason in found.failed)


@pytest.mark.parametrize(("delay", "refused"), [(0.03, False), (0.001, True)])
def test_what_leaves_noise_of_a_gross_misfit_needs_no_p(delay: float, refused: bool) -> None:
    """Screening that saw nothing, among so many candidates that the sign test says nothing either."""
    base = ground(model(), measure({DELAY: (delay,)}, runs=8), Selection())
    gross = float(signal_rms(base.fitted.projected).max()) > GROSS_MISFIT
    assert gross != refused
    found = survey(base.fitted, base.windows, [DELAY], None)
    unseen = [replace(found.screened[0], p_value=0.99)]
    stage = judged_stage(replace(found, screened=found.screened * 1000), unseen, base.numerics, Selection(), print)
    (one,) = stage.judged
    assert leaves_noise(one.fitted, base.windows, 1.2)
    assert one.failed == (("may be chance: p = 0.99 is not below 0.03",) if refused else ())
