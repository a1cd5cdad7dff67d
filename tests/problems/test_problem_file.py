"""A problem file becomes built objects, with everything in it where it belongs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from onlinebayes.criticism import Selection
from onlinebayes.criticism.wiring.faults import Offset, Rescaled
from onlinebayes.measurements import Signal
from onlinebayes.parameters import Parameter
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.problems.conftest import PROBLEM


def write(folder: Path, text: str) -> Path:
    (folder / "carriage.toml").write_text(text)
    return folder / "carriage.toml"


def test_bounds_beside_the_models_own_value_are_said(folder):
    notes = []
    load_problem(write(folder, PROBLEM.replace("[1.0, 10.0]", "[5.0, 10.0]")), note=notes.append)
    assert notes == ["body.carriage.mass: the model's own 3 lies outside the bounds 5 to 10"]


def test_where_an_integrator_begins_is_said(folder):
    model, notes = folder / "carriage.xml", []
    assert "<motor" in model.read_text()
    model.write_text(model.read_text().replace("<motor", '<general dyntype="integrator"'))
    load_problem(write(folder, PROBLEM), note=notes.append)
    assert len(notes) == 1
    assert "integrates its command" in notes[0]


def test_a_small_problem(folder):
    problem = load_problem(folder / "carriage.toml")
    assert isinstance(problem.simulator, MujocoSimulator)
    assert dict(problem.simulator.parameters) == {
        "body.carriage.mass": Parameter(1.0, 10.0, "kg"),
        "joint.carriage.damping": Parameter(0.0, 20.0, "N s/m"),
    }
    assert problem.simulator.nominal.tolist() == [3.0, 2.0]
    assert problem.measurement.runs == ("first", "second")
    assert problem.measurement.signals == (Signal("qpos.carriage", "m"),)
    assert problem.measurement.commands == ("motor",)
    assert problem.holdout == ("second",)
    assert problem.candidates == "all"
    assert problem.selection == Selection()
    assert problem.added == ()


def test_everything_optional(folder):
    text = PROBLEM.replace("schema = 1", "ignore = ['qpos.wheel']").replace('["second"]', '["sec*"]')
    text = text.replace("[1.0, 10.0]", '{ low = 1, high = 10, scale = "log", tie = false, scope = "shared" }')
    text += """
        [signals."qpos.carriage"]
        column = "position"
        unit = "mm"
        sign = -1
        scale = 2.0
        offset = 0.25
        sd = 1e-5
        resolution = 1e-6
        [selection]
        folds = 8
        horizon_s = 0.5
        alpha = 0.01
        tolerance = 1.5
        [effects]
        candidates = ["dry_friction", "actuator_delay@motor"]
        add = ["constant_load@carriage"]
    """
    table = (folder / "carriage.csv").read_text().replace("qpos.carriage", "position")
    (folder / "carriage.csv").write_text(table)
    problem = load_problem(write(folder, text), add=["dry_friction@carriage"])
    assert problem.simulator.parameters["body.carriage.mass"] == Parameter(1.0, 10.0, "kg", "log")
    assert problem.measurement.signals == (Signal("qpos.carriage", "m", 1e-5, 1e-6),)
    raw = float(table.splitlines()[100].split(",")[3])
    assert float(problem.measurement.data["signal"][0, 99, 0]) == pytest.approx(-2e-3 * raw + 0.25)
    assert problem.selection == Selection(8, 0.5, 0.01, 1.5, fixed_horizon=True)
    assert problem.candidates == ("dry_friction", "actuator_delay@motor")
    assert problem.added == ("constant_load@carriage", "dry_friction@carriage")
    assert [effect.key for effect in problem.simulator.effects] == list(problem.added)
    assert problem.simulator.parameters.names[-1] == "dry_friction@carriage.frictionloss"


def test_bounds_of_an_added_effect_may_be_given(folder):
    text = PROBLEM + '"dry_friction@carriage.frictionloss" = [0.0, 7.0]\n'
    problem = load_problem(write(folder, text), add=["dry_friction@carriage"])
    assert problem.simulator.parameters["dry_friction@carriage.frictionloss"] == Parameter(0.0, 7.0, "N")
    with pytest.raises(BadInput, match="no added effect has the parameter"):
        load_problem(folder / "carriage.toml")


def test_without_holdout_the_default_is_left_to_criticism(folder):
    assert load_problem(write(folder, PROBLEM.replace('holdout = ["second"]', ""))).holdout is None


FACTORY = """
import dataclasses
from pathlib import Path
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = Path(__file__).with_name("carriage.xml")

