"""The names of ours on the pages for those who know another library exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.inference.test_coming_from_sbi import known

PAGES = Path(__file__).parents[2] / "docs" / "concepts"
ROOMS = ("embeddings", "inference", "inference.proposals", "loggers", "objectives", "parameters", "policies", "runs")
OURS = known(*(f"onlinebayes.{room}" for room in (*ROOMS, "trainers", "transforms")))


@pytest.mark.parametrize("page", ["coming-from-bayes-sim", "coming-from-stable-baselines3"])
def test_our_names(page: str) -> None:
    text = (PAGES / f"{page}.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .*? \| (.*?) \| .*\|$", text, re.MULTILINE)
    names = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert len(names) > 20
    assert names - OURS == set()
    assert len(text.splitlines()) <= 60


def test_the_other_side_of_the_example_is_made_of_our_names() -> None:
    page = (PAGES / "coming-from-stable-baselines3.md").read_text(encoding="utf-8")
    shown = page[page.index("```text") :]
    called = set(re.findall(r"(\w+)\(", " ".join(line[52:] for line in shown.splitlines()[2:])))
    assert {"ppo", "improve", "load_policy", "act"} <= called
    assert called - OURS == set()
