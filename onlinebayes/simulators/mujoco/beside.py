"""What stands beside an exported file so that it replays as the simulator does: laws, and numbers that differ."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.effects import ActuatorDelay, Effect
from onlinebayes.simulators.mujoco.addresses import HINGE, SLIDE, model_array
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.system import MujocoSystem, is_const_input
from onlinebayes.simulators.standalone import Law, Setup

SAME = 1e-12
"""Relative difference up to which a number of the file is the simulator's."""


def beside(
    system: MujocoSystem, theta: Float[Tensor, " P"], spec: mujoco.MjSpec, lacking: tuple[str, ...]
) -> tuple[Setup, dict[str, str]]:
    """The laws and numbers beside a file.

    Args:
        system: the whole one.
        theta: its parameters.
        spec: of the file.
        lacking: keys of the effects that the file cannot hold.

    Returns:
        What stands beside the file, and the keys of the effects that cannot stand there -> why.
    """
    rows = to_host(theta[None])
    # A delay acts among the other stages of a command, in their order: all of them are laws then.
    aside = {*lacking, *(effect.key for effect in system.stages if isinstance(effect, ActuatorDelay))}
    laws, without = [], dict[str, str]()
    for effect in (effect for effect in system.effects if effect.key in aside):
        values = {name: float(column[0]) for name, column in system.own(effect, rows).items()}
        law = effect.standalone(values)
        if isinstance(law, Law):
            laws.append((effect.key, _kind(effect), effect.target, law))
        else:
            without[effect.key] = law
    model = spec.copy().compile()
    numbers = _numbers(system, rows, model)
    setup = Setup(
        timestep=float(system.model.opt.timestep),
        integrator=mujoco.mjtIntegrator(system.model.opt.integrator).name,
        ctrl=tuple(command.ctrl for command in system.commands),
        signals=system.signals,
        sensors=tuple(int(place) for place in system.sensor_places),
        slopes=_slopes(system),
        numbers=numbers,
        constants=any(map(is_const_input, numbers)),
        undelayed=tuple(e.target for e in system.stages if isinstance(e, ActuatorDelay) and e.key not in lacking),
        laws=tuple(laws),
    )
    return setup, without


def _kind(effect: Effect) -> str:
    return "command" if effect.has_command else effect.target_kind


def _numbers(system: MujocoSystem, rows: np.ndarray, model: mujoco.MjModel) -> dict[str, dict[int, float]]:
    """Field -> place -> value, where the file's model has another one than the simulator's world."""
    found = {}
    for name, values in system.write(rows).items():
        if name not in system.fields or name.startswith("opt."):
            continue
        held, wanted = model_array(model, name).ravel(), values[0].ravel()
        if held.shape != wanted.shape:
            continue
        other = np.flatnonzero(np.abs(held - wanted) > SAME * np.maximum(np.abs(held), np.abs(wanted)))
        if len(other):
            found[name] = {int(k): float(wanted[k]) for k in other}
    return found


def _slopes(system: MujocoSystem) -> dict[int, int]:
    """Place of each scalar joint's position among the signals -> that of its velocity."""
    model = system.model
    kept = [j for j in range(model.njnt) if model.jnt_type[j] in (SLIDE, HINGE)]
    return {int(model.jnt_qposadr[j]): model.nq + int(model.jnt_dofadr[j]) for j in kept}
