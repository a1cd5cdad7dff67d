"""A run in a folder: what it leaves, that it goes on there, and what it looks like."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import torch
from tensordict.nn import TensorDictModuleBase

import onlinebayes
from onlinebayes.inference import saving
from onlinebayes.objectives import Planned
from onlinebayes.runs import RunFolder
from onlinebayes.trainers import OnlineState, PolicyFiles, Recording, SimulatedPlayer, run_in_folder
from onlinebayes.trainers.playing import play
from tests.trainers.test_online import PRIOR, PROBLEM, TRUTH, build


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "log.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.usefixtures("without_shape_checks")
def test_a_run_leaves_a_log_a_recording_and_a_page_and_goes_on_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(steps: int) -> OnlineState:
        trainer = build(steps=steps)
        with RunFolder(tmp_path, "test") as folder:
            player = SimulatedPlayer(PROBLEM, trainer.objective.policy, TRUTH)
            with Recording(tmp_path, "test", PRIOR, player, TRUTH, {"oracle": 9.0}) as watcher:
                state = run_in_folder(trainer, PRIOR, folder, judge=lambda _: {"return": 7.0}, watchers=(watcher,))
        return state

    run(1)
    first = rows(tmp_path)
    assert [row["step"] for row in first] == ["1"]
    assert first[0]["figure/return"] == "7.0"
    state = run(2)
    assert "going on in" in capsys.readouterr().out
    assert state.step == 2
    second = rows(tmp_path)
    assert [row["step"] for row in second] == ["1", "2"]
    assert second[0] == first[0], "what was logged before the stop stays"
    assert float(second[1]["belief/length/mean"]) == pytest.approx(
        float(state.belief.sample((4000,)).mean(0)[0]), abs=0.05
    )
    assert {"run.rrd", "run-2.rrd", "run.html", "run.json"} <= {path.name for path in tmp_path.iterdir()}
    page = (tmp_path / "run.html").read_text("utf-8")
    for words in ("held-out truths", "calibrated", "oracle", "An episode"):
        assert words in page


def test_an_episode_ends_where_the_task_ends_it() -> None:
    trainer = build()
    states = play(PROBLEM, trainer.objective.policy, TRUTH)
    ends = PROBLEM.task.terminated(states)
    assert bool(ends[-1])
    assert not ends[:-1].any()


@pytest.mark.usefixtures("without_shape_checks")
def test_a_run_leaves_its_policy_its_belief_and_the_best_policy(tmp_path: Path) -> None:
    pytest.importorskip("safetensors")
    trainer, scores = build(steps=3), iter([1.0, 7.0, 3.0])
    files, kept = PolicyFiles(tmp_path, "test", trainer.objective, PROBLEM), []
    with RunFolder(tmp_path, "test") as folder:
        watchers = (files, lambda state: kept.append(onlinebayes.load_policy(tmp_path)))
        state = run_in_folder(trainer, PRIOR, folder, judge=lambda _: {"return": next(scores)}, watchers=watchers)
    best, last = onlinebayes.load_policy(tmp_path / "best"), onlinebayes.load_policy(tmp_path)
    assert [best.card.origin.mean_return, last.card.origin.mean_return] == [7.0, 3.0]
    assert kept[0].card.origin.trained_in == "worlds of the prior"
    assert last.card.origin.trained_in.startswith("worlds of the belief: length ")
    assert last.card.origin.frames == state.frames
    for policy, same in ((best, kept[1]), (last, kept[2])):
        assert all(
            (a.weight == b.weight).all() for a, b in zip(policy.network.layers, same.network.layers, strict=True)
        )
    belief = saving.load(tmp_path / "belief.safetensors", PRIOR.space)
    draws = [each.sample((9,), torch.Generator().manual_seed(0)) for each in (belief, state.belief)]
    assert torch.equal(*draws)


def test_a_policy_that_cannot_be_exported_is_said_once_and_costs_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("safetensors")

    class Planner(TensorDictModuleBase):
        def set_belief(self, belief: object, /) -> None:
            """Nothing."""

    state = OnlineState.begin(PRIOR)
    files = PolicyFiles(tmp_path, "test", Planned(Planner()), PROBLEM)
    for _ in range(2):
        state.complete({}, None)
        files(state)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith("no policy.safetensors is written: a policy with Planner cannot be exported; ")
    assert {path.name for path in tmp_path.iterdir()} == {"belief.safetensors"}
