"""What recipes and studies refuse of the command line, and what they take from other runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from onlinebayes.experiments import baselines, place_of, recorded_settings
from onlinebayes.runs import BadInput
from recipes import fetch_push, fetch_reach, fetch_slide, hopper
from recipes.studies import engines, fetch, fetch_friction, versus_sbi
from recipes.studies.jobs import each_kept_or_done, printed_by


@pytest.mark.parametrize("recipe", [fetch_push, fetch_reach, fetch_slide])
def test_noise_where_the_sensors_are_exact_is_refused(recipe) -> None:
    with pytest.raises(BadInput, match="needs noise 0"):
        recipe.Settings(noise=0.1)


@pytest.mark.parametrize("low", [-0.5, 0.0, 0.4])
def test_a_prior_of_the_hoppers_friction_without_its_truth_is_refused(low: float) -> None:
    with pytest.raises(BadInput, match=r"needs \.05 <= low <= 0.35"):
        hopper.Settings(low=low)


@pytest.mark.parametrize(
    ("study", "name"),
    [
        (engines, "cases"),
        (fetch, "cases"),
        (fetch_friction, "questions"),
        (versus_sbi, "tasks"),
    ],
)
def test_a_name_that_a_study_does_not_know_is_refused(study, name: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="nope is unknown; known: "):
        study.main(study.Study(**{name: ("nope",), "results": tmp_path}))
    assert not list(tmp_path.iterdir())


def test_a_table_of_a_part_says_so() -> None:
    assert printed_by("fetch", fetch.Study(out="elsewhere")) == "make fetch"
    assert printed_by("fetch", fetch.Study(seeds=(1,))) == "make fetch (a part)"


def test_a_baseline_has_the_same_settings_but_for_its_kind(tmp_path: Path) -> None:
    mine = hopper.Settings(out=str(tmp_path))
    for kind, low in (("prior", 0.3), ("oracle", 0.1)):
        other = replace(mine, kind=kind, low=low)
        place = place_of("hopper", other)
        place.mkdir()
        (place / "run.json").write_text(json.dumps({"recipe": "hopper", "settings": recorded_settings(other)}))
        (place / "log.csv").write_text("step,figure/return\n1,10\n2,20\n")
    assert baselines("hopper", mine) == {"prior": 20.0}


def test_jobs_that_other_code_did_are_kept_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs = {1: lambda: {"value": 1}, 2: lambda: {"value": 2}}
    assert each_kept_or_done("study", tmp_path, jobs, str) == {1: {"value": 1}, 2: {"value": 2}}
    assert "other code" not in capsys.readouterr().out
    monkeypatch.setattr("recipes.studies.jobs.code_mark", lambda packages: "other")
    assert each_kept_or_done("study", tmp_path, jobs, str) == {1: {"value": 1}, 2: {"value": 2}}
    assert f"study: other code did 2 of 2 jobs in {tmp_path}" in capsys.readouterr().out


def test_a_table_of_kept_jobs_names_the_commits_that_did_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "0.json").write_text('{"value": 0}')  # kept by a study that told no commit
    for each in ("bbb", "aaa+"):
        monkeypatch.setattr("recipes.studies.jobs.commit", lambda each=each: each)
        found = each_kept_or_done("study", tmp_path, {len(each): lambda: {"value": 1}}, str)
        assert found.commit == each
    monkeypatch.setattr("recipes.studies.jobs.commit", lambda: "ccc")
    found = each_kept_or_done("study", tmp_path, {i: lambda: {"value": 1} for i in (0, 3, 4)}, str)
    assert found.commit == "aaa+, bbb, unknown"
    assert found == {0: {"value": 0}, 3: {"value": 1}, 4: {"value": 1}}
