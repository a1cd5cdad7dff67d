"""Inputs played through hypotheses: what they would measure, and whether the motion stays within the limits.

An input whose motion leaves the limits under any hypothesis is brought nearer to its held command, by a factor of 0.7
and up to twelve times, and dropped after that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.limits import Limits
from onlinebayes.identification.replaying.replay import VISIBLE
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.simulators.identifiable import Identifiable

SHRINK, TIMES = 0.7, 12


@dataclass(frozen=True)
class FixedModel:
    """One thing that may be true: a model at one theta.

    Args:
        name: the effects that it holds, or ``"the model as it is"``.
        simulator: with those effects, at the step of the fit.
        theta: [SI].
    """

    name: str
    simulator: Identifiable
    theta: Float[Tensor, " P"]


def play(hypothesis: FixedModel, inputs: Inputs) -> TensorDict:
    """The trajectories under every input, batch size (N, K): row 0 is the posture, at rest; ``"valid"`` beside it."""
    N, K, _ = inputs.command.shape
    theta = hypothesis.theta.expand(N, -1)
    state = at_rest(hypothesis.simulator, theta, inputs.start, inputs.held, K * inputs.step)
    times = torch.arange(1, K, dtype=theta.dtype, device=theta.device) * inputs.step
    commands = TensorDict({"command": inputs.command[:, :-1]}, batch_size=(N, K - 1))
    path = hypothesis.simulator.rollout(theta, state, commands, times)
    rows = {key: torch.cat([state[key][:, None], path[key]], 1) for key in ("qpos", "qvel")}
    valid = torch.cat([torch.ones_like(path["valid"][:, :1]), path["valid"]], 1)
    return TensorDict({**rows, "valid": valid}, batch_size=(N, K))


def at_rest(
    simulator: Identifiable,
    theta: Float[Tensor, "N P"],
    start: Float[Tensor, "N J"],
    held: Float[Tensor, "N U"],
    seconds: float,
) -> TensorDictBase:
    """States at rest whose hidden parts (delay buffers, activations) know nothing but the held command.

    Args:
        simulator, theta: of the worlds.
        start: postures [m, rad].
        held: commands that were there before [command units].
        seconds: for how long at most [s]. Force stages are at rest until a recording begins.
    """
    state = simulator.project_onto_constraints(
        TensorDict({"qpos": start, "qvel": torch.zeros_like(start)}, batch_size=(len(start),))
    )
    settled = simulator.command_driven_states(theta, held[:, None], simulator.timestep)
    state.update({key: line[:, 0] for key, line in settled.items()})
    known = VISIBLE | settled.keys()
    hidden = [key for key in simulator.state.keys() if key not in known]  # noqa: SIM118  (iterating gives rows)
    memory = max((effect.memory for effect in simulator.effects if not effect.has_force), default=0.0)
    past = seconds if set(hidden) - {"effects"} else min(memory, seconds)
    if not hidden or past < simulator.timestep:
        return state
    before = TensorDict({"command": held[:, None]}, batch_size=(len(held), 1))
    left = simulator.rollout(theta, state, before, theta.new_tensor([past]))
    for key in hidden:
        state[key] = left[key][:, -1]
    return state


def keeps(trajectory: TensorDict, limits: Limits) -> Bool[Tensor, " N"]:
    """Check whether each trajectory stays finite and within travel and speed."""
    q, v = trajectory["qpos"], trajectory["qvel"]
    inside = ((q >= limits.travel_low) & (q <= limits.travel_high) & (v.abs() <= limits.speed)).all(-1)
    return (inside & trajectory["valid"]).all(-1)


def admissible(hypotheses: Sequence[FixedModel], inputs: Inputs, limits: Limits) -> Inputs:
    """The inputs that keep to the limits whichever hypothesis is true, scaled down where that is needed.

    Args:
        hypotheses: all that may be true.
        inputs: within the bounds of the commands already.
        limits: of the motion.

    Returns:
        Those that could be saved, in the same order; none where no motion is admissible.
    """
    factor = inputs.command.new_ones(inputs.count)
    open_ = torch.ones(inputs.count, dtype=torch.bool, device=factor.device)
    for _ in range(TIMES):
        index = open_.nonzero()[:, 0]
        tried = inputs.select(index).scaled(factor[index])
        good = torch.stack([keeps(play(hypothesis, tried), limits) for hypothesis in hypotheses]).all(0)
        open_[index[good]] = False
        if not bool(open_.any()):
            break
        factor[open_] *= SHRINK
    return inputs.scaled(factor).select((~open_).nonzero()[:, 0])


def predicted(
    hypothesis: FixedModel, inputs: Inputs, signals: Sequence[Signal], commands: Sequence[str]
) -> Measurement:
    """Predict the measurement of a noise-free sensor: one run an input, named by its number.

    Args:
        hypothesis: what is true.
        inputs: what is played.
        signals: to read.
        commands: names in the order of the measurement that this joins.
    """
    simulator = hypothesis.simulator
    trajectory = play(hypothesis, inputs)
    read = simulator.read(trajectory)[..., [simulator.signals.index(signal.name) for signal in signals]]
    command = inputs.command[..., [simulator.commands.index(name) for name in commands]]
    N, K = trajectory.batch_size
    time = torch.arange(K, dtype=read.dtype, device=read.device) * inputs.step
    seen = torch.ones(read.shape, dtype=torch.bool, device=read.device)
    data = TensorDict(
        {
            "time": time.expand(N, K).clone(),
            "command": command,
            "enable": torch.ones_like(command),
            "signal": read,
            "measured": seen,
            "mask": torch.ones(N, K, dtype=torch.bool, device=read.device),
        },
        batch_size=(N, K),
    )
    return Measurement(data, tuple(signals), tuple(commands), tuple(str(n) for n in range(N)))
