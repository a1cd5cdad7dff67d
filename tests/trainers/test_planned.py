"""A planner in the policy's place: it is told the belief, simulations repeat its commands, a killed run goes on."""

from __future__ import annotations

import copy
from functools import partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import InitTracker

from envs.skid_steer import CircleTask, SkidSteerKinematics
from onlinebayes.control import MPPI, Bounds, Knots, TaskCost
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
from onlinebayes.objectives import Planned
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Checkpoints, seed_everything
from onlinebayes.trainers import (
    OnlineState,
    OnlineTrainer,
    Point,
    Problem,
    Repeated,
    Saver,
    Schedule,
    Sizes,
    online_trainer,
    trajectories,
)
from onlinebayes.trainers.checkpoint import run_state
from onlinebayes.trainers.state import frozen
from onlinebayes.transforms import ParameterRandomization
from tests.trainers.test_online import Killed, differing

SPACE = ParameterSpace({"radius": Parameter(0.02, 0.2, "m"), "x_icr": Parameter(-0.5, 0.5, "m")})
TRUTH, PRIOR, STEPS = torch.tensor([0.06, 0.2], dtype=torch.float64), BoxUniform(SPACE), 12
TASK = CircleTask(horizon=STEPS)


def state_of(observation: torch.Tensor) -> TensorDict:
    return TensorDict({"qpos": observation.double()}, batch_size=observation.shape[:1])


def planner(seed: int = 0) -> MPPI:
    return MPPI(
        SkidSteerKinematics(SPACE, dtype=torch.float32),
        TaskCost(TASK),
        state=state_of,
        bounds=Bounds.of(TASK.action_spec),
        noise=Knots(1.0, 3),
        horizon=8,
        samples=16,
        thetas=2,
        temperature=0.1,
        seed=seed,
    )


def problem_of(plans: MPPI) -> Problem:
    return Problem(SkidSteerKinematics(SPACE), TASK, PRIOR, torch.full((3,), 0.003), plans.transforms)


def estimator(proposal) -> NeuralEstimator:
    """Knows next to nothing; these tests ask for the order of things."""
    embedding = SummaryEmbedding(TransitionFeatures(3, 2))
    network = MixtureEstimator(SPACE, embedding.size, hidden=8, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=1))


def build(steps: int = 2, *, repeats: bool = True, **settings) -> OnlineTrainer:
    seed_everything(0)
    plans = planner()
    problem = problem_of(plans)
    return online_trainer(
        problem,
        Planned(plans),
        estimator=estimator,
        real=settings.pop("real", problem.hidden(TRUTH, 7)),
        schedule=Schedule(steps, 0, real_steps=STEPS, behaviours=2, order=settings.pop("order", "online")),
        sizes=Sizes(worlds=1, batch_steps=1, simulations=12, groups=3),
        repeats=repeats,
        **settings,
    )


@pytest.mark.usefixtures("without_shape_checks")
def test_the_planner_plans_for_the_belief_of_the_step_before() -> None:
    trainer, told = build(), []
    objective, state = trainer.objective, OnlineState.begin(PRIOR)
    hand_on = objective.policy.set_belief
    object.__setattr__(objective.policy, "set_belief", lambda belief: (told.append(belief), hand_on(belief)))
    trainer.run(state, until=1)
    between = state.belief
    trainer.run(state)
    assert told == [PRIOR, between]
    assert between is not PRIOR
    assert state.frames == 0
    assert state.real.shape == (2, STEPS)


def test_other_worlds_than_the_beliefs_can_be_asked_for() -> None:
    trainer = build(order="policy-only", worlds=Point(TRUTH))
    trainer.run(OnlineState.begin(PRIOR))
    draws = trainer.objective.policy.get_extra_state()["draws"]
    assert torch.equal(draws, TRUTH.float().expand_as(draws))


def test_a_frozen_planner_shares_the_worlds_of_the_one_that_it_was_and_plans_as_it_would() -> None:
    plans = planner()
    plans.set_belief(PRIOR)
    copied = frozen(plans)
    assert copied.search.simulator is plans.search.simulator
    seen = TensorDict({"observation": torch.tensor([[1.0, 0.0, 1.5]])}, [1])
    first = plans(seen.clone())["action"]
    plans(seen.clone())
    assert torch.equal(copied(seen.clone())["action"], first), "what the one does leaves the other alone"
    assert copied.search.simulator is plans.search.simulator


