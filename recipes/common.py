"""What the recipes share: their settings, the hidden truths, and how a run is begun, gone on with and judged."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, Literal, get_args

import torch
from jaxtyping import Float
from scipy.stats import qmc
from torch import Tensor
from typing_extensions import TypeVar

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, RunFolder, seed_everything, write_atomic
from onlinebayes.trainers import (
    OnlineState,
    OnlineTrainer,
    Player,
    Point,
    Policy,
    Problem,
    Recording,
    Schedule,
    SimulatedPlayer,
    Worlds,
    run_in_folder,
)
from onlinebayes.trainers.distributed import OnRay, Workers
from onlinebayes.transforms import Distribution
from recipes.command import STOPPED, status

Kind = Literal["online", "posterior-first", "prior", "oracle"]


@dataclass(frozen=True)
class Options:
    """What every recipe can be told."""

    seed: int = 0
    """of networks, worlds and draws"""
    short: bool = False
    """a small budget: shows that the pieces connect"""
    out: str = "out"
    """the run's folder goes here"""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise BadInput(f"seed {self.seed}", "needs seed >= 0")


@dataclass(frozen=True)
class Settings(Options):
    """One run of a recipe."""

    seed: int = 0
    """which truth and which random numbers: 0 for the recipe's own values, s for point s + 1 of a Sobol sequence"""
    noise: float = 0.01
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    kind: Kind = "online"
    """online; posterior first, then the policy; a policy in worlds of the prior; an oracle's, in worlds of the truth"""
    ray_workers: int = 0
    """workers on Ray that step the worlds, of this machine or of the cluster at RAY_ADDRESS; 0: this process does;
    not in every recipe"""

    def __post_init__(self) -> None:
        if self.seed < 0 or not 0 <= self.noise < 1:
            raise BadInput(f"seed {self.seed}, noise {self.noise}", "needs seed >= 0 and 0 <= noise < 1")

    def workers(self) -> Workers | None:
        """What steps the worlds; None for this process."""
        return workers_of(self.ray_workers)

    def schedule(self, steps: int, policy_batches: int, real_steps: int) -> Schedule:
        """The schedule of this kind of run."""
        order = {"online": "online", "posterior-first": "posterior-first"}.get(self.kind, "policy-only")
        return Schedule(steps, policy_batches, real_steps, order=order)  # type: ignore[arg-type]

    def worlds(self, problem: Worlds, truth: Float[Tensor, " P"]) -> Distribution | None:
        """Where the policy's worlds come from: the belief where that is None."""
        if self.kind == "prior":
            return problem.prior
        return Point(truth) if self.kind == "oracle" else None


def workers_of(number: int) -> Workers | None:
    """So many on Ray; None for this process alone. Nothing is started before they are needed."""
    return OnRay(number) if number else None


P = TypeVar("P", bound=Worlds, default=Problem, covariant=True)
S = TypeVar("S", bound=Settings)


@dataclass(frozen=True)
class Run(Generic[P]):
    """What a recipe has built.

    Attributes:
        problem: system, task, prior, sensors.
        trainer: all parts together.
        truth: hidden from the trainer; judges the run.
        player: shows the hidden system; the problem's own without it.
        to_beat: return that the policy has to beat, where the run is about the policy alone.
        figures: gives further figures for the log of each outer step.
        workers: that step the trainer's worlds, to be closed at the end.
        score: (policy, truth) -> return on the real system, where that is another one than the problem's.
    """

    problem: P
    trainer: OnlineTrainer
    truth: Float[Tensor, " P"]
    player: Player | None = None
    to_beat: float | None = None
    figures: Callable[[], dict[str, float]] = dict
    workers: Workers | None = None
    score: Callable[[Policy, Float[Tensor, " P"]], float] | None = None

    def close(self) -> None:
        """End what the run has started."""
        if self.workers is not None:
            self.workers.close()

    def judge(self, state: OnlineState) -> dict[str, float]:
        """Log density of the truth, and the policy's return on the real system."""
        return {
            "return": (self.score or self.problem.score)(self.trainer.objective.policy, self.truth),
            "log density of the truth": float(state.belief.log_prob(self.truth)),
            **self.figures(),
        }

    def seen_by(self) -> Player | None:
        """What shows the hidden system."""
        if self.player is None and isinstance(self.problem, Problem):
            return SimulatedPlayer(self.problem, self.trainer.objective.policy, self.truth)
        return self.player


