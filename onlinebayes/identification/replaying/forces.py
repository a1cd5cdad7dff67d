"""The forces of added effects along a replay: what each one does at its joint, instant by instant.

    tau(t) = effect(q(t), v(t); theta),      for a dry friction  -F v / max(|v|, v_rest)

q is the replay's, v its difference quotient within each window. At rest a dry friction holds whatever acts on it up to
F; what it holds is not known from the motion, so that its force fades to nothing below v_rest, a fiftieth of the
largest speed. Effects on actuators, and those that name no force, have none here, nor have those that depend on what a
replay does not hold: the actuators' force, the command after its stages, a hidden state.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.replaying.scoped import in_run
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.identification.results import FittedModel, ReplayedRun
from onlinebayes.simulators.effects import Seen

AT_REST = 0.02


@dataclass(frozen=True)
class EffectForce:
    """One effect along one run.

    Args:
        effect: ``name@target``.
        joint: where it acts.
        value: generalised force on the joint, nan where the replay diverged [N, N m].
    """

    effect: str
    joint: str
    value: Float[Tensor, " T"]


def effect_forces(model: FittedModel, run: ReplayedRun, signals: tuple[str, ...]) -> tuple[EffectForce, ...]:
    """The forces of the model's effects along one of its replays.

    Args:
        model: the fitted model.
        run: one of its replays.
        signals: names of the replay's columns.
    """
    names = unwrap(model.simulator).parameters
    theta = dict(zip(names, in_run(model.simulator, model.theta, run.run).unbind(), strict=True))
    found = []
    for effect in model.simulator.effects:
        signal = f"qpos.{effect.target}"
        if effect.target_kind != "joint" or signal not in signals or len(run.time) < 2 or effect.memory:
            continue
        q = run.simulated[:, signals.index(signal)]
        v = _velocity(run, q)
        parameters = {name: theta[f"{effect.key}.{name}"].expand(len(q)) for name in effect.parameters}
        unknown = torch.full_like(q, torch.nan)  # what depends on it is nan, too
        seen = Seen(q, v, unknown, unknown, None, model.simulator.timestep)
        force, bound = effect.force(parameters, seen), effect.friction_bound(parameters, seen)
        if force is None and bound is not None:
            rest = AT_REST * torch.nan_to_num(v).abs().max()
            force = -bound * v / v.abs().maximum(rest).clamp_min(1e-12)
        if force is not None and not bool(force.isnan().all()):
            found.append(EffectForce(effect.key, effect.target, force))
    return tuple(found)


def _velocity(run: ReplayedRun, q: Float[Tensor, " T"]) -> Float[Tensor, " T"]:
    """Difference quotients that do not reach over the starts of windows; 0 in windows of a single row."""
    found = torch.zeros_like(q)
    for number in run.window.unique():
        mine = run.window == number
        if int(mine.sum()) > 1:
            found[mine] = torch.gradient(q[mine], spacing=(run.time[mine],))[0]
    return found
