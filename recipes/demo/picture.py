"""One picture of the demonstration: the replay before and after, the two posteriors, the two policies on the rig."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import gaussian_kde

from envs.driven_pendulum import BalanceTask
from envs.driven_pendulum.rig import DAMPING, DELAY, MASS
from onlinebayes.criticism import ReplayedRun
from recipes.demo.run import Branch, Outcome

MEASURED, WRONG, MENDED, TRUTH = "#1f2933", "#d1495b", "#2a6f97", "#8a8f98"
SHOWN = 6  # episodes of each policy


def picture(outcome: Outcome) -> Figure:
    """Three panels, one a stage."""
    figure = Figure(figsize=(13, 4.1), layout="constrained")
    FigureCanvasAgg(figure)
    left, middle, right = figure.subplots(1, 3)
    _replay(left, outcome)
    _posteriors(middle, outcome)
    _swings(right, outcome)
    for axis, text in ((left, "measured and simulated"), (middle, "posterior"), (right, "policies on the rig")):
        axis.set_title(text, loc="left", fontsize=11, color=MEASURED)
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=9)
    return figure


def _replay(axis: Axes, outcome: Outcome) -> None:
    """A held-out run, every second simulated anew from its measured start."""
    base, final = outcome.criticism.base.replays, outcome.criticism.final.replays
    before, after = next((b, a) for b, a in zip(base, final, strict=True) if b.held_out)
    time = before.time.numpy()
    axis.plot(time, before.measured[:, 0].numpy(), color=MEASURED, lw=3.2, alpha=0.35, label="measured")
    axis.plot(time, _broken(before), color=WRONG, lw=1.4, label="model as it was")
    axis.plot(time, _broken(after), color=MENDED, lw=1.4, label="mended model")
    error = outcome.criticism.heldout_error
    (signal,) = outcome.criticism.signals
    axis.text(
        0.02,
        0.02,
        f"held-out error {1e3 * error.before[signal]:.0f} → {1e3 * error.after[signal]:.1f} mrad",
        transform=axis.transAxes,
        fontsize=9,
        color=MEASURED,
    )
    axis.set_xlabel("time [s]")
    axis.set_ylabel("angle [rad]")
    axis.margins(y=0.15)
    axis.legend(frameon=False, fontsize=8, loc="upper right", ncols=3)


def _broken(replay: ReplayedRun) -> np.ndarray:
    """The simulated angle with gaps where a new window starts."""
    curve = replay.simulated[:, 0].numpy().copy()
    curve[1:][np.diff(replay.window.numpy()) != 0] = math.nan
    return curve


def _posteriors(axis: Axes, outcome: Outcome) -> None:
    """Mass and damping under both models, the truth as a cross."""
    for branch, colour, name in ((outcome.wrong, WRONG, "model as it was"), (outcome.mended, MENDED, "mended model")):
        _cloud(axis, branch, colour, name)
    truth = outcome.truth
    axis.plot(truth[MASS], 1e3 * truth[DAMPING], "+", color=MEASURED, ms=14, mew=1.8, label="the rig")
    axis.set_xlabel("bob's mass [kg]")
    axis.set_ylabel("damping [mN m s/rad]")
    axis.margins(0.25)
    if DELAY in outcome.mended.names:
        delay = 1e3 * outcome.mended.samples[:, outcome.mended.names.index(DELAY)]
        text = f"delay {float(delay.mean()):.1f} ± {float(delay.std()):.1f} ms\n(the rig: {1e3 * truth[DELAY]:.1f} ms)"
        axis.text(0.02, 0.02, text, transform=axis.transAxes, fontsize=9, color=MENDED, va="bottom")
    axis.legend(frameon=False, fontsize=8, loc="upper right")


def _cloud(axis: Axes, branch: Branch, colour: str, name: str) -> None:
    points = branch.samples[:, [branch.names.index(MASS), branch.names.index(DAMPING)]].numpy()
    points = points[:1500] * np.array([1.0, 1e3])
    axis.scatter(points[:, 0], points[:, 1], s=3, color=colour, alpha=0.12, lw=0)
    density = gaussian_kde(points.T)
    levels = np.quantile(density(points.T), (0.05, 0.32))
    (x0, y0), (x1, y1) = points.min(0), points.max(0)
    grid = np.stack(np.meshgrid(np.linspace(x0, x1, 80), np.linspace(y0, y1, 80)))
    heights = density(grid.reshape(2, -1)).reshape(80, 80)
    axis.contour(*grid, heights, levels=levels, colors=colour, linewidths=(0.9, 1.6))
    axis.plot([], [], color=colour, lw=2, label=name)


def _swings(axis: Axes, outcome: Outcome) -> None:
    """Angles from upright over the episodes; a line ends where the bob has fallen."""
    task = BalanceTask()
    for branch, colour, name in ((outcome.wrong, WRONG, "model as it was"), (outcome.mended, MENDED, "mended model")):
        angle = branch.angle[:SHOWN].numpy()
        fallen = np.cumsum(np.abs(np.diff(angle, axis=1, prepend=angle[:, :1])) > 0.4, axis=1) > 0
        time = task.period * np.arange(angle.shape[1])
        axis.plot(time, np.where(fallen, math.nan, angle).T, color=colour, lw=1.2, alpha=0.85)
        mean = float(branch.returns.mean())
        axis.plot([], [], color=colour, lw=2, label=f"{name}: {mean:.0f} of {task.horizon} steps")
    axis.axhline(0, color=TRUTH, lw=0.8, zorder=0)
    axis.axhspan(1.0, 1.25, color=TRUTH, alpha=0.15, lw=0)
    axis.axhspan(-1.25, -1.0, color=TRUTH, alpha=0.15, lw=0)
    axis.text(
        0.98, 1.12, "fallen", ha="right", va="center", fontsize=8, color=TRUTH, transform=axis.get_yaxis_transform()
    )
    axis.set_ylim(-1.25, 1.6)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("angle from upright [rad]")
    axis.legend(frameon=False, fontsize=8, loc="upper right")
