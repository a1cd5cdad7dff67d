"""Starts of a recording: postures in which runs began, each with the command under which the model rests there.

    u0:  v(h; q0, v = 0, u0) = 0,     h one integration step;     abs(q(t) - q0) <= 0.1 travel for 0 <= t <= H under u0

The command that a log has in its first row is no such u0: a run may begin in the middle of a motion. u0 is found by
Gauss and Newton from the command without force (the setpoint of a servo, 0 of a motor), or else from the log's; of
several commands that hold, as with friction, the first is kept. A posture that no command within the limits holds is
left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism.experiment.inputs import Posture
from onlinebayes.criticism.experiment.limits import Limits
from onlinebayes.criticism.experiment.play import FixedModel, at_rest
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.mujoco import MujocoSimulator

POSTURES = 3
ANOTHER = 0.2  # of the travel, by which postures differ that are worth a start of their own
STAYS = 0.1  # of the travel, by which what is held may drift within a horizon
ROUNDS = 6
NUDGE = 1e-3  # of a command's range, by which it is moved for its effect


@dataclass(frozen=True)
class _Held:
    """R postures, the best command for each, and whether the model stays there under it."""

    start: Float[Tensor, "R J"]
    command: Float[Tensor, "R U"]
    stays: Bool[Tensor, " R"]


def postures(windows: Windows, limits: Limits, model: FixedModel) -> list[Posture]:
    """The first posture that is held, and those that differ from it most.

    Args:
        windows: of the measured runs.
        limits: what is admissible.
        model: tells what holds a posture.

    Raises:
        BadInput: no command within the limits holds any posture in which a run began.
    """
    J = windows.free.shape[1]
    runs = windows.run.unique()
    firsts = [int((windows.run == r).nonzero()[0]) for r in runs]
    held = _holding(model, windows.start[firsts, :J], windows.command[firsts, 0], limits, windows)
    allowed = held.stays & _within(held.command, limits)
    if not bool(allowed.any()):
        raise _nothing_holds(model.simulator, held, limits)
    usable = allowed.nonzero()[:, 0]
    q = held.start[usable]
    u = torch.minimum(torch.maximum(held.command[usable], limits.command_low), limits.command_high)
    chosen = _apart(q, limits)
    names = [""] + [f", from where run '{windows.runs[int(runs[usable[k]])]}' began" for k in chosen[1:]]
    return [Posture(name, q[k], u[k]) for name, k in zip(names, chosen, strict=True)]


def _apart(q: Float[Tensor, "R J"], limits: Limits) -> list[int]:
    """The first, and of the others those that are furthest from all before."""
    chosen = [0]
    while len(chosen) < min(POSTURES, len(q)):
        apart = ((q[:, None] - q[chosen]) / _width(limits)).abs().amax(-1).amin(1)
        if float(apart.max()) < ANOTHER:
            break
        chosen.append(int(apart.argmax()))
    return chosen


def _holding(
    model: FixedModel, q: Float[Tensor, "R J"], logged: Float[Tensor, "R U"], limits: Limits, windows: Windows
) -> _Held:
    """From the command without force, and from the log's where that does not end in one that holds."""
    found = []
    for begin in (_without_force(model.simulator, q, logged), logged):
        u = _balanced(model, q, begin, limits, windows)
        found.append(_Held(q, u, _stay(model, q, u, limits, windows)))
    first, second = found
    better = first.stays & (_within(first.command, limits) | ~second.stays)
    return _Held(q, torch.where(better[:, None], first.command, second.command), first.stays | second.stays)


def _without_force(
    simulator: Extensible, q: Float[Tensor, "R J"], logged: Float[Tensor, "R U"]
) -> Float[Tensor, "R U"]:
    """The command at which each actuator of a joint gives no force at rest; 0 where that is not known."""
    if not isinstance(simulator, MujocoSimulator):
        return torch.zeros_like(logged)
    model, joints = simulator.model, joint_names(simulator)
    columns = []
    for name in simulator.commands:
        zero = q.new_zeros(len(q))
        actuator = model.actuator(name) if name in simulator.targets("actuator") else None
        joint = model.joint(int(actuator.trnid[0])).name if actuator is not None and actuator.trntype[0] <= 1 else ""
        gain = float(actuator.gainprm[0]) if actuator is not None else 0.0
        if actuator is None or joint not in joints or gain == 0:
            columns.append(zero)
            continue
        length = float(actuator.gear[0]) * q[:, joints.index(joint)]
        columns.append(-(float(actuator.biasprm[0]) + float(actuator.biasprm[1]) * length) / gain)
    return torch.stack(columns, -1)


