"""The parts of a problem file that change the model or say what differs between runs, from the file to the result."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from onlinebayes.cli.main import main
from onlinebayes.criticism import Scope
from onlinebayes.measurements.latency import advanced
from onlinebayes.parameters import Parameter
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.problems.conftest import MODEL, PROBLEM

HAND = """
<mujoco><option timestep="0.005"/><worldbody><body name="base"><freejoint/><geom size=".1"/>
  <body name="finger1" pos=".1 0 0"><joint name="finger1" axis="0 1 0" damping=".3"/><geom size=".1"/>
    <body name="tip1" pos=".1 0 0"><joint name="tip1" axis="0 1 0" damping=".1"/><geom size=".1"/></body></body>
  <body name="finger2" pos="-.1 0 0"><joint name="finger2" axis="0 1 0" damping=".4"/><geom size=".1"/></body>
</body></worldbody><actuator>
  <motor name="one" joint="finger1"/><position name="tip" joint="tip1" kp="5"/>
  <velocity name="two" joint="finger2" kv="2"/>
</actuator></mujoco>"""

HAND_PROBLEM = """
model = "hand.xml"
measurements = ["hand.csv"]
[model_edit]
weld = ["base"]
[parameters]
"""


def write(folder: Path, text: str, name: str = "carriage.toml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def table(masses: dict[str, float], seconds: float = 2.0) -> str:
    """A run for each mass m [kg] of m v' = 2 u - 2 v at 100 Hz, u a sine, with a little noise of the sensor."""
    rows, draw = ["run,time,ctrl.motor,qpos.carriage"], np.random.default_rng(0)
    for k, (run, mass) in enumerate(masses.items()):
        q = v = 0.0
        for i in range(round(seconds * 100) + 1):
            u = 4 * math.sin((4 + 0.3 * k) * i * 0.01 + k)
            rows.append(f"{run},{i * 0.01:.2f},{u:.6f},{q + 1e-5 * draw.standard_normal():.7f}")
            kept = math.exp(-2 * 0.01 / mass)  # exact while u is held
            q += u * 0.01 + (v - u) * mass / 2 * (1 - kept)
            v = u + (v - u) * kept
    return "\n".join(rows) + "\n"


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    """Two fingers on a floating base, and a short table of them."""
    (tmp_path / "hand.xml").write_text(HAND)
    rows = ["time,ctrl.one,ctrl.tip,ctrl.two,qpos.finger1,qpos.tip1,qpos.finger2"]
    rows += [f"{0.01 * k:.2f},0,0,0,{0.1 * k},{0.1 * k},{0.1 * k}" for k in range(300)]
    (tmp_path / "hand.csv").write_text("\n".join(rows) + "\n")
    return tmp_path


@pytest.mark.long
def test_masses_of_the_runs_from_a_file(folder, capsys):
    """Two runs' masses are recovered, a third run's is known, a held-out one's comes from its own halves."""
    masses = {"light": 2.0, "heavy": 4.0, "weighed": 3.0, "another": 2.5}
    (folder / "carriage.csv").write_text(table(masses, seconds=4.0))
    text = PROBLEM.replace('["second"]', '["another"]').replace(
        "[1.0, 10.0]", '{ low = 1.0, high = 10.0, scope = "per_run" }'
    )
    path = write(folder, text + '[runs."weig*"]\n"body.carriage.mass" = 3.0\n')
    assert load_problem(path).scope == Scope(("body.carriage.mass",), {"weig*": {"body.carriage.mass": 3.0}})
    assert main(["refine", str(path), "--out", str(folder / "out")]) == 0, capsys.readouterr().err
    report = json.loads((folder / "out" / "report.json").read_text())
    assert list(report["parameters"]) == [
        "body.carriage.mass[run light]",
        "body.carriage.mass[run heavy]",
        "joint.carriage.damping",
    ]
    for run in ("light", "heavy"):
        assert report["parameters"][f"body.carriage.mass[run {run}]"]["mean"] == pytest.approx(masses[run], rel=5e-3)
    error = report["heldout_error"]
    assert error["after"]["qpos.carriage"] < 2 * error["noise_floor"]["qpos.carriage"]
    refined = (folder / "out" / "refined.toml").read_text()
    assert "run light" in refined
    assert tomllib.loads(refined)["runs"] == {"weig*": {"body.carriage.mass": 3.0}}
    mass = mujoco.MjModel.from_xml_path(str(folder / "out" / "refined.xml")).body("carriage").mass[0]
    assert mass == pytest.approx(3.0, rel=1e-2)  # the mean of light and heavy
    assert load_problem(folder / "out" / "refined.toml").scope is not None


