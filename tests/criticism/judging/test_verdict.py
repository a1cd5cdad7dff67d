from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.judging.score import CrossValidated
from onlinebayes.criticism.judging.verdict import Evidence, decide, tied
from onlinebayes.identification.results import Numerics

FINE = Numerics(0.01, 0.0, True)


def verdict_of(
    before: float,
    after: float,
    *,
    enough: bool = True,
    undecided: bool = False,
    numerics: Numerics = FINE,
    accepted: int = 0,
    tie: bool = False,
    bounds: bool = False,
    miswired: bool = False,
) -> str:
    """The verdict on one signal's errors [floors]."""
    errors = {"q": before}, {"q": after}
    return decide(Evidence(enough, undecided, numerics, accepted, tie, bounds, *errors, miswired), 1.2)


def test_a_bound_comes_before_a_tie_and_after_too_little_data() -> None:
    assert verdict_of(5.0, 1.0, accepted=1, tie=True, bounds=True) == "bounds_exclude_truth"
    assert verdict_of(5.0, 1.0, enough=False, bounds=True) == "insufficient_data"


def test_equals_in_explaining_little_are_no_tie() -> None:
    assert verdict_of(9.0, 4.0, accepted=1, tie=True) == "tie"
    assert verdict_of(9.0, 8.0, accepted=1, tie=True) == "unexplained"


def test_a_wiring_fault_comes_before_everything() -> None:
    for enough, bounds in ((False, False), (True, True)):
        assert verdict_of(5.0, 5.0, enough=enough, bounds=bounds, miswired=True) == "data_problem"


@pytest.mark.parametrize(
    ("enough", "undecided", "fine", "accepted", "tie", "before", "after", "verdict"),
    [
        (False, False, True, 0, False, 1.0, 1.0, "insufficient_data"),
        (True, True, True, 0, False, 5.0, 5.0, "insufficient_data"),
        (True, True, True, 1, False, 5.0, 1.0, "missing_effect"),  # what is undecided is a further one
        (True, False, False, 0, False, 5.0, 5.0, "unexplained"),  # numerics: nothing is named
        (True, False, True, 1, True, 5.0, 1.0, "tie"),
        (True, False, True, 1, False, 5.0, 1.0, "missing_effect"),
        (True, False, True, 2, False, 50.0, 30.0, "missing_effect"),  # 64 % of the squared error is gone
        (True, False, True, 1, False, 50.0, 40.0, "unexplained"),  # 36 %
        (True, False, True, 1, False, 1.3, 1.15, "missing_effect"),  # reaches the floor
        (True, False, True, 0, False, 1.19, 1.19, "adequate"),
        (True, False, True, 0, False, 1.21, 1.21, "unexplained"),
    ],
)
def test_the_first_that_applies(enough, undecided, fine, accepted, tie, before, after, verdict) -> None:
    numerics = replace(FINE, sufficient=fine)
    found = verdict_of(before, after, enough=enough, undecided=undecided, numerics=numerics, accepted=accepted, tie=tie)
    assert found == verdict


def scores(density: list[float], rms: float, tau: float = 0.5) -> CrossValidated:
    d = torch.tensor(density).double()
    B = len(density)
    zero = torch.zeros(B, dtype=torch.float64)
    rows = (d / 10)[:, None].expand(B, 10)
    seen = torch.ones(B, 10, dtype=torch.bool)
    return CrossValidated(d, rms, rms, zero[:1], zero, zero + 10, rows, seen, tau)


def test_equal_errors_are_tied_whatever_the_score() -> None:
    assert tied(scores([9.0] * 8, 1.0), scores([0.0] * 8, 1.009), 0.01)


def test_a_steady_difference_parts() -> None:
    assert not tied(scores([5.0, 6.0, 5.0, 6.0, 5.0, 6.0, 5.0, 6.0], 1.0), scores([0.0] * 8, 1.1), 0.5)


def test_a_difference_of_few_blocks_does_not() -> None:
    assert tied(scores([9.0, -8.0, 9.0, -8.0, 9.0, -8.0, 9.0, -5.0], 1.0, tau=9.0), scores([0.0] * 8, 1.1), 0.5)
