"""Rows of a result table."""

from __future__ import annotations

import json
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

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


def test_the_head_says_when_and_by_which_code_a_table_was_printed(tmp_path: Path) -> None:
    table = ResultTable("study", "make study", [1], commit="0123abcd+")
    head = json.loads(table.write(tmp_path).read_text())
    assert head["commit"] == "0123abcd+"
    assert datetime.now(UTC).date() - date.fromisoformat(head["date"]) <= timedelta(days=1)
    line = f"Printed by `make study` on {head['date']} (commit 0123abcd+; seeds 1; "
    assert line in (tmp_path / "study.md").read_text()
    assert json.loads(ResultTable("study", "make study", [1], commit=None).to_json())["commit"] is None
