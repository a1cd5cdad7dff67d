"""A parameter that changes in time, found without being asked for; what is a law is not taken for one."""

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.changes_in_time import candidates_in_time, changed_in_time
from onlinebayes.criticism.search import ground
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import DryFriction
from tests.criticism.rigs import measure, model
from tests.criticism.test_timed import DAMPING, measured, table

FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))


def found(data) -> list:
    base = ground(model(), data, Selection())
    effects = candidates_in_time(base)
    assert {effect.key for effect in effects} == {
        f"parameter_{kind}@{name}" for kind in ("drift", "step") for name in ("body.cart.mass", DAMPING)
    }
    return changed_in_time(base, effects, Selection(), lambda line: None)


def test_a_drift_is_found() -> None:
    ((_, judged),) = found(measured(table(lambda t: 1.0 + 0.03 * t)))
    assert judged.effect.key == f"parameter_drift@{DAMPING}"
    assert float(judged.fitted.theta[-1]) == pytest.approx(0.03, rel=0.02)


def test_friction_is_no_change_in_time() -> None:
    assert found(measure({FRICTION: (1.0,)}, runs=9)) == []
