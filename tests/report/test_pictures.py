"""The small pictures and the words beside them say what the profile holds."""

from __future__ import annotations

import dataclasses
import re

import pytest

from onlinebayes.identification.detail import Profile
from onlinebayes.report import multiples, spread
from onlinebayes.report.markup import prose
from onlinebayes.report.region_words import in_words
from tests.report.many import many
from tests.report.synthetic import SIGNAL, criticism

PROFILE = Profile(
    SIGNAL, "velocity", "qvel.carriage", "m/s", (-0.2, -0.1, 0.0, 0.1, 0.2), (),
    time=(0.4, 0.1, 0.1, 0.4), before=(0.05, 0.5, 0.4, 0.05), after=(0.01, 0.02, 0.03, 0.01),
)  # fmt: skip


def test_neighbours_that_stand_out_are_one_region() -> None:
    assert multiples.telling(PROFILE) == "90 % of the error in 20 % of the time: −100 to 100 mm/s"
    assert multiples.title(PROFILE) == "by velocity of carriage"
    even = dataclasses.replace(PROFILE, before=PROFILE.time)
    assert multiples.telling(even) == "no part of it stands out"


def test_bars_are_as_high_as_the_shares() -> None:
    drawn = multiples.draw(PROFILE, changed=True)
    for kind, shares in (("time", PROFILE.time), ("before", PROFILE.before), ("after", PROFILE.after)):
        heights = [float(h) for h in re.findall(rf'class="share {kind}"[^>]*height="([\d.]+)"', drawn)]
        assert len(heights) == 4
        assert [h / heights[1] for h in heights] == pytest.approx([s / shares[1] for s in shares], abs=0.1)
    assert "share after" not in multiples.draw(PROFILE, changed=False)


def test_a_dot_stands_where_its_error_is_on_the_axis() -> None:
    (row,) = spread.spread_rows(criticism())
    assert row.values == pytest.approx({"before": 32.8, "after": 9.95})
    drawn = spread.draw([row], "title")
    ticks = [float(x) for x in re.findall(r'<path class="grid" d="M([\d.]+)', drawn)]
    before, after = (float(x) for x in re.findall(r'<circle[^>]*cx="([\d.]+)"', drawn))
    assert after == pytest.approx(ticks[1], abs=0.5)  # ten times the floor
    assert (before - ticks[0]) / (ticks[1] - ticks[0]) == pytest.approx(1.516, abs=0.01)  # log10 of 32.8


def test_the_worst_signal_stands_first() -> None:
    rows = spread.spread_rows(many(joints=5, candidates=3))
    assert [row.signal[-1] for row in rows] == ["0", "1", "2", "3", "4"]


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ("|qvel.arm.1| < 0.2 rad/s", "where arm.1 is slower than 0.2 rad/s"),
        ("qvel.arm > 0", "where arm moves forward"),
        ("qpos.arm > 0.2 rad", "where arm is above 0.2 rad"),
        ("|ctrl.motor| > 3", "where the command of motor is larger than 3"),
        ("run 'a run'", "in run “a run”"),
        ("time since the run's start < 2.5 s", "in the first 2.5 s of a run"),
        ("time since the run's start > 40 s", "later than 40 s after a run's start"),
        ("the last third of the time", "in the last third of the time"),
        ("something else", "something else"),
    ],
)
def test_regions_have_plain_words(where: str, words: str) -> None:
    assert in_words(where) == words


def test_numbers_stay_with_their_units_and_names_do_not() -> None:
    assert prose("joint_0 is off by 3.5 mm") == "joint_0 is off by 3.5&nbsp;mm"
