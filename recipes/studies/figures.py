"""``make figures``: Figures 4.3, 4.4, 4.5 and 5.2 of the thesis, with this library; 4.1 and 4.2 are block diagrams.

| figure | what is drawn                                                                                         |
|--------|-------------------------------------------------------------------------------------------------------|
| 4.3    | joint posteriors of CartPole's pole, two truths: by BayesSim's statistics, and by the filter                |
| 4.4    | one parameter, the pendulum's timestep, by every method of ``make tables`` (the thesis has Fetch Slide)     |
| 4.5    | return of CartPole policies along length and mass, trained on the prior and on the posterior, three seeds   |
| 5.2    | return and belief of one online run, step by step                                                           |

Figures 4.6 and 5.3, Fetch, are drawn by ``make fetch-robustness``.

    python -m recipes.studies.figures [--figures 4.5]       -> docs/results/figure-4.3.png ...
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from onlinebayes.experiments import Kind, Run, Settings, status
from onlinebayes.inference import Belief, BoxUniform, Density
from onlinebayes.inference.plots import POSTERIOR, PRIOR, TRUTH, save
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import Progress, seed_everything
from onlinebayes.trainers import Listed, OnlineState, returns
from onlinebayes.transforms import ParameterRandomization
from recipes import cartpole, pendulum
from recipes.studies import tables
from recipes.studies.one_round import OneRound, begun, mixture
from recipes.studies.table_systems import SYSTEMS

Name = Literal["4.3", "4.4", "4.5", "5.2"]
TRUTHS, SEED, SEEDS, CELLS, EPISODES = ((0.7, 1.3), (0.3, 0.5)), 551, (1, 2, 3), 24, 8
GRID = 200


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    figures: tuple[Name, ...] = get_args(Name)
    """which figures"""
    out: Path = Path("docs/results")
    """folder of the pictures"""


def main(study: Study) -> int:
    """Draw them."""
    draw: dict[Name, Callable[[], Figure]] = {
        "4.3": joint_posteriors,
        "4.4": by_method,
        "4.5": robustness,
        "5.2": step_by_step,
    }
    with Progress("figures", len(study.figures)) as progress:
        for i, name in enumerate(study.figures):
            progress.update(i, f"figure {name}")
            path = study.out / f"figure-{name}.png"
            save(draw[name](), path, dpi=110)
            print(f"written: {path}")
    return 0


def joint_posteriors() -> Figure:
    """Figure 4.3."""
    draw, system = begun(SEED), SYSTEMS["CartPole"]
    sets = system.simulate(BoxUniform(system.space).sample((tables.SIMULATIONS,), draw), draw)
    estimator = tables.mixture(tables.thesis_statistics, system.space, sets)
    estimator.fit(sets, generator=draw)
    one = OneRound.of("cartpole", SEED, 0.01)
    filtered = mixture(one, one.filtered())
    filtered.fit(one.simulated(1000), generator=draw)
    figure = Figure(figsize=(9, 7.5), layout="constrained")
    for row, truth in zip(figure.subplots(2, 2), TRUTHS, strict=True):
        measured = system.simulate(torch.tensor([truth], dtype=torch.float64), draw)[0].exclude("theta")
        drawn_plane(row[0], estimator.condition(measured), system.space, truth, zoomed=True)
        row[0].set_title("statistics of ten rollouts, no sensor noise", fontsize=10)
        inside = tuple(min(value, 0.95) for value in truth)
        theta = torch.tensor([inside], dtype=torch.float64)
        seen = one.worlds(1, 5).draw([one.policy] * 3, Listed(theta))
        drawn_plane(row[1], filtered.condition(seen.exclude("theta")), one.problem.space, inside, zoomed=True)
        row[1].set_title("filter, three rollouts, 1 % sensor noise", fontsize=10)
    return figure


def drawn_plane(
    ax: Axes, posterior: Density, space: ParameterSpace, truth: tuple[float, ...], *, zoomed: bool = False
) -> None:
    """Density of two parameters, dark where it is high; the truth as a star.

    Args:
        ax: to draw in.
        posterior: over the two.
        space: their names and bounds.
        truth: theirs.
        zoomed: show what holds the posterior and the truth, not the whole box.
    """
    low, high = (torch.tensor([getattr(p, side) for p in space.values()]).double() for side in ("low", "high"))
    if zoomed:
        shown = torch.cat([posterior.sample((2000,)).double(), torch.tensor([truth]).double()])
        least, most = shown.amin(0), shown.amax(0)
        low, high = torch.maximum(low, least - 0.1 * (most - least)), torch.minimum(high, most + 0.1 * (most - least))
    axis = (torch.arange(GRID, dtype=torch.float64) + 0.5) / GRID
    theta = low + (high - low) * torch.cartesian_prod(axis, axis)
    density = posterior.log_prob(theta).exp().reshape(GRID, GRID).T
    extent = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    ax.imshow(density.sqrt(), origin="lower", extent=extent, aspect="auto", cmap="Blues")
    ax.plot(*truth, "*", color=TRUTH, markersize=12, fillstyle="none")
    across, up = space.names
    ax.set(xlabel=f"{across} [{space[across].unit}]", ylabel=f"{up} [{space[up].unit}]")


def by_method() -> Figure:
    """Figure 4.4, of the pendulum's timestep."""
    draw, system = begun(SEED), SYSTEMS["Pendulum"]
    sets = system.simulate(BoxUniform(system.space).sample((tables.SIMULATIONS,), draw), draw)
    true = system.simulate(system.space.vector(system.truth)[None], draw)[0].exclude("theta")
    value = system.truth["dt"]
    theta = torch.linspace(value - 0.04, value + 0.04, 400, dtype=torch.float64)[:, None]
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    ax = figure.subplots()
    for column, make in tables.COLUMNS.items():
        estimator, single = make(system.space, sets), column == "rejection"
        estimator.fit(sets[:, 0] if single else sets, generator=draw)
        ax.plot(theta[:, 0], estimator.condition(true).log_prob(theta).exp(), label=column, lw=1.4)
    ax.axvline(value, color="black", lw=1, ls="--", label="truth")
    ax.set(xlabel="timestep [s]", ylabel="density [1/s]", title="Posteriors of the pendulum's timestep")
    ax.legend(frameon=False, fontsize=8)
    return figure


