"""The five classic systems equal Gymnasium's to 1e-6: one step from each state along 500, and 50 steps on their own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import gymnasium
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.acrobot import Acrobot, AcrobotTask
from envs.cartpole import CartPole, CartPoleTask
from envs.mountain_car import MountainCar, MountainCarContinuous, MountainCarContinuousTask, MountainCarTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.simulators import SimulatorEnv, Task, TorchSimulator

STEPS, FREE = 500, 50


@dataclass(frozen=True)
class Case:
    """One system: Gymnasium's name for it, ours, and Gymnasium's attribute behind each of our parameters."""

    id: str
    simulator: type[TorchSimulator]
    task: Task
    attributes: Mapping[str, str]
    changed: Mapping[str, float]
    single: bool = False  # whether Gymnasium keeps its state in single precision
    turns: tuple[int, ...] = field(default=())  # coordinates that Gymnasium wraps


CASES = [
    Case(
        "CartPole-v1",
        CartPole,
        CartPoleTask(),
        {"length": "length", "mass": "masspole", "masscart": "masscart", "gravity": "gravity", "force": "force_mag"},
        {"length": 0.37, "mass": 0.83, "masscart": 2.5, "gravity": 3.7, "force": 4.0},
    ),
    Case(
        "Pendulum-v1",
        Pendulum,
        PendulumTask(),
        {"length": "l", "mass": "m", "gravity": "g"},
        {"length": 0.4, "mass": 0.9, "gravity": 3.0},
    ),
    Case(
        "MountainCar-v0",
        MountainCar,
        MountainCarTask(),
        {"force": "force", "gravity": "gravity"},
        {"force": 0.0017, "gravity": 0.0031},
    ),
    Case(
        "MountainCarContinuous-v0",
        MountainCarContinuous,
        MountainCarContinuousTask(),
        {"power": "power"},
        {"power": 0.0029},
        single=True,
    ),
    Case(
        "Acrobot-v1",
        Acrobot,
        AcrobotTask(),
        {
            "length1": "LINK_LENGTH_1",
            "length2": "LINK_LENGTH_2",
            "mass1": "LINK_MASS_1",
            "mass2": "LINK_MASS_2",
            "com1": "LINK_COM_POS_1",
            "com2": "LINK_COM_POS_2",
            "moment": "LINK_MOI",
        },
        {"length1": 0.7, "length2": 2.0, "mass1": 1.3, "mass2": 0.6, "com1": 0.3, "com2": 0.8, "moment": 0.5},
        turns=(0, 1),
    ),
]
EVERY = [pytest.param(case, changed, id=f"{case.id}-{changed}") for case in CASES for changed in (False, True)]


def theirs(case: Case, values: Mapping[str, float]) -> gymnasium.Env:
    env = gymnasium.make(case.id).unwrapped
    env.reset(seed=0)
    for name, value in values.items():
        setattr(env, case.attributes[name], value)
    if case.id == "CartPole-v1":  # these two are worked out once, at construction
        env.total_mass, env.polemass_length = env.masspole + env.masscart, env.masspole * env.length
    return env


def step(env: gymnasium.Env, state: np.ndarray, action: object) -> tuple[np.ndarray, np.ndarray, float, bool]:
    """Gymnasium's next state, observation, reward and end from a state of ours."""
    env.state = np.array(state)
    env.steps_beyond_terminated = None
    observation, reward, terminated, _, _ = env.step(action)
    return np.array(env.state, dtype=np.float64), observation, float(reward), bool(terminated)


def actions(case: Case, rng: np.random.Generator) -> tuple[object, torch.Tensor]:
    """The same action for Gymnasium and for us; throttles and torques are held for a while, so that things move."""
    spec = case.task.action_spec
    if spec.shape == (1,) and spec.dtype == torch.float32:
        value = rng.uniform(-1, 1, 1).astype(np.float32) * float(spec.space.high)
        return value, torch.as_tensor(value)[None]
    choice = int(rng.integers(spec.shape[-1]))
    return choice, torch.nn.functional.one_hot(torch.tensor([choice]), spec.shape[-1])


