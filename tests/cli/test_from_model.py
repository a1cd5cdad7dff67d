"""A model and its logs in the place of a problem file; the demonstration as a command."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import recipes.demo.__main__ as demonstration
from onlinebayes.cli import demo, work
from onlinebayes.cli.main import main
from onlinebayes.criticism import Criticism
from onlinebayes.problems import load_problem
from tests.report.synthetic import criticism, drive


@pytest.fixture(scope="module")
def result() -> Criticism:
    return criticism(rate=50.0, seconds=2.0, simulator=drive())


@pytest.fixture
def asked(folder: Path, monkeypatch: pytest.MonkeyPatch, result: Criticism) -> list[tuple[str, Path]]:
    """What the search was asked, in the folder of the model and the log; it answers at once."""
    questions: list[tuple[str, Path]] = []

    def answered(command, problem, _budget):
        questions.append((command, problem.path))
        return dataclasses.replace(result, command=command)

    monkeypatch.setattr(work, "criticise", answered)
    monkeypatch.chdir(folder)
    return questions


@pytest.mark.parametrize("command", ["compare", "diagnose", "refine"])
def test_a_draft_goes_into_the_output_folder_and_is_used(command, asked, capsys) -> None:
    out = Path("out") / f"carriage-{command}"
    assert main([command, "carriage.xml", "carriage.csv"]) == 0
    assert asked == [(command, out / "problem.toml")]
    told = capsys.readouterr().out
    assert "matched:   ctrl.motor <- ctrl.motor" in told
    assert f"wrote:     {out / 'problem.toml'}" in told
    assert load_problem(out / "problem.toml").holdout == ("second",)
    assert {"report.json", "report.html", "run.rrd"} <= {path.name for path in out.iterdir()}
    assert main([command, "carriage.xml", "carriage.csv"]) == 0, "the same draft may be written again"


def test_files_behind_added_effects_and_another_folder(asked) -> None:
    given = ["compare", "--out", "here", "--add", "dry_friction@carriage", "carriage.xml", "carriage.csv"]
    assert main(given) == 0
    assert asked == [("compare", Path("here/problem.toml"))]


def test_a_problem_file_that_was_edited_is_left_alone(asked, capsys) -> None:
    out = Path("here")
    out.mkdir()
    (out / "problem.toml").write_text("# mine\n")
    assert main(["refine", "carriage.xml", "carriage.csv", "--out", "here"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(
        f"onlinebayes: error: {out / 'problem.toml'}: is there already, and is not this draft; use it"
    )
    assert "onlinebayes refine here/problem.toml --out here" in error
    assert (out / "problem.toml").read_text() == "# mine\n"
    assert not asked


def test_what_a_draft_leaves_open_is_said_and_the_draft_stays(asked, folder, capsys) -> None:
    log = (folder / "carriage.csv").read_text().replace("ctrl.motor,qpos.carriage", "one,two")
    (folder / "carriage.csv").write_text(log)
    assert main(["refine", "carriage.xml", "carriage.csv", "--out", "here"]) == 2
    told = capsys.readouterr()
    assert "missing:   qpos.carriage" in told.out
    assert "the draft leaves open which columns are qpos.carriage, ctrl.motor; fill it in" in told.err.splitlines()[-1]
    assert [path.name for path in Path("here").iterdir()] == ["problem.toml"]
    assert not asked


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["carriage.xml"], "a model needs a log: give carriage.xml LOG"),
        (["carriage.csv", "carriage.xml"], "give one problem file, or a model (.xml, .mjcf, .urdf) and then its logs"),
        (["carriage.toml", "carriage.csv"], "give one problem file, or a model"),
        (["none.xml", "carriage.csv"], "none.xml: no such file; name the MJCF file of the model"),
        (["carriage.xml", "none.csv"], "none.csv: no such file"),
    ],
)
def test_files_that_do_not_go_together_are_one_line_and_leave_nothing(files, said, asked, capsys) -> None:
    assert main(["refine", *files, "--out", "here"]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not Path("here").exists()


def test_the_demonstration_is_played_where_it_is_installed(monkeypatch, tmp_path, capsys) -> None:
    played = []
    monkeypatch.setattr(demonstration, "main", played.append)
    assert main(["demo", "--out", str(tmp_path / "d"), "--seed", "3", "--short"]) == 0
    assert played == [demonstration.Settings(tmp_path / "d", 3, short=True)]
    (tmp_path / "file").write_text("")
    assert main(["demo", "--out", str(tmp_path / "file")]) == 2
    assert "is a file, not a folder; give --out a folder" in capsys.readouterr().err
    monkeypatch.setattr(demo, "PLACES", ("a_package_that_nobody_has",))
    assert main(["demo"]) == 2
    assert "the recipes are not installed" in capsys.readouterr().err
