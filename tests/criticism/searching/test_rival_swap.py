"""What entered first gives way to a rival of its round once a later effect lets the data tell them apart."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.rival_swap import swap_in_better_rival
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import run_stage
from onlinebayes.criticism.searching.working_model import WorkingModel, with_effects
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import CubicStiffness, DryFriction, Effect, JointStiffness
from tests.criticism.rigs import measure, model

STIFFNESS = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-1.0, 1.0, "m"))
CUBIC = CubicStiffness("rail", Parameter(0.0, 100.0, "N/m3"), Parameter(-1.0, 1.0, "m"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
MEASURED = measure({STIFFNESS: (4.0, 0.1), FRICTION: (0.2,)})


def context() -> SearchContext:
    return SearchContext(MEASURED, Selection())


def grown(first: Effect) -> WorkingModel:
    """The slide with ``first`` accepted in the first round, and dry friction in the second."""
    asked = context()
    working = WorkingModel(model(), ground(model(), MEASURED, asked.selection))
    for accepted, tried in ((first, [STIFFNESS, CUBIC]), (FRICTION, [FRICTION])):
        grounds = working.grounds
        stage = run_stage(grounds.fitted, grounds.windows, tried, grounds.numerics, asked.selection)
        judged = next(one for one in stage.judged if one.effect.key == accepted.key)
        working = with_effects(working, [(stage, judged)], asked)
    return working


@pytest.mark.slow
def test_a_spring_takes_its_place_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the first round had not parted the two: a cubic spring stood in until the friction was found."""
    working = grown(CUBIC)
    assert swap_in_better_rival(working, context()) is None  # the first round did part them
    monkeypatch.setattr("onlinebayes.criticism.searching.rival_swap.parted", lambda *_: False)
    found = swap_in_better_rival(working, context())
    assert found is not None
    assert [effect.key for effect in found.effects] == [STIFFNESS.key, FRICTION.key]
    assert found.at_floor(1.2)
    assert not working.at_floor(1.2)
