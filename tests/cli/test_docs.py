"""The examples of the documentation are true: the problem file loads, the Python runs."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import pytest

from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.addresses import resolve
from onlinebayes.simulators.mujoco.fields import FIELDS

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


def test_the_fields_that_may_be_parameters_are_all_listed():
    """The table is what an address may name; each kind's row has its fields with the indices that they take."""
    page = (DOCS / "problem-files.md").read_text(encoding="utf-8")
    chapter = page.partition("### Fields that may be parameters\n")[2].partition("\n###")[0]
    listed = {kind: re.findall(r"`(.+?)`", row) for kind, row in re.findall(r"^\| (\w+) \| (`.*) \|$", chapter, re.M)}
    known = {
        kind: [name if len(columns) == 1 else f"{name}[0..{len(columns) - 1}]" for name, columns in fields.items()]
        for kind, fields in FIELDS.items()
    }
    known["actuator"] += ["kp", "kv"]
    assert listed == known


@pytest.mark.parametrize("field", ["solreflimit", "solimplimit", "solreffriction", "solimpfriction"])
def test_mjcfs_own_spelling_finds_the_field(field):
    body = '<body><joint name="j"/><geom size="1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    near = f"nearest: 'joint.j.{field[:6]}_{field[6:]}'"
    with pytest.raises(BadInput, match=near):
        resolve(model, f"joint.j.{field}[0]")


def test_the_arrays_example_runs():
    (code,) = (text for language, text in blocks("concepts/measurements.md") if language == "python")
    names: dict[str, object] = {}
    exec(compile(code, "measurements.md", "exec"), names)
    assert names["measurement"].runs == ("sine",)
