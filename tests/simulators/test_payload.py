"""A known mass on a body: inertia and weight besides what the parameters say."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Payload, ViscousFriction
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


def test_a_payload_hangs_at_the_centre_of_mass() -> None:
    """The same as the effect: a body's own centre, which is not at its joint."""
    plain = MujocoSimulator(SITES.format(compiler="", weight=""), threads=1)
    heavy = plain.with_payload("lower", 0.4)
    effect = plain.with_effect(Payload("lower", Parameter(0.0, 1.0, "kg")))
    free, some = torch.zeros(1, 0, dtype=torch.float64), torch.tensor([[0.4]], dtype=torch.float64)
    torch.testing.assert_close(swung(heavy, free), swung(effect, some), rtol=0, atol=1e-6)


def test_a_body_that_is_not_there_is_named() -> None:
    """The nearest body is the cure."""
    with pytest.raises(BadInput, match="no body 'arn'; nearest: arm"):
        MujocoSimulator(MODEL, threads=1).with_payload("arn", 1.0)


SITES = """
<mujoco><compiler autolimits="true" {compiler}/><option timestep="0.002" gravity="0 0 -9.81"/><worldbody>
  <site name="wall"/>
  <body name="upper" pos="0 0 1"><joint name="shoulder" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
    <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/>
      <frame pos=".1 0 0" euler="0 30 0"><site name="tool" pos=".1 .02 -.05"/></frame>{weight}
    </body>
  </body>
</worldbody><actuator><motor name="m" joint="shoulder"/></actuator></mujoco>"""
WEIGHT = '<body name="w" pos="{} {} {}"><inertial pos="0 0 0" mass=".4" diaginertia="1e-15 1e-15 1e-15"/></body>'


def swung(model: MujocoSimulator, theta: torch.Tensor) -> torch.Tensor:
    zero = torch.zeros(1, 2, dtype=torch.float64)
    state = TensorDict({"qpos": zero + 0.3, "qvel": zero}, batch_size=(1,))
    push = TensorDict({"command": torch.full((1, 300, 1), 1.5, dtype=torch.float64)}, batch_size=(1, 300))
    return model.rollout(theta, state, push, 0.002 * torch.arange(1, 301, dtype=torch.float64))["qpos"]


@pytest.mark.parametrize("compiler", ["", 'fusestatic="true"'])
def test_a_payload_at_a_site_is_a_mass_there(compiler: str) -> None:
    """A second body of 0.4 kg welded on at the site's place, and nothing at all at zero, also as a file of its own."""
    plain = MujocoSimulator(SITES.format(compiler=compiler, weight=""), threads=1)
    loaded = plain.with_effect(Payload("tool", Parameter(0.0, 1.0, "kg")))
    x, y, z = plain.model.site("tool").pos
    heavy = MujocoSimulator(SITES.format(compiler=compiler, weight=WEIGHT.format(x, y, z)), threads=1)
    none, some = (torch.tensor([[mass]], dtype=torch.float64) for mass in (0.0, 0.4))
    free = torch.zeros(1, 0, dtype=torch.float64)
    assert torch.equal(swung(loaded, none), swung(plain, free))
    torch.testing.assert_close(swung(loaded, some), swung(heavy, free), rtol=0, atol=1e-10)
    assert float((swung(loaded, some) - swung(plain, free)).abs().max()) > 0.1
    alone = MujocoSimulator(loaded.export_xml(some[0]), threads=1)
    assert loaded.not_exportable(some[0]) == {}
    torch.testing.assert_close(swung(alone, free), swung(loaded, some), rtol=0, atol=1e-9)


def test_sites_that_carry_a_payload() -> None:
    """Those of bodies that move, by name; criticism tries them where they are named."""
    plain = MujocoSimulator(SITES.format(compiler="", weight=""), threads=1)
    assert plain.targets("site") == ("tool",)
    with pytest.raises(BadInput, match="site 'wall' is fixed to the world"):
        plain.with_effect(Payload("wall", Parameter(0.0, 1.0)))
    with pytest.raises(BadInput, match="no body 'tol'"):
        plain.with_effect(Payload("tol", Parameter(0.0, 1.0)))
