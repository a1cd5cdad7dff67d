"""The error on runs that were never fitted: every window from its best start, own values found inside each run.

    s_w, own_r = argmin |r~|^2  with all shared parameters as fitted;      error = RMS of what is left

A start read off noisy sensors would add an error that no parameter deserves.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.rows import (
    Rows,
    band_counts,
    band_squares,
    project,
    rms,
    score_weights,
    start_shift,
)
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.fitting.theta import room, theta_of
from onlinebayes.identification.fitting.window_length import windows_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import build
from onlinebayes.identification.judging.scoring import LinearModel, score_parts
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.identification.scope import address_of
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

STEPS = 3
"""Of starts and own values: the replay bends little between a smoothed start and the best one."""


def held_out_errors(
    evaluator: Evaluator, evaluation: Evaluation, held: Measurement, horizon: float
) -> dict[str, float]:
    """RMS of each signal over the windows of runs that were not fitted [its unit]; inf where the replay diverges.

    Args:
        evaluator, evaluation: a hypothesis fitted to other runs.
        held: the runs.
        horizon: length of the windows [s].
    """
    noise = evaluator.windows.noise
    windows = windows_of(evaluator.given, held, horizon, noise, evaluator.discretisation.values)
    simulator = build(evaluator.discretisation.values.of(evaluator.given), evaluation.hypothesis, held.runs)
    theta = theta_of(simulator, evaluation.values)  # a new run's own value begins at the mean of the fitted runs'
    errors = _left(simulator, windows, theta) * windows.noise
    names = [evaluator.given.signals[column] for column in windows.columns]
    return dict(zip(names, errors.tolist(), strict=True))


def run_scores(
    simulator: Identifiable, values: Mapping[str, float], runs: Measurement, noise: Mapping[str, float], horizon: float
) -> Float[Tensor, " R"]:
    """Score a model's prediction of runs that were not fitted: S of each run alone, see :mod:`.scoring` [nats].

    Args:
        simulator: the model, which is integrated as it is.
        values: of its parameters, by name [SI].
        runs: R of them.
        noise: floor of each signal [its unit].
        horizon: length of the windows [s].

    Returns:
        0 where nothing is wrong, a half of ln 2 for each signal where no more than noise is left; inf where the replay
        diverges, or nothing of the run can be judged.

    Raises:
        BadInput: runs that do not suit the simulator.
    """
    floor = torch.tensor([noise[signal.name] for signal in runs.signals], dtype=torch.float64)
    theta, scores = theta_of(simulator, values), []
    for run in runs.runs:
        windows = windows_of(simulator, runs.select([run]), horizon, floor, Integration(simulator.timestep))
        rows = _settled(simulator, windows, theta)
        if rows is None:
            scores.append(float("inf"))
            continue
        squares, counts = band_squares(windows, rows.in_noise(rows.residual)), band_counts(windows)
        scores.append(float(score_parts(squares.sum(0), counts.sum(0)).sum()) if bool(counts.any()) else float("inf"))
    return torch.tensor(scores, dtype=torch.float64)


def _left(simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"]) -> Float[Tensor, " S"]:
    """RMS of every signal after starts and own values have settled [floors]."""
    rows = _settled(simulator, windows, theta)
    return torch.full_like(windows.noise, float("inf")) if rows is None else rms(windows, rows.in_noise(rows.residual))


def _settled(simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"]) -> Rows | None:
    """Return the residual rows after starts and own values have settled; None where the replay diverges."""
    starts = windows.start
    own = torch.tensor([name != address_of(name) for name in simulator.parameters], device=starts.device)
    for step in range(STEPS + 1):
        lin = linearise(simulator, windows, theta, starts)
        if not lin.valid:
            return None
        rows = project(windows, lin, score_weights(windows, lin.residual * per_noise(windows)))
        if step == STEPS:
            break
        model = LinearModel(rows, rows.columns * own, *(end * own for end in room(simulator, theta)))
        moved = model.whole() * own
        starts = lin.starts + start_shift(windows, lin, rows, moved[None])[0]
        theta = simulator.parameters.clamp(theta + moved)
    return rows
