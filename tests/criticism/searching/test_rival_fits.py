"""Which rivals are worth a refit in an accepted effect's place."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.searching.rival_fits import Incumbent, Rival, fit_with_rival
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.working_model import carry_theta
from onlinebayes.identification.fitting.fit import unfitted
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import Effect, JointStiffness, QuadraticDrag
from tests.criticism.rigs import measure, model

SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-1.0, 1.0, "m"))
DRAG = QuadraticDrag("rail", Parameter(0.0, 5.0))
START = {DRAG: {"drag": 0.5}, SPRING: {"stiffness": 3.0, "springref": 0.0}}


@pytest.fixture(scope="module")
def incumbent() -> Incumbent:
    """The slide with the spring that is in it."""
    return Incumbent.on(grounds([SPRING]), None)


def grounds(effects: Sequence[Effect]) -> Grounds:
    return ground(grown(model(), list(effects)), measure({SPRING: (4.0, 0.1)}), Selection())


def rival(effect: Effect) -> Rival:
    return Rival(effect, {f"{effect.key}.{name}": value for name, value in START[effect].items()})


def test_a_drag_is_no_rival_of_a_spring(incumbent: Incumbent, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first step leaves a hundred times the error and the blocks part the two: nothing is fitted."""

    def fitted(*_: object) -> None:
        raise AssertionError("it was fitted")

    monkeypatch.setattr("onlinebayes.criticism.searching.rival_fits.improve", fitted)
    assert fit_with_rival(rival(DRAG), model(), [DRAG], incumbent, float("inf")) is None


def test_what_the_blocks_do_not_part_is_fitted(incumbent: Incumbent, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onlinebayes.criticism.searching.rival_fits.parted", lambda *_: False)
    found = fit_with_rival(rival(DRAG), model(), [DRAG], incumbent, float("inf"))
    assert found is not None
    assert found.projected.objective > incumbent.grounds.fitted.projected.objective


def test_a_start_beside_the_truth_is_in_reach(incumbent: Incumbent) -> None:
    simulator, fitted = grown(model(), [SPRING]), incumbent.grounds.fitted
    stepped = incumbent.grounds.rung.of(simulator)
    theta = carry_theta(fitted.simulator, fitted.theta, stepped)
    for address, value in rival(SPRING).start.items():
        theta[stepped.parameters.index(address)] = value
    begun = unfitted(stepped, incumbent.grounds.windows, theta)
    assert begun.projected.objective > 4 * fitted.projected.objective
    assert not incumbent.is_out_of_reach(begun)
