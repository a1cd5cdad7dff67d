"""Quantities that follow from a known motion without the engine: hidden states of force stages, actuators' forces.

    h_{k+1} = advance(q_k, v_k, f_k, u_k, h_k),   f_k = the actuators' force at (u_k, q_k, v_k),   u = stages(command)

A force stage's hidden state depends on the motion only through what the effect sees, and forces of actuators follow
from command and motion (see :mod:`.actuation`): where both were measured, nothing needs to be simulated.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.stage import Place, actuator_fields
from onlinebayes.simulators.mujoco.system import MujocoSystem


def hidden_states_along(
    system: MujocoSystem, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
) -> dict[str, TensorDict]:
    """See :meth:`onlinebayes.simulators.base.Simulator.hidden_states_along`."""
    rests = system.rest(len(theta), step)
    # One that is an input stage as well needs its own rows of both; none of the vocabulary is.
    remembering = [effect for effect in system.staged if effect.key in rests and not effect.has_command]
    if not remembering:
        return {}
    ctrl = driven(system, theta, rests, motion.get("command").double(), step)
    on, fields = _on(system, motion), _fields(system, theta)
    qpos, qvel = motion.get("qpos").double(), motion.get("qvel").double()
    found = {}
    for effect in remembering:
        rest = rests[effect.key]
        seen = Place.of(system, effect).see(fields, qpos, qvel, ctrl, on, rest, step)
        after = effect.along(system.own(effect, theta), seen)
        if after is not None:
            found[effect.key] = TensorDict.cat([rest[:, None], after], dim=1)
    return found


def actuator_forces(
    system: MujocoSystem, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
) -> Float[Tensor, "N K U"]:
    """See :meth:`onlinebayes.simulators.base.Simulator.actuator_forces`."""
    ctrl = driven(system, theta, system.rest(len(theta), step), motion.get("command").double(), step)
    on, fields = _on(system, motion), _fields(system, theta)
    qpos, qvel = motion.get("qpos").double(), motion.get("qvel").double()
    joints = {one.column: one for one in system.joint_actuators if one.follows(system.model)}
    forces = []
    for column, command in enumerate(system.commands):
        if column in joints:
            one = joints[column]
            q, v = (int(at[one.joint]) for at in (system.model.jnt_qposadr, system.model.jnt_dofadr))
            force = one.force(fields, ctrl, qpos[..., q], qvel[..., v], on)
        else:
            force = fields["actuator_gainprm"][..., command.actuator, 0] * ctrl[..., command.ctrl] * on[..., column]
        forces.append(force)
    return torch.stack(forces, dim=-1) if forces else qpos.new_zeros(*motion.batch_size, 0)


def _on(system: MujocoSystem, motion: TensorDictBase) -> Tensor:
    """Return a mask of the actuators that are on (N, K, U)."""
    enable = motion.get("enable", None)
    return torch.ones(*motion.batch_size, len(system.commands)) if enable is None else enable > 0


def _fields(system: MujocoSystem, theta: Float[Tensor, "N P"]) -> dict[str, Tensor]:
    """The actuators' fields, (N, 1, ...) for K rows at once."""
    return {name: rows[:, None] for name, rows in actuator_fields(system, system.write(to_host(theta))).items()}


def driven(
    system: MujocoSystem,
    theta: Float[Tensor, "N P"],
    rests: dict[str, TensorDict],
    command: Float[Tensor, "N K U"],
    step: float,
) -> Float[Tensor, "N K nu"]:
    """Compute the inputs of the actuators on each row; the input stages have settled at the first command."""
    settling = math.ceil(max((effect.memory for effect in system.stages), default=0.0) / step)
    before = command[:, :1].expand(-1, settling, -1)
    ctrl, _, _ = system.drive(theta, rests, torch.cat([before, command], dim=1), step)
    return torch.from_numpy(ctrl[:, settling:])
