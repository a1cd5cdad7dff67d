"""``make fetch-robustness``: Figures 4.6 and 5.3 of the thesis, policies of the prior beside policies of a posterior.

| figure | what is drawn                                                                                       |
|--------|-----------------------------------------------------------------------------------------------------|
| 4.6    | success along the friction of the worlds, at the end of the recipes ``fetch_push`` and ``fetch_slide`` |
| 5.3    | success at the hidden friction, step by step                                                         |

    near = mean success where the friction is within a tenth of the prior's width of the hidden one,  far = elsewhere

Both policies of a task have seen as many steps. Success is judged on exact worlds, at the last step of an episode. Each
run is kept, so that a second start goes on.

    python -m recipes.studies.fetch_robustness [--tasks push]       -> docs/results/fetch-robustness.json
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import torch
from matplotlib.figure import Figure
from torch import Tensor

from envs.fetch import FRICTION
from onlinebayes.experiments import Kind, Run, folder_of, status
from onlinebayes.inference.plots import POSTERIOR, PRIOR, TRUTH, save
from onlinebayes.runs import Progress, ResultTable
from onlinebayes.trainers import Listed
from recipes import fetch_push, fetch_slide
from recipes.fetch import WORDS, outcomes
from recipes.studies.finished_run import finished_run
from recipes.studies.jobs import finished, printed_by

Task = Literal["push", "slide"]
CELLS, EPISODES, NEAR = 12, 64, 0.1
KINDS: dict[Kind, str] = {"prior": PRIOR, "online": POSTERIOR}
BUILD: dict[Task, Callable[..., Run]] = {"push": fetch_push.build, "slide": fetch_slide.build}


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    tasks: tuple[Task, ...] = get_args(Task)
    """which recipes"""
    seeds: tuple[int, ...] = (0,)
    """of truths, worlds and networks; the first one's are drawn"""
    out: str = "out/fetch_robustness"
    """runs go here"""
    results: Path = Path("docs/results")
    """folder of the table and the pictures"""


@dataclass(frozen=True)
class Seen:
    """Figures of one policy.

    Attributes:
        frames, course: steps so far and success at the hidden friction, at each outer step.
        along: success at each friction of the grid (CELLS,).
        density: log density of the hidden friction at the end [nats].
    """

    frames: list[int]
    course: list[float]
    along: Tensor
    density: float


def main(study: Study) -> int:
    """Do what is missing, print the table, draw the figures."""
    table = ResultTable("fetch-robustness", printed_by("fetch-robustness", study), study.seeds)
    keys = [(task, seed, kind) for task in study.tasks for seed in study.seeds for kind in KINDS]
    found: dict[tuple[Task, int, Kind], tuple[Run, Seen]] = {}
    with Progress("fetch-robustness", len(keys)) as progress:
        for i, key in enumerate(keys):
            progress.update(i, f"{key[0]}, seed {key[1]}, {key[2]}")
            found[key] = seen(study, *key)
    for task in study.tasks:
        tabled(table, task, [{kind: found[task, seed, kind] for kind in KINDS} for seed in study.seeds])
    first = {task: {kind: found[task, study.seeds[0], kind] for kind in KINDS} for task in study.tasks}
    for name, figure in (("4.6", along_the_friction(first)), ("5.3", step_by_step(first))):
        save(figure, study.results / f"figure-{name}.png", dpi=110)
    return finished(table, study.results)


def seen(study: Study, task: Task, seed: int, kind: Kind) -> tuple[Run, Seen]:
    """A run and what it reached."""
    settings_of = fetch_push.Settings if task == "push" else fetch_slide.Settings
    settings = settings_of(seed=seed, kind=kind, out=study.out)
    name = f"fetch_{task}"
    made, state = finished_run(name, BUILD[task], settings)
    with (Path(study.out) / folder_of(name, settings) / "log.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    theta = grid(made).repeat_interleave(EPISODES)[:, None]
    policy = made.trainer.objective.policy
    reached = outcomes(made.problem, policy, Listed(theta), len(theta), 79).reached[:, -1]
    density = float(state.belief.log_prob(made.truth))
    course = [float(row[f"figure/{WORDS['last']}"]) for row in rows]
    frames = [int(row["frames"]) for row in rows]
    return made, Seen(frames, course, reached.double().unflatten(0, (CELLS, EPISODES)).mean(1), density)


def grid(made: Run) -> Tensor:
    """The middles of equal parts of the prior (CELLS,)."""
    bounds = made.problem.space[FRICTION]
    return bounds.low + (bounds.high - bounds.low) * (torch.arange(CELLS, dtype=torch.float64) + 0.5) / CELLS


def tabled(table: ResultTable, task: Task, runs: list[dict[Kind, tuple[Run, Seen]]]) -> None:
    """Rows of one task."""
    means: dict[tuple[Kind, bool], list[float]] = {}
    for run in runs:
        made = run["prior"][0]
        bounds = made.problem.space[FRICTION]
        near = (grid(made) - made.truth).abs() <= NEAR * (bounds.high - bounds.low)
        for kind in KINDS:
            for where in (True, False):
                means.setdefault((kind, where), []).append(float(run[kind][1].along[near == where].mean()))
    for (kind, where), values in means.items():
        words = "near the hidden friction" if where else "elsewhere"
        table.add_seeds(f"{task}, {kind}: success {words}", values)
    gain = [b - a for a, b in zip(means["prior", True], means["online", True], strict=True)]
    table.add_seeds(f"{task}: online above prior, near", gain, least=0.0 if task == "slide" else None)
    table.add_seeds(f"{task}, online: log density of the friction", [r["online"][1].density for r in runs], unit="nats")
    table.add(f"{task}: the prior's density", float(runs[0]["prior"][1].density), unit="nats")
    table.add(f"{task}: steps of each run", runs[0]["prior"][1].frames[-1], unit="steps")


def along_the_friction(found: dict[Task, dict[Kind, tuple[Run, Seen]]]) -> Figure:
    """Figure 4.6."""
    figure = Figure(figsize=(4.5 * len(found), 3.6), layout="constrained")
    axes = figure.subplots(1, len(found), squeeze=False)[0]
    for ax, (task, runs) in zip(axes, found.items(), strict=True):
        for kind, color in KINDS.items():
            made, one = runs[kind]
            ax.plot(grid(made), one.along, "o-", color=color, label="prior" if kind == "prior" else "posterior")
        ax.axvline(float(made.truth), color=TRUTH, lw=1, label="hidden friction")
        ax.set(title=f"Fetch {task}", xlabel="friction", ylabel="success at the last step", ylim=(0, 1.02))
    axes[-1].legend(frameon=False, fontsize=9)
    return figure


def step_by_step(found: dict[Task, dict[Kind, tuple[Run, Seen]]]) -> Figure:
    """Figure 5.3."""
    figure = Figure(figsize=(4.5 * len(found), 3.6), layout="constrained")
    axes = figure.subplots(1, len(found), squeeze=False)[0]
    for ax, (task, runs) in zip(axes, found.items(), strict=True):
        for kind, color in KINDS.items():
            one = runs[kind][1]
            label = "prior" if kind == "prior" else "online, with the posterior"
            ax.plot(torch.tensor(one.frames) / 1000, one.course, "o-", color=color, label=label)
        ax.set(
            title=f"Fetch {task}", xlabel="steps [thousand]", ylabel="success at the hidden friction", ylim=(0, 1.02)
        )
    axes[0].legend(frameon=False, fontsize=9)
    return figure


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
