"""Poses in another convention are a fault of the table, and named with the lines that put it right."""

from __future__ import annotations

import tomllib
from collections.abc import Callable

import numpy as np
import pytest
import torch

from onlinebayes.criticism import compare
from onlinebayes.criticism.wiring.hypotheses import hypotheses
from onlinebayes.identification.data.windows import joint_names, make_windows
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.measurements import Measurement
from tests.criticism.tumbling import POSE, TRUTH, Block, fly, model, rotated, table

RATES = tuple(f"qvel.pose.{k}" for k in range(6))
Columns = dict[str, np.ndarray]


def in_order(columns: Columns) -> None:
    parts = [columns[name] for name in POSE[3:]]
    columns |= dict(zip(POSE[3:], (*parts[1:], parts[0]), strict=True))


def inverted(columns: Columns) -> None:
    columns |= {name: -columns[name] for name in POSE[4:]}


def with_rates(columns: Columns, velocity: np.ndarray) -> None:
    noise = 1e-2 * np.random.default_rng(0).normal(size=velocity.shape)
    columns |= dict(zip(RATES, (velocity + noise).T, strict=True))


def runs_with(linear_in_body: bool, angular_in_world: bool) -> dict[str, Columns]:
    runs = table(Block(), runs=5, seconds=2.0)
    _, poses, rates = fly(Block(), 5, 2.0, 0)
    for columns, pose, rate in zip(runs.values(), poses, rates, strict=True):
        q, back = pose[:, 3:], pose[:, 3:] * np.array([1.0, -1.0, -1.0, -1.0])
        v = rotated(back, rate[:, :3]) if linear_in_body else rate[:, :3]
        w = rotated(q, rate[:, 3:]) if angular_in_world else rate[:, 3:]
        with_rates(columns, np.concatenate([v, w], axis=1))
    return runs


def misread(change: Callable[[Columns], None]) -> dict[str, Columns]:
    runs = table(Block(), runs=5, seconds=2.0, noise=1e-6)
    for columns in runs.values():
        change(columns)
    return runs


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: misread(in_order), "x, y, z, w for"),
        (lambda: misread(inverted), "the world as the body sees it"),
        (lambda: runs_with(True, False), "the body's axes for the world's"),
        (lambda: runs_with(False, True), "the world's axes for the body's"),
    ],
)
def test_put_right_the_model_replays_the_table(made: Callable[[], dict[str, Columns]], says: str) -> None:
    simulator, turned = charted(model(), Measurement.from_runs(made(), commands=["thruster"]))
    (fault,) = [fault for fault in hypotheses(simulator, turned) if says in fault.says]
    right = make_windows(fault.model(simulator), fault.mended(turned), 0.5)
    theta = torch.tensor([TRUTH], dtype=torch.float64)

    def error(starts: torch.Tensor) -> torch.Tensor:
        shown, _ = replay(fault.model(simulator), right, theta, starts[None])
        return (shown[0] - right.value).square().mean((0, 1)).sqrt()

    assert float(error(right.start)[:6].max()) < 0.05
    assert float(error(right.start).max()) < 0.2  # speeds of some m/s
    shown = [f"qpos.{joint}" for joint in joint_names(simulator)]
    begun = fault.started(make_windows(simulator, turned, 0.5), shown)
    assert float(error(begun.start)[:6].max()) < 0.1
    asis = make_windows(simulator, turned, 0.5)
    assert float((replay(simulator, asis, theta, asis.start[None])[0][0] - asis.value).abs().max()) > 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says", "lines"),
    [
        (in_order, "x, y, z, w for w, x, y, z", {POSE[3]: {"column": POSE[6]}, POSE[4]: {"column": POSE[3]}}),
        (inverted, "the world as the body sees it", {POSE[4]: {"sign": -1}, POSE[6]: {"sign": -1}}),
    ],
)
def test_a_quaternion_in_another_convention_is_named(
    change: Callable[[Columns], None], says: str, lines: dict[str, dict[str, object]]
) -> None:
    runs = table(Block(), runs=5, seconds=2.0)
    for columns in runs.values():
        change(columns)
    found = compare(model(), Measurement.from_runs(runs, commands=["thruster"])).wiring
    assert found is not None
    assert found.fault.startswith(f"{POSE[3]} to {POSE[6]}: {says}")
    assert found.error_after < 1.2 < 10 < found.error_before
    assert found.alternatives == ()
    written = tomllib.loads(found.lines)["signals"]
    assert lines.items() <= written.items()


@pytest.mark.slow
@pytest.mark.parametrize(("linear", "angular", "says"), [(True, False, "the body's"), (False, True, "the world's")])
def test_velocities_in_other_axes_are_named(linear: bool, angular: bool, says: str) -> None:
    found = compare(model(), Measurement.from_runs(runs_with(linear, angular), commands=["thruster"])).wiring
    assert found is not None
    assert f": {says} axes for the" in found.fault
    assert found.error_after < 2  # turned by measured orientations, whose noise comes with the speed


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong() -> None:
    found = compare(model(), Measurement.from_runs(runs_with(False, False), commands=["thruster"]))
    assert found.wiring is None
    assert [found.parameters[name].mean for name in found.parameters] == pytest.approx(TRUTH, rel=0.01)
    assert max(found.remainder.rms_over_floor.values()) < 1.1


def test_mending_twice_is_no_change() -> None:
    measured = Measurement.from_runs(runs_with(False, False), commands=["thruster"])
    simulator, turned = charted(model(), measured)
    (fault,) = [fault for fault in hypotheses(simulator, turned) if "the world as the body sees it" in fault.says]
    other, mended = fault.model(simulator), fault.mended(turned)
    (back,) = [fault for fault in hypotheses(other, mended) if "the world as the body sees it" in fault.says]
    again = back.mended(mended).data["signal"]
    assert not np.allclose(mended.data["signal"], turned.data["signal"])
    assert np.allclose(again, turned.data["signal"], atol=1e-9)
