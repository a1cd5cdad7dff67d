"""Input at the edges, for every estimator: one line with a value, a rule and a cure, or a density that can be used."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import pytest
import torch
from tensordict import TensorDict
from torch.nn.functional import one_hot

from onlinebayes.embeddings import Embedding, LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Alarm,
    Belief,
    BoxUniform,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PopulationABC,
    PosteriorEstimator,
    RejectionABC,
    fit,
)
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from tests.inference.test_protocol import PRIOR, SPACE, simulate

Make = Callable[..., PosteriorEstimator]
Change = Callable[[TensorDict], TensorDict]

ONE = SPACE.subspace(["a"])


def neural(kind: str, space: ParameterSpace = SPACE, action: int = 1, components: int = 2) -> NeuralEstimator:
    features = TransitionFeatures(2, action)
    embedding: Embedding = LSTMEmbedding(features, 4) if kind == "lstm" else SummaryEmbedding(features)
    network = MixtureEstimator(space, embedding.size, components=components, hidden=8)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=2))


def rejection(space: ParameterSpace = SPACE, action: int = 1, components: int = 2) -> RejectionABC:
    return RejectionABC(SummaryEmbedding(TransitionFeatures(2, action)), space, adjusted=components > 1)


MAKES: dict[str, Make] = {"summary": partial(neural, "summary"), "lstm": partial(neural, "lstm"), "abc": rejection}
every_estimator = pytest.mark.parametrize("make", MAKES.values(), ids=MAKES)


def simulated(number: int = 60, seed: int = 0) -> TensorDict:
    generator = torch.Generator().manual_seed(seed)
    data = simulate(PRIOR.sample((number,), generator), generator).float()
    data["next", "observation"] = data["next", "observation"].clone()  # not a view of the same path
    data["observation"], data["theta"] = data["observation"].clone(), data["theta"].double()
    return data.set("mask", torch.ones(number, 4, dtype=torch.bool))


def changed(key: str | tuple[str, ...], index: object, value: float) -> Change:
    def of(data: TensorDict) -> TensorDict:
        data[key][index] = value
        return data

    return of


def replaced(key: str | tuple[str, ...], by: Callable[[torch.Tensor], torch.Tensor]) -> Change:
    return lambda data: data.set(key, by(data[key]))


def wider(data: TensorDict) -> TensorDict:
    for key in ("observation", ("next", "observation")):
        data[key] = data[key][..., [0, 1, 1]]
    return data


def shorter(data: TensorDict) -> TensorDict:
    data.batch_size = data.batch_size[:1]
    return data.set("action", data["action"][:, :3])


def diverged(data: TensorDict) -> TensorDict:
    for key in ("observation", ("next", "observation")):
        data[key] = torch.full_like(data[key], math.nan)
    return data.set("mask", torch.zeros(data.shape, dtype=torch.bool))


def choices(data: TensorDict) -> torch.Tensor:
    return (data["action"][..., 0] > 0).long()


def theta_lost(data: TensorDict) -> TensorDict:
    return changed("observation", 3, math.nan)(changed("theta", 3, math.nan)(data))


REFUSED: dict[str, tuple[Change, str]] = {
    "no trajectory": (lambda data: data[:0], "there is no trajectory"),
    "another width": (wider, "3 observed values and 1 action values a step; the embedding was built for 2 and 1"),
    "choices as numbers": (lambda data: data.set("action", choices(data)), r"'action' has shape \(\d+, 4\).*one_hot"),
    "no width": (replaced("observation", lambda x: x[..., 0]), r"'observation' has shape \(\d+, 4\)"),
    "another length": (shorter, "needs the same .trajectories, steps. for all"),
    "no key": (lambda data: data.exclude("action"), "have no key 'action'"),
    "nan": (changed("observation", (0, 2), math.nan), "'observation' is not finite in trajectory 0, step 2"),
    "inf": (changed("action", (0, 1), math.inf), "'action' is not finite in trajectory 0, step 1"),
    "all nan": (lambda data: diverged(data).exclude("mask"), "'observation' is not finite in trajectory 0, step 0"),
}
REFUSED_IN_A_FIT: dict[str, tuple[Change, str]] = {
    "one simulation": (
        lambda data: data[:1],
        "1 (trajectories|simulations); .*at (least|the very)",
    ),
    "one that did not diverge": (changed("mask", slice(1, None), False), "1 (trajectories|simulations); "),
    "all diverged": (diverged, "none of (60|40) simulations has a recorded step: every world diverged"),
    "no theta": (lambda data: data.exclude("theta"), "the simulations have no key 'theta'"),
    "theta is nan": (changed("theta", 3, math.nan), r"theta = \[nan, nan\] of trajectory 3 \(1 such\) is not finite"),
    "all is nan": (theta_lost, "theta .*of trajectory 3 .*is not finite"),
    "theta outside": (changed("theta", 3, 40.0), r"theta = \[40.0, 40.0\] of trajectory 3 \(1 such\) lies outside"),
    "a theta too many": (replaced("theta", lambda x: x[..., [0, 1, 1]]), "theta has 3 columns; needs 2.*: a, b"),
    "two worlds in one": (changed("theta", (3, 2), 0.5), "'theta' changes in trajectory 3 at step 2.*split_trajs"),
}
REFUSED_AS_MEASURED: dict[str, tuple[Change, str]] = {
    "no recorded step": (changed("mask", 1, False), r"trajectory 1 \(1 such\) has no recorded step; leave it out"),
    "no step": (lambda data: data[:, :0], "has no recorded step"),
    "not in a batch": (lambda data: data[0], r"'observation' has shape \(4, 2\).*add \[None\] to a single trajectory"),
}


def cases(*tables: dict[str, tuple[Change, str]]) -> pytest.MarkDecorator:
    joined = {name: case for table in tables for name, case in table.items()}
    return pytest.mark.parametrize(("change", "said"), joined.values(), ids=joined)


@every_estimator
@cases(REFUSED, REFUSED_IN_A_FIT)
def test_a_fit_says_in_one_line_what_is_wrong(make: Make, change: Change, said: str) -> None:
    with pytest.raises(BadInput, match=said) as caught:
        make().fit(change(simulated()), generator=torch.Generator().manual_seed(0))
    assert "; " in str(caught.value), "no cure"


@pytest.fixture(scope="module")
def fitted() -> dict[str, PosteriorEstimator]:
    found = {}
    for name, make in MAKES.items():
        torch.manual_seed(0)
        found[name] = make()
        found[name].fit(simulated(150), generator=torch.Generator().manual_seed(0))
    return found


@pytest.mark.parametrize("name", MAKES)
@cases(REFUSED, REFUSED_AS_MEASURED)
def test_conditioning_says_in_one_line_what_is_wrong(
    fitted: dict[str, PosteriorEstimator], name: str, change: Change, said: str
) -> None:
    measured = change(simulated(2, seed=1)).exclude("theta")
    with pytest.raises(BadInput, match=said) as caught:
        fitted[name].condition(measured)
    assert "; " in str(caught.value), "no cure"


def check(estimator: PosteriorEstimator, measured: TensorDict) -> None:
    """A density that can be used: one over the box to a tenth, finite where it draws, inside the box."""
    belief = estimator.condition(measured.exclude("theta"))
    draws = belief.sample((200,), torch.Generator().manual_seed(1))
    assert bool(estimator.box.contains(draws).all())
    assert bool(torch.isfinite(belief.log_prob(draws)).all())
    assert abs(mass(belief, draws, estimator.space) - 1) < 0.1


def mass(belief: Belief, draws: torch.Tensor, space: ParameterSpace) -> float:
    """The density's integral: about its draws, and everywhere else; a needle is missed by points of the whole box."""
    generator = torch.Generator().manual_seed(2)
    z = space.to_unit(draws)
    reach = z.amax(0) - z.amin(0)
    low, high = (z.amin(0) - reach).clamp(0, 1), (z.amax(0) + reach).clamp(0, 1)
    around, everywhere = torch.rand(2, 20_000, len(space), generator=generator, dtype=torch.float64).unbind()
    prior = BoxUniform(space)

    def ratio(points: torch.Tensor) -> torch.Tensor:
        theta = space.clamp(space.from_unit(points))
        return torch.exp(belief.log_prob(theta) - prior.log_prob(theta))

    outside = ((everywhere < low) | (everywhere > high)).any(-1)
    return float(ratio(low + around * (high - low)).mean() * (high - low).prod() + (ratio(everywhere) * outside).mean())