def test_constants_of_runs_join_the_simulator_but_are_not_fitted(folder):
    text = PROBLEM.replace('"joint.carriage.damping" = [0.0, 20.0]', "")
    path = write(folder, text + '[runs.first]\n"joint.carriage.damping" = 5.0\n')
    problem = load_problem(path)
    assert problem.simulator.parameters.names == ("body.carriage.mass", "joint.carriage.damping")
    assert problem.scope == Scope((), {"first": {"joint.carriage.damping": 5.0}}, unfitted=("joint.carriage.damping",))


def test_the_scope_of_an_effect(folder):
    path = write(folder, PROBLEM + '[effects.scope]\n"dry_friction@carriage" = "per_run"\n')
    assert load_problem(path).scope == Scope(("dry_friction@carriage",))
    assert load_problem(write(folder, PROBLEM)).scope is None


def test_a_glob_is_one_parameter_an_element_or_one_tied_value(hand):
    simulator = load_problem(write(hand, HAND_PROBLEM + '"joint.finger*.damping" = [0.0, 2.0]\n')).simulator
    assert dict(simulator.parameters) == {f"joint.finger{k}.damping": Parameter(0.0, 2.0, "N m s/rad") for k in (1, 2)}
    text = HAND_PROBLEM + '"joint.finger*.damping" = { low = 0.0, high = 2.0, tie = true, scope = "per_run" }\n'
    problem = load_problem(write(hand, text))
    tied = problem.simulator
    assert isinstance(tied, MujocoSimulator)
    assert tied.parameters.names == ("joint.finger*.damping",)
    assert tied.nominal.tolist() == [0.3]
    damping = tied.fields(np.array([[1.5]]))["dof_damping"][0]
    assert damping.tolist() == [1.5, 0.1, 1.5]
    exported = tied.export(torch.tensor([1.5], dtype=torch.float64)).compile()
    assert exported.dof_damping.tolist() == [1.5, 0.1, 1.5]
    assert problem.scope == Scope(("joint.finger*.damping",))


def test_what_is_written_out_wins_over_a_glob(hand):
    text = HAND_PROBLEM + '"joint.finger*.damping" = [0.0, 2.0]\n"joint.finger1.damping" = [0.0, 1.0]\n'
    space = load_problem(write(hand, text)).simulator.parameters
    assert {name: p.high for name, p in space.items()} == {"joint.finger2.damping": 2.0, "joint.finger1.damping": 1.0}


def test_the_model_is_edited(hand):
    more = "timestep = 0.002\nintegrator = 'implicitfast'\n[parameters]\n"
    text = HAND_PROBLEM.replace("[parameters]\n", more) + '"joint.tip1.damping" = [0.0, 2.0]\n'
    simulator = load_problem(write(hand, text)).simulator
    assert isinstance(simulator, MujocoSimulator)
    assert simulator.model.nq == 3
    assert simulator.timestep == 0.002
    assert simulator.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        ({"one": "force", "tip": "position", "two": "velocity"}, None),
        ({"one": "voltage"}, None),
        ({"tip": "force"}, "takes a position, not a force; make it a <motor>"),
        ({"two": "position"}, "takes a velocity, not a position; make it a <position> with its kp"),
        ({"one": "velocity"}, "takes a force or voltage, not a velocity"),
    ],
)
def test_what_a_command_is(hand, actuators, message):
    inputs = "".join(f'[actuators.{name}]\ninput = "{kind}"\n' for name, kind in actuators.items())
    path = write(hand, HAND_PROBLEM + '"joint.tip1.damping" = [0.0, 2.0]\n' + inputs)
    if message is None:
        load_problem(path)
    else:
        with pytest.raises(BadInput, match=message):
            load_problem(path)


