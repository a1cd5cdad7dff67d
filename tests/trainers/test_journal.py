"""A journal leaves what every run leaves; begun again it takes the place of the run before."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

import onlinebayes
from onlinebayes.inference import Box, BoxUniform
from onlinebayes.objectives import ppo
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Journal, PolicyFiles, Recording, SimulatedPlayer
from tests.loggers.test_recorder import entities
from tests.trainers.test_online import PRIOR, PROBLEM, SPACE, TRUTH
from tests.trainers.test_playing import after_a_step

NARROW = BoxUniform(SPACE, Box(SPACE, SPACE.to_unit(TRUTH) - 0.1, SPACE.to_unit(TRUTH) + 0.1))


def told(folder: Path) -> list[dict[str, str]]:
    player = SimulatedPlayer(PROBLEM, ppo(*PROBLEM.specs).policy, TRUTH)
    with Journal(folder, "mine", PRIOR, player, TRUTH, {"another": 9.0}) as journal:
        journal.step("policy", frames=100, losses={"loss_actor": 0.5}, figures={"return": 3.0})
        journal.step("belief", seconds=2.0, simulated=60, belief=NARROW, notes=["narrowed"])
    with (folder / "log.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_it_leaves_a_log_a_recording_and_a_page(tmp_path: Path) -> None:
    first, second = told(tmp_path)
    assert (first["frames"], first["loss/loss_actor"], first["figure/return"]) == ("100", "0.5", "3.0")
    assert (second["frames"], second["simulated"], second["notes"]) == ("100", "60", "narrowed")
    assert float(second["seconds/belief"]) == 2.0
    assert float(second["belief/length/mean"]) == pytest.approx(float(TRUTH[0]), abs=0.01)
    assert float(second["belief/length/sd"]) < float(first["belief/length/sd"]) / 3
    rows = entities(tmp_path / "run.rrd")
    assert rows["/belief/length/mean"] == 2
    assert rows["/returns/another"] == 1
    page = (tmp_path / "run.html").read_text("utf-8")
    for words in ("another", "An episode", "The belief", "narrowed", "median", "How it was made"):
        assert words in page


def test_it_leaves_a_policy_where_it_is_asked_to(tmp_path: Path) -> None:
    pytest.importorskip("safetensors")
    objective = ppo(*PROBLEM.specs)
    with Journal(tmp_path, "mine", PRIOR, watchers=(PolicyFiles(tmp_path, "mine", objective, PROBLEM),)) as journal:
        journal.step("policy", frames=100, figures={"return": 3.0})
    origin = onlinebayes.load_policy(tmp_path).card.origin
    assert (origin.recipe, origin.objective, origin.frames, origin.mean_return) == ("mine", "PPO", 100, 3.0)


def test_begun_again_it_takes_the_place_of_the_run_before(tmp_path: Path) -> None:
    told(tmp_path)
    assert len(told(tmp_path)) == 2
    assert [path.name for path in tmp_path.glob("*.rrd")] == ["run.rrd"]
    with pytest.raises(BadInput, match="a run of 'mine'"), Journal(tmp_path, "another", PRIOR):
        pass
    assert (tmp_path / "run.rrd").exists()


def test_a_policy_that_learns_alone_has_no_belief_to_show(tmp_path: Path) -> None:
    with Recording(tmp_path, "alone", PRIOR, truth=TRUTH, infers=False) as recording:
        recording(after_a_step(TRUTH))
    assert not [name for name in entities(tmp_path / "run.rrd") if "belief" in name or "corner" in name]
    page = (tmp_path / "run.html").read_text("utf-8")
    assert "nothing was inferred" in page
    assert "The belief" not in page
