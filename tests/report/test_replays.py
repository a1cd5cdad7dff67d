"""What is drawn of a replay: lines go on where the model has rows between those of the log, and break in its gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from onlinebayes.report.replays import traces
from tests.report.synthetic import SIGNAL, criticism


def test_rows_between_those_of_the_log_are_not_drawn_and_gaps_are() -> None:
    result = criticism(rate=50.0, seconds=2.0)
    run = result.final.replays[0]
    seen = torch.arange(len(run.time)) % 2 == 0
    seen[40:60] = False  # the sensor was out
    measured = torch.where(seen[:, None], run.measured, torch.nan)
    models = [
        replace(model, replays=(replace(model.replays[0], measured=measured),)) for model in (result.base, result.final)
    ]
    (trace,) = traces(replace(result, base=models[0], final=models[1]), SIGNAL)
    blank = np.isnan(trace.measured)
    gap = (trace.time > float(run.time[38])) & (trace.time < float(run.time[60]))
    assert bool((blank == gap).all())
    assert blank.sum() == 21
    assert len(trace.time) == int(seen.sum()) + 21
