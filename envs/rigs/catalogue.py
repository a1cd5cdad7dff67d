"""The eight rigs, by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from envs.rigs.linked import CART_POLE, SIX_JOINT_ARM, TWO_LINK_ARM
from envs.rigs.rig import Rig
from envs.rigs.singles import POSITION_SERVO, PUSHED_BLOCK, SLIDE_DRIVE, SWING, THROWN_BALL

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