def _balanced(
    model: FixedModel, q: Float[Tensor, "R J"], u: Float[Tensor, "R U"], limits: Limits, windows: Windows
) -> Float[Tensor, "R U"]:
    """Gauss and Newton on the speed after one step, the smallest change of the commands that does it."""
    R, U = u.shape
    size = limits.command_high - limits.command_low  # 0: no actuator, and not to be touched
    nudges = torch.cat([u.new_zeros(1, U), torch.diag(NUDGE * size)])
    u = torch.where(size > 0, u, torch.zeros_like(u))
    speed = _speed(model, q, u, limits, windows)
    for _ in range(ROUNDS):
        tried = (u + nudges[:, None]).flatten(0, 1)
        moved = _speed(model, q.repeat(U + 1, 1), tried, limits, windows).unflatten(0, (U + 1, R))
        slope = ((moved[1:] - moved[0]) / NUDGE).permute(1, 2, 0)
        step = (torch.linalg.pinv(slope, rtol=1e-6) @ moved[0][..., None])[..., 0] * size
        after = _speed(model, q, u - step, limits, windows)
        better = after.norm(dim=-1) < speed.norm(dim=-1)
        if not bool(better.any()):
            break
        u = torch.where(better[:, None], u - step, u)
        speed = torch.where(better[:, None], after, speed)
    return u


def _speed(
    model: FixedModel, q: Float[Tensor, "N J"], u: Float[Tensor, "N U"], limits: Limits, windows: Windows
) -> Float[Tensor, "N J"]:
    """Speed after one integration step from rest [travel/s]."""
    return _played(model, q, u, windows, [model.simulator.timestep])["qvel"][:, -1] / _width(limits)


def _stay(
    model: FixedModel, q: Float[Tensor, "R J"], u: Float[Tensor, "R U"], limits: Limits, windows: Windows
) -> Bool[Tensor, " R"]:
    """Check whether each world is finite and near its posture for a horizon."""
    times = [windows.step * k for k in range(1, windows.rows + 1)]
    path = _played(model, q, u, windows, times)
    apart = (path["qpos"] - q[:, None]).abs()
    return path["valid"].all(-1) & (apart <= STAYS * _width(limits)).all(-1).all(-1)


def _played(
    model: FixedModel, q: Float[Tensor, "N J"], u: Float[Tensor, "N U"], windows: Windows, times: Sequence[float]
) -> TensorDict:
    """Under a constant command that was there before, too."""
    theta = model.theta.expand(len(q), -1)
    state = at_rest(model.simulator, theta, q, u, windows.horizon)
    command = u[:, None].expand(-1, len(times), -1)
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    return model.simulator.rollout(theta, state, inputs, theta.new_tensor(times))


def _within(command: Float[Tensor, "R U"], limits: Limits) -> Bool[Tensor, " R"]:
    slack = 1e-9 * (limits.command_high - limits.command_low)
    return ((command >= limits.command_low - slack) & (command <= limits.command_high + slack)).all(-1)


def _width(limits: Limits) -> Float[Tensor, " J"]:
    return (limits.travel_high - limits.travel_low).clamp_min(1e-12)


def _nothing_holds(simulator: Measured, held: _Held, limits: Limits) -> BadInput:
    """Why no run's first posture will do: what the first that would be held takes, or that none is."""
    steady = held.stays.nonzero()[:, 0]
    r = int(steady[0]) if len(steady) else 0
    joints = zip(joint_names(simulator), held.start[r].tolist(), strict=True)
    where = ", ".join(f"{joint} = {x:.4g}" for joint, x in joints)
    if not len(steady):
        return BadInput(
            f"no command holds the model at rest where a run began (the first: {where})",
            "record a run that begins where the machine rests, and add it to the measurements",
        )
    over = ((held.command[r] > limits.command_high) | (held.command[r] < limits.command_low)).nonzero()[:, 0]
    takes = ", ".join(
        f"{simulator.commands[k]} = {float(held.command[r, k]):.4g}, where [{float(limits.command_low[k]):.4g}, "
        f"{float(limits.command_high[k]):.4g}] is allowed"
        for k in over.tolist()
    )
    return BadInput(
        f"to hold the model at rest where a run began ({where}) takes {takes}",
        "raise max_command under [next], or record a run that begins where less holds it",
    )