def one_of_two(data: TensorDict) -> TensorDict:
    return data.set("action", one_hot(choices(data), 2))


def constant(data: TensorDict) -> TensorDict:
    for key in ("observation", "action", ("next", "observation")):
        data[key] = torch.full_like(data[key], 0.3)
    return data


def parameter_a(data: TensorDict) -> TensorDict:
    return data.set("theta", data["theta"][..., :1])


TAKEN: dict[str, tuple[Change, dict[str, object]]] = {
    "one-hot choices": (one_of_two, {"action": 2}),
    "one-hot choices as bool": (lambda data: data.set("action", one_of_two(data)["action"].bool()), {"action": 2}),
    "whole numbers": (replaced("action", lambda x: (3 * x).long()), {}),
    "one step": (lambda data: data[:, :1], {}),
    "one component": (lambda data: data, {"components": 1}),
    "one parameter": (parameter_a, {"space": ONE}),
    "one parameter, one component": (parameter_a, {"space": ONE, "components": 1}),
    "constant features": (constant, {}),
    "worlds that diverged": (lambda data: torch.cat([data, diverged(data[:7].clone())]), {}),
}


@every_estimator
@pytest.mark.parametrize(("change", "how"), TAKEN.values(), ids=TAKEN)
def test_it_ends_with_a_density(make: Make, change: Change, how: dict[str, object]) -> None:
    estimator = make(**how)
    report = estimator.fit(change(simulated()), generator=torch.Generator().manual_seed(0))
    assert all(math.isfinite(value) for value in [*report.train, *report.validation])
    check(estimator, change(simulated(2, seed=1))[:2])


