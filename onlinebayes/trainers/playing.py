"""An episode as a drawing: played by the hidden system where its parameters are known, and by the simulator beside it.

The simulator stands at the belief's mean; the same policy drives it from the same start. Under the commands of the
other one it would soon be elsewhere where the motion is unstable, however right the belief is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.simulators import Drawable, Shape
from onlinebayes.simulators.drawing import scene
from onlinebayes.trainers.problem import Problem
from onlinebayes.trainers.simulations import Point
from onlinebayes.trainers.state import OnlineState, mean_of
from onlinebayes.trainers.trajectories import Policy, rolled_out
from onlinebayes.transforms import ParameterRandomization

MOST_STEPS = 500  # of an episode


@dataclass(frozen=True)
class Episode:
    """One system along one episode.

    Attributes:
        shapes: of the system.
        poses: (T, S, 7).
        dt: between two poses [s].
        longest: that an episode of this task may be [steps].
    """

    shapes: tuple[Shape, ...]
    poses: Float[Tensor, "T S 7"]
    dt: float
    longest: int = MOST_STEPS


Player = Callable[[OnlineState], Mapping[str, Episode]]
"""After a step: episodes by name, ``"real"`` first and ``"simulated"`` beside it; none where nothing can be drawn."""


@dataclass(frozen=True)
class SimulatedPlayer:
    """Plays a problem's task.

    Args:
        problem: system and task; if it can be drawn, there is something to show.
        policy: that is trained.
        truth: parameters of the hidden system (P,), where they are known.
        system: the hidden system with the same task, where it is another one than the problem's at other parameters.
    """

    problem: Problem
    policy: Policy
    truth: Float[Tensor, " P"] | None = None
    system: Problem | None = None

    def __call__(self, state: OnlineState) -> dict[str, Episode]:
        """The episodes after a step."""
        simulator, drawn = self.problem.simulator, (self.problem.simulator, self.problem.task)
        if not isinstance(simulator, Drawable):
            return {}
        mean = mean_of(state.records[-1], simulator.parameters).to(simulator.dtype)
        truth = mean if self.truth is None else self.truth
        states = play(self.system or self.problem, self.policy, truth)
        if self.system is not None:  # what else it remembers is its own, and it is drawn as the simulator is
            states, truth = states.exclude("effects"), mean
        longest = steps_of(self.problem)
        episodes = {"real": Episode(*scene(drawn, truth, states), simulator.dt, longest)}
        if self.truth is not None:
            path = play(self.problem, self.policy, mean)
            episodes["simulated"] = Episode(*scene(drawn, mean, path), simulator.dt, longest)
        return episodes


@torch.no_grad()
def play(problem: Problem, policy: Policy, theta: Float[Tensor, " P"]) -> TensorDict:
    """States (T + 1,) of one episode under the policy's deterministic action, to its end; its start is always one."""
    env = problem.worlds(1, ParameterRandomization(Point(theta)), seed=0, with_state=True)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        data = rolled_out(env, policy, steps_of(problem), to_end=True)[0]
    states = cast(TensorDict, torch.cat([data["state"], data["next", "state"][-1:]]))
    return states.exclude("theta", "steps")


def steps_of(problem: Problem) -> int:
    """Longest episode that is shown."""
    return min(problem.task.horizon, MOST_STEPS)
