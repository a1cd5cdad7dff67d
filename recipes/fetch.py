"""Parts that the recipes of the Fetch arm share: worlds to learn in and to be judged in, DDPG with hindsight, success.

The policy learns in lean worlds, whose idle parts are left out; inference and judges have the exact ones. Settings of
the policy: Plappert et al., Multi-Goal Reinforcement Learning (2018), with smaller networks and returns of three steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.fetch import FetchSimulator, FetchTask, ScriptedPusher, motion, scene
from onlinebayes.embeddings import LSTMEmbedding, TransitionFeatures
from onlinebayes.inference import Belief, BoxUniform, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
from onlinebayes.objectives import DDPG, DDPGSettings, Exploration, Hindsight, ddpg
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Point, Problem
from onlinebayes.trainers.trajectories import Policy
from onlinebayes.transforms import Distribution, ParameterRandomization

WORLDS, STEPS = 64, 50
WORDS = {"last": "success", "ever": "success at any step", "at_start": "met at the start", "moved": "object moved"}
"""Names of the shares of :class:`Success` in a log."""

MOVED = 0.01
"""From where on an object counts as moved [m]."""


LEARNING = DDPGSettings(
    widths=(64, 64, 64),
    memory=500_000,
    frames_per_update=16,
    gamma=0.95,
    value_range=(-20.0, 0.0),
    action_penalty=0.1,
    tau=0.05,
)


@dataclass(frozen=True)
class Fetch:
    """One task, in worlds to learn in and in exact ones."""

    lean: Problem
    exact: Problem

    @property
    def task(self) -> FetchTask:
        """The task."""
        assert isinstance(self.exact.task, FetchTask)
        return self.exact.task


def fetch(name: str, space: ParameterSpace) -> Fetch:
    """A task whose worlds have parameters of a space, by default uniform in it.

    Args:
        name: ``"reach"``, ``"push"`` or ``"slide"``.
        space: the unknown parameters.
    """
    lean, exact = (
        Problem(FetchSimulator(place, space, threads=1), FetchTask(place), BoxUniform(space))
        for place in (scene(name, lean=True), scene(name))
    )
    return Fetch(lean, exact)


def objective(
    made: Fetch, settings: DDPGSettings = LEARNING, *, elsewhere: float = 0.5, sees_theta: bool = False
) -> DDPG:
    """DDPG with hindsight.

    Args:
        made: the task.
        settings: of DDPG.
        elsewhere: share of a minibatch from steps that lead elsewhere; see :class:`Hindsight`.
        sees_theta: whether actor and critic see the world's parameters (Yu et al., Preparing for the Unknown: Learning
            a Universal Policy with Online System Identification, 2017). On a machine a belief's mean stands there.
    """
    return ddpg(
        *made.lean.specs,
        settings,
        in_keys=["observation", "desired_goal", *(["theta"] if sees_theta else [])],
        hindsight=Hindsight(made.task.goal_reward, elsewhere=elsewhere),
    )


def demonstrate(made: Fetch, learner: DDPG, worlds: Distribution, batches: int, seed: int) -> None:
    """Show what :class:`~envs.fetch.ScriptedPusher` does, a tenth of its actions at random, in 64 worlds a batch."""
    low, high = made.task.action_spec.space.low, made.task.action_spec.space.high
    shaken = TensorDictModule(Exploration(low, high, epsilon=0.1, noise=0.1), ["action"], ["action"])
    env = made.lean.worlds(WORLDS, ParameterRandomization(worlds), seed)
    policy = TensorDictSequential(ScriptedPusher(), shaken)
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        for _ in range(batches):
            learner.demonstrate(env.rollout(STEPS, policy, break_when_any_done=False))


def refuse_noise(noise: float) -> None:
    """Refuse sensors with noise.

    Raises:
        BadInput: there is some.
    """
    if noise:
        raise BadInput(f"noise {noise}", "the arm's sensors are exact: needs noise 0")


@dataclass(frozen=True)
class Success:
    """Shares of episodes.

    Attributes:
        last, ever: with the goal reached at the last step, at any step.
        at_start: with the goal reached before anything was done.
        moved: whose object, or gripper, was moved.
    """

    last: float
    ever: float
    at_start: float
    moved: float


def success(problem: Problem, policy: Policy, worlds: Distribution, episodes: int = 128, seed: int = 77) -> Success:
    """Measure the success of a policy's deterministic action in worlds of one kind."""
    found = outcomes(problem, policy, worlds, episodes, seed)
    shares = (found.reached[:, -1], found.reached.any(1), found.at_start, found.moved)
    return Success(*(float(share.double().mean()) for share in shares))


@dataclass(frozen=True)
class Outcomes:
    """Outcomes of episodes.

    Attributes:
        reached: whether the goal is reached after each step (N, T).
        at_start: whether it was before anything was done (N,).
        moved: whether the object was moved (N,).
        theta: of the worlds (N, P).
    """

    reached: Tensor
    at_start: Tensor
    moved: Tensor
    theta: Tensor


@torch.no_grad()
def outcomes(problem: Problem, policy: Policy, worlds: Distribution, episodes: int, seed: int) -> Outcomes:
    """Episodes of a policy's deterministic action."""
    task = problem.task
    assert isinstance(task, FetchTask)
    env = problem.worlds(episodes, ParameterRandomization(worlds), seed)
    env.set_seed(seed)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        data = env.rollout(task.horizon, policy, break_when_any_done=False)
    achieved, goal = data["next", "achieved_goal"], data["next", "desired_goal"]
    began = data["achieved_goal"][:, 0]
    moved = (achieved[:, -1] - began).norm(dim=-1) > MOVED
    return Outcomes(task.success(achieved, goal), task.success(began, goal[:, 0]), moved, data["theta"][:, 0])


def figures(made: Fetch, policy: Policy, truth: Float[Tensor, " P"], episodes: int = 128) -> dict[str, float]:
    """Success on the exact worlds, by name, for a run's log."""
    found = success(made.exact, policy, Point(truth), episodes)
    return {WORDS[name]: share for name, share in vars(found).items()}


def friction_estimator(epochs: int, proposal: Belief, features: TransitionFeatures | None = None) -> NeuralEstimator:
    """Trajectories -> LSTM over how object and gripper move, or over other features -> a mixture over the friction."""
    embedding = LSTMEmbedding(features if features is not None else TransitionFeatures(12, 4, view=motion))
    network = MixtureEstimator(proposal.space, embedding.size, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=epochs, batch_size=50))
