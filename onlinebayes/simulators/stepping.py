r"""One step of a mechanical system whose acceleration is given: actuators, effects, friction, integration.

    tau = gears u' + effects(q, v, gears u'),   v' = v + h a(q, v, tau),   v+ = v' with dry friction

    semi-implicit   q+ = q + h v+        (MuJoCo's Euler; Gymnasium's Pendulum)
    explicit        q+ = q + h v         (Gymnasium's CartPole)
    rk4             Runge and Kutta's method of fourth order, forces of effects at each stage (Gymnasium's Acrobot)

| term                               | code                              |
|------------------------------------|-----------------------------------|
| u' = input stages of effects of u  | :meth:`Stepper._drive`            |
| forces of effects, their hidden states | :meth:`Stepper._act`          |
| dry friction that sticks           | :meth:`Stepper._rub`, ``friction.stick`` |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.runs import heed
from onlinebayes.simulators.effects import Effect, Seen
from onlinebayes.simulators.friction import stick

Values = Mapping[str, Float[Tensor, " N"]]
"""Name -> value in each world, of every parameter of the system and of its effects [SI]."""
Hidden = dict[str, TensorDict]
"""Effect's key -> its hidden state."""


DIVERGED = 1e10
"""A coordinate or speed from here on counts as diverged, as in MuJoCo (``mjMAXVAL``) [m, rad, m/s, rad/s]."""


Integrator = Literal["semi-implicit", "explicit", "rk4"]


@dataclass(frozen=True)
class Joint:
    """One coordinate.

    Args:
        name: of the joint.
        kind: whether it slides or turns.
        max_speed: the speed is cut off there [m/s, rad/s].
        low, high: walls; the position is cut off there, and a speed into the wall is lost [m, rad].
    """

    name: str
    kind: Literal["slide", "hinge"]
    max_speed: float = math.inf
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True)
class Actuator:
    """One command column: a force ``gear * u`` on ``joint``, u cut off at ``limit`` [command units].

    ``gear`` is a number [N or N m per command unit] or the name of a parameter of the system.
    """

    name: str
    joint: str
    gear: float | str = 1.0
    limit: float = math.inf


@dataclass(frozen=True)
class Drive:
    """Forces and commands of the actuators over some timesteps of a held command.

    Args:
        joints: generalised forces (J, N, steps) [N, N m].
        forces: actuator -> its force before the gear, 0 while it is off (N, steps).
        commands: actuator -> its command after the input stages (N, steps) [command units].
    """

    joints: Float[Tensor, "J N steps"]
    forces: Mapping[str, Float[Tensor, "N steps"]]
    commands: Mapping[str, Float[Tensor, "N steps"]]


