"""Sensor effects: what is read changes, the motion does not; starts are where the sensor showed them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.pendulum import Pendulum
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator
from onlinebayes.simulators.effects import Effect, Reading, SensorBias, SensorClock, SensorDelay, SensorScale
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.sensing import sense, unsense
from tests.simulators.models import SLIDE

SENSORS: dict[type[Effect], float] = {SensorBias: 0.3, SensorScale: 0.2, SensorDelay: 0.013}


def _path(simulator: Simulator, value: float, q: float, v: float) -> tuple[torch.Tensor, ...]:
    theta = torch.tensor([[value]], dtype=torch.float64)
    shown = TensorDict(
        {"qpos": torch.tensor([[q]], dtype=torch.float64), "qvel": torch.tensor([[v]], dtype=torch.float64)},
        batch_size=[1],
    )
    start = unsense(simulator, theta, shown)
    times = simulator.timestep * torch.arange(1, 41, dtype=torch.float64)
    inputs = TensorDict({"command": torch.zeros(1, 40, 1).double()}, batch_size=[1, 40])
    path = simulator.rollout(theta, start, inputs, times)
    return sense(simulator, theta, start, path, times)[0], path["qpos"][0, :, 0], times


@pytest.mark.parametrize("kind", SENSORS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("backend", ["mujoco", "torch"])
def test_the_reading_follows_the_law_and_begins_where_it_was_shown(kind: type[Effect], backend: str) -> None:
    base, joint = (MujocoSimulator(SLIDE), "rail") if backend == "mujoco" else (Pendulum(()), "hinge")
    value = SENSORS[kind]
    simulator = base.with_effect(kind(f"qpos.{joint}", Parameter(0.0, 0.5)))  # type: ignore[call-arg]
    shown, true, times = _path(simulator, value, 0.4, 1.5)
    before = torch.cat([torch.tensor([0.4 + 1.5 * value], dtype=torch.float64), true])  # for the delay
    law = {
        SensorBias: true + value,
        SensorScale: (1 + value) * true,
        SensorDelay: torch.from_numpy(_interpolated(times - value, times, before, 1.5)),
    }[kind]
    torch.testing.assert_close(shown[:, 0], law, rtol=0.0, atol=1e-12)
    if backend == "mujoco":  # no force: a line through the shown start, whatever the sensor
        torch.testing.assert_close(shown[:, 0], 0.4 + 1.5 * times, rtol=0.0, atol=1e-12)


def _interpolated(then: torch.Tensor, times: torch.Tensor, line: torch.Tensor, slope: float):
    knots = np.concatenate([[0.0], times.numpy()])
    inside = np.interp(then.numpy(), knots, line.numpy())
    return np.where(then.numpy() < 0, line[0].item() + slope * then.numpy(), inside)


@pytest.mark.parametrize("lag", [0.03, -0.03])
def test_a_clock_shows_what_was_or_will_be_and_begins_where_it_was_shown(lag: float) -> None:
    """A steady motion is shown as steady, slower by the rate, from the shown start; so far both ways are exact."""
    clock = SensorClock("qpos.rail", Parameter(-0.1, 0.1), Parameter(-0.1, 0.1))
    rate, offset, q, v = torch.tensor([[0.02], [lag], [0.4], [1.5]], dtype=torch.float64)
    own = {"rate": rate, "offset": offset}
    times = 0.01 * torch.arange(1, 41, dtype=torch.float64)
    start, slope = clock.unsense(own, q, v)
    shown = clock.sense(own, Reading(start[:, None] + slope[:, None] * times, start, slope, times))
    torch.testing.assert_close(shown[0], 0.4 + 1.5 * times, rtol=0.0, atol=1e-12)
    assert float(slope) == pytest.approx(1.5 / 0.98)
    assert float(start) == pytest.approx(0.4 + lag * 1.5 / 0.98)


def test_a_clock_that_stands_is_refused() -> None:
    with pytest.raises(BadInput, match="stay within -1 and 1"):
        SensorClock("qpos.rail", Parameter(0.0, 1.0), Parameter(0.0, 0.1))


def test_two_sensors_of_one_signal_are_undone_in_reverse() -> None:
    simulator = MujocoSimulator(SLIDE).with_effect(SensorBias("qpos.rail", Parameter(-1, 1)))
    simulator = simulator.with_effect(SensorScale("qpos.rail", Parameter(-0.5, 0.5)))
    theta = torch.tensor([[0.3, 0.2]], dtype=torch.float64)
    state = TensorDict(
        {"qpos": torch.tensor([[0.5]], dtype=torch.float64), "qvel": torch.tensor([[1.2]], dtype=torch.float64)},
        batch_size=[1],
    )
    behind = unsense(simulator, theta, state)
    assert float(behind["qpos"]) == pytest.approx(0.5 / 1.2 - 0.3)
    assert float(behind["qvel"]) == pytest.approx(1.0)


def test_an_unknown_signal_is_refused_by_name() -> None:
    for simulator in (MujocoSimulator(SLIDE), Pendulum(())):
        with pytest.raises(BadInput, match="nearest: "):
            simulator.with_effect(SensorBias("qpos.rial", Parameter(-1, 1)))