def build(parameters):
    return MujocoSimulator(MODEL, parameters)

def fixed():
    return MujocoSimulator(MODEL, ParameterSpace({"body.carriage.mass": Parameter(1.0, 10.0)}))

def broken(parameters):
    return 1 / 0

def nothing(parameters):
    return None

constant = 3
"""


@pytest.mark.parametrize(
    ("factory", "message"),
    [
        ("build", None),
        ("fixed", "has the parameters body.carriage.mass; name exactly these"),
        ("broken", "raised ZeroDivisionError"),
        ("nothing", "returned a NoneType"),
        ("constant", "has no factory 'constant'"),
        ("absent", "has no factory 'absent'"),
    ],
)
def test_a_factory_in_the_current_folder(folder, monkeypatch, factory, message):
    name = f"rig_{factory}"
    monkeypatch.chdir(folder)
    (folder / f"{name}.py").write_text(FACTORY)
    path = write(folder, PROBLEM.replace("carriage.xml", f"{name}:{factory}"))
    if message is None:
        assert load_problem(path).simulator.parameters.names == ("body.carriage.mass", "joint.carriage.damping")
    else:
        with pytest.raises(BadInput, match=message):
            load_problem(path)


def test_a_module_registers_an_effect_of_ones_own(folder, monkeypatch):
    monkeypatch.chdir(folder)
    from onlinebayes.simulators.effects import EFFECTS

    (folder / "own_effects.py").write_text(
        "from onlinebayes.simulators.effects import EFFECTS, DryFriction\n"
        "class Grease(DryFriction):\n    name = 'grease'\n"
        "EFFECTS['grease'] = Grease\n"
    )
    text = PROBLEM + "[effects]\nmodules = ['own_effects']\ncandidates = ['grease@carriage']\n"
    try:
        assert load_problem(write(folder, text)).candidates == ("grease@carriage",)
    finally:
        EFFECTS.pop("grease", None)


def test_broken_runs_are_left_out(folder):
    path = write(folder, 'exclude = ["fir*"]\n' + PROBLEM.replace('holdout = ["second"]', ""))
    assert load_problem(path).measurement.runs == ("second",)
    with pytest.raises(BadInput, match=r"exclude: no run is called 'third'.*first, second"):
        load_problem(write(folder, 'exclude = ["third"]\n' + PROBLEM))
    with pytest.raises(BadInput, match="exclude: every run is left out"):
        load_problem(write(folder, 'exclude = ["*"]\n' + PROBLEM))


def test_a_wrapped_angle_is_unwrapped(folder):
    whole = load_problem(write(folder, PROBLEM)).measurement.data["signal"]
    header, *rows = (folder / "carriage.csv").read_text().splitlines()
    cells = [row.rsplit(",", 1) for row in rows]
    wrapped = [f"{first},{(float(q) + 0.05) % 0.1 - 0.05:.9g}" for first, q in cells]
    (folder / "carriage.csv").write_text("\n".join([header, *wrapped]))
    jumping = load_problem(write(folder, PROBLEM)).measurement.data["signal"]
    assert float(jumping.abs().max()) < 0.051 < float(whole.abs().max())
    path = write(folder, PROBLEM + '[signals."qpos.carriage"]\nperiod = 0.1\n')
    assert torch.allclose(load_problem(path).measurement.data["signal"], whole, atol=1e-8)
    with pytest.raises(BadInput, match="period: 0 is no period"):
        load_problem(write(folder, PROBLEM + '[signals."qpos.carriage"]\nperiod = 0\n'))


def test_bom_and_crlf_are_welcome(folder):
    (folder / "carriage.toml").write_bytes(b"\xef\xbb\xbf" + PROBLEM.replace("\n", "\r\n").encode())
    assert load_problem(folder / "carriage.toml").holdout == ("second",)


def test_the_loaded_runs_replay(folder):
    """What is loaded is what the simulator takes: the true parameters reproduce the first run's positions."""
    problem = load_problem(folder / "carriage.toml")
    data = problem.measurement.data[:1]
    state = problem.simulator.state[:1]
    state["qpos"], state["qvel"] = torch.zeros_like(state["qpos"]), torch.zeros_like(state["qvel"])
    inputs = data.select("command", "enable")[:, :-1]
    replay = problem.simulator.rollout(problem.simulator.nominal[None], state, inputs, data["time"][0, 1:])
    assert float((replay["qpos"] - data["signal"][:, 1:]).abs().max()) < 2e-2


