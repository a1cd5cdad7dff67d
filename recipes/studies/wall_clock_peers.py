"""What a user of stable-baselines3 and sbi would write: a policy, a posterior between, the policy in its worlds.

The settings are those of the rl-baselines3-zoo for CartPole-v1 (PPO) and Pendulum-v1 (SAC). sbi gets the statistics of
a trajectory that the thesis proposes (Eq 4.20): with whole trajectories it learnt less here.

    x = (mean ds, var ds, mean ds a^T),     ds = s_{t+1} - s_t
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from sbi.inference import NPE
from sbi.utils import BoxUniform
from sbi.utils.tracking import TensorBoardTracker
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from onlinebayes.experiments import hidden_truth
from recipes import cartpole, pendulum
from recipes.studies.wall_clock import SOLVED, Outcome, Stopwatch

Array = NDArray[np.float64]
SIMULATIONS, STEPS, EPISODES = 500, 50, 32


def set_cartpole(env: Any, theta: Array) -> None:
    """Half the pole's length and its mass, and what Gymnasium keeps of them."""
    env.length, env.masspole = theta
    env.total_mass = env.masspole + env.masscart
    env.polemass_length = env.masspole * env.length


def set_pendulum(env: Any, theta: Array) -> None:
    """Length and mass."""
    env.l, env.m = theta


@dataclass(frozen=True)
class Case:
    """One task as the zoo has it.

    Args:
        name: Gymnasium's.
        apply: sets theta in an environment.
        sensor_range: of each observed value, to which the noise is relative.
        truth: seed -> hidden parameters.
        learner: environments, seed -> the algorithm with the zoo's settings.
        worlds: the zoo's number of environments.
        frames: the zoo's number of frames.
        every: frames between two questions whether the task is solved.
    """

    name: str
    apply: Callable[[Any, Array], None]
    sensor_range: Tensor
    truth: Callable[[int], Tensor]
    learner: Callable[[Any, int], BaseAlgorithm]
    worlds: int
    frames: int
    every: int


def ppo_of_the_zoo(worlds: Any, seed: int) -> BaseAlgorithm:
    """PPO for CartPole-v1."""
    return PPO(
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


def sac_of_the_zoo(worlds: Any, seed: int) -> BaseAlgorithm:
    """SAC for Pendulum-v1."""
    return SAC("MlpPolicy", worlds, learning_rate=1e-3, seed=seed, device="cpu")


CASES = {
    "cartpole": Case(
        "CartPole-v1",
        set_cartpole,
        cartpole.RANGE,
        lambda seed: hidden_truth(cartpole.SPACE, seed, {"length": 0.5, "mass": 0.1}),
        ppo_of_the_zoo,
        8,
        100_000,
        5_000,
    ),
    "pendulum": Case(
        "Pendulum-v1",
        set_pendulum,
        pendulum.RANGE,
        lambda seed: hidden_truth(pendulum.SPACE, seed, {"length": 1.0, "mass": 1.0}),
        sac_of_the_zoo,
        1,
        20_000,
        1_000,
    ),
}


class Worlds(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment that draws its parameters at each reset, seen through noisy sensors."""

    def __init__(self, case: Case, draw: Callable[[], Array], noise: float = 0.01) -> None:
        super().__init__(gymnasium.make(case.name))
        self._case, self.draw, self.theta = case, draw, draw()
        self._sd = noise * case.sensor_range.numpy()

    def reset(self, **arguments: Any) -> tuple[Array, dict[str, Any]]:
        """Other parameters, then a fresh episode."""
        self.theta = self.draw()
        self._case.apply(self.unwrapped, self.theta)
        seen, info = self.env.reset(**arguments)
        return self._through_sensors(seen), info

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        return self._through_sensors(seen), float(reward), terminated, truncated, info

    def _through_sensors(self, seen: Array) -> Array:
        return (seen + self._sd * np.random.standard_normal(seen.shape)).astype(np.float32)


def trajectory(model: BaseAlgorithm, env: Worlds) -> tuple[Array, Array]:
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


def returned(model: BaseAlgorithm, case: Case, truth: Array) -> float:
    """Mean return of the deterministic policy on the hidden system."""
    worlds = make_vec_env(lambda: Worlds(case, lambda: truth), n_envs=EPISODES)
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
        case: the task.
        seed: of the run.
        watch: what is not timed stands aside.
    """

    def __init__(self, case: Case, goal: float, seed: int, watch: Stopwatch) -> None:
        super().__init__()
        self._case, self._goal, self._watch = case, goal, watch
        self._truth = case.truth(seed).double()
        self._prior = BoxUniform(torch.full((2,), 0.1), torch.ones(2))
        self._worlds: Callable[[], Tensor] = lambda: self._prior.sample((1,))[0]
        self._asked = 0
        self.found = Outcome(math.inf, -math.inf, -math.inf)

    def draw(self) -> Array:
        """Theta of a world that begins anew."""
        return np.asarray(self._worlds().double().numpy())

    def _on_step(self) -> bool:
        if self.num_timesteps < self._asked + self._case.every:
            return True
        self._asked = self.num_timesteps
        score = self._watch.aside(lambda: returned(self.model, self._case, self._truth.numpy()))
        solved, inferred = score >= self._goal, math.isfinite(self.found.density)
        if not inferred and (solved or self.num_timesteps >= self._case.frames / 4):
            self._infer()
        self.found = Outcome(self._watch.seconds if solved else math.inf, score, self.found.density)
        return not solved

    def _infer(self) -> None:
        """Simulate under the policy, train NPE, condition on one real trajectory; its worlds follow."""
        env = Worlds(self._case, self.draw)
        pairs = [trajectory(self.model, env) for _ in range(SIMULATIONS)]
        theta, x = (torch.as_tensor(np.stack(part), dtype=torch.float32) for part in zip(*pairs, strict=True))
        with TemporaryDirectory() as place:  # sbi would leave its curves in the folder that it is called from
            tracker = TensorBoardTracker(SummaryWriter(place))
            inference = NPE(prior=self._prior, density_estimator="mdn", tracker=tracker, show_progress_bars=False)
            inference.append_simulations(theta, x).train()
        _, real = trajectory(self.model, Worlds(self._case, lambda: np.asarray(self._truth.numpy())))
        posterior = inference.build_posterior().set_default_x(torch.as_tensor(real, dtype=torch.float32))
        drawn = iter(posterior.sample((20_000,), show_progress_bars=False))
        self._worlds = lambda: next(drawn)
        density = float(posterior.log_prob(self._truth.float()[None])[0])
        self.found = Outcome(math.inf, self.found.score, density)


def theirs(task: str, seed: int) -> Outcome:
    """Both libraries, until the task is solved or the zoo's frames are used up."""
    case = CASES[task]
    np.random.seed(seed)
    torch.manual_seed(seed)
    watch = Stopwatch()
    between = Between(case, SOLVED[task], seed, watch)
    worlds = make_vec_env(lambda: Worlds(case, between.draw), n_envs=case.worlds, seed=seed)
    case.learner(worlds, seed).learn(case.frames, callback=between)
    return between.found
