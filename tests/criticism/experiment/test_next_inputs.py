"""The family of inputs: within the limits, without a jolt at both ends, and balanced where it says so."""

from __future__ import annotations

import math

import pytest
import torch

from onlinebayes.criticism.experiment.inputs import Inputs, Posture, admissible_inputs
from onlinebayes.criticism.experiment.limits import Allowed, Limits, find_limits
from onlinebayes.criticism.experiment.play import FixedModel, admissible, play
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.runs import BadInput
from tests.criticism import sprung


@pytest.fixture(scope="module")
def windows() -> Windows:
    runs = sprung.small_runs(sprung.model(), sprung.TRUTH)
    return make_windows(sprung.model(), sprung.measurement(runs), 1.0)


@pytest.fixture(scope="module")
def limits() -> Limits:
    one = torch.ones(1, dtype=torch.float64)
    return Limits(-5 * one, 8 * one, 60 * one, -0.1 * one, 0.1 * one, 0.5 * one, 6.0)


def hanging(held: float) -> list[Posture]:
    """Where the sprung slide begins, held by so much."""
    return [Posture("", torch.tensor([sprung.REST]).double(), torch.tensor([held]).double())]


@pytest.fixture(scope="module")
def inputs(windows: Windows, limits: Limits) -> Inputs:
    return admissible_inputs(windows, limits, ("motor",), hanging(60 * sprung.REST))


def test_commands_and_their_rates_keep_to_the_limits(inputs: Inputs, limits: Limits) -> None:
    """Every input uses what it may and no more."""
    rate = (inputs.command[:, 1:] - inputs.command[:, :-1]).abs() / inputs.step
    assert inputs.count >= 15
    assert len(set(inputs.names)) == inputs.count
    assert float(inputs.command.min()) >= -5 - 1e-9
    assert float(inputs.command.max()) <= 8 + 1e-9
    assert float(rate.max()) <= 60 * (1 + 1e-9)
    assert bool((inputs.command.abs().amax((1, 2)) > 1).all())


def test_inputs_begin_and_end_at_the_held_command_without_a_jolt(inputs: Inputs) -> None:
    """u and du/dt are those of the held command at both ends."""
    away = (inputs.command - inputs.held[:, None]).abs()
    largest = away.amax((1, 2))
    assert float(away[:, [0, -1]].max()) < 1e-12
    assert bool((away[:, [1, -2]].amax((1, 2)) < 0.01 * largest).all())


def test_a_slow_rate_does_not_take_commands_out_of_their_bounds(windows: Windows) -> None:
    """Brought nearer to what is held, which lies within the bounds, they stay there."""
    one = torch.ones(1, dtype=torch.float64)
    narrow = Limits(-0.5 * one, 0.5 * one, one, -one, one, one, 6.0)
    command = admissible_inputs(windows, narrow, ("motor",), hanging(-0.49)).command
    assert float(command.abs().max()) <= 0.5 + 1e-9
    assert float((command[:, 1:] - command[:, :-1]).abs().max()) <= windows.step * (1 + 1e-9)


def test_balanced_inputs_bring_a_free_mass_back_to_rest(windows: Windows) -> None:
    """No integral and no double integral is left, so that neither speed nor place of a free mass is."""
    one = torch.ones(1, dtype=torch.float64)
    wide = Limits(-20 * one, 20 * one, 1e6 * one, -one, one, one, 6.0)
    inputs = admissible_inputs(windows, wide, ("motor",), hanging(0.0))
    balanced = [n for n, name in enumerate(inputs.names) if "balanced" in name]
    pushed = (inputs.command - inputs.held[:, None])[balanced][..., 0]
    speed = pushed.cumsum(1) * inputs.step
    assert len(balanced) >= 6
    assert float(speed[:, -1].abs().max()) < 1e-6
    assert float(speed.sum(1).abs().max()) < 1e-6


def test_inputs_that_leave_travel_or_speed_are_scaled_down(inputs: Inputs, limits: Limits) -> None:
    """What remains keeps to the limits under every hypothesis, and is the larger for being as large as it can."""
    model = sprung.model()
    pair = [FixedModel(str(k), model, torch.tensor([k, 9.0], dtype=torch.float64)) for k in (2.0, 4.0)]
    safe = admissible(pair, inputs, limits)
    paths = torch.stack([play(hypothesis, safe)["qpos"] for hypothesis in pair])
    speeds = torch.stack([play(hypothesis, safe)["qvel"] for hypothesis in pair])
    assert safe.count > 0
    assert bool((safe.scale <= 1).all())
    assert bool((safe.scale < 0.9).any())
    assert float(paths.abs().max()) <= 0.1
    assert float(speeds.abs().max()) <= 0.5
    assert math.isclose(safe.step, inputs.step)


def test_limits_come_from_measurements_model_and_user(windows: Windows) -> None:
    """Measured values bound what nobody says; the model's ranges and the user's own limits go before them."""
    measurement = sprung.measurement(sprung.small_runs(sprung.model(), sprung.TRUTH))
    largest = float(measurement.data["command"].abs().max())
    bare = find_limits(sprung.model(), measurement, windows, Allowed(), 0.0)
    assert float(bare.command_high[0]) == largest == -float(bare.command_low[0])
    assert bare.seconds == pytest.approx(12 * windows.horizon)
    width = float(bare.travel_high[0] - bare.travel_low[0])
    measured = float(measurement.data["signal"].max() - measurement.data["signal"].min())
    assert measured < width < 1.3 * measured
    stated = sprung.MODEL.replace('type="slide"', 'type="slide" range="-1 1" limited="true"').replace(
        'name="motor"', 'name="motor" ctrlrange="-3 4" ctrllimited="true"'
    )
    given = find_limits(sprung.model(stated), measurement, windows, Allowed(max_speed={"rail": 2.0}), 0.0)
    assert (float(given.command_low[0]), float(given.command_high[0])) == (-3.0, 4.0)
    assert (float(given.travel_low[0]), float(given.travel_high[0])) == pytest.approx((-0.96, 0.96))
    assert float(given.speed[0]) == 2.0


@pytest.mark.parametrize(
    ("text", "size", "allowed", "message"),
    [
        (sprung.MODEL, 0.0, Allowed(), "no command ever differs from zero"),
        (sprung.MODEL, 0.04, Allowed(seconds=1.0), "shorter than two windows"),
        (sprung.MODEL[: sprung.MODEL.index("<actuator>")] + "</mujoco>", 0.04, Allowed(), "no actuators"),
    ],
)
def test_nothing_admissible_is_bad_input(
    windows: Windows, text: str, size: float, allowed: Allowed, message: str
) -> None:
    """No actuator, no command ever, no time: one line that says so."""
    measurement = sprung.measurement(sprung.small_runs(sprung.model(), sprung.TRUTH, size))
    with pytest.raises(BadInput, match=message):
        find_limits(sprung.model(text), measurement, windows, allowed, 0.0)
