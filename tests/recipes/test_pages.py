"""The pages of the results are made from the tables that there are, and say what these say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onlinebayes.runs import ResultTable, result_page
from recipes.studies.pages import Study, main

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def test_pages_are_made_anew_and_tables_stay_as_they_are(tmp_path: Path) -> None:
    table = ResultTable("pendulum", "make pendulum", [1], commit="abcd1234")
    table.add("error", 2.0, unit="m", goal="<= 1", holds=False)
    file = table.write(tmp_path)
    printed = {**json.loads(file.read_text(encoding="utf-8")), "date": "2026-11-01"}
    file.write_text(json.dumps(printed), encoding="utf-8")
    (tmp_path / "pendulum.md").write_text("another page", encoding="utf-8")
    main(Study(tmp_path))
    page = (tmp_path / "pendulum.md").read_text(encoding="utf-8")
    assert "on 2026-11-01 (commit abcd1234; seeds 1; " in page
    assert "| error | 2 | m | <= 1 | **no** |" in page
    assert "[pendulum](pendulum.md)" in (tmp_path / "goals.md").read_text(encoding="utf-8")
    assert json.loads(file.read_text(encoding="utf-8")) == printed


@pytest.mark.parametrize("file", sorted(RESULTS.glob("*.json")), ids=lambda file: file.stem)
def test_every_page_of_the_repository_is_made_from_its_table(file: Path) -> None:
    page = result_page(json.loads(file.read_text(encoding="utf-8")))
    assert file.with_suffix(".md").read_text(encoding="utf-8") == page, "run make pages"
