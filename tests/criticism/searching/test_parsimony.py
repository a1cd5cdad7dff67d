"""One law that does what two accepted ones do takes their place; one that does less does not."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.judging.acceptance import Judged, judge
from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.parsimony import simplify
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import Stage, blocks_for, refit
from onlinebayes.criticism.searching.working_model import WorkingModel, with_effects
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Interrupt, Watch
from onlinebayes.simulators.effects import ConstantLoad, Effect, JointStiffness, QuadraticDrag
from tests.criticism.cases import refined
from tests.criticism.rigs import measure, model
from tests.criticism.winds import HeadWind

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
DRAG = QuadraticDrag("rail", Parameter(0.0, 5.0))
SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-1.0, 1.0, "m"))


def judged(working: WorkingModel, effect: Effect) -> Judged:
    now, windows = working.grounds, working.grounds.windows
    blocks = blocks_for(now.fitted, windows, None)
    begin = dict.fromkeys(effect.parameters, 0.3)
    fitted, _ = refit(now.fitted, windows, effect, begin)
    return judge(effect, 0.0, fitted, cross_validate(now.fitted, windows, blocks), windows, blocks, now.numerics, 0.03)


def added(working: WorkingModel, effect: Effect, rival: Effect, measurement: Measurement) -> WorkingModel:
    """The model with the effect, whatever speaks for it, of a round in which a rival was looked at too."""
    now, windows = working.grounds, working.grounds.windows
    blocks = blocks_for(now.fitted, windows, None)
    scores = cross_validate(now.fitted, windows, blocks)
    one = judged(working, effect)
    stage = Stage(now.fitted, windows, blocks, scores, (), (one, judged(working, rival)))
    return with_effects(working, [(stage, one)], SearchContext(measurement, Selection()))


@pytest.mark.parametrize(
    ("rival", "left"), [(HeadWind("rail"), ["head_wind@rail"]), (SPRING, [LOAD.key, DRAG.key])], ids=["both", "less"]
)
def test_one_law_that_is_two_takes_their_place(rival: Effect, left: list[str]) -> None:
    measurement = measure({LOAD: (0.5,), DRAG: (0.5,)}, runs=6, seconds=2.0)
    working = WorkingModel(model(), ground(model(), measurement, Selection()))
    for effect in (LOAD, DRAG):
        working = added(working, effect, rival, measurement)
    assert [effect.key for effect in working.effects] == [LOAD.key, DRAG.key]
    stopped = Interrupt()
    stopped.requested = True
    assert simplify(working, SearchContext(measurement, Selection(), watch=Watch(print, stopped))) is working
    said: list[str] = []
    leaner = simplify(working, SearchContext(measurement, Selection(), watch=Watch(said.append)))
    assert [effect.key for effect in leaner.effects] == left
    assert leaner.at_floor(1.2)
    if rival.key in left:
        assert f"looking whether {rival.key} explains more than one of the effects" in said
        sizes = dict(zip(leaner.grounds.fitted.simulator.parameters, leaner.grounds.fitted.theta.tolist(), strict=True))
        assert sizes["head_wind@rail.drag"] == pytest.approx(0.5, abs=0.1)
        assert sizes["head_wind@rail.load"] == pytest.approx(0.5, abs=0.1)


@pytest.mark.long
def test_a_spring_is_not_a_load_and_a_lower_centre_of_mass(tmp_path) -> None:
    """Each of the two was chosen for its one parameter beside a spring's two."""
    result, _ = refined("swing", "effect", 2066, tmp_path)
    assert set(result.accepted) == {"actuator_delay@motor", "joint_stiffness@hinge"}
