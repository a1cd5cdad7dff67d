"""Progress tells speed and time left where it is told the frames."""

from __future__ import annotations

import pytest

from onlinebayes.runs import Progress, progress


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_speed_and_time_left_count_from_where_a_run_goes_on(clock, capsys):
    with Progress("online", 6, every=0.0) as shown:
        shown.update(2, "policy", frames=5000)
        clock[0] = 10.0
        shown.update(2.5, "policy", frames=25_000)
        clock[0] = 20.0
        shown.update(3, frames=45_000)
    assert capsys.readouterr().err.splitlines() == [
        "online 2/6 [0 s] policy",
        "online 2/6 [10 s, 2,000 frames/s, 70 s left] policy",
        "online 3/6 [20 s, 2,000 frames/s, 60 s left]",
    ]


def test_the_speed_is_that_of_the_last_half_minute(clock, capsys):
    with Progress("online", every=0.0) as shown:
        for second in range(0, 101, 10):
            clock[0] = second
            shown.update(0, frames=second if second < 50 else 1000 * second)
    assert capsys.readouterr().err.splitlines()[-1] == "online 0 [100 s, 1,000 frames/s]"


def test_without_frames_nothing_is_said_of_speed(clock, capsys):
    with Progress("refine", 2, every=0.0) as shown:
        shown.update(0, "a")
        clock[0] = 5.0
        shown.update(1, "b")
    assert capsys.readouterr().err.splitlines() == ["refine 0/2 [0 s] a", "refine 1/2 [5 s] b"]


@pytest.mark.parametrize(("seconds", "text"), [(99, "99 s"), (600, "10 min"), (7200, "2.0 h")])
def test_spans(seconds, text):
    assert progress._span(seconds) == text
