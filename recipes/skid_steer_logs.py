"""Two real skid-steered robots: which limits does the driver add, and where is the robot after two seconds of commands?

    python -m recipes.skid_steer_logs [--vehicle warthog] [--short]      needs ONLINEBAYES_DATA; some minutes

The commands of a Clearpath Husky and a Warthog were written down as wheel speeds of a nominal geometry. Replayed
through that geometry they miss the robot by metres and turns. ``refine`` looks for what lies between the commands and
the motion: how fast the driver lets travel and turn change, what slips, which sensor is late. The error is that of the
pose at the end of windows of two seconds, from the commands alone, in calibration steps that were not fitted.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from envs.measured import FOLDER
from envs.measured.skid_steer import SkidSteer, Warthog
from onlinebayes.criticism import Criticism
from onlinebayes.experiments import Options, place_of, status
from onlinebayes.identification import Windows, make_windows, replay
from onlinebayes.measurements import Measurement
from onlinebayes.problems import ProblemFile, criticise, load_problem
from onlinebayes.report import write_report
from onlinebayes.simulators.identifiable import Identifiable

FILES = {"husky": "problem.toml", "warthog": "warthog.toml"}
LIMITS = {"travel_acceleration@vehicle", "turn_acceleration@vehicle"}
WINDOWS = 3
"""Windows of a calibration step: one in which the command begins, two of steady driving."""


@dataclass(frozen=True)
class Settings(Options):
    """Options of the recipe.

    Args:
        vehicle: ``"husky"`` or ``"warthog"``.
    """

    vehicle: Literal["husky", "warthog"] = "husky"


@dataclass(frozen=True)
class Miss:
    """Error of a model at the windows' ends, RMS: ``position`` [m], ``yaw`` [rad]."""

    position: float
    yaw: float

    def __str__(self) -> str:
        return f"{self.position:.3f} m, {self.yaw:.3f} rad"


def load(vehicle: str) -> ProblemFile:
    """The problem of one robot.

    Raises:
        BadInput: ONLINEBAYES_DATA is not set, or does not hold the log.
    """
    return load_problem(FOLDER / "skid_steer" / FILES[vehicle])


def calibration_step(run: str) -> int:
    """Return the number of the command that a window belongs to: they are numbered on, three of each."""
    return int(run.removeprefix("w")) // WINDOWS


@dataclass(frozen=True)
class Drives:
    """Whole windows of a log, each to be driven from its first row.

    Args:
        windows: what was commanded and measured.
        wheels: both wheels' speeds in the first rows [rad/s].
        pose: columns of x, y and yaw.
    """

    windows: Windows
    wheels: Float[Tensor, "W 2"]
    pose: tuple[int, ...]

    @classmethod
    def of(cls, vehicle: Identifiable, runs: Measurement) -> Drives:
        """Every run from its first row to its last."""
        windows = make_windows(vehicle, runs, max(runs.durations))
        names = [signal.name for signal in runs.signals]
        left_right = [names.index("qvel.left"), names.index("qvel.right")]
        pose = tuple(names.index(f"qpos.{axis}") for axis in ("x", "y", "yaw"))
        return cls(windows, runs.data["signal"][windows.run, 0][:, left_right], pose)

    def miss(self, vehicle: SkidSteer, theta: Float[Tensor, " P"]) -> Miss:
        """Measure the vehicle's error at the windows' last measured poses, driven by the commands alone."""
        windows, pose = self.windows, list(self.pose)
        speeds = vehicle.rolling(theta.expand(windows.count, -1), self.wheels)
        start = torch.cat([torch.zeros_like(speeds), speeds], dim=1)
        played, _ = replay(vehicle, windows, theta[None], start[None])
        seen = windows.measured[..., pose].all(-1)
        last = seen.shape[1] - 1 - seen.flip(1).int().argmax(1)
        error = (played[0] - windows.value)[torch.arange(len(last)), last][:, pose].square().mean(0)
        return Miss(float((error[0] + error[1]).sqrt()), float(error[2].sqrt()))


def nominal(robot: str) -> tuple[SkidSteer, Tensor]:
    """The geometry by which the commands were written down, and nothing else; the wheels follow at once."""
    vehicle = (Warthog if robot == "warthog" else SkidSteer)(["wheel_lag"])
    return vehicle, vehicle.parameters.clamp(torch.zeros_like(vehicle.nominal))


def fitted(found: Criticism) -> tuple[SkidSteer, Tensor]:
    """The vehicle with what was found, and its parameters."""
    vehicle = found.final.simulator
    assert isinstance(vehicle, SkidSteer)
    return vehicle, found.final.theta


def main(settings: Settings) -> int:
    """Refine one log; returns the exit status."""
    problem, place = load(settings.vehicle), place_of(f"skid_steer_logs-{settings.vehicle}", settings)
    if settings.short:
        few = (*sorted(LIMITS), "side_asymmetry@vehicle")
        problem = replace(sampled(problem, 10), candidates=few)
    held = Drives.of(problem.simulator, problem.measurement.select(problem.holdout or ()))
    before = held.miss(*nominal(settings.vehicle))
    found = criticise("refine", problem)
    write_report(found, place / "refine", title=f"the log of a {settings.vehicle}", problem=problem.path)
    after = held.miss(*fitted(found))
    print(f"accepted: {', '.join(found.accepted) or 'nothing'}")
    print(f"{settings.vehicle}, {held.windows.count} windows of other commands: nominal {before}; refined {after}")
    print(f"report: {place / 'refine' / 'report.html'}")
    limited = LIMITS & set(found.accepted) if settings.short else set(found.accepted) >= LIMITS
    even = "side_asymmetry@vehicle" not in found.accepted
    # A tenth of the windows names one limit: that of the turn mends the heading, the position needs both.
    closer = after.position < before.position / (1 if settings.short else 2) and after.yaw < before.yaw / 4
    return 0 if limited and even and closer else 1


def sampled(problem: ProblemFile, every: int) -> ProblemFile:
    """The problem with one calibration step of so many."""
    runs = [run for run in problem.measurement.runs if calibration_step(run) % every == 0]
    some = replace(problem, measurement=problem.measurement.select(runs))
    return replace(some, holdout=tuple(run for run in problem.holdout or () if run in runs))


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
