"""Where the error concentrates is said by the time since a run's start, too, in seconds."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from onlinebayes.criticism.judging.localise import failures, in_a_sentence
from onlinebayes.criticism.results import Failure
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import unfitted
from tests.criticism.rigs import TRUTH, measure, model

SECONDS = 8.0
UNITS = {"qpos.rail": "m"}


def found(amount: Callable[[Tensor], Tensor], runs: int) -> tuple[tuple[Failure, ...], str]:
    """Where a true model errs, as regions and as a sentence: a wave of so many noises at each time was added."""
    measurement = measure(runs=runs, seconds=SECONDS)
    time = measurement.data["time"]
    wave = 1e-4 * amount(time) * torch.sin(40.0 * time)
    measurement.data["signal"] = measurement.data["signal"] + wave[..., None]
    windows = make_windows(model(), measurement, 1.0)
    fitted = unfitted(model(), windows, torch.tensor(TRUTH, dtype=torch.float64))
    return failures(fitted, windows, UNITS), in_a_sentence(fitted, windows, UNITS, {"qpos.rail": 9.0})


@pytest.mark.parametrize("runs", [1, 4])
def test_what_errs_in_the_first_second_of_each_run(runs: int) -> None:
    (worst, *_), sentence = found(lambda time: 30.0 * (time < 1.0), runs)
    assert worst.where == "time since the run's start < 2.0 s"
    assert worst.share_of_error > 0.95
    assert worst.share_of_time == pytest.approx(0.25, abs=0.02)
    assert sentence.endswith("most in the first 2.0 s of a run.")


def test_what_grows_through_each_run() -> None:
    (worst, *_), sentence = found(lambda time: 30.0 * (time / SECONDS) ** 3, 4)
    assert worst.where == "time since the run's start > 6.0 s"
    assert worst.share_of_error > 0.7
    assert sentence.endswith("most later than 6.0 s after a run's start.")


def test_what_is_the_same_throughout_is_at_no_time() -> None:
    regions, _ = found(lambda time: torch.full_like(time, 30.0), 4)
    assert not [region for region in regions if "time" in region.where]
