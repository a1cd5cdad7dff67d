"""The one rule on made-up gains."""

from __future__ import annotations

import pytest

from onlinebayes.identification.judging.rule import equally_good, preferred, refusal
from onlinebayes.identification.judging.scoring import Gain

NOTHING = Gain((0.0, 0.0), 0.0, 8, 0)


def gain(*by_signal: float, se: float = 0.01, worse: int = 0) -> Gain:
    return Gain(by_signal, se, 8, worse)


def test_a_clear_gain_in_one_signal_is_preferred() -> None:
    assert preferred([gain(0.2, 0.0), gain(0.1, 0.0)], NOTHING)


@pytest.mark.parametrize(
    ("found", "gained", "why"),
    [
        ([gain(0.04, 0.0)], NOTHING, "explains too little"),
        ([gain(0.2, 0.0)], gain(2.5, 0.0), "explains too little"),
        ([gain(0.2, -0.3)], NOTHING, "explains too little"),
        ([gain(0.2, 0.0, se=0.11)], NOTHING, "uncertain"),
        ([gain(0.2, 0.0, worse=2)], NOTHING, "2 of 8 parts"),
        ([gain(0.2, 0.0), gain(0.01, 0.0)], NOTHING, "does not hold where it was not seen"),
    ],
)
def test_what_is_refused_says_why(found: list[Gain], gained: Gain, why: str) -> None:
    assert why in (refusal(found, gained) or "")


def test_a_signal_does_not_compete_with_what_was_gained_in_another() -> None:
    assert preferred([gain(0.0, 0.2)], gain(2.5, 0.1))
    assert not preferred([gain(0.2, 0.0)], gain(2.5, 0.1))


def test_two_are_equally_good_where_one_way_of_leaving_out_cannot_tell_them_apart() -> None:
    assert equally_good([gain(0.3, 0.0), gain(0.01, 0.0, se=0.02)], [1.0, 0.05])
    assert not equally_good([gain(0.3, 0.0), gain(0.3, 0.0)], [1.0, 1.0])
