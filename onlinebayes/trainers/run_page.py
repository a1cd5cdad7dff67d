"""Contents of the page of a run: parameters, curves, calibration, the episode as it moves, where the time went."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import quantities
from onlinebayes.inference.calibration import LEVELS
from onlinebayes.loggers import Curves, Film, Page, calibration
from onlinebayes.simulators.drawing import captioned, render, view_of
from onlinebayes.trainers.playing import Episode
from onlinebayes.trainers.state import OnlineState, Record

NUMBER = re.compile(r"-?\d[\d.e+-]*|-?\.\d+")
NORMAL = 1.645
"""Standard deviations from a normal distribution's middle to its 5 % and its 95 %."""
FRAMES, FILM = 8, 60  # of the strip and of the film
EPISODE = "An episode: the real system, and pale the simulator at the {}'s mean, driven by the same policy"
BAND = "median, 5 to 95 %"


def page(
    name: str,
    state: OnlineState,
    *,
    truth: Float[Tensor, " P"] | None,
    corner: np.ndarray | None,
    played: Mapping[str, Episode],
    baselines: Mapping[str, float],
    made: Mapping[str, str],
) -> Page:
    """The page after the last step.

    Args:
        name: of the recipe.
        state: where the run stands.
        truth: of the hidden system, where it is known.
        corner: picture of the belief; None where the policy learnt alone.
        played: the last episode.
        baselines: returns of other runs by their kind.
        made: how the run was made, by what is said: command, commit, settings.
    """
    last, inferred = state.records[-1], corner is not None
    pictures, films = {} if corner is None else {"The belief": corner}, {}
    if played:
        films[EPISODE.format("belief" if inferred else "prior")] = _film(played)
        pictures["The same episode at eight moments"] = _strip(played)
    seconds: dict[str, float] = {}
    for record in state.records:
        for part, value in record.seconds.items():
            seconds[part] = seconds.get(part, 0.0) + value
    return Page(
        title=name,
        lead=_lead(last, inferred),
        head=["parameter", "unit", *_head(inferred), *([] if truth is None else ["truth"])],
        rows=_rows(state, truth),
        charts=[*(_beliefs(state, truth) if inferred else []), *_charts(state, baselines)],
        pictures=pictures,
        seconds=seconds,
        notes=notes_of(state.records),
        films=films,
        made=made,
    )


def notes_of(records: Sequence[Record]) -> list[str]:
    """The notes of all steps; those that differ by their numbers alone are one line, in the words of the last."""
    alike: dict[str, list[tuple[int, str]]] = {}
    for record in records:
        for note in record.notes:
            alike.setdefault(NUMBER.sub("", note), []).append((record.step, note))
    return [f"{_steps([step for step, _ in told])}: {told[-1][1]}" for told in alike.values()]


def _steps(steps: Sequence[int]) -> str:
    """``step 3``; ``steps 1 to 8``; ``steps 1, 3 to 5``."""
    runs: list[list[int]] = []
    for step in sorted(set(steps)):
        if runs and step == runs[-1][-1] + 1:
            runs[-1].append(step)
        else:
            runs.append([step])
    told = ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
    return f"step{'s' if len(set(steps)) > 1 else ''} {told}"


def _rows(state: OnlineState, truth: Tensor | None) -> list[list[str]]:
    rows, last = [], state.records[-1]
    for i, parameter in enumerate(last.belief):
        low, middle, high = quantiles_of(last, parameter)
        true = [] if truth is None or truth[i].isnan() else [float(truth[i])]
        cells, unit = quantities.apart((middle, low, high, *true), high - low, state.belief.space[parameter].unit)
        rows.append([parameter, unit, *cells, *([""] if truth is not None and not true else [])])
    return rows


def quantiles_of(record: Record, parameter: str) -> tuple[float, float, float]:
    """5, 50 and 95 % of a parameter; of a normal distribution's in a run that kept mean and sd alone."""
    if parameter in record.quantiles:
        return record.quantiles[parameter]
    mean, sd = record.belief.get(parameter, (math.nan, math.nan))  # one that the model got later has none before
    return mean - NORMAL * sd, mean, mean + NORMAL * sd


