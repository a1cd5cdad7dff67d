"""Gross faults of the wiring that ``compare`` says, each in a line with its cure, though it tries no law."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import compare
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from tests.criticism import tumbling
from tests.criticism.wired import ARM, PENDULUM


def a_row_off(measurement: Measurement, name: str, rows: int) -> Measurement:
    """One column ``rows`` rows below where it belongs; what it then lacks is not measured."""
    s, data = [signal.name for signal in measurement.signals].index(name), measurement.data.clone()
    data["signal"][..., s] = torch.roll(data["signal"][..., s], rows, 1)
    data["measured"][:, slice(0, 1) if rows > 0 else slice(-1, None), s] = False
    return replace(measurement, data=data)


def dead(measurement: Measurement, name: str) -> Measurement:
    """One command 0 in every row."""
    data = measurement.data.clone()
    data["command"][..., measurement.commands.index(name)] = 0.0
    return replace(measurement, data=data)


@pytest.mark.slow
def test_a_quaternion_with_w_last_is_said() -> None:
    runs = tumbling.table(tumbling.Block(), runs=6, seconds=2.0)
    for columns in runs.values():
        wxyz = [columns[f"qpos.pose.{k}"] for k in (3, 4, 5, 6)]
        columns |= {f"qpos.pose.{3 + k}": wxyz[(k + 1) % 4] for k in range(4)}
    result = compare(tumbling.model(), tumbling.measurement(runs))
    assert result.wiring is not None
    assert result.wiring.fault == "qpos.pose.3 to qpos.pose.6: x, y, z, w for w, x, y, z"
    assert '[signals."qpos.pose.3"]\ncolumn = "qpos.pose.6"' in result.wiring.lines


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        pytest.param(1, "0.01 s (1 row) late", marks=pytest.mark.slow),
        pytest.param(-1, "0.01 s (1 row) early", marks=pytest.mark.slow),
    ],
)
def test_a_column_a_row_from_the_others_is_said(rows: int, says: str) -> None:
    result = compare(ARM.model(), a_row_off(ARM.measure(), "qpos.elbow", rows))
    assert result.wiring is not None
    assert result.wiring.fault == f"qpos.elbow is logged {says}"
    assert result.wiring.lines == f'[signals."qpos.elbow"]\nlatency = {0.01 * rows:g}'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "says"),
    [(1, "qpos.hinge is logged 0.01 s (1 row) late"), (-1, "ahead of the")],
)
def test_signals_a_row_from_the_commands_are_said_and_no_curve_between_rows(rows: int, says: str) -> None:
    result = compare(PENDULUM.model(), a_row_off(PENDULUM.measure(), "qpos.hinge", rows))
    assert result.wiring is not None
    assert says in result.wiring.fault
    assert result.read_as == ""


@pytest.mark.slow
def test_a_command_that_never_changes_is_said_where_the_machine_moves_all_the_same() -> None:
    result = compare(ARM.model(), dead(ARM.measure(), "lift"))
    assert result.notes[0].startswith("ctrl.lift is 0 in every row while qpos.shoulder and qpos.elbow move")
    assert 'column = ".." under [commands.lift]' in result.notes[0]


def test_the_only_command_must_change_where_the_model_follows_nothing_without() -> None:
    with pytest.raises(BadInput, match=r"ctrl.motor is 0 in every row while qpos.hinge moves.*enable.motor = 0"):
        compare(PENDULUM.model(), dead(PENDULUM.measure(), "motor"))


def test_a_swing_that_nobody_drives_has_no_dead_command() -> None:
    """The same column of zeros, and the pendulum swings out as its model does."""
    measurement = dead(PENDULUM.measure(), "motor")
    free, time = PENDULUM.model(), measurement.data["time"][0]
    start = torch.linspace(0.4, 1.2, len(measurement.runs), dtype=torch.float64)[:, None]
    path = free.rollout(
        torch.tensor(PENDULUM.truth, dtype=torch.float64).expand(len(start), -1),
        TensorDict({"qpos": start, "qvel": 0 * start}, batch_size=(len(start),)),
        TensorDict({"command": measurement.data["command"][:, :-1]}, batch_size=(len(start), len(time) - 1)),
        time[1:],
    )
    angle = torch.cat([start[:, None], path["qpos"]], 1)
    data = measurement.data.clone()
    data["signal"] = angle + 1e-3 * torch.randn(angle.shape, generator=torch.Generator().manual_seed(2)).double()
    result = compare(free, replace(measurement, data=data))
    assert result.verdict == "adequate"
    assert not any("in every row" in note for note in result.notes)


def test_runs_of_two_rows_show_no_motion() -> None:
    measurement = PENDULUM.measure()
    with pytest.raises(BadInput, match="no run has more than 2 rows; record runs of many rows"):
        compare(PENDULUM.model(), replace(measurement, data=measurement.data[:, :2]))
