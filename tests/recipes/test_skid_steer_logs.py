"""The recipe of the two real robots: its pieces on made windows, and its short form on the logs where they are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch

from envs.measured.skid_steer import SkidSteer, Warthog
from onlinebayes.measurements import Measurement
from recipes.skid_steer_logs import Drives, Settings, calibration_step, main
from recipes.studies.skid_steer_logs import held_out

T = torch.arange(40, dtype=torch.float64) * 0.05


def window(speed: float, shift: float = 0.0) -> dict[str, torch.Tensor]:
    """Straight on at one wheel speed [rad/s]; the pose stands in every other row, the last one is ``shift`` off."""
    x = SkidSteer.defaults["radius"] * speed * T
    x[-2] += shift
    pose = {f"qpos.{axis}": torch.zeros_like(T) for axis in ("y", "yaw")}
    columns = {"time": T, "ctrl.left": speed + 0 * T, "ctrl.right": speed + 0 * T, "qpos.x": x, **pose}
    columns |= {"qvel.left": speed + 0 * T, "qvel.right": speed + 0 * T}
    for axis in ("x", "y", "yaw"):
        columns[f"qpos.{axis}"] = torch.where(torch.arange(40) % 2 == 0, columns[f"qpos.{axis}"], torch.nan)
    return columns


def test_the_miss_is_that_of_the_last_pose_that_was_measured() -> None:
    log = Measurement.from_runs({"w000": window(3.0, 0.3), "w001": window(3.0, -0.4)})
    vehicle = SkidSteer(["radius"])
    found = Drives.of(vehicle, log).miss(vehicle, vehicle.nominal)
    assert found.position == pytest.approx((0.5 * (0.3**2 + 0.4**2)) ** 0.5, abs=1e-3)
    assert found.yaw == pytest.approx(0.0, abs=1e-9)


def test_a_body_rolls_as_its_wheels_do() -> None:
    warthog = Warthog(["radius", "x_icr"])
    speeds = warthog.rolling(torch.tensor([[0.3, 0.2]]).double(), torch.tensor([[1.0, 3.0]]).double())[0]
    rate = 0.3 * 2 / Warthog.defaults["track"]
    assert speeds.tolist() == pytest.approx([1.0, 3.0, 0.6, -0.2 * rate, rate])


def test_windows_of_one_command_stand_on_one_side() -> None:
    log = Measurement.from_runs({f"w{k:03d}": window(3.0) for k in range(15)})
    held = held_out(log, 0)
    assert len(held) == 6
    assert {calibration_step(run) for run in held}.isdisjoint(
        calibration_step(run) for run in log.runs if run not in held
    )


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get("ONLINEBAYES_DATA"), reason="needs the measured logs")
def test_the_short_form_names_a_limit_and_no_asymmetry(tmp_path: Path) -> None:
    assert main(Settings(short=True, out=str(tmp_path))) == 0