def robustness() -> Figure:
    """Figure 4.5: mean over seeds, and the lowest and highest."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    kinds: dict[Kind, str] = {"prior": PRIOR, "posterior-first": POSTERIOR}
    for kind, color in kinds.items():
        runs = [learnt(kind, seed) for seed in SEEDS]
        for index, ax in enumerate(axes):
            drawn_along(ax, runs, index, color, "prior" if kind == "prior" else "posterior")
    space = runs[0].problem.space
    for ax, name, value in zip(axes, space.names, runs[0].truth.tolist(), strict=True):
        ax.axvline(value, color=TRUTH, lw=1)
        ax.set_xlabel(f"{name} [{space[name].unit}]")
    axes[0].set_ylabel("return")
    axes[0].legend(frameon=False, title="worlds trained in")
    figure.suptitle("CartPole policies away from the true pole (red): mean and range of three seeds", fontsize=10)
    return figure


def learnt(kind: Kind, seed: int) -> Run:
    """A recipe's run; the truth is Gymnasium's pole for every seed."""
    seed_everything(seed)
    made = cartpole.build(Settings(seed=0, kind=kind), cartpole.SPACE)
    made.trainer.run(OnlineState.begin(made.problem.prior))
    return made


def drawn_along(ax: Axes, runs: list[Run], index: int, color: str, label: str) -> None:
    """Returns along one parameter, the other at its truth."""
    problem = runs[0].problem
    name = problem.space.names[index]
    theta = runs[0].truth.repeat(CELLS, 1)
    theta[:, index] = torch.linspace(problem.space[name].low, problem.space[name].high, CELLS, dtype=theta.dtype)
    each = torch.stack([along(run, theta) for run in runs])
    ax.fill_between(theta[:, index], each.amin(0), each.amax(0), color=color, alpha=0.25, lw=0)
    ax.plot(theta[:, index], each.mean(0), color=color, label=label)


def along(run: Run, theta: Tensor) -> Tensor:
    """Mean return at each theta."""
    env = run.problem.worlds(len(theta) * EPISODES, ParameterRandomization(Listed(theta.repeat(EPISODES, 1))), 999)
    found = returns(env, run.trainer.objective.policy, run.problem.task.horizon)
    return found.unflatten(0, (EPISODES, -1)).mean(0)


def step_by_step() -> Figure:
    """Figure 5.2, of the pendulum: CartPole is balanced after the first step."""
    seed_everything(SEED)
    made = pendulum.build(Settings(seed=2))
    beliefs: list[Belief] = []
    found = [made.problem.score(made.trainer.objective.policy, made.truth)]

    def look(state: OnlineState) -> None:
        beliefs.append(state.belief)
        found.append(made.problem.score(made.trainer.objective.policy, made.truth))

    made.trainer.run(OnlineState.begin(made.problem.prior), on_step=look)
    figure = Figure(figsize=(11, 6), layout="constrained")
    grid = figure.add_gridspec(2, 4)
    ax = figure.add_subplot(grid[0, :])
    ax.plot(range(len(found)), found, "o-", color=POSTERIOR)
    ax.set(xlabel="outer steps", ylabel="return on the true system", title="Online BayesSim on the pendulum")
    for column, step in enumerate((0, 1, len(beliefs) // 2, len(beliefs) - 1)):
        plane = figure.add_subplot(grid[1, column])
        drawn_plane(plane, beliefs[step], made.problem.space, tuple(made.truth.tolist()), zoomed=True)
        plane.set_title(f"belief after step {step + 1}")
    return figure


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
