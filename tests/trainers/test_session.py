"""A run in a folder: what it leaves, that it goes on there, and what it looks like."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import torch

from onlinebayes.runs import RunFolder
from onlinebayes.trainers import OnlineState, Recording, SimulatedPlayer, run_in_folder
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
    states, commands = play(PROBLEM, trainer.objective.policy, TRUTH)
    assert len(states) == len(commands) + 1
    ends = PROBLEM.task.terminated(states)
    assert bool(ends[-1])
    assert not ends[:-1].any()
    assert torch.equal(commands.abs(), torch.ones_like(commands))
