"""A separation decides where the effect would be accepted, too; the words say which, and from which size on."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.criticism.experiment import Rivalry
from onlinebayes.criticism.experiment.deciding import accepted_from, rescaled, strength
from onlinebayes.criticism.experiment.rivals import Size
from onlinebayes.criticism.report import plan_words


def test_three_sigma_and_five_percent_are_both_asked() -> None:
    """And sigma alone where no effect is added."""
    sigma = torch.tensor([20.0, 20.0, 2.0, 20.0])
    fall = torch.tensor([0.018, 0.05, 0.5, float("nan")])
    assert (strength(sigma, fall) >= 3 - 1e-6).tolist() == [False, True, False, True]
    assert float(strength(sigma, fall)[3]) == 20.0


def test_at_the_size_that_is_said_the_error_falls_by_five_percent() -> None:
    """The missed squares go with the square of the size."""
    fall = torch.tensor(0.018)
    size = Size(1.04e-5, 0.0, "N m s2/rad2")
    asked = accepted_from(size, float(strength(torch.tensor(20.0), fall)))
    assert asked is not None
    assert float(rescaled(fall, asked / size.value)) == pytest.approx(0.05, rel=1e-4)
    assert accepted_from(Size(0.9, 1.0, ""), 1.5) == pytest.approx(0.8)  # a factor, smaller than one
    assert accepted_from(None, 5.0) is None
    assert accepted_from(size, 0.0) is None


NAMES = ("drag@hinge = 1e-05 N m s2/rad2", "the model as it is")


@pytest.mark.parametrize(
    ("rivalry", "outcome", "said"),
    [
        (
            Rivalry(
                NAMES, 19.8, 21.7, False, fall=0.018, decides=False, too_small=True, accepted_from=1.7e-5, unit="u"
            ),
            "too small",
            "19.8 sigma, but it would lower the error by 1.8 %, and 5 % are asked: accepted from about 1.7e-05 u on",
        ),
        (
            Rivalry(NAMES, 13.0, 13.0, False, fall=0.061, accepted_from=9e-6, unit="u"),
            "decides",
            "13 sigma; it would lower the error by 6.1 %, and 5 % are asked: accepted from about 9e-06 u on",
        ),
        (
            Rivalry(("a", "b"), 2.0, 8.0, False, decides=False),
            "left open",
            "2 sigma, not enough (another input gives 8)",
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
