"""Checks of an arm whose truth is known: what changed is named, sized and dated, and nothing else rings."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from onlinebayes.criticism import Check, check
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, FolderMemo, Memo
from tests.criticism.checking.rig import COVARIANCE, DAMPING, MASS, model, record


@pytest.fixture(scope="module")
def memo(tmp_path_factory: pytest.TempPathFactory) -> Memo:
    """The reference is fitted once."""
    return FolderMemo(Path(tmp_path_factory.mktemp("memo")))


@pytest.fixture(scope="module")
def reference() -> Measurement:
    return record(8, 0)


def checked(reference: Measurement, new: Measurement, memo: Memo) -> Check:
    return check(model(), COVARIANCE, reference, new, memo=memo)


def test_the_same_machine_holds(reference: Measurement, memo: Memo) -> None:
    found = checked(reference, record(3, 50, name="n"), memo)
    assert (found.verdict, found.changes) == ("holds", ())
    assert found.error.p > 0.005
    assert found.new_runs == ("n0", "n1", "n2")
    (points,) = [drift.points for drift in found.drifts if drift.key == "body.arm.mass"]
    assert [point.reference for point in points] == [True] * 8 + [False] * 3
    assert all(abs(point.value - MASS) < 5 * point.sd for point in points)


def test_an_offset_of_a_sensor_is_named(reference: Measurement, memo: Memo) -> None:
    found = checked(reference, record(3, 51, name="n", offset=math.radians(3)), memo)
    (change,) = found.changes
    assert change.key == "sensor_bias@qpos.hinge.bias"
    assert change.after == pytest.approx(math.radians(3), abs=5 * change.sd)
    assert change.low < math.radians(3) < change.high
    assert change.since.first
    assert change.p < 1e-4
    assert found.error.p > 0.005  # nothing is left to explain


@pytest.mark.slow
def test_a_payload_is_a_larger_mass(reference: Measurement, memo: Memo) -> None:
    (change,) = checked(reference, record(3, 52, name="n", mass=1.3), memo).changes
    assert (change.key, change.unit) == ("body.arm.mass", "kg")
    assert change.after == pytest.approx(1.3, abs=0.01)
    assert "payload@arm.mass" in change.alike


@pytest.mark.slow
def test_wear_is_dated_by_its_run(reference: Measurement, memo: Memo) -> None:
    worn = record(6, 55, name="n", damping=[DAMPING] * 3 + [0.1] * 3)
    found = checked(reference, worn, memo)
    (change,) = found.changes
    assert change.key == "joint.hinge.damping"
    assert change.after == pytest.approx(0.1, abs=1e-3)
    assert (change.since.run, change.since.time, change.since.first) == ("n3", None, False)
    (drift,) = found.drifts
    new = [point.value for point in drift.points if not point.reference]
    assert max(new[:3]) < 0.09 < min(new[3:])


@pytest.mark.slow
def test_a_change_within_a_run_is_dated_by_time(reference: Measurement, memo: Memo) -> None:
    (change, *_) = checked(reference, record(1, 54, name="n", seconds=8.0, after=(4.0, 0.12)), memo).changes
    assert change.key == "joint.hinge.damping"
    assert change.since.time is not None
    assert 3.0 < change.since.time < 6.5


@pytest.mark.long
@pytest.mark.timeout(600)
def test_false_alarms_are_rare(reference: Measurement, memo: Memo) -> None:
    """40 checks at 1 %: two or more alarms have a probability of 6 %, three or more of 0.7 %."""
    found = [checked(reference, record(1 + k % 3, 3000 + k, name="n"), memo).verdict for k in range(40)]
    assert found.count("changed") <= 2


def test_a_log_in_which_nothing_moves_is_refused(reference: Measurement, memo: Memo) -> None:
    still = record(1, 60, name="n")
    still.data["signal"][:] = math.pi / 2
    still.data["command"][:] = 0.0
    with pytest.raises(BadInput, match="nothing moves"):
        checked(reference, still, memo)
