"""What the recipes share: their settings, the hidden truths, and how a run is begun, gone on with and judged."""

from __future__ import annotations

import csv
import logging
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import torch
import tyro
from jaxtyping import Float
from scipy.stats import qmc
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, RunFolder, seed_everything, write_atomic
from onlinebayes.trainers import (
    OnlineState,
    OnlineTrainer,
    Point,
    Problem,
    Recording,
    Schedule,
    SimulatedPlayer,
    run_in_folder,
)
from onlinebayes.transforms import Distribution

Kind = Literal["online", "posterior-first", "prior", "oracle"]


@dataclass(frozen=True)
class Settings:
    """One run of a recipe."""

    seed: int = 0
    """which truth and which random numbers: 0 for Gymnasium's default parameters, s for point s of a Sobol sequence"""
    noise: float = 0.01
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    kind: Kind = "online"
    """online; posterior first, then the policy; a policy in worlds of the prior; an oracle's, in worlds of the truth"""
    short: bool = False
    """a small budget: shows that the pieces connect"""
    out: str = "out"
    """the run's folder goes here"""

    def __post_init__(self) -> None:
        if self.seed < 0 or not 0 <= self.noise < 1:
            raise BadInput(f"seed {self.seed}, noise {self.noise}", "needs seed >= 0 and 0 <= noise < 1")

    def schedule(self, steps: int, policy_batches: int, real_steps: int) -> Schedule:
        """The schedule of this kind of run."""
        order = {"online": "online", "posterior-first": "posterior-first"}.get(self.kind, "policy-only")
        return Schedule(steps, policy_batches, real_steps, order=order)  # type: ignore[arg-type]

    def worlds(self, problem: Problem, truth: Float[Tensor, " P"]) -> Distribution | None:
        """Where the policy's worlds come from: the belief where that is None."""
        if self.kind == "prior":
            return problem.prior
        return Point(truth) if self.kind == "oracle" else None


@dataclass(frozen=True)
class Run:
    """What a recipe has built.

    Attributes:
        problem: system, task, prior, sensors.
        trainer: all parts together.
        truth: hidden from the trainer; judges the run.
    """

    problem: Problem
    trainer: OnlineTrainer
    truth: Float[Tensor, " P"]

    def judge(self, state: OnlineState) -> dict[str, float]:
        """Log density of the truth, and the policy's return on the real system."""
        return {
            "return": self.problem.score(self.trainer.objective.policy, self.truth),
            "log density of the truth": float(state.belief.log_prob(self.truth)),
        }


def hidden_truth(space: ParameterSpace, seed: int, default: dict[str, float]) -> Float[Tensor, " P"]:
    """Seed 0: the default values. Seed s: point s of the unscrambled Sobol sequence over the bounds."""
    if seed == 0:
        return space.vector(default)
    point = qmc.Sobol(d=len(space), scramble=False).random(seed + 1)[seed]
    return space.from_unit(torch.from_numpy(point))


def settle() -> None:
    """One thread a run, and no chatter of the libraries."""
    torch.set_num_threads(1)
    logging.getLogger("torchrl").setLevel(logging.WARNING)


def main(name: str, build: Callable[[Settings], Run], description: str | None) -> int:
    """Read the settings, run in a folder of the run's own, say what was written; returns the exit status."""
    return status(partial(run, name, build), Settings, description)


def status(play: Callable[[Any], int], settings: type, description: str | None) -> int:
    """What a recipe's ``play`` returns for the settings of the command line; 2 and one line for bad input."""
    settle()
    try:
        return play(tyro.cli(settings, description=description))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2


def run(name: str, build: Callable[[Settings], Run], settings: Settings) -> int:
    """One run; 0 when the belief holds the truth better than the prior did, 130 when it was stopped."""
    seed_everything(settings.seed)
    place = Path(settings.out) / folder_of(name, settings)
    told = {key: value for key, value in asdict(settings).items() if key != "out"}
    with RunFolder(place, name, settings=told) as folder:
        made = build(settings)
        player = SimulatedPlayer(made.problem, made.trainer.objective.policy, made.truth)
        kinds = baselines(Path(settings.out), name, settings)
        with Recording(place, name, made.problem.prior, player, made.truth, kinds) as recording:
            state = run_in_folder(made.trainer, made.problem.prior, folder, judge=made.judge, watchers=(recording,))
        if state.interrupted:
            print(f"stopped; kept: {state.kept()}. The same command goes on from there")
            return 130
        write_atomic(folder.path("finished"), "")
    print(f"written: {place}   open it with: onlinebayes show {place}   or {place / 'run.html'} in a browser")
    return outcome(made, state)


def baselines(out: Path, name: str, settings: Settings) -> dict[str, float]:
    """Last returns of the other kinds of run with the same seed, as far as they lie in the same folder."""
    found = {}
    for kind in get_args(Kind):
        log = out / folder_of(name, replace(settings, kind=kind)) / "log.csv"
        if kind != settings.kind and log.exists():
            with log.open(encoding="utf-8") as file:
                found[kind] = float(list(csv.DictReader(file))[-1]["figure/return"])
    return found


def folder_of(name: str, settings: Settings) -> str:
    """Name of a run's folder."""
    return "-".join([name, settings.kind, str(settings.seed), *["short"] * settings.short])


def outcome(made: Run, state: OnlineState) -> int:
    """0 when the run did what it promises: a belief better than the prior, where there is one."""
    if made.trainer.worlds is not None:
        return 0
    gain = float(state.belief.log_prob(made.truth) - made.problem.prior.log_prob(made.truth))
    print(f"the belief holds the truth {gain:.1f} nats better than the prior")
    return 0 if gain > 0 else 1
