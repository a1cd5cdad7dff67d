"""``[signals."qpos.*"]``: one table for all signals that a glob fits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from onlinebayes.problems import load_problem
from onlinebayes.problems.wiring_lines import composed
from onlinebayes.runs import BadInput
from tests.problems.conftest import PROBLEM

MODEL = """<mujoco><option timestep="0.005"/><worldbody>
  <body><joint name="rail" type="slide" axis="1 0 0" damping="1"/><geom size=".1" mass="1"/>
  <body><joint name="lift" axis="0 1 0" damping="1"/><geom size=".1" mass="1"/>
  <body pos=".2 0 0"><joint name="bend" axis="0 1 0" damping="1"/><geom size=".1" mass="1"/></body></body></body>
  </worldbody><actuator><motor name="a" joint="lift"/><motor name="b" joint="bend"/></actuator></mujoco>"""
HEAD = 'schema = 1\nmodel = "arm.xml"\nmeasurements = ["log.csv"]\nparameters = {}\n'


def load(folder: Path, text: str):
    time = np.arange(200) * 0.02
    columns = [time, *(np.sin((k + 1) * time) for k in range(3)), np.cos(time), np.sin(time)]
    rows = "\n".join(",".join(f"{cell:.6f}" for cell in row) for row in np.stack(columns, 1))
    (folder / "log.csv").write_text(f"time,qpos.rail,qpos.lift,qpos.bend,ctrl.a,ctrl.b\n{rows}\n")
    (folder / "arm.xml").write_text(MODEL)
    (folder / "arm.toml").write_text(HEAD + text)
    return load_problem(folder / "arm.toml").measurement


def ratios(folder: Path, text: str, key: str = "signal") -> list[float]:
    plain, changed = load(folder, "").data[key], load(folder, text).data[key]
    return (changed[0].abs().amax(0) / plain[0].abs().amax(0)).tolist()


def test_degrees_of_all_hinges_leave_a_slide_as_it_is(tmp_path: Path) -> None:
    """And a speed that was not measured is no column that is missing."""
    text = '[signals."qpos.*"]\nunit = "deg"\n[signals."qvel.*"]\nunit = "deg/s"\n'
    assert ratios(tmp_path, text) == pytest.approx([1.0, np.pi / 180, np.pi / 180])


def test_the_table_of_one_wins_key_by_key(tmp_path: Path) -> None:
    text = '[signals."qpos.*"]\nunit = "deg"\nsd = 0.1\n[signals."qpos.bend"]\nunit = "rad"\n'
    assert ratios(tmp_path, text) == pytest.approx([1.0, np.pi / 180, 1.0])
    assert [signal.sd for signal in load(tmp_path, text).signals] == [0.1, 0.1, 0.1]


def test_all_commands(tmp_path: Path) -> None:
    assert ratios(tmp_path, '[commands."*"]\nscale = 2\n[commands.b]\nscale = 3\n', "command") == pytest.approx([2, 3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[signals."qpos.x*"]\nunit = "deg"\n', r'signals."qpos.x\*": no name of the model is like it; the model has'),
        ('[signals."qpos.*"]\ncolumn = "x"\n', r'signals."qpos.\*".column: unknown key'),
        ('[signals."qpos.*"]\nunit = "degrees"\n', r"unit 'degrees' is unknown; nearest: deg"),
        ('[signals."qpos.*"]\nunit = "V"\n', r"'V' is no unit of qpos.\*"),
        ('[signals."qpos.lyft"]\nunit = "deg"\n', "unknown key; nearest: qpos.lift"),
    ],
)
def test_what_a_glob_may_not_say(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        load(tmp_path, text)


def test_the_line_that_mends_a_fault_goes_with_what_a_glob_says() -> None:
    content = {"signals": {"qpos.*": {"unit": "deg", "scale": 2.0}}}
    assert composed('[signals."qpos.hip"]\nscale = 3.0', content) == '[signals."qpos.hip"]\nscale = 6.0'


def test_a_glob_stands_for_nothing_in_the_names_of_sensors(folder: Path) -> None:
    (folder / "carriage.toml").write_text(PROBLEM + '[signals."*"]\nsd = 1e-4\n')
    assert [signal.sd for signal in load_problem(folder / "carriage.toml").measurement.signals] == [1e-4]
