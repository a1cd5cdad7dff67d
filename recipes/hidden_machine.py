r"""Machines that hide an effect: equations, integrator and laws written apart from the library's own.

    M(q) dv/dt = f(q, v) + B clip(u(t - T)) - e_j F sign(v_j)

An instant is a millisecond, and all forces are held over it: a Runge-Kutta step. A joint that turns round within one is
stopped at its end. A joint at rest stays there, to the last bit, while the force that holds it is no larger than F. A
command takes effect T after it was given, to the millisecond; before the first it was none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Simulator

INSTANT = 1e-3  # [s]

Acceleration = Callable[[Mapping[str, Tensor], Tensor, Tensor, Tensor], Tensor]
"""(parameters (N,), q, v, generalised forces (N, J)) -> accelerations (N, J)."""


@dataclass(frozen=True)
class Equations:
    """A machine without what it hides.

    Args:
        acceleration: of its joints.
        push: (parameters, command cut off (N, 1)) -> generalised forces (N, J) [N, N m].
        joints: number of joints J.
        limit: at which the command is cut off.
        top_speed: at which velocities are cut off [m/s, rad/s].
    """

    acceleration: Acceleration
    push: Callable[[Mapping[str, Tensor], Tensor], Tensor]
    joints: int
    limit: float
    top_speed: float = float("inf")


@dataclass(frozen=True)
class Hidden:
    """Effects of a machine that its model does not know.

    Args:
        friction: bound F of a dry friction [N, N m].
        joint: index of the joint that it acts on.
        delay: dead time T of the actuator [s].
    """

    friction: float = 0.0
    joint: int = 0
    delay: float = 0.0


class Machine(Simulator):
    """N machines side by side, to be asked for trajectories and to judge a policy on; no log is replayed here.

    Args:
        equations: of motion.
        parameters: of the model, which the machine has too; nothing is said of what is hidden.
        hidden: beside them.
        dt: control period [s].
        worlds: number of machines N.
    """

    _theta: Tensor
    _q: Tensor
    _v: Tensor
    _commands: Tensor

    def __init__(
        self, equations: Equations, parameters: ParameterSpace, hidden: Hidden, dt: float, worlds: int = 1
    ) -> None:
        self.equations, self.parameters, self.hidden, self.dt = equations, parameters, hidden, dt
        self.device, self.dtype = torch.device("cpu"), torch.float64
        self._late, self._instants = round(hidden.delay / INSTANT), round(dt / INSTANT)
        self.worlds = worlds
        self.reset(self.nominal.expand(worlds, -1))

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The middle of the bounds."""
        return self.parameters.from_unit(torch.full((len(self.parameters),), 0.5, dtype=self.dtype))

    @property
    def state(self) -> TensorDict:
        """Positions and velocities, and the commands that are still on their way, an instant each."""
        parts = {"qpos": self._q.clone(), "qvel": self._v.clone(), "late": self._commands.clone()}
        return TensorDict(parts, batch_size=(self.worlds,))

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """Of each machine."""
        return self._theta.clone()

    @property
    def failed(self) -> Tensor:
        """None ever."""
        return torch.zeros(self.worlds, dtype=torch.bool)

    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        """New parameters and states for the machines under ``mask``."""
        start = state if state is not None else TensorDict(batch_size=(self.worlds,))
        J = self.equations.joints
        fresh = {
            "_theta": theta.to(self.dtype),
            "_q": start.get("qpos", torch.zeros(self.worlds, J)).to(self.dtype),
            "_v": start.get("qvel", torch.zeros(self.worlds, J)).to(self.dtype),
            "_commands": start.get("late", torch.zeros(self.worlds, self._late)).to(self.dtype),
        }
        for name, value in fresh.items():
            setattr(
                self, name, value.clone() if mask is None else torch.where(mask[:, None], value, getattr(self, name))
            )
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """One control period."""
        command = inputs.get("command").to(self.dtype).clamp(-self.equations.limit, self.equations.limit)
        line = torch.cat([self._commands, command.expand(-1, self._instants)], dim=1)
        self._commands = line[:, line.shape[1] - self._late :]
        values = dict(zip(self.parameters.names, self._theta.unbind(-1), strict=True))
        for k in range(self._instants):
            self._advance(values, self.equations.push(values, line[:, k : k + 1]))
        return self.state

    def _advance(self, values: Mapping[str, Tensor], force: Tensor) -> None:
        """An instant."""
        q, v, j = self._q, self._v, self.hidden.joint
        if not self.hidden.friction:
            self._q, self._v = self._flown(values, force)
            return
        bound, none = self.hidden.friction, torch.zeros_like(q)
        one = none.index_fill(1, torch.tensor([j]), 1.0)
        acceleration = self.equations.acceleration
        mobility = acceleration(values, q, v, one) - acceleration(values, q, v, none)  # a column of M^-1
        free = acceleration(values, q, v, force)[:, j]
        holding, resting = -free / mobility[:, j], v[:, j] == 0
        stuck = resting & (holding.abs() <= bound)
        rubbing = torch.where(stuck, holding, -bound * torch.sign(torch.where(resting, free, v[:, j])))
        after_q, after_v = self._flown(values, force + rubbing[:, None] * one)
        stops = stuck | (after_v[:, j] * v[:, j] < 0)
        impulse = torch.where(stops, -after_v[:, j] / mobility[:, j], torch.zeros_like(free))
        self._v = torch.where(stops[:, None] & (one > 0), none, after_v + impulse[:, None] * mobility)
        self._q = torch.where(stuck[:, None] & (one > 0), q, after_q)

    def _flown(self, values: Mapping[str, Tensor], force: Tensor) -> tuple[Tensor, Tensor]:
        """A Runge-Kutta step under a constant force."""
        h, q, v = INSTANT, self._q, self._v

        def rate(dq: Tensor, dv: Tensor, by: float) -> tuple[Tensor, Tensor]:
            moved = v + by * dv
            return moved, self.equations.acceleration(values, q + by * dq, moved, force)

        none = torch.zeros_like(q)
        a = rate(none, none, 0.0)
        b = rate(*a, h / 2)
        c = rate(*b, h / 2)
        d = rate(*c, h)
        top = self.equations.top_speed
        after = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        return q + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]), after.clamp(-top, top)

    def rollout(self, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, times: Tensor) -> TensorDict:
        """Not of a machine."""
        raise BadInput("a real machine cannot be replayed", "replay the model")

    def with_effect(self, effect: Any) -> Self:
        """Not of a machine."""
        raise BadInput(f"a real machine cannot be given {effect.key}", "add it to the model")

    def with_worlds(self, worlds: int) -> Machine:  # type: ignore[override]
        """More of the same."""
        return Machine(self.equations, self.parameters, self.hidden, self.dt, worlds)


