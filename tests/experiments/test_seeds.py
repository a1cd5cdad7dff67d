"""A run for each seed, and one page of what they have in common."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import pytest

from onlinebayes.experiments import Settings, main, place_of, running
from onlinebayes.experiments.seeds import write_seeds

LOG = "step,frames,figure/return,figure/gain\n1,100,{0},1\n2,200,{1},\n"


def run(place: Path, returns: tuple[float, ...], more: str = "") -> Path:
    place.mkdir(parents=True)
    (place / "log.csv").write_text(LOG.format(*returns) + more)
    return place


def rows(place: Path) -> list[dict[str, str]]:
    with (place / "seeds.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_curves_are_medians_and_quartiles_over_seeds(tmp_path: Path) -> None:
    folders = {seed: run(tmp_path / str(seed), (seed, 10.0 * seed)) for seed in range(1, 6)}
    said = write_seeds(tmp_path, "pendulum", folders)
    assert said == "return, median of 5 seeds: 30 (quartiles 20 and 40)"
    found = rows(tmp_path)
    assert [row["return/median"] for row in found] == ["3.0", "30.0"]
    assert [row["return/upper quartile"] for row in found] == ["4.0", "40.0"]
    assert [row["gain/median"] for row in found] == ["1.0", "nan"]
    page = (tmp_path / "run.html").read_text("utf-8")
    assert "5 seeds, 2 steps" in page
    assert page.count("<svg") == 2


def test_runs_of_different_length_share_their_first_steps(tmp_path: Path) -> None:
    longer = run(tmp_path / "1", (3.0, 4.0), "3,300,9,\n")
    write_seeds(tmp_path, "pendulum", {0: run(tmp_path / "0", (1.0, 2.0)), 1: longer})
    assert [row["return/median"] for row in rows(tmp_path)] == ["2.0", "3.0"]


def test_each_seed_has_a_run_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Settings] = []

    def in_folder(name: str, made: object, settings: Settings) -> int:
        asked.append(settings)
        run(place_of(name, settings), (0.0, float(settings.seed)))
        return 1 if settings.seed == 4 else 0

    class Made:
        def close(self) -> None:
            """Nothing was started."""

    monkeypatch.setattr(running, "in_folder", in_folder)
    monkeypatch.setattr(running, "built", lambda build, settings: Made())
    monkeypatch.setattr(sys, "argv", ["own", "--seeds", "2..4", "--out", str(tmp_path), "--noise", "0.1"])
    assert main("own", lambda settings: None, None) == 1, "one of them missed its goal"
    place = tmp_path / "own-online-seeds"
    assert [(one.seed, one.seeds, one.noise) for one in asked] == [(2, "", 0.1), (3, "", 0.1), (4, "", 0.1)]
    assert {path.name for path in place.iterdir()} == {*(f"own-online-{k}" for k in (2, 3, 4)), "run.html", "seeds.csv"}
    said = capsys.readouterr().out
    assert "return, median of 3 seeds: 3 (quartiles 2.5 and 3.5)" in said
    assert f"onlinebayes show {place}" in said


def test_a_stop_ends_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def one(name: str, build: object, settings: Settings) -> int:
        asked.append(settings.seed)
        run(place_of(name, settings), (0.0, 0.0))
        return running.STOPPED if settings.seed == 1 else 0

    monkeypatch.setattr(running, "run", one)
    all_seeds = Settings(seeds="0..3", out=str(tmp_path))
    assert running.each_seed("own", lambda settings: None, all_seeds) == running.STOPPED
    assert asked == [0, 1]
    assert len(rows(tmp_path / "own-online-seeds")) == 2, "what is complete is shown"
