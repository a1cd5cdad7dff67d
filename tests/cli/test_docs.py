"""The examples of the documentation are true: the problem file loads, the Python runs."""

from __future__ import annotations

import re
from pathlib import Path

from onlinebayes.cli.problem import load_problem

DOCS = Path(__file__).parents[2] / "docs"


def blocks(page: str) -> list[tuple[str, str]]:
    """(language, text) of every code block of a page."""
    return re.findall(r"```(\w*)\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_complete_example_of_a_problem_file_loads(tmp_path):
    (_, model), (_, table), (_, problem), *_ = blocks("problem-files.md")
    for name, text in (("carriage.xml", model), ("carriage.csv", table), ("carriage.toml", problem)):
        (tmp_path / name).write_text(text)
    loaded = load_problem(tmp_path / "carriage.toml")
    assert loaded.measurement.runs == ("plain", "pulses")
    assert loaded.holdout == ("pulses",)
    assert loaded.measurement.signals[0].sd == 1e-5


def test_the_arrays_example_runs():
    (code,) = (text for language, text in blocks("concepts/measurements.md") if language == "python")
    names: dict[str, object] = {}
    exec(compile(code, "measurements.md", "exec"), names)
    assert names["measurement"].runs == ("sine",)
