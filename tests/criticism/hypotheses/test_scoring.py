"""Left-out squares: what a fold is predicted by, against fits that never saw it."""

from __future__ import annotations

import torch

from onlinebayes.criticism.hypotheses.fitting import fit
from onlinebayes.criticism.hypotheses.lengths import windows_of
from onlinebayes.criticism.hypotheses.rows import band_counts, band_squares
from onlinebayes.criticism.hypotheses.scoring import LinearModel, folds_of, gain, left_out, partitions
from onlinebayes.identification.replaying.ladder import Rung
from tests.criticism.rigs import NOISE, measure, model

SIMULATOR, MEASUREMENT = model(), measure(runs=6, seconds=1.5)
WINDOWS = windows_of(SIMULATOR, MEASUREMENT, 0.5, torch.tensor([NOISE], dtype=torch.float64), Rung(0.01))


def test_a_fold_is_predicted_as_by_a_fit_without_it() -> None:
    fitted, folds = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal), folds_of(WINDOWS)
    model = LinearModel.of(fitted)
    normal = model.columns.mT @ model.columns
    right = (model.columns.mT @ model.rows.residual[..., None])[..., 0]
    for f in (0, 3):
        without = WINDOWS.select((folds != f).nonzero()[:, 0])
        again = fit(SIMULATOR, without, SIMULATOR.nominal)
        predicted = fitted.theta + model.without(folds == f, normal, right)
        moved = (again.theta - fitted.theta).abs()
        # To first order, with the weights of all data: within a fifth of what the fold moves.
        torch.testing.assert_close(predicted, again.theta, rtol=0, atol=float(0.2 * moved.max()))


def test_left_out_squares_of_a_right_model_are_those_of_noise_and_a_little_more() -> None:
    fitted, folds = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal), folds_of(WINDOWS)
    left = left_out(LinearModel.of(fitted), WINDOWS, folds)
    inside = band_squares(WINDOWS, fitted.rows.in_noise(fitted.rows.residual)).sum()
    assert inside < left.squares.sum() < 1.1 * inside
    assert 0.8 < float(left.rms) < 1.1
    assert left.counts.sum() == band_counts(WINDOWS).sum()


def test_a_hypothesis_gains_nothing_over_itself() -> None:
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    left = left_out(LinearModel.of(fitted), WINDOWS, folds_of(WINDOWS))
    own = gain(left, left)
    assert (own.gain, own.se, own.worse, own.folds) == (0.0, 0.0, 0, 6)


def test_runs_are_folds_and_regions_hold_the_windows_that_lie_together() -> None:
    by_run, by_position = partitions(WINDOWS)
    assert torch.equal(by_run, WINDOWS.run)
    mean = WINDOWS.value.mean((1, 2))
    assert mean[by_position == 3].min() >= mean[by_position == 0].max()
