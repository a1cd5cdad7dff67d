"""An environment in the place of a simulator: its worlds, its judge, its episodes, a policy that learns alone."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch

from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.runs import BadInput, Checkpoints, RunFolder, seed_everything
from onlinebayes.runs.checkpoints import plain
from onlinebayes.trainers import (
    EnvPlayer,
    EnvProblem,
    OnlineState,
    OnlineTrainer,
    Point,
    Saver,
    Schedule,
    Sizes,
    online_trainer,
    run_in_folder,
)
from onlinebayes.trainers.checkpoint import fresh_episodes, run_state
from onlinebayes.transforms import ParameterRandomization
from recipes import custom_gym
from recipes.custom_gym import SPACE, look, pendulum
from tests.trainers.test_online import Killed, build, leaves
from tests.trainers.test_playing import after_a_step

PROBLEM = EnvProblem(pendulum, BoxUniform(SPACE), 20, beside=4, episodes=3)
TRUTH = torch.tensor([0.7, 1.2], dtype=torch.float64)


def policy():
    return sac(*PROBLEM.specs).policy


def test_simulations_are_as_many_as_asked_for_in_few_worlds() -> None:
    data = PROBLEM.simulations(8, 5, seed=0).draw([policy()], PROBLEM.prior)
    assert data.shape == (8, 5)
    assert len(data["theta"][:, 0].unique(dim=0)) == 8


def test_so_are_groups() -> None:
    groups = PROBLEM.simulations(8, 5, seed=0).groups([policy(), policy()], PROBLEM.prior)
    assert groups.shape == (8, 2, 5)
    assert len(groups["theta"][:, 0, 0].unique(dim=0)) == 8
    assert torch.equal(groups["theta"][:, 0, 0], groups["theta"][:, 1, 0])


def test_the_hidden_world_tells_no_theta_and_sensors_are_noisy() -> None:
    seen = PROBLEM.hidden(TRUTH, seed=0).run(policy(), 5)
    assert "theta" not in seen
    noisy = replace(PROBLEM, sensor_sd=torch.full((3,), 0.1)).hidden(TRUTH, seed=0).run(policy(), 5)
    length = [run["observation"][..., :2].norm(dim=-1) for run in (seen, noisy)]
    assert (length[0] - 1).abs().max() < 1e-5 < (length[1] - 1).abs().max()


def test_a_policy_is_judged_in_worlds_of_the_truth() -> None:
    good = policy()
    assert PROBLEM.score(good, TRUTH) == PROBLEM.score(good, TRUTH) != PROBLEM.score(good, 0.8 * TRUTH)


@pytest.mark.parametrize("noise", [None, torch.full((3,), 0.05)])
def test_a_right_belief_moves_as_the_real_system_and_a_wrong_one_parts_from_it(noise) -> None:
    player = EnvPlayer(replace(PROBLEM, sensor_sd=noise), policy(), TRUTH, look, dt=0.05)
    right, wrong = player(replaced(TRUTH)), player(replaced(torch.tensor([1.3, 0.6])))
    assert len(right["real"].poses) == len(right["simulated"].poses) == 21
    torch.testing.assert_close(right["simulated"].poses, right["real"].poses)
    torch.testing.assert_close(wrong["real"].poses, right["real"].poses)
    assert (wrong["simulated"].poses - wrong["real"].poses).abs().max() > 1e-2


def replaced(mean: torch.Tensor) -> OnlineState:
    state = after_a_step(mean)
    belief = dict(zip(SPACE.names, [(float(m), 0.1) for m in mean], strict=True))
    state.records[-1] = replace(state.records[-1], belief=belief)
    return state


def trainer(order: str):
    return online_trainer(
        PROBLEM,
        sac(*PROBLEM.specs),
        schedule=Schedule(1, 1, order=order),
        sizes=Sizes(worlds=2, batch_steps=4),
        worlds=Point(TRUTH),
    )


def test_a_policy_that_learns_alone_needs_no_estimator() -> None:
    state = trainer("policy-only").run(OnlineState.begin(PROBLEM.prior))
    assert (state.frames, state.real, state.belief) == (8, None, PROBLEM.prior)
    with pytest.raises(BadInput, match="without an estimator"):
        trainer("online")


def learning() -> OnlineTrainer:
    seed_everything(0)
    return online_trainer(
        PROBLEM,
        sac(*PROBLEM.specs, SACSettings(widths=(8, 8), memory=200, minibatch=16, frames_per_update=8)),
        estimator=partial(custom_gym.estimator, 2),
        real=PROBLEM.hidden(TRUTH, 7),
        schedule=Schedule(2, 3, real_steps=8),
        sizes=Sizes(worlds=2, batch_steps=4, simulations=12, groups=4),
    )


def parted(first: dict, second: dict) -> list[str]:
    """Names of what is not the same, but for seconds and for what a collector last carried, which begins anew."""
    told = [{key: value for key, value in leaves(plain(each)).items() if known(key)} for each in (first, second)]
    if told[0].keys() != told[1].keys():
        return sorted(told[0].keys() ^ told[1].keys())
    return [key for key, value in told[0].items() if not same(value, told[1][key])]


def known(key: str) -> bool:
    return "seconds" not in key and not key.startswith("/collector/carried")


def same(one: object, other: object) -> bool:
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else one == other


SAVES = ["1 batch", "2 batches", "policy", "real", "step"]
"""When a run saves, in each of its two steps."""


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("after", range(1, 10))
def test_a_run_that_is_stopped_goes_on_as_far_as_its_worlds_can_tell(after: int, tmp_path: Path) -> None:
    """To the last bit where no episode was under way that the policy would have learnt from on."""
    trainer, state = learning(), OnlineState.begin(PROBLEM.prior)
    trainer.run(state)
    whole = run_state(trainer, state)

    trainer, saves = learning(), []
    saver = Saver(trainer, Checkpoints(tmp_path, "test"), every=0.0)

    def save_and_die(state: OnlineState, now: bool) -> None:
        saver(state, now)
        saves.append(now)
        if len(saves) == after:
            raise Killed

    with pytest.raises(Killed):
        trainer.run(OnlineState.begin(PROBLEM.prior), checkpoint=save_and_die)
    trainer, state = learning(), OnlineState.begin(PROBLEM.prior)
    saver = Saver(trainer, Checkpoints(tmp_path, "test"), every=0.0)
    assert saver.resume(state)
    trainer.run(state, checkpoint=saver)
    others = parted(run_state(trainer, state), whole)
    in_policy = "batch" in SAVES[(after - 1) % len(SAVES)]
    assert bool(others) == in_policy, others
    assert trainer.collector._frames == whole["collector"]["frames"]


def test_that_it_is_not_the_same_is_said_at_the_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with RunFolder(tmp_path / "environment", "test") as folder:
        run_in_folder(trainer("policy-only"), PROBLEM.prior, folder)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("worlds of a SerialEnv cannot say where they stand in an episode")
    assert "not to the same last bit" in said[0]
    assert fresh_episodes(build()) is None, "worlds of a simulator can say it"


def test_worlds_draw_from_the_distribution() -> None:
    theta = PROBLEM.worlds(3, ParameterRandomization(Point(TRUTH)), 0).reset()["theta"]
    torch.testing.assert_close(theta, TRUTH.expand(3, -1))
