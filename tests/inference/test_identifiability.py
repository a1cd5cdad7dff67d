"""What a posterior tells, in words: of posteriors whose answer is known."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import Box, BoxUniform, RejectionABC, identifiability
from onlinebayes.parameters import Parameter, ParameterSpace
from tests.inference.systems import trajectories

MASS, LENGTH = Parameter(0.1, 1.0, "kg"), Parameter(0.2, 2.0, "m")
PENDULUM = ParameterSpace({"mass": MASS, "length": LENGTH})
ARM = PENDULUM | ParameterSpace({"damping": Parameter(0.01, 1.0, "N m s", "log")})
ZEROS = ParameterSpace({name: Parameter(-1.0, 1.0, "rad") for name in ("first", "second")})
MIXED = ParameterSpace({"mass": MASS, "bias": Parameter(-1.0, 1.0, "rad")})


class Told:
    """The prior, weighed by exp(-d^2 / 2) of each distance d: what a measurement of that quantity leaves."""

    def __init__(self, space: ParameterSpace, *distances: Callable[..., torch.Tensor]) -> None:
        self.space, self.box, self._distances = space, Box.whole(space), distances

    def sample(self, shape=(), generator=None):
        theta = BoxUniform(self.space).sample((400_000,), generator)
        log_weight = torch.zeros(len(theta)).double()
        for distance in self._distances:
            log_weight -= distance(*theta.unbind(-1)).square() / 2
        weight = log_weight.softmax(0)
        return theta[torch.multinomial(weight, shape[0], replacement=True, generator=generator)]

    def log_prob(self, theta):
        raise AssertionError("draws are enough")


def ratio(mass, length, *rest):
    return (mass / length).div(0.5).log() / 0.02


def found(space: ParameterSpace, *distances: Callable[..., torch.Tensor]):
    return identifiability(Told(space, *distances), Box.whole(space))


def test_only_a_ratio() -> None:
    told = found(PENDULUM, ratio)
    assert [each.exponents for each in told.combinations] == [{"mass": 1, "length": -1}]
    assert told.unknown == ("mass", "length")
    assert told.combinations[0].width < 0.05
    assert str(told).startswith("Only mass/length is known; left of the prior's width: mass/length (2")
    assert str(told).endswith("mass and length alone are about as wide as the prior.")


def test_one_parameter_is_not_in_the_dynamics() -> None:
    told = found(ARM, lambda m, length, d: (m - 0.5) / 0.05, lambda m, length, d: (length - 1) / 0.1)
    assert told.known == ("mass", "length")
    assert not told.combinations
    assert told.parameters["damping"] == pytest.approx(1.0, abs=0.03)
    assert str(told).startswith("Only mass and length are known")
    assert str(told).endswith("damping is about as wide as the prior.")


def test_all_are_known() -> None:
    told = found(PENDULUM, lambda m, length: (m - 0.5) / 0.02, lambda m, length: (length - 1) / 0.1)
    assert told.known == ("mass", "length")
    assert not told.combinations
    # A standard deviation of .02 of .9 wide, that is .9 / sqrt(12).
    assert told.parameters["mass"] == pytest.approx(0.02 / 0.9 * 12**0.5, rel=0.05)
    assert str(told).startswith("mass and length are known; left of the prior's width: mass (7.6 %)")


def test_nothing_is_known() -> None:
    assert str(found(PENDULUM)) == "Nothing is known: mass and length are about as wide as the prior."
    assert str(found(PENDULUM.subspace(["mass"]))) == "Nothing is known: mass is about as wide as the prior."
    assert not found(ARM).combinations


def test_what_is_known_by_half_is_said_with_its_share() -> None:
    told = found(PENDULUM, lambda m, length: (m - 0.55) / 0.2)
    assert not told.known
    assert str(told) == "Little is known: mass and length keep 72 % and 99 % of the prior's width."


def test_one_parameter_has_nothing_to_go_with() -> None:
    told = found(PENDULUM.subspace(["mass"]), lambda m: (m - 0.5) / 0.02)
    assert str(told) == "mass is known; left of the prior's width: mass (7.6 %)."


@pytest.mark.parametrize(
    ("space", "distances", "words"),
    [
        (ARM, [ratio], ["mass/length"]),
        (PENDULUM, [lambda m, length: (m * length**2).div(0.4).log() / 0.02], ["mass * length^2"]),
        (ARM, [lambda m, length, d: (d / (m * length**2)).div(0.2).log() / 0.02], ["mass * length^2/damping"]),
        (ARM, [ratio, lambda m, length, d: (d / length).div(0.1).log() / 0.05], ["mass/length", "length/damping"]),
        (PENDULUM, [lambda m, length: (m / length**0.8).div(0.4).log() / 0.01], ["mass/length^0.8"]),
        (ZEROS, [lambda a, b: (a + b - 0.1) / 0.02], ["first + second"]),
        (ZEROS, [lambda a, b: (a - b) / 0.02], ["first - second"]),
        (MIXED, [lambda m, b: (m - 0.5 - 0.4 * b) / 0.02], ["a combination of mass and bias"]),
    ],
)
def test_combinations_are_named(space: ParameterSpace, distances: list, words: list[str]) -> None:
    assert [each.words for each in found(space, *distances).combinations] == words


def test_a_ratio_beside_a_parameter_that_is_known() -> None:
    told = found(ARM, ratio, lambda m, length, d: d.log().add(2) / 0.1)
    assert told.known == ("damping",)
    assert [each.words for each in told.combinations] == ["mass/length"]
    assert str(told).startswith("Only damping and mass/length are known")


def test_parameters_that_are_known_and_their_ratio_far_better() -> None:
    told = found(PENDULUM, ratio, lambda m, length: (m - 0.5) / 0.1)
    assert told.known == ("mass", "length")
    assert [each.words for each in told.combinations] == ["mass/length"]
    assert "mass/length (2" in str(told)


def test_an_estimator_is_read_like_any_belief() -> None:
    """Steps whose mean change is log(mass / length), seen by rejection; the seed is fixed."""
    generator, prior = torch.Generator().manual_seed(0), BoxUniform(PENDULUM)

    def simulate(theta: torch.Tensor):
        data = trajectories(theta, lambda t: (t[:, :1] / t[:, 1:]).log().expand(-1, 2), 0.05, generator)
        return data.auto_batch_size_(2).set("theta", theta)

    estimator = RejectionABC(SummaryEmbedding(TransitionFeatures(2, 1, products=False)), PENDULUM, adjusted=True)
    estimator.fit(simulate(prior.sample((3000,), generator)), generator=generator)
    measured = simulate(torch.tensor([[0.4, 0.9]]).double())
    told = identifiability(estimator.condition(measured), prior.box)
    assert [each.words for each in told.combinations] == ["mass/length"]
    assert told.combinations[0].width < 0.2