def _pendulum(values: Mapping[str, Tensor], q: Tensor, v: Tensor, force: Tensor) -> Tensor:
    """A uniform rod about its end, angle from upright: m l^2 / 3 a = m g l / 2 sin(q) + force, g = 10."""
    length, mass = values["length"][:, None], values["mass"][:, None]
    return (5.0 * mass * length * torch.sin(q) + force) / (mass * length**2 / 3.0)


def _cartpole(values: Mapping[str, Tensor], q: Tensor, v: Tensor, force: Tensor) -> Tensor:
    """Cart of 1 kg and a uniform rod on it, by half its length, by its mass matrix, g = 9.8."""
    length, m = values["length"], values["mass"]
    sin, cos = torch.sin(q[:, 1]), torch.cos(q[:, 1])
    cart, pole, both = 1.0 + m, 4.0 / 3.0 * m * length**2, m * length * cos
    on_cart, on_pole = force[:, 0] + m * length * v[:, 1] ** 2 * sin, force[:, 1] + 9.8 * m * length * sin
    determinant = cart * pole - both**2
    return (
        torch.stack([(pole * on_cart - both * on_pole), (cart * on_pole - both * on_cart)], -1) / determinant[:, None]
    )


PENDULUM = Equations(_pendulum, lambda values, command: command, 1, limit=2.0, top_speed=8.0)
CARTPOLE = Equations(
    _cartpole, lambda values, command: torch.cat([10.0 * command, torch.zeros_like(command)], -1), 2, limit=1.0
)
