"""A first fit that contacts or friction stopped far from the optimum is begun elsewhere; a good one is left alone."""

import pytest
import torch

from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting import initial_theta
from onlinebayes.identification.fitting.fit import fit, unfitted
from onlinebayes.identification.fitting.initial_theta import from_elsewhere
from tests.criticism.rigs import TRUTH, measure, model


@pytest.fixture(scope="module")
def windows():
    return make_windows(model(), measure(runs=8), 1.0)


def test_a_fit_that_stopped_far_away_is_begun_elsewhere(windows) -> None:
    far = torch.tensor([7.0, 9.0]).double()
    stopped = unfitted(model(), windows, far, starts=windows.start + 20 * windows.start_sd)
    found = from_elsewhere(stopped, windows, far)
    assert found.theta.tolist() == pytest.approx(list(TRUTH), rel=0.01)
    assert found.projected.objective < 0.01 * stopped.projected.objective


@pytest.mark.long
def test_what_was_done_is_not_done_twice(windows, monkeypatch) -> None:
    """A fit that began at nominal theta with fresh starts would end where it ended."""
    begun: list[list[float]] = []

    def spy(simulator, windows, theta, weight):
        begun.append(theta.tolist())
        return fit(simulator, windows, theta, weight)

    monkeypatch.setattr(initial_theta, "fit", spy)
    nominal = model().nominal.double()
    stopped = unfitted(model(), windows, torch.tensor([7.0, 9.0]).double())
    from_elsewhere(stopped, windows, nominal)
    assert begun == [[7.0, 9.0]]


def test_a_fit_that_leaves_noise_is_the_one(windows) -> None:
    good = fit(model(), windows, model().nominal.double())
    assert from_elsewhere(good, windows, model().nominal.double()) is good
