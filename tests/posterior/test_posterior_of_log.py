"""Posteriors from logs whose truth is known: coverage, what cannot be told apart, the alarm."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torchrl.envs import TransformedEnv

from envs.pendulum import PendulumTask
from onlinebayes.inference import BoxUniform, saving
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.posterior import LogPosterior, lines, posterior_of_log, side_by_side, write_posterior
from onlinebayes.report.posterior_page import headline
from onlinebayes.runs import BadInput, Interrupt, Stopped
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.transforms import ParameterRandomization
from tests.identification.fitting.test_unmeasured_moments import BOUNDS, DAMPING, GEAR, HANGING, LINK, MASS, recorded
from tests.posterior.pendulum import FREE, POINT_MASS, log, model

TRUTH = torch.tensor([1.1, 0.12], dtype=torch.float64)


@pytest.fixture(scope="module")
def found() -> LogPosterior:
    return posterior_of_log(model(), log(TRUTH, 1))


def test_it_is_near_the_truth_and_far_narrower_than_the_prior(found: LogPosterior) -> None:
    for (name, value), truth in zip(found.parameters.items(), TRUTH.tolist(), strict=True):
        assert abs(value.mean - truth) < 4 * value.sd, name
        assert value.q05 < value.q50 < value.q95
        assert value.of_prior < 0.1
        assert value.mean == pytest.approx(value.fitted, abs=value.sd)
    assert found.identifiability.unknown == ()
    assert not found.method.linear


def test_the_right_model_raises_no_alarm_and_its_worlds_miss_the_log_by_the_noise(found: LogPosterior) -> None:
    assert found.surprise > 0.05
    signal = found.reproduction["qpos.hinge"]
    assert signal.rms == pytest.approx(signal.noise, rel=0.15)


def test_its_distribution_has_its_moments(found: LogPosterior) -> None:
    draws = found.belief.sample((20_000,), torch.Generator().manual_seed(0))
    for k, value in enumerate(found.parameters.values()):
        assert float(draws[:, k].mean()) == pytest.approx(value.mean, abs=0.1 * value.sd)
        assert float(draws[:, k].std()) == pytest.approx(value.sd, rel=0.1)


def test_a_seed_decides_it(found: LogPosterior) -> None:
    again = posterior_of_log(model(), log(TRUTH, 1))
    assert again.parameters == found.parameters


def test_a_recipe_loads_it_as_its_prior(found: LogPosterior, tmp_path) -> None:
    write_posterior([found], tmp_path)
    simulator = model().with_worlds(64)
    prior = saving.load(tmp_path / "belief.json", simulator.parameters)
    env = TransformedEnv(SimulatorEnv(simulator, PendulumTask()), ParameterRandomization(prior))
    env.set_seed(0)
    theta = env.reset()["theta"]
    assert theta.shape == (64, 2)
    value = found.parameters["body.bob.mass"]
    assert float(theta[:, 0].double().mean()) == pytest.approx(value.mean, abs=value.sd)


def test_a_measurement_unlike_the_model_rings() -> None:
    """The log is of a pendulum with a spring at its hinge that the model lacks."""
    wide = ParameterSpace({**FREE, "joint.hinge.stiffness": Parameter(0.0, 5.0, "N m/rad")})
    truth = torch.tensor([1.1, 0.12, 3.0], dtype=torch.float64)
    found = posterior_of_log(model(), log(truth, 1, free=wide, noise=0.001))
    assert found.surprise < 0.01
    assert any("unlike anything that the model can do" in text for _, text in lines(found))
    assert dict(lines(found))["known"].endswith("in a model that cannot have made this log (see the alarm)")
    assert "need not be the machine's" in headline([found])
    chance = [text for label, text in lines(replace(found, surprise=0.04)) if label == "alarm"]
    assert ["is unusual for the model (p 0.04" in text and "one log in 25" in text for text in chance] == [True]


def test_only_ratios_are_known_where_mass_motor_and_friction_grow_together() -> None:
    """A pendulum's motion tells gear / mass and damping / mass, and no more of a point mass."""
    free = ParameterSpace({
        "body.bob.mass": Parameter(0.5, 2.0, "kg"),
        "joint.hinge.damping": Parameter(0.02, 0.5, "N m s/rad"),
        "actuator.motor.gear[0]": Parameter(0.4, 2.5, ""),
    })  # fmt: skip
    truth = torch.tensor([1.0, 0.15, 1.0], dtype=torch.float64)
    found = posterior_of_log(model(free, POINT_MASS), log(truth, 2, free=free, xml=POINT_MASS))
    told = dict(lines(found))["known"]
    assert told.startswith("Only ")
    ratios = found.identifiability.combinations
    assert len(ratios) == 2
    assert {name for ratio in ratios for name in ratio.exponents} == set(free.names)
    assert all(sum(ratio.exponents.values()) == 0 and ratio.width < 0.1 for ratio in ratios), told
    assert found.parameters["body.bob.mass"].of_prior > 0.5
    ratio = found.belief.sample((4000,), torch.Generator().manual_seed(0))
    ratio = ratio[:, 2] / ratio[:, 0]
    assert abs(float(ratio.mean()) - 1.0) < 0.05
    assert float(ratio.std()) < 0.05


