"""The sensors' view of a motion: a trajectory's signals, changed by the simulator's sensor effects in their order.

    shown = sense_n(... sense_1(read(trajectory))),      state behind a shown one = unsense_1(... unsense_n(state))

State and physics know nothing of it. A measurement shows a window's start as the sensors do: what replays it asks
:func:`unsense` for the state to start from, so that the start, its prior and held-out starts move with the sensor.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect, Reading


def sense(
    simulator: Extensible,
    theta: Float[Tensor, "*batch P"],
    state: TensorDictBase,
    trajectory: TensorDictBase,
    times: Float[Tensor, " T"],
) -> Float[Tensor, "*batch T S"]:
    """The signals of a trajectory as the simulator's sensors show them.

    Args:
        simulator: whose effects are asked.
        theta: parameters of each trajectory [SI].
        state: where each began, batch size (*batch,): ``"qpos"`` and ``"qvel"`` are read.
        trajectory: batch size (*batch, T).
        times: instants since the start (T,) [s].
    """
    signals = simulator.read(trajectory)
    effects = _sensors(simulator)
    if not effects:
        return signals
    motion = torch.cat([state.get("qpos"), state.get("qvel")], dim=-1)
    # A motion's start does not hold what sensors of the model read there: their first reading stands in.
    start = torch.cat([motion, signals[..., 0, motion.shape[-1] :]], dim=-1)
    slope = torch.zeros_like(start)
    for i, j in _positions(simulator).items():
        slope[..., i] = start[..., j]
    columns = list(signals.unbind(-1))
    for effect in effects:
        s, own = simulator.signals.index(effect.target), _own(simulator, effect, theta)
        columns[s] = effect.sense(own, Reading(columns[s], start[..., s], slope[..., s], times))
    return torch.stack(columns, dim=-1)


def unsense(simulator: Extensible, theta: Float[Tensor, "*batch P"], state: TensorDict) -> TensorDict:
    """The state behind the positions and velocities that the position sensors show, batch size (*batch,)."""
    effects = _sensors(simulator)
    if not effects:
        return state
    q, v = list(state["qpos"].unbind(-1)), list(state["qvel"].unbind(-1))
    pairs = _positions(simulator)
    for effect in reversed(effects):
        i = simulator.signals.index(effect.target)
        if i in pairs:
            j = pairs[i] - len(q)
            q[i], v[j] = effect.unsense(_own(simulator, effect, theta), q[i], v[j])
    state = state.clone(recurse=False)
    state["qpos"], state["qvel"] = torch.stack(q, dim=-1), torch.stack(v, dim=-1)
    return state


def _sensors(simulator: Measured) -> list[Effect]:
    return [effect for effect in simulator.effects if effect.target_kind == "signal"]


def _positions(simulator: Extensible) -> dict[int, int]:
    """Place of each scalar joint's position signal -> place of its velocity."""
    places = {name: i for i, name in enumerate(simulator.signals)}
    return {
        i: places[f"qvel.{name.removeprefix('qpos.')}"]
        for name, i in places.items()
        if name.startswith("qpos.") and name.removeprefix("qpos.") in simulator.joint_kinds
    }


def _own(simulator: Simulator, effect: Effect, theta: Tensor) -> dict[str, Tensor]:
    return {name: theta[..., simulator.parameters.index(f"{effect.key}.{name}")] for name in effect.parameters}
