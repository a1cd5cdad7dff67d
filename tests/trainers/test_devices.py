"""Algorithm 1 with its worlds on a GPU, and from a checkpoint there."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
import torch

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.inference import residual_estimator
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.runs import Checkpoints, seed_everything
from onlinebayes.simulators.drawing import scene
from onlinebayes.trainers import OnlineState, OnlineTrainer, Problem, Saver, Schedule, Sizes, online_trainer
from onlinebayes.trainers.playing import SimulatedPlayer
from onlinebayes.transforms import ParameterRandomization
from tests.trainers.test_online import PRIOR, SPACE, TRUTH, everything_observed, fit

pytestmark = [pytest.mark.gpu, pytest.mark.usefixtures("without_shape_checks")]

DEVICE = "cuda"
TASK = CartPoleTask()


def problem() -> Problem:
    sd = torch.tensor([0.001, 0.001, 0.001, 0.001])
    return Problem(CartPole(SPACE, device=DEVICE), TASK, PRIOR, sd)


def build(steps: int) -> OnlineTrainer:
    seed_everything(0)
    system = problem()
    train = partial(fit, epochs=5, batch_size=50, learning_rate=6e-3)
    return online_trainer(
        system,
        ppo(*system.specs, PPOSettings(minibatch=64, epochs=1)),
        estimator=residual_estimator(system.simulator, TASK, state=everything_observed, train=train),
        real=system.hidden(TRUTH, 7),
        schedule=Schedule(steps, 2, real_steps=30, behaviours=2),
        sizes=Sizes(worlds=8, batch_steps=16, simulations=100, groups=24),
        seed=0,
    )


def test_two_steps_and_a_picture_of_them() -> None:
    trainer = build(2)
    state = trainer.run(OnlineState.begin(PRIOR))
    assert (state.step, state.interrupted) == (2, False)
    assert not [note for record in state.records for note in record.notes if "real system" in note]
    assert state.real["observation"].device.type == DEVICE
    assert SPACE.contains(state.belief.sample((100,))).all()
    assert problem().score(trainer.objective.policy, TRUTH, episodes=4) > 0
    episodes = SimulatedPlayer(problem(), trainer.objective.policy, TRUTH)(state)
    assert {episode.poses.device.type for episode in episodes.values()} == {"cpu"}
    env = problem().worlds(2, ParameterRandomization(PRIOR), 0).base_env
    env.reset()
    assert env.render().shape == (240, 320, 3)
    shapes, poses = scene([env.simulator], env.simulator.theta[0], env.simulator.state)
    assert poses.shape == (2, len(shapes), 7)


def test_a_run_that_was_stopped_ends_as_if_it_had_not_been(tmp_path: Path) -> None:
    """To rounding: sums on a GPU need not come in the same order twice."""
    whole = build(2).run(OnlineState.begin(PRIOR))
    first, checkpoints = build(1), Checkpoints(tmp_path, "online")
    first.run(OnlineState.begin(PRIOR), checkpoint=Saver(first, checkpoints))
    second, state = build(2), OnlineState.begin(PRIOR)
    assert Saver(second, checkpoints).resume(state)
    assert state.step == 1
    assert state.real["observation"].device.type == DEVICE
    assert state.belief.sample((3,), torch.Generator().manual_seed(0)).device.type == DEVICE
    second.run(state)
    torch.testing.assert_close(state.real, whole.real, rtol=1e-3, atol=1e-3)
    one, other = (each.belief.sample((2000,), torch.Generator().manual_seed(0)).mean(0) for each in (state, whole))
    torch.testing.assert_close(one, other, rtol=1e-2, atol=1e-2)
