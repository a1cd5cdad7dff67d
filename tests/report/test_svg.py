"""Charts: round ticks, no lost spikes, breaks where data break."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from onlinebayes.report.svg import Curve, Panel, chart, decimate, nice_ticks


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 10.0, [0, 2, 4, 6, 8, 10]),
        (-1.0, 1.0, [-1, -0.5, 0, 0.5, 1]),
        (0.13, 0.17, [0.13, 0.14, 0.15, 0.16, 0.17]),
    ],
)
def test_ticks_are_round(low: float, high: float, expected: list[float]) -> None:
    assert nice_ticks(low, high) == pytest.approx(expected)


def test_no_range_has_no_ticks() -> None:
    assert nice_ticks(1.0, 1.0) == []
    assert nice_ticks(float("nan"), 1.0) == []


def test_every_panel_has_three_ticks() -> None:
    for high in np.geomspace(1e-6, 1e6, 97):
        assert 3 <= len(nice_ticks(-high, 0.7 * high, count=3)) <= 8


def test_decimation_keeps_spikes_and_ends() -> None:
    x = np.arange(100_000.0)
    y = np.sin(x / 1e4)
    y[31_234], y[77_777] = 9.0, -9.0
    few_x, few_y = decimate(x, y, 500)
    assert len(few_x) <= 2 * 500 + 2
    assert (few_y.max(), few_y.min()) == (9.0, -9.0)
    assert (few_x[0], few_x[-1]) == (x[0], x[-1])
    assert (np.diff(few_x) > 0).all()


def test_decimation_skips_nan_and_keeps_long_gaps() -> None:
    x = np.arange(10_000.0)
    y = np.where((x > 4000) & (x < 6000), np.nan, 1.0)
    y[::7] = np.nan
    _, few = decimate(x, y, 100)
    assert np.isnan(few).sum() >= 10
    assert np.isfinite(few).sum() >= 70


def test_short_curves_stay() -> None:
    x = np.arange(10.0)
    assert decimate(x, x, 100)[0] is x


def test_lines_break_at_nan() -> None:
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    text = chart([Panel([Curve(np.arange(5.0), y, "before", "a")], "y", 100)], "x")
    (d,) = re.findall(r'class="curve before" d="([^"]*)"', text)
    assert d.count("M") == 2


def test_dots_stand_alone_in_any_order() -> None:
    x, y = np.array([3.0, 1.0, 2.0, 0.0]), np.array([0.0, 1.0, np.nan, 2.0])
    text = chart([Panel([Curve(x, y, "after", "a", dots=True)], "y", 100)], "x")
    (d,) = re.findall(r'class="dots after" d="([^"]*)"', text)
    places = re.findall(r"M([\d.]+) [\d.]+h0", d)
    assert d.count("L") == 0
    assert [float(place) for place in places] == sorted(map(float, places), reverse=True)
    assert len(places) == 3


@pytest.mark.parametrize("y", [np.full(5, np.nan), np.zeros(5), np.empty(0), np.full(5, 1e-9)])
def test_odd_data_still_give_a_drawing(y: np.ndarray) -> None:
    text = chart(
        [Panel([Curve(np.arange(len(y)) * 1.0, y, "after", "<&>")], "y <&>", 100, band=0.0)], "x", title='"<&>'
    )
    ElementTree.fromstring(text)
    assert "nan" not in text
