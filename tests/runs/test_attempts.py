"""Parts of work that fail leave the others, and say so in one line."""

from __future__ import annotations

import pytest

from onlinebayes.runs import Attempts, BadInput, Stopped

pytestmark = pytest.mark.usefixtures("faults_are_noted")


def test_what_fails_is_noted_in_one_line_and_the_work_goes_on() -> None:
    attempts, done = Attempts(), []
    with attempts.attempt("the first part"):
        done.append(1)
        raise RuntimeError("sizes 12\nand 13 differ")
    with attempts.attempt("the second part"):
        done.append(2)
    assert done == [1, 2]
    (line,) = attempts.failed
    assert line.startswith(
        "the first part failed by a fault of onlinebayes: RuntimeError: sizes 12 and 13 differ (test_attempts.py, line "
    )
    assert [type(error) for error in attempts.errors] == [RuntimeError]


def test_a_value_has_another_in_its_place() -> None:
    attempts = Attempts()
    assert attempts.made("a figure", lambda: 3, 0) == 3
    assert attempts.made("a figure", lambda: 1 // 0, 0) == 0
    assert len(attempts.failed) == 1


def test_a_bad_input_is_said_in_its_own_words() -> None:
    attempts = Attempts()
    with attempts.attempt("the replay"):
        raise BadInput("the model diverges", "shorten its step")
    assert attempts.failed == ["the replay failed: the model diverges; shorten its step"]


@pytest.mark.parametrize("stop", [Stopped(), KeyboardInterrupt()])
def test_a_stop_is_no_failure(stop: BaseException) -> None:
    attempts = Attempts()
    with pytest.raises(type(stop)), attempts.attempt("the search"):
        raise stop
    assert attempts.failed == []
