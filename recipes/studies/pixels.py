"""``make pixels``: a pendulum's length and mass from 50 frames under changing light, beside those from its states.

| seen as | what the estimator is given                                          |
|---------|----------------------------------------------------------------------|
| states  | cos, sin and rate with 1 % noise                                     |
| frames  | what the small convolution of ``recipes.pendulum_pixels`` reads      |

Both have the same estimator, simulations and truths; TARP error as in ``make calibration``. The reader is judged on
frames that it has not seen. Each finished job is kept.

    python -m recipes.studies.pixels                      -> docs/results/pixels.json
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import fmean, median
from typing import Any

from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable
from onlinebayes.transforms import ParameterRandomization
from recipes import pendulum, pendulum_pixels
from recipes.pendulum_pixels import STEPS, WORLDS, FilmedSettings, filmed, taught
from recipes.studies.calibration import MOST, NOISE, SEED, judged
from recipes.studies.exact import coverage_error
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by
from recipes.studies.one_round import OneRound, begun

ESTIMATOR, SIMULATIONS, THETAS = "filter, mixture", 1000, 500
FARTHEST = 1.0
"""Nats by which frames may say less than states."""


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    out: str = "out/pixels"


def states() -> dict[str, Any]:
    """The posteriors from states."""
    draw = begun(SEED)
    return judged(OneRound.of("pendulum", SEED, NOISE), ESTIMATOR, SIMULATIONS, THETAS, (1,), draw)


def frames(out: str) -> dict[str, Any]:
    """The posteriors from frames, and the reader's error in frames of other worlds and lights [1, 1, rad/s]."""
    draw, settings = begun(SEED), FilmedSettings(seed=SEED, out=out)
    made = pendulum_pixels.build(settings)
    one = OneRound(made.problem, pendulum.state, made.trainer.objective.policy, STEPS, SEED)
    result = judged(one, ESTIMATOR, SIMULATIONS, THETAS, (1,), draw)
    with_camera = filmed(made.problem, SEED + 4000)
    worlds = with_camera.worlds(WORLDS, ParameterRandomization(made.problem.prior), SEED + 4)
    seen = worlds.rollout(STEPS, break_when_any_done=False).reshape(-1)["next"]
    wrong = taught(with_camera, settings)(seen["pixels"]) - seen["observation"]
    return result | {"reader": wrong.square().mean(0).sqrt().tolist()}


def tabled(found: dict[str, dict[str, Any]], study: Study) -> ResultTable:
    """Both posteriors, and by how much frames say less."""
    table = ResultTable("pixels", printed_by("pixels", study), [SEED])
    for name, result in found.items():
        density, error = fmean(result["density 1"]), coverage_error(result["ball 1"])
        spread = f"median {median(result['density 1']):.2f} of {len(result['density 1'])} thetas"
        table.add(f"{name}: density of the truth", density, spread=spread, unit="nats")
        table.add(f"{name}: TARP error", error, goal=f"at most {MOST:g}", holds=error <= MOST)
    if {"states", "frames"} <= found.keys():
        less = fmean(found["states"]["density 1"]) - fmean(found["frames"]["density 1"])
        table.add("frames say less by", less, unit="nats", goal=f"at most {FARTHEST:g}", holds=less <= FARTHEST)
    for name, error in zip(("cos", "sin", "rate [rad/s]"), found.get("frames", {}).get("reader", ()), strict=False):
        table.add(f"error of the reader, {name}", error)
    return table


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs: dict[str, Callable[[], dict[str, Any]]] = {"states": states, "frames": partial(frames, study.out)}
    found = each_kept_or_done("pixels", study.out, jobs, str, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
