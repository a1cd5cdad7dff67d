r"""Mountain car: an engine too weak for the slope, in a valley that has to be swung out of.

    v' = v + (force u - gravity cos 3x),   x' = x + v',   |v| <= 0.07,   -1.2 <= x <= 0.6, a wall at both ends

x position, v speed; time counts in steps, so that all units are lengths and steps. The same systems, steps and rewards
as Gymnasium's ``MountainCar-v0`` and ``MountainCarContinuous-v0`` (Moore 1990; Sutton and Barto, Example 10.1); the
second of these keeps its state in single precision.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import ClassVar

import torch
from jaxtyping import Bool, Float, Int
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, OneHot

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator
from onlinebayes.simulators.drawing import BLUE, DARK, RED, Shape, planar

MAX_SPEED = 0.07  # [lengths/step]
LOW, HIGH = -1.2, 0.6  # walls
PIECES = 46  # of the road, in drawings
GREEN = (0.55, 0.68, 0.52, 1.0)


class Valley(TorchSimulator, ABC):
    """The hill of both cars; a subclass says what its engine's strength is called."""

    joints = (Joint("car", "slide", max_speed=MAX_SPEED, low=LOW, high=HIGH),)
    timestep = 1.0
    flag: ClassVar[float]  # where drawings show the goal

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Acceleration of the car; see the module."""
        return tau - parameters["gravity"] * torch.cos(3 * q)

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The hill, a flag at the goal, and the car."""
        vertices, faces = hill()
        return (
            Shape("hill", "mesh", (), GREEN, moving=False, vertices=vertices, faces=faces),
            Shape("pole", "box", (0.005, 0.005, 0.11), DARK, moving=False),
            Shape("flag", "box", (0.05, 0.003, 0.03), RED, moving=False),
            Shape("car", "box", (0.065, 0.04, 0.025), BLUE),
            Shape("rear_wheel", "sphere", (0.022,), DARK),
            Shape("front_wheel", "sphere", (0.022,), DARK),
        )

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T 6 7"]:
        """See :class:`~onlinebayes.simulators.Drawable`."""
        x = states.get("qpos")[..., 0]
        at, zero = torch.full_like(x, self.flag), torch.zeros_like(x)
        pole, flag = planar(at, height(at) + 0.11, zero), planar(at - 0.05, height(at) + 0.19, zero)

        def on_road(forward: float, above: float, y: float) -> Tensor:
            sin, cos = torch.sin(slope(x)), torch.cos(slope(x))
            return planar(x + forward * cos - above * sin, height(x) + forward * sin + above * cos, -slope(x), y)

        car = on_road(0.0, 0.05, 0.0), on_road(-0.035, 0.022, -0.03), on_road(0.035, 0.022, -0.03)
        return torch.stack((planar(zero, zero, zero), pole, flag, *car), dim=1)


class MountainCar(Valley):
    """Batched mountain car; the command is -1, 0 or 1."""

    physical = ParameterSpace(
        {"force": Parameter(1e-5, 0.1, "length/step2", "log"), "gravity": Parameter(0.0, 0.05, "length/step2")}
    )
    defaults = {"force": 0.001, "gravity": 0.0025}  # noqa: RUF012
    actuators = (Actuator("engine", "car", gear="force", limit=1.0),)
    flag = 0.5


class MountainCarContinuous(Valley):
    """Batched mountain car with a throttle; the command is cut off at 1."""

    physical = ParameterSpace(
        {"power": Parameter(1e-5, 0.1, "length/step2", "log"), "gravity": Parameter(0.0, 0.05, "length/step2")}
    )
    defaults = {"power": 0.0015, "gravity": 0.0025}  # noqa: RUF012
    actuators = (Actuator("engine", "car", gear="power", limit=1.0),)
    flag = 0.45


class MountainCarTask(Task):
    """Reach the flag at 0.5: reward -1 a step; 200 steps at most.

    Observation (x, v); action one-hot of (left, nothing, right).

    Args:
        horizon: steps of an episode.
    """

    observation_size = 2
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"position": "", "velocity": ""},
        "action": {"push left": "", "no push": "", "push right": ""},
    }
    goal = 0.5

    def __init__(self, horizon: int = 200) -> None:
        self.horizon = horizon
        self.action_spec = OneHot(3, dtype=torch.int64)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Position uniform in [-0.6, -0.4], at rest."""
        return start(theta, generator)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 2"]:
        """(x, v)."""
        return torch.cat((state.get("qpos"), state.get("qvel")), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """-1, 0 or 1."""
        return (action[..., 2:] - action[..., :1]).to(torch.float64)

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Minus one, also for the step that arrives."""
        return -torch.ones(state.batch_size, dtype=torch.float32, device=state.device)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """At the flag, not on the way back."""
        return arrived(state, self.goal)


class MountainCarContinuousTask(Task):
    """Reach the flag at 0.45 with little throttle: reward 100 there, less 0.1 u^2 a step; 999 steps at most.

    Observation (x, v); action the throttle in [-1, 1].

    Args:
        horizon: steps of an episode.
    """

    observation_size = 2
    channels: Mapping[str, Mapping[str, str]] = {
        "observation": {"position": "", "velocity": ""},
        "action": {"throttle": ""},
    }
    goal = 0.45

    def __init__(self, horizon: int = 999) -> None:
        self.horizon = horizon
        self.action_spec = Bounded(-1.0, 1.0, shape=(1,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Position uniform in [-0.6, -0.4], at rest."""
        return start(theta, generator)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 2"]:
        """(x, v)."""
        return torch.cat((state.get("qpos"), state.get("qvel")), dim=-1).to(torch.float32)

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """The throttle; the simulator cuts it off."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """100 for the step that arrives, less the throttle's cost."""
        return 100.0 * self.terminated(after).double() - 0.1 * action[..., 0].double().square()

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """At the flag, not on the way back."""
        return arrived(state, self.goal)


def start(theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
    """At rest somewhere near the bottom of the valley."""
    draw = torch.rand(len(theta), 1, dtype=theta.dtype, device=theta.device, generator=generator)
    state = {"qpos": -0.6 + 0.2 * draw, "qvel": torch.zeros_like(draw)}
    return TensorDict(state, batch_size=(len(theta),), device=theta.device)


def arrived(state: TensorDictBase, goal: float) -> Bool[Tensor, " N"]:
    """Check whether the car is at the goal and does not roll back."""
    return (state.get("qpos")[..., 0] >= goal) & (state.get("qvel")[..., 0] >= 0)


def height(x: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Height of the road, for drawings: its slope is what pulls the car."""
    return 0.45 * torch.sin(3 * x) + 0.55


def slope(x: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Angle of the road [rad], for drawings."""
    return torch.atan(3 * 0.45 * torch.cos(3 * x))


def hill() -> tuple[Float[Tensor, "V 3"], Int[Tensor, "F 3"]]:
    """Front and top of the ground between the walls, as vertices and faces."""
    x = torch.linspace(LOW, HIGH, PIECES + 1, dtype=torch.float64)
    z, low = height(x), torch.zeros_like(x)
    bottom, front, back = (torch.stack((x, low + y, z), -1) for y, z in ((-0.1, low), (-0.1, z), (0.1, z)))
    i = torch.arange(PIECES)
    rows = [torch.cat((bottom, front)), torch.cat((front, back))]
    quads = torch.cat(
        (torch.stack((i, i + 1, i + PIECES + 2), -1), torch.stack((i, i + PIECES + 2, i + PIECES + 1), -1))
    )
    return torch.cat(rows), torch.cat((quads, quads + 2 * (PIECES + 1)))