@pytest.mark.parametrize(
    ("compensated", "gravcomp"),
    [(("one", "tip"), [0, 0, 1, 1, 0]), (("two",), [0, 0, 0, 0, 1]), (("one",), None), (("tip",), None)],
)
def test_a_drive_that_carries_the_weight(hand, compensated, gravcomp):
    switches = "".join(f"[actuators.{name}]\ngravity_compensation = true\n" for name in compensated)
    path = write(hand, HAND_PROBLEM + '"joint.tip1.damping" = [0.0, 2.0]\n' + switches)
    if gravcomp is None:
        with pytest.raises(BadInput, match="moves body 'tip1' too and is not compensated"):
            load_problem(path)
    else:
        simulator = load_problem(path).simulator
        assert isinstance(simulator, MujocoSimulator)
        assert simulator.model.body_gravcomp.tolist() == gravcomp


@pytest.mark.parametrize("latency", [0.03, 0.0137, -0.02])
def test_a_late_column_is_moved_back(latency):
    time = np.arange(0.0, 2.0, 0.01)
    late = np.sin(3 * (time - latency))
    found = advanced(time, late, latency)
    known = ~np.isnan(found)
    assert np.abs(found - np.sin(3 * time))[known].max() < 2e-4
    assert (~known).sum() == pytest.approx(abs(latency) / 0.01, abs=1)
    assert advanced(time, late, 0.0) is late


def test_latency_of_a_column_sampled_now_and_then():
    time = np.arange(0.0, 2.0, 0.01)
    late = np.where(np.arange(200) % 5 == 0, np.sin(3 * (time - 0.03)), np.nan)
    found = advanced(time, late, 0.03)
    assert (~np.isnan(found)).sum() == 39
    assert np.nanmax(np.abs(found - np.sin(3 * time))) < 1e-6


def test_a_latency_of_half_a_row_on_a_clock_that_jitters():
    time = np.arange(0, 10, 0.1) + np.random.default_rng(0).uniform(-0.01, 0.01, 100)
    late = np.sin(time - 0.05)
    late[60] = np.nan
    found = advanced(time, late, 0.05)
    lost = np.flatnonzero(np.isnan(found))
    assert set(lost) <= {59, 60, 99}  # beside the cell that is missing, and the run's end
    known = np.setdiff1d(np.arange(100), lost)
    np.testing.assert_allclose(found[known], np.sin(time[known]), atol=3e-3)


def test_latency_in_a_file(folder):
    path = write(folder, PROBLEM + '[signals."qpos.carriage"]\nlatency = 0.05\n')
    plain = load_problem(write(folder, PROBLEM, "plain.toml")).measurement.data
    moved = load_problem(path).measurement.data
    assert torch.allclose(moved["signal"][:, :-5], plain["signal"][:, 5:], atol=1e-12)
    assert not bool(moved["measured"][:, -5:].any())


@pytest.mark.long
def test_a_sensor_and_a_torque_are_compared(folder, capsys):
    """Their columns become signals with a replay of their own; ``ignore`` leaves them out."""
    sensor = '<sensor><jointvel name="rate" joint="carriage"/></sensor></mujoco>'
    (folder / "carriage.xml").write_text(MODEL.replace("</mujoco>", sensor))
    head, *rows = (folder / "carriage.csv").read_text().splitlines()
    torques = [2 * float(row.split(",")[2]) for row in rows]  # of the command held until the row
    rows = [f"{row},{torque},nan" for row, torque in zip(rows, [0.0, *torques], strict=False)]
    (folder / "carriage.csv").write_text("\n".join([f"{head},qfrc.carriage,sensor.rate", *rows]))
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 0, capsys.readouterr().err
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["signals"]["qfrc.carriage"]["unit"] == "N"
    assert report["heldout_error"]["after"]["qfrc.carriage"] < 1e-3
    ignoring = load_problem(write(folder, 'ignore = ["qfrc.*", "sensor.*"]\n' + PROBLEM))
    assert ignoring.simulator.signals == ("qpos.carriage", "qvel.carriage")


