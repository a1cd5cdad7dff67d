"""The README's example is taken out of it and run as a reader would run it; its links lead somewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), ROOT / "llms.txt", *ROOT.glob("docs/**/*.md")])
LINK = r"\]\(([^)#\"\s]*)#?([^)\"\s]*)(?: \"[^\"]*\")?\)"
"""[text](target#anchor "title"), the anchor and the title where there are some."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def test_the_example_does_what_the_readme_says(tmp_path: Path) -> None:
    code, _ = blocks(ROOT / "README.md", "python")
    printed = run(code, tmp_path)
    assert printed.startswith("missing_effect ('quadratic_drag@arm',)")
    before, after = (float(value) for value in re.findall(r"{'qpos.arm': ([\d.e-]+)}", printed))
    said = re.search(r"falls from (\d+) to (\d+) mrad", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert said is not None
    assert [round(1000 * before), round(1000 * after)] == [int(figure) for figure in said.groups()]
    assert {path.name for path in (tmp_path / "out" / "arm").iterdir()} == {
        "report.html", "report.json", "run.rrd", "refined.xml",
    }  # fmt: skip


@pytest.mark.slow
def test_the_second_example_learns_to_balance(tmp_path: Path) -> None:
    pytest.importorskip("safetensors")
    _, code = blocks(ROOT / "README.md", "python")
    score, action = run(code, tmp_path).splitlines()[-2:]
    assert float(score.removesuffix(" of 500")) > 400
    assert action == "[0 1]"
    assert {path.name for path in (tmp_path / "out" / "poles").iterdir()} == {"policy.safetensors", "policy.md"}


def run(code: str, folder: Path) -> str:
    """The output of a script; warnings are errors, but for the one that torchrl raises at its own import."""
    script = folder / "example.py"
    script.write_text(code)
    command = [sys.executable, "-W", "error", "-W", "ignore:Creating:DeprecationWarning", script]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_between_the_documents_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(LINK, page.read_text(encoding="utf-8")):
        if "://" not in target:
            other = page.parent / target if target else page
            assert other.exists(), f"{page.name} links to {target}"
            assert not anchor or anchor in anchors(other), f"{page.name} links to {target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links to them."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_rows_of_a_table_are_as_wide_as_its_head(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        head, *rows = table.splitlines()
        for row in rows:
            assert len(re.findall(r"(?<!\\)\|", row)) == len(re.findall(r"(?<!\\)\|", head)), row
