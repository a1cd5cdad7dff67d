"""Every task names the columns of what is seen and done, as many as there are."""

from __future__ import annotations

import pytest
from torchrl.data import Categorical, OneHot

from envs.acrobot import AcrobotTask
from envs.cartpole import CartPoleTask
from envs.driven_pendulum import BalanceTask
from envs.egocentric.battery_log import BatteryLog
from envs.hopper import HopperTask
from envs.mountain_car import MountainCarContinuousTask, MountainCarTask
from envs.pendulum import PendulumTask
from envs.reach import ReachTask
from envs.skid_steer import CircleTask
from envs.swing_up import SwingUpTask
from onlinebayes.simulators import Task

TASKS = (
    AcrobotTask, BalanceTask, BatteryLog, CartPoleTask, CircleTask, HopperTask, MountainCarContinuousTask,
    MountainCarTask, PendulumTask, ReachTask, SwingUpTask,
)  # fmt: skip


def check_channels(task: Task) -> None:
    sizes = dict(task.observation_sizes) or {"observation": task.observation_size}
    discrete = isinstance(task.action_spec, OneHot | Categorical)
    sizes["action"] = task.action_spec.space.n if discrete else task.action_spec.shape[-1]
    assert {key: len(names) for key, names in task.channels.items()} == sizes


@pytest.mark.parametrize("kind", TASKS)
def test_columns_are_named(kind: type[Task]) -> None:
    check_channels(kind())


@pytest.mark.parametrize("scene", ["reach", "push"])
def test_columns_of_the_fetch_arm_are_named(scene: str) -> None:
    pytest.importorskip("gymnasium_robotics")
    from onlinebayes.parameters import ParameterSpace
    from recipes.fetch import fetch

    check_channels(fetch(scene, ParameterSpace({})).exact.task)
