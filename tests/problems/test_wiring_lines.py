"""The line that a report prints for a wiring fault, put into the problem file, makes the verdict what it should be."""

from __future__ import annotations

from pathlib import Path

import pytest

from onlinebayes.criticism import Criticism
from onlinebayes.criticism.wiring.faults import AsItStands, Fault, Rescaled
from onlinebayes.measurements import Measurement
from onlinebayes.problems import criticise, load_problem
from tests.criticism.wired import NOISE, PENDULUM

PROBLEM = f"""
schema = 1
model = "pendulum.xml"
measurements = ["pendulum.csv"]
holdout = ["run8", "run9"]

[parameters]
"body.rod.mass" = [0.3, 3.0]
"joint.hinge.damping" = [0.0, 0.5]

[selection]
horizon_s = 0.7

[effects]
candidates = ["dry_friction@hinge", "actuator_gain@motor"]

[signals."qpos.hinge"]
sd = {NOISE}
"""
FAULTS: dict[str, tuple[Fault, bool, str]] = {
    "sign": (Rescaled("signal", ("qpos.hinge",), -1.0, ""), False, '[signals."qpos.hinge"]\nsign = -1'),
    "millivolts": (Rescaled("command", ("motor",), 1e3, ""), False, "[commands.motor]\nscale = 0.001"),
    "gravity": (AsItStands(), True, "[actuators.motor]\ngravity_compensation = true"),
}


def table(measurement: Measurement) -> str:
    """The measurement as CSV."""
    lines = ["run,time,ctrl.motor,qpos.hinge"]
    for r, run in enumerate(measurement.runs):
        columns = (measurement.data[key][r].reshape(-1).tolist() for key in ("time", "command", "signal"))
        lines += [f"{run},{t:.17g},{u:.17g},{q:.17g}" for t, u, q in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def refined(folder: Path, text: str) -> Criticism:
    (folder / "pendulum.toml").write_text(text)
    return criticise("refine", load_problem(folder / "pendulum.toml"))


def with_line(text: str, line: str) -> str:
    """The line put under its header, where the file has that already, else at the end."""
    header, value = line.split("\n")
    return text.replace(header, line) if header in text else f"{text}\n{header}\n{value}\n"


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "sign" else pytest.mark.long) for n in FAULTS]
)
def test_the_printed_line_puts_it_right(tmp_path: Path, name: str) -> None:
    fault, compensated, line = FAULTS[name]
    measurement = fault.correct(PENDULUM.measure(compensated=compensated, runs=10, seconds=1.5))
    (tmp_path / "pendulum.xml").write_text(PENDULUM.xml)
    (tmp_path / "pendulum.csv").write_text(table(measurement))
    found = refined(tmp_path, PROBLEM)
    assert found.verdict == "data_problem"
    assert found.accepted == ()
    assert found.wiring is not None
    assert found.wiring.lines == line
    assert not any("ends on its bound" in note for note in found.notes)  # of a table that is at fault
    assert found.corrected is not None
    for address, true in zip(found.corrected.parameters, PENDULUM.truth, strict=True):
        assert found.corrected.parameters[address].mean == pytest.approx(true, rel=0.1)
    mended = refined(tmp_path, with_line(PROBLEM, line))
    assert mended.verdict == "adequate"
    assert mended.wiring is None