def hidden_truth(space: ParameterSpace, seed: int, default: dict[str, float]) -> Float[Tensor, " P"]:
    """Seed 0: the default values. Seed s: point s + 1 of the unscrambled Sobol sequence over the bounds.

    Points 0 and 1 are left out: a corner of the bounds, and their centre, which whoever guesses the prior's mean knows.
    """
    if seed == 0:
        return space.vector(default)
    point = qmc.Sobol(d=len(space), scramble=False).fast_forward(seed + 1).random(1)[0]
    return space.from_unit(torch.from_numpy(point))


def main(name: str, build: Callable[[S], Run[Any]], description: str | None, settings: type[S] | None = None) -> int:
    """Read the settings, run in a folder of the run's own, say what was written; returns the exit status."""
    return status(partial(run, name, build), settings if settings is not None else Settings, description)


def run(name: str, build: Callable[[S], Run[Any]], settings: S) -> int:
    """One run; 0 when it does what it promises, 130 when it was stopped."""
    seed_everything(settings.seed)
    place, _ = place_of(name, settings), settings.workers()  # which refuses before there is a folder
    with closing(built(build, settings)) as made, RunFolder(place, name, settings=told(settings)) as folder:
        kinds, infers = baselines(name, settings), made.trainer.schedule.order != "policy-only"
        with Recording(place, name, made.problem.prior, made.seen_by(), made.truth, kinds, infers) as recording:
            state = run_in_folder(made.trainer, made.problem.prior, folder, judge=made.judge, watchers=(recording,))
        if state.interrupted:
            print(f"stopped; kept: {state.kept()}. The same command goes on from there")
            return STOPPED
        write_atomic(folder.path("finished"), "")
    good = outcome(made, state)
    print(written(place))
    return good


def told(settings: Settings) -> dict[str, Any]:
    """What a run's folder remembers, for it goes on with the same only; runs of before Ray did not name it."""
    left_out = {"out"} if settings.ray_workers else {"out", "ray_workers"}
    return {key: value for key, value in asdict(settings).items() if key not in left_out}


def built(build: Callable[[S], Run[Any]], settings: S) -> Run[Any]:
    """The run.

    Raises:
        BadInput: Ray is asked of a recipe that does without.
    """
    made = build(settings)
    if settings.ray_workers and made.workers is None:
        raise BadInput("this recipe steps its worlds in one process", "leave out --ray-workers")
    return made


def written(place: Path) -> str:
    """What every recipe says at its end."""
    return f"written: {place}   open it with: onlinebayes show {place}   or {place / 'run.html'} in a browser"


def baselines(name: str, settings: Settings) -> dict[str, float]:
    """Last returns of the other kinds of run with the same settings, as far as they lie in the same folder."""
    found = {}
    for kind in get_args(Kind):
        other = replace(settings, kind=kind)
        log, about = (place_of(name, other) / file for file in ("log.csv", "run.json"))
        if kind == settings.kind or not (log.exists() and about.exists()):
            continue
        if json.loads(about.read_text(encoding="utf-8"))["settings"] == json.loads(
            json.dumps(told(other), default=str)
        ):
            with log.open(encoding="utf-8") as file:
                found[kind] = float(list(csv.DictReader(file))[-1]["figure/return"])
    return found


def place_of(name: str, settings: Options) -> Path:
    """A run's folder."""
    return Path(settings.out) / folder_of(name, settings)


def folder_of(name: str, settings: Options) -> str:
    """Name of a run's folder."""
    kind = [settings.kind] if isinstance(settings, Settings) else []
    return "-".join([name, *kind, str(settings.seed), *["short"] * settings.short])


def outcome(made: Run[Any], state: OnlineState) -> int:
    """0 when the run does what it promises: a belief better than the prior where there is one, or a better policy."""
    if made.to_beat is not None:
        after = state.records[-1].figures["return"]
        print(f"return: {made.to_beat:.1f} before, {after:.1f} after")
        return 0 if after > made.to_beat else 1
    if made.trainer.worlds is not None:
        return 0
    gain = float(state.belief.log_prob(made.truth) - made.problem.prior.log_prob(made.truth))
    print(f"the belief holds the truth {abs(gain):.1f} nats {'better' if gain > 0 else 'worse'} than the prior")
    return 0 if gain > 0 else 1
