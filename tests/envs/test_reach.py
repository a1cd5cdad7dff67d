"""The reach task: its kinematics, its goals, what is asked of a task with goals, and what hindsight is worth."""

from __future__ import annotations

import mujoco
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs.utils import ExplorationType, check_env_specs, set_exploration_type

from envs.reach import MODEL, PHYSICAL, ReachTask, arm, fingertip
from envs.reach.task import AWAY, START
from onlinebayes.objectives import DDPGSettings, Hindsight, ddpg
from onlinebayes.simulators import Drawable, GoalTask, SimulatorEnv
from onlinebayes.simulators.testing import check_simulator


def env(worlds: int, seed: int = 0) -> SimulatorEnv:
    return SimulatorEnv(arm(worlds=worlds, threads=1), ReachTask(), seed=seed)


def servo(seen: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
    """A controller that knows the kinematics: damped least squares towards the goal, then high gain."""
    q = torch.atan2(seen[..., 3:6], seen[..., :3]).double()
    jacobian = torch.func.vmap(torch.func.jacrev(fingertip))(q)
    away = goal.double() - fingertip(q)
    squared = jacobian.mT @ jacobian + 1e-4 * torch.eye(3, dtype=torch.float64)
    turn = torch.linalg.solve(squared, (jacobian.mT @ away[..., None])).squeeze(-1)
    return (10 * turn).clamp(-1, 1).float()


def test_conformance() -> None:
    simulator = arm()
    check_simulator(simulator)
    assert bool(PHYSICAL.contains(simulator.nominal))
    assert simulator.commands == ("yaw", "shoulder", "elbow")


def test_the_environment_is_one_with_goals() -> None:
    made = env(4)
    check_env_specs(made)
    assert isinstance(made.task, GoalTask)
    assert isinstance(made.task, Drawable)
    assert isinstance(made.simulator, Drawable)
    data = made.rollout(60, break_when_any_done=False)
    assert data["next", "truncated"].squeeze(-1).nonzero()[:, 1].tolist() == [49] * 4
    assert not data["next", "terminated"].any()
    for begin, end in ((0, 50), (50, 60)):
        goal = data["desired_goal"][:, begin:end]
        assert (goal == goal[:, :1]).all()
    assert (data["desired_goal"][:, 49] != data["desired_goal"][:, 50]).any(-1).all()


def test_the_fingertip_is_where_mujoco_has_it() -> None:
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    for qpos in 2 * torch.randn(20, 3, dtype=torch.float64):
        data.qpos[:] = qpos.numpy()
        mujoco.mj_kinematics(model, data)
        torch.testing.assert_close(fingertip(qpos), torch.as_tensor(data.site("tip").xpos))


def test_the_reward_can_be_asked_again_for_any_goal() -> None:
    made = env(50)
    policy = TensorDictModule(servo, ["observation", "desired_goal"], ["action"])
    after = made.rollout(50, policy)["next"]
    again = made.task.goal_reward(after["achieved_goal"], after["desired_goal"])
    assert torch.equal(again, after["reward"].squeeze(-1))
    assert set(again.unique().tolist()) == {-1.0, 0.0}
    assert (made.task.goal_reward(after["achieved_goal"], after["achieved_goal"]) == 0).all()
    other = after["desired_goal"].roll(1, 0)
    near = (after["achieved_goal"] - other).norm(dim=-1) < 0.025
    assert torch.equal(made.task.success(after["achieved_goal"], other), near)
    assert torch.equal(made.task.goal_reward(after["achieved_goal"], other), near.float() - 1)


def test_starts_are_one_posture_with_goals_all_around_and_none_at_the_fingertip() -> None:
    task, theta = ReachTask(), torch.zeros(4000, 8, dtype=torch.float64)
    start, again = (task.start(theta, torch.Generator().manual_seed(7)) for _ in range(2))
    assert (start == again).all()
    assert (start["qpos"] == theta.new_tensor(START)).all()
    assert (start["qvel"] == 0).all()
    goal, tip = start["task", "goal"], fingertip(start["qpos"])
    away = goal - tip
    assert away.norm(dim=-1).min() >= AWAY
    assert goal[:, 2].min() > 0, "above the floor"
    sides = (away > 0).long() @ torch.tensor([1, 2, 4])
    assert (torch.bincount(sides, minlength=8) > 40).all(), "in each of the eight directions"
    # Yaw is uniform: the mean of 4000 is within five standard errors, 0.06, but once in a million seeds.
    assert torch.atan2(goal[:, 1], goal[:, 0]).mean().abs() < 0.06


def test_a_batch_equals_single_worlds() -> None:
    many, action = env(3), 2 * torch.rand(3, 10, 3) - 1
    goal = many.reset()["desired_goal"].double()
    seen = torch.stack([many.step(TensorDict({"action": action[:, k]}, [3]))["next"] for k in range(10)], dim=1)
    task, simulator = many.task, arm(threads=1)
    for world in range(3):
        start = TensorDict({"qpos": torch.tensor([START]).double()}, [1]).set("qvel", torch.zeros(1, 3).double())
        simulator.reset(simulator.nominal[None], start)
        for k in range(10):
            command = task.command(action[world : world + 1, k])
            state = simulator.step(TensorDict({"command": command}, [1])).set("task", {"goal": goal[world : world + 1]})
            for key, value in task.observe(state).items():  # a cosine of several numbers may be rounded differently
                torch.testing.assert_close(seen[key][world, k], value[0], atol=1e-6, rtol=0)


@pytest.mark.usefixtures("without_shape_checks")
def test_every_goal_can_be_reached_and_kept_and_chance_does_not_meet_it() -> None:
    made = env(300)
    reward = made.rollout(50)["next", "reward"].squeeze(-1)
    assert (reward == 0).any(-1).float().mean() < 0.03  # 0.003; ten in 300 once in 10^7 seeds
    last = made.rollout(50, TensorDictModule(servo, ["observation", "desired_goal"], ["action"]))[:, -10:]
    assert (last["next", "reward"] == 0).all()


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("hindsight", [True, False])
def test_hindsight_solves_it_and_the_same_without_does_not(hindsight: bool) -> None:
    made, test = env(32, seed=1), env(200, seed=2)
    objective = ddpg(
        made.observation_spec_unbatched,
        made.action_spec_unbatched,
        DDPGSettings(widths=(128, 128), gamma=0.95, value_range=(-20.0, 0.0), action_penalty=0.1, frames_per_update=8),
        in_keys=("observation", "desired_goal"),
        hindsight=Hindsight(made.task.goal_reward) if hindsight else None,
    )
    collector = Collector(
        made, objective.policy, frames_per_batch=1600, total_frames=40_000, auto_register_policy_transforms=False
    )
    for data in collector:
        objective.update(data)
    collector.shutdown()
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        last = test.rollout(50, objective.policy)[:, -1]
    success = test.task.success(last["next", "achieved_goal"], last["next", "desired_goal"]).float().mean()
    assert success >= 0.9 if hindsight else success < 0.3
