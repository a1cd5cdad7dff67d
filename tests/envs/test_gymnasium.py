"""The five classic systems equal Gymnasium's to 1e-6, with its parameters and with others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import gymnasium
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.acrobot import MAX_SPEEDS, Acrobot, AcrobotTask
from envs.cartpole import CartPole, CartPoleTask
from envs.mountain_car import MountainCar, MountainCarContinuous, MountainCarContinuousTask, MountainCarTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.simulators import SimulatorEnv, Task, TorchSimulator

STEPS, FREE, TOLERANCE = 500, 50, 1e-6


@dataclass(frozen=True)
class Case:
    """One system: Gymnasium's name for it, ours, and Gymnasium's attribute behind each of our parameters."""

    id: str
    simulator: type[TorchSimulator]
    task: Task
    attributes: Mapping[str, str]
    changed: Mapping[str, float]
    low: tuple[float, ...]  # of states that are tried, positions first
    high: tuple[float, ...]
    turns: tuple[int, ...] = ()  # coordinates that Gymnasium wraps


CASES = [
    Case(
        "CartPole-v1",
        CartPole,
        CartPoleTask(),
        {"length": "length", "mass": "masspole", "masscart": "masscart", "gravity": "gravity", "force": "force_mag"},
        {"length": 0.37, "mass": 0.83, "masscart": 2.5, "gravity": 3.7, "force": 4.0},
        (-2.6, -0.25, -3.0, -3.0),
        (2.6, 0.25, 3.0, 3.0),
    ),
    Case(
        "Pendulum-v1",
        Pendulum,
        PendulumTask(),
        {"length": "l", "mass": "m", "gravity": "g"},
        {"length": 0.4, "mass": 0.9, "gravity": 3.0},
        (-7.0, -8.0),
        (7.0, 8.0),
    ),
    # The wall behind the flag, which no episode reaches, does not stop Gymnasium's car.
    Case(
        "MountainCar-v0",
        MountainCar,
        MountainCarTask(),
        {"force": "force", "gravity": "gravity"},
        {"force": 0.0017, "gravity": 0.0031},
        (-1.2, -0.07),
        (0.52, 0.07),
    ),
    Case(
        "MountainCarContinuous-v0",
        MountainCarContinuous,
        MountainCarContinuousTask(),
        {"power": "power"},
        {"power": 0.0029},
        (-1.2, -0.07),
        (0.52, 0.07),
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
        (-math.pi, -math.pi, -MAX_SPEEDS[0], -MAX_SPEEDS[1]),
        (math.pi, math.pi, MAX_SPEEDS[0], MAX_SPEEDS[1]),
        turns=(0, 1),
    ),
]
EVERY = [
    pytest.param(case, changed, id=f"{case.id}-{'changed' if changed else 'default'}")
    for case in CASES
    for changed in (False, True)
]


@dataclass(frozen=True)
class Steps:
    """What Gymnasium did from K states, each a row."""

    before: np.ndarray
    action: torch.Tensor
    after: np.ndarray
    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray


def theirs(case: Case, changed: bool) -> gymnasium.Env:
    env = gymnasium.make(case.id).unwrapped
    env.reset(seed=0)
    for name, value in (case.changed if changed else {}).items():
        assert hasattr(env, case.attributes[name])
        setattr(env, case.attributes[name], value)
    if case.id == "CartPole-v1":  # these two are worked out once, at construction
        env.total_mass, env.polemass_length = env.masspole + env.masscart, env.masspole * env.length
    return env


def ours(case: Case, changed: bool, worlds: int) -> tuple[TorchSimulator, torch.Tensor]:
    simulator = case.simulator(tuple(case.attributes), worlds)
    values = {**simulator.defaults, **(case.changed if changed else {})}
    theta = simulator.parameters.vector({name: values[name] for name in case.attributes})
    return simulator, theta.expand(worlds, -1)


def order(case: Case) -> list[int]:
    """Where Gymnasium keeps each of our coordinates: CartPole's positions and speeds alternate."""
    return [0, 2, 1, 3] if case.id == "CartPole-v1" else list(range(len(case.low)))


def draw(case: Case, rng: np.random.Generator) -> tuple[object, torch.Tensor]:
    """The same action for Gymnasium and for us."""
    spec = case.task.action_spec
    if spec.dtype == torch.float32:
        value = rng.uniform(-1, 1, 1).astype(np.float32) * float(spec.space.high)
        return value, torch.as_tensor(value)
    choice = int(rng.integers(spec.shape[-1]))
    return choice, torch.nn.functional.one_hot(torch.tensor(choice), spec.shape[-1])


