"""The skid-steered robot: its kinematics against arcs that are known, its circle, and the contracts of both."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict

from envs.skid_steer import MAX_WHEEL_SPEED, PHYSICAL, CircleTask, SkidSteerKinematics
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Drawable, SimulatorEnv
from onlinebayes.simulators.testing import check_engine, check_env

NAMES = tuple(PHYSICAL)


def drive(command: list[list[float]], dt: float = 0.1, **theta: float) -> TensorDict:
    """The robot's states (T,) from the origin under commands (T, 2)."""
    robot = SkidSteerKinematics(NAMES, dt=dt)
    values = PHYSICAL.vector({"radius": 0.1, "axial_distance": 0.5, "x_icr": 0.0} | theta)[None]
    inputs = TensorDict({"command": torch.tensor([command], dtype=torch.float64)}, batch_size=(1, len(command)))
    times = dt * torch.arange(1, len(command) + 1)
    return robot.rollout(values, TensorDict({"qpos": torch.zeros(1, 3)}, [1]), inputs, times)[0]


def test_conformance() -> None:
    space = ParameterSpace({name: PHYSICAL[name] for name in NAMES})
    check_engine(SkidSteerKinematics(space), commands=2)
    check_engine(SkidSteerKinematics(("x_icr",)), commands=2)
    check_env(lambda: SimulatorEnv(SkidSteerKinematics(NAMES, worlds=4), CircleTask(horizon=8)))


def test_equal_wheels_drive_straight_and_opposite_ones_turn_about_the_icr() -> None:
    ahead = drive([[2.0, 2.0]] * 10)
    assert ahead["qpos"][-1].tolist() == pytest.approx([0.2, 0.0, 0.0])
    assert ahead["qvel"][-1].tolist() == pytest.approx([0.2, 0.0, 0.0])
    turned = drive([[1.0, -1.0]] * 20_000, dt=1e-3, x_icr=0.3)
    yaw = turned["qpos"][:, 2]
    assert float(yaw[-1]) == pytest.approx(0.4 * 20)
    ahead_of_it = turned["qpos"][:, :2] + 0.3 * torch.stack((yaw.cos(), yaw.sin()), -1)
    assert (ahead_of_it - torch.tensor([0.3, 0.0])).norm(dim=-1).max() < 1e-3  # it stays where it is


def test_the_wheels_have_a_limit_and_each_side_its_own_command() -> None:
    assert torch.equal(drive([[9.0, -9.0]])["qpos"], drive([[MAX_WHEEL_SPEED, -MAX_WHEEL_SPEED]])["qpos"])
    assert float(drive([[1.0, 0.0]])["qpos"][0, 2]) > 0  # the right wheels alone turn it to the left


def test_a_command_held_for_several_steps_and_one_that_is_no_number() -> None:
    robot, theta = SkidSteerKinematics(NAMES), SkidSteerKinematics(NAMES).nominal[None]
    start = TensorDict({"qpos": torch.zeros(1, 3)}, [1])
    command = torch.tensor([[[3.0, 1.0], [1.0, 2.0]]])
    held = robot.rollout(theta, start, TensorDict({"command": command}, [1, 2]), torch.tensor([0.3, 0.4]))
    each = command[:, [0, 0, 0, 1]]
    every = robot.rollout(theta, start, TensorDict({"command": each}, [1, 4]), 0.1 * torch.arange(1, 5))
    assert torch.equal(held["qpos"], every["qpos"][:, 2:])
    command[0, 1, 0] = torch.nan
    broken = robot.rollout(theta, start, TensorDict({"command": command}, [1, 2]), torch.tensor([0.3, 0.4]))
    assert broken["valid"].tolist() == [[True, False]]
    assert torch.equal(broken["qpos"][:, 1], held["qpos"][:, 0])


def test_cost_is_zero_on_the_circle_at_the_wanted_speed() -> None:
    task = CircleTask()
    pose = torch.tensor([[0.6, 0.8, 0.3], [0.0, 1.1, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64)
    speed = torch.tensor([[0.15, 5.0, 5.0], [0.15, 0.0, 0.0], [0.05, 0.0, 0.0]], dtype=torch.float64)
    state = TensorDict({"qpos": pose, "qvel": speed}, [3])
    assert task.cost(state).tolist() == pytest.approx([0.0, 0.1, 0.1])
    assert torch.equal(task.reward(state, torch.zeros(3, 2), state), -task.cost(state))


def test_the_wheels_speeds_that_belong_to_the_circle_keep_the_robot_on_it() -> None:
    """With x_icr = 0: v = (w_R + w_L) r / 2 = .15 and w = v / 1 m."""
    task, robot = CircleTask(), SkidSteerKinematics(NAMES)
    theta = PHYSICAL.vector({"radius": 0.0625, "axial_distance": 0.475, "x_icr": 0.0})[None]
    middle, half = 0.15 / 0.0625, 0.5 * 0.15 * 0.475 / 0.0625
    command = torch.tensor([middle + half, middle - half]).expand(1, 200, 2)
    start = task.start(theta, torch.Generator())
    path = robot.rollout(theta, start, TensorDict({"command": command}, [1, 200]), 0.1 * torch.arange(1, 201))
    assert float(path["qvel"][0, -1, 0]) == pytest.approx(0.15, rel=1e-6)
    assert float(task.cost(path).mean()) < 1e-3  # Euler steps of 10 Hz leave it by 7.5 mm a radian


def test_it_can_be_drawn() -> None:
    robot, task = SkidSteerKinematics(), CircleTask()
    assert isinstance(robot, Drawable)
    assert isinstance(task, Drawable)
    states = TensorDict({"qpos": torch.tensor([[1.0, 2.0, math.pi / 2]])}, [1])
    poses = robot.poses(robot.nominal, states)
    assert poses.shape == (1, len(robot.shapes(robot.nominal)), 7)
    assert poses[0, -1, :2].tolist() == pytest.approx([1.0, 2.2])  # the ICR lies .2 m ahead
    assert (poses[..., 3:].norm(dim=-1) - 1).abs().max() < 1e-6
    assert task.poses(robot.nominal, states).shape == (1, 1, 7)


def test_refusals() -> None:
    with pytest.raises(BadInput, match="unknown"):
        SkidSteerKinematics(("mass",))
    with pytest.raises(BadInput, match="dt = 0"):
        SkidSteerKinematics(dt=0.0)
    with pytest.raises(BadInput, match="worlds = 0"):
        SkidSteerKinematics(worlds=0)


@pytest.mark.gpu
def test_on_a_gpu_it_gives_what_the_cpu_gives() -> None:
    robot, theta = SkidSteerKinematics(NAMES), SkidSteerKinematics(NAMES).nominal.expand(5, -1)
    command, times = torch.randn(5, 30, 2, dtype=torch.float64), 0.1 * torch.arange(1, 31)
    state, inputs = TensorDict({"qpos": torch.zeros(5, 3)}, [5]), TensorDict({"command": command}, [5, 30])
    there = SkidSteerKinematics(NAMES, device="cuda").rollout(theta, state, inputs, times)
    assert there.device is not None
    torch.testing.assert_close(there["qpos"].cpu(), robot.rollout(theta, state, inputs, times)["qpos"])
