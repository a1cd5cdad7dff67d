"""The study of the rigs: which answers are right, what is kept, and a sample of its cases."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import recipes.studies.jobs as jobs_module
from envs.rigs import LEVELS, RIGS, case, effect_case, sized_case
from onlinebayes.criticism import compare, refine
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import EFFECTS, Scales
from recipes.studies.blind_rigs.__main__ import Study, main
from recipes.studies.blind_rigs.judging import judge, loaded
from recipes.studies.blind_rigs.names import answer, spelt
from recipes.studies.blind_rigs.plan import Job, jobs
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.blind_rigs.table import tabulate, wilson
from recipes.studies.blind_rigs.truth import in_floors, true_error, true_values
from recipes.studies.jobs import record
from recipes.studies.spawned import Failed

# Making a case takes seconds with shapes checked, and tests/envs checks them.
unchecked = pytest.mark.usefixtures("without_shape_checks")
NAMED = Judged(
    "slide_drive",
    "effect",
    1,
    hidden=("dry_friction@carriage",),
    verdict="missing_effect",
    accepted=("dry_friction@carriage",),
    first="dry_friction@carriage",
    before=3.0,
    after=1.1,
    reference=1.0,
)


# --- which answers are right -----------------------------------------------------------------------------------------


def test_a_hidden_effect_is_spelt_with_its_axis() -> None:
    assert spelt("com_offset@bob", {"com_offset@bob.x": 0.01}) == "com_offset@bob.x"
    assert spelt("gravity_tilt@world", {"gravity_tilt@world.angle": 0.01}) == "gravity_tilt@world.x"
    assert spelt("dry_friction@hinge", {}) == "dry_friction@hinge"


def test_partners_compositions_and_simpler_effects_are_told_from_wrong_ones() -> None:
    load = answer("slide_drive", "constant_load@carriage")
    assert load.found(["gravity_tilt@world.x"])
    assert not load.found(["joint_stiffness@carriage"])
    asymmetric = answer("slide_drive", "asymmetric_friction@carriage")
    assert asymmetric.found(["dry_friction@carriage", "gravity_tilt@world.x"])
    assert not asymmetric.found(["dry_friction@carriage"])
    assert asymmetric.admits("dry_friction@carriage")
    stribeck = answer("slide_drive", "stribeck_friction@carriage")
    assert stribeck.admits("dry_friction@carriage")
    assert not stribeck.found(["dry_friction@carriage"])
    assert not stribeck.admits("constant_load@carriage")


def test_every_rule_sees_its_fault() -> None:
    assert (NAMED.right, NAMED.first_right, NAMED.all_found, NAMED.innocent, NAMED.missed) == (
        True,
        True,
        True,
        (),
        False,
    )
    assert NAMED.share == pytest.approx(0.95)
    wrong = replace(NAMED, first="quadratic_drag@carriage", accepted=("quadratic_drag@carriage",))
    assert (wrong.right, wrong.first_right, wrong.innocent) == (True, False, ("quadratic_drag@carriage",))
    tied = replace(wrong, verdict="tie", equal=("dry_friction@carriage",))
    assert (tied.first_or_tied, tied.innocent, tied.accused) == (True, wrong.innocent, ())
    beside = replace(tied, accepted=(*tied.accepted, "cogging@carriage"))
    assert (wrong.accused, beside.accused) == (wrong.innocent, ("cogging@carriage",))
    extra = replace(NAMED, accepted=("dry_friction@carriage", "cogging@carriage"))
    assert (extra.all_found, extra.innocent, extra.missed) == (True, ("cogging@carriage",), True)
    pair = replace(NAMED, hidden=("dry_friction@carriage", "constant_load@carriage"))
    assert not pair.all_found
    assert replace(NAMED, ended="out of time", verdict="", accepted=(), first="").missed


def test_the_measured_ratio_decides_the_size_and_faint_effects_do_not_count() -> None:
    sizes = [replace(NAMED, before=b).size for b in (1.2, 1.5, 2.0, 4.0)]
    assert sizes == ["faint", "weak", "medium", "strong"]
    faint = replace(NAMED, before=1.2, verdict="adequate", accepted=(), first="")
    assert (faint.counts, faint.missed) == (False, False)
    assert replace(faint, accepted=("cogging@carriage",)).missed
    assert replace(NAMED, before=None, level="weak").size == "weak"


def test_a_pair_of_which_one_is_faint_beside_the_other_counts_but_not_among_those_that_both_show() -> None:
    pair = replace(NAMED, hidden=("dry_friction@carriage", "constant_load@carriage"))
    beside = {"dry_friction@carriage": 2.5, "constant_load@carriage": 1.01}
    faint = replace(pair, seed=2, beside=beside, refused={"constant_load@carriage": "rank 9"})
    clear = replace(pair, seed=3, beside=dict.fromkeys(beside, 1.4), accepted=pair.hidden)
    assert [judged.shows for judged in (pair, faint, clear)] == [False, False, True]
    table = tabulate([faint, clear], 2)
    rows = {row.name: row for row in table.rows}
    assert (rows["two effects: both accepted"].value, rows["two effects: both accepted"].unit) == (0.5, "1 of 2")
    assert rows["two effects that both show: both accepted"].unit == "1 of 1"
    assert "without it the true model errs 1.01 times" in rows[f"MISS {faint.name}"].unit


@pytest.mark.parametrize(
    ("kind", "fields", "right"),
    [
        ("null", {"verdict": "adequate"}, True),
        ("null", {"verdict": "missing_effect"}, False),
        ("outside", {"verdict": "unexplained"}, True),
        ("bounds", {"verdict": "bounds_exclude_truth", "fault": "a", "widened": ("a",)}, True),
        ("bounds", {"verdict": "bounds_exclude_truth", "fault": "a", "widened": ("b",)}, False),
        ("short", {"verdict": "insufficient_data"}, True),
        ("wiring", {"verdict": "missing_effect", "fault": "sign qpos.carriage"}, False),
        ("wiring", {"verdict": "data_problem", "fault": "sign qpos.a", "wiring": "qpos.a: the reversed sign"}, True),
        (
            "wiring",
            {"verdict": "data_problem", "fault": "command_unit ctrl.a 10", "wiring": "degrees for radians"},
            False,
        ),
        (
            "wiring",
            {"verdict": "data_problem", "fault": "command_unit ctrl.a 10", "wiring": "ten times too large"},
            True,
        ),
        ("tie", {"verdict": "tie", "accepted": ("viscous_friction@carriage",), "equal": ("back_emf@motor",)}, True),
        ("tie", {"verdict": "tie", "accepted": ("viscous_friction@carriage",), "equal": ("armature@carriage",)}, False),
        ("tie", {"verdict": "missing_effect", "accepted": ("back_emf@motor",)}, False),
    ],
)
def test_each_kind_has_its_right_verdict(kind: str, fields: dict[str, object], right: bool) -> None:
    hidden = ("back_emf@motor",) if kind == "tie" else ()
    asked = Judged("slide_drive", kind, 1, hidden=hidden, partners=("viscous_friction@carriage",) if hidden else ())
    assert replace(asked, **fields).right is right  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "right"),
    [
        ({"verdict": "bounds_exclude_truth", "accepted": ("body.pole.inertia[1]",)}, True),
        ({"verdict": "missing_effect", "accepted": ("armature@hinge",)}, True),
        ({"verdict": "bounds_exclude_truth", "accepted": ("actuator.motor.gear[0]",)}, True),  # one ratio is left
        ({"verdict": "tie", "accepted": ("dry_friction@hinge",), "equal": ("body.pole.inertia[1]",)}, True),
        ({"verdict": "tie", "accepted": ("dry_friction@hinge",), "equal": ("dry_friction@slider",)}, False),
        ({"verdict": "bounds_exclude_truth", "accepted": ("body.cart.mass",)}, False),
        ({"verdict": "adequate"}, False),
    ],
)
def test_a_number_that_is_off_may_be_named_by_itself_or_by_the_law_that_it_is(
    fields: dict[str, object], right: bool
) -> None:
    asked = Judged("cart_pole", "own", 1, hidden=("body.pole.inertia[1]",), before=3.0, reference=1.0)
    assert replace(asked, **fields).right is right  # type: ignore[arg-type]
    assert replace(asked, **fields).missed is not right  # type: ignore[arg-type]


def test_a_passive_term_is_taken_away_by_its_number_or_by_its_effect() -> None:
    asked = Judged("swing", "surplus", 1, hidden=("joint.hinge.frictionloss",), verdict="bounds_exclude_truth")
    assert replace(asked, accepted=("joint.hinge.frictionloss",)).right
    assert replace(asked, accepted=("dry_friction@hinge",), verdict="missing_effect").right
    assert not replace(asked, accepted=("joint.hinge.armature",)).right
    both = replace(asked, accepted=("joint.hinge.frictionloss", "cogging@hinge"))
    assert both.accused == ("cogging@hinge",)
    rows = {row.name: row for row in tabulate([both], 1).rows}
    assert (rows["surplus: verdict right"].value, rows["surplus: verdict right"].goal) == (1.0, ">= 0.9")


def test_an_effect_named_by_the_models_number_that_is_the_same_law_is_right() -> None:
    numbered = replace(NAMED, rig="swing", hidden=("com_offset@bob.x",), verdict="bounds_exclude_truth")
    numbered = replace(numbered, accepted=("body.bob.ipos[0]",), first="body.bob.ipos[0]")
    assert (numbered.right, numbered.first_right, numbered.missed) == (True, True, False)
    assert not replace(numbered, accepted=("body.bob.inertia[1]",)).right


def test_a_case_survives_its_file() -> None:
    judged = replace(NAMED, refused={"a@b": "weak"}, widened=("x",), gain=3.0)
    kept = json.loads(json.dumps({**asdict(judged), "code": "of before"}))
    assert record(Judged, kept) == judged


# --- the study -------------------------------------------------------------------------------------------------------


@pytest.mark.long
@unchecked
def test_the_plan_mixes_kinds_and_rigs_and_levels_come_in_turn() -> None:
    plan = jobs({"effect": 6, "null": 3}, RIGS, 1000)
    assert len(plan) == len(set(plan)) == 8 * 9
    assert {job.rig for job in plan[:16]} == set(RIGS)
    assert {job.kind for job in plan[:16]} == {"effect", "null"}
    assert [case("thrown_ball", "effect", seed).level for seed in (0, 1, 2)] == list(LEVELS)


@pytest.mark.long
@unchecked
def test_a_study_goes_on_from_its_finished_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Job] = []

    def spawned(todo: Iterable[partial[dict[str, Any]]], processes: int, limit: float) -> Iterator[tuple[int, object]]:
        for number, each in enumerate(todo):
            (job, most) = each.args
            if len(asked) == 3:
                asked.append(job)
                raise KeyboardInterrupt
            asked.append(job)
            answer = asdict(Judged(job.rig, job.kind, job.seed, verdict="unexplained", seconds=5.0))
            yield number, Failed("out of time", 4 * most) if job.kind == "null" else answer

    few = Study(
        effects=3, null=1, others=0, rigs=("thrown_ball", "swing"), first=0, out=tmp_path, results=tmp_path / "r"
    )
    monkeypatch.setattr(jobs_module, "spawned", spawned)
    assert main(few) == 130
    assert "3 of 8 are kept" in capsys.readouterr().err
    assert "| cases judged | 3 |" in (few.results / "blind-rigs.md").read_text()
    assert main(few) == 0
    assert len(asked) == 9  # eight and the one that was interrupted
    assert len(set(asked)) == 8
    assert "cases out of time: 2" in capsys.readouterr().out
    assert "MISS swing-null-0" in (few.results / "blind-rigs.md").read_text()
    assert len((few.results / "blind-rigs-cases.jsonl").read_text().splitlines()) == 8


@pytest.mark.parametrize(
    ("study", "problem"),
    [
        (Study(rigs=("crane",)), "crane is unknown"),
        (Study(processes=0), "0 processes"),
    ],
)
def test_what_cannot_be_run_is_refused(study: Study, problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        main(study)


def test_the_table_counts_and_lists_every_miss() -> None:
    wrong = replace(
        NAMED,
        seed=2,
        accepted=("quadratic_drag@carriage",),
        first="quadratic_drag@carriage",
        refused={"dry_friction@carriage": "rank 2: p = 0.2"},
    )
    quiet = [Judged("swing", "null", k, verdict="adequate", before=1.0, after=1.0) for k in range(3)]
    rows = {row.name: row for row in tabulate([NAMED, wrong, *quiet], 6).rows}
    assert (rows["cases judged"].value, rows["cases judged"].goal, rows["cases judged"].holds) == (5, "6", False)
    assert (rows["one effect: ranked first"].unit, rows["one effect: ranked first"].holds) == ("1 of 2", False)
    assert (rows["null: something accepted"].value, rows["null: something accepted"].holds) == (0.0, True)
    assert rows["dry_friction: one effect ranked first"].value == 0.5
    assert "dry_friction@carriage rank 2: p = 0.2" in rows["MISS slide_drive-effect-2"].unit
    assert "MISS slide_drive-effect-1" not in rows
    low, high = wilson(0, 100)
    assert (low, high) == pytest.approx((0.0, 0.037), abs=1e-3)


# --- the reference, and sizes ----------------------------------------------------------------------------------------


@pytest.mark.long
@unchecked
def test_the_true_effect_brings_the_held_out_error_to_the_floor() -> None:
    made = effect_case("thrown_ball", "viscous_friction@x", "strong", 3)
    problem = loaded(made)
    compared = compare(problem.simulator, problem.measurement, holdout=problem.holdout)
    error = compared.heldout_error
    reference = true_error(made, problem, compared.base.simulator, error.noise_floor)
    assert reference is not None
    # Twelve two-second runs, two held out: four windows decide, whose starts are a good or a bad guess.
    assert 0.5 < reference < 1.6
    assert in_floors(error.before, error.noise_floor) > 2 * reference


@pytest.mark.long
@unchecked
def test_the_truth_is_found_under_the_librarys_names() -> None:
    made = effect_case("swing", "com_offset@bob", "medium", 1)
    problem = loaded(made)
    model = problem.simulator.with_effect(EFFECTS["com_offset"].scaled("bob.x", Scales(1.0, 1.0, 1.0, 1.0)))
    values = true_values(made, model)
    assert values["com_offset@bob.x.x"] == made.truth["com_offset@bob.x"]
    assert values["body.bob.mass"] == made.truth["body.bob.mass"]


@pytest.mark.long
@unchecked
def test_an_effect_of_no_size_leaves_the_null_case() -> None:
    rig = RIGS["thrown_ball"]
    nothing, plain = sized_case(rig, rig.effects[-1], 0.0, 900), case(rig.name, "null", 900)
    for name, column in plain.columns["fit1"].items():
        np.testing.assert_array_equal(column, nothing.columns["fit1"][name])


def test_all_that_a_blind_case_hides_is_tried_without_being_named() -> None:
    for rig in RIGS.values():
        # Play behind a motor is tried where it is named, behind a servo always.
        named = {"backlash"} if not any(actuator.servo for actuator in rig.actuators) else set()
        last = {name for name, effect in EFFECTS.items() if effect.tried_last}
        assert all(effect.key.split("@")[0] in EFFECTS.keys() - named - last for effect in rig.effects)
        assert all(effect.key.split("@")[0] in last for effect in rig.last)
        assert all(effect.key.split("@")[0] in named for effect in rig.by_name)
        assert not any(effect.key.split("@")[0] in EFFECTS for effect in rig.outside)


# --- a sample of the study -------------------------------------------------------------------------------------------


@unchecked
@pytest.mark.long
@pytest.mark.parametrize(
    ("rig", "kind", "seed"),
    [
        ("swing", "effect", 0),
        ("swing", "null", 0),
        ("thrown_ball", "null", 0),
        ("thrown_ball", "bounds", 0),
        ("swing", "wiring", 0),
        ("thrown_ball", "short", 0),
    ],
)
def test_a_case_is_answered_rightly(rig: str, kind: str, seed: int) -> None:
    judged = Judged(**judge(Job(rig, kind, seed)))
    assert not judged.missed
    assert judged.counts


@pytest.mark.long
def test_wind_takes_the_place_of_the_drag_and_the_load_that_it_was_taken_for() -> None:
    made = effect_case("thrown_ball", "wind@world", "medium", 0)
    problem = loaded(made)
    found = refine(problem.simulator, problem.measurement, holdout=problem.holdout, selection=problem.selection)
    assert found.accepted == ("wind@ball.x",)
    assert found.verdict == "missing_effect"
    assert found.remainder.status == "noise"
