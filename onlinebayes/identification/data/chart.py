"""Free and ball joints for criticism: an orientation as three turns about the body's axes, beside the measured one.

    turn of an orientation p at the instant t = turn(t) + log(q(t)^-1 p),  q(t) the measured one (see .orientation_path)

The measured turn is then turn(t), the residual is log(q_measured^-1 q_simulated), the tangent error of
``mj_differentiatePos``, and a window's start is nv positions and nv velocities. All else in criticism sees scalar
signals; slides, hinges, linear positions and all velocities pass through untouched. A simulation that is more than half
a turn away from the measurement shows the rest to a whole turn.

| when             | what happens                                      | code                               |
|------------------|---------------------------------------------------|------------------------------------|
| once             | measured quaternions become turns                 | :func:`.replaying.charted.charted` |
| before a rollout | p = q(t) exp(turn of the start - turn(t))         | :meth:`Chart.enter`                |
| after it         | turns of the simulated orientations at every row  | :meth:`Chart.leave`                |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.coordinates import Rotation
from onlinebayes.identification.data.rotations import exponential, inverse, logarithm, product
from onlinebayes.simulators.identifiable import Identifiable

POSE = "pose"
"""Key of a trajectory's positions as the model has them, quaternions included, where ``"qpos"`` holds turns."""


@dataclass(frozen=True)
class Chart:
    """The measured orientations of B joints at the rows of W windows, to which turns are relative.

    Args:
        physics: the simulator with its own positions.
        turning: the joints; none of them where all are scalar, and then nothing is changed.
        quaternion: at the start and at each of the K rows.
        turn: measured ones there [rad].
    """

    physics: Identifiable
    turning: tuple[Rotation, ...]
    quaternion: Float[Tensor, "W K1 B 4"]
    turn: Float[Tensor, "W K1 B 3"]

    def enter(self, state: TensorDict) -> TensorDict:
        """The states of M x W worlds at their windows' starts, in the physics' own positions."""
        if not self.turning:
            return state
        turned = state["qpos"].unflatten(0, (-1, len(self.turn)))
        state = state.clone(recurse=False)
        state["qpos"] = positions(self.turning, turned, self.quaternion[:, 0], self.turn[:, 0]).flatten(0, 1)
        return state

    def leave(self, trajectory: TensorDict) -> TensorDict:
        """Trajectories (M, W, K) of the physics with turns as positions; its own ones stand under ``"pose"``."""
        if not self.turning:
            return trajectory
        trajectory = trajectory.clone(recurse=False)
        trajectory[POSE] = trajectory["qpos"]
        trajectory["qpos"] = turns(self.turning, trajectory[POSE], self.quaternion[:, 1:], self.turn[:, 1:])
        return trajectory


def positions(
    turning: Sequence[Rotation],
    turned: Float[Tensor, "*batch J"],
    quaternion: Float[Tensor, "*#batch B 4"],
    turn: Float[Tensor, "*#batch B 3"],
) -> Float[Tensor, "*batch Q"]:
    """The model's positions: every three turns as the quaternion that they stand for beside the measured one."""
    parts, begin = [], 0
    for b, rotation in enumerate(turning):
        first = rotation.first - b  # each joint before has one number less
        away = turned[..., first : first + 3] - turn[..., b, :]
        parts += [turned[..., begin:first], product(quaternion[..., b, :], exponential(away))]
        begin = first + 3
    return torch.cat([*parts, turned[..., begin:]], dim=-1)


def turns(
    turning: Sequence[Rotation],
    qpos: Float[Tensor, "*batch Q"],
    quaternion: Float[Tensor, "*#batch B 4"],
    turn: Float[Tensor, "*#batch B 3"],
) -> Float[Tensor, "*batch J"]:
    """The way back: every quaternion of the model's positions as turns beside the measured one."""
    parts, begin = [], 0
    for b, rotation in enumerate(turning):
        first = rotation.first
        away = logarithm(product(inverse(quaternion[..., b, :]), qpos[..., first : first + 4]))
        parts += [qpos[..., begin:first], turn[..., b, :] + away]
        begin = first + 4
    return torch.cat([*parts, qpos[..., begin:]], dim=-1)