def step(env: gymnasium.Env, state: np.ndarray, action: object) -> tuple[np.ndarray, np.ndarray, float, bool]:
    env.state, env.steps_beyond_terminated = np.array(state), None
    observation, reward, terminated, _, _ = env.step(action)
    return np.array(env.state, dtype=np.float64), observation, float(reward), bool(terminated)


def stacked(rows: list[tuple]) -> Steps:
    before, action, after, observation, reward, terminated = zip(*rows, strict=True)
    return Steps(
        np.stack(before),
        torch.stack(action),
        np.stack(after),
        np.stack(observation),
        np.array(reward),
        np.array(terminated),
    )


def difference(case: Case, state: TensorDict, expected: np.ndarray) -> np.ndarray:
    found = torch.cat((state["qpos"], state["qvel"]), -1).numpy()
    gap = found - expected[:, order(case)]
    for i in case.turns:
        gap[:, i] = (gap[:, i] + math.pi) % (2 * math.pi) - math.pi
    return np.abs(gap)


def check(case: Case, changed: bool, steps: Steps) -> None:
    """Take every step as a world of one batch."""
    simulator, theta = ours(case, changed, len(steps.before))
    begun = torch.as_tensor(steps.before[:, order(case)])
    joints = len(simulator.joints)
    start = TensorDict({"qpos": begun[:, :joints], "qvel": begun[:, joints:]}, batch_size=(len(begun),))
    before = simulator.reset(theta, start)
    after = simulator.step(TensorDict({"command": case.task.command(steps.action)}, batch_size=(len(begun),)))
    assert difference(case, after, steps.after).max() < TOLERANCE
    observation = case.task.observe(after)
    assert observation.dtype == torch.float32
    np.testing.assert_allclose(observation, steps.observation, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(case.task.reward(before, steps.action, after), steps.reward, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(case.task.terminated(after), steps.terminated)


@pytest.mark.parametrize(("case", "changed"), EVERY)
def test_one_step_from_each_state_along_500_steps_of_random_actions(case: Case, changed: bool) -> None:
    rng, env, rows = np.random.default_rng(1), theirs(case, changed), []
    for _ in range(STEPS):
        before = np.array(env.state, dtype=np.float64)
        choice, action = draw(case, rng)
        rows.append((before, action, *step(env, before, choice)))
        if rows[-1][-1]:
            env.reset()
    check(case, changed, stacked(rows))


@pytest.mark.parametrize(("case", "changed"), EVERY)
def test_one_step_from_states_all_over_where_speeds_are_cut_off_and_episodes_end(case: Case, changed: bool) -> None:
    rng, env, rows = np.random.default_rng(2), theirs(case, changed), []
    for _ in range(STEPS):
        before = rng.uniform(case.low, case.high)[np.argsort(order(case))]
        choice, action = draw(case, rng)
        rows.append((before, action, *step(env, before, choice)))
    steps = stacked(rows)
    check(case, changed, steps)
    if case.id != "Pendulum-v1":
        assert 0 < steps.terminated.sum() < STEPS
    if case.id.startswith("MountainCar"):
        assert (np.isclose(steps.after[:, 0], case.low[0]) & (steps.after[:, 1] == 0)).any(), "the wall stops it"


@pytest.mark.parametrize(("case", "changed"), EVERY)
def test_fifty_steps_on_their_own(case: Case, changed: bool) -> None:
    rng, env = np.random.default_rng(3), theirs(case, changed)
    simulator, theta = ours(case, changed, 1)
    state = simulator.reset(theta, case.task.start(theta, torch.Generator().manual_seed(3)))
    expected = torch.cat((state["qpos"], state["qvel"]), -1)[0].numpy()[np.argsort(order(case))]
    for _ in range(FREE):
        choice, action = draw(case, rng)
        expected, *_ = step(env, expected, choice)
        state = simulator.step(TensorDict({"command": case.task.command(action[None])}, batch_size=(1,)))
    assert difference(case, state, expected[None]).max() < TOLERANCE


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_the_environment_has_gymnasiums_horizon_and_starts(case: Case) -> None:
    assert case.task.horizon == gymnasium.spec(case.id).max_episode_steps
    env = SimulatorEnv(case.simulator((), worlds=400), case.task, seed=3)
    found = env.reset()["observation"].double()
    reference = gymnasium.make(case.id)
    seen = torch.stack([torch.as_tensor(reference.reset(seed=s)[0]) for s in range(400)]).double()
    # Uniform draws: means of 400 agree within four standard errors (1e-4 of all seeds fail in some coordinate).
    gap = (found.mean(0) - seen.mean(0)).abs()
    assert (gap <= 4 * (2 * seen.var(0) / 400).sqrt() + 1e-6).all()
    torch.testing.assert_close(found.std(0), seen.std(0), rtol=0.2, atol=1e-6)
