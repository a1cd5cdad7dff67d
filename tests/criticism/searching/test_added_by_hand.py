"""What is added by hand is begun where the search would begin it, and only where that can help."""

import pytest
import torch

from onlinebayes.criticism import Selection
from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.searching import added_by_hand
from onlinebayes.criticism.searching.search import ground
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.parameters import Parameter
from onlinebayes.runs.interrupt import Stopped
from onlinebayes.simulators.effects import ActuatorDelay, Cogging, DryFriction
from tests.criticism.rigs import measure, model

COGGING = Cogging("rail", Parameter(0.0, 5.0, "N"), Parameter(1.0, 100.0, "rad/m"), Parameter(-3.2, 6.3, "rad"))
DELAY = ActuatorDelay("motor", Parameter(0.0, 0.05, "s"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))


@pytest.mark.slow
def test_cogging_added_by_hand_finds_its_poles() -> None:
    data = measure({COGGING: (1.0, 40.0, 0.7)}, runs=3, finer=16)
    (effect,) = propose(model(), make_windows(model(), data, 1.0), ["cogging@rail"])  # as the command line builds it
    grounds = ground(model().with_effect(effect), data, Selection())
    amplitude, poles, phase = grounds.fitted.theta[-3:].tolist()
    assert amplitude == pytest.approx(1.0, rel=0.02)
    assert poles == pytest.approx(40.0, rel=0.01)
    assert (phase - 0.7 + torch.pi) % (2 * torch.pi) - torch.pi == pytest.approx(0.0, abs=0.05)
    assert misfit(grounds.fitted.projected) < 1.2


def test_what_is_stopped_keeps_the_first_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise Stopped

    data = measure({COGGING: (1.0, 40.0, 0.7)}, runs=3)
    monkeypatch.setattr(added_by_hand, "settle", stopped)
    first = ground(model().with_effect(COGGING), data, Selection())
    assert misfit(first.fitted.projected) > 3.0


def test_what_leaves_noise_or_has_one_start_is_not_screened(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("screened again")

    monkeypatch.setattr(added_by_hand, "survey", never)
    delayed = measure({DELAY: (0.02,)}, runs=3)
    fitted = ground(model().with_effect(DELAY), delayed, Selection()).fitted
    assert float(fitted.theta[-1]) == pytest.approx(0.02, rel=0.02)
    left = ground(model().with_effect(FRICTION), delayed, Selection()).fitted
    assert misfit(left.projected) > 3.0  # friction is not what is missing, and has nowhere else to begin
