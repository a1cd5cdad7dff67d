"""The study of measured machines: what it reports of a refine, and that every problem file loads."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from envs.measured import FOLDER
from onlinebayes.problems import load_problem
from onlinebayes.runs import Row
from onlinebayes.simulators.effects import EFFECTS
from recipes.studies import measured
from recipes.studies.measured import known_rows, sets, table
from recipes.studies.measured_rows import Refined

PROBLEMS = sorted(FOLDER.rglob("problem.toml"))

REPORT = {
    "verdict": "missing_effect",
    "accepted": ["dry_friction@servo"],
    "heldout_error": {
        "before": {"qpos.servo": 0.06},
        "after": {"qpos.servo": 0.02},
        "noise_floor": {"qpos.servo": 0.001},
        "horizon_s": {"qpos.servo": 1.0},
    },
    "parameters": {"joint.servo.damping": {"mean": 0.1, "sd": 0.01, "unit": "N m s/rad"}},
    "detail": {
        "windows": [
            {"signal": "qpos.servo", "run": "a", "held_out": True, "before": 0.03, "after": 0.01},
            {"signal": "qpos.servo", "run": "a", "held_out": True, "before": 0.04, "after": 0.07},
            {"signal": "qpos.servo", "run": "b", "held_out": False, "before": 9.0, "after": 9.0},
        ]
    },
}


def test_the_rows_of_a_report() -> None:
    refined = Refined("xl330", REPORT, 12.0)
    rows = {row.name: row for row in refined.rows("dry_friction", True, {"qpos.servo": "rad"})}
    assert rows["xl330: effects accepted, in order"].value == "dry_friction@servo"
    error = rows["xl330: held-out qpos.servo over 1 s, before"]
    assert (error.value, error.unit) == (pytest.approx(60.0), "mrad")
    assert rows["xl330: fall of that error"].value == pytest.approx(3.0)
    assert rows["xl330: fall of that error"].holds is True
    assert rows["xl330: joint.servo.damping"].spread == 0.01
    (before, after), *others = refined.by_run("qpos.servo").values()
    assert (before, after) == (pytest.approx((0.5 * 25e-4) ** 0.5), pytest.approx((0.5 * 50e-4) ** 0.5))
    assert not others


def test_sets_that_are_not_run_keep_their_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measured, "judge", lambda name, _data: (Row(f"{name}: verdict", "tie"),))
    file = table(["sts3250"], tmp_path, [Row("sts3250: verdict", "old"), Row("dart_car/floor: time", 1.0)]).write(
        tmp_path
    )
    assert known_rows(file) == (Row("dart_car/floor: time", 1.0), Row("sts3250: verdict", "tie"))
    assert not known_rows(tmp_path / "none.json")


def test_every_study_has_a_problem_or_says_where_it_is() -> None:
    assert sets()
    for name in sets():
        told = (FOLDER / name / "README.md").read_text(encoding="utf-8") if name == "so101" else ""
        assert any((FOLDER / name).rglob("problem.toml")) or "$ONLINEBAYES_DATA/sage_so101/problem.toml" in told


@pytest.fixture
def vocabulary() -> Iterator[None]:
    """What a problem's modules register is gone after the test."""
    registered = dict(EFFECTS)
    yield
    EFFECTS.clear()
    EFFECTS.update(registered)


@pytest.mark.slow
@pytest.mark.usefixtures("vocabulary")
@pytest.mark.parametrize("path", PROBLEMS, ids=[path.parent.name for path in PROBLEMS])
def test_the_problem_loads(path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ONLINEBAYES_DATA", str(data))
    problem = load_problem(path)
    assert problem.holdout
    assert set(problem.holdout) < set(problem.measurement.runs)
