"""One picture of the demonstration: the replay before and after, the two posteriors, the two policies on the rig."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import gaussian_kde

from envs.driven_pendulum import BalanceTask
from envs.driven_pendulum.rig import DAMPING, DELAY, MASS
from onlinebayes.criticism import ReplayedRun
from recipes.demo.run import SIGNAL, Branch, Outcome

RIG, WRONG, MENDED, GROUND = "#1f2933", "#d1495b", "#2a6f97", "#8a8f98"
SHOWN = 8  # episodes of each policy
NARROW = 0.2  # of an axis: what a cloud spans at most to be enlarged
MASSES = (0.95, 0.5)  # shares of a posterior within its contours


def picture(outcome: Outcome) -> Figure:
    """Three panels, one a stage, and one legend for all."""
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 3)
    for axis, draw in zip(panels, (_replay, _posteriors, _swings), strict=True):
        title, says = draw(axis, outcome)
        axis.set_title(f"{title}\n{says}", loc="left", fontsize=10.5, color=RIG, linespacing=1.5)
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=9)
    handles = [
        Line2D([], [], color=RIG, lw=4, alpha=0.35, label="the rig"),
        Line2D([], [], color=WRONG, lw=2.5, label="the model as it was"),
        Line2D([], [], color=MENDED, lw=2.5, label="the mended model"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=10.5)
    return figure


def _replay(axis: Axes, outcome: Outcome) -> tuple[str, str]:
    """A held-out run, every second simulated anew from its measured start."""
    base, final = outcome.criticism.base.replays, outcome.criticism.final.replays
    before, after = next((b, a) for b, a in zip(base, final, strict=True) if b.held_out)
    time = before.time.numpy()
    axis.plot(time, before.measured[:, 0].numpy(), color=RIG, lw=4, alpha=0.35)
    axis.plot(time, _broken(before), color=WRONG, lw=1.5)
    axis.plot(time, _broken(after), color=MENDED, lw=1.5)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("angle [rad]")
    error = outcome.criticism.heldout_error
    scale = f"{1e3 * error.before[SIGNAL]:.0f} → {1e3 * error.after[SIGNAL]:.1f} mrad"
    return (
        "A held-out run, replayed second by second",
        f"error {scale} (noise floor {1e3 * error.noise_floor[SIGNAL]:.1f})",
    )


def _broken(replay: ReplayedRun) -> Float[np.ndarray, " T"]:
    """The simulated angle with gaps where a new window starts."""
    curve = replay.simulated[:, 0].numpy().copy()
    curve[1:][np.diff(replay.window.numpy()) != 0] = math.nan
    return curve


def _posteriors(axis: Axes, outcome: Outcome) -> tuple[str, str]:
    """Mass and damping under both models, the rig's own as a cross; the mended model's enlarged where it is narrow."""
    at = np.array([outcome.truth[MASS], 1e3 * outcome.truth[DAMPING]])
    clouds = [_points(outcome.wrong), _points(outcome.mended)]
    axis.set_xlabel("mass of the bob [kg]")
    axis.set_ylabel("damping [mN m s/rad]")
    _cloud(axis, clouds[0], WRONG)
    _mended(axis, clouds[1], at)
    low, high = _limits(axis, np.concatenate([*clouds, at[None]]), 0.12)
    if (np.ptp(clouds[1], axis=0) < NARROW * (high - low)).any():
        inset = axis.inset_axes((0.45, 0.56, 0.5, 0.42))
        _mended(inset, clouds[1], at)
        _limits(inset, np.concatenate([clouds[1], at[None]]), 0.3)
        inset.tick_params(labelsize=7)
        inset.locator_params(nbins=3)
        axis.indicate_inset_zoom(inset, edgecolor=GROUND)
    if DELAY not in outcome.mended.names:
        return "Posteriors given the measured runs", "no delay was found"
    delay = 1e3 * outcome.mended.samples[:, outcome.mended.names.index(DELAY)]
    found = f"{float(delay.mean()):.2f} ± {float(delay.std()):.2f} ms"
    return "Posteriors given the measured runs", f"motor delay {found}, the rig's {1e3 * outcome.truth[DELAY]:.2f}"


def _mended(axis: Axes, points: Float[np.ndarray, "S 2"], at: Float[np.ndarray, " 2"]) -> None:
    _cloud(axis, points, MENDED)
    axis.plot(*at, "+", color=RIG, ms=15, mew=2)


def _limits(
    axis: Axes, points: Float[np.ndarray, "S 2"], margin: float
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Set the limits of the axes: all points and a margin, no negative damping."""
    low, high = points.min(0), points.max(0)
    low, high = low - margin * (high - low), high + margin * (high - low)
    low[1] = max(low[1], 0.0)
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    return low, high


def _points(branch: Branch) -> Float[np.ndarray, "S 2"]:
    """Draws of mass [kg] and damping [mN m s/rad]."""
    points = branch.samples[:1500, [branch.names.index(MASS), branch.names.index(DAMPING)]].numpy()
    return points * np.array([1.0, 1e3])


def _cloud(axis: Axes, points: Float[np.ndarray, "S 2"], colour: str) -> None:
    """Contours that hold half and 95 % of the draws."""
    density = gaussian_kde(points.T)
    levels = np.quantile(density(points.T), [1 - mass for mass in MASSES])
    low, high = np.quantile(points, 0.01, axis=0), np.quantile(points, 0.99, axis=0)
    wide = 0.5 * (high - low)
    sides = [np.linspace(low[i] - wide[i], high[i] + wide[i], 120) for i in range(2)]
    grid = np.stack(np.meshgrid(*sides))
    heights = density(grid.reshape(2, -1)).reshape(grid.shape[1:])
    axis.contourf(*grid, heights, levels=[*levels, heights.max() * 1.01], colors=[colour, colour], alpha=0.3)
    axis.contour(*grid, heights, levels=levels, colors=colour, linewidths=1.2)


def _swings(axis: Axes, outcome: Outcome) -> tuple[str, str]:
    """Angles from upright over the episodes; a line ends where the bob has fallen."""
    task = BalanceTask()
    for branch, colour in ((outcome.wrong, WRONG), (outcome.mended, MENDED)):
        angle = branch.angle[:SHOWN].numpy()
        # After a fall the next episode begins: its start is a jump.
        fallen = np.cumsum(np.abs(np.diff(angle, axis=1, prepend=angle[:, :1])) > 0.4, axis=1) > 0
        time = task.period * np.arange(angle.shape[1])
        axis.plot(time, np.where(fallen, math.nan, angle).T, color=colour, lw=1.2, alpha=0.85)
    for side in (1, -1):
        axis.axhspan(side * 1.0, side * 1.25, color=GROUND, alpha=0.18, lw=0)
        axis.text(1.95, side * 1.12, "fallen", ha="right", va="center", fontsize=9, color=GROUND)
    axis.set_ylim(-1.25, 1.25)
    axis.set_xlim(0, task.period * task.horizon)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("angle from upright [rad]")
    wrong, mended = (float(branch.returns.mean()) for branch in (outcome.wrong, outcome.mended))
    return "Both policies on the rig", f"return {wrong:.0f} → {mended:.0f} of {task.horizon}"
