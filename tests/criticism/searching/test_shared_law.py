"""One law at several places, none of which may be added alone: a quadrotor whose rotors all lag.

Pairs of effects find the same, a pair a round and with more fits; that they do is looked at, too.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching import search as searching
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import search
from onlinebayes.criticism.searching.shared_law import find_shared_law
from onlinebayes.identification.fitting.projection import signal_rms
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.runs import Interrupt, Watch
from tests.criticism.hovering import measure, model

LAG = 0.04
LAGS = {f"actuator_lag@rotor{k}" for k in range(4)}
LAWS = ["actuator_lag", "actuator_gain"]


@pytest.mark.long
def test_four_rotors_that_lag_are_found_together() -> None:
    simulator, flights = charted(model(), measure(LAG))
    found = search(simulator, SearchContext(flights, Selection(), LAWS), 6)
    stage, final = found.stages[0], found.final.fitted
    assert not any(judged.admissible for judged in stage.judged)
    assert {judged.effect.key for _, judged in found.accepted} == LAGS
    for key in LAGS:
        column = final.simulator.parameters.index(f"{key}.time_constant")
        assert float(final.theta[column]) == pytest.approx(LAG, rel=0.05)
    stopped = Interrupt()
    stopped.requested = True
    context = SearchContext(flights, Selection(), LAWS)
    assert (
        find_shared_law(stage, found.effects, found.base.numerics, replace(context, watch=Watch(interrupt=stopped)))
        == []
    )
    alone = replace(stage, screened=stage.screened[:1])
    assert find_shared_law(alone, found.effects, found.base.numerics, context) == []


@pytest.mark.long
def test_pairs_of_lags_come_to_the_same_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "find_shared_law", lambda *_: [])
    simulator, flights = charted(model(), measure(LAG))
    found = searching.search(simulator, SearchContext(flights, Selection(), LAWS), 6)
    assert {judged.effect.key for _, judged in found.accepted} == LAGS
    assert float(signal_rms(found.final.fitted.projected).max()) < 1.2


@pytest.mark.slow
def test_rotors_that_follow_at_once_have_no_lag() -> None:
    simulator, flights = charted(model(), measure(0.0))
    found = search(simulator, SearchContext(flights, Selection(), LAWS), 6)
    assert found.accepted == ()
