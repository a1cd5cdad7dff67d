"""A joint's signals that were logged some rows late are the log's; a sensor's or a motor's delay is not."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.wiring import late_columns
from onlinebayes.criticism.wiring.bench import Bench
from onlinebayes.criticism.wiring.late_columns import is_the_logs, late_column
from onlinebayes.criticism.wiring.shifts import Shifted, late_joints
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, Effect
from tests.criticism.cases import refined
from tests.criticism.wired import ARM, PENDULUM, STEP, Rig

ELBOW = "qpos.elbow"
DEAD_TIME = Parameter(0.0, 0.1, "s")
SWINGS = "".join(
    f'<body name="{name}"><joint name="{name}" type="hinge" axis="0 1 0" damping="0.05"/>'
    '<inertial pos="0 0 -0.4" mass="1" diaginertia="0.01 0.01 0.001"/></body>'
    for name in ("left", "right")
)
APART = Rig(
    "two pendulums",
    f'<mujoco><option timestep="0.005" integrator="RK4"/><worldbody>{SWINGS}</worldbody>'
    '<actuator><motor name="left_motor" joint="left"/><motor name="right_motor" joint="right"/></actuator></mujoco>',
    ParameterSpace({f"body.{name}.mass": Parameter(0.3, 3.0, "kg") for name in ("left", "right")}),
    (1.2, 0.9),
    (1.2, 1.2),
)


def late_by(rows: float) -> Measurement:
    """The elbow's column lags behind the others, interpolated between rows, and holds its first value until then."""
    measured = ARM.measure(runs=4)
    data, whole = measured.data.clone(), math.floor(rows)
    column = data["signal"][:, :, 1].clone()
    line = torch.cat([column[:, :1].expand(-1, whole + 1), column], 1)
    part = rows - whole
    data["signal"][:, :, 1] = (1 - part) * line[:, 1 : column.shape[1] + 1] + part * line[:, : column.shape[1]]
    return replace(measured, data=data)


def bench(measurement: Measurement, rig: Rig = ARM) -> Bench:
    simulator, selection = rig.model(), Selection()
    return Bench(simulator, measurement, selection.horizon_s, ground(simulator, measurement, selection))


@pytest.mark.parametrize("rows", [4, pytest.param(2, marks=pytest.mark.long), pytest.param(7, marks=pytest.mark.long)])
def test_the_row_is_found_from_afar(rows) -> None:
    lead = late_column(bench(late_by(rows)))
    assert lead is not None
    assert lead[0] == Shifted((ELBOW,), rows, STEP)


@pytest.mark.slow
def test_a_row_is_too_little() -> None:
    assert late_column(bench(late_by(1))) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "value"),
    [(DryFriction("elbow", Parameter(0.0, 2.0, "N m")), 0.15), (ActuatorDelay("lift", DEAD_TIME), 0.03)],
)
def test_other_misfits_speak_for_no_late_column(effect: Effect, value: float) -> None:
    assert late_column(bench(ARM.measure({effect: (value,)}, runs=4))) is None


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "log"), [(3.0, True), (3.35, False)])
def test_it_is_the_logs_where_it_is_late_by_whole_rows(rows, log) -> None:
    table = bench(late_by(rows))
    lead = late_column(table)
    assert lead is not None
    assert is_the_logs(table, *lead) == log


@pytest.mark.slow
def test_a_motor_as_late_may_be_it(monkeypatch) -> None:
    """Where each joint moves by itself, a late motor and a late column leave the same table."""
    measured = APART.measure({ActuatorDelay("right_motor", DEAD_TIME): (0.03,)}, runs=4)
    table = bench(measured, APART)
    lead = late_column(table)
    assert lead is not None
    assert lead[0] == Shifted(("qpos.right",), 3, STEP)
    assert not is_the_logs(table, *lead)
    monkeypatch.setattr(late_columns, "EQUAL_ERROR_RATIO", 0.0)  # no motor is asked: the rows are whole
    assert is_the_logs(table, *lead)


def test_where_no_other_joint_is_on_time_nothing_is_tried() -> None:
    assert not list(late_joints(PENDULUM.measure(runs=1)))
    assert {fault.signals for fault in late_joints(ARM.measure(runs=1))} == {("qpos.shoulder",), (ELBOW,)}


@pytest.mark.long
def test_a_wrist_of_six_that_is_logged_late_is_named_before_any_effect_is_tried(tmp_path) -> None:
    result, stages = refined("six_joint_arm", "wiring", 3104, tmp_path)
    assert result.wiring is not None
    assert result.wiring.fault == "qpos.j6 and qvel.j6 are logged 0.03 s (3 rows) late"
    assert not any(stage.startswith("screening") for stage in stages)
