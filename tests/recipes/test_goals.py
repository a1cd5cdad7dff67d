"""The page of goals says what the tables say."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.runs import ResultTable
from onlinebayes.runs.results import today
from recipes.studies.goals import page_of

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def test_a_page_counts_goals_and_names_what_misses_them(tmp_path: Path) -> None:
    table = ResultTable("pendulum", "make pendulum", [1], commit="abcd1234")
    table.add("held", 2.0, unit="s", goal="<= 3", holds=True)
    table.add("missed | by far", 0.123456, unit="rad", goal=">= 1", holds=False)
    for seed, value in enumerate((3.0, 1.0, 2.0)):
        table.add(f"seed {seed}: error", value, unit="m", goal="<= 1", holds=value <= 1)
    table.add("no goal", 1.0)
    table.write(tmp_path)
    old = ResultTable("old", "make old", [1], commit=None)
    old.add("held long ago", 1.0, goal="<= 1", holds=True)
    old.write(tmp_path)
    ResultTable("without goals", "make nothing", [1]).write(tmp_path)
    lines = page_of(tmp_path).splitlines()
    first = f"| [pendulum](pendulum.md) | {today()} | abcd1234 | 2 | 5 | missed \\| by far; error (2) |"
    assert lines[-3:] == [first, f"| [old](old.md) | {today()} |  | 1 | 1 |  |", "| all | | | 3 | 6 | |"]


def test_the_page_of_the_repository_is_the_latest() -> None:
    assert (RESULTS / "goals.md").read_text(encoding="utf-8") == page_of(RESULTS), "run make pages"
