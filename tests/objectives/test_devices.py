"""Objectives in worlds on a GPU: they collect, learn and go on from a state there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.data import Bounded
from torchrl.envs import TransformedEnv

from envs.cartpole import CartPole, CartPoleTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.objectives import (
    ActorCritic,
    DDPGSettings,
    Hindsight,
    Objective,
    PPOSettings,
    SACSettings,
    actor_critic,
    ddpg,
    ppo,
    sac,
)
from onlinebayes.simulators import SimulatorEnv
from tests.objectives.test_ddpg import GOALS, KEYS, reward, walk, walker

pytestmark = pytest.mark.gpu

DEVICE = "cuda"
WORLDS, STEPS = 16, 32


def pendulums() -> SimulatorEnv:
    return SimulatorEnv(Pendulum(["mass"], WORLDS, device=DEVICE), PendulumTask(20))


def cartpoles() -> SimulatorEnv:
    return SimulatorEnv(CartPole(["mass"], WORLDS, device=DEVICE), CartPoleTask())


BUILT: dict[str, tuple[Callable[[], SimulatorEnv], Callable[..., Objective]]] = {
    "ppo of a choice": (cartpoles, partial(ppo, settings=PPOSettings(minibatch=64, normalise=True))),
    "ppo": (pendulums, partial(ppo, settings=PPOSettings(minibatch=64))),
    "sac": (pendulums, partial(sac, settings=SACSettings(minibatch=32, normalise=True))),
    "ddpg": (pendulums, partial(ddpg, settings=DDPGSettings(minibatch=32, widths=(32, 32)))),
    "recurrent": (cartpoles, actor_critic),
}


@pytest.mark.parametrize("kind", BUILT)
def test_it_learns_there_and_goes_on_from_a_state(kind: str) -> None:
    env, build = BUILT[kind][0](), BUILT[kind][1]
    specs = env.observation_spec_unbatched, env.action_spec_unbatched
    objective, other = build(*specs), build(*specs)
    if isinstance(objective, ActorCritic):
        env = TransformedEnv(env)
        for transform in objective.transforms():
            env.append_transform(transform)
    frames = WORLDS * STEPS
    collector = Collector(
        env,
        objective.policy,
        frames_per_batch=frames,
        total_frames=2 * frames,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
    )
    before = [value.clone() for value in objective.policy.parameters()]
    assert {value.device.type for value in before} == {DEVICE}
    for batch in collector:
        assert {value.device.type for value in batch.values(True, True)} == {DEVICE}
        losses = objective.update(batch)
        assert torch.tensor(list(losses.values())).isfinite().all(), losses
    assert any(not torch.equal(a, b) for a, b in zip(before, objective.policy.parameters(), strict=True))
    other.load_state_dict(on_the_cpu(objective.state_dict()))
    for a, b in zip(objective.policy.parameters(), other.policy.parameters(), strict=True):
        assert torch.equal(a, b)
    assert torch.tensor(list(other.update(batch).values())).isfinite().all()


def on_the_cpu(state: object) -> object:
    """A state as a checkpoint reads it."""
    if isinstance(state, torch.Tensor):
        return state.cpu()
    if isinstance(state, dict):
        return type(state)({key: on_the_cpu(value) for key, value in state.items()})
    return [on_the_cpu(value) for value in state] if isinstance(state, list) else state


def test_hindsight_and_demonstrations() -> None:
    action = Bounded(-1, 1, (2,)).to(DEVICE)
    settings = DDPGSettings(widths=(32, 32), minibatch=64, demonstrations=0.25)
    objective = ddpg(GOALS.to(DEVICE), action, settings, in_keys=KEYS, hindsight=Hindsight(reward))
    walked = walk(walker(DDPGSettings(widths=(32, 32))).policy)
    objective.demonstrate(walked.to(DEVICE))
    losses = objective.update(walked.to(DEVICE))
    assert torch.tensor(list(losses.values())).isfinite().all()
    sample = objective.buffer.sample()
    assert {value.device.type for value in sample.values(True, True)} == {DEVICE}
