"""One law that is the sum of several accepted ones takes their place, though no round has tried it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.confounded import merge_confounded
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import ground, search
from onlinebayes.criticism.searching.stage import Stage, run_stage
from onlinebayes.criticism.searching.working_model import WorkingModel, with_effects
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Interrupt, Watch
from onlinebayes.simulators.effects import ConstantLoad, QuadraticDrag
from tests.criticism.rigs import measure, model
from tests.criticism.winds import WindOfOneSize

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
DRAG = QuadraticDrag("rail", Parameter(0.0, 5.0))


WIND = WindOfOneSize("rail")


def both(measurement: Measurement) -> tuple[WorkingModel, Stage]:
    """The slide with a load and drag accepted one by one, and the round in which wind was screened against it."""
    asked = SearchContext(measurement, Selection())
    working = WorkingModel(model(), ground(model(), measurement, asked.selection))
    for effect in (LOAD, DRAG):
        now = working.grounds
        stage = run_stage(now.fitted, now.windows, [effect], now.numerics, asked.selection)
        working = with_effects(working, [(stage, stage.judged[0])], asked)
    now = working.grounds
    last = run_stage(now.fitted, now.windows, [WIND], now.numerics, asked.selection)
    assert set(last.screened[0].confounded_with) == {"constant_load@rail.load", "quadratic_drag@rail.drag"}
    assert not last.judged
    return working, last


def test_one_law_takes_the_place_of_all_it_is_confounded_with() -> None:
    measurement = measure({LOAD: (0.2,), DRAG: (1.6,)}, runs=6, seconds=2.0)
    working, last = both(measurement)
    stopped = Interrupt()
    stopped.requested = True
    assert merge_confounded(working, last, SearchContext(measurement, Selection(), watch=Watch(print, stopped))) is None
    said: list[str] = []
    leaner = merge_confounded(working, last, SearchContext(measurement, Selection(), watch=Watch(said.append)))
    assert leaner is not None
    assert [effect.key for effect in leaner.effects] == [WIND.key]
    assert f"looking whether {WIND.key} explains what several effects do" in said
    assert leaner.at_floor(1.2)
    assert float(leaner.grounds.fitted.theta[-1]) == pytest.approx(0.2, abs=0.02)
    stage, judged = leaner.accepted[0]
    assert judged.admissible
    assert stage.current.simulator.effects == ()  # what it gains is told against the model without the several


def test_what_is_confounded_but_leaves_more_changes_nothing() -> None:
    measurement = measure({LOAD: (0.2,), DRAG: (0.6,)}, runs=6, seconds=2.0)
    working, last = both(measurement)
    assert merge_confounded(working, last, SearchContext(measurement, Selection())) is None


@pytest.mark.slow
def test_the_search_asks_and_goes_on_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if wind had led no round: it is found in the end, and screened against it is what it took the place of."""
    plain: Callable[..., Stage] = run_stage

    def unled(*args: object) -> Stage:
        stage = plain(*args)
        if stage.current.simulator.effects == () or stage.screened[0].effect is WIND:
            rest = tuple(judged for judged in stage.judged if judged.effect is not WIND)
            return Stage(stage.current, stage.windows, stage.blocks, stage.scores, stage.screened, rest)
        return stage

    monkeypatch.setattr("onlinebayes.criticism.searching.search.run_stage", unled)
    measurement = measure({LOAD: (0.2,), DRAG: (1.6,)}, runs=6, seconds=2.0)
    found = search(model(), SearchContext(measurement, Selection(), (LOAD, DRAG, WIND)), 6)
    assert [judged.effect.key for _, judged in found.accepted] == [WIND.key]
    assert {effect.key for effect in found.stages[-1].current.simulator.effects} == {WIND.key}
    assert {screened.effect.key for screened in found.stages[-1].screened} == {LOAD.key, DRAG.key}
