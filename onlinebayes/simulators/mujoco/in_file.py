"""One world as MJCF holds it: without what MuJoCo has no term for, with the integration under which it has a delay.

MuJoCo knows a delay from one timestep on, and under RK4 of one timestep alone (see :mod:`.foreign`). The file therefore
has a timestep h / n that is no longer than the shortest delay, and goes by implicitfast where RK4 would be wrong.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import mujoco
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.abilities.portable import InFile
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco.foreign import delay_of, not_exportable
from onlinebayes.simulators.mujoco.host import to_host

if TYPE_CHECKING:
    from onlinebayes.simulators.mujoco.blueprint import Remakable

MOST_PARTS = 16
"""Timesteps of the file in one of the simulator at most: a shorter delay is left out."""


def in_file(simulator: Remakable, theta: Float[Tensor, " P"]) -> InFile:
    """See :meth:`onlinebayes.simulators.abilities.Portable.in_file`."""
    rows, held, changes = to_host(theta[None]), simulator, list[str]()
    delays = sorted(filter(None, (delay_of(simulator._system, e, rows) for e in _delayed(simulator))))
    timestep = float(simulator.model.opt.timestep)
    parts = math.ceil(timestep / delays[0] - 1e-9) if delays else 1
    if 1 < parts <= MOST_PARTS:
        held, timestep = held.with_timestep(timestep / parts), timestep / parts
        changes.append(
            f"timestep {timestep:.6g} s in place of {parts * timestep:.6g} s, for MuJoCo has no delay shorter than one"
        )
    runge_kutta = held.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    if runge_kutta and delays and delays[-1] > timestep * (1 + 1e-9):
        held = held.with_first_order()
        changes.append("integrator implicitfast in place of RK4, under which MuJoCo has a delay of one timestep alone")
    without = not_exportable(held._system, rows)
    left = [effect for effect in held.effects if effect.key not in without]
    if without:
        held = held._remade(effects=tuple(left))
    columns = [simulator.parameters.index(name) for name in held.parameters]
    return InFile(held, theta[torch.tensor(columns, dtype=torch.long)], without, tuple(changes))


def _delayed(simulator: Remakable) -> list[ActuatorDelay]:
    """The delays whose actuator has none of its own in the model."""
    model = simulator.model
    found = [effect for effect in simulator.effects if isinstance(effect, ActuatorDelay)]
    return [effect for effect in found if not model.actuator_delay[model.actuator(effect.target).id]]
