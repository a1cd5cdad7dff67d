"""Whether anything can touch is asked right: what the engine finds touching, and what it never will."""

import mujoco
import numpy as np
import pytest

from onlinebayes.simulators.mujoco.collisions import can_touch
from onlinebayes.simulators.mujoco.model import batch_model

LINK = """<body pos="0 0 {up}"><joint axis="0 1 0"/><geom type="sphere" size=".3" mass="1" {masks}/>{inside}</body>"""


def chain(links: int, masks: str = "", rest: str = "", option: str = "") -> mujoco.MjModel:
    """Links of one hinge each that overlap with their neighbours."""
    inside = ""
    for _ in range(links):
        inside = LINK.format(up=0.2, masks=masks, inside=inside)
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{rest}{inside}</worldbody></mujoco>")


FLOOR = '<geom type="plane" size="1 1 .1"/>'


@pytest.mark.parametrize(
    ("model", "touching"),
    [
        (chain(1), False),
        (chain(2), False),
        (chain(3), True),
        (chain(3, 'contype="0" conaffinity="0"'), False),
        (chain(3, 'contype="2" conaffinity="4"'), False),
        (chain(3, 'contype="2" conaffinity="2"'), True),
        (chain(1, rest=FLOOR), True),
        (chain(1, 'contype="0" conaffinity="0"', FLOOR), False),
        (chain(1, 'contype="0"', FLOOR), True),
        (chain(2, option='<option><flag filterparent="disable"/></option>'), True),
    ],
)
def test_what_touches_can_touch(model: mujoco.MjModel, touching: bool) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (data.ncon > 0) == touching
    assert can_touch(model) == touching


def test_what_is_excluded_cannot_touch() -> None:
    names = '<body name="{0}"><joint axis="0 1 0"/><geom size=".3"/></body>'
    bodies = names.format("a") + names.format("b")
    exclude = '<contact><exclude body1="b" body2="a"/></contact>'
    for contact, touching in (("", True), (exclude, False)):
        text = f"<mujoco><worldbody>{bodies}</worldbody>{contact}</mujoco>"
        assert can_touch(mujoco.MjModel.from_xml_string(text)) == touching


def test_a_pair_by_name_can_touch() -> None:
    text = """<mujoco><worldbody><body><joint/><geom name="a" size=".1"/></body>
    <geom name="b" size=".1" contype="0" conaffinity="0"/></worldbody>
    <contact><pair geom1="a" geom2="b"/></contact></mujoco>"""
    assert can_touch(mujoco.MjModel.from_xml_string(text))


def test_not_looking_for_contacts_changes_no_bit() -> None:
    model = chain(2)
    model.dof_damping[:] = 0.1
    given, unlooked = mujoco.MjData(model), mujoco.MjData(model)
    without = batch_model(model)
    assert without.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    assert not batch_model(chain(3)).opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    for data in (given, unlooked):
        data.qvel[:] = (1.0, -2.0)
    for _ in range(500):
        mujoco.mj_step(model, given)
        mujoco.mj_step(without, unlooked)
    assert np.array_equal(given.qpos, unlooked.qpos)
    assert np.array_equal(given.qvel, unlooked.qvel)


STUCK = """<body pos="0 0 .2"><joint axis="0 1 0" frictionloss=".3" range="-20 20" limited="true"/>
<geom type="sphere" size=".05" mass="1" pos=".1 0 0"/>{inside}</body>"""


def tree_with_every_constraint() -> mujoco.MjModel:
    """Three links with dry friction, narrow stops and a floor in reach."""
    inside = ""
    for _ in range(3):
        inside = STUCK.format(inside=inside)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="1 1 .1" pos="0 0 .35"/>{inside}</worldbody></mujoco>'
    )


def test_not_looking_for_islands_in_one_tree_changes_no_bit() -> None:
    model = tree_with_every_constraint()
    without = batch_model(model)
    assert without.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
    two_trees = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{STUCK.format(inside='')}{STUCK.format(inside='')}</worldbody></mujoco>"
    )
    assert not batch_model(two_trees).opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
    given, unlooked, kinds = mujoco.MjData(model), mujoco.MjData(model), set()
    for data in (given, unlooked):
        data.qvel[:] = (3.0, -5.0, 4.0)
    for _ in range(500):
        mujoco.mj_step(model, given)
        mujoco.mj_step(without, unlooked)
        kinds |= set(given.efc_type.tolist())
    assert len(kinds) == 3  # dry friction, stops and contacts did act
    assert np.array_equal(given.qpos, unlooked.qpos)
    assert np.array_equal(given.qvel, unlooked.qvel)
