"""Replays of whole runs, window by window from each window's best start, and the error that is reported.

    error = RMS over the windows' rows of measured - simulated
    floor = noise                                                                      from best starts
    floor^2 = noise^2 + mean over rows of sum_j (d sim / d s_j)^2 sd(s_j)^2            from smoothed ones

A start read off a noisy sensor would add an error that no parameter deserves. Where all methods are to begin alike it
is a measurement, and its uncertainty belongs to the floor. A held-out run's own values, where parameters differ between
runs, are lent from one half of the run to the other (see
:mod:`.fitting.per_run_values`). The same error is also given window by window, and by the time for which the model has
run freely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.chart import POSE
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.detail import HorizonError, WindowError
from onlinebayes.identification.fitting.best_starts import best_starts
from onlinebayes.identification.fitting.per_run_values import held_out_model
from onlinebayes.identification.fitting.projection import project, row_weights, start_shift
from onlinebayes.identification.fitting.sensitivities import linearise_starts
from onlinebayes.identification.replaying.replay import replay, replay_binned, rollout, sensor_readings
from onlinebayes.identification.results import ReplayedRun
from onlinebayes.simulators.identifiable import Identifiable

START_STEPS = 2
"""Of Newton, in held-out runs: starts are nearly linear over a window. One is enough for runs that are only drawn."""


def replay_runs(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], held_out: bool
) -> tuple[ReplayedRun, ...]:
    """Every run of the windows as measured and as simulated; rows from a window in which the model diverged are nan."""
    model, parts, values = held_out_model(simulator, windows, theta) if held_out else (simulator, windows, theta)
    trajectory = rollout(model, parts, values[None], parts.start[None])[0]
    valid = trajectory["valid"][..., None]
    simulated = sensor_readings(model, parts, values[None], parts.start[None], trajectory[None])[0]
    simulated = torch.where(valid & torch.isfinite(simulated), simulated, torch.nan)
    qpos = torch.where(valid, trajectory.get(POSE, trajectory["qpos"]), torch.nan)
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


def begun_best(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    *,
    held_out: bool,
    rough: Identifiable | None = None,
) -> Windows:
    """The same windows, each begun at its best start; as they are where the model diverges.

    Args:
        simulator, windows, theta: what is replayed.
        held_out: whether parameters of single runs are lent within a run.
        rough: the simulator by which derivatives are taken; the same when None.
    """
    model, parts, values = held_out_model(simulator, windows, theta) if held_out else (simulator, windows, theta)
    starts, weight = parts.start, row_weights(parts, torch.ones_like(parts.noise))
    quick = model if rough is None or model is not simulator else rough
    for _ in range(START_STEPS if held_out else 1):
        lin = linearise_starts(quick, parts, values, starts)
        if quick is not model:
            shown, valid = replay_binned(model, parts, values[None], starts[None])
            residual = parts.bin(parts.value) - shown[0]
            lin = replace(lin, residual=residual, valid=lin.valid and bool(valid.all()))
        if not lin.valid:
            break
        shift = start_shift(parts, lin, project(parts, lin), torch.zeros_like(values))
        # Where friction sticks a step may lead astray: a window keeps the better of the two.
        starts, _ = best_starts(
            model, parts, weight, values, lin.starts + torch.stack([torch.zeros_like(shift), shift])
        )
    return replace(windows, start=starts)


def replay_error(replays: tuple[ReplayedRun, ...], signals: tuple[str, ...]) -> dict[str, float]:
    """RMS over all rows of these replays, signal -> value [its unit]; inf where it diverged, nan without rows."""
    measured = torch.cat([run.measured for run in replays])
    simulated = torch.cat([run.simulated for run in replays])
    return dict(zip(signals, _rms(measured, simulated).tolist(), strict=True))


def start_spread(simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"]) -> Float[Tensor, "W K S"]:
    """Variance that the starts' uncertainty gives the replay at every row [the signals' units squared]."""
    moved = torch.stack([torch.zeros_like(windows.start), *torch.diag_embed(windows.start_sd).unbind(1)])
    simulator, windows, theta = held_out_model(simulator, windows, theta)
    signals_at, _ = replay(simulator, windows, theta.expand(len(moved), -1), windows.start + moved)
    return (signals_at[1:] - signals_at[0]).square().sum(0)


def start_floor(windows: Windows, spread: Float[Tensor, "W K S"], signals: tuple[str, ...]) -> dict[str, float]:
    """Noise floor of :func:`replay_error`: sensor noise and the starts' uncertainty as the model propagates it."""
    seen = windows.measured
    share = torch.where(seen, spread, torch.zeros_like(spread)).sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)
    return dict(zip(signals, (share + windows.noise.square()).sqrt().tolist(), strict=True))


def window_errors(
    before: Sequence[ReplayedRun], after: Sequence[ReplayedRun], signals: tuple[str, ...]
) -> tuple[WindowError, ...]:
    """Error of every signal in every window in which it was measured, in the order of the runs and of time."""
    found = []
    for base, final in zip(before, after, strict=True):
        for number in base.window.unique().tolist():
            mine = base.window == number
            start = float(base.time[mine][0])
            seen = ~torch.isnan(base.measured[mine])
            errors = [_rms(run.measured[mine], run.simulated[mine]) for run in (base, final)]
            found += [
                WindowError(signal, base.run, number, base.held_out, start, float(errors[0][s]), float(errors[1][s]))
                for s, signal in enumerate(signals)
                if bool(seen[:, s].any())
            ]
    return tuple(found)


def horizon_errors(
    before: Sequence[ReplayedRun],
    after: Sequence[ReplayedRun],
    windows: Windows,
    signals: tuple[str, ...],
    bins: int = 20,
) -> tuple[HorizonError, ...]:
    """Error against the time since the window's start, in ``bins`` equal bins of one horizon.

    Args:
        before, after: the held-out runs replayed by the base and by the final model.
        windows: their windows.
        signals: names of the columns.
        bins: at most as many as a window has rows.
    """
    bins = min(bins, windows.rows)
    inside = windows.inside[windows.run.argsort(stable=True)]  # in the order of the replays
    row = torch.arange(windows.rows, device=inside.device).expand_as(inside)[inside]
    place = row * bins // windows.rows
    measured = torch.cat([run.measured for run in before])
    error = [torch.cat([run.simulated for run in runs]) - measured for runs in (before, after)]
    middle = tuple((b + 0.5) * windows.horizon / bins for b in range(bins))
    found = []
    for s, signal in enumerate(signals):
        seen = ~torch.isnan(measured[:, s])
        squares = (error[0][:, s].square(), error[1][:, s].square())
        base, final = (tuple(float(one[seen & (place == b)].mean().sqrt()) for b in range(bins)) for one in squares)
        found.append(HorizonError(signal, middle, base, final, (float(windows.noise[s]),) * bins))
    return tuple(found)


def _rms(measured: Float[Tensor, "T S"], simulated: Float[Tensor, "T S"]) -> Float[Tensor, " S"]:
    seen = ~torch.isnan(measured)
    wrong = torch.where(seen, torch.nan_to_num(measured - simulated, nan=float("inf")), 0.0)
    return (wrong.square().sum(0) / seen.sum(0)).sqrt()
