"""``make hidden-effect``: a model that grows while a policy learns in its worlds, one that does not, and an oracle.

| part     | what is run                                                                                             |
|----------|---------------------------------------------------------------------------------------------------------|
| naming   | the critic alone, on five and on ten real trajectories, of a policy that learns in worlds of the prior  |
| learning | whole runs with criticism, without, and an oracle's policy, which learns as much in worlds of the truth |

    share = (return - untrained policy's return) / (oracle's return - untrained policy's return)

The friction of a cart that a balancing policy hardly moves is asked for once more, with 2 s of excitation within
limits (``onlinebayes.trainers.Excited``).

Machines of ``recipes.hidden_effect``: pendulum and cart-pole with a dry friction, a late actuator, or nothing hidden.
Named: the last thing that the critic said should be added, within ten real trajectories, is exactly what is hidden.
Each finished job is kept, so that a second start goes on.

    python -m recipes.studies.hidden_effect [--seeds 0 1] [--parts naming]      -> docs/results/hidden-effect.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from statistics import fmean
from typing import Any, Literal

from tensordict import TensorDict

from onlinebayes.experiments import status
from onlinebayes.runs import Interrupt, ResultTable, processor_time, seed_everything
from onlinebayes.trainers import Excited, Finding, GrowingTrainer, OnlineState, improve
from onlinebayes.trainers.real import united
from recipes.hidden_effect import MOMENTS, Settings, build
from recipes.hidden_systems import SYSTEMS
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by

Part = Literal["naming", "learning"]
KINDS = ("criticised", "blind", "oracle")
EFFECTS = ("friction", "delay")
NAMING, EXCITED = "naming", "excited"
EPISODES = 64
SEEDS = tuple(range(10))


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    systems: tuple[str, ...] = tuple(SYSTEMS)
    """which machines"""
    effects: tuple[str, ...] = (*EFFECTS, "nothing")
    """what they hide"""
    parts: tuple[Part, ...] = ("naming", "learning")
    """which parts"""
    seeds: tuple[int, ...] = SEEDS
    """of truth, networks and noise"""
    out: str = "out/hidden_effect"


@dataclass(frozen=True)
class Job:
    """One run."""

    system: str
    effect: str
    kind: str
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.system}-{self.effect}-{self.kind}-{self.seed}"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = {job: partial(learnt if job.kind in KINDS else named, job) for job in jobs_of(study)}
    found = each_kept_or_done("hidden effect", study.out, jobs, lambda job: job.name, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def jobs_of(study: Study) -> list[Job]:
    """Naming first; seed by seed, so that a study that is cut short has whole seeds."""
    cases = [(seed, system, effect) for seed in study.seeds for system in study.systems for effect in study.effects]
    naming = [case for case in cases if "naming" in study.parts]
    jobs = [Job(system, effect, kind, seed) for seed, system, effect in naming for kind in asked(system, effect)]
    learning = [case for case in cases if "learning" in study.parts and case[2] != "nothing"]
    return jobs + [Job(system, effect, kind, seed) for seed, system, effect in learning for kind in KINDS]


def asked(system: str, effect: str) -> tuple[str, ...]:
    """List how the critic is asked about a machine: as its policy moves it, and where that is hardly, excited too."""
    hardly = SYSTEMS[system].excitation is not None and effect in ("friction", "nothing")
    return (NAMING, EXCITED) if hardly else (NAMING,)


def named(job: Job) -> dict[str, Any]:
    """Ask the critic for its findings on five and on ten real trajectories."""
    seed_everything(job.seed)
    excite = job.kind == EXCITED
    parts = build(Settings(job.seed, system=job.system, effect=job.effect, excite=excite))  # type: ignore[arg-type]
    growing = parts.trainer
    assert isinstance(growing, GrowingTrainer)
    trainer, seen, said, seconds = growing.trainer, list[TensorDict](), list[Finding](), list[float]()
    with Interrupt() as interrupt:
        for turn in trainer.schedule.turns[: max(MOMENTS)]:
            improve(parts.objective, trainer.collector, turn.policy_batches)
            more = trainer.real.run(parts.objective.policy, trainer.schedule.real_steps)
            assert more is not None
            seen.append(more)
            began = processor_time()
            said.append(growing.critic(united(seen), parts.begun, interrupt))
            seconds.append(processor_time() - began)
            if interrupt.requested:
                raise KeyboardInterrupt
    return {
        "hidden": [name.rpartition(".")[0] for name in parts.further],
        "said": [[effect.key for effect in finding.effects] for finding in said],
        "words": [finding.words for finding in said],
        "seconds": seconds,
        "trajectories": sum(len(more) for more in seen),
        "excitations": trainer.real.asked if isinstance(trainer.real, Excited) else 0,
    }


def learnt(job: Job) -> dict[str, Any]:
    """Run the training and return its results."""
    began = time.monotonic()
    seed_everything(job.seed)
    parts = build(Settings(job.seed, system=job.system, effect=job.effect, kind=job.kind))  # type: ignore[arg-type]
    before = parts.machine.score(parts.objective.policy, parts.truth, EPISODES)
    state = parts.trainer.run(OnlineState.begin(parts.begun.prior))
    if state.interrupted:
        raise KeyboardInterrupt
    return {
        "before": before,
        "return": parts.machine.score(parts.objective.policy, parts.truth, EPISODES),
        "hidden": [name.rpartition(".")[0] for name in parts.further],
        "grown": [list(record.grown) for record in state.records],
        "belief": {name: list(values) for name, values in state.records[-1].belief.items()},
        "truth": {**dict(zip(parts.begun.space.names, parts.truth.tolist(), strict=True)), **parts.further},
        "notes": [note for record in state.records for note in record.notes if "critic" in note],
        "seconds": time.monotonic() - began,
        "criticism": sum(record.seconds.get("criticism", 0.0) for record in state.records),
    }


def tabled(found: Mapping[Job, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    seeds = sorted({job.seed for job in found})
    table = ResultTable("hidden-effect", printed_by("hidden-effect", study), seeds)
    for system in study.systems:
        for effect in study.effects:
            runs = {
                kind: {seed: found[job] for seed in seeds if (job := Job(system, effect, kind, seed)) in found}
                for kind in (NAMING, EXCITED, *KINDS)
            }
            add_naming(table, f"{system}, {effect}", runs[NAMING])
            add_naming(table, f"{system}, excited, {effect}", runs[EXCITED])
            if effect != "nothing":
                add_learning(table, f"{system}, {effect}", runs)
    spent = [seconds for job, run in found.items() if job.kind not in KINDS for seconds in run["seconds"]]
    if spent:
        table.add("processor time of one criticism, mean", fmean(spent), unit="s")
    return table


def add_naming(table: ResultTable, name: str, runs: dict[int, dict[str, Any]]) -> None:
    """Add the rows on whether the last finding of the critic is what is hidden."""
    if not runs:
        return
    last: list[list[str]] = [next((keys for keys in reversed(run["said"]) if keys), []) for run in runs.values()]
    unit = f"of {len(runs)} seeds"
    if name.endswith("nothing"):
        wrong = sum(bool(keys) for keys in last)
        holds = held(wrong == 0, len(runs))
        table.add(f"{name} hidden: something added", wrong, unit=unit, goal="0", holds=holds)
        return
    right = sum(keys == run["hidden"] for keys, run in zip(last, runs.values(), strict=True))
    table.add(
        f"{name}: named", right, unit=unit, goal="at least 9 of 10", holds=held(right >= 0.9 * len(runs), len(runs))
    )
    other = sum(bool(keys) and keys != run["hidden"] for keys, run in zip(last, runs.values(), strict=True))
    table.add(f"{name}: something else added", other, unit=unit)


def held(good: bool, seeds: int) -> bool | None:
    """Check whether a goal over ten seeds holds; fewer can only miss it."""
    return good if seeds >= len(SEEDS) or not good else None


def add_learning(table: ResultTable, name: str, runs: dict[str, dict[int, dict[str, Any]]]) -> None:
    """Add the rows on the gain from finding the effect."""
    seeds = sorted(set.intersection(*(set(runs[kind]) for kind in KINDS)))
    if not seeds:
        return
    unit = f"mean of {len(seeds)} seeds"
    oracle, before = (fmean(runs["oracle"][seed][key] for seed in seeds) for key in ("return", "before"))
    table.add(f"{name}: untrained policy's return", before, unit=unit)
    table.add(f"{name}: oracle's return", oracle, unit=unit)
    share = {}
    for kind in KINDS[:2]:
        each = [(runs[kind][seed]["return"] - before) / (oracle - before) for seed in seeds]
        share[kind] = fmean(each)
    table.add(
        f"{name}: share with criticism",
        share["criticised"],
        unit=unit,
        goal="at least 0.9",
        holds=held(share["criticised"] >= 0.9, len(seeds)),
    )
    table.add(
        f"{name}: share without",
        share["blind"],
        unit=unit,
        goal="at most 0.7",
        holds=held(share["blind"] <= 0.7, len(seeds)),
    )


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
