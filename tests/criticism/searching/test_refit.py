"""A refit begins again nearer to nothing where it realised next to nothing of much that screening promised."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching import stage
from onlinebayes.criticism.searching.search import ground
from onlinebayes.identification.fitting.fit import Fit, improve, still_promised, unfitted
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation, JointStiffness, QuadraticDrag
from tests.criticism.rigs import measure, model

SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-1.0, 1.0, "m"))
DRAG = QuadraticDrag("rail", Parameter(0.0, 5.0))
LIMIT = ActuatorSaturation("motor", Parameter(0.2, 11.0, "N"))


@pytest.mark.parametrize(
    ("effect", "start", "promised", "begun"),
    [
        (DRAG, {"drag": 0.5}, 0.9, [0.5, 0.25, 0.0]),
        (DRAG, {"drag": 0.5}, 0.2, [0.5]),
        (SPRING, {"stiffness": 3.0, "springref": 0.0}, 0.9, [3.0]),
    ],
    ids=["much was promised and nothing came", "little was promised", "it came"],
)
def test_where_a_refit_begins(monkeypatch: pytest.MonkeyPatch, effect, start, promised, begun) -> None:
    base = ground(model(), measure({SPRING: (4.0, 0.1)}), Selection())
    sizes, fitted = list[float](), stage._fitted

    def counted(current: Fit, windows, effect, start, hopeless) -> Fit:
        sizes.append(start[effect.magnitude])
        return fitted(current, windows, effect, start, hopeless)

    monkeypatch.setattr(stage, "_fitted", counted)
    stage.refit(base.fitted, base.windows, effect, start, promised=promised)
    assert sizes == begun


@pytest.mark.parametrize(("promised", "begun"), [(0.9, [9.0, *(s["limit"] for s in LIMIT.starts)]), (0.2, [9.0])])
def test_a_limit_that_stops_at_the_peaks_begins_again_further_in(monkeypatch, promised, begun) -> None:
    base = ground(model(), measure({LIMIT: (3.0,)}, runs=3), Selection())
    limited, sizes = base.fitted.simulator.with_effect(LIMIT), list[float]()
    stuck = unfitted(limited, base.windows, torch.cat([base.fitted.theta, torch.tensor([10.9]).double()]))

    def counted(current: Fit, windows, effect, start, hopeless) -> Fit:
        sizes.append(start["limit"])
        return stuck

    monkeypatch.setattr(stage, "_fitted", counted)
    stage.refit(base.fitted, base.windows, LIMIT, {"limit": 9.0}, promised=promised)
    assert sizes == begun


@pytest.mark.parametrize(
    ("left", "begun"), [(0.2, [3.0, 0.0, *(s["stiffness"] for s in SPRING.starts)]), (0.05, [3.0])]
)
def test_a_refit_that_is_stuck_on_its_way_begins_at_the_effects_other_values(monkeypatch, left, begun) -> None:
    base = ground(model(), measure({SPRING: (4.0, 0.1)}, runs=3), Selection())
    sizes, fitted = list[float](), stage._fitted

    def counted(current: Fit, windows, effect, start, hopeless) -> Fit:
        sizes.append(start["stiffness"])
        return fitted(current, windows, effect, start, hopeless)

    monkeypatch.setattr(stage, "_fitted", counted)
    monkeypatch.setattr(stage, "still_promised", lambda _: left)
    stage.refit(base.fitted, base.windows, SPRING, {"stiffness": 3.0, "springref": 0.0}, promised=0.9)
    assert sizes == begun


def test_what_a_further_step_promises_is_next_to_nothing_at_a_mode_and_much_before_it() -> None:
    base = ground(model(), measure({SPRING: (4.0, 0.1)}, runs=3), Selection())
    sprung = base.fitted.simulator.with_effect(SPRING)
    begun = unfitted(sprung, base.windows, torch.cat([base.fitted.theta, torch.tensor([3.0, 0.0]).double()]))
    assert still_promised(begun) > 0.9
    assert still_promised(improve(begun, base.windows)) < 0.01
