"""A fault of the log that takes measured values away is compared over what is left of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from onlinebayes.criticism import log_faults, promising_faults
from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.wiring.faults import Rescaled
from onlinebayes.measurements import Measurement
from tests.criticism.rigs import measure, model


@dataclass(frozen=True)
class OffInOneRun(Rescaled):
    """The reversed sign of a sensor that was off in one run."""

    run: int = 2
    smoothed_anew = True

    def correct(self, measurement: Measurement) -> Measurement:
        right = super().correct(measurement)
        data = right.data.clone()
        data["measured"][self.run] = False
        return replace(right, data=data)


def test_a_fault_that_takes_a_runs_windows_away_is_judged_over_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    sign = Rescaled("signal", ("qpos.rail",), -1.0, "the reversed sign")
    off = OffInOneRun("signal", ("qpos.rail",), -1.0, "the reversed sign")
    monkeypatch.setattr(promising_faults, "possible_faults", lambda *_, **__: (sign, off))
    table = sign.correct(measure(runs=4, seconds=1.0))
    search = start_search(model(), table)
    found = log_faults.find_fault(search.evaluator, search.base, table)
    assert found is not None
    assert (found.fault, found.equals) == (sign, (off,))
    assert [one.folds for one in found.gains] == [4, 4]
