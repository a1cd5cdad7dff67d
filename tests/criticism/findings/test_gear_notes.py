"""Of a limit of force a reader is told that it stands before the gear, and what it is behind it."""

import pytest
import torch

from onlinebayes.criticism import compare
from onlinebayes.criticism.findings.gear_notes import gear_notes
from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.results import Estimate, FittedModel
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorSaturation
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, measure

SATURATION = ActuatorSaturation("motor", Parameter(0.1, 6.0, ""))
SAID = "actuator_saturation@motor.limit is the actuator's own force, before its gear of"


def geared(gear: str, parameters: ParameterSpace = FREE) -> MujocoSimulator:
    return MujocoSimulator(SLIDE.replace('joint="rail"/>', f'joint="rail" gear="{gear}"/>'), parameters, threads=1)


def fitted(simulator: MujocoSimulator, *values: float) -> FittedModel:
    theta, keys = torch.tensor(values, dtype=torch.float64), tuple(effect.key for effect in simulator.effects)
    return FittedModel(simulator, theta, torch.zeros(len(theta), len(theta)), {}, keys, ())


@pytest.mark.parametrize("gear", ["50", "-50"])
def test_a_limit_before_a_gear(gear: str) -> None:
    notes = gear_notes(fitted(geared(gear).with_effect(SATURATION), 2.5, 1.4, 0.4), ())
    assert list(notes) == [f"{SAID} {gear}: 0.4 there is 20 N behind it"]


@pytest.mark.parametrize("gear", ["1", "-1"])
def test_without_a_gear_nothing_is_said(gear: str) -> None:
    assert not list(gear_notes(fitted(geared(gear).with_effect(SATURATION), 2.5, 1.4, 0.4), ()))


def test_the_gear_is_the_fitted_one() -> None:
    free = FREE | ParameterSpace({"actuator.motor.gear[0]": Parameter(1.0, 100.0, "")})
    notes = gear_notes(fitted(geared("2", free).with_effect(SATURATION), 2.5, 1.4, 3.0, 0.4), ())
    assert list(notes) == [f"{SAID} 3: 0.4 there is 1.2 N behind it"]


def test_a_limit_that_was_only_ranked() -> None:
    limit = Estimate(0.4, 0.01, 0.38, 0.42, "")
    rows = [
        Candidate("actuator_saturation@motor", 1, 0.01, 1.0, 0.1, 9, parameters={"limit": limit}),
        Candidate("actuator_gain@motor", 2, 0.02, 1.0, 0.1, 9, parameters={"gain": limit}),
    ]
    assert list(gear_notes(fitted(geared("50"), 2.5, 1.4), rows)) == [f"{SAID} 50: 0.4 there is 20 N behind it"]


def test_a_report_says_it() -> None:
    """The slide's own commands through a gear of two, half as large a limit."""
    halved = measure({SATURATION: (4.0,)}, runs=6)
    halved.data["command"] /= 2
    result = compare(geared("2").with_effect(SATURATION), halved)
    (note,) = [note for note in result.notes if "gear" in note]
    assert note.startswith(f"{SAID} 2: 2 there is 4")
