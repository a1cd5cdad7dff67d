"""``make update-speed`` measures what it says, in small."""

from __future__ import annotations

import json
from pathlib import Path

import torch

from recipes.studies.update_speed import Settings, main


def test_the_table_has_every_row_with_its_goal(tmp_path: Path) -> None:
    threads = torch.get_num_threads()
    main(Settings(steps=1, pairs=1, out=str(tmp_path)))
    torch.set_num_threads(threads)
    rows = {row["name"]: row for row in json.loads((tmp_path / "update-speed.json").read_text())["rows"]}
    goals = {name: row["goal"] for name, row in rows.items() if row["goal"]}
    assert goals == {"SAC, ours over by hand": "<= 1.3", "DDPG, ours over by hand": "<= 1.3"}
    assert all(row["value"] > 0 for row in rows.values())
