"""The study of exclusion limits: what is put into a record, what counts as found, and that it goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

import recipes.studies.exclusion_limits.__main__ as study_module
from envs.rigs import RIGS, sized_case
from onlinebayes.runs import BadInput
from recipes.studies.blind_rigs.workers import Done
from recipes.studies.exclusion_limits.__main__ import Study, main
from recipes.studies.exclusion_limits.probing import Prober, of_one_size
from recipes.studies.exclusion_limits.record import TIMES, Probe, Record, from_json
from recipes.studies.exclusion_limits.table import tabulate
from recipes.studies.job import Job
from recipes.studies.json_line import line

unchecked = pytest.mark.usefixtures("without_shape_checks")

FOUND = Probe("swing", 3, "quadratic_drag@hinge", 0.002, "missing_effect", ("quadratic_drag@hinge",), seconds=9.0)
MISSED = replace(FOUND, effect="armature@hinge", accepted=(), verdict="adequate", refused="rank 2, gain 3 ± 2: p 0.2")


@pytest.mark.parametrize("rig", RIGS)
def test_every_effect_of_one_size_has_its_turn(rig: str) -> None:
    whole = of_one_size(RIGS[rig], 0)
    assert whole
    assert not {"thermal_derating", "actuator_saturation", "stribeck_friction"} & {e.key.split("@")[0] for e in whole}
    keys = [effect.key for effect in whole]
    assert [effect.key for effect in of_one_size(RIGS[rig], 4)] == keys[4 % len(keys) :] + keys[: 4 % len(keys)]


@pytest.mark.long
def test_the_record_is_the_one_without_the_effect_but_for_its_motion() -> None:
    rig = RIGS["swing"]
    drag = next(effect for effect in rig.effects if effect.key == "quadratic_drag@hinge")
    without, little = sized_case(rig, None, 1.0, 5), sized_case(rig, drag, 0.5, 5)
    added = little.truth.keys() - without.truth.keys()
    assert added == {"quadratic_drag@hinge.drag"}
    assert little.truth["quadratic_drag@hinge.drag"] == 0.5 * drag.size["drag"]
    assert all(little.truth[name] == value for name, value in without.truth.items())
    (before, after) = (case.columns["fit1"]["ctrl.motor"] for case in (without, little))
    assert (before == after).all()


def test_found_is_accepted_or_tied_with_what_was() -> None:
    assert FOUND.found
    assert not MISSED.found
    assert replace(MISSED, verdict="tie", accepted=("sensor_bias@qpos.hinge",), equal=(MISSED.effect,)).found
    assert not replace(MISSED, accepted=("dry_friction@hinge",)).found


def test_a_record_is_read_as_it_was_written() -> None:
    record = Record("swing", 3, "adequate", 11, ("cogging@hinge",), (FOUND, MISSED))
    assert from_json(line(record)) == record
    with pytest.raises(ValueError, match="record of limits"):
        from_json(line(FOUND))


def test_the_table_counts_and_lists_every_miss() -> None:
    records = [Record("swing", 3, "adequate", 11, ("cogging@hinge",), (FOUND, MISSED)), Record("swing", 4, ended="x")]
    table = tabulate(records, 3)
    rows = {row.name: row for row in table.rows}
    share = rows[f"{TIMES:g} times the exclusion limit: found"]
    assert (share.value, share.unit, share.holds) == (0.5, "1 of 2", False)
    assert rows["records"].holds is False
    assert rows["effects with a limit"].unit.startswith("of 12")
    assert "rank 2" in rows["MISS swing-armature@hinge-3"].unit
    assert rows["NO ANSWER swing-limits-4"].value == "x"


@unchecked
def test_the_study_goes_on_from_its_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Job] = []

    def work(jobs: Sequence[Job], do: Prober, processes: int, limit: float) -> Iterator[Done[Job, Record]]:
        for job in jobs:
            if len(asked) == 3:
                asked.append(job)
                raise KeyboardInterrupt
            asked.append(job)
            probe = replace(FOUND, rig=job.rig, seed=job.seed, code=do.code)
            yield Done(job, Record(job.rig, job.seed, "adequate", 11, (), (probe,)), "", 1.0)

    study = Study(records=3, rigs=("swing", "slide_drive"), out=tmp_path / "out", results=tmp_path / "r")
    monkeypatch.setattr(study_module, "work", work)
    assert main(study) == 130
    assert "3 of 6 records are kept" in capsys.readouterr().err
    assert main(study) == 0
    assert len(asked) == 7  # the six, one of them twice
    assert "6 records, 3 of them probed before" in capsys.readouterr().err
    assert "| records | 6 |" in (study.results / "exclusion-limits.md").read_text()


@pytest.mark.parametrize(
    ("study", "problem"), [(Study(rigs=("crane",)), "crane is unknown"), (Study(records=0), "0 records")]
)
def test_what_cannot_be_run_is_refused(study: Study, problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        main(study)


@pytest.mark.long
def test_a_swing_shows_what_its_limit_promises() -> None:
    record = Prober(each=2)(Job("swing", "limits", 0))
    assert record.verdict == "adequate"
    assert [probe.found for probe in record.probes] == [True, True]
