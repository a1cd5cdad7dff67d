"""The driven pendulum rig: the "reality" of the studies, a simulator whose hidden effects are its own parameters.

Its parameters carry the addresses of the model in ``driven_pendulum.xml`` with the effect added, so that a fitted value
and the true one are looked up under one name. A hidden effect at zero is not there.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Self

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from envs.driven_pendulum.dynamics import Pendulum
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.checks import timesteps_of
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

MODEL = Path(__file__).with_name("driven_pendulum.xml")
MASS, DAMPING = "body.bob.mass", "joint.hinge.damping"
FRICTION = "dry_friction@hinge.frictionloss"
DRAG = "quadratic_drag@hinge.drag"
STIFFNESS, SPRINGREF = "joint_stiffness@hinge.stiffness", "joint_stiffness@hinge.springref"
DELAY = "actuator_delay@motor.delay"
NOMINAL = {MASS: 0.4, DAMPING: 0.012, FRICTION: 0.0, DRAG: 0.0, STIFFNESS: 0.0, SPRINGREF: 0.0, DELAY: 0.0}
BUFFER = ("effects", "actuator_delay@motor", "buffer")

PARAMETERS = ParameterSpace(
    {
        MASS: Parameter(0.1, 1.0, "kg"),
        DAMPING: Parameter(0.0, 0.1, "N m s/rad"),
        FRICTION: Parameter(0.0, 0.5, "N m"),
        DRAG: Parameter(0.0, 0.1, "N m s2/rad2"),
        STIFFNESS: Parameter(0.0, 2.0, "N m/rad"),
        SPRINGREF: Parameter(-math.pi, math.pi, "rad"),
        DELAY: Parameter(0.0, 0.12, "s"),
    }
)


class DrivenPendulumRig(Identifiable):
    """N driven pendulums, integrated by :mod:`envs.driven_pendulum.dynamics`.

    The state holds ``"qpos"`` and ``"qvel"`` (N, 1) and the commands of the last timesteps, newest first, under
    ``("effects", "actuator_delay@motor", "buffer")``.

    Args:
        worlds: N.
        dt: seconds of one :meth:`step` [s].
        timestep: longest integration step [s]; ``dt`` is a whole number of them.
        device, dtype: of all tensors.

    Raises:
        BadInput: ``dt`` is not a whole number of timesteps.
    """

    def __init__(
        self,
        worlds: int = 1,
        dt: float = 0.005,
        timestep: float = 0.0025,
        *,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float64,
    ) -> None:
        self.substeps = timesteps_of(dt, timestep)
        self.parameters, self.effects = PARAMETERS, ()
        self.worlds, self.dt, self.timestep = worlds, dt, timestep
        self.commands, self.signals = ("motor",), ("qpos.hinge", "qvel.hinge")
        self.device, self.dtype = torch.device(device), dtype
        self._theta = self.nominal.expand(worlds, -1).clone()
        self._state = self._rest(worlds)
        self._failed = torch.zeros(worlds, dtype=torch.bool, device=self.device)

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """Theta of the model file, every hidden effect absent."""
        return self.parameters.vector(NOMINAL, dtype=self.dtype, device=self.device)

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state."""
        return self._state.clone()

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that got a command which is not finite, or whose motion is none; they are held."""
        return self._failed.clone()

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; without a state they hang at rest."""
        theta = theta.to(self.device, self.dtype)
        mask = torch.ones(self.worlds, dtype=torch.bool, device=self.device) if mask is None else mask
        self.parameters.check(theta[mask])
        fresh = self._complete(state, self.worlds)
        self._theta = torch.where(mask[:, None], theta, self._theta)
        self._state = TensorDict(
            {
                key: torch.where(mask[:, None], fresh[key], self._state[key])
                for key in fresh.keys(include_nested=True, leaves_only=True)
            },
            batch_size=(self.worlds,),
        )
        self._failed = self._failed & ~mask
        return self.state

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance all worlds by ``dt``."""
        self._state, self._failed = self._advance(
            self._theta, self._state, self._failed, self._command(inputs), self.substeps
        )
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds; see :meth:`Simulator.rollout`."""
        theta = theta.to(self.device, self.dtype)
        self.parameters.check(theta)
        now = self._complete(state, theta.shape[0])
        command = self._command(inputs)
        steps = torch.round(times / self.timestep).long().tolist()
        failed = torch.zeros(len(theta), dtype=torch.bool, device=self.device)
        rows = []
        for k, (before, after) in enumerate(zip([0, *steps[:-1]], steps, strict=True)):
            now, failed = self._advance(theta, now, failed, command[:, k], after - before)
            rows.append(now.clone().set("valid", ~failed))
        return TensorDict.stack(rows, dim=1)

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """Angle [rad] and speed [rad/s]."""
        return torch.cat([state["qpos"], state["qvel"]], dim=-1)

    def with_effect(self, effect: Effect) -> Self:
        """Refused: the rig plays reality, its effects are parameters of its own."""
        raise BadInput(
            f"the rig cannot take '{effect.key}'",
            f"set one of its own parameters: {', '.join(self.parameters)}",
        )

    def with_worlds(self, worlds: int) -> Self:
        """The same rig with another number of worlds."""
        return type(self)(worlds, self.dt, self.timestep, device=self.device, dtype=self.dtype)

    def with_timestep(self, timestep: float) -> Self:
        """The same rig, all worlds nominal, with another longest step, which is ``dt`` too [s]."""
        return type(self)(self.worlds, timestep, timestep, device=self.device, dtype=self.dtype)

    def _rest(self, worlds: int) -> TensorDict:
        slots = math.floor(self.parameters[DELAY].high / self.timestep + 1e-9) + 2
        angle, speed, buffer = (
            torch.zeros(worlds, width, device=self.device, dtype=self.dtype) for width in (1, 1, slots)
        )
        return _state(angle, speed, buffer)

    def _complete(self, state: TensorDictBase | None, worlds: int) -> TensorDict:
        complete = self._rest(worlds)
        if state is not None:
            for key in list(complete.keys(include_nested=True, leaves_only=True)):
                given = state.get(key, None)
                if given is not None:
                    complete[key] = given.to(self.device, self.dtype).clone()
        return complete

    def _command(self, inputs: TensorDictBase) -> Tensor:
        command, enable = inputs["command"], inputs.get("enable", None)
        command = command if enable is None else command * enable
        return command.to(self.device, self.dtype)[..., 0]

    def _advance(
        self, theta: Tensor, state: TensorDictBase, failed: Tensor, command: Tensor, steps: int
    ) -> tuple[TensorDict, Tensor]:
        """``steps`` timesteps under one held command; the delayed one changes once within each timestep."""
        p = self.parameters.view(theta)
        pendulum = Pendulum(p[MASS], p[DAMPING], p[FRICTION], p[DRAG], p[STIFFNESS], p[SPRINGREF])
        # T = whole h + late: for the first `late` seconds of a timestep an older command still acts.
        whole = torch.floor(p[DELAY] / self.timestep + 1e-9)
        late = (p[DELAY] - whole * self.timestep).clamp(min=0)
        slot, split = whole.long()[:, None], bool((late > 0).any())
        q, v, buffer = state["qpos"][:, 0], state["qvel"][:, 0], state[BUFFER]
        for _ in range(steps):
            buffer = torch.cat([command[:, None], buffer[:, :-1]], dim=1)
            if split:
                q, v = pendulum.advance(q, v, buffer.gather(1, slot + 1)[:, 0], late)
            q, v = pendulum.advance(q, v, buffer.gather(1, slot)[:, 0], self.timestep - late)
        failed = failed | ~(command.isfinite() & q.isfinite() & v.isfinite())
        hold = failed[:, None]
        return _state(
            torch.where(hold, state["qpos"], q[:, None]),
            torch.where(hold, state["qvel"], v[:, None]),
            torch.where(hold, state[BUFFER], buffer),
        ), failed


def _state(angle: Tensor, speed: Tensor, buffer: Tensor) -> TensorDict:
    return TensorDict(
        {"qpos": angle, "qvel": speed, "effects": {"actuator_delay@motor": {"buffer": buffer}}},
        batch_size=angle.shape[:1],
    )
