"""Replays of whole runs, window by window from smoothed measured starts, and the error that is reported.

    error = RMS over the windows' rows of measured - simulated, starts as smoothed
    floor^2 = noise^2 + mean over rows of sum_j (d sim / d s_j)^2 sd(s_j)^2

Here a start is a measurement, as a user would give one, so its uncertainty belongs to the floor. A held-out run's own
values, where parameters differ between runs, are lent from one half of the run to the other (see ``own``).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.own import held_out_model
from onlinebayes.criticism.replay import replay, rollout, shown
from onlinebayes.criticism.results import ReplayedRun
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator


def replay_runs(
    simulator: Simulator, windows: Windows, theta: Float[Tensor, " P"], held_out: bool
) -> tuple[ReplayedRun, ...]:
    """Every run of the windows as measured and as simulated; rows from a window in which the model diverged are nan."""
    model, parts, values = held_out_model(simulator, windows, theta) if held_out else (simulator, windows, theta)
    trajectory = rollout(model, parts, values[None], parts.start[None])[0]
    valid = trajectory["valid"][..., None]
    simulated = shown(model, parts, values[None], parts.start[None], trajectory[None])[0]
    simulated = torch.where(valid & torch.isfinite(simulated), simulated, torch.nan)
    qpos = torch.where(valid, trajectory["qpos"], torch.nan)
    measured = torch.where(windows.measured, windows.value, torch.nan)
    found = []
    for r, name in enumerate(windows.runs):
        mine = (windows.run == r).nonzero()[:, 0]
        inside = windows.inside[mine].flatten()
        K = windows.rows
        row = windows.first[mine, None] + torch.arange(1, K + 1, device=mine.device)
        number = torch.arange(len(mine), device=mine.device)[:, None].expand(-1, K)

        def rows(table: Tensor, mine: Tensor = mine, inside: Tensor = inside) -> Tensor:
            return table[mine].flatten(0, 1)[inside]

        found.append(
            ReplayedRun(
                name,
                held_out,
                (windows.begin[r] + row.to(theta) * windows.step).flatten()[inside],
                rows(windows.command),
                rows(measured),
                rows(simulated),
                rows(qpos),
                number.flatten()[inside],
            )
        )
    return tuple(found)


def replay_error(replays: tuple[ReplayedRun, ...], signals: tuple[str, ...]) -> dict[str, float]:
    """RMS over all rows of these replays, signal -> value [its unit]; inf where it diverged, nan without rows."""
    measured = torch.cat([run.measured for run in replays])
    simulated = torch.cat([run.simulated for run in replays])
    seen = ~torch.isnan(measured)
    wrong = torch.where(seen, torch.nan_to_num(measured - simulated, nan=float("inf")), 0.0)
    return dict(zip(signals, (wrong.square().sum(0) / seen.sum(0)).sqrt().tolist(), strict=True))


def start_floor(
    simulator: Simulator, windows: Windows, theta: Float[Tensor, " P"], signals: tuple[str, ...]
) -> dict[str, float]:
    """Noise floor of :func:`replay_error`: sensor noise and the starts' uncertainty as the model propagates it."""
    moved = torch.stack([torch.zeros_like(windows.start), *torch.diag_embed(windows.start_sd).unbind(1)])
    simulator, windows, theta = held_out_model(simulator, windows, theta)
    signals_at, _ = replay(simulator, windows, theta.expand(len(moved), -1), windows.start + moved)
    spread = (signals_at[1:] - signals_at[0]).square().sum(0)
    seen = windows.measured
    share = torch.where(seen, spread, torch.zeros_like(spread)).sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)
    return dict(zip(signals, (share + windows.noise.square()).sqrt().tolist(), strict=True))
