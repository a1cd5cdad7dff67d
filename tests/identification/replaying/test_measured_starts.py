"""A late sensor's held-out starts are those of the machine, not of what was shown."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.identification.fitting.heldout import replay_error, replay_runs
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import SensorClock, SensorDelay
from tests.criticism.late import measure
from tests.criticism.wired import ARM, NOISE, PENDULUM, STEP

LATE = SensorDelay("qpos.elbow", Parameter(0.0, 0.1, "s"))
ROWS = 4
DELAY = ROWS * STEP  # [s]


def test_the_true_model_replays_a_late_sensor_as_well_as_a_prompt_one() -> None:
    noise = torch.full((2,), NOISE, dtype=torch.float64)
    signals = ("qpos.shoulder", "qpos.elbow")

    def errors(delay: float, as_shown: bool = False) -> tuple[float, ...]:
        model = ARM.model().with_effect(LATE)
        theta = torch.tensor([*ARM.truth, delay], dtype=torch.float64)
        measured = ARM.measure()
        if delay:
            data = measured.data.clone()
            data["signal"][:, ROWS:, 1] = data["signal"][:, :-ROWS, 1].clone()
            measured = replace(measured, data=data)
        windows = (
            make_windows(model, measured, 1.0, MEMORY, noise, inset=True)
            if as_shown
            else windows_to_replay(model, measured, theta, 1.0, noise)
        )
        return tuple(replay_error(replay_runs(model, windows, theta, held_out=True), signals).values())

    prompt, late, shown = errors(0.0), errors(DELAY), errors(DELAY, as_shown=True)
    assert all(a < 1.5 * b for a, b in zip(late, prompt, strict=True))
    assert shown[1] > 3 * late[1]


@pytest.mark.parametrize("begin", [0.0, 2.0])
def test_the_true_clock_replays_a_drifting_sensor_as_well_as_a_prompt_one(begin: float) -> None:
    """Each window begins with the lag of its time; without a clock the model errs by far more than the noise."""
    noise, rate = torch.full((1,), NOISE, dtype=torch.float64), 5e-3
    clock = SensorClock("qpos.hinge", Parameter(-0.1, 0.1, "s/s"), Parameter(-0.1, 0.1, "s"), begin)
    model, measured = PENDULUM.model().with_effect(clock), measure(runs=2, seconds=6.0, drift=rate)

    def error(*own: float) -> float:
        theta = torch.tensor([*PENDULUM.truth, *own], dtype=torch.float64)
        windows = windows_to_replay(model, measured, theta, 1.0, noise)
        return replay_error(replay_runs(model, windows, theta, held_out=True), ("qpos.hinge",))["qpos.hinge"]

    assert error(rate, rate * begin) < 4 * NOISE
    assert error(0.0, 0.0) > 4 * error(rate, rate * begin)
