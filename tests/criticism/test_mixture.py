"""Worlds drawn from a result: each is one of the models that the data leave open, within the bounds."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from onlinebayes.criticism import Criticism, refine, worlds_of
from onlinebayes.inference import TruncatedMixture, saving
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.trainers import Problem
from onlinebayes.transforms import ParameterRandomization
from tests.criticism.rigs import TRUTH, measure, model
from tests.slide import Watching

LATE = ActuatorDelay("motor", Parameter(0.0, 0.2, "s"))


@pytest.fixture(scope="module")
def tied() -> Criticism:
    """A late motor and a late sensor look alike from outside."""
    log = measure({LATE: (0.05,)}, runs=9, noise=1e-3)
    return refine(model(), log, holdout=("run8",), candidates=("actuator_delay", "sensor_delay", "dry_friction"))


@pytest.mark.slow
def test_a_tie_leaves_two_models_with_weights(tied: Criticism) -> None:
    assert tied.verdict == "tie"
    assert {one.accepted for one in tied.hypotheses} == {("actuator_delay@motor",), ("sensor_delay@qpos.rail",)}
    assert sum(one.weight for one in tied.hypotheses) == pytest.approx(1.0)
    assert tied.hypotheses[0].model is tied.final
    for one in tied.hypotheses:
        delay = next(value for name, value in one.model.parameters.items() if name.endswith(".delay"))
        assert delay.mean == pytest.approx(0.05, abs=0.005)


@pytest.mark.slow
def test_every_drawn_world_is_one_of_the_models(tied: Criticism) -> None:
    worlds = worlds_of(tied)
    drawn = worlds.sample((500,), torch.Generator().manual_seed(0))
    assert torch.equal(drawn, worlds.space.clamp(drawn))
    motor, sensor = (drawn[:, worlds.space.index(f"{name}.delay")] for name in worlds_names(tied))
    assert bool(((motor == 0) ^ (sensor == 0)).all())
    share = float((sensor == 0).double().mean())
    assert share == pytest.approx(float(worlds.weight[0]), abs=0.1)  # four standard errors of 500 draws
    mass = drawn[:, worlds.space.index("body.cart.mass")]
    assert float(mass.mean()) == pytest.approx(TRUTH[0], rel=0.02)
    alone = worlds.alone(0).sample((3,))
    assert bool((alone[:, worlds.space.index(f"{worlds_names(tied)[1]}.delay")] == 0).all())


@pytest.mark.slow
def test_the_belief_has_a_density_that_can_be_kept(tied: Criticism, tmp_path: Path) -> None:
    worlds = worlds_of(tied)
    belief = worlds.belief
    drawn = belief.sample((500,), torch.Generator().manual_seed(0))
    motor, sensor = (worlds.space.index(f"{name}.delay") for name in worlds_names(tied))
    first = drawn[:, motor] > 0.02
    assert float(first.double().mean()) == pytest.approx(float(worlds.weight[0]), abs=0.1)
    assert float(drawn[first, motor].mean()) == pytest.approx(0.05, abs=0.005)
    assert bool(torch.isfinite(belief.log_prob(drawn)).all())
    both, neither = worlds.mean[0].clone(), worlds.mean[0].clone()
    both[sensor], neither[motor] = 0.05, 0.0
    assert float(belief.log_prob(worlds.mean).min()) > float(belief.log_prob(torch.stack([both, neither])).max()) + 10
    saving.save(belief, tmp_path / "belief.json")
    again = saving.load(tmp_path / "belief.json", worlds.space)
    torch.testing.assert_close(again.log_prob(drawn), belief.log_prob(drawn))
    assert isinstance(again, TruncatedMixture)


@pytest.mark.slow
def test_the_belief_is_a_prior_of_the_trainer(tied: Criticism) -> None:
    worlds = worlds_of(tied)
    problem = Problem(worlds.simulator, Watching(), prior=worlds.belief)
    env = problem.worlds(64, ParameterRandomization(problem.prior), seed=0)
    theta = env.rollout(2)["theta"][:, 0].double()
    assert theta.shape == (64, len(worlds.space))
    assert torch.equal(theta, worlds.space.clamp(theta))
    mass = theta[:, worlds.space.index("body.cart.mass")]
    assert float((mass - TRUTH[0]).abs().max()) < 0.1 * TRUTH[0]


@pytest.mark.slow
def test_the_worlds_run_in_the_simulator_of_all_models(tied: Criticism) -> None:
    worlds = worlds_of(tied)
    theta = worlds.sample((4,))
    simulator = worlds.simulator.with_worlds(4)
    simulator.reset(theta)
    assert torch.equal(simulator.theta, theta)


def test_where_nothing_is_missing_there_is_one_model() -> None:
    result = refine(model(), measure(runs=9), holdout=("run8",), candidates=("dry_friction",))
    worlds = worlds_of(result)
    assert worlds.names == ("the model as it is",)
    assert worlds.sample((2, 3)).shape == (2, 3, 2)


def worlds_names(result: Criticism) -> list[str]:
    return [one.accepted[0] for one in result.hypotheses]
