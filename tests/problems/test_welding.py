"""A welded body loses what its joint moved and measured; what another joint needs is refused."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import pytest

from onlinebayes.problems.welding import weld
from onlinebayes.runs import BadInput

HAND = """<mujoco><worldbody><body name="arm"><joint name="arm" axis="0 1 0"/><geom size=".1"/>
<body name="left" pos=".2 0 0"><joint name="left" type="slide"/><geom size=".02"/></body>
<body name="right" pos=".2 .1 0"><joint name="right" type="slide"/><geom size=".02"/></body></body></worldbody>
<tendon><fixed name="split"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
<equality><joint joint1="left" joint2="right"/></equality>
<actuator><motor name="arm" joint="arm"/><position name="grip" tendon="split" kp="9"/><motor joint="left"/></actuator>
<sensor><jointpos name="arm" joint="arm"/><tendonpos name="width" tendon="split"/><jointpos joint="right"/>
<actuatorfrc name="force" actuator="grip"/></sensor>
<keyframe><key name="home" qpos=".1 0 0" ctrl="0 0 0"/></keyframe></mujoco>"""


def welded(*bodies: str, model: str = HAND) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(model)
    weld(spec, bodies)
    return spec.compile()


def _left(model: mujoco.MjModel) -> tuple[Sequence[str], ...]:
    joints = [model.joint(j).name for j in range(model.njnt)]
    actuators = [model.actuator(a).name for a in range(model.nu)]
    return joints, actuators, [model.sensor(s).name for s in range(model.nsensor)]


def test_a_gripper_goes_with_all_that_moves_and_measures_it() -> None:
    model = welded("left", "right")
    assert _left(model) == (["arm"], ["arm"], ["arm"])
    assert (model.neq, model.ntendon, model.nkey) == (0, 0, 0)


def test_nothing_to_weld_changes_nothing() -> None:
    model = welded()
    assert (model.njnt, model.nu, model.nsensor, model.nkey) == (3, 3, 4, 1)


def test_half_of_a_pair_is_refused() -> None:
    with pytest.raises(BadInput, match=r"body 'left' cannot lose its joint 'left', which .* ties to 'right'"):
        welded("left")


def test_what_hangs_on_bodies_and_sites_stays() -> None:
    more = """<equality><weld body1="arm"/></equality><sensor><framepos objtype="body" objname="left"/></sensor>"""
    model = welded("left", "right", model=HAND.replace("<keyframe>", f"{more}<keyframe>"))
    assert (model.neq, model.nsensor) == (1, 2)


def test_a_nameless_free_base_goes() -> None:
    dog = """<mujoco><worldbody><body name="base"><freejoint/><geom size=".1"/><body><joint name="hip"/>
    <geom size=".1"/></body></body></worldbody><actuator><motor joint="hip"/></actuator></mujoco>"""
    assert _left(welded("base", model=dog))[:2] == (["hip"], ["actuator0"])
