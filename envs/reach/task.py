"""Bring the fingertip to a goal that is elsewhere in every episode, and keep it there; nothing says how near it is.

    r = 0 where |tip - goal| < 0.025 m, -1 elsewhere

Exploration hardly ever meets the goal by chance, so that without hindsight there is next to nothing to learn from
(Andrychowicz et al. 2017; the goal is Gymnasium-Robotics' kind, in joint space).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from envs.reach.physics import fingertip
from onlinebayes.simulators import Shape, Task

START = (0.0, 0.9, -1.5)
"""Yaw, shoulder and elbow at the start [rad]: the fingertip is 0.43 m in front of the turret."""

SPAN = (1.3, 0.7, 0.8)
"""Goals are where the fingertip comes with each joint turned by up to so much from the start [rad]."""

AWAY = 0.15
"""Least distance of a goal from the fingertip at the start [m]."""

TOLERANCE = 0.025
"""Within which a goal is reached [m]."""

GREEN = (0.25, 0.65, 0.35, 1.0)


JOINTS = ("yaw", "shoulder", "elbow")


class ReachTask(Task):
    """Reach a goal in 50 steps of 0.04 s.

    | key               | width | meaning                                                                          |
    |-------------------|-------|----------------------------------------------------------------------------------|
    | ``observation``   | 12    | cosines and sines of the joint angles, their rates [rad/s], the fingertip [m]    |
    | ``achieved_goal`` | 3     | the fingertip [m]                                                                |
    | ``desired_goal``  | 3     | the goal [m]                                                                     |

    Action: the three motors in [-1, 1].

    Args:
        horizon: steps of an episode.
        tolerance: within which a goal is reached [m].
    """

    observation_size = 12
    observation_sizes: Mapping[str, int] = {"observation": 12, "achieved_goal": 3, "desired_goal": 3}
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {
            **{f"{function} {joint}": "" for function in ("cos", "sin") for joint in JOINTS},
            **{f"{joint} rate": "rad/s" for joint in JOINTS},
            **{f"fingertip {axis}": "m" for axis in "xyz"},
        },
        "achieved_goal": {f"reached {axis}": "m" for axis in "xyz"},
        "desired_goal": {f"goal {axis}": "m" for axis in "xyz"},
        "action": {f"{joint} motor": "of its limit" for joint in JOINTS},
    }
    goal_size = 3

    def __init__(self, horizon: int = 50, tolerance: float = TOLERANCE) -> None:
        self.horizon, self.tolerance = horizon, tolerance
        self.action_spec = Bounded(-1.0, 1.0, shape=(3,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """At rest in one posture; goals among postures around it, none nearer than :data:`AWAY`."""
        begin = theta.new_tensor(START).expand(len(theta), -1)
        state = {"qpos": begin, "qvel": torch.zeros_like(begin), "task": {"goal": _goals(begin, generator)}}
        return TensorDict(state, batch_size=(len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> dict[str, Tensor]:
        """See the class."""
        qpos = state.get("qpos")
        tip = fingertip(qpos)
        seen = torch.cat((qpos.cos(), qpos.sin(), state.get("qvel"), tip), dim=-1)
        values = {"observation": seen, "achieved_goal": tip, "desired_goal": state.get(("task", "goal"))}
        return {key: value.to(torch.float32) for key, value in values.items()}

    def command(self, action: Tensor) -> Float[Tensor, "N 3"]:
        """The motors' commands, shares of their gears."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Zero at the goal, minus one elsewhere."""
        seen = self.observe(after)  # in single precision, as who asks again has them
        return self.goal_reward(seen["achieved_goal"], seen["desired_goal"])

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never: the goal is to be kept."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state.device)

    def goal_reward(
        self, achieved: Float[Tensor, "*batch 3"], desired: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch"]:
        """Zero where the goal is reached, minus one elsewhere."""
        return self.success(achieved, desired).to(torch.float32) - 1

    def success(
        self, achieved: Float[Tensor, "*batch 3"], desired: Float[Tensor, "*batch 3"]
    ) -> Bool[Tensor, "*batch"]:
        """Check whether the fingertip is within the tolerance of the goal."""
        return (achieved - desired).norm(dim=-1) < self.tolerance

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The goal, as large as its tolerance."""
        return (Shape("goal", "sphere", (self.tolerance,), GREEN, moving=False),)

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 1 7"]:
        """Return the poses of the goal; see :class:`~onlinebayes.simulators.Drawable`."""
        goal = states.get(("task", "goal"))
        upright = goal.new_tensor((1.0, 0.0, 0.0, 0.0)).expand(len(goal), -1)
        return torch.cat((goal, upright), dim=-1)[:, None]


def _goals(begin: Float[Tensor, "n 3"], generator: torch.Generator) -> Float[Tensor, "n 3"]:
    """Postures uniform around the start, drawn again where they are too near."""
    tip, span = fingertip(begin), begin.new_tensor(SPAN)
    goals, open_rows = torch.empty_like(tip), torch.arange(len(tip), device=tip.device)
    while len(open_rows):
        draw = torch.rand(len(open_rows), 3, dtype=tip.dtype, device=tip.device, generator=generator)
        goals[open_rows] = fingertip(begin[open_rows] + (2 * draw - 1) * span)
        open_rows = open_rows[(goals[open_rows] - tip[open_rows]).norm(dim=-1) < AWAY]
    return goals
