"""What entered first gives way to a rival of its round once a later effect lets the data tell them apart."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import run_stage
from onlinebayes.criticism.searching.standing import Standing, with_effects
from onlinebayes.criticism.searching.swapped import swapped
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import CubicStiffness, DryFriction, Effect, JointStiffness
from tests.criticism.rigs import measure, model

STIFFNESS = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-1.0, 1.0, "m"))
CUBIC = CubicStiffness("rail", Parameter(0.0, 100.0, "N/m3"), Parameter(-1.0, 1.0, "m"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
MEASURED = measure({STIFFNESS: (4.0, 0.1), FRICTION: (0.2,)})


def context() -> SearchContext:
    return SearchContext(MEASURED, Selection())


def grown(first: Effect) -> Standing:
    """The slide with ``first`` accepted in the first round, and dry friction in the second."""
    asked = context()
    standing = Standing(model(), ground(model(), MEASURED, asked.selection))
    for accepted, tried in ((first, [STIFFNESS, CUBIC]), (FRICTION, [FRICTION])):
        grounds = standing.grounds
        stage = run_stage(grounds.fitted, grounds.windows, tried, grounds.numerics, asked.selection)
        judged = next(one for one in stage.judged if one.effect.key == accepted.key)
        standing = with_effects(standing, [(stage, judged)], asked)
    return standing


@pytest.mark.slow
def test_a_spring_takes_its_place_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the first round had not parted the two: a cubic spring stood in until the friction was found."""
    standing = grown(CUBIC)
    assert swapped(standing, context()) is None  # the first round did part them
    monkeypatch.setattr("onlinebayes.criticism.searching.swapped.parted", lambda *_: False)
    found = swapped(standing, context())
    assert found is not None
    assert [effect.key for effect in found.effects] == [STIFFNESS.key, FRICTION.key]
    assert found.at_floor(1.2)
    assert not standing.at_floor(1.2)
