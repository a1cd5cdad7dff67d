"""Weights of the models that a critic leaves open: what moves them, where the model follows, and what is saved."""

from __future__ import annotations

import math
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import refine
from onlinebayes.objectives import sac
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput, Checkpoints, heed
from onlinebayes.simulators.effects import ActuatorDelay, SensorBias, ViscousFriction
from onlinebayes.simulators.effects.plain import to_plain
from onlinebayes.trainers import Finding, LoggedRuns, OnlineState, Saver, SearchCritic
from onlinebayes.trainers.checkpoint import run_state
from onlinebayes.trainers.critic import finding_of, left_open
from onlinebayes.trainers.hypotheses import CLEAR, OpenHypotheses, OpenHypothesis
from recipes.hidden_machine import Hidden
from recipes.pendulum import state as state_of
from tests.criticism.rigs import measure, model
from tests.trainers.test_growing import FRICTION, PROBLEM, SPACE, TRUTH, build, machine
from tests.trainers.test_online import Killed, differing

VISCOUS = ViscousFriction("hinge", Parameter(0.0, 2.0, "N m s/rad"))
NOISE = {"qpos.hinge": 0.02, "qvel.hinge": 0.16}
OLD = dict(zip(SPACE.names, TRUTH.tolist(), strict=True))


def hypothesis(effect, size: float, weight: float) -> OpenHypothesis:
    values = {**OLD, f"{effect.key}.{effect.magnitude}": size}
    return OpenHypothesis((to_plain(effect),), values, weight)


def torn(viscous: float = 0.6, dry: float = 0.4) -> OpenHypotheses:
    return OpenHypotheses((hypothesis(VISCOUS, 0.3, viscous), hypothesis(FRICTION, 0.8, dry)), NOISE, 1.0)


def test_a_trajectory_multiplies_each_weight_by_what_its_model_predicts() -> None:
    now = torn(0.5, 0.5).after(torch.tensor([[1.0 + math.log(3.0), 1.0]]))
    assert list(now.weights) == ["viscous_friction@hinge", "dry_friction@hinge"]
    assert list(now.weights.values()) == pytest.approx([0.25, 0.75])
    both = now.after(torch.tensor([[0.2, 0.0], [0.0, 0.2]]))
    assert list(both.weights.values()) == pytest.approx([0.25, 0.75]), "two that contradict each other say nothing"
    assert now.words == "dry_friction@hinge 0.75, viscous_friction@hinge 0.25"


@pytest.mark.parametrize("scores", [[[0.3, 0.9]], [[math.inf, 0.4]], [[50.0, 0.0]] * 5, [[0.1, 0.1]], []])
def test_weights_add_up_to_one(scores: list[list[float]]) -> None:
    now = torn().after(torch.tensor(scores).reshape(-1, 2))
    assert sum(now.weights.values()) == pytest.approx(1.0, abs=1e-12)
    assert all(weight > 0 for weight in now.weights.values()), "what was said can be taken back"


def test_a_trajectory_that_no_model_can_replay_says_nothing() -> None:
    assert torn().after(torch.full((3, 2), math.inf)).weights == pytest.approx(torn().weights)


def test_the_heaviest_is_clear_where_it_weighs_ten_times_the_next() -> None:
    assert torn(0.5, 0.5).clear is None
    assert torn(0.1, 0.89).clear is None
    clear = torn(0.9 / (1 + CLEAR), 1 - 0.9 / (1 + CLEAR)).clear
    assert clear is not None
    assert clear.keys == ("dry_friction@hinge",)
    assert clear.added_to(PROBLEM.simulator) == (FRICTION,)
    bias = hypothesis(SensorBias("qpos.hinge", Parameter(-1.0, 1.0, "rad")), 0.1, 1.0)
    assert clear.moves(PROBLEM.simulator)
    assert not bias.moves(PROBLEM.simulator)


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(("friction", "heavier"), [(0.8, "dry_friction@hinge"), (0.0, "viscous_friction@hinge")])
def test_a_trajectory_that_one_model_explains_moves_the_weight_to_it(friction: float, heavier: str) -> None:
    """A machine with the dry friction of one model; without any the other, of hardly any friction, is nearer."""
    real = machine(Hidden(friction=friction), worlds=2).run(sac(*PROBLEM.specs).policy, 50)
    open_ = replace(torn(0.5, 0.5), each=(hypothesis(VISCOUS, 0.02, 0.5), hypothesis(FRICTION, 0.8, 0.5)))
    critic = SearchCritic(LoggedRuns(state_of))
    scores = critic.scores(real, PROBLEM, open_)
    assert scores.shape == (2, 2)
    assert bool((scores >= 0).all())
    before, after = open_.weights[heavier], open_.after(scores[:1]).weights[heavier]
    assert after > before + 0.1
    assert open_.after(scores).weights[heavier] > after, "the second one says so too"


class Torn:
    """A critic that leaves two models open, and weighs them by given scores."""

    def __init__(self, scores: tuple[float, float]) -> None:
        self.row, self.asked = scores, list[int]()

    def __call__(self, real, problem, interrupt) -> Finding:
        return Finding((), "torn", torn())

    def scores(self, real: TensorDict, problem, hypotheses: OpenHypotheses) -> torch.Tensor:
        self.asked.append(len(real))
        return torch.tensor([self.row]).expand(len(real), 2)


