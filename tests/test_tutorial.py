"""The tutorial is followed as a reader would: its files are written, its commands run, what it shows is printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from decimal import Decimal
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def blocks(page: str) -> list[tuple[str, str]]:
    """(language, text) of every code block, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", page, flags=re.DOTALL | re.MULTILINE)


def run(command: str, folder: Path) -> str:
    """What a shell prints that finds this Python and this checkout first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-ec", command],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80"},
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stderr}"
    return done.stdout


def words(line: str) -> str:
    return " ".join(NUMBER.sub("#", line).split())


def near(number: str) -> object:
    """Within a fifth of what is shown, or 1.5 units of its last digit (0.02 at most) where that is more."""
    unit = 10.0 ** int(Decimal(number).as_tuple().exponent)
    return pytest.approx(float(number), rel=0.2, abs=min(0.02, 1.5 * unit))


def shown_in(shown: str, printed: str) -> None:
    """Every line of ``shown`` but "..." stands in ``printed``, in this order, with about the same numbers."""
    rest = printed.splitlines()
    for line in (line for line in shown.splitlines() if line.strip() not in ("", "...")):
        found = next((k for k, other in enumerate(rest) if words(other) == words(line)), None)
        assert found is not None, f"nothing printed reads like: {line}\n{printed}"
        numbers = [float(number) for number in NUMBER.findall(rest[found])]
        assert numbers == [near(number) for number in NUMBER.findall(line)], f"{rest[found]}\nis shown as\n{line}"
        rest = rest[found + 1 :]


def test_a_line_that_is_not_printed_is_noticed() -> None:
    shown_in("error 10 mrad\n...\nend", "start\nerror 10.4 mrad\nmore\nend")
    for wrong in ("error 20 mrad", "terror 10 mrad", "end\nstart"):
        with pytest.raises(AssertionError):
            shown_in(wrong, "start\nerror 10.4 mrad\nmore\nend")
    shown_in("drag 0.0203, p 0.002", "drag 0.0211, p 0.003")
    for wrong in ("drag 0.0155, p 0.002", "drag 0.0203, p 0.006", "drag 0.0203"):
        with pytest.raises(AssertionError):
            shown_in(wrong, "drag 0.0211, p 0.002")


def test_the_tutorial_has_what_its_test_runs() -> None:
    languages = [language for language, _ in blocks((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))]
    assert languages.count("bash") >= 7
    assert languages.count("text") >= 5


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_tutorial_can_be_followed(tmp_path: Path) -> None:
    printed = ""
    for language, text in blocks((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")):
        if language == "bash":
            printed = run(text, tmp_path)
        elif language == "text":
            shown_in(text, printed)
        elif language in ("python", "toml"):
            name = text.splitlines()[0].removeprefix("# ")
            (tmp_path / name).write_text(text, encoding="utf-8")
