"""Two real skid-steered robots: how far the pose is off after two seconds of commands, nominal model beside ours.

The structure is found once a robot by ``refine``, from a sample of its calibration steps. Over splits of all of them
what was found is fitted anew to the steps that are left in, and judged by those that are held out.

    ONLINEBAYES_DATA=/path/to/data python -m recipes.studies.skid_steer_logs      -> docs/results/skid-steer-logs.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from envs.measured.skid_steer import SkidSteer
from onlinebayes.criticism import Criticism, fit
from onlinebayes.experiments import status
from onlinebayes.identification import make_windows, split
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.problems import ProblemFile, criticise
from onlinebayes.report import write_report
from onlinebayes.runs import ResultTable, Row, generator, processor_time
from recipes.skid_steer_logs import LIMITS, Drives, Miss, calibration_step, fitted, load, nominal, sampled
from recipes.studies.jobs import check_names, each_kept_or_done, finished, printed_by

STEPS = 15
"""Of the fit over a split, which begins at what refine found."""

FIT_STEP = 0.025
"""Step of that fit [s]: half a row of the log. The errors are those of the model's own step."""

LATEST = 0.5
"""A pose may be so late in that fit [s]: the search looks as far as a tenth of a window, where the Warthog's ends."""

HELD = 0.4
"""Share of the calibration steps that a split holds out."""

GOALS = {"husky": Miss(0.21, 0.27), "warthog": Miss(0.50, 0.40)}
"""The best of the prototypes, from commands alone."""


@dataclass(frozen=True)
class Study:
    """Splits of the study, and places of its results.

    Args:
        seeds: one split each; steps and latest delay of the fit were chosen while looking at splits 0 and 2.
        robots: whose logs.
        every: of so many calibration steps one is shown to ``refine``; the splits have all.
        results: folder of skid-steer-logs.json.
        out: folder of the reports.
    """

    seeds: Sequence[int] = (3, 5)
    robots: Sequence[str] = ("husky", "warthog")
    every: int = 5
    results: Path = Path("docs/results")
    out: Path = Path("out/skid_steer_logs")


def held_out(measurement: Measurement, seed: int) -> tuple[str, ...]:
    """The windows of the calibration steps that one split holds out."""
    steps = sorted({calibration_step(run) for run in measurement.runs})
    order = torch.randperm(len(steps), generator=generator(seed)).tolist()
    held = {steps[k] for k in order[: round(HELD * len(steps))]}
    return tuple(run for run in measurement.runs if calibration_step(run) in held)


def found_rows(robot: str, found: Criticism) -> Iterator[Row]:
    """List the rows on what ``refine`` found on one robot."""
    named = set(found.accepted)
    accepted, uneven = ", ".join(found.accepted) or "none", "side_asymmetry@vehicle" in named
    yield Row(f"{robot}: verdict", found.verdict)
    yield Row(f"{robot}: accepted, in order", accepted, goal="both limits of acceleration", holds=named >= LIMITS)
    yield Row(f"{robot}: left and right differ", "yes" if uneven else "no", goal="no", holds=not uneven)
    if robot == "warthog":
        late = [effect for effect in found.accepted if effect.startswith("sensor_delay")]
        goal = "a shift between wheels and body"
        yield Row(f"{robot}: late signals", ", ".join(late) or "none", goal=goal, holds=bool(late))
    for name, value in found.final.parameters.items():
        yield Row(f"{robot}: {name}", value.mean, value.sd, value.unit)


def miss_rows(robot: str, before: Sequence[Miss], after: Sequence[Miss]) -> Iterator[Row]:
    """List the rows on the errors of both models, the mean over the splits and each of them."""
    for axis, unit in (("position", "m"), ("yaw", "rad")):
        for which, misses in (("nominal", before), ("ours", after)):
            values, most = [float(getattr(one, axis)) for one in misses], float(getattr(GOALS[robot], axis))
            mean, each = statistics.mean(values), " ".join(f"{value:.3f}" for value in values)
            goal, holds = (f"<= {most:g}", mean <= most) if which == "ours" else (None, None)
            yield Row(
                f"{robot}: {axis} after 2 s of commands, {which}, mean of the splits", mean, each, unit, goal, holds
            )


def judge(robot: str, study: Study) -> dict[str, Any]:
    """Refine one robot's log, and fit what was found over every split."""
    problem, began = load(robot), processor_time()
    found = criticise("refine", sampled(problem, study.every))
    write_report(found, study.out / robot, title=f"the log of a {robot}", problem=problem.path)
    rows = [*found_rows(robot, found)]
    rows.append(Row(f"{robot}: processor time of refine", processor_time() - began, unit="s"))
    model, theta = fitted(found)
    splits = [over_split(robot, problem, model, theta, seed) for seed in study.seeds]
    rows += miss_rows(robot, *zip(*splits, strict=True))
    rows.append(Row(f"{robot}: processor time of all", processor_time() - began, unit="s"))
    return {"rows": [asdict(row) for row in rows]}


def over_split(robot: str, problem: ProblemFile, model: SkidSteer, theta: Tensor, seed: int) -> tuple[Miss, Miss]:
    """Measure the errors of the nominal model and ours, over what one split holds out."""
    fit_runs, held = split(problem.measurement, held_out(problem.measurement, seed))
    for name in [name for name in model.parameters if name.startswith("sensor_delay@")]:
        model = model.with_bounds(name, Parameter(0.0, LATEST, "s"))
    coarse = model.with_timestep(FIT_STEP)
    refit = fit(coarse, make_windows(coarse, fit_runs, max(fit_runs.durations)), theta, most=STEPS)
    drives = Drives.of(problem.simulator, held)
    return drives.miss(*nominal(robot)), drives.miss(model, refit.theta)


def main(study: Study) -> int:
    """Both robots; the exit status says whether all goals are met."""
    check_names(study.robots, GOALS)
    jobs = {robot: partial(judge, robot, study) for robot in study.robots}
    found = each_kept_or_done("skid-steer-logs", study.out, jobs, str)
    table = ResultTable("skid-steer-logs", printed_by("skid-steer-logs", study), study.seeds)
    table.rows += [Row(**row) for kept in found.values() for row in kept["rows"]]
    return finished(table, study.results, found)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