@pytest.mark.parametrize(
    "fault",
    [
        Rescaled("signal", ("qpos.carriage",), -1.0, ""),
        Rescaled("signal", ("qpos.carriage",), 1e-3, ""),
        Offset("qpos.carriage", 0.25),
    ],
)
def test_the_line_of_a_wiring_fault_does_what_the_check_tried(folder, fault):
    """What the wiring check replays is what its line in the problem file makes of the table."""
    asked = fault.correct(load_problem(folder / "carriage.toml").measurement)
    written = load_problem(write(folder, f"{PROBLEM}\n{fault.lines}\n")).measurement
    assert torch.allclose(written.data["signal"], asked.data["signal"], rtol=1e-12, atol=1e-15)


def test_the_beginning_of_runs_may_be_skipped(folder):
    late = load_problem(write(folder, PROBLEM.replace("holdout", "skip_s = 0.5\nholdout"))).measurement
    assert late.data["time"][:, 0].tolist() == [0.5, 0.5]
    with pytest.raises(BadInput, match="skip_s: -1 s is no time"):
        load_problem(write(folder, PROBLEM.replace("holdout", "skip_s = -1\nholdout")))


def test_how_commands_go_between_rows_may_be_said(folder):
    def loaded(line):
        return load_problem(write(folder, PROBLEM.replace("holdout", f"{line}\nholdout"))).measurement.between_rows

    assert (loaded(""), loaded('commands_between_rows = "curve"')) == (None, "curve")
    with pytest.raises(BadInput, match="commands_between_rows: 'line' is unknown; use held or curve"):
        loaded('commands_between_rows = "line"')


def test_measurements_may_lie_in_the_folder_of_data(folder, tmp_path_factory, monkeypatch):
    data = tmp_path_factory.mktemp("data")
    (folder / "carriage.csv").rename(data / "carriage.csv")
    path = write(folder, PROBLEM.replace('"carriage.csv"', '"$ONLINEBAYES_DATA/carriage.csv"'))
    monkeypatch.setenv("ONLINEBAYES_DATA", str(data))
    assert load_problem(path).measurement.runs == ("first", "second")
    monkeypatch.delenv("ONLINEBAYES_DATA")
    with pytest.raises(BadInput, match=r"measurements: ONLINEBAYES_DATA is not set; .*holds 'carriage.csv'"):
        load_problem(path)
    with pytest.raises(BadInput, match=r"\$HOME/carriage.csv: no such file"):
        load_problem(write(folder, PROBLEM.replace('"carriage.csv"', '"$HOME/carriage.csv"')))


