"""Gymnasium-Robotics' own Fetch environments, to be compared with.

Version 1.4.2 compares numbers of the model with MuJoCo's enums, which from MuJoCo 3.12 on are no longer equal to
numbers; while :func:`environments` is entered, it is shown numbers in their place.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import mujoco


class _Loose:
    """The engine, with numbers for the members of its enums."""

    def __getattr__(self, name: str) -> Any:
        found = getattr(mujoco, name)
        if not hasattr(found, "__members__"):
            return found
        return SimpleNamespace(**{member: int(value) for member, value in found.__members__.items()})


@contextmanager
def environments() -> Iterator[dict[str, type]]:
    """Name of a task -> its environment's class."""
    from gymnasium_robotics.envs.fetch import push, reach, slide
    from gymnasium_robotics.utils import mujoco_utils

    before, mujoco_utils.mujoco = mujoco_utils.mujoco, _Loose()
    try:
        yield {
            "reach": reach.MujocoFetchReachEnv,
            "push": push.MujocoFetchPushEnv,
            "slide": slide.MujocoFetchSlideEnv,
        }
    finally:
        mujoco_utils.mujoco = before
