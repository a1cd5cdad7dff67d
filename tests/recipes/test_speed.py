"""``make bench`` measures what it says, in small."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from recipes.studies.speed import Settings, main
from recipes.studies.timing import Pairs, alternate, rate


@pytest.mark.slow
def test_the_table_has_every_row_with_its_goal(tmp_path: Path) -> None:
    threads = torch.get_num_threads()
    main(Settings(worlds=(16,), hoppers=8, seconds=0.02, threads=1, out=str(tmp_path)))
    torch.set_num_threads(threads)
    rows = {row["name"]: row for row in json.loads((tmp_path / "bench.json").read_text())["rows"]}
    assert (tmp_path / "bench.md").read_text().startswith("# bench")
    goals = {name: row["goal"] for name, row in rows.items() if row["goal"]}
    assert goals == {
        "CartPole, 16 worlds, over one GymEnv": ">= 400",
        "Hopper, simulator.step over raw": ">= 0.9",
        "Hopper, Collector, random policy over raw": ">= 0.65",
        "policy of 2 x 64 units, an action": "<= 30",
    }
    ratio = rows["CartPole, 16 worlds, over one GymEnv"]
    assert 1 < ratio["value"] < 100
    assert ratio["holds"] is False  # 16 worlds cannot do it
    assert all(row["value"] > 0 for row in rows.values())


def test_pairs_alternate_and_the_first_is_thrown_away() -> None:
    calls: list[str] = []

    def side(name: str, value: float) -> float:
        calls.append(name)
        return value

    pairs = alternate(lambda: side("a", 6.0), lambda: side("b", 2.0), pairs=3)
    assert calls == ["a", "b"] * 4
    assert pairs.ratios == [3.0] * 3
    assert Pairs([1.0, 9.0], [2.0, 3.0]).ratios == [0.5, 3.0]


def test_a_rate_counts_frames_over_the_time_they_took() -> None:
    found = rate(lambda: 1000, 0.01)
    assert found > 1000 / 0.01
