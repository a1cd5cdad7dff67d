"""What is tried last is found without being asked for; what is another law is not taken for it."""

import math
from dataclasses import replace

import pytest

from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.searching import flexible_candidates
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.flexible_candidates import (
    MOST_LEADS,
    FlexibleFind,
    best_of_groups,
    find_beside,
    flexible_groups,
    try_groups,
)
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import refit, run_stage
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Watch
from onlinebayes.simulators.effects import ActuatorDeadZone, ActuatorDelay, Cogging, DryFriction
from tests.criticism.rigs import measure, model
from tests.identification.replaying.test_timed import DAMPING, measured, table

FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
COGGING = Cogging("rail", Parameter(0.0, 5.0, "N"), Parameter(1.0, 100.0, "rad/m"), Parameter(-3.2, 6.3, "rad"))


def found(data) -> FlexibleFind | None:
    base = ground(model(), data, Selection())
    groups = flexible_groups(base)
    assert [what for what, _ in groups] == [
        *("for cogging", "for wind"),
        *(f"for changes of {name} in time" for name in ("body.cart.mass", DAMPING)),
    ]
    return best_of_groups(base, try_groups(base, groups, SearchContext(data, Selection())), Selection())


def test_a_drift_is_found() -> None:
    one = found(measured(table(lambda t: 1.0 + 0.03 * t)))
    assert one.believed
    assert one.judged.effect.key == f"parameter_drift@{DAMPING}"
    assert float(one.judged.fitted.theta[-1]) == pytest.approx(0.03, rel=0.02)


@pytest.mark.slow
def test_friction_is_none_of_them() -> None:
    assert found(measure({FRICTION: (1.0,)}, runs=9)) is None


def test_beside_which_candidates_the_last_ones_are_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that fail fewest rules first, then those that gain most; what may be chance is none."""
    data = measure({FRICTION: (1.0,)}, runs=9)
    base = ground(model(), data, Selection())
    stage = run_stage(base.fitted, base.windows, (FRICTION,), base.numerics, Selection())
    (judged,) = stage.judged
    rank = {"most": (2, 90.0), "nearest": (1, 40.0), "next": (1, 30.0), "last": (3, 80.0), "chance": (0, 99.0)}
    leads = [
        replace(
            judged,
            effect=DryFriction(name, FRICTION.frictionloss),
            failed=("rule",) * failed,
            gain=replace(judged.gain, gain=gain),
            p_value=0.5 if name == "chance" else 0.001,
        )
        for name, (failed, gain) in rank.items()
    ]
    lines, tried = list[str](), list[object]()
    monkeypatch.setattr(flexible_candidates, "try_groups", lambda current, *_: tried.append(current) or [])
    context = SearchContext(data, Selection(), watch=Watch(say=lines.append))
    groups = flexible_groups(base)
    assert find_beside([replace(stage, judged=tuple(leads))], base, groups, context) is None
    assert lines == [f"looking beside dry_friction@{name}" for name in ("nearest", "next", "most")]
    assert len(tried) == MOST_LEADS


@pytest.mark.slow
def test_a_wrong_period_is_left_for_a_better_start() -> None:
    data = measure({COGGING: (1.0, 25.0, 0.7)}, runs=3, finer=16)
    base = ground(model(), data, Selection()).fitted
    windows = make_windows(model(), data, 1.0)
    wrong, near = ({"amplitude": 0.5, "poles": poles, "phase": 0.5} for poles in (45.0, 26.0))
    stuck, _ = refit(base, windows, COGGING, wrong)
    found, _ = refit(base, windows, COGGING, wrong, others=(near,))
    kept, _ = refit(base, windows, COGGING, near, others=(wrong,))
    assert float(stuck.theta[-2]) != pytest.approx(25.0, rel=0.1)
    assert float(found.theta[-2]) == pytest.approx(25.0, rel=0.01)
    assert float(kept.theta[-2]) == pytest.approx(25.0, rel=0.01)


@pytest.mark.long
def test_cogging_is_found_among_all() -> None:
    result = refine(model(), measure({COGGING: (1.0, 25.0, 0.7)}, runs=9, finer=16))
    assert (result.verdict, result.accepted) == ("missing_effect", ("cogging@rail",))
    assert len(result.candidates) >= result.candidates_tried  # those that were tried last are listed, too
    assert result.parameters["cogging@rail.amplitude"].mean == pytest.approx(1.0, rel=0.02)
    assert result.parameters["cogging@rail.poles"].mean == pytest.approx(25.0, rel=0.01)


@pytest.mark.long
def test_cogging_behind_a_late_motor_is_found() -> None:
    delay = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))
    result = refine(model(), measure({COGGING: (1.0, 60.0, 0.7), delay: (0.012,)}, runs=9, finer=16))
    assert set(result.accepted) == {"actuator_delay@motor", "cogging@rail"}
    assert result.parameters["cogging@rail.poles"].mean == pytest.approx(60.0, rel=0.01)


@pytest.mark.long
def test_cogging_behind_a_dead_zone_is_found() -> None:
    dead = ActuatorDeadZone("motor", Parameter(0.0, 5.0, "N"))
    result = refine(model(), measure({COGGING: (1.0, 60.0, 0.7), dead: (0.6,)}, runs=9, finer=16))
    assert set(result.accepted) == {"actuator_dead_zone@motor", "cogging@rail"}
    assert result.parameters["cogging@rail.poles"].mean == pytest.approx(60.0, rel=0.01)
    assert result.parameters["actuator_dead_zone@motor.width"].mean == pytest.approx(0.6, rel=0.05)


@pytest.mark.long
def test_a_step_and_cogging_are_found() -> None:
    """Both are tried last, and neither is admissible alone."""
    data = measured(table(lambda t: 1.4 if t < 16.0 else 2.8, pull=lambda q: math.sin(60.0 * q + 0.7)))
    result = refine(model(), data)
    assert set(result.accepted) == {f"parameter_step@{DAMPING}", "cogging@rail"}
    assert result.verdict == "missing_effect"
    assert result.parameters["cogging@rail.poles"].mean == pytest.approx(60.0, rel=0.01)
    assert result.parameters[f"parameter_step@{DAMPING}.size"].mean == pytest.approx(1.4, rel=0.05)


@pytest.mark.long
def test_cogging_beside_friction_is_found() -> None:
    result = refine(model(), measure({COGGING: (1.0, 25.0, 0.7), FRICTION: (0.5,)}, runs=9, finer=16))
    assert result.verdict == "missing_effect"
    assert set(result.accepted) == {"cogging@rail", "dry_friction@rail"}
    assert result.parameters["cogging@rail.amplitude"].mean == pytest.approx(1.0, rel=0.02)
    assert result.parameters["cogging@rail.poles"].mean == pytest.approx(25.0, rel=0.01)
