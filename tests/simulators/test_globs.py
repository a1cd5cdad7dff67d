"""A glob stands for elements of the user's model, whatever is added to that later."""

from __future__ import annotations

import mujoco
import pytest
import torch

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import EFFECTS, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator

TWO_SERVOS = """
<mujoco><option timestep="0.002"/><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .5 0 0"/>
    <body name="lower" pos=".5 0 0"><joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .4 0 0"/><site name="tip" pos=".4 0 0"/></body></body>
</worldbody><actuator>
  <position name="lift" joint="shoulder" kp="20" kv="1"/><position name="bend" joint="elbow" kp="20" kv="1"/>
</actuator></mujoco>"""
SCALES = Scales(1.0, 1.0, 1.0, 0.01, "hinge")


def simulator(*names: str) -> MujocoSimulator:
    return MujocoSimulator(TWO_SERVOS, ParameterSpace({name: Parameter(0.0, 100.0) for name in names}), threads=1)


def test_an_effect_that_brings_an_actuator_along_is_not_matched() -> None:
    arm = simulator("actuator.*.kp")
    loaded = arm.with_effect(EFFECTS["constant_load"].scaled("shoulder", SCALES))
    assert "constant_load@shoulder" in [loaded.model.actuator(i).name for i in range(loaded.model.nu)]
    fields = loaded.fields(torch.tensor([[30.0, 2.0]]).double().numpy())
    gains = {loaded.model.actuator(i).name: float(fields["actuator_gainprm"][0, i, 0]) for i in range(loaded.model.nu)}
    assert (gains["lift"], gains["bend"]) == (30.0, 30.0)
    assert gains["constant_load@shoulder"] == loaded.model.actuator("constant_load@shoulder").gainprm[0]


def test_what_the_model_is_made_to_carry_later_is_not_matched() -> None:
    arm = simulator("body.*.mass", "actuator.*.gear[0]")
    changed = arm.with_payload("lower", 0.7).with_columns(["xfrc.lower.2"])
    fields = changed.fields(torch.tensor([[3.0, 5.0]]).double().numpy())
    assert {changed.model.body(i).name: float(fields["body_mass"][0, i]) for i in range(1, changed.model.nbody)} == {
        "upper": 3.0,
        "lower": 3.0,
        "payload@lower": pytest.approx(0.7),
    }
    gears = {changed.model.actuator(i).name: float(fields["actuator_gear"][0, i, 0]) for i in range(changed.model.nu)}
    assert gears == {"lift": 5.0, "bend": 5.0, "xfrc.lower.2": 0.0}


def test_the_numbers_of_what_effects_add_are_not_the_models_own() -> None:
    arm = simulator("joint.*.damping")
    grown = arm.with_effect(EFFECTS["constant_load"].scaled("shoulder", SCALES))
    grown = grown.with_effect(EFFECTS["payload"].scaled("tip", SCALES))
    assert grown.own_numbers == arm.own_numbers
    assert not [name for name in grown.own_numbers if "@" in name or name.endswith(".damping")]


def test_a_variant_keeps_what_a_glob_stands_for() -> None:
    arm = simulator("actuator.*.kp").with_effect(EFFECTS["constant_load"].scaled("shoulder", SCALES))
    for variant in (
        arm.with_timestep(0.001),
        arm.with_runge_kutta(),
        arm.with_worlds(3),
        arm.with_gravity_compensation(),
    ):
        assert variant is not None
        assert variant.parameters.names == arm.parameters.names
        assert variant.nominal[0] == 20.0


def test_a_glob_that_matches_nothing_of_the_users_is_refused() -> None:
    with pytest.raises(BadInput, match="no actuator that matches 'grip\\*'"):
        simulator("actuator.grip*.kp")
    spec = mujoco.MjSpec.from_string(TWO_SERVOS)
    assert MujocoSimulator(spec, ParameterSpace({"actuator.b*.kp": Parameter(0.0, 50.0)}), threads=1).nominal == 20.0
