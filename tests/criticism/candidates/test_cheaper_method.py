"""Screening by a cheaper method sees what screening by Runge and Kutta's method sees, or is not used."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.candidates.cheaper_method import alike, by_cheaper_method
from onlinebayes.criticism.candidates.survey import Screened, screen
from onlinebayes.criticism.results import MOVES_NOTHING
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.blocks import flip_groups
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import QuadraticDrag
from tests.criticism.rigs import TRUTH, measure, model

DRAG = QuadraticDrag("rail", Parameter(0.0, 5.0, "N s2/m2"))


def slide_without_its_drag() -> tuple[Fit, Windows]:
    """The slide's mass and damping fitted to a log that holds a drag."""
    simulator = model()
    windows = make_windows(simulator, measure({DRAG: (0.8,)}), 1.0, 0.1)
    return fit(simulator, windows, torch.tensor(TRUTH, dtype=torch.float64)), windows


def screened(current: Fit, windows: Windows) -> dict[str, Screened]:
    """By the method of the fit."""
    effects = propose(current.simulator, windows)
    return {one.effect.key: one for one in screen(current, windows, effects, flip_groups(windows, 0.0))}


def cheaply_screened(current: Fit, windows: Windows) -> dict[str, Screened]:
    return screened(by_cheaper_method(current, windows, trials=100), windows)


def test_it_replays_at_a_quarter_of_the_evaluations_and_keeps_the_residual() -> None:
    current, windows = slide_without_its_drag()
    quick = by_cheaper_method(current, windows, trials=100)
    assert quick.simulator is not current.simulator
    assert quick.simulator.with_first_order() is quick.simulator
    assert torch.equal(quick.lin.residual, current.lin.residual)
    assert torch.equal(quick.theta, current.theta)
    assert alike(current.projected.columns, quick.projected.columns)


def test_candidates_come_out_as_by_the_model_s_own_method() -> None:
    current, windows = slide_without_its_drag()
    quick, exact = cheaply_screened(current, windows), screened(current, windows)
    assert next(iter(quick)) == next(iter(exact)) == DRAG.key
    for key, one in exact.items():
        assert quick[key].confounded_with == one.confounded_with, key
        # What promises less than a hundredth is noise by either method.
        if one.promise > 0.01:
            assert quick[key].z == pytest.approx(one.z, rel=0.05), key
            assert quick[key].promise == pytest.approx(one.promise, rel=0.1), key
            assert quick[key].exclusion_limit == pytest.approx(one.exclusion_limit, rel=0.1), key


def test_what_is_confounded_with_a_fitted_parameter_stays_so() -> None:
    current, windows = slide_without_its_drag()
    assert screened(by_cheaper_method(current, windows, trials=100), windows)[
        "viscous_friction@rail"
    ].confounded_with == ("joint.rail.damping",)


def test_what_moves_nothing_is_no_effect() -> None:
    """A slide stands wherever its encoder says: a bias of that moves the replay by rounding alone, whose z was 10."""
    current, windows = slide_without_its_drag()
    bias = cheaply_screened(current, windows)["sensor_bias@qpos.rail"]
    assert (bias.z, bias.confounded_with) == (None, (MOVES_NOTHING,))


def test_few_trials_are_replayed_by_the_model_s_own_method() -> None:
    current, windows = slide_without_its_drag()
    assert by_cheaper_method(current, windows, trials=3) is current


def test_a_model_of_first_order_is_what_it_was() -> None:
    current, windows = slide_without_its_drag()
    own = replace(current, simulator=current.simulator.with_first_order())
    assert by_cheaper_method(own, windows, trials=100) is own


def test_columns_that_come_out_otherwise_are_not_used() -> None:
    current, windows = slide_without_its_drag()
    off = replace(current, projected=replace(current.projected, columns=1.1 * current.projected.columns))
    assert not alike(off.projected.columns, current.projected.columns)
    assert by_cheaper_method(off, windows, trials=100) is off
