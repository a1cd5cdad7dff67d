"""The model's own numbers as parameters: which there are, how far they may be off, and what freeing one does."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator

ARM = """
<mujoco><worldbody>
  <body name="arm"><joint name="hinge" type="hinge" axis="0 1 0" damping="0.3" frictionloss="0.1"/>
    <inertial pos="0 0 -0.2" mass="2" diaginertia="0.02 0.02 0.001"/></body>
</worldbody><actuator>
  <motor name="motor" joint="hinge" gear="5"/><position name="servo" joint="hinge" kp="40"/>
</actuator></mujoco>"""
MASS = ParameterSpace({"body.arm.mass": Parameter(1.0, 3.0, "kg")})


def test_numbers_that_are_something_and_not_free_already_are_listed_around_their_values() -> None:
    simulator = MujocoSimulator(ARM, MASS)
    found = simulator.own_numbers
    assert {"body.arm.ipos[2]", "body.arm.inertia[0]", "joint.hinge.damping", "joint.hinge.frictionloss"} <= set(found)
    assert {"actuator.motor.gear[0]", "actuator.servo.kp"} <= set(found)
    assert not {"body.arm.mass", "joint.hinge.stiffness", "joint.hinge.armature", "actuator.motor.kp"} & set(found)
    for name, bounds in found.items():
        own = float(simulator.with_free(name, bounds).nominal[-1])
        assert bounds.low <= own <= bounds.high, name
    assert found["joint.hinge.damping"].low == 0.0  # what the machine lacks can be taken away


def test_a_freed_number_comes_after_the_models_other_parameters_and_before_effects() -> None:
    friction = DryFriction("hinge", Parameter(0.0, 1.0, "N m"))
    simulator = MujocoSimulator(ARM, MASS).with_effect(friction)
    free = simulator.with_free("body.arm.ipos[2]", simulator.own_numbers["body.arm.ipos[2]"])
    assert free.parameters.names == ("body.arm.mass", "body.arm.ipos[2]", "dry_friction@hinge.frictionloss")
    theta = torch.tensor([2.0, -0.25, 0.0], dtype=torch.float64)
    assert free.export(theta).body("arm").ipos[2] == pytest.approx(-0.25)


def test_what_is_free_already_is_refused_in_one_line() -> None:
    with pytest.raises(BadInput, match="is a parameter already"):
        MujocoSimulator(ARM, MASS).with_free("body.arm.mass", MASS["body.arm.mass"])