@pytest.mark.usefixtures("without_shape_checks")
def test_simulations_repeat_the_real_commands_or_ask_the_planner() -> None:
    for repeats in (True, False):
        trainer = build(1, repeats=repeats)
        state = trainer.run(OnlineState.begin(PRIOR))
        simulated = trainer.simulations.draw(trainer.makers(state, [0]), PRIOR)
        same = (simulated["action"] == state.real["action"]).all(-1).all(-1)
        assert same.all() if repeats else not same.any()
        assert simulated["theta"][:, 0].unique(dim=0).shape == (12, 2)


def test_commands_of_several_trajectories_are_dealt_out_and_end_held() -> None:
    action = torch.tensor([[[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]], [[4.0, 4.0], [5.0, 5.0], [0.0, 0.0]]])
    mask = torch.tensor([[True, True, True], [True, True, False]])
    made = Repeated(TensorDict({"action": action, "mask": mask}, [2, 3]))
    loaded = Repeated()
    loaded.load_state_dict(made.state_dict())
    env = problem_of(planner()).worlds(3, ParameterRandomization(PRIOR), seed=0)
    for policy in (made, loaded, copy.deepcopy(made)):
        found = trajectories(env, policy, 4)["action"][..., 0]
        assert found.tolist() == [[1, 2, 3, 3], [4, 5, 5, 5], [1, 2, 3, 3]]


def test_a_world_that_begins_anew_begins_the_commands_anew() -> None:
    action = torch.arange(1.0, 4.0)[None, :, None]
    policy = Repeated(TensorDict({"action": action, "mask": torch.ones(1, 3, dtype=torch.bool)}, [1, 3]))
    began = [[True, True], [False, False], [False, True], [False, False]]
    given = [policy(TensorDict({"is_init": torch.tensor(row)[:, None]}, [2]))["action"][:, 0].tolist() for row in began]
    assert given == [[1, 1], [2, 2], [3, 1], [3, 2]]


def test_what_cannot_be_repeated_is_refused() -> None:
    with pytest.raises(BadInput, match="no commands to repeat"):
        Repeated()(TensorDict({"is_init": torch.ones(1, 1, dtype=torch.bool)}, [1]))
    action = TensorDict({"action": torch.ones(1, 2, 1), "mask": torch.ones(1, 2, dtype=torch.bool)}, [1, 2])
    with pytest.raises(BadInput, match="InitTracker"):
        Repeated(action)(TensorDict({"observation": torch.ones(1, 1)}, [1]))
    assert isinstance(planner().transforms()[0], InitTracker)


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(
    ("repeats", "after"),
    [(True, 1), (True, 2), *(pytest.param(repeats, 3, marks=pytest.mark.slow) for repeats in (True, False))],
)
def test_a_killed_run_goes_on_to_the_last_bit(repeats: bool, after: int, tmp_path: Path) -> None:
    """Two saves a step: after it was measured, and at its end. The judge plans too, which moves the planner on."""
    make = partial(build, repeats=repeats)
    trainer, state = make(), OnlineState.begin(PRIOR)
    trainer.run(state, on_step=partial(judged, trainer))
    whole = run_state(trainer, state)

    trainer, state = make(), OnlineState.begin(PRIOR)
    saver, saves = Saver(trainer, Checkpoints(tmp_path, "test"), every=0.0), []

    def save_and_die(state: OnlineState, now: bool) -> None:
        saver(state, now)
        saves.append(1)
        if len(saves) == after:
            raise Killed

    with pytest.raises(Killed):
        trainer.run(state, on_step=partial(judged, trainer), checkpoint=save_and_die)
    torch.rand(10)
    trainer, state = make(), OnlineState.begin(PRIOR)
    saver = Saver(trainer, Checkpoints(tmp_path, "test"), every=0.0)
    assert saver.resume(state)
    trainer.run(state, on_step=partial(judged, trainer), checkpoint=saver)
    assert differing(whole, run_state(trainer, state)) == []


def judged(trainer: OnlineTrainer, state: OnlineState) -> None:
    """What a judge does after a step."""
    plans = trainer.objective.policy
    problem_of(plans).score(plans, TRUTH, episodes=1)
