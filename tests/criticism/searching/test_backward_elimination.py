"""What entered first goes again where the law that came later explains all; both of two that are there stay."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.judging.acceptance import judge
from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.searching.backward_elimination import eliminate
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import Stage, blocks_for, refit
from onlinebayes.criticism.searching.working_model import WorkingModel, with_effects
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import DryFriction, Effect, QuadraticDrag
from tests.criticism.cases import refined
from tests.criticism.wired import PENDULUM

DRY = DryFriction("hinge", Parameter(0.0, 2.0, "N m"))
DRAG = QuadraticDrag("hinge", Parameter(0.0, 1.0))
SIZES = {DRY: 0.1, DRAG: 0.1}


def added(working: WorkingModel, effect: Effect, measurement: Measurement) -> WorkingModel:
    """The model with the effect, whatever speaks for it."""
    now, windows = working.grounds, working.grounds.windows
    blocks = blocks_for(now.fitted, windows, None)
    scores = cross_validate(now.fitted, windows, blocks)
    fitted, _ = refit(now.fitted, windows, effect, {effect.magnitude: 0.05})
    judged = judge(effect, 0.0, fitted, scores, windows, blocks, now.numerics, 0.03)
    stage = Stage(now.fitted, windows, blocks, scores, (), (judged,))
    return with_effects(working, [(stage, judged)], SearchContext(measurement, Selection()))


@pytest.mark.parametrize("hidden", [(DRAG,), pytest.param((DRY, DRAG), marks=pytest.mark.slow)], ids=["one", "both"])
def test_what_is_there_stays_and_nothing_else(hidden) -> None:
    measurement = PENDULUM.measure({effect: (SIZES[effect],) for effect in hidden}, runs=6)
    working = WorkingModel(PENDULUM.model(), ground(PENDULUM.model(), measurement, Selection()))
    for effect in (DRY, DRAG):
        working = added(working, effect, measurement)
    assert working.effects == [DRY, DRAG]
    leaner = eliminate(working, SearchContext(measurement, Selection()))
    assert leaner.effects == list(hidden)
    assert leaner.at_floor(1.2)


@pytest.mark.long
def test_friction_that_stood_in_for_a_tilt_and_a_drag_goes_again(tmp_path) -> None:
    """Dry friction enters first, is surely not nothing beside the right two, and the model predicts as well without."""
    result, _ = refined("thrown_ball", "effect", 2023, tmp_path)
    assert set(result.accepted) == {"constant_load@x", "viscous_friction@x"}
    assert result.verdict == "missing_effect"


@pytest.mark.long
def test_cogging_of_less_than_two_periods_over_the_travel_is_found_alone(tmp_path) -> None:
    """Armature and a scale of the encoder enter first, as a pair."""
    result, _ = refined("swing", "effect", 2013, tmp_path)
    assert result.accepted == ("cogging@hinge",)
    assert result.parameters["cogging@hinge.poles"].mean == pytest.approx(7.0, abs=0.1)
