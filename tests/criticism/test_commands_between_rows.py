"""A servo whose goals are sent more often than its log has rows, and the same servo whose goals change at the rows."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import mujoco
import numpy as np
import pytest

from onlinebayes.criticism import begun_as_read, prepare, refine
from onlinebayes.criticism.prepared_log import PreparedLog
from onlinebayes.measurements import BetweenRows, Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import UNWATCHED
from onlinebayes.simulators.mujoco import MujocoSimulator

SERVO = """
<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body name="horn">
<joint name="servo" axis="0 1 0" damping="0.5" armature="0.012"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.004" mass="0.01"/>
<geom type="sphere" pos="0 0 -0.1" size="0.02" mass="0.1"/></body></worldbody>
<actuator><position name="servo" joint="servo" kp="{kp}"/></actuator></mujoco>"""
FREE = ParameterSpace(
    {
        "joint.servo.damping": Parameter(0.0, 2.0, "N m s/rad"),
        "joint.servo.armature": Parameter(0.002, 0.05, "kg m2"),
    }
)
NOISE, EVERY, ROWS = 1e-3, 10, 150
TRIED = ["actuator_gain", "actuator_delay", "dry_friction", "payload", "quadratic_drag"]


def goal(run: int, t: float) -> float:
    """A chirp of 0.3 to 2 Hz; in two of the runs a goal that jumps within a row [rad]."""
    if run in (1, 3):
        return 0.6 if int((t + 0.007) / (0.83 + 0.1 * run)) % 2 else -0.6
    return (0.5 + 0.05 * run) * float(np.sin(2 * np.pi * ((0.3 + 0.1 * run) * t + 0.2 * t**2)))


def log(held: bool) -> Measurement:
    """Five runs of a servo with kp 14, where the model has 20; goals at 500 Hz, or held for a row of 20 ms."""
    model, noise, table = mujoco.MjModel.from_xml_string(SERVO.format(kp=14)), np.random.default_rng(3), {}
    for run in range(5):
        data, angle = mujoco.MjData(model), [0.0]
        for step in range(EVERY * (ROWS - 1)):
            data.ctrl[0] = goal(run, 0.002 * (step - step % EVERY if held else step))
            mujoco.mj_step(model, data)
            if (step + 1) % EVERY == 0:
                angle.append(float(data.qpos[0]))
        time = 0.02 * np.arange(ROWS)
        table[f"run{run}"] = {
            "time": time,
            "ctrl.servo": np.array([goal(run, t) for t in time]),
            "qpos.servo": np.array(angle) + NOISE * noise.standard_normal(ROWS),
        }
    return Measurement.from_runs(table, signals=[Signal("qpos.servo", "rad", sd=NOISE)])


def servo() -> MujocoSimulator:
    return MujocoSimulator(SERVO.format(kp=20), FREE, threads=1)


def task(held: bool) -> PreparedLog:
    return prepare(servo(), log(held), ["run4"], None, None)


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
def test_the_base_model_tells_how_commands_go_between_rows(held: bool) -> None:
    found, search = begun_as_read(task(held), UNWATCHED)
    assert found.fit_runs.between_rows == found.held_runs.between_rows == (None if held else "curve")
    assert float(search.base.left_out[0].rms.max()) < 1.7  # held, the other one leaves 20
    assert any("between the log's rows is not known" in note for note in found.notes) != held


def test_who_says_how_commands_go_is_not_asked() -> None:
    assert [type(one).__name__ for one in task(False).other_readings(servo())] == ["CurveBetweenRows"]
    for way in get_args(BetweenRows):
        asked = prepare(servo(), replace(log(held=False), between_rows=way), ["run4"], None, None)
        assert list(asked.other_readings(servo())) == []
        assert asked.notes == ()


@pytest.mark.slow
def test_goals_between_rows_change_no_name() -> None:
    """Held, the log of the faster goals left 20 noise floors, and the search ended as unexplained."""
    held, between = (refine(servo(), log(one), holdout=["run4"], candidates=TRIED) for one in (True, False))
    names = [{*result.accepted, *result.candidates[0].indistinguishable_from} for result in (held, between)]
    assert names[0] == names[1] >= {"actuator_gain@servo"}
    assert held.verdict == between.verdict == "tie"
    assert (held.read_as, between.read_as) == ("", 'commands_between_rows = "curve"')
    assert max(between.remainder.rms_over_floor.values()) < 1.1
