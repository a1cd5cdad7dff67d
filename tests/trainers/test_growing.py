"""A run whose model grows: when the critic is asked, what is kept, what is saved, and what a critic may do wrong."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.criticism import refine
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    BoxUniform,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    filtered_estimator,
    fit,
)
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Checkpoints, Interrupt, seed_everything
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction
from onlinebayes.simulators.effects.plain import from_plain, to_plain
from onlinebayes.trainers import (
    Finding,
    GrowingTrainer,
    LoggedRuns,
    OnlineState,
    Point,
    Problem,
    RealEnvironment,
    Saver,
    Schedule,
    SearchCritic,
    Sizes,
    online_trainer,
)
from onlinebayes.trainers.checkpoint import run_state
from onlinebayes.trainers.critic import finding_of, simple_laws
from onlinebayes.transforms import ParameterRandomization
from recipes.hidden_machine import PENDULUM, Hidden, Machine
from recipes.pendulum import RANGE, state
from tests.trainers.test_online import Killed, differing

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
TRUTH = torch.tensor([0.7, 0.6], dtype=torch.float64)
FRICTION = DryFriction("hinge", Parameter(0.0, 2.0, "N m"))
DELAY = ActuatorDelay("motor", Parameter(0.0, 0.2, "s"))
NAME = "dry_friction@hinge.frictionloss"


class FinePendulum(Pendulum):
    timestep = 0.025
    defaults = {**Pendulum.defaults, "length": 0.5, "mass": 0.5}  # noqa: RUF012


PROBLEM = Problem(FinePendulum(SPACE, dt=0.05), PendulumTask(), BoxUniform(SPACE), 0.01 * RANGE)


def machine(hidden: Hidden, worlds: int = 1) -> RealEnvironment:
    """Real systems that know nothing of our effects."""
    problem = replace(PROBLEM, simulator=Machine(PENDULUM, SPACE, hidden, 0.05))
    return RealEnvironment(problem.worlds(worlds, ParameterRandomization(Point(TRUTH)), 7))


def quick(problem: Problem, proposal) -> NeuralEstimator:
    """Knows little, but in no time."""
    embedding = SummaryEmbedding(TransitionFeatures(3, 1))
    network = MixtureEstimator(problem.space, embedding.size, hidden=16, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=1, batch_size=20))


def estimator(problem: Problem):
    train = partial(fit, epochs=15, batch_size=50, learning_rate=1e-3)
    return filtered_estimator(problem.simulator, problem.task, state=state, train=train)


def over(objective, real, problem: Problem, steps: int = 3, real_steps: int = 10, filtered: bool = False):
    return online_trainer(
        problem,
        objective,
        estimator=estimator(problem) if filtered else partial(quick, problem),
        real=real,
        schedule=Schedule(steps, 1, real_steps, behaviours=1, group=1, first_batches=0 if filtered else None),
        sizes=Sizes(worlds=4, batch_steps=8, simulations=150 if filtered else 40, groups=20),
    )


def build(critic, moments=(1,), **settings) -> GrowingTrainer:
    seed_everything(0)
    objective = sac(*PROBLEM.specs, SACSettings(minibatch=32))
    real = settings.pop("real", None) or machine(Hidden(friction=0.8))
    return GrowingTrainer(PROBLEM, partial(over, objective, real, **settings), critic, moments)


def says(*findings: Finding) -> Callable[..., Finding]:
    """A critic with its answers ready."""
    answers = list(findings)
    return lambda real, problem, interrupt: answers.pop(0)


NOTHING = Finding((), "nothing")
LATE, RUBS = Finding((DELAY,), "late"), Finding((FRICTION,), "rubs")


def test_an_effect_is_the_same_when_it_has_been_plain_values() -> None:
    for effect in (FRICTION, DELAY):
        assert from_plain(to_plain(effect), {effect.name: type(effect)}) == effect
    with pytest.raises(BadInput, match="'dry_frction' is unknown"):
        from_plain({"name": "dry_frction", "target": "hinge"}, {"dry_friction": DryFriction})


def test_the_model_grows_and_what_was_measured_is_kept() -> None:
    trainer = build(says(RUBS))
    seen: list[OnlineState] = []
    state = trainer.run(OnlineState.begin(PROBLEM.prior), on_step=lambda s: seen.append(s.belief.space.names))
    assert seen == [SPACE.names, (*SPACE.names, NAME), (*SPACE.names, NAME)]
    assert trainer.problem.simulator.parameters.names == (*SPACE.names, NAME)
    assert [record.grown for record in state.records] == [(), ("dry_friction@hinge",), ("dry_friction@hinge",)]
    assert "rubs" in state.records[1].notes
    assert {"criticism", "growing"} <= set(state.records[1].seconds)
    assert len(state.real) == 3, "the trajectories of the first model are there still"
    assert len(state.policies) == 3
    assert state.frames == 3 * 4 * 8
    assert state.belief.sample((5,)).shape == (5, 3)


@pytest.mark.slow
def test_the_policy_that_learnt_before_learns_on() -> None:
    trainer = build(says(RUBS))
    objective = trainer.trainer.objective
    trainer.run(OnlineState.begin(PROBLEM.prior))
    assert trainer.trainer.objective is objective
    assert trainer.trainer.simulations.env.base_env.simulator.effects == (FRICTION,)


@pytest.mark.slow
def test_another_effect_takes_the_place_of_the_first() -> None:
    trainer = build(says(LATE, RUBS), moments=(1, 2))
    state = trainer.run(OnlineState.begin(PROBLEM.prior))
    assert [record.grown for record in state.records[1:]] == [("actuator_delay@motor",), ("dry_friction@hinge",)]
    assert trainer.problem.space.names == (*SPACE.names, NAME)


@pytest.mark.slow
def test_what_was_added_stays_where_nothing_more_is_found() -> None:
    trainer = build(says(RUBS, NOTHING), moments=(1, 2))
    state = trainer.run(OnlineState.begin(PROBLEM.prior))
    assert state.records[-1].grown == ("dry_friction@hinge",)
    assert "nothing" in state.records[-1].notes


def test_trajectories_that_cannot_be_criticised_end_nothing() -> None:
    def refuses(real, problem, interrupt):
        raise BadInput("too short", "record more")

    state = build(refuses).run(OnlineState.begin(PROBLEM.prior))
    assert state.step == 3
    told = "the trajectories cannot be criticised (too short; record more); the model stays as it was"
    assert told in state.records[1].notes
    assert state.records[-1].grown == ()


def test_a_fault_of_our_own_is_raised() -> None:
    def fails(real, problem, interrupt):
        raise ArithmeticError("no number")

    with pytest.raises(ArithmeticError):
        build(fails).run(OnlineState.begin(PROBLEM.prior))


def test_ctrl_c_during_criticism_keeps_the_run_and_it_is_asked_again() -> None:
    calls = []

    def stopped(real, problem, interrupt):
        calls.append(len(real))
        if len(calls) == 1:
            os.kill(os.getpid(), signal.SIGINT)
        return RUBS

    trainer = build(stopped)
    state = trainer.run(OnlineState.begin(PROBLEM.prior))
    assert (state.interrupted, state.step, state.effects) == (True, 1, [])
    state = trainer.run(state)
    assert calls == [1, 1]
    assert state.records[-1].grown == ("dry_friction@hinge",)


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("after", [3, 4, 6])
def test_a_killed_run_goes_on_to_the_last_bit(after: int, tmp_path: Path) -> None:
    """Killed before it grew (3: the first step is complete), when it had grown (4), and in the step that follows."""
    trainer, state = build(says(RUBS)), OnlineState.begin(PROBLEM.prior)
    trainer.run(state)
    whole = run_state(trainer, state)

    trainer, state = build(says(RUBS)), OnlineState.begin(PROBLEM.prior)
    saver, saves = Saver(trainer, Checkpoints(tmp_path, "test"), every=1e9), []

    def save_and_die(state: OnlineState, now: bool) -> None:
        saver(state, now)
        saves.append(len(state.effects))
        if len(saves) == after:
            raise Killed

    with pytest.raises(Killed):
        trainer.run(state, checkpoint=save_and_die)
    assert saves[-1] == (after > 3)
    torch.rand(10)
    trainer, state = build(says(RUBS)), OnlineState.begin(PROBLEM.prior)
    saver = Saver(trainer, Checkpoints(tmp_path, "test"), every=1e9)
    assert saver.resume(state)
    assert len(state.belief.space) == (2 if after == 3 else 3)
    trainer.run(state, checkpoint=saver)
    assert differing(whole, run_state(trainer, state)) == []


def test_moments_are_checked() -> None:
    with pytest.raises(BadInput, match="from 1 on"):
        build(says(), moments=(0,))


def test_trajectories_are_read_as_a_log() -> None:
    real = machine(Hidden(), worlds=3).run(sac(*PROBLEM.specs).policy, 40)
    real["mask"][1, 25:] = False
    log = LoggedRuns(state)(real, PROBLEM)
    assert log.runs == ("trajectory 1", "trajectory 2", "trajectory 3")
    assert log.lengths.tolist() == [41, 26, 41]
    assert [signal.name for signal in log.signals] == ["qpos.hinge", "qvel.hinge"]
    torch.testing.assert_close(log.data["command"][0, :40, 0], real["action"][0, :, 0].double())
    angle = log.data["signal"][..., 0]
    assert (angle[:, :26].diff(dim=1).abs() < 1).all(), "no whole turns in between"
    torch.testing.assert_close(angle[0].cos(), log_cosine(real), atol=0.1, rtol=0)


def log_cosine(real: TensorDict) -> torch.Tensor:
    return torch.cat([real["observation"][0, :, 0], real["next", "observation"][0, -1:, 0]]).double()


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("friction", [0.8, 0.0])
def test_dry_friction_is_named_and_nothing_where_there_is_nothing(friction: float) -> None:
    """Five random trajectories of 2.5 s, by fixed seeds; ``make hidden-effect`` counts how often it is so."""
    critic, real = SearchCritic(LoggedRuns(state)), machine(Hidden(friction=friction), worlds=5)
    trainer = build(critic, steps=2, real=real, real_steps=50, filtered=True)
    found = trainer.run(OnlineState.begin(PROBLEM.prior))
    assert found.records[-1].grown == (("dry_friction@hinge",) if friction else ())
    if friction:
        mean, sd = found.records[-1].belief[NAME]
        assert abs(mean - friction) < 4 * sd + 0.1
        for name, true in zip(SPACE.names, TRUTH.tolist(), strict=True):
            mean, sd = found.records[-1].belief[name]
            assert sd < 0.15, "the old parameters are known as well (the prior's sd is 0.26)"
            assert abs(mean - true) < 4 * sd


@pytest.mark.long
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("friction", [0.8, 0.0])
def test_refine_says_the_same_of_the_trajectories_as_a_log(friction: float) -> None:
    runs, real = LoggedRuns(state), machine(Hidden(friction=friction), worlds=5)
    begun = build(SearchCritic(runs), steps=1, real=real, real_steps=50).run(OnlineState.begin(PROBLEM.prior))
    trajectories = begun.real
    log = runs(trajectories, PROBLEM)
    finding = SearchCritic(runs)(trajectories, PROBLEM, Interrupt())
    result = refine(PROBLEM.simulator, log, holdout=log.runs[-1:], candidates=simple_laws())
    # A tie is an answer, too: then both name it, and nothing is added.
    assert finding == finding_of(result, PROBLEM.simulator, f"criticism of {len(trajectories)} real trajectories")
    assert result.accepted == (("dry_friction@hinge",) if friction else ())