def test_a_model_that_names_nothing_is_refused(folder):
    """MuJoCo leaves such an element out of a copy of the spec, which then compiles."""
    model = folder / "carriage.xml"
    model.write_text(model.read_text().replace('joint="carriage"', 'joint="cariage"'))
    with pytest.raises(BadInput, match="cariage"):
        load_problem(folder / "carriage.toml")


def test_a_mass_is_never_negative(folder):
    write(folder, PROBLEM.replace("[1.0, 10.0]", "[-1.0, 10.0]"))
    with pytest.raises(BadInput, match=r"address 'body.carriage.mass': a mass of -1 kg cannot be; give a lower bound"):
        load_problem(folder / "carriage.toml")


def test_an_error_is_one_line(folder, capsys):
    """What was kept out of a table is said only where the work begins."""
    text = (folder / "carriage.csv").read_text().replace("ctrl.motor", "comand", 1)
    (folder / "carriage.csv").write_text(text)
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no column 'ctrl.motor'" in line


def pushed(folder, column: str = "xfrc.carriage.0") -> None:
    """The drive's force measured at the carriage (2 N a command) in place of the command, and no drive."""
    model = folder / "carriage.xml"
    model.write_text(model.read_text().replace('<motor name="motor" joint="carriage" gear="2"/>', ""))
    _, *rows = (folder / "carriage.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    rows = [f"{run},{time},{2 * float(u)},{q}" for run, time, u, q in cells]
    rows[0] = rows[0].replace(cells[0][2], "", 1) if float(cells[0][2]) else rows[0]
    (folder / "carriage.csv").write_text("\n".join([f"run,time,{column},qpos.carriage", *rows]) + "\n")


def test_a_wrench_from_outside_moves_the_model(folder, capsys):
    pushed(folder)
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 0, capsys.readouterr().err
    report = json.loads((folder / "out" / "report.json").read_text())
    # Euler's steps of 5 ms wrote the table: at those the push explains it to the table's last digit.
    assert report["remainder"]["rms_over_floor"]["qpos.carriage"] < 1.2
    assert report["parameters"]["body.carriage.mass"]["mean"] == pytest.approx(3.0, rel=0.005)
    problem = load_problem(folder / "carriage.toml")
    assert problem.simulator.commands == ("xfrc.carriage.0",)
    assert problem.simulator.targets("actuator") == ()  # no law of an actuator acts on what was measured
    assert (
        main(["init", str(folder / "carriage.xml"), str(folder / "carriage.csv"), "--out", str(folder / "p.toml")]) == 0
    )
    assert load_problem(folder / "p.toml").simulator.commands == ("xfrc.carriage.0",)


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("xfrc.cariage.0", "no body 'cariage' that moves; nearest: carriage"),
        ("xfrc.carriage.6", "is no part of a wrench; write xfrc.<body>.0 to .5"),
    ],
)
def test_a_wrench_on_nothing_is_refused(folder, column, said):
    pushed(folder, column)
    with pytest.raises(BadInput, match=said):
        load_problem(folder / "carriage.toml")


def test_a_table_without_the_wrench_was_not_pushed(folder):
    pushed(folder)
    rows = [f"free,{0.01 * k},{0.1 + 0.02 * k}" for k in range(20)]
    (folder / "free.csv").write_text("\n".join(["run,time,qpos.carriage", *rows]))
    write(folder, PROBLEM.replace('["carriage.csv"]', '["carriage.csv", "free.csv"]'))
    measured = load_problem(folder / "carriage.toml").measurement
    assert not bool(measured.data["command"][measured.runs.index("free")].any())


def test_two_parameters_may_not_be_the_same_value():
    from onlinebayes.parameters import ParameterSpace

    space = ParameterSpace({"body.carriage.mass": Parameter(1, 2), "body.c*.mass": Parameter(1, 2)})
    with pytest.raises(BadInput, match=r"'body.carriage.mass' and 'body.c\*.mass' are the same value"):
        MujocoSimulator(MODEL, space)
