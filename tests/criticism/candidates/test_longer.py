"""A lag beyond a tenth of the horizon is found, not called by other names; a user's own bound stands."""

import pytest
import torch

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.searching.stage import refit
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorLag
from tests.criticism.rigs import measure, model

TRUTH = 0.25  # s, of windows of one second


def lag_of(bound: float) -> ActuatorLag:
    return ActuatorLag("motor", Parameter(0.0, bound, "s"))


def lagging(lag: float):
    """Windows of a slide whose motor lags, and the base model fitted; without the runs' beginnings.

    The rig's lag starts at no command. What a log begins with is taken as having been held before.
    """
    windows = make_windows(model(), measure({lag_of(0.5): (lag,)}, runs=8, seconds=5.0), 1.0, 4.0)
    windows = windows.select((windows.first * windows.step > 1.9).nonzero()[:, 0])
    return windows, fit(model(), windows, torch.tensor([2.5, 1.4]).double())


@pytest.fixture(scope="module")
def late():
    return lagging(TRUTH)


def test_a_lag_that_ends_on_the_bound_is_given_a_longer_one(late) -> None:
    windows, base = late
    (proposed,) = propose(model(), windows, ["actuator_lag"])
    assert proposed.parameters["time_constant"].high == pytest.approx(0.1)
    fitted, effect = refit(base, windows, proposed, {"time_constant": 0.04})
    assert effect.key == proposed.key
    assert effect.parameters["time_constant"].high == pytest.approx(0.3)
    assert float(fitted.theta[-1]) == pytest.approx(TRUTH, abs=0.005)
    assert effect in fitted.simulator.effects


def test_a_bound_that_is_not_criticisms_stands(late) -> None:
    windows, base = late
    fitted, effect = refit(base, windows, lag_of(0.12), {"time_constant": 0.05})
    assert effect == lag_of(0.12)
    assert float(fitted.theta[-1]) == pytest.approx(0.12, rel=1e-3)


def test_a_lag_inside_its_bound_keeps_it() -> None:
    windows, base = lagging(0.05)
    (proposed,) = propose(model(), windows, ["actuator_lag"])
    _, effect = refit(base, windows, proposed, {"time_constant": 0.04})
    assert effect is proposed
