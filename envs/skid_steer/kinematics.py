r"""A skid-steered robot as a unicycle whose centre of rotation lies in front of its origin or behind it.

    v = r (w_right + w_left) / 2                                forward speed [m/s]
    w = r (w_right - w_left) / b                                yaw rate [rad/s]
    x'   = x   + dt (v cos(yaw) + x_icr w sin(yaw))
    y'   = y   + dt (v sin(yaw) - x_icr w cos(yaw))
    yaw' = yaw + dt w

r wheel radius [m], b axial distance [m], x_icr displacement of the instant centre of rotation (ICR) along the robot's
axis [m], w_right and w_left the wheels' speeds [rad/s]. K. Kozlowski and D. Pazderski, Modeling and control of a
4-wheel skid-steering mobile robot, Int. J. Appl. Math. Comput. Sci. 14(4), 2004.

The wheels' speeds are the commands, so that the robot has no inertia and a trajectory is a sum: ``rollout`` needs no
loop over time. ``envs/measured/skid_steer`` is the same law behind a driver, wheels and tyres that take their time.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, Self, final

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from envs.skid_steer import picture
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Shape, Simulator
from onlinebayes.simulators.effects import Effect

MAX_WHEEL_SPEED = math.pi
"""The wheels turn at half a revolution a second at most [rad/s]."""

PHYSICAL = ParameterSpace(
    {
        "radius": Parameter(0.001, 1.0, "m"),
        "axial_distance": Parameter(0.01, 10.0, "m"),
        "x_icr": Parameter(-5.0, 5.0, "m"),
    }
)
"""Every parameter with its physical bounds, not a prior."""

DEFAULTS = {"radius": 0.0625, "axial_distance": 0.475, "x_icr": 0.2}
"""Of a small robot [m]."""


@final
class SkidSteerKinematics(Simulator):
    """N robots on a plane.

    | key of a state | shape  | meaning                                                                             |
    |----------------|--------|-------------------------------------------------------------------------------------|
    | ``"qpos"``     | (N, 3) | x, y [m], yaw [rad], not wrapped                                                    |
    | ``"qvel"``     | (N, 3) | forward and leftward speed [m/s], in the robot's frame, and yaw rate [rad/s] of the |
    |                |        | last step; 0 after a reset, which never reads it                                    |

    Commands (N, 2): speeds of the right and the left wheels [rad/s], cut off at :data:`MAX_WHEEL_SPEED`.

    Args:
        parameters: the free ones and their bounds, in the order of theta; or just their names, with the bounds of
            :data:`PHYSICAL`. The others rest at :data:`DEFAULTS`.
        worlds: number of worlds N.
        dt: seconds between two commands [s].
        dtype, device: of all tensors.

    Raises:
        BadInput: a parameter that the robot does not have, a ``dt`` that is not positive, no world.
    """

    _theta: Tensor
    _pose: Tensor
    _speed: Tensor
    _failed: Tensor

    def __init__(
        self,
        parameters: ParameterSpace | Sequence[str] = (),
        worlds: int = 1,
        *,
        dt: float = 0.1,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> None:
        if not isinstance(parameters, ParameterSpace):
            parameters = PHYSICAL.subspace(parameters)
        for name in parameters:
            PHYSICAL.index(name)
        if not 0.0 < dt < math.inf:
            raise BadInput(f"dt = {dt:g} s", "it must be positive and finite")
        self.parameters, self.dt, self.dtype = parameters, dt, dtype
        self.device = torch.empty(0, device=device).device  # "cuda" becomes "cuda:0"
        self._populate(worlds)

    def _populate(self, worlds: int) -> None:
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        self.worlds = worlds
        self.reset(self.nominal.expand(worlds, -1))

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The defaults."""
        values = {name: DEFAULTS[name] for name in self.parameters}
        return self.parameters.vector(values, dtype=self.dtype, device=self.device)

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds."""
        parts = {"qpos": self._pose.clone(), "qvel": self._speed.clone()}
        return TensorDict(parts, batch_size=(self.worlds,), device=self.device)

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds whose command was no number since their last reset."""
        return self._failed.clone()

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; see :meth:`Simulator.reset`."""
        theta = theta.to(self.device, self.dtype, copy=True)
        pose, failed = self._pose_of(state, self.worlds), torch.zeros(self.worlds, dtype=torch.bool, device=self.device)
        speed = torch.zeros_like(pose)
        if mask is not None:
            rows = mask.to(self.device)[:, None]
            theta, pose = torch.where(rows, theta, self._theta), torch.where(rows, pose, self._pose)
            speed, failed = torch.where(rows, speed, self._speed), self._failed & ~rows[:, 0]
        self._theta, self._pose, self._speed, self._failed = theta, pose, speed, failed
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt``."""
        speed = torch.stack(self._speeds(self._theta, self._wheels(inputs)), dim=-1)
        pose = torch.cat(_path(self._pose, [part[:, None] for part in speed.unbind(-1)], self.dt), dim=-1)
        self._failed = self._failed | ~pose.isfinite().all(-1)
        held = self._failed[:, None]
        self._pose, self._speed = torch.where(held, self._pose, pose), torch.where(held, self._speed, speed)
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds, as sums over the steps; see :meth:`Simulator.rollout`. A timestep is ``dt``."""
        marks = [round(time / self.dt) for time in times.tolist()]
        speeds = self._speeds(theta.to(self.device, self.dtype)[:, None], self._wheels(inputs))
        start = self._pose_of(state, len(theta))
        if marks == list(range(1, len(marks) + 1)):
            rows = _state(_path(start, speeds, self.dt), speeds)
        else:
            at = torch.tensor(marks, device=self.device)
            held = torch.diff(at, prepend=at.new_zeros(1))
            path = _path(start, [part.repeat_interleave(held, dim=1) for part in speeds], self.dt)
            rows = _state([part[:, at - 1] for part in path], speeds)
        valid = torch.ones(rows.batch_size, dtype=torch.bool, device=self.device)
        if not bool(rows["qpos"].sum().isfinite()):
            valid = rows["qpos"].isfinite().all(-1)
            rows = _held(rows, valid, start)
        return rows.set("valid", valid)

    def with_effect(self, effect: Effect) -> Self:
        """Refused: a robot without forces carries no effect; ``envs/measured/skid_steer`` carries them."""
        raise BadInput(f"{effect.key} has no form in a kinematic robot", "use a simulator with forces for it")

    def with_worlds(self, worlds: int) -> Self:
        """A new simulator with another number of worlds, all nominal and at the origin."""
        other = copy.copy(self)
        other._populate(worlds)
        return other

    def snapshot(self) -> dict[str, Any]:
        """Return the state of all worlds; see :class:`~onlinebayes.simulators.snapshots.Resumable`."""
        parts = {"theta": self._theta, "pose": self._pose, "speed": self._speed, "failed": self._failed}
        return {key: value.clone() for key, value in parts.items()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken."""
        parts = (snapshot[key].to(self.device, copy=True) for key in ("theta", "pose", "speed", "failed"))
        self._theta, self._pose, self._speed, self._failed = parts

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The robot with its parameters; see :mod:`~envs.skid_steer.picture`."""
        radius, axial, _ = self._values(theta)
        return picture.shapes(float(radius), float(axial))

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T S 7"]:
        """Return the poses of its parts; see :class:`~onlinebayes.simulators.Drawable`."""
        radius, axial, x_icr = self._values(theta)
        return picture.poses(float(radius), float(axial), float(x_icr), states.get("qpos"))

    def _values(self, theta: Float[Tensor, "*batch P"]) -> tuple[Tensor, Tensor, Tensor]:
        """Radius, axial distance and displacement of the ICR (*batch), those that are not free at their defaults."""
        values = self.parameters.view(theta)
        values |= {name: theta.new_tensor(value) for name, value in DEFAULTS.items() if name not in values}
        return values["radius"], values["axial_distance"], values["x_icr"]

    def _wheels(self, inputs: TensorDictBase) -> Float[Tensor, "*batch 2"]:
        """Speeds of the right and the left wheels [rad/s]."""
        wheels = inputs.get("command").to(self.device, self.dtype).clamp(-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED)
        enable = inputs.get("enable", None)
        return wheels if enable is None else wheels * enable.to(wheels)

    def _speeds(self, theta: Float[Tensor, "*#batch P"], wheels: Float[Tensor, "*#batch 2"]) -> tuple[Tensor, ...]:
        """Forward and leftward speed and yaw rate (*batch); see the module."""
        radius, axial, x_icr = self._values(theta)
        right, left = wheels.unbind(-1)
        rate = radius / axial * (right - left)
        return 0.5 * radius * (right + left), -x_icr * rate, rate

    def _pose_of(self, state: TensorDictBase | None, worlds: int) -> Float[Tensor, "M 3"]:
        if state is None:
            return torch.zeros(worlds, 3, dtype=self.dtype, device=self.device)
        return state.get("qpos").to(self.device, self.dtype, copy=True)


def _path(start: Float[Tensor, "M 3"], speeds: Sequence[Float[Tensor, "M T"]], dt: float) -> list[Tensor]:
    """x, y and yaw (M, T) after each of T steps at forward and leftward speeds and yaw rates; see the module."""
    forward, left, rate = speeds
    x, y, yaw = start[:, :, None].unbind(1)
    after = yaw + dt * rate.cumsum(1)
    before = torch.cat((yaw, after[:, :-1]), dim=1)
    cos, sin = before.cos(), before.sin()
    along, across = forward * cos - left * sin, forward * sin + left * cos
    return [x + dt * along.cumsum(1), y + dt * across.cumsum(1), after]


def _state(pose: Sequence[Float[Tensor, "*batch"]], speed: Sequence[Float[Tensor, "*batch"]]) -> TensorDict:
    parts = {"qpos": torch.stack(tuple(pose), dim=-1), "qvel": torch.stack(tuple(speed), dim=-1)}
    return TensorDict(parts, batch_size=pose[0].shape, device=pose[0].device)


def _held(rows: TensorDict, valid: Bool[Tensor, "M T"], start: Float[Tensor, "M 3"]) -> TensorDict:
    """The rows, those that are not valid as the last valid one, or as the start at rest."""
    index = valid.long().cumsum(1)[..., None].expand(-1, -1, 3)
    firsts = {"qpos": start[:, None], "qvel": torch.zeros_like(start[:, None])}
    held = {key: torch.cat((first, rows[key]), dim=1).gather(1, index) for key, first in firsts.items()}
    return TensorDict(held, batch_size=rows.batch_size, device=rows.device)
