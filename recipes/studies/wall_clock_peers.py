"""What a user of stable-baselines3 and sbi would write for CartPole: a policy, a posterior between, then its worlds.

The settings are those of the rl-baselines3-zoo for CartPole-v1. sbi gets the statistics of a trajectory that the thesis
proposes (Eq 4.20): with whole trajectories it learnt less here.

    x = (mean ds, var ds, mean ds a^T),     ds = s_{t+1} - s_t
"""

from __future__ import annotations

import math
from collections.abc import Callable
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from sbi.inference import NPE
from sbi.utils import BoxUniform
from sbi.utils.tracking import TensorBoardTracker
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from onlinebayes.experiments import hidden_truth
from recipes.cartpole import DEFAULT, RANGE, SPACE
from recipes.studies.wall_clock import SOLVED, Outcome, Stopwatch

Array = NDArray[np.float64]
SIMULATIONS, STEPS, EPISODES = 500, 50, 32
WORLDS, FRAMES, EVERY = 8, 100_000, 5_000
"""The zoo's environments and frames, and the frames between two questions whether the task is solved."""


class World(gymnasium.Wrapper[Any, Any, Any, Any]):
    """CartPole-v1 that draws half the pole's length and its mass at each reset, seen through noisy sensors."""

    def __init__(self, draw: Callable[[], Array], noise: float = 0.01) -> None:
        super().__init__(gymnasium.make("CartPole-v1"))
        self.draw, self.theta = draw, draw()
        self._sd = noise * RANGE.numpy()

    def reset(self, **arguments: Any) -> tuple[Array, dict[str, Any]]:
        """Other parameters, then a fresh episode."""
        self.theta = self.draw()
        env: Any = self.unwrapped
        env.length, env.masspole = self.theta
        env.total_mass, env.polemass_length = env.masspole + env.masscart, env.masspole * env.length
        seen, info = self.env.reset(**arguments)
        return self._through_sensors(seen), info

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        return self._through_sensors(seen), float(reward), terminated, truncated, info

    def _through_sensors(self, seen: Array) -> Array:
        return (seen + self._sd * np.random.standard_normal(seen.shape)).astype(np.float32)


def trajectory(model: BaseAlgorithm, env: World) -> tuple[Array, Array]:
    """Theta and the statistics of one trajectory of the policy as it explores."""
    seen, commands = [env.reset()[0]], []
    for _ in range(STEPS):
        action, _ = model.predict(seen[-1], deterministic=False)
        after, _, terminated, _, _ = env.step(action)
        seen.append(after)
        commands.append(np.atleast_1d(action))
        if terminated:
            break
    change, command = np.diff(np.stack(seen), axis=0), np.stack(commands).astype(float)
    return env.theta, np.concatenate([change.mean(0), change.var(0), (change.T @ command / len(command)).ravel()])


def returned(model: BaseAlgorithm, truth: Array) -> float:
    """Mean return of the deterministic policy on the hidden system."""
    worlds = make_vec_env(lambda: World(lambda: truth), n_envs=EPISODES)
    seen, total, going = worlds.reset(), np.zeros(EPISODES), np.ones(EPISODES, dtype=bool)
    while going.any():
        action, _ = model.predict(np.asarray(seen), deterministic=True)
        seen, reward, over, _ = worlds.step(action)
        total += reward * going
        going &= ~over
    return float(total.mean())


class Between(BaseCallback):
    """Asks whether the task is solved, and infers the posterior in the middle.

    Args:
        truth: the hidden parameters.
        watch: what is not timed stands aside.
    """

    def __init__(self, truth: Tensor, watch: Stopwatch) -> None:
        super().__init__()
        self._truth, self._watch = truth.double(), watch
        self._prior = BoxUniform(torch.full((2,), 0.1), torch.ones(2))
        self._drawn: Callable[[], Tensor] = lambda: self._prior.sample((1,))[0]
        self._asked = 0
        self.found = Outcome(math.inf, -math.inf, -math.inf)

    def draw(self) -> Array:
        """Theta of a world that begins anew."""
        return np.asarray(self._drawn().double().numpy())

    def _on_step(self) -> bool:
        if self.num_timesteps < self._asked + EVERY:
            return True
        self._asked = self.num_timesteps
        score = self._watch.aside(lambda: returned(self.model, self._truth.numpy()))
        solved, inferred = score >= SOLVED, math.isfinite(self.found.density)
        if not inferred and (solved or self.num_timesteps >= FRAMES / 4):
            self._infer()
        self.found = Outcome(self._watch.seconds if solved else math.inf, score, self.found.density)
        return not solved

    def _infer(self) -> None:
        """Simulate under the policy, train NPE, condition on one real trajectory; its worlds follow."""
        env = World(self.draw)
        pairs = [trajectory(self.model, env) for _ in range(SIMULATIONS)]
        theta, x = (torch.as_tensor(np.stack(part), dtype=torch.float32) for part in zip(*pairs, strict=True))
        with TemporaryDirectory() as place:  # sbi would leave its curves in the folder that it is called from
            tracker = TensorBoardTracker(SummaryWriter(place))
            inference = NPE(prior=self._prior, density_estimator="mdn", tracker=tracker, show_progress_bars=False)
            inference.append_simulations(theta, x).train()
        _, real = trajectory(self.model, World(lambda: np.asarray(self._truth.numpy())))
        posterior = inference.build_posterior().set_default_x(torch.as_tensor(real, dtype=torch.float32))
        drawn = iter(posterior.sample((20_000,), show_progress_bars=False))
        self._drawn = lambda: next(drawn)
        density = float(posterior.log_prob(self._truth.float()[None])[0])
        self.found = Outcome(math.inf, self.found.score, density)


def theirs(seed: int) -> Outcome:
    """Both libraries, until the task is solved or the zoo's frames are used up."""
    np.random.seed(seed)
    torch.manual_seed(seed)
    watch = Stopwatch()
    between = Between(hidden_truth(SPACE, seed, {name: DEFAULT[name] for name in SPACE.names}), watch)
    worlds = make_vec_env(lambda: World(between.draw), n_envs=WORLDS, seed=seed)
    model = PPO(
        "MlpPolicy",
        worlds,
        n_steps=32,
        batch_size=256,
        gae_lambda=0.8,
        gamma=0.98,
        n_epochs=20,
        ent_coef=0.0,
        learning_rate=lambda left: 0.001 * left,
        clip_range=lambda left: 0.2 * left,
        seed=seed,
        device="cpu",
    )
    model.learn(FRAMES, callback=between)
    return between.found
