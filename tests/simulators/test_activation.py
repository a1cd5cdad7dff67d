"""Activations that follow from commands alone, against plain MuJoCo stepped through the whole run."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorLag
from onlinebayes.simulators.mujoco import MujocoSimulator, activation
from tests.criticism.rigs import SLIDE, model

ROWS, STEPS = 150, 3
KINDS = {
    "filter": '<general name="motor" joint="rail" dyntype="filter" dynprm="0.03"/>',
    "filterexact": '<general name="motor" joint="rail" dyntype="filterexact" dynprm="0.03" ctrlrange="-2 2"/>',
    "limited": '<general name="motor" joint="rail" dyntype="filterexact" dynprm="0.03" actrange="-1 1"/>',
    "overshooting": '<general name="motor" joint="rail" dyntype="filter" dynprm="0.007" actrange="-1 1"/>',
    "position": '<position name="motor" joint="rail" kp="40" timeconst="0.05"/>',
    "integrator": '<general name="motor" joint="rail" dyntype="integrator"/>',
    "intvelocity": '<intvelocity name="motor" joint="rail" kp="40" actrange="-0.2 0.3"/>',
}


def xml(actuator: str, integrator: str = "RK4") -> str:
    return SLIDE.replace('<motor name="motor" joint="rail"/>', actuator).replace("RK4", integrator)


def drawn() -> np.ndarray:
    return 3.0 * np.random.default_rng(0).standard_normal(ROWS).repeat(2)[:ROWS]


def stepped(plain: mujoco.MjModel, command: np.ndarray, start: float) -> np.ndarray:
    """The activation before the first row and after each, by mj_step."""
    data, line = mujoco.MjData(plain), [start]
    data.act[0] = start
    for u in command:
        data.ctrl[0] = u
        mujoco.mj_step(plain, data, nstep=STEPS)
        line.append(float(data.act[0]))
    return np.array(line)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
@pytest.mark.parametrize("kind", list(KINDS))
def test_activations_are_those_of_plain_mujoco(kind: str, integrator: str) -> None:
    simulator, command = MujocoSimulator(xml(KINDS[kind], integrator), threads=1), drawn()
    found = simulator.command_driven_states(
        simulator.nominal[None], torch.tensor(command)[None, :, None], STEPS * 0.01
    )["act"]
    start = 0.0 if "int" in kind else float(found[0, 0, 0])
    assert found.shape == (1, ROWS + 1, 1)
    np.testing.assert_allclose(found[0, :, 0], stepped(simulator.model, command, start), rtol=0, atol=1e-9)
    if kind in ("filter", "position"):  # settled under the first command
        assert start == command[0]


def test_each_world_has_its_own_time_constant() -> None:
    free = ParameterSpace({"actuator.motor.dynprm[0]": Parameter(0.01, 1.0, "s")})
    simulator, command = MujocoSimulator(xml(KINDS["filterexact"]), free, threads=1), torch.tensor(drawn())
    theta = torch.tensor([[0.02], [0.5]]).double()
    found = simulator.command_driven_states(theta, command.expand(2, -1)[..., None], STEPS * 0.01)["act"]
    for line, tau in zip(found, theta, strict=True):
        alone = MujocoSimulator(xml(KINDS["filterexact"].replace("0.03", f"{float(tau)}")), threads=1)
        np.testing.assert_allclose(line[:, 0], stepped(alone.model, command.numpy(), float(line[0, 0])), atol=1e-9)


def test_many_worlds_are_taken_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    free = ParameterSpace({"actuator.motor.dynprm[0]": Parameter(0.01, 1.0, "s")})
    simulator = MujocoSimulator(xml(KINDS["filterexact"]), free, threads=1)
    theta, command = torch.tensor([[0.02], [0.1], [0.5]]).double(), torch.tensor(drawn()).expand(3, -1)[..., None]
    whole = simulator.command_driven_states(theta, command, STEPS * 0.01)["act"]
    monkeypatch.setattr(activation, "MEMORY", 2 * ROWS)
    assert torch.equal(simulator.command_driven_states(theta, command, STEPS * 0.01)["act"], whole)


def test_a_lag_before_the_filter_counts() -> None:
    simulator = MujocoSimulator(xml(KINDS["filterexact"]), threads=1).with_effect(
        ActuatorLag("motor", Parameter(0.0, 0.5, "s"))
    )
    theta, command = torch.tensor([[0.1]]).double(), torch.tensor(drawn())[None, :, None]
    found = simulator.command_driven_states(theta, command, STEPS * 0.01)["act"]
    state = simulator.with_worlds(1).state
    state["act"] = found[:, 0]
    state["effects"] = simulator.rollout(
        theta, state, _inputs(command[:, :1].expand(-1, 200, -1)), torch.arange(1, 201).double() * 0.03
    )[:, -1]["effects"]
    times = torch.arange(1, ROWS + 1).double() * STEPS * 0.01
    path = simulator.rollout(theta, state, _inputs(command), times)["act"]
    torch.testing.assert_close(found[:, 1:], path, rtol=0, atol=1e-6)


def _inputs(command: torch.Tensor) -> TensorDict:
    return TensorDict({"command": command}, batch_size=command.shape[:2])


def test_other_activations_and_none_are_not_followed() -> None:
    command = torch.zeros(1, 4, 1).double()
    muscle = MujocoSimulator(xml('<muscle name="motor" joint="rail" lengthrange="0 1"/>'), threads=1)
    assert muscle.command_driven_states(muscle.nominal[None], command, 0.01) == {}
    assert model().command_driven_states(model().nominal[None], command, 0.01) == {}
    assert model().memory_span == 0.0


def test_integrators_remember_for_ever() -> None:
    assert MujocoSimulator(xml(KINDS["intvelocity"]), threads=1).integrating_commands == ("motor",)
    assert MujocoSimulator(xml(KINDS["filter"]), threads=1).integrating_commands == ()


def test_an_integrator_begins_where_the_first_keyframe_has_it() -> None:
    keyframe = xml(KINDS["intvelocity"]).replace("</mujoco>", '<keyframe><key act="0.2"/></keyframe></mujoco>')
    simulator = MujocoSimulator(keyframe, threads=1)
    found = simulator.command_driven_states(simulator.nominal[None], torch.zeros(1, 2, 1).double(), 0.01)["act"]
    assert found.flatten().tolist() == [0.2, 0.2, 0.2]


def test_a_filter_forgets_within_ten_time_constants() -> None:
    one = xml(KINDS["filterexact"])
    assert MujocoSimulator(one, threads=1).memory_span == pytest.approx(0.3)
    free = {"near": Parameter(0.01, 0.06, "s"), "wide": Parameter(0.01, 9.0, "s")}
    found = {
        name: MujocoSimulator(one, ParameterSpace({"actuator.motor.dynprm[0]": bounds}), threads=1).memory_span
        for name, bounds in free.items()
    }
    assert found == {"near": pytest.approx(0.6), "wide": pytest.approx(1.2)}
    assert MujocoSimulator(xml(KINDS["integrator"]), threads=1).memory_span == 0.0