def test_a_mapped_log_is_the_problem_of_the_table(folder):
    from mcap.writer import Writer

    files = {}
    for line in (folder / "carriage.csv").read_text().splitlines()[1:]:
        run, at, u, q = line.split(",")
        if run not in files:
            files[run] = Writer(str(folder / f"{run}.mcap"))
            files[run].start()
            channels = [files[run].register_channel(topic, "json", 0) for topic in ("/state", "/effort")]
        instant = round(float(at) * 1e9)
        state = json.dumps({"name": ["x"], "position": [1000 * float(q)]}).encode()
        files[run].add_message(channels[0], instant, state, instant)
        files[run].add_message(channels[1], instant, json.dumps({"data": -float(u)}).encode(), instant)
    for writer in files.values():
        writer.finish()
    wanted = load_problem(folder / "carriage.toml").measurement
    text = PROBLEM.replace('"carriage.csv"', '"first.mcap", "second.mcap"')
    (folder / "log.toml").write_text(
        f'{text}[signals."qpos.carriage"]\ncolumn = "/state.position[x]"\nunit = "mm"\n'
        '[commands.motor]\ncolumn = "/effort.data"\nsign = -1\n'
    )
    found = load_problem(folder / "log.toml").measurement
    assert (found.runs, found.signals, found.commands) == (wanted.runs, wanted.signals, wanted.commands)
    for key in ("time", "command", "enable", "signal", "measured", "mask"):
        assert torch.allclose(found.data[key].double(), wanted.data[key].double(), rtol=1e-12, atol=1e-12), key


def test_hinges_with_numbers_for_names_are_no_orientation(folder):
    """Four joints leg.0 to leg.3 once were read as the quaternion of a ball joint."""
    legs = "".join(f'<body><joint name="leg.{k}" damping="1"/><geom size=".1" pos="{k} 0 1"/></body>' for k in range(4))
    (folder / "carriage.xml").write_text(f"<mujoco><worldbody>{legs}</worldbody></mujoco>")
    rows = ["time," + ",".join(f"qpos.leg.{k}" for k in range(4))]
    rows += [f"{0.01 * i:.2f},{0.1 * i},0.2,," for i in range(300)]
    (folder / "carriage.csv").write_text("\n".join(rows) + "\n")
    text = 'model = "carriage.xml"\nmeasurements = ["carriage.csv"]\n[parameters]\n"joint.leg.0.damping" = [0, 2]\n'
    measurement = load_problem(write(folder, text)).measurement
    assert measurement.data["signal"][0, 10, 0].item() == pytest.approx(1.0)


def test_names_with_brackets_are_themselves(folder):
    text = (folder / "carriage.csv").read_text().replace("first,", "drive[1],").replace("second,", "drive[2],")
    more = text.replace("drive[", "push[").partition("\n")[2]
    head, _, rows = (text + more).partition("\n")
    rows = "\n".join(f"{row},0" for row in rows.splitlines())
    (folder / "carriage.csv").write_text(f"{head},qpos.extra[0]\n{rows}\n")
    top = 'exclude = ["push[1]"]\nignore = ["qpos.extra[0]"]\nholdout = ["drive[2]", "pus*"]'
    problem = load_problem(write(folder, PROBLEM.replace('holdout = ["second"]', top)))
    assert problem.measurement.runs == ("drive[1]", "drive[2]", "push[2]")
    assert problem.holdout == ("drive[2]", "push[2]")


def test_a_mapped_column_that_is_not_there_is_named(folder) -> None:
    text = PROBLEM + '[signals."qpos.carriage"]\ncolumn = "nope"\n'
    (folder / "carriage.toml").write_text(text)
    with pytest.raises(BadInput, match=r"no column 'nope', which \[signals\.\"qpos\.carriage\"\] names"):
        load_problem(folder / "carriage.toml")


def test_seconds_that_are_called_milliseconds_are_met_with_the_run_and_the_cure(folder) -> None:
    (folder / "carriage.toml").write_text(PROBLEM + '[time]\nunit = "ms"\n')
    with pytest.raises(BadInput, match=r"run 'first' lasts 0\.002 s.*\[time\] unit"):
        load_problem(folder / "carriage.toml")


@pytest.mark.parametrize("wrong", ["[next]\nmax_comand = 1\n", "next = 1\n"])
def test_what_next_may_do_is_read_by_every_command(folder, wrong: str) -> None:
    (folder / "carriage.toml").write_text(wrong + PROBLEM if wrong.startswith("next") else PROBLEM + wrong)
    with pytest.raises(BadInput, match="next"):
        load_problem(folder / "carriage.toml")