def flat(state: TensorDict, case: Case) -> np.ndarray:
    """Our state in Gymnasium's order: CartPole's positions and speeds alternate."""
    q, v = state["qpos"][0].numpy(), state["qvel"][0].numpy()
    if case.id == "CartPole-v1":
        return np.array([q[0], v[0], q[1], v[1]])
    q = q.copy()
    for i in case.turns:
        q[i] = (q[i] + math.pi) % (2 * math.pi) - math.pi
    return np.concatenate([q, v])


def built(case: Case, changed: bool) -> tuple[TorchSimulator, torch.Tensor, gymnasium.Env]:
    values = dict(case.changed) if changed else {}
    simulator = case.simulator(tuple(case.attributes))
    theta = simulator.parameters.vector({name: {**simulator.defaults, **values}[name] for name in case.attributes})
    return simulator, theta[None], theirs(case, values)


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(("case", "changed"), EVERY)
def test_one_step_from_each_of_500_states(case: Case, changed: bool) -> None:
    rng, (simulator, theta, env) = np.random.default_rng(1), built(case, changed)
    state = simulator.reset(theta, case.task.start(theta, torch.Generator().manual_seed(1)))
    ended = 0
    for _ in range(STEPS):
        choice, action = actions(case, rng)
        expected, observation, reward, terminated = step(env, flat(state, case), choice)
        after = simulator.step(TensorDict({"command": case.task.command(action)}, batch_size=(1,)))
        tolerance = {"rtol": 1e-6, "atol": 1e-6}
        np.testing.assert_allclose(flat(after, case), expected, **tolerance)
        np.testing.assert_allclose(case.task.observe(after)[0].numpy(), observation, **tolerance)
        np.testing.assert_allclose(float(case.task.reward(state, action, after)), reward, **tolerance)
        assert bool(case.task.terminated(after)) == terminated
        ended += terminated
        state = after
        if terminated:
            state = simulator.reset(theta, case.task.start(theta, torch.Generator().manual_seed(1 + ended)))
    assert not simulator.failed.any()


@pytest.mark.parametrize(("case", "changed"), EVERY)
def test_fifty_steps_on_their_own(case: Case, changed: bool) -> None:
    rng, (simulator, theta, env) = np.random.default_rng(2), built(case, changed)
    state = simulator.reset(theta, case.task.start(theta, torch.Generator().manual_seed(3)))
    expected = flat(state, case)
    for _ in range(FREE):
        choice, action = actions(case, rng)
        expected, *_ = step(env, expected, choice)
        state = simulator.step(TensorDict({"command": case.task.command(action)}, batch_size=(1,)))
    # Gymnasium rounds the continuous car's state to 24 bits in every step.
    tolerance = 1e-5 if case.single else 1e-6
    np.testing.assert_allclose(flat(state, case), expected, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_the_environment_has_gymnasiums_horizon_and_starts(case: Case) -> None:
    registered = gymnasium.spec(case.id)
    assert case.task.horizon == registered.max_episode_steps
    env = SimulatorEnv(case.simulator((), worlds=400), case.task, seed=3)
    ours = env.reset()["observation"].double()
    reference = gymnasium.make(case.id)
    seen = torch.stack([torch.as_tensor(reference.reset(seed=s)[0]) for s in range(400)]).double()
    # Uniform draws: means of 400 agree within four standard errors (1e-4 of all seeds fail in some coordinate).
    gap = (ours.mean(0) - seen.mean(0)).abs()
    assert (gap <= 4 * (2 * seen.var(0) / 400).sqrt() + 1e-6).all()
    torch.testing.assert_close(ours.std(0), seen.std(0), rtol=0.2, atol=1e-6)