@dataclass(frozen=True)
class Stepper:
    """Advances states of any number of worlds; holds none itself.

    Args:
        acceleration: a(values, q, v, tau) (J, N), affine in tau; see ``TorchSimulator.acceleration``.
        joints, actuators: of the system, in the order of coordinates and commands.
        effects: added so far.
        timestep: h [s].
        integrator: see the module.
    """

    acceleration: Callable[[Values, Tensor, Tensor, Tensor], Tensor]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    effects: tuple[Effect, ...]
    timestep: float
    integrator: Integrator

    def advance(
        self,
        values: Values,
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        hidden: Hidden,
        command: Float[Tensor, "N U"],
        enable: Tensor | None,
        steps: int,
    ) -> tuple[Float[Tensor, "J N"], Float[Tensor, "J N"], Hidden]:
        """``steps`` timesteps under one held command; gives new tensors and leaves the given ones alone."""
        if not steps:
            return q, v, hidden
        held = command[:, None].expand(-1, steps, -1)
        drive, hidden = self._drive(values, hidden, held, None if enable is None else enable[:, None], self.timestep)
        h = self.timestep
        for k in range(steps):
            heed()
            before = dict(hidden)
            tau, bounds = self._act(values, q, v, hidden, drive, k)
            a = self.acceleration(values, q, v, tau)
            if self.integrator == "rk4":
                moved, free = self._runge_kutta(values, q, v, a, before, drive, k)
                new = self._cut(self._rub(values, q, v, tau, a, free, bounds))
                q = torch.add(moved, new - free, alpha=h) if bounds else moved
            else:
                new = self._cut(self._rub(values, q, v, tau, a, torch.add(v, a, alpha=h), bounds))
                q = torch.add(q, new if self.integrator == "semi-implicit" else v, alpha=h)
            q, v = self._stopped(q, new)
        return q, v, hidden

    def _cut(self, v: Float[Tensor, "J N"]) -> Float[Tensor, "J N"]:
        """Speeds cut off where joints have a greatest one, in place."""
        for i, joint in enumerate(self.joints):
            if joint.max_speed < math.inf:
                v[i].clamp_(-joint.max_speed, joint.max_speed)
        return v

    def _stopped(self, q: Float[Tensor, "J N"], v: Float[Tensor, "J N"]) -> tuple[Tensor, Tensor]:
        """Positions cut off at the walls, and speeds into them lost, in place."""
        for i, joint in enumerate(self.joints):
            if joint.low > -math.inf or joint.high < math.inf:
                q[i].clamp_(joint.low, joint.high)
                into = ((q[i] <= joint.low) & (v[i] < 0)) | ((q[i] >= joint.high) & (v[i] > 0))
                v[i].masked_fill_(into, 0.0)
        return q, v

    def _runge_kutta(
        self, values: Values, q: Tensor, v: Tensor, a: Tensor, hidden: Hidden, drive: Drive, k: int
    ) -> tuple[Tensor, Tensor]:
        """Positions and velocities after one step; ``a`` is the acceleration at its beginning."""
        h, speeds, accelerations = self.timestep, [v], [a]
        for part in (0.5, 0.5, 1.0):
            at, rate = torch.add(q, speeds[-1], alpha=part * h), torch.add(v, accelerations[-1], alpha=part * h)
            tau, _ = self._act(values, at, rate, dict(hidden), drive, k)
            speeds.append(rate)
            accelerations.append(self.acceleration(values, at, rate, tau))

        def mean(stages: list[Tensor]) -> Tensor:
            return (stages[0] + 2 * stages[1] + 2 * stages[2] + stages[3]) / 6

        return torch.add(q, mean(speeds), alpha=h), torch.add(v, mean(accelerations), alpha=h)

    def hidden_states_along(
        self,
        values: Values,
        q: Float[Tensor, "J N K"],
        v: Float[Tensor, "J N K"],
        command: Float[Tensor, "N K U"],
        enable: Tensor | None,
        step: float,
    ) -> Hidden:
        """Hidden states of force stages before and after each row; see ``Identifiable.hidden_states_along``."""
        rests = {effect.key: effect.rest(len(command), step, command) for effect in self.effects}
        settling = math.ceil(max((e.memory for e in self.effects if e.has_command), default=0.0) / step)
        before = command[:, :1].expand(-1, settling, -1)
        stages = {key: rest for key, rest in rests.items() if rest is not None}
        if settling:
            _, stages = self._drive(values, stages, before, None, step)
        drive, _ = self._drive(values, stages, command, enable, step)
        found: Hidden = {}
        for effect in self.effects:
            rest = rests[effect.key]
            if rest is None or not effect.has_force or effect.has_command:
                continue
            _, _, seen = self._see(effect, values, q, v, rest, drive, slice(None), step)
            after = effect.along(_own(effect, values), seen)
            if after is not None:
                found[effect.key] = TensorDict.cat([rest[:, None], after], dim=1)
        return found

    def _drive(
        self, values: Values, hidden: Hidden, command: Tensor, enable: Tensor | None, timestep: float
    ) -> tuple[Drive, Hidden]:
        """Return the actuators' drive on each step of ``command`` (N, steps, U), and the hidden states after them.

        ``enable`` has a row for each step, or one for all.
        """
        hidden = dict(hidden)
        total: dict[str, Tensor] = {}
        forces, commands = {}, {}
        for column, actuator in enumerate(self.actuators):
            u = command[..., column]
            if actuator.limit < math.inf:
                u = u.clamp(-actuator.limit, actuator.limit)
            for effect in self.effects:
                if effect.has_command and effect.target == actuator.name:
                    u, after = effect.command(_own(effect, values), hidden.get(effect.key), u, timestep)
                    if after is not None:
                        hidden[effect.key] = after
            commands[actuator.name] = forces[actuator.name] = u
            if enable is not None:
                forces[actuator.name] = u * enable[..., column].to(u)
            gear = self._gear(values, actuator)
            force = u * (gear[:, None] if isinstance(gear, Tensor) else gear)
            if enable is not None:
                force = force * enable[..., column].to(u)
            total[actuator.joint] = total[actuator.joint] + force if actuator.joint in total else force
        none = command.new_zeros(()).expand(command.shape[:2])
        joints = torch.stack([total.get(joint.name, none) for joint in self.joints])
        return Drive(joints, forces, commands), hidden

    def _act(
        self, values: Values, q: Tensor, v: Tensor, hidden: Hidden, drive: Drive, k: int
    ) -> tuple[Tensor, dict[int, Tensor]]:
        """Forces of actuators and effects (J, N), and the bound of the dry friction at each joint that has some.

        Hidden states are moved on to the end of the step, in place of those in ``hidden``.
        """
        tau = list(drive.joints[..., k].unbind(0))
        bounds: dict[int, Tensor] = {}
        acting = [effect for effect in self.effects if effect.has_force]
        acting.sort(key=lambda effect: effect.target_kind != "actuator")
        added: dict[int, Tensor] = {}  # by effects at actuators, in the drive that those at joints see
        if not acting:
            return drive.joints[..., k], bounds
        for effect in acting:
            own = _own(effect, values)
            i, gear, seen = self._see(effect, values, q, v, hidden.get(effect.key), drive, k, self.timestep)
            if gear is None and i in added:
                seen = replace(seen, drive=seen.drive + added[i])
            force, bound, after = effect.force(own, seen), effect.friction_bound(own, seen), effect.advance(own, seen)
            if force is not None and gear is not None:
                force = force * gear
                added[i] = added[i] + force if i in added else force
            if force is not None:
                tau[i] = tau[i] + force
            if bound is not None:
                bounds[i] = bounds[i] + bound if i in bounds else bound
            if after is not None:
                hidden[effect.key] = after
        return torch.stack(tau), bounds

    def _see(
        self,
        effect: Effect,
        values: Values,
        q: Tensor,
        v: Tensor,
        hidden: TensorDict | None,
        drive: Drive,
        k: int | slice,
        timestep: float,
    ) -> tuple[int, Tensor | float | None, Seen]:
        """The joint on which the effect acts, the gear between (None at the joint itself), and what it sees."""
        rows = {joint.name: i for i, joint in enumerate(self.joints)}
        if effect.target_kind == "actuator":
            actuator = next(actuator for actuator in self.actuators if actuator.name == effect.target)
            i, gear = rows[actuator.joint], self._gear(values, actuator)
            force, command = drive.forces[actuator.name][:, k], drive.commands[actuator.name][:, k]
            return i, gear, Seen(q[i], v[i], force, command, hidden, timestep)
        i = rows[effect.target]
        command = torch.zeros_like(q[i])
        for actuator in self.actuators:
            if actuator.joint == effect.target:
                command = command + drive.commands[actuator.name][:, k]
        return i, None, Seen(q[i], v[i], drive.joints[i, :, k], command, hidden, timestep)

    @staticmethod
    def _gear(values: Values, actuator: Actuator) -> Tensor | float:
        return values[actuator.gear] if isinstance(actuator.gear, str) else actuator.gear

    def _rub(
        self, values: Values, q: Tensor, v: Tensor, tau: Tensor, a: Tensor, free: Tensor, bounds: dict[int, Tensor]
    ) -> Tensor:
        """Velocities after the step (J, N), from the acceleration and the velocities without dry friction."""
        if not bounds:
            return free
        columns = []
        for i in bounds:
            # The acceleration is affine in tau, so a unit force at joint i shows column i of the inverse mass.
            unit = torch.zeros_like(tau)
            unit[i] = 1.0
            columns.append(self.acceleration(values, q, v, tau + unit) - a)
        impulse = torch.stack([bound * self.timestep for bound in bounds.values()])
        return stick(free, torch.stack(columns, dim=1), impulse, list(bounds))


def diverged(q: Float[Tensor, "J N"], v: Float[Tensor, "J N"]) -> Bool[Tensor, " N"]:
    """Worlds with a value that is not a number or too large."""
    return ~((q.abs() < DIVERGED) & (v.abs() < DIVERGED)).all(0)


def _own(effect: Effect, values: Values) -> dict[str, Tensor]:
    """An effect's own parameters by their short names."""
    return {name: values[f"{effect.key}.{name}"] for name in effect.parameters}
