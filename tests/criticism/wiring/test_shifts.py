"""Signals that run ahead of the commands, or late by whole rows, are found with the line that mends them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.inquiry import suspect
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.wiring.shifts import ROWS, Shifted, late, shifts
from onlinebayes.criticism.wiring.wiring import Suspicion
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.wired import ARM, PENDULUM, STEP

POSITION = "qpos.hinge"
FRICTION = DryFriction("elbow", Parameter(0.0, 2.0, "N m"))


def ahead(measurement: Measurement, rows: int) -> Measurement:
    """Every signal shows what happens so many rows later; the last rows show nothing."""
    data = measurement.data.clone()
    data["signal"] = torch.roll(data["signal"], -rows, 1)
    data["measured"] = data["measured"].clone()
    data["measured"][:, -rows:] = False
    return replace(measurement, data=data)


def test_a_table_put_right_shows_what_happened() -> None:
    measured = PENDULUM.measure(runs=2)
    mended = Shifted((POSITION,), -3, STEP).mended(ahead(measured, 3))
    assert not bool(mended.data["measured"][:, :3].any())
    assert bool(mended.data["measured"][:, 3:].all())
    torch.testing.assert_close(mended.data["signal"][:, 3:], measured.data["signal"][:, 3:], atol=1e-9, rtol=0)


def test_signals_ahead_are_found() -> None:
    simulator, selection = PENDULUM.model(), Selection()
    table = ahead(PENDULUM.measure(), 5)
    found = suspect(ground(simulator, table, selection), simulator, table, selection)
    assert found is not None
    assert found.certain
    assert found.fault.says == "the signals run 0.05 s (5 rows) ahead of the commands"
    assert found.fault.lines == f'[signals."{POSITION}"]\nlatency = -0.05'


def with_torque(measured: Measurement, early: bool, factor: float = 1.0) -> Measurement:
    """The pendulum's table with the motor's torque, read before or after its row's command was sent."""
    draw = torch.Generator().manual_seed(2)
    command = measured.data["command"]
    torque = command if early else torch.roll(command, 1, 1)
    noisy = factor * (torque + 0.01 * torch.randn(torque.shape, generator=draw, dtype=torque.dtype))
    data = measured.data.clone()
    data["signal"] = torch.cat([data["signal"], noisy], -1)
    data["measured"] = torch.cat([data["measured"], data["measured"]], -1)
    if not early:
        data["measured"][:, 0, -1] = False
    return replace(measured, data=data, signals=(*measured.signals, Signal("qfrc.hinge", "N m")))


def found_with(table: Measurement) -> Suspicion | None:
    simulator, selection = MujocoSimulator(PENDULUM.xml, PENDULUM.free, threads=1, sensors=("qfrc.hinge",)), Selection()
    return suspect(ground(simulator, table, selection), simulator, table, selection)


@pytest.mark.slow
def test_a_sensor_that_is_read_under_the_next_command_is_found() -> None:
    measured = PENDULUM.measure()
    assert found_with(with_torque(measured, early=False)) is None
    found = found_with(with_torque(measured, early=True))
    assert found is not None
    assert found.certain
    assert found.fault.says == "qfrc.hinge is logged 0.01 s (1 row) early"
    assert found.fault.lines == '[signals."qfrc.hinge"]\nlatency = -0.01'


@pytest.mark.slow
def test_a_sensor_of_the_wrong_sign_is_found() -> None:
    found = found_with(with_torque(PENDULUM.measure(), early=False, factor=-1.0))
    assert found is not None
    assert found.certain
    assert found.fault.lines == '[signals."qfrc.hinge"]\nsign = -1'


def test_shifts_leave_most_of_a_run() -> None:
    measured = PENDULUM.measure(runs=1)
    assert [-fault.rows for fault in shifts(measured)] == list(ROWS)
    assert next(iter(shifts(measured))).step == pytest.approx(STEP)
    short = measured.rows("run0", 0, 18)
    assert [-fault.rows for fault in shifts(short)] == [1, 2, 3]


@pytest.mark.parametrize(("rows", "log"), [(1.0, False), (1.98, True), (2.5, False), (7.03, True), (7.1, False)])
def test_a_buffer_is_late_by_whole_rows(rows: float, log: bool) -> None:
    found = late(ARM.measure(runs=1), {"qpos.elbow": rows * STEP})
    assert found == (Shifted(("qpos.elbow",), round(rows), STEP) if log else None)


@pytest.mark.parametrize(("rows", "nearest"), [(3.4, 3), (1.7, 2), (1.2, None)])
def test_a_delay_that_leaves_more_than_noise_is_tried_as_the_nearest_row(rows: float, nearest: int | None) -> None:
    measured = ARM.measure(runs=1)
    found = late(measured, {"qpos.elbow": rows * STEP}, loosely=True)
    assert found == (None if nearest is None else Shifted(("qpos.elbow",), nearest, STEP))
    assert late(measured, {"qpos.elbow": rows * STEP}) is None


def test_where_all_signals_are_late_it_may_be_the_motors() -> None:
    assert late(PENDULUM.measure(runs=1), {POSITION: 3 * STEP}) is None
    assert late(ARM.measure(runs=1), {"qpos.elbow": 3 * STEP, "qpos.shoulder": 3 * STEP}) is None
    assert late(ARM.measure(runs=1), {}) is None


@pytest.mark.slow
def test_a_column_that_is_late_by_rows_is_the_logs_before_any_effect_is_tried() -> None:
    measured, stages = ARM.measure(runs=6), []
    data = measured.data.clone()
    data["signal"][:, 3:, 1] = data["signal"][:, :-3, 1].clone()
    result = refine(ARM.model(), replace(measured, data=data), progress=stages.append)
    assert not any(stage.startswith("screening") for stage in stages)
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert result.wiring.fault == "qpos.elbow is logged 0.03 s (3 rows) late"
    assert result.wiring.lines == '[signals."qpos.elbow"]\nlatency = 0.03'
    assert result.accepted == ()


@pytest.mark.long
def test_a_late_column_beside_friction_is_the_logs_also_where_only_a_late_motor_was_tried() -> None:
    measured = ARM.measure({FRICTION: (0.03,)}, runs=10)
    data = measured.data.clone()
    data["signal"][:, 3:, 1] = data["signal"][:, :-3, 1].clone()
    result = refine(ARM.model(), replace(measured, data=data), candidates=["actuator_delay"])
    assert result.wiring is not None
    assert result.wiring.fault == "qpos.elbow is logged 0.03 s (3 rows) late"


@pytest.mark.long
def test_a_late_motor_beside_friction_that_nobody_tries_is_no_late_column() -> None:
    hidden = {ActuatorDelay("bend", Parameter(0.0, 0.1, "s")): (0.03,), FRICTION: (0.15,)}
    result = refine(ARM.model(), ARM.measure(hidden, runs=10), candidates=["actuator_delay"])
    assert result.accepted == ("actuator_delay@bend",)
    assert result.wiring is None
    assert max(result.remainder.rms_over_floor.values()) > 1.5  # so that the log was looked at
