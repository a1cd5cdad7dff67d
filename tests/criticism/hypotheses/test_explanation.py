"""The whole search on small sets whose truth is known: it names what is hidden, and nothing where nothing is."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ConstantLoad, DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, NOISE, SLIDE, TRUTH, explain, held_out_error, measure, model

FEW = ("dry_friction", "quadratic_drag", "joint_stiffness", "constant_load", "actuator_delay")
HELD = ("run9", "run8")
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_nothing_is_added_to_a_right_model(seed: int) -> None:
    table = measure(runs=10, seed=seed)
    found = explain(model(), table, holdout=HELD)
    assert found.found.hypothesis.keys == ()
    assert held_out_error(found, found.found, table, HELD) < 1.2 * NOISE


def test_a_hidden_load_is_named_sized_and_brings_the_held_out_error_to_the_noise() -> None:
    table = measure({LOAD: (0.5,)}, runs=10)
    found = explain(model(), table, holdout=HELD, candidates=FEW)
    assert found.found.hypothesis.keys == ("constant_load@rail",)
    assert found.found.values["constant_load@rail.load"] == pytest.approx(0.5, abs=0.02)
    assert [found.found.values[name] for name in model().parameters] == pytest.approx(TRUTH, rel=0.02)
    before, after = (held_out_error(found, one, table, HELD) for one in (found.base, found.found))
    assert after < 1.2 * NOISE < before


@pytest.mark.slow
def test_two_hidden_effects_are_both_named() -> None:
    found = explain(model(), measure({LOAD: (0.5,), FRICTION: (0.3,)}, runs=10), holdout=HELD, candidates=FEW)
    assert set(found.found.hypothesis.keys) == {"constant_load@rail", "dry_friction@rail"}


@pytest.mark.slow
def test_a_wrong_number_of_the_model_is_preferred_to_an_effect() -> None:
    damping = ParameterSpace({"joint.rail.damping": Parameter(0.0, 10.0, "N s/m")})
    table = measure(runs=10, truth=(2.4, 1.4))
    found = explain(model(damping), table, holdout=HELD)
    (round_, _), (key,) = found.rounds, found.found.hypothesis.keys
    numbers = {"body.cart.mass", "actuator.motor.gear[0]"}  # with the damping free, only their quotient is seen
    assert key in numbers
    assert numbers - {key} | {"actuator_gain@motor"} <= {other.key for other in round_.equals}
    before, after = (held_out_error(found, one, table, HELD) for one in (found.base, found.found))
    assert after < 1.2 * NOISE < before


@pytest.mark.slow
def test_a_freed_number_is_written_into_the_mended_model() -> None:
    everything = ParameterSpace(
        {"joint.rail.damping": Parameter(1.39, 1.41), "actuator.motor.gear[0]": Parameter(0.999, 1.001)}
    )
    found = explain(model(everything), measure(runs=10, truth=(2.4, 1.4)), holdout=HELD).found
    assert found.hypothesis.keys == ("body.cart.mass",)
    mended = found.fitted.simulator
    assert isinstance(mended, MujocoSimulator)
    assert mended.export(found.fitted.theta).body("cart").mass == pytest.approx(2.4, abs=0.02)


@pytest.mark.slow
def test_what_the_model_has_and_the_machine_lacks_is_taken_away() -> None:
    mass = ParameterSpace({"body.cart.mass": Parameter(0.5, 8.0, "kg")})
    found = explain(model(mass), measure(runs=10, truth=(2.5, 0.0)), holdout=HELD)
    assert found.found.hypothesis.keys == ("joint.rail.damping",)
    assert found.found.values["joint.rail.damping"] == pytest.approx(0.0, abs=0.01)


@pytest.mark.slow
def test_an_encoder_that_finds_another_zero_in_each_run_is_told_from_one_zero() -> None:
    sprung = MujocoSimulator(SLIDE.replace('damping="1"', 'damping="1" stiffness="40"'), FREE, threads=1)
    for zeros, key in ((0.01 * torch.linspace(-1, 1, 10), "{} in each run"), (torch.full((10,), 0.01), "{}")):
        measured = measure(runs=10, simulator=sprung)
        measured.data["signal"] += zeros.double()[:, None, None]
        found = explain(sprung, measured, holdout=HELD)
        # One zero in all runs is a constant load on the spring: a tie, in which either may be named first.
        names = {*found.found.hypothesis.keys, *(other.key for other in found.rounds[0].equals)}
        assert len(found.found.hypothesis.keys) == 1
        assert key.format("sensor_bias@qpos.rail") in names
        if key == "{}":
            assert "constant_load@rail" in names
        else:
            assert "constant_load@rail" not in found.found.hypothesis.keys


def test_runs_are_folds_and_the_windows_begin_where_noise_says() -> None:
    found = explain(model(), measure(runs=10), holdout=HELD, candidates=["dry_friction"])
    assert len(found.base.left_out[0].folds) == 8
    assert found.windows.runs == tuple(f"run{k}" for k in range(8))
    assert torch.isfinite(found.windows.start).all()


def test_an_unknown_candidate_is_refused_in_one_line() -> None:
    with pytest.raises(BadInput, match="effect 'magic' is unknown"):
        explain(model(), measure(runs=4, seconds=1.0), holdout=["run3"], candidates=["magic"])