@pytest.mark.parametrize("name", MAKES)
@pytest.mark.parametrize("factor", [1e3, 1e30])
def test_far_from_all_simulations_there_is_a_density_and_the_alarm_rings(
    fitted: dict[str, PosteriorEstimator], name: str, factor: float
) -> None:
    """The density means nothing there: nothing but the alarm can say so."""
    measured, estimator = simulated(1, seed=1), fitted[name]
    embedding = estimator.embedding if isinstance(estimator, RejectionABC) else estimator.loss.embedding
    alarm = Alarm(embedding, simulated(150))
    assert alarm.check(measured).p > 0.05, "the seed is fixed"
    for key in ("observation", ("next", "observation")):
        measured[key] = factor * measured[key]
    assert alarm.check(measured)
    check(estimator, measured)


def test_worlds_that_diverged_change_nothing_for_the_others() -> None:
    first, second = rejection(), rejection()
    generator = torch.Generator().manual_seed(0)
    first.fit(simulated(), generator=generator)
    second.fit(torch.cat([simulated(), diverged(simulated(7, seed=2))]), generator=generator)
    measured, theta = simulated(2, seed=1), PRIOR.sample((50,), generator)
    torch.testing.assert_close(first.condition(measured).log_prob(theta), second.condition(measured).log_prob(theta))


def population(change: Change) -> PopulationABC:
    def of(theta: torch.Tensor, generator: torch.Generator) -> TensorDict:
        data = simulate(theta, generator)
        return change(data.set("mask", torch.ones(data.shape, dtype=torch.bool)))

    embedding = SummaryEmbedding(TransitionFeatures(2, 1))
    return PopulationABC(embedding, PRIOR, of, particles=20, batch=40, simulations=120)


IN_A_SIMULATION = {
    **{name: case for name, case in REFUSED.items() if name != "no trajectory"},
    "all diverged": REFUSED_IN_A_FIT["all diverged"],
    "most diverged": (changed("mask", slice(19, None), False), "19 of 40 simulations have a recorded step; 20 partic"),
}


@cases(IN_A_SIMULATION)
def test_a_population_refuses_such_simulations(change: Change, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        population(change).run(simulated(1, seed=1), torch.Generator().manual_seed(0))


@cases(REFUSED, REFUSED_AS_MEASURED)
def test_a_population_refuses_such_measurements(change: Change, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        population(lambda data: data).run(change(simulated(2, seed=1)), torch.Generator().manual_seed(0))


@pytest.mark.parametrize("change", [lambda data: data, constant, changed("mask", slice(0, 9), False)])
def test_a_population_ends_with_a_density(change: Change) -> None:
    found = population(change).run(simulated(1, seed=1), torch.Generator().manual_seed(0)).belief
    draws = found.sample((200,), torch.Generator().manual_seed(1))
    assert bool(found.box.contains(draws).all())
    assert bool(torch.isfinite(found.log_prob(draws)).all())


def test_an_alarm_needs_summaries_that_vary() -> None:
    embedding, data = SummaryEmbedding(TransitionFeatures(2, 1)), constant(simulated(150))
    embedding.fit(data["observation"], data["action"], data["next", "observation"], data["mask"])
    with pytest.raises(BadInput, match="all simulations have the same summaries"):
        Alarm(embedding, data)
    with pytest.raises(BadInput, match="99 simulations; an alarm needs 100 or more"):
        Alarm(embedding, simulated(99))
