"""Units that no name says: proposed where values fit but one, asked where they fit several, silent where SI fits."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onlinebayes.problems import load_problem
from onlinebayes.problems.drafting.first_draft import Draft, draft

TIME = np.arange(400) * 0.02
NARROW, NONE = 'range="-1.6 1.6"', ""


def arm(limits: str = NARROW, drive: str = "position", gripper: str = "", compiler: str = 'angle="radian"') -> str:
    """Two links and perhaps a gripper, whose range is ``gripper``."""
    gain = 'kp="20"' if drive == "position" else ""
    hand = (
        f'<body pos=".1 0 0"><joint name="gripper" {gripper}/><geom size=".02" mass=".05"/></body>' if gripper else ""
    )
    acts = "".join(f'<{drive} name="{name}" joint="{name}" {gain}/>' for name in ("lift", "bend"))
    acts += f'<{drive} name="gripper" joint="gripper" {gain}/>' if gripper else ""
    return f"""<mujoco><compiler {compiler}/><option timestep="0.002" integrator="implicitfast"/>
      <default><joint axis="0 1 0" damping="0.6" armature="0.03"/></default>
      <worldbody><body pos="0 0 1"><joint name="lift" {limits}/><geom size=".04" mass=".3"/>
      <body pos=".2 0 0"><joint name="bend" {limits}/><geom size=".04" mass=".2"/>{hand}</body></body></worldbody>
      <actuator>{acts}</actuator></mujoco>"""


def swing(amplitude: float, phase: float = 0.0, rate: float = 3.0) -> np.ndarray:
    return amplitude * np.sin(rate * TIME + phase)


def drafted(folder: Path, model: str, columns: Mapping[str, np.ndarray]) -> Draft:
    (folder / "arm.xml").write_text(model)
    rows = np.stack([TIME, *columns.values()], 1)
    text = "\n".join(",".join(f"{cell:.6f}" for cell in row) for row in rows)
    (folder / "log.csv").write_text(f"{','.join(['time', *columns])}\n{text}\n")
    made = draft(folder / "arm.xml", [folder / "log.csv"], folder / "arm.toml")
    (folder / "arm.toml").write_text(made.text)
    return made


def moved(position: float, command: float | None = None) -> dict[str, np.ndarray]:
    told = position if command is None else command
    return {
        "qpos.lift": swing(position),
        "qpos.bend": swing(0.8 * position, 1.0),
        "ctrl.lift": swing(told, 0.1),
        "ctrl.bend": swing(0.8 * told, 1.1),
    }


@pytest.mark.parametrize("limits", [NARROW, NONE])
def test_a_log_in_degrees_is_read_so_all_at_once(tmp_path: Path, limits: str) -> None:
    drafted(tmp_path, arm(limits), moved(60.0))
    content: dict[str, Any] = tomllib.loads((tmp_path / "arm.toml").read_text())
    assert content["signals"] == {"qpos.*": {"unit": "deg"}}
    assert content["commands"] == {"*": {"unit": "deg"}}
    data = load_problem(tmp_path / "arm.toml").measurement.data
    assert float(data["signal"].abs().max()) == pytest.approx(math.radians(60.0), rel=1e-2)
    assert float(data["command"].abs().max()) == pytest.approx(math.radians(60.0), rel=1e-2)


def test_positions_in_degrees_beside_commands_in_radians(tmp_path: Path) -> None:
    drafted(tmp_path, arm(), moved(60.0, 1.0))
    content = tomllib.loads((tmp_path / "arm.toml").read_text())
    assert content["signals"] == {"qpos.*": {"unit": "deg"}}
    assert "commands" not in content


@pytest.mark.parametrize(
    ("model", "columns"),
    [
        (arm(), moved(1.5)),
        (arm(), moved(1.9)),  # a little over a limit that gives
        (arm(NONE), moved(4.0)),  # more than a turn, as a servo may
        (arm(NONE, "motor"), {**moved(1.0), "qpos.lift": 40 * TIME}),  # a wheel
    ],
)
def test_what_can_be_si_is_taken_so(tmp_path: Path, model: str, columns: dict[str, np.ndarray]) -> None:
    made = drafted(tmp_path, model, columns)
    assert made.questions == ()
    assert all(one.exact for one in made.matches)


def test_a_fast_joint_without_a_range_is_a_question(tmp_path: Path) -> None:
    made = drafted(tmp_path, arm(NONE, "motor"), moved(90.0, 1.0))
    (asked,) = made.questions
    assert "if these are degrees, write unit" in asked
    assert f"# CHECK: {asked}" in made.text


def percent() -> np.ndarray:
    return 50 + swing(45.0)


def test_a_gripper_in_percent_of_its_range(tmp_path: Path) -> None:
    hand = {"qpos.gripper": percent(), "ctrl.gripper": percent()}
    drafted(tmp_path, arm(gripper='range="-0.1 0.7"'), moved(1.0) | hand)
    content = tomllib.loads((tmp_path / "arm.toml").read_text())
    assert content["signals"] == {"qpos.gripper": {"scale": 0.008, "offset": -0.1}}
    assert content["commands"] == {"gripper": {"scale": 0.008, "offset": -0.1}}
    data = load_problem(tmp_path / "arm.toml").measurement.data["signal"]
    assert float(data[..., 2].max()) == pytest.approx(-0.1 + 0.8 * 0.95, abs=1e-2)


def test_a_gripper_in_percent_beside_joints_in_degrees(tmp_path: Path) -> None:
    """Which of the two a gripper of -10 to 100 degrees has nobody can see; LeRobot writes percent."""
    model, hand = arm(gripper='range="-0.17 1.75"'), {"qpos.gripper": percent(), "ctrl.gripper": percent()}
    made = drafted(tmp_path, model, moved(60.0) | hand)
    assert [asked.split(" has")[0] for asked in made.questions] == ["qpos.gripper", "ctrl.gripper"]
    assert all("deg, or percent?" in asked for asked in made.questions)
    own = {"qpos": "observation.state[{}.pos]", "ctrl": "action[{}.pos]"}
    columns = {own[key[:4]].format(key[5:]): value for key, value in (moved(60.0) | hand).items()}
    drafted(tmp_path, model, columns)
    content = tomllib.loads((tmp_path / "arm.toml").read_text())
    assert content["signals"]["qpos.lift"] == {"column": "observation.state[lift.pos]", "unit": "deg"}
    assert content["signals"]["qpos.gripper"]["scale"] == pytest.approx(0.0192)


def test_counts_of_an_encoder_are_asked(tmp_path: Path) -> None:
    columns = {name: np.round(2048 + 600 * cells) for name, cells in moved(1.0).items()}
    made = drafted(tmp_path, arm(), columns)
    assert len(made.questions) == 4
    assert "counts of an encoder? write scale = 2 pi / counts of a turn (0.00153398 of 4096)" in made.questions[0]
    assert not any(one.keys for one in made.matches)


def test_millimetres_of_a_slide_that_has_a_range(tmp_path: Path) -> None:
    model = """<mujoco><worldbody><body><joint name="lift" type="slide" axis="1 0 0" range="0 .4" limited="true"/>
      <geom size=".1"/></body></worldbody><actuator><motor name="lift" joint="lift"/></actuator></mujoco>"""
    made = drafted(tmp_path, model, {"qpos.lift": 200 + swing(150.0), "ctrl.lift": swing(3.0)})
    assert {one.name: one.unit for one in made.matches if one.unit} == {"qpos.lift": "mm"}


def test_radians_in_a_model_that_does_not_say_so(tmp_path: Path) -> None:
    """1.6 is read as degrees there: joints of a fortieth of a radian, which the log leaves."""
    made = drafted(tmp_path, arm(compiler=""), moved(1.4))
    (asked,) = made.questions
    assert 'its file seems to have radians; add <compiler angle="radian"/> to it' in asked
    assert not any(one.keys for one in made.matches)


def test_speeds_in_degrees_show_by_the_change_of_the_positions(tmp_path: Path) -> None:
    speeds = {"qvel.lift": swing(180.0, math.pi / 2), "qvel.bend": swing(144.0, 1.0 + math.pi / 2)}
    made = drafted(tmp_path, arm(), moved(60.0) | speeds)
    content = tomllib.loads(made.text)
    assert content["signals"] == {"qpos.*": {"unit": "deg"}, "qvel.*": {"unit": "deg/s"}}
    radians = {name: np.radians(cells) for name, cells in speeds.items()}
    content = tomllib.loads(drafted(tmp_path, arm(), moved(60.0) | radians).text)
    assert content["signals"] == {"qpos.*": {"unit": "deg"}}


def test_topics_of_other_rates_on_clocks_of_two_columns_show_degrees_together(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm())
    degrees = {name: np.degrees(cells) for name, cells in moved(0.9).items()}
    logs = {"states": ("qpos", np.arange(400)), "orders": ("ctrl", np.arange(0, 400, 3))}
    for log, (kind, rows) in logs.items():
        own = {name.replace(".", "_"): cells for name, cells in degrees.items() if name.startswith(kind)}
        lines = [
            ",".join([f"{50 + k // 50}", f"{k % 50 * 20_000_000}", *(f"{cells[k]:.4f}" for cells in own.values())])
            for k in rows
        ]
        (tmp_path / f"{log}.csv").write_text("\n".join([",".join(["sec", "nanosec", *own]), *lines]) + "\n")
    made = draft(tmp_path / "arm.xml", [tmp_path / f"{log}.csv" for log in logs], tmp_path / "arm.toml")
    (tmp_path / "arm.toml").write_text(made.text)
    file = tomllib.loads(made.text)
    assert file["time"] == {"column": "sec", "unit": "s", "rest": "nanosec"}
    assert file["signals"]["qpos.*"] == {"unit": "deg"}
    assert file["commands"]["*"] == {"unit": "deg"}
    measured = load_problem(tmp_path / "arm.toml").measurement
    assert measured.runs == ("states+orders",)
    assert float(measured.data["signal"].nan_to_num().abs().max()) == pytest.approx(0.9, abs=0.01)
