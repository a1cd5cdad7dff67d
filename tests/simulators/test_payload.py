"""A known mass on a body: inertia and weight besides what the parameters say."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ViscousFriction
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = """
<mujoco><option timestep="0.01" gravity="0 0 -10"/><worldbody><body name="arm">
  <joint name="lift" type="slide" axis="0 0 1"/><inertial pos="0.1 0.2 0.3" mass="2" diaginertia="1 1 1"/>
</body></worldbody><actuator><motor name="motor" joint="lift"/></actuator></mujoco>"""


def test_a_payload_adds_to_a_mass_that_is_free() -> None:
    """(m + M) a = u - (m + M) g with m a parameter; effects and the worlds' parameters stay."""
    space = ParameterSpace({"body.arm.mass": Parameter(0.5, 8.0, "kg")})
    plain = MujocoSimulator(MODEL, space, threads=1).with_effect(ViscousFriction("lift", Parameter(0, 1)))
    heavy = plain.with_payload("arm", 3.0)
    theta = torch.tensor([[1.0, 0.0], [5.0, 0.0]], dtype=torch.float64)
    zero = torch.zeros(2, 1, dtype=torch.float64)
    state = TensorDict({"qpos": zero, "qvel": zero}, batch_size=(2,))
    push = TensorDict({"command": zero[:, None] + 100.0}, batch_size=(2, 1))
    v = heavy.rollout(theta, state, push, torch.tensor([0.01], dtype=torch.float64))["qvel"][:, 0, 0]
    expected = 0.01 * (100.0 / torch.tensor([4.0, 8.0], dtype=torch.float64) - 10.0)
    torch.testing.assert_close(v, expected, rtol=1e-9, atol=0)
    assert heavy.parameters.names == plain.parameters.names
    assert heavy.signals == plain.signals


def test_a_body_that_is_not_there_is_named() -> None:
    """The nearest body is the cure."""
    with pytest.raises(BadInput, match="no body 'arn'; nearest: arm"):
        MujocoSimulator(MODEL, threads=1).with_payload("arn", 1.0)
