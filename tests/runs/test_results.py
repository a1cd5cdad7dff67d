"""Rows of a result table."""

from __future__ import annotations

import pytest

from onlinebayes.runs import ResultTable, Row


@pytest.mark.parametrize(
    ("goals", "goal", "holds"),
    [
        ({}, None, None),
        ({"least": 2.0}, ">= 2", True),
        ({"least": 2.5}, ">= 2.5", False),
        ({"most": 1.0}, "<= 1", False),
    ],
)
def test_seeds_are_told_by_their_median_and_one_by_one(goals, goal, holds) -> None:
    table = ResultTable("study", "make study", [1, 2, 3])
    table.add_seeds("return", [3.0, 1.0, 2.0], unit="m", **goals)
    assert table.rows == [Row("return", 2.0, "3 1 2", "m", goal, holds)]
