"""Left-out squares: what a fold is predicted by, against fits that never saw it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.rows import band_counts, band_squares
from onlinebayes.identification.fitting.window_length import windows_of
from onlinebayes.identification.judging.scoring import LinearModel, folds_of, gain, in_common, left_out, partitions
from onlinebayes.identification.replaying.integration import Integration
from tests.criticism.rigs import NOISE, measure, model

SIMULATOR, MEASUREMENT = model(), measure(runs=6, seconds=1.5)
WINDOWS = windows_of(SIMULATOR, MEASUREMENT, 0.5, torch.tensor([NOISE], dtype=torch.float64), Integration(0.01))
BY_RUN, BY_POSITION = partitions(WINDOWS)


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
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    left = left_out(LinearModel.of(fitted), WINDOWS, BY_RUN)
    inside = band_squares(WINDOWS, fitted.rows.in_noise(fitted.rows.residual)).sum()
    assert inside < left.squares.sum() < 1.1 * inside
    assert 0.8 < float(left.rms) < 1.1
    assert left.counts.sum() == band_counts(WINDOWS).sum()


def test_a_hypothesis_gains_nothing_over_itself() -> None:
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    left = left_out(LinearModel.of(fitted), WINDOWS, BY_RUN)
    own = gain(left, left)
    assert (own.gain, own.se, own.worse, own.folds) == (0.0, 0.0, 0, 6)


def test_runs_are_folds_and_regions_hold_the_windows_that_lie_together() -> None:
    assert torch.equal(BY_RUN.of, WINDOWS.run)
    mean = WINDOWS.value.mean((1, 2))
    assert mean[BY_POSITION.of == 3].min() >= mean[BY_POSITION.of == 0].max()


def test_many_short_runs_make_twelve_folds_of_runs_that_follow_each_other() -> None:
    many = replace(WINDOWS, run=torch.arange(WINDOWS.count))
    folds = folds_of(many)
    assert WINDOWS.count > len(folds.unique()) == 12
    assert torch.equal(folds, folds.sort().values)
    assert int(folds.bincount().max()) - int(folds.bincount().min()) <= 1


def test_nothing_is_gained_by_windows_that_are_taken_away() -> None:
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    whole = left_out(LinearModel.of(fitted), WINDOWS, BY_RUN)
    kept = torch.nonzero(WINDOWS.run != 2)[:, 0]
    some = WINDOWS.select(kept)
    part = replace(whole, squares=whole.squares[kept], counts=whole.counts[kept], folds=BY_RUN.over(some))
    assert part.rms != whole.rms
    for one, other in ((part, whole), (whole, part)):
        own = gain(one, other)
        assert (own.gain, own.se, own.worse, own.folds) == (0.0, 0.0, 0, 5)
    unseen = replace(whole, counts=whole.counts.clone(), squares=whole.squares.clone())
    unseen.counts[:3], unseen.squares[:3] = 0.0, 0.0
    assert gain(unseen, whole).gain == 0.0
    better = replace(part, squares=0.25 * part.squares)
    assert gain(better, whole).gain == pytest.approx(gain(better, part).gain)


def test_other_folds_or_windows_cannot_be_compared() -> None:
    left = left_out(LinearModel.of(fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)), WINDOWS, BY_RUN)
    with pytest.raises(ValueError, match="different folds"):
        gain(replace(left, folds=BY_POSITION), left)
    noise = torch.tensor([NOISE], dtype=torch.float64)
    longer = windows_of(SIMULATOR, MEASUREMENT, 1.0, noise, Integration(0.01))
    other = left_out(LinearModel.of(fit(SIMULATOR, longer, SIMULATOR.nominal)), longer, partitions(longer)[0])
    with pytest.raises(ValueError, match="no window in common"):
        in_common(other, left)


def test_windows_of_another_step_lie_where_they_lay() -> None:
    finer = windows_of(SIMULATOR.with_timestep(0.005), MEASUREMENT, 0.5, WINDOWS.noise, Integration(0.005))
    assert finer.spans == WINDOWS.spans
    assert WINDOWS.spans[:2] == (("run0", 0.0, 0.5), ("run0", 0.5, 1.0))


def test_a_gain_that_every_run_shares_is_certain_where_one_run_errs_most() -> None:
    """Errors of 30 floors and, in one run, of 300: each run's error is halved, give or take a tenth."""
    draw = torch.Generator().manual_seed(0)
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    left = left_out(LinearModel.of(fitted), WINDOWS, BY_RUN)
    wrong = torch.where(BY_RUN.of == 2, 300.0, 30.0)[:, None, None].to(left.squares)
    halved = (0.5 + 0.1 * torch.rand(len(BY_RUN), generator=draw))[BY_RUN.of, None, None].to(left.squares)
    before = replace(left, squares=wrong.square() * left.counts)
    after = replace(left, squares=(halved * wrong).square() * left.counts)
    own = gain(after, before)
    assert own.gain > 10 * own.se > 0
    assert own.worse == 0


def test_a_gain_in_one_run_alone_is_uncertain() -> None:
    fitted = fit(SIMULATOR, WINDOWS, SIMULATOR.nominal)
    left = left_out(LinearModel.of(fitted), WINDOWS, BY_RUN)
    before = replace(left, squares=900.0 * left.counts)
    once = torch.where(BY_RUN.of == 2, 0.1, 1.0)[:, None, None].to(left.squares)
    own = gain(replace(before, squares=once * before.squares), before)
    assert 0 < own.gain < 2 * own.se


def test_windows_of_some_runs_are_those_of_a_measurement_of_these_runs() -> None:
    names = [WINDOWS.runs[4], WINDOWS.runs[1]]
    some = WINDOWS.of_runs(names)
    alone = windows_of(SIMULATOR, MEASUREMENT.select(names), 0.5, WINDOWS.noise, Integration(0.01))
    assert some.runs == alone.runs
    assert sorted(some.spans) == sorted(alone.spans)
    order = [some.spans.index(span) for span in alone.spans]
    assert torch.equal(some.select(torch.tensor(order)).value, alone.value)
