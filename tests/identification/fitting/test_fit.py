"""Fits where undamped steps are refused, and fits that are given up."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import DryFriction, JointStiffness
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import TRUTH, measure, model

FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-3.0, 3.0, "m"))
HIDDEN = (0.8, 3.0, 0.4)


def rig() -> MujocoSimulator:
    return model().with_effect(FRICTION).with_effect(SPRING)


@pytest.fixture(scope="module")
def windows() -> Windows:
    return make_windows(rig(), measure({FRICTION: HIDDEN[:1], SPRING: HIDDEN[1:]}, runs=2), 1.0)


@pytest.mark.slow
def test_a_spring_beside_friction_is_recovered_from_afar(windows: Windows) -> None:
    found = fit(rig(), windows, torch.tensor([*TRUTH, 0.1, 0.5, -1.0]).double())
    assert found.converged
    torch.testing.assert_close(found.theta, torch.tensor([*TRUTH, *HIDDEN]).double(), rtol=0.01, atol=0.0)


@pytest.mark.slow
def test_a_fit_that_creeps_above_what_is_wanted_is_given_up(windows: Windows) -> None:
    # Without friction the spring's model cannot reach the noise.
    simulator = model().with_effect(SPRING)
    begin = torch.tensor([*TRUTH, 0.5, -1.0]).double()
    patient, hasty = fit(simulator, windows, begin), fit(simulator, windows, begin, hopeless=0.0)
    assert patient.converged
    assert not hasty.converged
    assert hasty.projected.objective >= patient.projected.objective
