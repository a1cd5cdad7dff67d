"""A run whose model grew, in its folder: the log, the recording and the page show when, and what came of it."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from onlinebayes.runs import RunFolder
from onlinebayes.trainers import Recording, SimulatedPlayer, run_in_folder
from tests.trainers.test_growing import NAME, PROBLEM, RUBS, SPACE, TRUTH, build, says


def rows_of(path: Path) -> dict[str, list[int]]:
    """Entity -> the steps at which it has rows."""
    found: dict[str, list[int]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if not chunk.is_static and "step" in chunk.timeline_names:
            table = chunk.to_record_batch()
            found.setdefault(chunk.entity_path, []).extend(table.column("step").to_pylist())
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_the_recording_shows_when_the_model_grew(tmp_path: Path) -> None:
    trainer = build(says(RUBS))
    policy = trainer.trainer.objective.policy

    def play(state):
        return SimulatedPlayer(trainer.problem, policy, TRUTH, PROBLEM)(state)

    recording = Recording(tmp_path, "test", PROBLEM.prior, play, TRUTH, further={NAME: 0.8})
    with RunFolder(tmp_path, "test") as folder, recording:
        run_in_folder(trainer, PROBLEM.prior, folder, watchers=(recording,))
    with (tmp_path / "log.csv").open(encoding="utf-8") as file:
        log = list(csv.DictReader(file))
    assert [row["grown"] for row in log] == ["", "dry_friction@hinge", "dry_friction@hinge"]
    assert [bool(row[f"belief/{NAME}/mean"]) for row in log] == [False, True, True]
    assert [bool(row["seconds/criticism"]) for row in log] == [False, True, False]
    steps = rows_of(tmp_path / "run.rrd")
    assert steps["/events"] == [2]
    assert steps["/criticism/effects\\ added"] == [2, 3]
    escaped = NAME.replace("@", "\\@")
    assert steps[f"/belief/{escaped}/truth"] == steps[f"/belief/{escaped}/mean"] == [2, 3]
    assert steps[f"/belief/{SPACE.names[0]}/mean"] == [1, 2, 3]
    page = (tmp_path / "run.html").read_text("utf-8")
    assert "the model grew: dry_friction@hinge" in page
    assert NAME in page
