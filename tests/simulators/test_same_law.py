"""What effects say of themselves to criticism: which numbers of a model are the same law, what joints say with less."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import same_as
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import EFFECTS, AirDrag, Effect, GravityTilt, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator

ARM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="hinge" axis="0 1 0" damping="0.3" frictionloss="0.1" stiffness="2" armature="0.02"/>
      <inertial pos="0.1 0 -0.2" mass="2" diaginertia="0.02 0.02 0.001"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge" gear="5"/></actuator>
</mujoco>"""
PLACES = {"joint": "hinge", "actuator": "motor", "body": "arm"}
PAIRS = [(effect, k) for effect in EFFECTS.values() for k in range(len(effect.same_law_as))]


def _path(simulator: MujocoSimulator, theta: list[float]) -> torch.Tensor:
    command = torch.sin(torch.arange(200, dtype=torch.float64) / 20)[None, :, None]
    inputs = TensorDict({"command": command}, batch_size=(1, 200))
    state = TensorDict({key: torch.full((1, 1), 0.5).double() for key in ("qpos", "qvel")}, batch_size=(1,))
    times = 0.002 * torch.arange(1, 201, dtype=torch.float64)
    return simulator.rollout(torch.tensor([theta], dtype=torch.float64), state, inputs, times)["qpos"]


@pytest.mark.parametrize(("effect", "k"), PAIRS, ids=lambda one: getattr(one, "name", str(one)))
def test_a_number_that_an_effect_calls_its_own_law_moves_the_model_as_the_effect_does(
    effect: type[Effect], k: int
) -> None:
    """In place of an effect that adds d to what the model has, or multiplies it, the number itself does so."""
    place = PLACES[effect.target_kind]
    target = f"{place}.{effect.axes[k]}" if effect.axes else place
    address = effect.same_law_as[k].replace("*", place)
    assert same_as(address) == f"{effect.name}@{target}"
    assert same_as(f"{address} in each run") == f"{address} in each run", "which is no law"

    one = effect.scaled(target, Scales(force=1.0, speed=1.0, travel=1.0, time=1.0))
    values = {**one.neutral, one.magnitude: one.neutral[one.magnitude] + 0.05}
    with_effect = MujocoSimulator(ARM).with_effect(one).with_soft_friction()  # as soft as the number is
    number = MujocoSimulator(ARM, ParameterSpace({address: Parameter(-10.0, 10.0)}))
    own = float(number.nominal[0])
    moved = own * 1.05 if effect.target_kind == "actuator" else own + 0.05
    said, shown = _path(with_effect, [values[name] for name in one.parameters]), _path(number, [moved])
    torch.testing.assert_close(shown, said, rtol=0, atol=1e-9)
    sideways = effect.name == "com_offset" and target.endswith(".y")  # along the axis of the hinge: moves nothing
    assert torch.equal(said, _path(number, [own])) == sideways


def test_other_keys_are_what_they_are() -> None:
    for key in ("joint.hinge.range[0]", "dry_friction@hinge", "com_offset@arm.x", "option.gravity[2]"):
        assert same_as(key) == key
    assert same_as("sensor_bias@qpos.hinge in each run") == "sensor_bias@qpos.hinge"


def test_what_single_joints_say_with_less_says_so() -> None:
    some = Scales(force=1.0, speed=1.0, travel=1.0, time=1.0)
    drag, tilt = AirDrag.scaled("arm", some), GravityTilt.scaled("world.x", some)
    assert drag.said_by_joints({"hinge": "hinge"}, ("hinge",))
    assert not drag.said_by_joints({"hinge": "hinge", "knee": "hinge"}, ("hinge", "knee"))
    assert not drag.said_by_joints({"ball": ""}, ("ball",)), "whose drag is no joint's"
    assert tilt.said_by_joints({"x": "slide", "y": "slide"}, ())
    assert not tilt.said_by_joints({"x": "slide", "pole": "hinge"}, ())
    others = [effect for effect in EFFECTS.values() if effect not in (AirDrag, GravityTilt)]
    assert all(effect.said_by_joints is Effect.said_by_joints for effect in others)
