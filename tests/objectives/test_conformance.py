"""Every objective of the library does what the exported check asks of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torchrl.envs import Compose, EnvBase, StepCounter, TransformedEnv

from envs.cartpole import CartPole, CartPoleTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes import objectives
from onlinebayes.objectives import (
    ActorCriticSettings,
    DDPGSettings,
    Hindsight,
    Objective,
    Planned,
    PPOSettings,
    SACSettings,
    actor_critic,
    ddpg,
    inputs,
    ppo,
    sac,
)
from onlinebayes.objectives.testing import check_objective
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from tests.objectives.test_examples_ddpg import KEYS, Points, reward

WORLDS = 4


def pendulums() -> EnvBase:
    return SimulatorEnv(Pendulum(["mass"], WORLDS), PendulumTask(20))


def cartpoles() -> EnvBase:
    return SimulatorEnv(CartPole(["mass"], WORLDS), CartPoleTask(20))


def points() -> EnvBase:
    return TransformedEnv(Points(WORLDS), StepCounter(max_steps=10))


def with_memory() -> EnvBase:
    return TransformedEnv(cartpoles(), Compose(*actor_critic(*specs(cartpoles), NARROW).transforms()))


def swings_with_memory() -> EnvBase:
    return TransformedEnv(pendulums(), Compose(*actor_critic(*specs(pendulums), NARROW).transforms()))


def specs(make_env: Callable[[], EnvBase]) -> tuple:
    env = make_env()
    return env.observation_spec_unbatched, env.action_spec_unbatched


ONCE = PPOSettings(epochs=1, minibatch=32, widths=(8, 8))
SOFT = SACSettings(memory=256, frames_per_update=64, minibatch=32, widths=(8, 8))
DETERMINISTIC = DDPGSettings(memory=256, frames_per_update=64, minibatch=32, widths=(8, 8))
NARROW = ActorCriticSettings(width=8)
BUILT: dict[str, tuple[Callable[[], EnvBase], Callable[[], Objective]]] = {
    "ppo": (cartpoles, lambda: ppo(*specs(cartpoles), ONCE)),
    "ppo, normalised": (pendulums, lambda: ppo(*specs(pendulums), replace(ONCE, normalise=True))),
    "sac": (pendulums, lambda: sac(*specs(pendulums), SOFT)),
    "sac, normalised": (pendulums, lambda: sac(*specs(pendulums), replace(SOFT, normalise=True))),
    "ddpg": (pendulums, lambda: ddpg(*specs(pendulums), DETERMINISTIC)),
    "ddpg, hindsight": (
        points,
        lambda: ddpg(*specs(points), DETERMINISTIC, in_keys=KEYS, hindsight=Hindsight(reward)),
    ),
    "ppo, of continuous actions, at a pace": (
        pendulums,
        lambda: ppo(*specs(pendulums), replace(ONCE, target_kl=0.01)),
    ),
    "ppo, of several inputs": (points, lambda: ppo(*specs(points), ONCE, in_keys=KEYS)),
    "sac, of several inputs": (points, lambda: sac(*specs(points), SOFT, in_keys=KEYS)),
    "ddpg, normalised": (pendulums, lambda: ddpg(*specs(pendulums), replace(DETERMINISTIC, normalise=True))),
    "ddpg, hindsight, normalised": (
        points,
        lambda: ddpg(*specs(points), replace(DETERMINISTIC, normalise=True), in_keys=KEYS, hindsight=Hindsight(reward)),
    ),
    "recurrent, of continuous actions": (
        swings_with_memory,
        lambda: actor_critic(*specs(pendulums), NARROW),
    ),
    "recurrent": (with_memory, lambda: actor_critic(*specs(cartpoles), NARROW)),
    "recurrent, normalised": (
        with_memory,
        lambda: actor_critic(*specs(cartpoles), replace(NARROW, normalise=True)),
    ),
}


def test_every_objective_of_the_library_is_among_them() -> None:
    """But for a planner's, which refuses to be taught (see ``test_planned``)."""
    parts = [getattr(objectives, name) for name in objectives.__all__]
    learning = {part for part in parts if all(hasattr(part, name) for name in ("update", "load_state_dict"))}
    assert learning - {Objective, Planned} == {type(make()) for _, make in BUILT.values()}


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("kind", BUILT)
def test_it_conforms(kind: str) -> None:
    make_env, make = BUILT[kind]
    check_objective(make, make_env)


def test_the_check_finds_one_that_learns_from_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    make_env, make = BUILT["sac"]
    monkeypatch.setattr(inputs, "refuse_nonfinite", lambda data: None)
    with pytest.raises(AssertionError, match="learns from nan in"):
        check_objective(make, make_env)


def test_a_number_beyond_single_precision_is_refused_and_a_large_sum_is_not() -> None:
    data = cartpoles().rollout(8)
    data["next", "reward"] = torch.full_like(data["next", "reward"], 1e38)
    assert inputs.selected(data, [("next", "reward")])["next", "reward"].isfinite().all()
    data["next", "reward"] = data["next", "reward"].double() * 1e10
    with pytest.raises(BadInput, match=r"'reward'.*4 of the batch's 4 rows"):
        inputs.selected(data, [("next", "reward")])
