"""What TorchRL's users expect of an environment: goals, seeds, copies, checkpoints, one line for bad input."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import gymnasium
import pytest
import torch
from tensordict import TensorDict
from torch import nn
from torchrl.data import Bounded
from torchrl.envs import GymWrapper, RewardSum, StepCounter, TransformedEnv, check_env_specs

from envs.driven_pendulum import MODEL, BalanceTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.runs.checkpoints import plain
from onlinebayes.simulators import GoalTask, SimulatorEnv, Task
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.transforms import ParameterRandomization, SensorNoise

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})


def pendulum(worlds: int = 5) -> SimulatorEnv:
    return SimulatorEnv(Pendulum(SPACE, worlds), PendulumTask(horizon=20))


def mujoco(worlds: int = 5) -> SimulatorEnv:
    space = ParameterSpace({"body.bob.mass": Parameter(0.2, 0.7, "kg")})
    simulator = MujocoSimulator(MODEL, space, worlds, 0.02, threads=1)
    return SimulatorEnv(
        simulator.with_effect(ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))), BalanceTask(seconds=0.5)
    )


MAKE = [pendulum, mujoco]


class TurnTo(Task):
    """Turn the pendulum to an angle that differs by episode."""

    observation_sizes = {"observation": 3, "achieved_goal": 1, "desired_goal": 1}  # noqa: RUF012
    goal_size = 1
    horizon = 10
    action_spec = Bounded(-2.0, 2.0, (1,), dtype=torch.float32)

    def start(self, theta, generator):
        goal = 2 * torch.rand(len(theta), 1, generator=generator, dtype=theta.dtype)
        zero = torch.zeros(len(theta), 1, dtype=theta.dtype)
        return TensorDict({"qpos": zero, "qvel": zero, "task": {"goal": goal}}, batch_size=(len(theta),))

    def observe(self, state):
        angle, rate = state["qpos"], state["qvel"]
        seen = torch.cat([angle.cos(), angle.sin(), rate], -1)
        values = {"observation": seen, "achieved_goal": angle, "desired_goal": state["task", "goal"]}
        return {key: value.float() for key, value in values.items()}

    def command(self, action):
        return action

    def reward(self, state, action, after):
        return self.goal_reward(after["qpos"], after["task", "goal"])

    def goal_reward(self, achieved, desired):
        return self.success(achieved, desired).double() - 1

    def success(self, achieved, desired):
        return (achieved - desired).abs().squeeze(-1) < 0.05

    def terminated(self, state):
        return torch.zeros(state.batch_size, dtype=torch.bool)


def test_goals_are_observed_stay_within_an_episode_and_change_with_it() -> None:
    env = SimulatorEnv(Pendulum(SPACE, 6), TurnTo())
    check_env_specs(env)
    assert isinstance(env.task, GoalTask)
    data = env.rollout(25, break_when_any_done=False)
    goal = data["desired_goal"].squeeze(-1)
    for begin in (0, 10):
        assert (goal[:, begin : begin + 10] == goal[:, begin : begin + 1]).all()
    assert (goal[:, 9] != goal[:, 10]).all()
    again = env.task.goal_reward(data["next", "achieved_goal"].double(), data["next", "desired_goal"].double())
    assert torch.equal(again.float(), data["next", "reward"].squeeze(-1))
    reached = env.task.goal_reward(data["next", "achieved_goal"], data["next", "achieved_goal"])
    assert (reached == 0).all(), "another goal, another reward"


def test_keys_are_arguments() -> None:
    env = SimulatorEnv(Pendulum(SPACE, 3), PendulumTask(), observation_key="seen", theta_key=("world", "theta"))
    check_env_specs(env)
    drawn = ParameterRandomization(BoxUniform(SPACE), theta_key=("world", "theta"))
    data = TransformedEnv(env, drawn).rollout(3)
    assert data["seen"].shape == (3, 3, 3)
    assert len(data["world", "theta"][:, 0].unique(dim=0)) == 3


@pytest.mark.parametrize("make", MAKE)
def test_an_environment_goes_on_from_its_state_to_the_last_bit(make: Callable[..., SimulatorEnv]) -> None:
    def whole() -> TransformedEnv:
        drawn = ParameterRandomization(BoxUniform(made.simulator.parameters))
        return TransformedEnv(made, drawn)

    made = make()
    env = whole()
    env.rollout(13, break_when_any_done=False)
    state = plain({"env": made.get_extra_state(), "random": torch.get_rng_state()})
    carried = env.rollout(4, auto_reset=True)[:, -1]["next"].exclude("reward")
    first = env.rollout(40, auto_reset=False, tensordict=carried.clone(), break_when_any_done=False)
    # The same again: back to the state, forward by the same steps.
    made = make()
    env = whole()
    env.rollout(3, break_when_any_done=False)
    made.set_extra_state(state["env"])
    torch.set_rng_state(state["random"])
    env.rollout(4, auto_reset=True)
    second = env.rollout(40, auto_reset=False, tensordict=carried.clone(), break_when_any_done=False)
    assert (first == second).all()
    with pytest.raises(BadInput, match="build it as it was"):
        make(worlds=2).set_extra_state(state["env"])


@pytest.mark.parametrize("make", MAKE)
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_and_pickles_stand_where_the_original_does_and_go_their_own_way(make, copied) -> None:
    env = make()
    start = env.reset()
    other = copied(env)
    before = other.simulator.state.clone()
    torch.manual_seed(5)
    first = env.rollout(6, auto_reset=False, tensordict=start.clone())
    assert (other.simulator.state == before).all(), "the copy stays where it is"
    torch.manual_seed(5)
    second = other.rollout(6, auto_reset=False, tensordict=start.clone())
    assert (first == second).all()
    assert torch.equal(env.reset()["observation"], other.reset()["observation"]), "and draws the same next start"


def test_a_seed_decides_starts_and_parameters() -> None:
    def first(seed: int) -> TensorDict:
        env = TransformedEnv(pendulum(), ParameterRandomization(BoxUniform(SPACE)))
        torch.rand(3)
        env.set_seed(seed)
        return env.reset()

    one, two, other = first(1), first(1), first(2)
    assert torch.equal(one["theta"], two["theta"])
    assert torch.equal(one["observation"], two["observation"])
    assert not torch.equal(one["theta"], other["theta"])
    before = torch.get_rng_state()
    TransformedEnv(pendulum(), ParameterRandomization(BoxUniform(SPACE))).set_seed(3)
    assert torch.equal(before, torch.get_rng_state())


@pytest.mark.parametrize("value", [-1.0, float("nan"), 5.0])
def test_theta_outside_its_bounds_is_refused_for_the_worlds_that_reset(value: float) -> None:
    env = pendulum()
    theta = torch.full((5, 2), 0.5).double()
    theta[2, 1] = value
    with pytest.raises(BadInput, match=r"mass = .* it must lie in \[0.1, 1\]"):
        env.reset(TensorDict({"theta": theta}, [5]))
    env.reset()
    others = torch.tensor([[True], [True], [False], [True], [True]])
    env.reset(TensorDict({"theta": theta, "_reset": others}, [5]))


def test_an_environment_that_would_ignore_theta_is_refused() -> None:
    env = TransformedEnv(GymWrapper(gymnasium.make("Pendulum-v1")), ParameterRandomization(BoxUniform(SPACE)))
    with pytest.raises(BadInput, match="GymWrapper does not read 'theta' at reset"):
        env.reset()


def test_a_task_that_disagrees_with_itself_is_told_in_one_line() -> None:
    class Wide(PendulumTask):
        observation_size = 4

    class Column(PendulumTask):
        def reward(self, state, action, after):
            return super().reward(state, action, after).unsqueeze(-1)

    with pytest.raises(BadInput, match=r"Wide.observe gave .*\(5, 3\).* the task says .*\(5, 4\)"):
        SimulatorEnv(Pendulum(SPACE, 5), Wide()).reset()
    with pytest.raises(BadInput, match=r"Column.reward gave shape \(5, 1\)"):
        SimulatorEnv(Pendulum(SPACE, 5), Column()).rollout(2)


def test_torchrls_own_transforms_stand_around_ours() -> None:
    env = TransformedEnv(pendulum(), ParameterRandomization(BoxUniform(SPACE)))
    for transform in (SensorNoise(torch.tensor([0.01, 0.01, 0.1])), RewardSum(), StepCounter()):
        env.append_transform(transform)
    check_env_specs(env)
    data = env.rollout(30, break_when_any_done=False)
    torch.testing.assert_close(data["next", "episode_reward"][:, 19], data["next", "reward"][:, :20].sum(1))
    assert data["next", "step_count"].max() == 20
    assert isinstance(env.transform, nn.Module)
