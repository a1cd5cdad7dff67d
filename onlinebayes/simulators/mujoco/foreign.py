"""Effects that MJCF cannot hold at given parameters, why, and what would let plain MuJoCo have them.

Force stages, sensor effects and parameters that change have no term there, nor do input stages but delays. Of these
MuJoCo has none between nothing and one timestep: it reads its buffer before the present command enters it, which makes
a shorter delay a whole timestep. RK4 reads it anew at each stage, later commands at later ones, which no command held
over a timestep does: there only a delay of one timestep is the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco
import numpy as np

from onlinebayes.simulators.effects import ActuatorDelay, Effect
from onlinebayes.simulators.mujoco.fields import SPEC
from onlinebayes.simulators.mujoco.system import MujocoSystem

NO_TERM = "which plain MuJoCo has no term for"


def not_exportable(system: MujocoSystem, theta: np.ndarray) -> Mapping[str, str]:
    """Keys of the effects that plain MuJoCo lacks in the world with parameters theta (1, P) -> why, as a clause."""
    keys = [key for key, term in system.native.items() if not set(term.fields) <= set(SPEC)]
    keys += [e.key for e in system.effects if e in system.staged or e.target_kind in ("signal", "parameter")]
    found = dict.fromkeys(keys, NO_TERM)
    for effect in system.stages:
        reason = _of_a_delay(system, effect, theta) if isinstance(effect, ActuatorDelay) else NO_TERM
        if reason:
            found[effect.key] = reason
    return found


def delay_of(system: MujocoSystem, effect: Effect, theta: np.ndarray) -> float:
    """T of a delay in the world with parameters theta (1, P) [s]."""
    return float(system.own(effect, theta)["delay"][0])


def samples(delay: float, timestep: float) -> int:
    """Length of the buffer that MuJoCo needs for a delay [s] at a timestep [s]."""
    return math.ceil(delay / timestep) + 2


def _of_a_delay(system: MujocoSystem, effect: Effect, theta: np.ndarray) -> str:
    """Why MuJoCo's own ``delay`` is not this one, and what has to change for that; empty where it is."""
    option, delay = system.model.opt, delay_of(system, effect, theta)
    if system.model.actuator_delay[system.model.actuator(effect.target).id]:
        return "for its actuator has a delay of its own there: add this one to that by hand"
    if 0 < delay < option.timestep:
        known, cure, step = "from one timestep on", f'timestep="{delay:.6g}"', delay
    elif option.integrator == mujoco.mjtIntegrator.mjINT_RK4 and delay > option.timestep:
        known, cure, step = "under RK4 for one timestep alone", 'integrator="implicitfast"', option.timestep
    else:
        return ""
    attributes = f'delay="{delay:.6g}" interp="linear" nsample="{samples(delay, step)}"'
    return f"which plain MuJoCo has {known} ({option.timestep:g} s): {cure}, and {attributes} at the actuator, hold it"
