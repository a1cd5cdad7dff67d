"""When a gain is clear, and when one model is told from another."""

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.judging.score import CrossValidated, Gain, cross_validate, parted
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.blocks import make_blocks
from onlinebayes.identification.fitting.fit import fit
from tests.criticism.rigs import measure, model

BIN = 0.02


@pytest.mark.parametrize(
    ("gain", "se", "blocks", "better", "clear"),
    [
        (20.0, 9.0, 8, 5, True),
        (20.0, 11.0, 8, 7, False),
        (20.0, 11.0, 8, 8, True),  # 2^-8 = .004
        (20.0, 11.0, 7, 7, True),
        (20.0, 11.0, 6, 6, False),  # 2^-6 = .016
        (-20.0, 5.0, 8, 0, False),
    ],
)
def test_two_standard_errors_or_all_of_enough_blocks(
    gain: float, se: float, blocks: int, better: int, clear: bool
) -> None:
    assert Gain(gain, se, blocks, better).clear is clear


@pytest.mark.parametrize(
    ("blocks", "better", "tried", "p"),
    [(8, 8, 1, 2.0**-8), (12, 12, 40, 40 * 2.0**-12), (8, 8, 1000, 1.0), (8, 7, 1, 1.0)],
)
def test_the_sign_test_counts_every_candidate_and_asks_for_all_blocks(
    blocks: int, better: int, tried: int, p: float
) -> None:
    assert Gain(20.0, 11.0, blocks, better).sign_p(tried) == pytest.approx(p)


@pytest.fixture(scope="module")
def scores() -> CrossValidated:
    windows = make_windows(model(), measure(runs=8), 1.0)
    return cross_validate(fit(model(), windows, torch.tensor([2.5, 1.4]).double()), windows, make_blocks(windows, 0.05))


def shifted(scores: CrossValidated, by_block: list[float], tau: float = 0.0) -> CrossValidated:
    """The same model, better by so much in each block, in every one of its bins alike."""
    gained = torch.tensor(by_block, dtype=torch.float64)
    rows = scores.row_density + gained.mean() * len(gained) / scores.row_density.numel()
    return replace(scores, log_density=scores.log_density + gained, row_density=rows, tau=tau or scores.tau)


def test_a_model_is_not_parted_from_itself(scores) -> None:
    assert not parted(scores, scores, BIN)


def test_one_block_that_shows_most_of_it_is_outweighed_by_the_bins(scores) -> None:
    better = shifted(scores, [1.0] * 7 + [90.0])
    assert parted(better, scores, BIN)
    assert parted(scores, better, BIN)


def test_bins_that_go_together_for_long_do_not_count_one_by_one(scores) -> None:
    long = 6 * BIN
    better = shifted(scores, [1.0] * 7 + [90.0], tau=long)
    assert not parted(better, replace(scores, tau=long), BIN)


def test_a_signal_that_moves_in_one_block_alone_does_not_count() -> None:
    windows = make_windows(model(), measure(runs=8), 1.0)
    blocks = make_blocks(windows, 0.05)
    windows = replace(windows, observed=windows.observed & (windows.run == 3)[:, None, None])
    fitted = fit(model(), windows, torch.tensor([2.5, 1.4]).double())
    found = cross_validate(fitted, windows, blocks)
    assert bool(torch.isfinite(found.log_density).all())
    assert float(found.log_density[3]) == 0.0
