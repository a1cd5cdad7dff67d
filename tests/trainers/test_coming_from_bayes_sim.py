"""The names of ours on the page for those who know BayesSim's code or SimuRLacra exist."""

from __future__ import annotations

import re
from pathlib import Path

from tests.inference.test_coming_from_sbi import known

PAGE = (Path(__file__).parents[2] / "docs" / "concepts" / "coming-from-bayes-sim.md").read_text("utf-8")
ROOMS = ("embeddings", "inference", "inference.proposals", "objectives", "parameters", "trainers", "transforms")


def test_our_names() -> None:
    rows = re.findall(r"^\| .*? \| (.*?) \| .*\|$", PAGE, re.MULTILINE)
    names = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert len(names) > 25
    assert names - known(*(f"onlinebayes.{room}" for room in ROOMS)) == set()
