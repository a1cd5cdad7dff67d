"""A late sensor's held-out starts are those of the machine, not of what was shown."""

from __future__ import annotations

from dataclasses import replace

import torch

from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.identification.fitting.heldout import replay_error, replay_runs
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import SensorDelay
from tests.criticism.wired import ARM, NOISE, STEP

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
