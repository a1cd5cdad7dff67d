"""A fitted hypothesis as the report shows it: the mended simulator, its parameters with their spread, and its replays.

The report integrates no more coarsely than the user's model did. Covariances are the jackknife's over blocks of the
data; windows begin at their best starts, as they did in the fit: a start read off a noisy sensor would add an error
that no parameter deserves.
"""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import make_blocks
from onlinebayes.identification.fitting.discretisation import NEGLIGIBLE, error_in_floors
from onlinebayes.identification.fitting.fit import Fit, residual_correlation_time, weighed_by_noise
from onlinebayes.identification.fitting.heldout import begun_best, replay_runs
from onlinebayes.identification.fitting.identifiability import (
    covariance_of,
    estimates,
    flat_directions,
    rests_on_moments,
)
from onlinebayes.identification.fitting.theta import theta_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import build
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.identification.results import FittedModel, FlatDirection, Numerics


def numerics_of(evaluation: Evaluation, evaluator: Evaluator) -> Numerics:
    """Check whether a fitted hypothesis is integrated finely enough to be judged by."""
    fitted = evaluation.fitted
    given = build(evaluator.given, evaluation.hypothesis, evaluator.runs)
    error, left = error_in_floors(fitted, given, evaluator.windows)
    return Numerics(
        fitted.simulator.timestep, error, evaluator.original_integrator or error <= NEGLIGIBLE * max(1.0, left)
    )


def flat_of(fit: Fit, windows: Windows) -> tuple[FlatDirection, ...]:
    """The combinations of parameters that the fit runs do not determine."""
    return flat_directions(fit, residual_correlation_time(windows, fit.lin), windows.bin_step)


def fitted_model(
    evaluation: Evaluation,
    evaluator: Evaluator,
    folds: int | None,
    way: Integration,
    windows: Sequence[tuple[Windows, bool]],
    fit: Fit | None = None,
) -> FittedModel:
    """A hypothesis with its replays of all runs.

    Args:
        evaluation, evaluator: the hypothesis, and by what it was fitted.
        folds: number of blocks asked for.
        way: how it is run.
        windows: of runs, and whether these were held out.
        fit: :func:`weighed_by_noise` of the evaluation, where it is known.
    """
    fit = weighed_by_noise(evaluation.fitted, evaluator.windows) if fit is None else fit
    tau, bin_step = residual_correlation_time(evaluator.windows, fit.lin), evaluator.windows.bin_step
    blocks = make_blocks(evaluator.windows, tau, folds)
    model = way.of(build(evaluator.given, evaluation.hypothesis, evaluator.runs))
    quick, rough = evaluation.fitted.simulator, evaluation.fitted.rough
    theta = theta_of(model, evaluation.values)
    covariance = covariance_of(fit, blocks, tau, bin_step) + rests_on_moments(fit, tau, bin_step)
    values = estimates(fit, covariance, blocks.count, flat_of(fit, evaluator.windows))
    replays = [
        run
        for part, held in windows
        for run in replay_runs(model, begun_best(quick, part, theta, held_out=held, rough=rough), theta, held)
    ]
    return FittedModel(model, theta, covariance, values, tuple(effect.key for effect in model.effects), tuple(replays))
