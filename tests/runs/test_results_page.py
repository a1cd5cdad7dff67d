"""The page of a result table: matrices, all other rows where they are few, a summary where they are many."""

from __future__ import annotations

import json

import pytest

from onlinebayes.runs import ResultTable, Row, result_page


def page(table: ResultTable) -> list[str]:
    return result_page(json.loads(table.to_json())).splitlines()


@pytest.fixture
def long() -> ResultTable:
    table = ResultTable("study", "make study", [1], commit="0123abcd")
    for i in range(40):
        table.add(f"system {i}: after {i} steps", float(i), spread="lost", unit="m", goal="<= 38", holds=i <= 38)
        table.add(f"verdict {i}", "tie")
    return table


def test_a_short_table_is_shown_whole_without_its_empty_columns() -> None:
    table = ResultTable("study", "make study", [], commit=None)
    table.add("error | of all", 0.12345, unit="m")
    lines = page(table)
    assert lines[4] == "All 1 rows: [study.json](study.json)."
    assert lines[6:] == ["| name | value | unit |", "|---|---|---|", "| error \\| of all | 0.1235 | m |"]
    assert "(commit unknown; seeds none; " in lines[2]


def test_a_long_table_shows_misses_the_range_of_each_quantity_and_the_first_other_rows(long: ResultTable) -> None:
    lines = page(long)
    assert "39 of 40 goals are held. All 80 rows and their spreads: [study.json](study.json)." in lines
    assert "| system 39: after 39 steps | 39 | m | <= 38 |" in lines
    assert "| after ... steps | 40 | 0 | 19.5 | 39 | m | 39 of 40 |" in lines
    assert "| verdict 7 | tie |" in lines
    assert "| verdict 8 | tie |" not in lines
    assert lines[-1] == "And 32 more."


def test_what_is_printed_holds_every_row(long: ResultTable) -> None:
    lines = long.to_markdown().splitlines()
    assert "| verdict 39 | tie |  |  |  |  |" in lines
    assert "| system 0: after 0 steps | 0 | lost | m | <= 38 | yes |" in lines


def test_a_table_without_a_date_is_said_to_be_of_older_code(long: ResultTable) -> None:
    old = {**json.loads(long.to_json()), "commit": None, "date": None}
    assert "Printed by older code" in result_page(old)
    assert "older code" not in result_page(json.loads(long.to_json()))


def test_long_texts_of_a_long_table_are_cut(long: ResultTable) -> None:
    long.rows.insert(0, Row("why", "x" * 99))
    assert f"| why | {'x' * 60}... |" in page(long)


def test_cases_that_share_quantities_are_a_matrix() -> None:
    table = ResultTable("study", "make study", [1], commit=None)
    for case, least, held in (("pendulum", ">= 3", True), ("acrobot, prior", ">= 7", False)):
        table.add(f"{case}: density", 5.0, unit="nats", goal=least, holds=held)
        table.add(f"{case}: time", 2.0, unit="s", goal="<= 1", holds=False)
        table.add(f"{case}: held", 0.5, unit="1 of 2")
    table.add("cases judged", 2)
    lines = page(table)
    assert lines[4].endswith("Bold: the goal is missed.")
    assert lines[6:] == [
        "|  | density [nats] | time [s], goal <= 1 | held |",
        "|---|---|---|---|",
        "| pendulum | 5 (>= 3) | **2** | 1 of 2 |",
        "| acrobot, prior | **5** (>= 7) | **2** | 1 of 2 |",
        "",
        "| name | value |",
        "|---|---|",
        "| cases judged | 2 |",
    ]


def test_cases_that_share_nothing_are_matrices_of_their_own() -> None:
    table = ResultTable("study", "make study", [1], commit=None)
    for case, quantities in (("a 1", "xyz"), ("a 2", "xyz"), ("b 1", "uvw"), ("b 2", "uvw")):
        for quantity in quantities:
            table.add(f"{case}: {quantity}", 1.0)
    heads = [line for line in page(table) if line.startswith("|  |")]
    assert heads == ["|  | x | y | z |", "|  | u | v | w |"]


def test_few_cases_with_many_quantities_stand_side_by_side() -> None:
    table = ResultTable("study", "make study", [1], commit=None)
    for case in ("slow", "fast"):
        for i in range(8):
            table.add(f"{case}: quantity {i}", float(i))
    lines = page(table)
    assert "|  | slow | fast |" in lines
    assert "| quantity 7 | 7 | 7 |" in lines


def test_the_cases_of_one_quantity_are_a_column() -> None:
    table = ResultTable("study", "make study", [1], commit=None)
    for i in range(8):
        table.add(f"case {i}: size", float(i), unit="m")
    assert page(table)[6:10] == ["|  | size [m] |", "|---|---|", "| case 0 | 0 |", "| case 1 | 1 |"]
