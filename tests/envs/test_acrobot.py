"""The acrobot beyond what Gymnasium says of it: the simulator's contract, energy, what no data can say."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from envs.acrobot import GRAVITY, Acrobot, AcrobotTask
from onlinebayes.parameters import Parameter
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, ViscousFriction
from onlinebayes.simulators.testing import check_simulator


@pytest.mark.usefixtures("without_shape_checks")
def test_conformance() -> None:
    simulator = Acrobot(tuple(Acrobot.defaults), 2)
    check_simulator(simulator, steps=4, atol=1e-12, inert=("length2",))
    check_env_specs(SimulatorEnv(simulator, AcrobotTask()))


@pytest.mark.usefixtures("without_shape_checks")
def test_conformance_with_effects_at_the_stages_of_a_step() -> None:
    rubbed = Acrobot(("mass1", "mass2"), 2).with_effect(DryFriction("elbow", Parameter(0.0, 0.5, "N m")))
    damped = rubbed.with_effect(ViscousFriction("shoulder", Parameter(0.0, 0.5, "N m s/rad")))
    check_simulator(damped.with_effect(ActuatorDelay("motor", Parameter(0.0, 0.5, "s"))), steps=4, atol=1e-12)


def energy(state: TensorDict) -> torch.Tensor:
    """Kinetic and potential, for masses 1, lengths 1, centres at 0.5 and moments 1."""
    (a, b), (u, w) = state["qpos"].unbind(-1), state["qvel"].unbind(-1)
    inertia = 1 * 0.25 + 1 * (1 + 0.25 + torch.cos(b)) + 2
    mixed, second = 0.25 + 0.5 * torch.cos(b) + 1, 0.25 + 1
    kinetic = 0.5 * inertia * u**2 + mixed * u * w + 0.5 * second * w**2
    return kinetic - GRAVITY * (1.5 * torch.cos(a) + 0.5 * torch.cos(a + b))


def test_energy_stays_and_the_finer_the_step_the_better() -> None:
    drift, draw = [], 2 * torch.rand(8, 4, dtype=torch.float64) - 1
    for timestep in (0.1, 0.05):
        simulator = Acrobot((), 8).with_timestep(timestep)
        start = TensorDict({"qpos": draw[:, :2], "qvel": draw[:, 2:]}, batch_size=(8,))
        state = simulator.reset(simulator.nominal.expand(8, -1), start)
        before = energy(state)
        for _ in range(round(4 / timestep)):
            state = simulator.step(TensorDict({"command": torch.zeros(8, 1)}, batch_size=(8,)))
        drift.append((energy(state) - before).abs().max().item())
    assert drift[0] < 0.01
    assert drift[1] < drift[0] / 8, "an error of fourth order in the step"


@pytest.mark.parametrize(("angles", "high"), [((math.pi, 0.0), True), ((0.0, 0.0), False), ((math.pi / 2, 1.4), False)])
def test_the_reward_is_minus_one_until_the_tip_is_high(angles: tuple[float, float], high: bool) -> None:
    task = AcrobotTask()
    state = TensorDict({"qpos": torch.tensor([angles]), "qvel": torch.zeros(1, 2)}, batch_size=(1,))
    assert task.terminated(state).tolist() == [high]
    assert task.reward(state, torch.tensor([[0, 1, 0]]), state).tolist() == [0.0 if high else -1.0]
