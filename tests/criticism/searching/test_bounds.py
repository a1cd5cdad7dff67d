"""A truth outside its bounds is said to be there, and nothing else is called a matter of bounds."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from onlinebayes.criticism import refine
from onlinebayes.criticism.report import words
from onlinebayes.criticism.report.refined import refined_toml
from onlinebayes.criticism.searching.bounds import pressed
from onlinebayes.criticism.searching.search import ground
from onlinebayes.identification.results import Selection
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import DryFriction
from tests.criticism.rigs import FREE, TRUTH, measure, model

MASS, DAMPING = FREE
TIGHT = ParameterSpace({MASS: Parameter(0.5, 2.0, "kg"), DAMPING: FREE[DAMPING]})
HELD = ["run9", "run8"]
FEW = ["dry_friction", "quadratic_drag", "constant_load", "actuator_gain", "actuator_delay"]


@pytest.fixture(scope="module")
def light():
    """A mass of 2.5 kg that the problem file bounds at 2 kg."""
    return refine(model(TIGHT), measure(runs=10), holdout=HELD, candidates=FEW)


def test_the_bound_is_named_with_the_value_that_the_data_ask_for(light) -> None:
    assert light.verdict == "bounds_exclude_truth"
    assert light.accepted == ()
    assert light.widened[MASS].before == (0.5, 2.0)
    assert light.widened[MASS].after == (0.5, 5.0)  # twice what the data ask for, where 17 kg was tried
    mass = light.parameters[MASS]
    assert abs(mass.mean - TRUTH[0]) < 5 * mass.sd < 0.05
    assert light.heldout_error.after["qpos.rail"] < 0.5 * light.heldout_error.before["qpos.rail"]
    assert light.remainder.status == "noise"
    (sentence,) = words.bounds(light)
    assert f'"{MASS}" = [0.5, 5]' in sentence
    assert sentence.endswith("The held-out error after is that of the model with this bound widened.")
    assert MASS in words.headline(light)


def test_the_refined_problem_holds_the_wider_bounds(light) -> None:
    content = {"model": "m.xml", "measurements": ["l.csv"], "parameters": {MASS: {"low": 0.5, "high": 2.0}}}
    written = tomllib.loads(refined_toml(content, Path("a"), Path("b"), light))
    assert written["parameters"][MASS] == {"low": 0.5, "high": 5.0}


@pytest.mark.long
def test_an_effect_that_drives_a_parameter_to_its_bound_is_still_an_effect() -> None:
    friction = DryFriction("rail", Parameter(0.0, 5.0, "N"))
    narrow = ParameterSpace({MASS: Parameter(2.4, 2.6, "kg"), DAMPING: Parameter(0.0, 1.5, "N s/m")})
    found = refine(model(narrow), measure({friction: (1.0,)}, runs=10), holdout=HELD, candidates=FEW)
    assert found.verdict == "missing_effect"
    assert found.accepted == ("dry_friction@rail",)
    assert found.widened == {}


@pytest.mark.parametrize(
    ("bounds", "wider"),
    [
        (Parameter(0.5, 2.0, "kg"), Parameter(0.5, 17.0, "kg")),  # the truth is above
        (Parameter(3.0, 8.0, "kg"), Parameter(0.3, 8.0, "kg")),  # below
        (Parameter(3.0, 8.0, "kg", "log"), Parameter(0.3, 8.0, "kg", "log")),
        (Parameter(0.5, 8.0, "kg"), None),  # inside
    ],
)
def test_which_bounds_are_pressed(bounds: Parameter, wider: Parameter | None) -> None:
    space = ParameterSpace({MASS: bounds, DAMPING: FREE[DAMPING]})
    base = ground(model(space), measure(runs=8), Selection())
    assert list(pressed(base.fitted)) == ([] if wider is None else [(MASS, wider)])


def test_friction_never_becomes_negative_and_gravity_stays() -> None:
    space = ParameterSpace({"option.gravity[0]": Parameter(0.5, 1.0, "m/s2"), DAMPING: Parameter(0.0, 10.0, "N s/m")})
    base = ground(model(space), measure(runs=8, truth=(2.5, 0.0), parameters=FREE), Selection())
    assert base.fitted.theta.tolist() == [0.5, 0.0]
    assert list(pressed(base.fitted)) == []


def test_an_unknown_parameter_has_no_bounds() -> None:
    with pytest.raises(BadInput, match="unknown"):
        model().with_bounds("joint.rail.dampin", Parameter(0.0, 1.0))
