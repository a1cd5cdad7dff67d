"""Series with instants of their own: what nobody asks for spoils nothing."""

from __future__ import annotations

from array import array
from pathlib import Path

import pytest

from onlinebayes.measurements.formats.series import Series, SeriesSource
from onlinebayes.runs import BadInput


def source() -> SeriesSource:
    """A joint, and a map that was sent twice with one stamp."""
    joint = Series(array("q", [0, 10, 20]), array("d", [0.0, 0.5, 1.0]))
    twice = Series(array("q", [5, 5]), array("d", [1.0, 1.0]))
    return SeriesSource(Path("log.mcap"), {"joint": joint, "map": twice})


def test_a_clock_that_stands_still_matters_where_its_column_is_asked_for() -> None:
    assert source().columns(["time", "joint"])["joint"].tolist() == [0.0, 0.5, 1.0]
    with pytest.raises(BadInput, match=r"sample 2 of 'map': the time goes from"):
        source().columns(["time", "joint", "map"])


def test_the_time_alone_is_that_of_all_samples() -> None:
    assert source().columns(["time"])["time"].tolist() == pytest.approx([0.0, 5e-9, 1e-8, 2e-8])
