"""The held-out runs: the error that is reported, and the same error in detail."""

from __future__ import annotations

from onlinebayes.criticism.findings.profiles import profiles
from onlinebayes.criticism.results import HeldOutError
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.fitting.heldout import (
    horizon_errors,
    replay_error,
    window_errors,
)
from onlinebayes.identification.results import FittedModel, ReplayedRun


def evaluate_held_out(
    base: FittedModel, final: FittedModel, held: Windows, signals: tuple[str, ...], units: dict[str, str]
) -> tuple[HeldOutError, Detail]:
    """Error over the held-out windows with its floor; windows and profiles of all runs, horizons of the held-out ones.

    Args:
        base, final: the models with their replays of all runs.
        held: windows of the held-out runs at every row, as those replays had them.
        signals: names of the columns.
        units: signal -> unit.
    """
    before, after = _held_out(base), _held_out(final)
    error = HeldOutError(
        replay_error(before, signals),
        replay_error(after, signals),
        dict(zip(signals, held.noise.tolist(), strict=True)),
        dict.fromkeys(signals, held.horizon),
    )
    detail = Detail(
        window_errors(base.replays, final.replays, signals),
        horizon_errors(before, after, held, signals),
        profiles(base.replays, final.replays, signals, base.simulator.commands, units),
    )
    return error, detail


def _held_out(model: FittedModel) -> tuple[ReplayedRun, ...]:
    return tuple(run for run in model.replays if run.held_out)
