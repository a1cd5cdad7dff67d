"""A Gymnasium environment of your own in the place of a simulator: its parameters are inferred, a policy learns in it.

    python -m recipes.custom_gym [--seed S] [--short]      a few minutes; Ctrl-C and again goes on

Nothing here is batched: sixteen of Gymnasium's own pendulums step one after the other, ``Parameterized`` sets length
and mass of each at reset, and the hidden system is one more of them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import torch
from tensordict import TensorDict
from torchrl.envs import GymWrapper, SerialEnv, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.pendulum import Pendulum
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Belief,
    BoxUniform,
    Gate,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PosteriorEstimator,
    fit,
)
from onlinebayes.objectives import sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import RunFolder, generator, seed_everything
from onlinebayes.simulators import Parameterized
from onlinebayes.trainers import (
    Episode,
    OnlineState,
    OnlineTrainer,
    Point,
    Policy,
    RealEnvironment,
    Recording,
    Schedule,
    Simulations,
    collector_of,
    returns,
    run_in_folder,
)
from onlinebayes.transforms import Distribution, ParameterRandomization
from recipes.common import settle, status

SPACE = ParameterSpace({"length": Parameter(0.5, 1.5, "m"), "mass": Parameter(0.5, 1.5, "kg")})
WORLDS = 16


@dataclass(frozen=True)
class Settings:
    """One run."""

    seed: int = 0
    """of networks, worlds and draws"""
    short: bool = False
    """a small budget: shows that the pieces connect"""
    out: str = "out"
    """the run's folder goes here"""


def set_parameters(env: Any, values: Mapping[str, float]) -> None:
    """What Gymnasium calls them."""
    env.unwrapped.l, env.unwrapped.m = values["length"], values["mass"]


def pendulum() -> Parameterized:
    """One of Gymnasium's pendulums, with parameters."""
    return Parameterized(GymWrapper(gymnasium.make("Pendulum-v1")), SPACE, set_parameters)


def worlds(number: int, distribution: Distribution, seed: int) -> tuple[TransformedEnv, ParameterRandomization]:
    """Several of them, one after the other, with parameters from a distribution."""
    drawn = ParameterRandomization(distribution)
    env = TransformedEnv(SerialEnv(number, pendulum), drawn)
    env.set_seed(seed)
    return env, drawn


def estimator(epochs: int, proposal: Belief) -> PosteriorEstimator:
    """Differences of observations and their products with the torque -> averages -> a mixture: no simulator needed."""
    embedding = SummaryEmbedding(TransitionFeatures(3, 1))
    network = MixtureEstimator(SPACE, embedding.size, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=epochs))


@dataclass(frozen=True)
class Player:
    """Plays one episode of Gymnasium's pendulum, and draws it as ours is drawn."""

    policy: Policy
    truth: torch.Tensor

    def __call__(self, state: OnlineState) -> dict[str, Episode]:
        """The episode after a step."""
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            seen = worlds(1, Point(self.truth), 7)[0].rollout(200, self.policy)["observation"][0].double()
        states = TensorDict({"qpos": torch.atan2(seen[:, 1:2], seen[:, :1])}, batch_size=seen.shape[:1])
        drawn = Pendulum(SPACE)
        return {"real": Episode(drawn.shapes(self.truth), drawn.poses(self.truth, states), drawn.dt)}


def build(settings: Settings, truth: torch.Tensor) -> OnlineTrainer:
    """The whole composition."""
    prior, seed = BoxUniform(SPACE), settings.seed
    steps, batches, repeats, epochs = (2, 2, 20, 30) if settings.short else (4, 40, 30, 30)
    env, drawn = worlds(WORLDS, prior, seed)
    spec = env.observation_spec["observation"][0], env.action_spec[0]
    objective = sac(*spec, tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=4)
    simulations, held_out = (worlds(WORLDS, prior, seed + k) for k in (1, 2))
    return OnlineTrainer(
        objective=objective,
        collector=collector_of(env, objective.policy, 16),
        randomization=drawn,
        simulations=Simulations(*simulations, 50, repeats=repeats),
        held_out=Simulations(*held_out, 50),
        estimator=partial(estimator, epochs),
        gate=Gate(),
        real=RealEnvironment(worlds(1, Point(truth), seed + 3)[0]),
        schedule=Schedule(steps=steps, policy_batches=batches, real_steps=50),
        generator=generator(seed, "custom_gym"),
    )


def main(settings: Settings) -> int:
    """One run in a folder of its own; 0 when the belief holds the truth better than the prior."""
    settle()
    seed_everything(settings.seed)
    truth, prior = SPACE.vector({"length": 1.0, "mass": 0.8}), BoxUniform(SPACE)
    place = Path(settings.out) / "-".join(["custom_gym", str(settings.seed), *["short"] * settings.short])
    with RunFolder(place, "custom_gym", settings={k: v for k, v in asdict(settings).items() if k != "out"}) as folder:
        trainer = build(settings, truth)
        judged = worlds(8, Point(truth), 99)[0]

        def judge(state: OnlineState) -> dict[str, float]:
            return {
                "return": float(returns(judged, trainer.objective.policy, 200).mean()),
                "log density of the truth": float(state.belief.log_prob(truth)),
            }

        player = Player(trainer.objective.policy, truth)
        with Recording(place, "custom_gym", prior, player, truth) as recording:
            state = run_in_folder(trainer, prior, folder, judge=judge, watchers=(recording,))
    if state.interrupted:
        print(f"stopped; kept: {state.kept()}. The same command goes on from there")
        return 130
    gain = float(state.belief.log_prob(truth) - prior.log_prob(truth))
    print(f"the belief holds the truth {gain:.1f} nats better than the prior; written: {place}")
    print(f"open it with: onlinebayes show {place}")
    return 0 if gain > 0 else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
