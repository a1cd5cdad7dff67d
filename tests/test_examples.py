"""The pages of ``docs/examples`` run as a reader would run them, and print what they say they print."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_tutorial import blocks, shown_in

PAGES = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.md"))


LONG = {"adaptive-policy", "ray", "task-for-your-mjcf"}  # train a policy or start workers, for a quarter of a minute
CASES = [pytest.param(page, id=page.stem, marks=pytest.mark.slow if page.stem in LONG else ()) for page in PAGES]


@pytest.mark.parametrize("page", CASES)
def test_the_page_does_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": page.stem.replace("-", "_")}
    told = 0
    for language, text in blocks(page.read_text(encoding="utf-8")):
        if language == "python":
            capsys.readouterr()
            exec(compile(text, page.name, "exec"), names)
        elif language == "text":
            shown_in(text, capsys.readouterr().out)
            told += 1
    assert told, "the page shows nothing that its code prints"


def test_there_are_pages() -> None:
    assert len(PAGES) >= 5
    for page in PAGES:
        assert re.match(r"# \S", page.read_text(encoding="utf-8")), page.name
