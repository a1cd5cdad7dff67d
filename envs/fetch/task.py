"""The tasks of the Fetch arm: bring the gripper, or an object, to a goal, and keep it there.

    r = 0 where |achieved - goal| <= 0.05 m, -1 elsewhere;      dense: r = - |achieved - goal|

Plappert et al., Multi-Goal Reinforcement Learning (2018); observations, starts and goals as in Gymnasium-Robotics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, final

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded

from envs.fetch.model import SUBSTEPS, Scene
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Shape, Task

THRESHOLD = 0.05
"""Within which a goal is reached [m]."""

APART = 0.1
"""Least distance of an object from the gripper at the start, seen from above [m]."""

STEP = SUBSTEPS * 0.002
"""Velocities are observed as distances in so many seconds [s]."""

RED = (0.85, 0.3, 0.3, 0.8)


@final
class FetchTask(Task):
    """One of the tasks, 50 steps of 0.04 s.

    | key               | width  | meaning                                              |
    |-------------------|--------|------------------------------------------------------|
    | ``observation``   | 10, 25 | the rows of the next table, side by side             |
    | ``achieved_goal`` | 3      | the object, or the gripper without one [m]           |
    | ``desired_goal``  | 3      | the goal [m]                                         |

    | observed                     | columns | with an object only                        |
    |------------------------------|---------|--------------------------------------------|
    | gripper [m]                  | 3       |                                            |
    | object, object - gripper [m] | 6       | yes                                        |
    | fingers [m]                  | 2       |                                            |
    | Euler angles [rad]           | 3       | yes; of the object                         |
    | velocity, angular velocity   | 6       | yes; the velocity is from the gripper's    |
    | velocity of gripper, fingers | 5       | velocities are all times .04 s             |

    Action (4,): the gripper's way in x, y, z in units of 5 cm, and its opening, which is locked and does nothing.

    Args:
        scene: of the task.
        horizon: steps of an episode.
        reward: "sparse" or "dense".

    Raises:
        BadInput: another reward, or an episode without steps.
    """

    goal_size = 3

    def __init__(self, scene: Scene, horizon: int = 50, reward: Literal["sparse", "dense"] = "sparse") -> None:
        if reward not in ("sparse", "dense") or horizon < 1:
            raise BadInput(f"reward {reward!r}, horizon {horizon}", "needs 'sparse' or 'dense', and a step or more")
        self.scene, self.horizon, self.sparse = scene, horizon, reward == "sparse"
        self.observation_size = 10 if scene.object_column is None else 25
        self.observation_sizes: Mapping[str, int] = {
            "observation": self.observation_size,
            "achieved_goal": 3,
            "desired_goal": 3,
        }
        self.action_spec = Bounded(-1.0, 1.0, shape=(4,), dtype=torch.float32)
        self.channels = _channels(scene.object_column is not None)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """The scene's posture; the object anywhere around the gripper but under it, the goal anywhere in its square."""
        n, scene = len(theta), self.scene
        qpos, qvel = (theta.new_tensor(row).expand(n, -1).clone() for row in (scene.qpos, scene.qvel))
        if scene.object_column is not None:
            qpos[:, scene.object_column : scene.object_column + 2] = self._places(qpos, generator)
        state = {"qpos": qpos, "qvel": qvel, "task": {"goal": self._goals(qpos, generator)}}
        return TensorDict(state, batch_size=(n,), device=theta.device)

    def _places(self, like: Tensor, generator: torch.Generator) -> Float[Tensor, "n 2"]:
        """Uniform in a square, drawn again where they are too near."""
        middle = like.new_tensor(self.scene.grip[:2])
        places, wrong = middle.expand(len(like), 2).clone(), torch.arange(len(like), device=like.device)
        while len(wrong):
            places[wrong] = middle + self.scene.object_range * _square(len(wrong), 2, like, generator)
            wrong = wrong[(places[wrong] - middle).norm(dim=-1) < APART]
        return places

    def _goals(self, like: Tensor, generator: torch.Generator) -> Float[Tensor, "n 3"]:
        middle = like.new_tensor(self.scene.grip + self.scene.goal_offset)
        goals = middle + self.scene.goal_range * _square(len(like), 3, like, generator)
        if self.scene.object_height is not None:
            goals[:, 2] = self.scene.object_height
        return goals

    def observe(self, state: TensorDictBase) -> dict[str, Tensor]:
        """See the class."""
        return {key: value.to(torch.float32) for key, value in self.exactly(state).items()}

    def exactly(self, state: TensorDictBase) -> dict[str, Float[Tensor, "N _"]]:
        """Observe a state, in the precision of the state."""
        place, velocity = state.get("grip").split(3, dim=-1)
        fingers = list(self.scene.fingers)
        opening, closing = state.get("qpos")[..., fingers], state.get("qvel")[..., fingers] * STEP
        velocity = velocity * STEP
        if self.scene.object_column is None:
            seen, achieved = [place, opening, velocity, closing], place
        else:
            achieved, euler, moving, turning = state.get("object").split(3, dim=-1)
            seen = [place, achieved, achieved - place, opening, euler]
            seen += [moving * STEP - velocity, turning * STEP, velocity, closing]
        goal = state.get(("task", "goal"))
        return {"observation": torch.cat(seen, dim=-1), "achieved_goal": achieved, "desired_goal": goal}

    def command(self, action: Tensor) -> Float[Tensor, "N 3"]:
        """The hand's way, in units of 5 cm."""
        return action[..., :3].clamp(-1, 1)

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Of the state that is reached."""
        seen = self.observe(after)  # in single precision, as who asks again has them
        return self.goal_reward(seen["achieved_goal"], seen["desired_goal"])

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Never: the goal is to be kept."""
        return torch.zeros(state.batch_size, dtype=torch.bool, device=state.device)

    def goal_reward(
        self, achieved: Float[Tensor, "*batch 3"], desired: Float[Tensor, "*batch 3"]
    ) -> Float[Tensor, "*batch"]:
        """See the module."""
        distance = (achieved - desired).norm(dim=-1)
        return -(distance > THRESHOLD).to(torch.float32) if self.sparse else -distance

    def success(
        self, achieved: Float[Tensor, "*batch 3"], desired: Float[Tensor, "*batch 3"]
    ) -> Bool[Tensor, "*batch"]:
        """Check whether the goal is reached."""
        return (achieved - desired).norm(dim=-1) < THRESHOLD

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The goal."""
        return (Shape("goal", "sphere", (0.02,), RED, moving=False),)

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 1 7"]:
        """Return the poses of the goal; see :class:`~onlinebayes.simulators.Drawable`."""
        goal = states.get(("task", "goal"))
        upright = goal.new_tensor((1.0, 0.0, 0.0, 0.0)).expand(len(goal), -1)
        return torch.cat((goal, upright), dim=-1)[:, None]


def _square(n: int, width: int, like: Tensor, generator: torch.Generator) -> Float[Tensor, "n width"]:
    """Uniform in -1 .. 1."""
    return 2 * torch.rand(n, width, dtype=like.dtype, device=like.device, generator=generator) - 1


def _channels(has_object: bool) -> Mapping[str, Mapping[str, str]]:
    """Names and units of all columns, in their order."""
    way, fingers = f"m per {STEP:g} s", ("right finger", "left finger")
    place, opening = {f"gripper {axis}": "m" for axis in "xyz"}, dict.fromkeys(fingers, "m")
    moving = {**{f"gripper velocity {axis}": way for axis in "xyz"}, **{f"{each} velocity": way for each in fingers}}
    seen = {**place, **opening, **moving}
    if has_object:
        seen = {
            **place,
            **{f"{what} {axis}": "m" for what in ("object", "object - gripper") for axis in "xyz"},
            **opening,
            **{f"object Euler angle {axis}": "rad" for axis in "xyz"},
            **{f"object - gripper velocity {axis}": way for axis in "xyz"},
            **{f"object angular velocity {axis}": f"rad per {STEP:g} s" for axis in "xyz"},
            **moving,
        }
    return {
        "observation": seen,
        "achieved_goal": {f"reached {axis}": "m" for axis in "xyz"},
        "desired_goal": {f"goal {axis}": "m" for axis in "xyz"},
        "action": {**{f"way {axis}": "5 cm" for axis in "xyz"}, "opening (locked)": ""},
    }


def motion(observation: Float[Tensor, "*batch 25"]) -> Float[Tensor, "*batch 12"]:
    """Return the features that show friction: object - gripper [m], velocity of the object [m/s], its angular velocity
    [rad/s], the gripper's velocity [m/s]. In an observation the object's velocity is seen from the moving gripper."""
    gripper = observation[..., 20:23]
    moving, turning = observation[..., 14:17] + gripper, observation[..., 17:20]
    return torch.cat([observation[..., 6:9], moving / STEP, turning / STEP, gripper / STEP], dim=-1)
