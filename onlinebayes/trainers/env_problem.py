"""Any environment with parameters in the place of a simulator: one world each, stepped one after the other.

    problem = EnvProblem(make, prior, horizon=200)        # make() gives a Parameterized
    trainer = online_trainer(problem, objective, estimator=..., real=..., schedule=..., sizes=...)

The same face as :class:`~onlinebayes.trainers.Problem`; ``look`` says what such an environment looks like, so that
:class:`EnvPlayer` can show its episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec
from torchrl.envs import SerialEnv, Transform, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from onlinebayes.inference import Belief
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import heed, torch_threads_kept
from onlinebayes.simulators import Parameterized, Shape
from onlinebayes.trainers.playing import MOST_STEPS, Episode
from onlinebayes.trainers.problem import behind_sensors
from onlinebayes.trainers.real import RealEnvironment
from onlinebayes.trainers.simulations import Point, Simulations
from onlinebayes.trainers.state import OnlineState, mean_of
from onlinebayes.trainers.trajectories import Policy, returns
from onlinebayes.transforms import ParameterRandomization

Look = Callable[[Any], tuple[tuple[Shape, ...], Float[Tensor, "S 7"]]]
"""The environment behind all wrappers -> its shapes and their poses as it stands."""


class _Beside(SerialEnv):
    """Worlds of this process, which leave torch's threads as they are where they are closed, or forgotten."""

    def close(self, **settings: Any) -> None:
        """End them."""
        with torch_threads_kept():
            super().close(**settings)


@dataclass(frozen=True)
class EnvProblem:
    """An environment with unknown parameters.

    Args:
        make: gives one world.
        prior: over its parameters.
        horizon: longest episode [steps].
        sensor_sd: standard deviation of each observed value's sensor (O,) [its unit]; None for perfect sensors.
        transforms: gives further transforms for one environment, behind the sensors.
        beside: most worlds that are simulated at once for the belief.
        episodes: by which a policy is judged.
        name: of the task, for a policy's card.
        channels: names and units of what is seen and done, as :class:`~onlinebayes.simulators.Task` gives them.
    """

    make: Callable[[], Parameterized]
    prior: Belief
    horizon: int
    sensor_sd: Float[Tensor, " O"] | None = None
    transforms: Callable[[], Iterable[Transform]] = tuple
    beside: int = 16
    episodes: int = 8
    name: str = ""
    channels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def space(self) -> ParameterSpace:
        """The unknown parameters."""
        return self.prior.space

    @property
    def specs(self) -> tuple[Composite, TensorSpec]:
        """Observation and action spec of one world, which objectives are built from."""
        env = self.make()
        return env.observation_spec_unbatched, env.action_spec_unbatched

    def worlds(self, number: int, drawn: ParameterRandomization, seed: int) -> TransformedEnv:
        """``number`` worlds, their theta drawn by a transform, seen through the sensors."""
        env = TransformedEnv(_Beside(number, self.make), drawn)
        env.set_seed(seed)
        return behind_sensors(env, self.sensor_sd, self.transforms, seed)

    def simulations(self, number: int, steps: int, seed: int) -> Simulations:
        """At most ``beside`` worlds, run as often as it takes to give ``number`` trajectories of ``steps`` steps."""
        drawn, worlds = ParameterRandomization(self.prior), min(number, self.beside)
        return Simulations(self.worlds(worlds, drawn, seed), drawn, steps, repeats=-(-number // worlds))

    def hidden(self, truth: Float[Tensor, " P"], seed: int) -> RealEnvironment:
        """One world with these parameters, in the place of a real system."""
        return RealEnvironment(self.worlds(1, ParameterRandomization(Point(truth)), seed))

    def score(self, policy: Policy, truth: Float[Tensor, " P"]) -> float:
        """Mean return of a policy's deterministic action in worlds with these parameters, behind the sensors."""
        env = self.worlds(self.episodes, ParameterRandomization(Point(truth)), 999)
        return float(returns(env, policy, self.horizon).mean())


@dataclass(frozen=True)
class EnvPlayer:
    """Plays an episode in a world of the true parameters, and its actions in one of the belief's mean.

    Both begin alike where ``set_seed`` settles how an episode begins.

    Args:
        problem: the environment.
        policy: that is trained.
        truth: parameters of the hidden system (P,).
        look: what a world looks like.
        dt: from one step to the next [s].
    """

    problem: EnvProblem
    policy: Policy
    truth: Float[Tensor, " P"]
    look: Look
    dt: float

    def __call__(self, state: OnlineState) -> dict[str, Episode]:
        """The episodes after a step."""
        steps = min(self.problem.horizon, MOST_STEPS)
        real, actions = self._played(self.truth, self.policy, steps)
        mean, again = mean_of(state.records[-1], self.problem.space), iter(actions)
        simulated, _ = self._played(mean, lambda data: data.set("action", next(again)), len(actions))
        return {"real": real, "simulated": simulated}

    @torch.no_grad()
    def _played(
        self, theta: Tensor, policy: Callable[[TensorDictBase], TensorDictBase], steps: int
    ) -> tuple[Episode, list[Tensor]]:
        """An episode to its end, and its actions."""
        world = self.problem.make()
        env = TransformedEnv(world, ParameterRandomization(Point(theta)))
        env.set_seed(7)
        env = behind_sensors(env, self.problem.sensor_sd, self.problem.transforms, 7)
        data, actions = env.reset(), list[Tensor]()
        seen = [self.look(world.inner)]
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            while len(actions) < steps:
                heed()
                data = env.step(policy(data))
                actions.append(data["action"])
                seen.append(self.look(world.inner))
                if bool(data["next", "done"].any()):
                    break
                data = step_mdp(data)
        longest = min(self.problem.horizon, MOST_STEPS)
        return Episode(seen[0][0], torch.stack([poses for _, poses in seen]), self.dt, longest), actions
