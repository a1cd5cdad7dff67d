"""A separation decides where the effect would be accepted, too; the words say which, and from which size on."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.criticism.experiment import Rivalry
from onlinebayes.criticism.experiment.deciding import accepted_from, rescaled, strength
from onlinebayes.criticism.experiment.rivals import Size
from onlinebayes.report import plan_words


def test_two_standard_errors_and_the_least_gain_are_both_asked() -> None:
    """Four standard deviations are two standard errors of the likelihood that they gain."""
    sigma = torch.tensor([20.0, 20.0, 3.0])
    gain = torch.tensor([0.018, 0.05, 0.5])
    assert (strength(sigma, gain) >= 1 - 1e-6).tolist() == [False, True, False]
    assert float(strength(sigma, gain)[2]) == 0.75


def test_at_the_size_that_is_said_the_least_gain_is_reached() -> None:
    """The missed squares go with the square of the size."""
    gain = torch.tensor(0.018)
    size = Size(1.04e-5, 0.0, "N m s2/rad2")
    asked = accepted_from(size, float(strength(torch.tensor(20.0), gain)))
    assert asked is not None
    assert float(rescaled(gain, torch.tensor(asked / size.value))) == pytest.approx(0.05, rel=1e-4)
    assert accepted_from(Size(0.9, 1.0, ""), 0.5) == pytest.approx(0.8)  # a factor, smaller than one
    assert accepted_from(None, 5.0) is None
    assert accepted_from(size, 0.0) is None


NAMES = ("drag@hinge = 1e-05 N m s2/rad2", "the model as it is")


@pytest.mark.parametrize(
    ("rivalry", "outcome", "said"),
    [
        (
            Rivalry(
                NAMES, 19.8, 21.7, False, gain=0.018, decides=False, too_small=True, accepted_from=1.7e-5, unit="u"
            ),
            "too small",
            "19.8 sigma, but the true one would gain 0.018 nats, and 0.05 are asked: accepted from about 1.7e-05 u on",
        ),
        (
            Rivalry(NAMES, 13.0, 13.0, False, gain=0.061, accepted_from=9e-6, unit="u"),
            "decides",
            "13 sigma; the true one would gain 0.061 nats, and 0.05 are asked: accepted from about 9e-06 u on",
        ),
        (
            Rivalry(("a", "b"), 2.0, 8.0, False, decides=False),
            "left open",
            "2 sigma, not enough (another input gives 8); the true one would gain 0 nats, and 0.05 are asked",
        ),
        (
            Rivalry(("a", "b"), 1.0, 1.4, True, decides=False),
            "structural",
            "at most 1.4 sigma under any admissible input",
        ),
    ],
)
def test_the_words_say_what_becomes_of_a_pair(rivalry: Rivalry, outcome: str, said: str) -> None:
    """One line each."""
    assert plan_words.outcome(rivalry) == outcome
    assert plan_words.expected(rivalry) == f"{' or '.join(rivalry.names)}: {said}"
