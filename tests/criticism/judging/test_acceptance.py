"""Which of the rules lets an effect in."""

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.judging.acceptance import Judged, judge
from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import GROSS_FLOORS, judged_stage, leaves_noise
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.blocks import make_blocks
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import misfit, project
from onlinebayes.identification.results import Numerics, Selection
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, Effect
from tests.criticism.rigs import measure, model

DELAY = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))


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
    base, one = unseen({DELAY: (delay,)})
    assert (misfit(base.fitted.projected) > GROSS_FLOORS) != refused
    assert leaves_noise(one.fitted, base.windows, 1.2)
    assert one.failed == (("may be chance: p = 0.99 is not below 0.03",) if refused else ())


@pytest.mark.parametrize(("friction", "refused"), [(0.05, False), (1.0, True)])
def test_nor_does_what_leaves_a_quarter_of_it(friction: float, refused: bool) -> None:
    base, one = unseen({DELAY: (0.03,), FRICTION: (friction,)})
    left = misfit(project(base.windows, one.fitted.lin))
    assert left > 1.2
    assert (left > misfit(base.fitted.projected) / 4) == refused
    assert ("may be chance: p = 0.99 is not below 0.03" in one.failed) == refused


def unseen(effects: dict[Effect, tuple[float, ...]]) -> tuple[Grounds, Judged]:
    """The delay judged where screening saw nothing of it, with so many others that the sign test sees nothing."""
    base = ground(model(), measure(effects, runs=8), Selection())
    found = survey(base.fitted, base.windows, [DELAY], None)
    blind = [replace(found.screened[0], p_value=0.99)]
    stage = judged_stage(replace(found, screened=found.screened * 1000), blind, base.numerics, Selection())
    (one,) = stage.judged
    return base, one
