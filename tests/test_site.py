"""The documentation as a whole: pages are found, sketches are marked, the reference has every public name once."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import onlinebayes
from tests.test_readme import LINK

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [page for page in [*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")] if page.parent != DOCS / "api"]

RUN_ELSEWHERE = {
    "concepts/measurements.md": "Measurement",  # cli/test_docs
    "concepts/effects.md": "PropellerTorque",  # simulators/test_own_effect
    "concepts/simulators.md": "ppo(",  # trainers/test_documented_pieces
}
"""Page -> what stands in its block that another test runs."""

RUN_HERE = {"concepts/simulators.md": "class Slider", "concepts/rigs.md": "write_case"}
"""Page -> what stands in its block that runs alone."""


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    yield import_module("api")
    sys.modules.pop("api")


@pytest.fixture
def docstrings(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    yield import_module("docstrings")
    sys.modules.pop("docstrings")


def linked(page: Path) -> set[Path]:
    """Pages of the documentation to which a page links."""
    targets = [target for target, _ in re.findall(LINK, page.read_text(encoding="utf-8")) if target]
    return {(page.parent / target).resolve() for target in targets if "://" not in target}


def python_blocks(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def test_every_page_is_two_clicks_from_the_first_one_at_most() -> None:
    first = DOCS / "README.md"
    one = linked(first)
    two = one.union(*(linked(page) for page in one if page.suffix == ".md" and page.is_file()))
    far = [str(page.relative_to(DOCS)) for page in PAGES if page.resolve() not in {first.resolve(), *two}]
    assert not far, f"not reached from docs/README.md in two clicks: {sorted(far)}"


@pytest.mark.parametrize("page", [page for page in PAGES if page.suffix == ".md"], ids=lambda page: page.stem)
def test_a_block_of_python_that_no_test_runs_says_that_it_is_a_sketch(page: Path) -> None:
    name = page.relative_to(DOCS).as_posix()
    if name == "tutorial.md" or name.startswith("examples/"):  # test_tutorial and test_examples run all
        return
    text = page.read_text(encoding="utf-8")
    example = text.partition("## An example")[2] if name == "concepts/posteriors.md" else ""  # test_documented_loop
    for block in python_blocks(page):
        sketch = block.startswith("# sketch: ")
        runs = any(name in runs and runs[name] in block for runs in (RUN_ELSEWHERE, RUN_HERE)) or block in example
        assert sketch != runs, f"{name}: {'run, and called a sketch' if runs else 'not run, and not marked'}:\n{block}"


@pytest.mark.slow
@pytest.mark.parametrize("name", RUN_HERE)
def test_a_block_that_stands_alone_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = (text for text in python_blocks(DOCS / name) if RUN_HERE[name] in text)
    exec(compile(block, name, "exec"), {"__name__": "block"})


def test_the_reference_describes_every_public_name_once(api) -> None:
    described_by = api.owners()
    pages = {room: api.page(room, described_by) for room in api.rooms()}
    described: list[tuple[int, str]] = []
    for room, page in pages.items():
        (members,) = re.findall(r"^   :members: (.*)$", page, flags=re.MULTILINE)
        elsewhere = page.partition("Also offered here: ")[2]
        own = [] if members == "__doc__" else members.split(", ")
        for name in api.names(room):
            assert (name in own) != (f"[`{name}`]" in elsewhere), f"{room}.{name}"
        values = (getattr(import_module(room), name) for name in own)
        described += [(id(value), room) for value in values if hasattr(value, "__qualname__")]
    assert len({thing for thing, _ in described}) == len(described) > 300
    assert {"onlinebayes.criticism", "onlinebayes.parameters", "onlinebayes.simulators.effects"} <= set(pages)


def test_docstrings_are_read_as_the_plain_text_that_they_are(docstrings) -> None:
    lines = [
        "|x| of (*batch, P), ``a * b`` on ``c``.",
        "",
        "    y = |x| * 2",
        "",
        "Args:",
        "    x: a name_ [``unit``^2].",
        "",
        "    more",
    ]
    assert docstrings.reread(lines) == [
        "\\|x\\| of (\\*batch, P), ``a * b`` on ``c``.", "", "::", "", "    y = |x| * 2", "",
        "Args:", "    x: a name\\_ [``unit``\\ ^2].", "", "    more",
    ]  # fmt: skip


def test_the_citation_is_of_this_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {onlinebayes.__version__}\n" in citation


def test_every_page_stands_in_the_side_bar() -> None:
    """A forgotten one ends the site's build, an hour later."""
    said = (DOCS / "site" / "conf.py").read_text(encoding="utf-8")
    alone = [f"/docs/{page.stem}" for page in DOCS.glob("*.md") if page.stem != "README"]
    assert [page for page in alone if f'"{page}"' not in said] == []
