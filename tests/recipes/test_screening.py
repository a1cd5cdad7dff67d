"""``make screening``: both ways of screening on one fit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from recipes.studies.screening import Study, main


@pytest.mark.long
def test_both_ways_are_timed_and_compared(tmp_path: Path) -> None:
    main(Study(rig="swing", effect="dry_friction@hinge", runs=7, repeats=1, results=tmp_path))
    table = json.loads((tmp_path / "screening.json").read_text())
    rows = {row["name"]: row for row in table["rows"]}
    assert table["command"] == "make screening"
    assert rows["candidates"]["value"] > 20
    assert rows["first by each"]["holds"]
    (difference,) = (row for name, row in rows.items() if name.startswith("largest relative difference of z"))
    assert difference["holds"]
