"""The page in a real browser: fits narrow and wide screens, is silent on the console, is readable by day and by night.

Each page is put into frames of the widths to try, in one document that measures them and writes what it found into
itself; the browser prints that document. Skipped where there is no Chromium.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from onlinebayes.report.html import to_html
from tests.report.many import many
from tests.report.synthetic import criticism

WIDTHS = (1280, 390)
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no chromium or google-chrome on PATH")
MEASURE = """
onload = () => {
  const found = [...document.querySelectorAll("iframe")].map(frame => {
    const page = frame.contentDocument, root = page.documentElement, wide = frame.clientWidth;
    const scrolled = e => e.closest(".scroll, pre") !== null;
    return {
      width: wide, content: root.scrollWidth,
      out: [...page.body.querySelectorAll("*")].filter(e => !scrolled(e) && !e.closest(".skip, caption") &&
        e.getBoundingClientRect().right > wide + 1).map(e => e.tagName + "." + e.getAttribute("class")),
      headings: [...page.querySelectorAll("h1, h2, h3, h4")].map(e => +e.tagName[1]),
      tables: [...page.querySelectorAll("table")].map(t =>
        [!!t.caption, t.querySelectorAll("thead th[scope=col]").length]),
      pictures: [...page.querySelectorAll("svg")].map(e => e.getAttribute("aria-label") || ""),
      links: [...page.querySelectorAll("a")].map(a => !!page.querySelector(a.getAttribute("href"))),
      ids: [...page.querySelectorAll("[id]")].map(e => e.id),
    };
  });
  document.getElementById("found").textContent = JSON.stringify(found);
}
"""


@dataclass(frozen=True)
class Seen:
    """What the browser measured of a page, by width, and what it wrote on its console."""

    frames: list[dict[str, Any]]
    console: list[str]


def look(page: str, folder: Path) -> Seen:
    """Load the page in frames of all widths."""
    assert BROWSER is not None
    inner = html.escape(page, quote=True)
    frames = "".join(f'<iframe width="{w}" height="900" srcdoc="{inner}" style="border:0"></iframe>' for w in WIDTHS)
    outer = folder / "frames.html"
    outer.write_text(
        f'<!doctype html><meta charset="utf-8"><script>{MEASURE}</script><pre id="found"></pre>{frames}',
        encoding="utf-8",
    )
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}",
        "--enable-logging=stderr", "--virtual-time-budget=2000", "--window-size=1400,1000", "--dump-dom",
        outer.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    assert found[1], "the page did not finish loading"
    return Seen(json.loads(html.unescape(found[1])), [line for line in done.stderr.splitlines() if "CONSOLE" in line])


@pytest.fixture(scope="module", params=["drive", "arm"])
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    result = criticism() if request.param == "drive" else many()
    return look(to_html(result, title="a problem", refined=("refined.toml",)), tmp_path_factory.mktemp("page"))


@needs_browser
def test_nothing_reaches_over_the_edge(seen: Seen) -> None:
    assert [frame["width"] for frame in seen.frames] == list(WIDTHS)
    for frame in seen.frames:
        assert frame["content"] <= frame["width"], frame["out"][:5]
        assert frame["out"] == []


@needs_browser
def test_the_console_is_silent(seen: Seen) -> None:
    assert seen.console == []


@needs_browser
def test_headings_tables_and_pictures_have_their_words(seen: Seen) -> None:
    frame = seen.frames[0]
    levels = frame["headings"]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert levels.count(2) == 6
    assert len(frame["tables"]) >= 6
    assert all(caption and heads >= 2 for caption, heads in frame["tables"])
    assert len(frame["pictures"]) >= 8
    assert all(len(label) > 20 for label in frame["pictures"])
    assert frame["links"]
    assert all(frame["links"])
    assert len(set(frame["ids"])) == len(frame["ids"])


@needs_browser
def test_a_page_that_reaches_over_the_edge_is_caught(tmp_path: Path) -> None:
    bad = "<!doctype html><body><div style='width:700px'>wide</div><script>console.error('no')</script></body>"
    found = look(bad, tmp_path)
    assert found.frames[1]["content"] > found.frames[1]["width"]
    assert found.frames[1]["out"]
    assert found.console


TEXT = [("ink", "paper"), ("soft", "paper"), ("soft", "wash"), ("ink", "wash"), ("after", "paper")]
BADGES = [("paper", "soft"), ("paper", "before"), ("paper", "gain")]


@pytest.mark.parametrize("scheme", ["light", "dark", "print"])
def test_text_stands_out_from_its_ground(scheme: str) -> None:
    style = files("onlinebayes.report").joinpath("style.css").read_text(encoding="utf-8")
    parts = {
        "light": style,
        "dark": style.split("prefers-color-scheme: dark")[1],
        "print": style.split("@media print")[1],
    }
    colours = dict(reversed(re.findall(r"--(\w+): (#[0-9a-f]{3,6})", parts[scheme])))
    for text, ground in TEXT + BADGES:
        assert contrast(colours[text], colours[ground]) >= 4.5, f"{scheme}: {text} on {ground}"


def contrast(one: str, other: str) -> float:
    """The ratio of WCAG 2.2, 1 to 21."""
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_contrast_is_wcags() -> None:
    assert contrast("#000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


def test_many_joints_and_candidates_stay_small_and_folded() -> None:
    page = to_html(many())
    assert len(page) < 1_500_000
    shown = re.sub(r"<details>.*?</details>", "", page, flags=re.DOTALL)
    assert "6 more signals" in page
    assert "138 more candidates" in page
    assert len(shown) < 250_000
    assert shown.count("<tr") < 80
