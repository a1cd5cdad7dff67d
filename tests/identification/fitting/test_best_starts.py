"""Each window takes the start that replays it best."""

from __future__ import annotations

import torch

from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.best_starts import best_starts
from onlinebayes.identification.fitting.projection import row_weights
from tests.criticism.rigs import TRUTH, measure, model


def test_each_window_takes_the_start_that_replays_it_best() -> None:
    simulator, windows = model(), make_windows(model(), measure(runs=3), 1.0, 0.1)
    theta, weights = torch.tensor(TRUTH, dtype=torch.float64), row_weights(windows, torch.ones(1).double())
    thrown = windows.start.clone()
    thrown[2] += 0.5
    thrown[5:] += 0.5
    chosen, _ = best_starts(simulator, windows, weights, theta, torch.stack([thrown, windows.start]))
    assert torch.equal(chosen, windows.start)
