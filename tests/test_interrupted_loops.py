"""Every long loop of the library ends soon after a stop was asked for.

Soon is counted in calls of torch, in the place of seconds: a loop runs once to its end, then again with a stop that is
asked for after a tenth and after half of its calls, and has to be gone within :data:`SOON` more of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch.overrides import TorchFunctionMode
from torchrl.envs import InitTracker

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    ChangingBelief,
    LikelihoodEstimator,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    cross_validate,
    filter_of,
    fit,
)
from onlinebayes.inference.calibration import coverage
from onlinebayes.objectives import ppo
from onlinebayes.runs import Stopped, seed_everything
from onlinebayes.runs.interrupt import heeding
from onlinebayes.simulators.by_steps import by_steps
from onlinebayes.simulators.effects import StribeckFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.trainers import EnvPlayer, EnvProblem, SimulatedPlayer, collector_of, improve, trajectories
from onlinebayes.trainers.distributed import Here, PartedCollector, PartedSimulations, in_parts
from onlinebayes.transforms import ParameterRandomization
from recipes import custom_gym
from tests.control.test_mppi import observations, planner
from tests.inference import test_epsilon_free, test_filtered, test_population
from tests.inference.test_protocol import PRIOR as PLAIN
from tests.inference.test_protocol import simulate
from tests.objectives.test_conformance import BUILT
from tests.simulators.models import SLIDE
from tests.simulators.test_force_stage import SCALES
from tests.trainers import test_env_problem, test_playing
from tests.trainers.test_distributed import PRIOR, PROBLEM, policy

SOON = 10_000
"""Calls of torch: a tenth of a second. A gradient step, or a step of all worlds, has a few hundred."""

Loop = Callable[[], object]


class Asked(TorchFunctionMode):
    """Asks for a stop at a number of calls of torch, and counts them."""

    def __init__(self, at: float = float("inf")) -> None:
        super().__init__()
        self.at, self.calls = at, 0

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.calls += 1
        return function(*args, **(kwargs or {}))

    @property
    def requested(self) -> bool:
        return self.calls >= self.at


def random(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def plain_estimator() -> NeuralEstimator:
    embedding = SummaryEmbedding(TransitionFeatures(2, 1))
    network = MixtureEstimator(PLAIN.space, embedding.size, hidden=16)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=8))


def a_fit() -> Loop:
    data = simulate(PLAIN.sample((400,)), random())
    return lambda: plain_estimator().fit(data, generator=random())


def combining_trajectories() -> Loop:
    estimator, data = plain_estimator(), simulate(PLAIN.sample((200,)), random())
    estimator.fit(data, generator=random())
    groups = torch.stack([simulate(data["theta"][:20, 0], random(i)) for i in range(20)], 1)
    return lambda: estimator.calibrate(groups, generator=random())


def a_change() -> Loop:
    estimator, data = plain_estimator(), simulate(PLAIN.sample((200,)), random())
    estimator.fit(data, generator=random())
    seen = data[:12].exclude("theta")
    return lambda: ChangingBelief(estimator).update(seen)


def length_scale() -> Loop:
    data = simulate(PLAIN.sample((200,)), random())
    make = lambda _: plain_estimator().loss  # noqa: E731
    return lambda: cross_validate(make, data, [1.0, 2.0], generator=random(), train=partial(fit, epochs=4))


def rounds_of_proposals() -> Loop:
    data, _ = test_epsilon_free.measured(0)
    return lambda: test_epsilon_free.sampler(epochs=5, rounds=2, simulations=300).run(data, random())


def a_population() -> Loop:
    measured = test_population.sharp(test_population.TRUTH, random())
    return lambda: test_population.sampler(simulations=40_000, particles=100, batch=500).run(measured, random())


def a_filter() -> LikelihoodEstimator:
    box = test_filtered.PRIOR.box
    model = filter_of(test_filtered.Pendulum(test_filtered.SPACE), test_filtered.TASK, box, state=test_filtered.state)
    return LikelihoodEstimator(model, box, 1, draws=30, enough=30.0)


def pendulums(number: int) -> TensorDict:
    return test_filtered.simulate(test_filtered.PRIOR.sample((number,)), random())


def fitting_a_filter() -> Loop:
    data = pendulums(10)
    return lambda: a_filter().fit(data, generator=random())


def a_climb() -> Loop:
    data, estimator = pendulums(8), test_filtered.made()
    return lambda: estimator.fit(data, generator=random())


def a_likelihood() -> Loop:
    data, estimator = pendulums(20), a_filter()
    estimator.fit(data, generator=random())
    return lambda: estimator.condition(data[:1].exclude("theta"))


def calibration() -> Loop:
    data, estimator = pendulums(20), a_filter()
    estimator.fit(data, generator=random())
    theta, each = data["theta"][:2, 0], lambda part: estimator.each(part.unsqueeze(1))
    return lambda: coverage(each, theta, data[:2].exclude("theta"), samples=20)


def learning(kind: str) -> Loop:
    make_env, make = BUILT[kind]
    objective = make()
    data = collector_of(make_env(), objective.policy, 512).next()
    return lambda: objective.update(data.clone())


def collecting() -> Loop:
    make_env, make = BUILT["sac"]
    objective = make()
    return lambda: improve(objective, collector_of(make_env(), objective.policy, 256), 2)


def collecting_in_parts() -> Loop:
    _, make = BUILT["sac"]
    objective, drawn = make(), ParameterRandomization(PRIOR)
    makes = in_parts(PROBLEM.worlds, 4, 2, 0)
    return lambda: improve(objective, PartedCollector(makes, objective.policy, 128, drawn, Here(2), 0), 2)


def simulating() -> Loop:
    source, acts = PROBLEM.simulations(6, 100, 0), policy()
    return lambda: source.draw([acts, acts], PRIOR)


def groups() -> Loop:
    source, acts = PROBLEM.simulations(6, 100, 0), policy()
    return lambda: source.groups([acts, acts], PRIOR)


def simulating_in_parts() -> Loop:
    acts, parts = policy(), PartedSimulations(PROBLEM.worlds, 6, 100, Here(2), 0)
    return lambda: parts.draw([acts], PRIOR)


def a_judge() -> Loop:
    acts, truth = policy(), PRIOR.sample()
    return lambda: PROBLEM.score(acts, truth, episodes=4)


def an_episode() -> Loop:
    problem, mean = test_playing.PROBLEM, test_playing.TRUTH
    player, state = SimulatedPlayer(problem, ppo(*problem.specs).policy, mean), test_playing.after_a_step(mean)
    return lambda: player(state)


ENVIRONMENT = EnvProblem(custom_gym.pendulum, test_env_problem.PROBLEM.prior, 60, beside=3, episodes=3)


def an_environment_s_simulations() -> Loop:
    source, acts = ENVIRONMENT.simulations(6, 60, seed=0), test_env_problem.policy()
    return lambda: source.draw([acts], ENVIRONMENT.prior)


def an_environment_s_judge() -> Loop:
    acts = test_env_problem.policy()
    return lambda: ENVIRONMENT.score(acts, test_env_problem.TRUTH)


def an_environment_s_episode() -> Loop:
    truth = test_env_problem.TRUTH
    player = EnvPlayer(ENVIRONMENT, test_env_problem.policy(), truth, custom_gym.look, dt=0.05)
    state = test_env_problem.replaced(truth)
    return lambda: player(state)


def a_plan() -> Loop:
    planning, seen = planner(iterations=8, horizon=30), observations(2)
    return lambda: planning(seen.clone())


def acting_by_plans() -> Loop:
    env, planning = PROBLEM.worlds(2, ParameterRandomization(PRIOR), 0), planner()
    env.append_transform(InitTracker())
    return lambda: trajectories(env, planning, 11)


def question(simulator: Any, worlds: int, steps: int) -> tuple[Any, ...]:
    theta = simulator.parameters.from_unit(torch.full((worlds, len(simulator.parameters)), 0.5).double())
    state = TensorDict({"qpos": torch.zeros(worlds, 1).double(), "qvel": torch.zeros(worlds, 1).double()}, [worlds])
    inputs = TensorDict({"command": torch.ones(worlds, steps, 1).double()}, [worlds, steps])
    return theta, state, inputs, simulator.dt * torch.arange(1, steps + 1).double()


def an_engine_s_rollout() -> Loop:
    simulator = MujocoSimulator(SLIDE, threads=1)
    asked = question(simulator, 3000, 400)
    return lambda: simulator.rollout(*asked)


def an_engine_s_rollout_with_forces() -> Loop:
    simulator = MujocoSimulator(SLIDE).with_effect(StribeckFriction.scaled("rail", SCALES))
    asked = question(simulator, 3, 400)
    return lambda: simulator.rollout(*asked)


def a_rollout_in_torch() -> Loop:
    simulator = test_filtered.Pendulum(test_filtered.SPACE)
    asked = question(simulator, 3, 400)
    return lambda: simulator.rollout(*asked)


def a_rollout_by_steps() -> Loop:
    simulator = test_filtered.Pendulum(test_filtered.SPACE)
    asked = question(simulator, 3, 200)
    return lambda: by_steps(simulator, *asked)


LOOPS: dict[str, Callable[[], Loop]] = {
    made.__name__: made
    for made in (
        a_fit,
        combining_trajectories,
        a_change,
        length_scale,
        rounds_of_proposals,
        a_population,
        fitting_a_filter,
        a_climb,
        a_likelihood,
        calibration,
        collecting,
        collecting_in_parts,
        simulating,
        groups,
        simulating_in_parts,
        a_judge,
        an_episode,
        an_environment_s_simulations,
        an_environment_s_judge,
        an_environment_s_episode,
        a_plan,
        acting_by_plans,
        an_engine_s_rollout,
        an_engine_s_rollout_with_forces,
        a_rollout_in_torch,
        a_rollout_by_steps,
    )
} | {f"learning, {kind}": partial(learning, kind) for kind in BUILT if "recurrent" not in kind}

LONG = ("a_likelihood", "calibration")


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in LOOPS])
def test_a_loop_ends_soon_after_it_was_asked_to(name: str) -> None:
    seed_everything(0)
    loop = LOOPS[name]()
    with Asked() as whole:
        loop()
    for share in (0.1, 0.5):
        seed_everything(0)
        loop = LOOPS[name]()
        with Asked(share * whole.calls) as asked, heeding(asked), pytest.raises(Stopped):
            loop()
        assert asked.calls - asked.at < SOON