def test_the_model_changes_when_one_of_what_was_left_open_is_clear() -> None:
    """3.4 nats for dry friction: from .4 to .95 with the first trajectory that comes after the question."""
    critic = Torn((4.0, 0.6))
    trainer = build(critic)
    state = trainer.run(OnlineState.begin(PROBLEM.prior))
    assert critic.asked == [1], "each trajectory once, and only those that came after"
    assert [record.grown for record in state.records] == [(), (), ("dry_friction@hinge",)]
    assert trainer.problem.simulator.effects == (FRICTION,)
    assert "torn" in state.records[1].notes
    assert any(
        note.startswith("weights after 1 new real trajectories: dry_friction") for note in state.records[2].notes
    )
    assert state.hypotheses is not None
    assert sum(state.hypotheses.weights.values()) == pytest.approx(1.0)
    assert state.hypotheses.weights["dry_friction@hinge"] > 0.9


def test_what_stays_open_changes_nothing_but_the_weights() -> None:
    state = build(Torn((0.7, 0.6))).run(OnlineState.begin(PROBLEM.prior))
    assert state.records[-1].grown == ()
    assert state.hypotheses is not None
    assert torn().weights["dry_friction@hinge"] < state.hypotheses.weights["dry_friction@hinge"] < 0.5


def test_trajectories_that_cannot_be_weighed_end_nothing() -> None:
    class Refuses(Torn):
        def scores(self, real, problem, hypotheses) -> torch.Tensor:
            raise BadInput("too short", "record more")

    state = build(Refuses((0.0, 0.0))).run(OnlineState.begin(PROBLEM.prior))
    assert state.hypotheses == torn()
    assert any("cannot be weighed (too short; record more)" in note for note in state.records[-1].notes)


def test_a_stop_is_heeded_while_trajectories_are_weighed() -> None:
    class Slow(Torn):
        turns = 0

        def scores(self, real, problem, hypotheses) -> torch.Tensor:
            os.kill(os.getpid(), signal.SIGTERM)
            for _ in range(1000):
                heed()
                self.turns += 1
            return super().scores(real, problem, hypotheses)

    critic = Slow((4.0, 0.6))
    state = build(critic).run(OnlineState.begin(PROBLEM.prior))
    assert (state.interrupted, state.hypotheses) == (True, torn())
    assert critic.turns <= 1


def test_what_is_open_is_saved_and_loaded(tmp_path: Path) -> None:
    state = OnlineState.begin(PROBLEM.prior)
    state.hypotheses, state.weighed = torn(), 3
    Checkpoints(tmp_path, "test").save(state.state_dict())
    found = Checkpoints(tmp_path, "test").load()
    again = OnlineState.begin(PROBLEM.prior)
    assert found is not None
    again.load_state_dict(found.state)
    assert (again.hypotheses, again.weighed) == (torn(), 3)
    assert again.hypotheses is not None
    assert again.hypotheses.each[1].added_to(PROBLEM.simulator) == (FRICTION,)


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("after", [4, 8])
def test_a_run_killed_while_models_are_open_goes_on_to_the_last_bit(after: int, tmp_path: Path) -> None:
    """Killed when the critic had left them open (4), and when one of them had become the model (8)."""
    trainer, state = build(Torn((4.0, 0.6))), OnlineState.begin(PROBLEM.prior)
    trainer.run(state)
    whole = run_state(trainer, state)

    trainer, state = build(Torn((4.0, 0.6))), OnlineState.begin(PROBLEM.prior)
    saver, saves = Saver(trainer, Checkpoints(tmp_path, "test"), every=1e9), []

    def save_and_die(state: OnlineState, now: bool) -> None:
        saver(state, now)
        saves.append((state.hypotheses is not None, bool(state.effects)))
        if len(saves) == after:
            raise Killed

    with pytest.raises(Killed):
        trainer.run(state, checkpoint=save_and_die)
    assert saves[-1] == (True, after == 8), saves
    torch.rand(10)
    trainer, state = build(Torn((4.0, 0.6))), OnlineState.begin(PROBLEM.prior)
    saver = Saver(trainer, Checkpoints(tmp_path, "test"), every=1e9)
    assert saver.resume(state)
    trainer.run(state, checkpoint=saver)
    assert differing(whole, run_state(trainer, state)) == []


@pytest.mark.slow
def test_a_tie_is_left_open_with_the_weights_of_the_criticism() -> None:
    late = ActuatorDelay("motor", Parameter(0.0, 0.2, "s"))
    log = measure({late: (0.05,)}, runs=9, noise=1e-3)
    result = refine(model(), log, holdout=("run8",), candidates=("actuator_delay", "sensor_delay", "dry_friction"))
    rivals = [key for one in result.candidates if one.accepted for key in one.indistinguishable_from]
    found = left_open(result, model(), rivals)
    assert found is not None
    assert set(found.weights) == {"actuator_delay@motor", "sensor_delay@qpos.rail"}
    assert list(found.weights.values()) == pytest.approx([one.weight for one in result.hypotheses])
    assert found.each[0].values[f"{found.each[0].keys[0]}.delay"] == pytest.approx(0.05, abs=0.005)
    assert set(found.noise) == {"qpos.rail"}
    assert found.horizon > 0
    finding = finding_of(result, model(), "criticism")
    assert (finding.effects, finding.hypotheses) == ((), found)
    assert finding.words.endswith(f"nothing is added until one is clear ({found.words})")
    assert left_open(result, model(), [*rivals, "backlash@rail"]) is None, "which was not fitted"
