"""Hidden states at the windows' starts, worked out along what was measured of the run before: no physics simulated.

    run r, theta_m:   motion of the run -> h at all its rows (M, R, G)  -> picked at each window's first row (M, W)

One pass a run, however many windows it has; where effects remember little more than a window, one over what they
remember before each, all windows at once: fewer steps, hardly more rows. See ``Identifiable.hidden_states_along``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.coordinates import velocity
from onlinebayes.identification.data.windows import Windows
from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.sensing import unsense

SLICED = 2.0  # times the runs' rows: what the windows' own histories may add up to


def recall(simulator: Identifiable, windows: Windows, theta: Float[Tensor, "M W P"]) -> dict[str, TensorDict]:
    """Key of effect -> its hidden state at each window's start, batch size (M * W,).

    Empty where no force stage remembers anything, or a run's motion is not known.
    """
    if not windows.run_histories or not any(effect.has_force and effect.memory for effect in simulator.effects):
        return {}
    runs, mine = torch.unique(windows.run, return_inverse=True)
    motion = _motion(simulator, windows, runs.tolist())
    if motion is None:
        return {}
    remembered = max(math.ceil(e.memory / windows.step) for e in simulator.effects if e.has_force)
    whole = len(runs) * motion.batch_size[1]
    if remembered < motion.batch_size[1] and windows.count * remembered <= SLICED * whole:
        return _lately(simulator, windows, theta, motion[mine], remembered)
    M, R = theta.shape[0], len(runs)
    # Windows of one run share their theta.
    window = torch.stack([(mine == r).nonzero()[0, 0] for r in range(R)])
    worlds = theta[:, window].flatten(0, 1)
    moved = unsense(simulator, worlds[:, None], motion.expand(M, *motion.batch_size).flatten(0, 1))
    found = simulator.hidden_states_along(worlds, moved, windows.step)
    rows = windows.first.clamp_max(motion.batch_size[1])
    return {key: line.unflatten(0, (M, R))[:, mine, rows].flatten(0, 1) for key, line in found.items()}


def _lately(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, "M W P"], motion: TensorDict, rows: int
) -> dict[str, TensorDict]:
    """The same from the rows before each window alone; ``motion`` is that of each window's run (W, K)."""
    M, W = theta.shape[:2]
    window, row = (torch.arange(count, device=theta.device) for count in (W, rows))
    last = windows.first.clamp_max(motion.batch_size[1])
    begin = (last - rows).clamp_min(0)
    line = motion[window[:, None], begin[:, None] + row]
    worlds = theta.flatten(0, 1)
    moved = unsense(simulator, worlds[:, None], line.expand(M, W, rows).flatten(0, 1))
    found = simulator.hidden_states_along(worlds, moved, windows.step)
    return {key: each.unflatten(0, (M, W))[:, window, last - begin].flatten(0, 1) for key, each in found.items()}


def _motion(simulator: Identifiable, windows: Windows, runs: list[int]) -> TensorDict | None:
    """Return the motion for ``Identifiable.hidden_states_along``, to the runs' last windows (R, K); None if unknown."""
    longest = max(1, int(windows.first.max()))
    lines = []
    for r in runs:
        past = windows.run_histories[r]
        if past.motion is None:
            return None
        # Rows after a run's end are never picked.
        rows = torch.arange(longest, device=windows.run.device).clamp_max(past.motion.batch_size[0] - 1)
        line = past.motion[rows]
        positions = [f"qpos.{joint}" for joint in past.joints]
        rates = [velocity(joint, simulator.signals) for joint in past.joints]
        state = {
            "qpos": _placed(simulator, "qpos.", positions, line["q"]),
            "qvel": _placed(simulator, "qvel.", rates, line["v"]),
        }
        lines.append(TensorDict({**state, "command": line["command"], "enable": line["enable"]}, batch_size=[longest]))
    return TensorDict.stack(lines)


def _placed(
    simulator: Measured, prefix: str, signals: Sequence[str | None], values: Float[Tensor, "K J"]
) -> Float[Tensor, "K n"]:
    """The signals' columns among all of the state's that begin with ``prefix``; those of other joints are 0."""
    names = [name for name in simulator.signals if name.startswith(prefix)]
    state = values.new_zeros(len(values), len(names))
    state[:, [names.index(name) for name in signals if name is not None]] = values
    return state