def _lead(last: Record, inferred: bool) -> str:
    simulated = f", {last.simulated} for the belief" if last.simulated else ""
    alone = "" if inferred else "; the policy learnt alone, nothing was inferred"
    figures = "".join(f"; {name} {value:.4g}" for name, value in last.figures.items())
    return f"{last.step} steps, {last.frames} simulated frames for the policy{simulated}{alone}{figures}"


def _head(inferred: bool) -> list[str]:
    return ["median", "5 %", "95 %"] if inferred else ["median of the prior", "its 5 %", "95 %"]


def _beliefs(state: OnlineState, truth: Tensor | None) -> list[Curves]:
    records, charts = state.records, []
    steps = ("step", [record.step for record in records])
    for i, parameter in enumerate(records[-1].belief):
        low, middle, high = zip(*(quantiles_of(record, parameter) for record in records), strict=True)
        level = {} if truth is None or truth[i].isnan() else {"truth": float(truth[i])}
        unit = state.belief.space[parameter].unit
        title = f"{parameter} [{unit}]" if unit else parameter
        charts.append(Curves(title, steps, {BAND: middle}, {BAND: (low, high)}, level))
    return [chart for chart in charts if _is_curve(chart)]


def _charts(state: OnlineState, baselines: Mapping[str, float]) -> list[Curves]:
    records, charts = state.records, list[Curves]()
    frames = ("simulated frames", [record.frames for record in records])
    for figure in dict.fromkeys(figure for record in records for figure in record.figures):
        values = [record.figures.get(figure, float("nan")) for record in records]
        charts.append(Curves(figure, frames, {figure: values}, levels=baselines if figure == "return" else {}))
    if (found := newest_calibration(records)) is not None:
        charts.append(calibration(LEVELS, found))
    for loss in dict.fromkeys(loss for record in records for loss in record.losses):
        charts.append(Curves(loss, frames, {loss: [r.losses.get(loss, float("nan")) for r in records]}))
    return [chart for chart in charts if _is_curve(chart) or chart.levels]


def _is_curve(chart: Curves) -> bool:
    """Whether there are two points or more: one alone is in the log."""
    return any(sum(map(math.isfinite, values)) > 1 for values in chart.lines.values())


def newest_calibration(records: list[Record]) -> tuple[float, ...] | None:
    """Coverage by level of the last fit; None where there was none."""
    return next((record.calibration for record in reversed(records) if record.calibration), None)


def _frames(played: Mapping[str, Episode], number: int, width: int) -> tuple[list[np.ndarray], float]:
    """Pictures evenly over the episode, and how many poses lie between two."""
    real, simulated = played["real"], played.get("simulated")
    number = min(number, len(real.poses))
    places = torch.linspace(0, len(real.poses) - 1, number).round().long().tolist()
    view = view_of(real.shapes, real.poses)
    tall = (view.high[1] - view.low[1]) / (view.high[0] - view.low[0])
    size = (round(width * min(1.0, tall)), width)
    frames = []
    for k in places:
        behind = None if simulated is None else (simulated.shapes, simulated.poses[min(k, len(simulated.poses) - 1)])
        picture = render(real.shapes, real.poses[k], size=size, view=view, ghost=behind)
        frames.append(captioned(picture, f"{k * real.dt:.2f} s"))
    return frames, (len(real.poses) - 1) / max(number - 1, 1)


def _strip(played: Mapping[str, Episode]) -> np.ndarray:
    """The episode in a few frames, in two rows."""
    frames, _ = _frames(played, FRAMES, 240)
    half = (len(frames) + 1) // 2
    frames += [np.full_like(frames[0], 255)] * (2 * half - len(frames))
    return np.concatenate([np.concatenate(row, axis=1) for row in (frames[:half], frames[half:])])


def _film(played: Mapping[str, Episode]) -> Film:
    """The episode as it moves."""
    frames, stride = _frames(played, FILM, 360)
    return Film(frames, max(stride * played["real"].dt, 0.02))
