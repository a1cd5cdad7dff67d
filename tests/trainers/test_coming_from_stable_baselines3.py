"""The names of ours on the page for those who know Stable-Baselines3 exist."""

from __future__ import annotations

import re
from pathlib import Path

from tests.inference.test_coming_from_sbi import known

PAGE = (Path(__file__).parents[2] / "docs" / "concepts" / "coming-from-stable-baselines3.md").read_text("utf-8")
ROOMS = ("inference", "loggers", "objectives", "policies", "runs", "trainers", "transforms")


def test_our_names() -> None:
    rows = re.findall(r"^\| .*? \| (.*?) \| .* \|$", PAGE, re.MULTILINE)
    names = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert len(names) > 20
    assert names - known(*(f"onlinebayes.{room}" for room in ROOMS)) == set()


def test_the_other_side_of_the_example_is_made_of_our_names() -> None:
    shown = PAGE[PAGE.index("```text") :]
    called = set(re.findall(r"(\w+)\(", " ".join(line[52:] for line in shown.splitlines()[2:])))
    assert {"ppo", "improve", "load_policy", "act"} <= called
    assert called - known(*(f"onlinebayes.{room}" for room in ROOMS)) == set()


def test_it_is_short() -> None:
    assert len(PAGE.splitlines()) <= 60