def test_what_moves_nothing_keeps_its_prior() -> None:
    """Gravity along the hinge's axis."""
    free = ParameterSpace({**FREE, "option.gravity[1]": Parameter(-5.0, 5.0, "m/s2")})
    truth = torch.tensor([1.1, 0.12, 0.0], dtype=torch.float64)
    found = posterior_of_log(model(free), log(truth, 1, free=free))
    assert found.identifiability.unknown == ("option.gravity[1]",)
    assert found.parameters["option.gravity[1]"].of_prior == pytest.approx(1.0, abs=0.15)
    assert found.parameters["body.bob.mass"].of_prior < 0.1
    assert "option.gravity[1] is about as wide as the prior" in dict(lines(found))["known"]


def test_several_models_stand_side_by_side(found: LogPosterior) -> None:
    told = side_by_side([found, found])
    assert [label for label, _ in told if label.startswith("model")] == ["model 1", "model 2"]
    assert sum("hinge.damping" in text for _, text in told) == 2
    assert "100 %" in told[0][1]


def test_a_model_without_free_parameters_is_refused() -> None:
    free = ParameterSpace()
    with pytest.raises(BadInput, match="no free parameter"):
        posterior_of_log(model(free), log(torch.zeros(0).double(), 1, free=free))


def test_a_stop_ends_it() -> None:
    interrupt = Interrupt()

    def at_the_draws(line: str) -> None:
        interrupt.requested = line.startswith("replaying draws")

    with pytest.raises(Stopped):
        posterior_of_log(model(), log(TRUTH, 1), progress=at_the_draws, interrupt=interrupt)


@pytest.mark.parametrize(
    "memory", [pytest.param(0.0, marks=pytest.mark.slow), pytest.param(0.8, marks=pytest.mark.long)]
)
def test_ninety_percent_intervals_hold_the_truth(memory: float, without_shape_checks: None) -> None:
    """Over 40 logs of 12 s; with white noise, and with noise that is correlated over five rows.

    A right interval holds the truth in 30 of 40 at least with probability 0.9985 (binomial): with other seeds one of
    300 runs would fail by chance, for two parameters.
    """
    truths, held = BoxUniform(FREE).sample((40,), torch.Generator().manual_seed(0)), torch.zeros(2)
    for k, truth in enumerate(truths):
        found = posterior_of_log(model(), log(truth, k, seconds=12.0, memory=memory), seed=k)
        held += torch.tensor([
            value.q05 <= float(truth[i]) <= value.q95 for i, value in enumerate(found.parameters.values())
        ])  # fmt: skip
    assert bool((held >= 30).all()), held


def test_with_a_gear_free_a_mass_is_known_only_beside_it() -> None:
    """Nothing but a moment of inertia that nobody measured says how large the two are."""
    space = ParameterSpace({name: BOUNDS[name] for name in (MASS, DAMPING, GEAR)})
    link = MujocoSimulator(LINK.format(**HANGING, mass=0.5), space, threads=1)
    found = posterior_of_log(link, recorded(HANGING, 0.8), holdout=["run3"])
    low, high = found.parameters[MASS].q05, found.parameters[MASS].q95
    assert low < 0.5
    assert high > 0.8
    ratio = next(one for one in found.identifiability.combinations if set(one.exponents) == {MASS, GEAR})
    assert ratio.width < 0.01
    assert found.parameters[MASS].of_prior > 0.5
