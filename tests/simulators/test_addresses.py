from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import NATIVE, MujocoSimulator, pseudo_inertia
from onlinebayes.simulators.mujoco.addresses import resolve
from onlinebayes.simulators.mujoco.fields import FIELDS, SPEC
from tests.simulators.models import ARM, SLIDE, TUMBLER


@pytest.fixture(scope="module")
def arm() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(ARM)


def _written(xml: str, name: str, values: list[float]) -> dict[str, np.ndarray]:
    space = ParameterSpace({name: Parameter(-100.0, 100.0)})
    return MujocoSimulator(xml, space).fields(np.array(values)[:, None])


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [
        ("body.upper.mass", 1.5, "kg"),
        ("joint.elbow.damping", 0.2, "N m s/rad"),
        ("joint.elbow.damping[0]", 0.2, "N m s/rad"),
        ("joint.elbow.springref", math.radians(20), "rad"),
        ("joint.elbow.stiffness", 1.5, "N m/rad"),
        ("joint.shoulder.range[1]", math.radians(150), "rad"),
        ("geom.floor.friction[0]", 1.0, ""),
        ("actuator.lift.gear", 12.0, ""),
        ("actuator.bend.kp", 8.0, ""),
        ("actuator.bend.kv", 0.6, ""),
        ("actuator.bend.forcerange[0]", -6.0, ""),
        ("tendon.cord.stiffness", 0.5, ""),
        ("sensor.reading.noise", 0.01, ""),
        ("site.tip.pos[0]", 0.9, "m"),
        ("option.gravity[2]", -9.81, "m/s2"),
        ("option.density", 0.0, "kg/m3"),
    ],
)
def test_reads_the_files_own_value(arm: mujoco.MjModel, name: str, value: float, unit: str) -> None:
    address = resolve(arm, name)
    assert address.read(arm) == pytest.approx(value)
    assert address.unit == unit


def test_units_of_a_slide() -> None:
    assert resolve(mujoco.MjModel.from_xml_string(SLIDE), "joint.rail.damping").unit == "N s/m"


def test_kp_sets_gain_and_bias_together(arm: mujoco.MjModel) -> None:
    fields = _written(ARM, "actuator.bend.kp", [3.0, 5.0])
    i = arm.actuator("bend").id
    assert fields["actuator_gainprm"][:, i, 0].tolist() == [3.0, 5.0]
    assert fields["actuator_biasprm"][:, i, 1].tolist() == [-3.0, -5.0]
    assert fields["actuator_biasprm"][:, i, 2].tolist() == [-0.6, -0.6]


def test_kv_of_a_velocity_servo_is_its_gain() -> None:
    xml = SLIDE.replace("<motor ", '<velocity kv="4" ')
    model = mujoco.MjModel.from_xml_string(xml)
    assert resolve(model, "actuator.motor.kv").read(model) == 4.0
    fields = _written(xml, "actuator.motor.kv", [9.0])
    assert fields["actuator_gainprm"][0, 0, 0] == 9.0
    assert fields["actuator_biasprm"][0, 0, 2] == -9.0


def test_damping_of_a_ball_joint_is_that_of_all_its_dofs() -> None:
    fields = _written(TUMBLER, "joint.ball.damping", [1.0, 2.0])
    assert fields["dof_damping"].tolist() == [[0.0] * 6 + [1.0] * 3, [0.0] * 6 + [2.0] * 3]


def test_names_may_contain_dots() -> None:
    model = mujoco.MjModel.from_xml_string(SLIDE.replace('"rail"', '"left.rail"'))
    assert resolve(model, "joint.left.rail.armature").read(model) == 0.0


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("joint.elbw.damping", "nearest: elbow"),
        ("joint.elbow.dampin", r"nearest: 'joint\.elbow\.damping'"),
        ("joints.elbow.damping", "nearest: joint"),
        ("body.upper.inertial", r"has 10 values"),
        ("option.timestep", "all worlds share one timestep"),
        ("option.gravty", "nearest: 'option.gravity'"),
        ("geom.floor.friction", r"'geom\.floor\.friction\[0\]'"),
        ("geom.floor.friction[3]", "from 0 to 2"),
        ("joint.elbow.frictionloss[1]", "from 0 to 0"),
        ("joint.elbow", "malformed"),
        ("joint.elbow.damping[x]", "malformed"),
        ("damping", "starts with 'damping'"),
        ("actuator.lift.kp", "not a position servo"),
        ("actuator.lift.kv", "not a position or velocity servo"),
    ],
)
def test_says_what_is_wrong_and_what_is_near(arm: mujoco.MjModel, name: str, says: str) -> None:
    with pytest.raises(BadInput, match=says) as error:
        resolve(arm, name)
    assert "\n" not in str(error.value)


def test_every_field_can_be_exported() -> None:
    arrays = {column.array for fields in FIELDS.values() for columns in fields.values() for column in columns}
    arrays = arrays - {pseudo_inertia.ARRAY} | {*pseudo_inertia.FIELDS}
    assert arrays | {array for term in NATIVE.values() for array in term.fields} == set(SPEC)
