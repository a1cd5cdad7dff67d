"""The eight rigs, by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from envs.rigs.machines.cart_pole import CART_POLE
from envs.rigs.machines.position_servo import POSITION_SERVO
from envs.rigs.machines.pushed_block import PUSHED_BLOCK
from envs.rigs.machines.six_joint_arm import SIX_JOINT_ARM
from envs.rigs.machines.slide_drive import SLIDE_DRIVE
from envs.rigs.machines.swing import SWING
from envs.rigs.machines.thrown_ball import THROWN_BALL
from envs.rigs.machines.two_link_arm import TWO_LINK_ARM
from envs.rigs.rig import Rig

RIGS: Mapping[str, Rig] = MappingProxyType(
    {
        rig.name: rig
        for rig in (
            SLIDE_DRIVE,
            SWING,
            CART_POLE,
            TWO_LINK_ARM,
            SIX_JOINT_ARM,
            POSITION_SERVO,
            PUSHED_BLOCK,
            THROWN_BALL,
        )
    }
)
