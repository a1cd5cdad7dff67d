"""``make house-size`` counts lines and constants by room."""

from __future__ import annotations

from pathlib import Path

from recipes.studies.house_size import LOOSE, Size, constants, of_the_tree, sizes, table

MODULE = '''"""A module."""
LEAST = 0.05
MOST: int = 7
ENDS = (0.25, 1.0)
WORDS = ("no", "number")
TRUE = True


def f(x: float = 3.0) -> float:
    y = 4.0
    return x + y
'''


def test_only_numbers_at_the_top_of_a_module_count() -> None:
    assert constants(MODULE) == 3


def test_files_are_counted_by_room() -> None:
    rooms = sizes(iter([("a/x.py", MODULE), ("a/b/y.py", "X = 1\n"), ("z.py", "\n\n")]))
    assert rooms == {"a": Size(12, 4), LOOSE: Size(2, 0)}


def test_the_house_is_found_and_the_table_has_both_sides() -> None:
    now = sizes(of_the_tree(Path(__file__).parents[2]))
    assert {"hypotheses", "report"} <= set(now)
    rows = {row.name: row for row in table(now, {"judging": Size(100, 10)}, "abc").rows}
    assert rows["judging: lines"].value == "0"
    assert rows["judging: lines"].spread == "100 at abc"
