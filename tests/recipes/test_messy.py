"""The study of messy machines: which answers are right, its figures, how it goes on."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

import recipes.studies.messy as study_module
from recipes.studies.messy import Found, Study, ask, main, tabulate, unanswered
from recipes.studies.spawned import Failed

NAMED = Found(
    "cart_pole-8002",
    hidden=("dry_friction@hinge",),
    small=("body.pole.ipos[2]", "sensor_delay@qpos.slider"),
    verdict="missing_effect",
    accepted=("dry_friction@hinge",),
    errors=(1.0, 0.4),
    reference=0.35,
    shows=0.2,
    floors=12.0,
    seconds=30.0,
)


def test_what_dominates_is_told_from_what_does_not_and_from_what_is_not_there() -> None:
    assert (NAMED.named_first, NAMED.small_first, NAMED.false, NAMED.worse, NAMED.counts) == (
        True,
        False,
        (),
        False,
        True,
    )
    assert NAMED.share == pytest.approx(0.6 / 0.65)
    small = replace(NAMED, accepted=("com_offset@pole.z", "dry_friction@hinge"), errors=(1.0, 0.9, 0.4))
    assert (small.named_first, small.small_first, small.all_named, small.false) == (False, True, True, ())
    wrong = replace(NAMED, accepted=("dry_friction@hinge", "cubic_stiffness@hinge"), errors=(1.0, 0.4, 0.5))
    assert (wrong.false, wrong.worse) == (("cubic_stiffness@hinge",), True)
    assert not replace(wrong, errors=(1.0, 0.4, 0.403)).worse
    tied = replace(NAMED, verdict="tie", accepted=("quadratic_drag@hinge",), equal=("joint.hinge.frictionloss",))
    assert (tied.named_first, tied.named_or_tied) == (False, True)
    assert not replace(NAMED, shows=0.9).counts
    assert replace(NAMED, reference=0.99).share is None
    assert not replace(NAMED, reference=None).counts


def test_a_number_that_dominates_may_be_named_by_its_law() -> None:
    number = replace(NAMED, hidden=("body.pole.ipos[0]",), accepted=("com_offset@pole.x",))
    assert number.named_first
    assert replace(number, accepted=("body.pole.ipos[0]",)).named_first


def test_the_table_counts_and_lists_misses() -> None:
    wrong = replace(NAMED, name="swing-8001", accepted=("cogging@hinge",), errors=(1.0, 1.1), reference=0.3)
    ended = Found("swing-8009", (), (), ended="the model cannot follow the measurement")
    rows = {row.name: row for row in tabulate([NAMED, wrong, ended], 8000).rows}
    assert rows["cases"].spread == "1 without an answer"
    assert (rows["what dominates accepted first"].unit, rows["what dominates accepted first"].holds) == (
        "1 of 2",
        False,
    )
    assert rows["something accepted that makes held-out runs worse"].value == 0.5
    assert "not there: cogging@hinge" in rows["MISS swing-8001"].unit
    assert rows["MISS swing-8009"].unit.startswith("no answer")
    assert f"MISS {NAMED.name}" not in rows


def test_a_case_without_an_answer_keeps_what_was_hidden() -> None:
    found = Found(**unanswered("thrown_ball-8903", Failed("out of time", 900.0)))
    assert (found.hidden, found.ended, found.counts) == (("constant_load@y",), "out of time", False)
    assert len(found.small) >= 6


def test_rigs_take_turns() -> None:
    names = Study(first=8900, cases=9).names
    assert len({name.rpartition("-")[0] for name in names}) == 8
    assert names[0].rpartition("-")[0] == names[8].rpartition("-")[0]


def test_finished_cases_are_not_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study(first=8900, cases=2, out=tmp_path, results=tmp_path / "results", processes=1)
    for name in study.names:
        (tmp_path / f"{name}.json").write_text(json.dumps(asdict(replace(NAMED, name=name))), encoding="utf-8")
    monkeypatch.setattr(study_module, "ask", lambda name: pytest.fail(name))
    assert main(study) == 0
    assert "| cases | 2 |" in (study.results / "messy.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_a_messy_ball_is_answered_and_its_truth_lowers_the_held_out_error() -> None:
    found = Found(**ask("thrown_ball-8903"))
    assert not found.ended
    assert found.verdict
    assert len(found.errors) == len(found.accepted) + 1
