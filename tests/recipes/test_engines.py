"""The study of two engines: what it makes of a report, what the model lacks, and one case in each direction."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.hopper.standard import JOINTS
from onlinebayes.runs import ResultTable
from recipes.studies.engines import add_case, judged, judgement
from recipes.studies.engines_data import CASES, FLYING, Case, model_of, touching_nothing

MISSING, SURPLUS = Case("damping", "missing"), Case("armature", "surplus")


def report(case: Case, accepted: tuple[str, ...], values: tuple[float, ...]) -> dict:
    ends = {"viscous_friction": ".damping", "joint": ""}
    names = [f"{key}{ends[key.partition('@')[0].partition('.')[0]]}" for key in accepted]
    return {
        "verdict": "missing_effect",
        "accepted": list(accepted),
        "parameters": {
            name: {"mean": value} for name, value in zip(["body.torso.mass", *names], [3.7, *values], strict=True)
        },
        "heldout_error": {
            "before": {"qpos.rooty": 0.006, "qpos.rootx": 0.001},
            "after": {"qpos.rooty": 0.001, "qpos.rootx": 0.001},
            "noise_floor": {"qpos.rooty": 0.001, "qpos.rootx": 0.001},
        },
    }


def test_a_law_is_named_at_all_three_joints_or_not_at_all() -> None:
    keys = tuple(f"viscous_friction@{joint}" for joint in JOINTS)
    found = judgement(MISSING, report(MISSING, keys, (1.0, 0.99, 1.005)))
    assert found["right"]
    assert found["off"] == pytest.approx(1.0)
    assert (found["before"], found["after"]) == pytest.approx((6.0, 1.0))
    assert not judgement(MISSING, report(MISSING, keys[:2], (1.0, 1.0)))["right"]
    own = tuple(f"joint.{joint}.armature" for joint in JOINTS)
    assert judgement(SURPLUS, report(SURPLUS, own, (0.0, 0.02, 0.0)))["off"] == pytest.approx(2.0)


def test_a_case_that_is_missed_has_a_row_that_says_so() -> None:
    missed = {**judgement(MISSING, report(MISSING, ("viscous_friction@rooty",), (0.1,))), "seconds": 200.0}
    table = ResultTable("engines", "make engines", [1])
    add_case(table, MISSING, [missed])
    rows = {row.name: row for row in table.rows}
    assert rows["MISS damping of the joints, missing in the model, seed 1"].value == "viscous_friction@rooty"
    assert [row.holds for row in table.rows].count(False) == 2  # the name and the time


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_model_lacks_what_it_should_and_keeps_the_rest(case: Case) -> None:
    model = model_of(case).compile()
    kept = {"damping": model.dof_damping[3:], "armature": model.dof_armature[3:]}
    for law, values in kept.items():
        lacking = case.side == "missing" and law == case.law
        assert (values == (0.0 if lacking else 1.0)).all(), law
    assert mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, 0) == "thigh"


def test_runs_that_touch_something_are_not_kept() -> None:
    model = model_of(MISSING).compile()
    path = np.repeat([FLYING], 3, axis=0)
    path[1, 4], path[2, 1] = -0.01, 0.3  # a leg at its end, a torso near the floor
    assert touching_nothing(model, path).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("case", "seed"),
    [
        pytest.param(MISSING, 11, marks=pytest.mark.slow, id="missing"),
        pytest.param(SURPLUS, 1, marks=pytest.mark.long, id="surplus"),
    ],
)
def test_what_parts_the_engines_is_named_and_sized(case: Case, seed: int, tmp_path: Path) -> None:
    """Seed 11 of the surplus is named and sized too, but leaves three floors: see docs/log.md."""
    pytest.importorskip("pydrake", reason="needs the extra robotics")
    found = judged(case, seed, str(tmp_path))
    assert found["right"], found["accepted"]
    assert found["off"] < 1.0
    assert found["after"] < 1.5 < found["before"]
