"""``make robustness``: where a policy trained on the posterior is better than one trained on the prior, and where not.

    R(pi, theta) for theta on a grid over the prior's box        Figures 4.5 and 5.2 of the thesis

The policies are those of ``make online``, which has to have been run in the same folder. Near is what lies within a
tenth of the box's width of the hidden truth, in every parameter: some two standard deviations of the last belief. Far
is all else.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from matplotlib.figure import Figure
from torch import Tensor

from onlinebayes.experiments import Kind, Run, Settings, folder_of, status
from onlinebayes.runs import BadInput, Checkpoints, Progress, ResultTable, atomic_path
from onlinebayes.trainers import Listed, OnlineState, Saver, returns
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.online import BUILD

SIDE, EPISODES, NEAR = 15, 4, 0.1
KINDS: tuple[Kind, ...] = ("prior", "online")


@dataclass(frozen=True)
class Study:
    """Which runs of ``make online`` are looked at."""

    tasks: tuple[str, ...] = ("pendulum", "acrobot", "cartpole_motor")
    """which recipes"""
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5)
    """which truths"""
    runs: str = "out/online"
    """where their folders lie"""
    out: str = "docs/results"
    """folder of robustness.json, robustness.md and a picture for each task"""


@dataclass(frozen=True)
class Grid:
    """Returns (SIDE^2,) over the box for each kind of policy, and which cells are near the truth."""

    returns: dict[Kind, Float[Tensor, " C"]]
    near: Tensor
    truth: Float[Tensor, " P"]


def main(study: Study) -> int:
    """Judge every policy, print the table, draw the first seed's grids."""
    table = ResultTable("robustness", "make robustness", study.seeds)
    with Progress("robustness", len(study.tasks) * len(study.seeds)) as progress:
        for t, task in enumerate(study.tasks):
            grids = []
            for s, seed in enumerate(study.seeds):
                progress.update(t * len(study.seeds) + s, f"{task}, seed {seed}")
                grids.append(judged(study, task, seed))
            told(table, task, grids)
            draw(grids[0], task, Path(study.out) / f"robustness-{task}.svg")
    print(table.to_markdown())
    print(f"written: {table.write(study.out)}")
    return 0 if table.holds else 1


def judged(study: Study, task: str, seed: int) -> Grid:
    """Returns of the two policies of one truth over the grid."""
    axis = (torch.arange(SIDE, dtype=torch.float64) + 0.5) / SIDE
    cells = torch.cartesian_prod(axis, axis)
    found: dict[Kind, Tensor] = {}
    for kind in KINDS:
        made = trained(study, task, kind, seed)
        theta = made.problem.space.from_unit(cells).repeat_interleave(EPISODES, 0)
        env = made.problem.worlds(len(theta), ParameterRandomization(Listed(theta)), 999)
        got = returns(env, made.trainer.objective.policy, made.problem.task.horizon)
        found[kind] = got.unflatten(0, (-1, EPISODES)).mean(1)
    truth = made.problem.space.to_unit(made.truth)
    return Grid(found, ((cells - truth).abs() <= NEAR).all(-1), made.truth)


def trained(study: Study, task: str, kind: Kind, seed: int) -> Run:
    """A run of ``make online`` as it ended."""
    settings = Settings(seed=seed, kind=kind, out=study.runs)
    made, folder = BUILD[task](settings), Path(study.runs) / folder_of(task, settings)
    if not (folder / "finished").exists():
        raise BadInput(f"{folder} holds no finished run", "run make online first, or name other seeds and tasks")
    Saver(made.trainer, Checkpoints(folder, task)).resume(OnlineState.begin(made.problem.prior))
    return made


def told(table: ResultTable, task: str, grids: list[Grid]) -> None:
    """Rows of one task: means near the truth and far from it, medians over the seeds."""
    for near, where in ((True, "near the truth"), (False, "far from it")):
        mean = {kind: [float(g.returns[kind][g.near == near].mean()) for g in grids] for kind in KINDS}
        for kind, values in mean.items():
            table.add_seeds(f"{task}, {kind}: return {where}", values)
        gain = [b - a for a, b in zip(mean["prior"], mean["online"], strict=True)]
        table.add_seeds(f"{task}: online above prior, {where}", gain, least=0.0 if near else None)


def draw(grid: Grid, task: str, path: Path) -> None:
    """Both policies' returns over the box, in one range of colours; the hidden truth as a cross."""
    space = BUILD[task](Settings()).problem.space
    everything = torch.cat(list(grid.returns.values()))
    low, high = float(everything.min()), float(everything.max())
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    ends = [float(x) for x in space.from_unit(torch.tensor([[0.0, 0.0], [1.0, 1.0]], dtype=torch.float64)).T.flatten()]
    for ax, kind in zip(axes, KINDS, strict=True):
        values = grid.returns[kind].reshape(SIDE, SIDE).T
        picture = ax.imshow(values, origin="lower", extent=ends, aspect="auto", vmin=low, vmax=high)
        ax.plot(*grid.truth.tolist(), "x", color="white", markersize=10, markeredgewidth=2)
        ax.set(title=f"trained on the {'prior' if kind == 'prior' else 'posterior, online'}", xlabel=space.names[0])
    axes[0].set_ylabel(space.names[1])
    figure.colorbar(picture, ax=axes, label="return")
    with atomic_path(path) as file:
        figure.savefig(file, format="svg")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
