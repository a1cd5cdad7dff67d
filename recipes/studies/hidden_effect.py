"""``make hidden-effect``: a model that grows while a policy learns in its worlds, one that does not, and an oracle.

    share = (return - untrained policy's return) / (oracle's return - untrained policy's return)

Machines of ``recipes.hidden_effect``: pendulum and cart-pole with a dry friction, a late actuator, or nothing hidden.
"With criticism" and "without" are the same run but for the critic; the oracle's policy learns as many batches in worlds
of the truth. Named: the model has exactly the hidden effect from ten real trajectories on. Machines that hide nothing
are run until criticism has seen ten real trajectories. Each finished job is kept, so that a second start goes on.

    python -m recipes.studies.hidden_effect [--seeds 0 1] [--systems pendulum]      -> docs/results/hidden-effect.json
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import tyro

from onlinebayes.runs import Progress, ResultTable, seed_everything, write_atomic
from onlinebayes.trainers import OnlineState
from recipes.common import settle
from recipes.hidden_effect import MOMENTS, SYSTEMS, Settings, build

KINDS = ("criticised", "blind", "oracle")
EFFECTS = ("friction", "delay")
EPISODES = 64
SEEDS = tuple(range(10))


@dataclass(frozen=True)
class Study:
    """Which runs."""

    systems: tuple[str, ...] = tuple(SYSTEMS)
    """which machines"""
    effects: tuple[str, ...] = (*EFFECTS, "nothing")
    """what they hide"""
    seeds: tuple[int, ...] = SEEDS
    """of truth, networks and noise"""
    out: str = "out/hidden_effect"
    """finished jobs go here"""
    minutes: float | None = None
    """after which no further job is begun; the table then holds what there is"""
    results: Path = Path("docs/results")
    """folder of the table"""


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
    settle()
    began, found = time.monotonic(), dict[Job, dict[str, Any]]()
    jobs = jobs_of(study)
    with Progress("hidden effect", len(jobs)) as progress:
        for i, job in enumerate(jobs):
            path = Path(study.out) / f"{job.name}.json"
            late = study.minutes is not None and time.monotonic() - began > 60 * study.minutes
            if not path.exists() and not late:
                progress.update(i, job.name)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, json.dumps(done(job)))
            if path.exists():
                found[job] = json.loads(path.read_text(encoding="utf-8"))
    table = tabled(found, study)
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def jobs_of(study: Study) -> list[Job]:
    """Seed by seed, so that a study that is cut short has whole seeds."""
    return [
        Job(system, effect, kind, seed)
        for seed in study.seeds
        for system in study.systems
        for effect in study.effects
        for kind in (KINDS if effect != "nothing" else KINDS[:1])
    ]


def done(job: Job) -> dict[str, Any]:
    """What came of a run."""
    began = time.monotonic()
    steps = max(MOMENTS) + 1 if job.effect == "nothing" else Settings.steps
    seed_everything(job.seed)
    parts = build(Settings(job.seed, system=job.system, effect=job.effect, kind=job.kind, steps=steps))  # type: ignore[arg-type]
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


def tabled(found: dict[Job, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    seeds = sorted({job.seed for job in found})
    whole = len(found) == len(jobs_of(Study()))
    told = "" if whole else f" (a sample: {len(found)} of {len(jobs_of(Study()))} runs, seeds {seeds})"
    table = ResultTable("hidden-effect", f"make hidden-effect{told}", seeds)
    for system in study.systems:
        for effect in study.effects:
            runs = {
                kind: {
                    job.seed: found[job]
                    for job in found
                    if (job.system, job.effect, job.kind) == (system, effect, kind)
                }
                for kind in KINDS
            }
            if effect == "nothing":
                add_nothing(table, system, runs["criticised"])
            else:
                add_effect(table, f"{system}, {effect}", runs)
    every = [run["criticism"] / run["seconds"] for job, run in found.items() if job.kind == "criticised"]
    if every:
        table.add("share of a run's seconds that went into criticism, mean", fmean(every))
    return table


def add_nothing(table: ResultTable, system: str, runs: dict[int, dict[str, Any]]) -> None:
    """What was added where nothing is hidden."""
    if runs:
        wrong = sum(bool(run["grown"][-1]) for run in runs.values())
        goal, holds = "0", wrong == 0
        table.add(
            f"{system}, nothing hidden: something added", wrong, unit=f"of {len(runs)} runs", goal=goal, holds=holds
        )


def add_effect(table: ResultTable, name: str, runs: dict[str, dict[int, dict[str, Any]]]) -> None:
    """Whether the effect was named, and what that is worth."""
    if critical := runs["criticised"]:
        named = sum(run["grown"][-1] == run["hidden"] for run in critical.values())
        holds = named >= 0.9 * len(critical)
        table.add(f"{name}: named", named, unit=f"of {len(critical)} runs", goal="at least 9 of 10", holds=holds)
    seeds = sorted(set.intersection(*(set(runs[kind]) for kind in KINDS)))
    if not seeds:
        return
    oracle, before = (fmean(runs["oracle"][seed][key] for seed in seeds) for key in ("return", "before"))
    table.add(f"{name}: untrained policy's return", before)
    table.add(f"{name}: oracle's return", oracle)
    share = {}
    for kind in KINDS[:2]:
        each = [(runs[kind][seed]["return"] - before) / (oracle - before) for seed in seeds]
        share[kind] = fmean(each)
    most = share["criticised"] - 0.1
    holds = share["criticised"] >= 0.95
    table.add(f"{name}: share with criticism, mean", share["criticised"], goal="at least 0.95", holds=holds)
    goal = f"at most {most:.2f}"
    table.add(f"{name}: share without, mean", share["blind"], goal=goal, holds=share["blind"] <= most)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Study, description=__doc__)))
