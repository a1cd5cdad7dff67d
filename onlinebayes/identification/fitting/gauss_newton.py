"""Theta and all windows' starts of one hypothesis, fitted to the score: damped Gauss-Newton within bounds.

    step:  min |r~ - C~ d|^2 + lambda |D d|^2,   low <= theta + d <= high,    D^2 = diag(C~' C~)     (Marquardt 1963)

The undamped step is tried first, and all dampings at once where it brings less than half of what it promises. Where
theta and all starts together promise next to nothing the fit has ended, and nothing is tried. The weights are renewed
after each step, so that the fit ends where the score of the data it saw has no slope (iteratively reweighted least
squares). Derivatives cost a replay for each parameter and start: they are kept as long as steps with them keep that
promise (chord method).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.rows import Rows, band_counts, band_squares, project, score_weights, start_shift
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise
from onlinebayes.identification.fitting.theta import room
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

DAMPINGS = (0.003, 0.03, 0.3, 3.0, 30.0)
"""Marquardt's lambdas, replayed side by side where the undamped step does not descend."""

MOST_STEPS = 16
"""A fit ends after so many steps."""

PROMISE_KEPT = 0.5
"""Share of the promised gain below which a step is damped, and derivatives are worked out anew."""

FEW = 8
"""Windows at least, and a quarter of all, that show from where a fit leads on: those that err most."""

SETTLED = 2e-3
"""A step that lowers the score by less ends the fit: a tenth of what any rule looks at."""


@dataclass(frozen=True)
class Fitted:
    """A simulator fitted to windows.

    Args:
        simulator: what was fitted.
        rough: the same, integrated as is enough for derivatives.
        lin: its replay and sensitivities at the mode.
        rows: the same, starts taken out, with the weights of the score there.
        score: of the data that it was fitted to, see :func:`score_of`.
    """

    simulator: Identifiable
    rough: Identifiable
    lin: Linearisation
    rows: Rows
    score: float

    @property
    def theta(self) -> Float[Tensor, " P"]:
        """The mode [SI]."""
        return self.lin.theta

    def of(self, some: Int[Tensor, " V"]) -> Fitted:
        """In some of the windows."""
        lin, rows = self.lin, self.rows
        parts = {name: getattr(lin, name)[some] for name in ("starts", "residual", "by_start", "by_theta")}
        cut = {name: getattr(rows, name)[some] for name in ("residual", "columns", "basis", "triangle", "prior_weight")}
        return replace(self, lin=replace(lin, **parts), rows=replace(rows, **cut))


def score_of(windows: Windows, residual: Float[Tensor, "W n S"]) -> float:
    """Sum over signals of the mean over bands of 1/2 log(mean square + 1), for a residual in units of noise."""
    count = band_counts(windows).sum(0)
    mean_square = band_squares(windows, residual).sum(0) / count.clamp_min(1.0)
    return float((0.5 * torch.log1p(mean_square)).mean(0).sum())


def fit(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"] | None = None,
    *,
    rough: Identifiable | None = None,
    most: int = MOST_STEPS,
    wanted: float = math.inf,
) -> Fitted:
    """Fit from a starting value.

    Args:
        simulator: what is fitted; its parameters' bounds are the prior.
        windows: the data.
        theta: where to begin [SI].
        starts: where the windows' starts begin; the smoothed ones when None.
        rough: the simulator by which derivatives are taken; the same when None.
        most: steps.
        wanted: a score; the fit is given up where the steps that are left would not come down to it at its pace. Its
            derivatives are then those of an earlier step.

    Raises:
        BadInput: the replay diverges where it begins.
    """
    models = (simulator, simulator if rough is None else rough)
    begun = windows.start if starts is None else starts
    here = _linearised(*models, windows, simulator.parameters.clamp(theta), begun)
    if here is None:
        raise BadInput(
            "the simulation diverges over the measured windows",
            "check the model, its time step and the bounds of its parameters, or shorten horizon_s",
        )
    fresh, gained = True, 0.0
    for left in reversed(range(most)):
        promise = _promise(windows, here)
        if here.score - (left + 1) * max(promise, gained) > wanted:
            return here
        if promise + _start_promise(windows, here) < SETTLED:
            if fresh:
                break
            here, fresh = _linearised(*models, windows, here.theta, here.lin.starts) or here, True
            continue
        there = _stepped(windows, here, promise)
        gained = here.score - there.score
        settled, fresh = fresh and gained < SETTLED, gained < max(SETTLED, PROMISE_KEPT * promise)
        here = there
        if settled:
            break
        if here.score - left * max(promise, gained) > wanted:
            return here
        if fresh:  # old derivatives lead no further
            here = _linearised(*models, windows, here.theta, here.lin.starts) or here
    return here if fresh else _linearised(*models, windows, here.theta, here.lin.starts) or here


def best_theta(
    simulator: Identifiable,
    rough: Identifiable,
    windows: Windows,
    thetas: Float[Tensor, "G B P"],
    starts: Float[Tensor, "W J2"] | None = None,
) -> Float[Tensor, " P"]:
    """Choose a fit's start: of each of G groups the theta whose replay comes nearest, of these the one that leads on.

    Which of them leads on is what one step from there promises, in the windows that err most: a law that replaces
    another one makes the replay worse until theta and the starts have followed.

    Args:
        simulator, rough, windows, starts: as for :func:`fit`.
        thetas: B alternatives in each group [SI].
    """
    if len(thetas) * thetas.shape[1] == 1:
        return thetas[0, 0]
    begun, groups = windows.start if starts is None else starts, thetas.flatten(0, 1)
    binned, valid = replay_binned(simulator, windows, groups, begun.expand(len(groups), *begun.shape))
    residual = (windows.bin(windows.value) - binned) * per_noise(windows)
    scores = torch.tensor([score_of(windows, one) for one in residual], dtype=torch.float64)
    scores = torch.where(valid.all(1).to(scores.device), scores, math.inf).view(thetas.shape[:2])
    nearest = [int(row.argmin()) for row in scores]
    most = min(range(len(thetas)), key=lambda g: float(scores[g, nearest[g]]))
    if len(thetas) == 1:
        return thetas[most, nearest[most]]
    left = residual.view(*thetas.shape[:2], *residual.shape[1:])[most, nearest[most]]
    some = left.square().sum((1, 2)).topk(min(windows.count, max(FEW, windows.count // 4))).indices.sort().values
    part, there = windows.select(some), begun[some]
    found = (_linearised(rough, rough, part, thetas[g, b], there) for g, b in enumerate(nearest))
    promised = [math.inf if one is None else one.score - _promise(part, one) for one in found]
    leads = min(range(len(thetas)), key=lambda g: promised[g])
    return thetas[leads, nearest[leads]]


def _linearised(
    simulator: Identifiable,
    rough: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
) -> Fitted | None:
    """A point with its derivatives; None where a replay diverges."""
    lin = linearise(rough, windows, theta, starts)
    if rough is not simulator:
        shown, valid = replay_binned(simulator, windows, theta[None], starts[None])
        if not bool(valid.all()):
            return None
        residual = windows.bin(windows.value) - shown[0]
        lin = replace(lin, residual=residual) if lin.valid else linearise(simulator, windows, theta, starts)
    return weighed(simulator, rough, windows, lin) if lin.valid else None


def weighed(simulator: Identifiable, rough: Identifiable, windows: Windows, lin: Linearisation) -> Fitted:
    """A point with the weights of the score there.

    Args:
        simulator, rough, windows: as for :func:`fit`.
        lin: replay and sensitivities at the point.
    """
    residual = lin.residual * per_noise(windows)
    rows = project(windows, lin, score_weights(windows, residual))
    # What a better start would remove is no error of the model: the weights are those of what is left.
    left = rows.in_noise(rows.residual)
    return Fitted(simulator, rough, lin, project(windows, lin, score_weights(windows, left)), score_of(windows, left))


def _promise(windows: Windows, here: Fitted) -> float:
    """By how much the undamped step lowers the score, to first order."""
    rows = here.rows
    step = bounded_step(here.simulator, rows, here.theta, 0.0)
    return here.score - score_of(windows, rows.in_noise(rows.residual - rows.columns @ step))


def _start_promise(windows: Windows, here: Fitted) -> float:
    """By how much better starts lower the score, to first order."""
    return score_of(windows, here.lin.residual * per_noise(windows)) - here.score


def _stepped(windows: Windows, here: Fitted, promise: float) -> Fitted:
    """One step on, damped where the undamped one breaks its promise; itself where none lowers the score."""
    dampings = DAMPINGS if promise >= SETTLED else ()
    there = min(here, _best_of(windows, here, (0.0,)), key=_score)
    if dampings and there.score > here.score - PROMISE_KEPT * promise:
        there = min(there, _best_of(windows, here, dampings), key=_score)
    # One bad start can make the common step fail: let every window keep its old start.
    return there if there is not here else min(here, _best_of(windows, here, (0.0, *dampings), kept=True), key=_score)


def _score(fitted: Fitted) -> float:
    return fitted.score


def _best_of(windows: Windows, here: Fitted, dampings: Sequence[float], *, kept: bool = False) -> Fitted:
    """The best of some steps, each with the starts that go with it; itself where none lowers the misfit.

    With ``kept`` each window's start is the best of that, of where it is, and of the smoothed one.
    """
    simulator, lin, rows = here.simulator, here.lin, here.rows
    steps = torch.stack([bounded_step(simulator, rows, lin.theta, damping) for damping in dampings])
    moved = lin.starts + start_shift(windows, lin, rows, steps)
    theta = simulator.parameters.clamp(lin.theta + steps)
    scale = per_noise(windows) * rows.weight
    options = [moved, *(one.expand_as(moved) for one in (lin.starts, windows.start))] if kept else [moved]
    played = [_replayed(simulator, windows, theta, starts, scale) for starts in options]
    misfit, which = torch.stack([one for _, one in played]).min(0)
    best = int(misfit.sum(1).argmin())
    if not bool(misfit[best].sum() < (lin.residual * scale).square().sum()):
        return here
    chosen, window = which[best], torch.arange(windows.count, device=misfit.device)
    starts = torch.stack([one[best] for one in options])[chosen, window]
    binned = torch.stack([one[best] for one, _ in played])[chosen, window]
    residual = windows.bin(windows.value) - binned
    return weighed(simulator, here.rough, windows, replace(lin, theta=theta[best], starts=starts, residual=residual))


def _replayed(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, "D P"],
    starts: Float[Tensor, "D W J2"],
    scale: Float[Tensor, "W n S"],
) -> tuple[Float[Tensor, "D W n S"], Float[Tensor, "D W"]]:
    """The replays, and the misfit of every window; infinite where it diverged."""
    binned, valid = replay_binned(simulator, windows, theta, starts)
    misfit = ((windows.bin(windows.value) - binned) * scale).square().sum((2, 3))
    return binned, torch.where(valid, misfit, torch.full_like(misfit, math.inf))


def bounded_step(simulator: Simulator, rows: Rows, theta: Float[Tensor, " P"], damping: float) -> Float[Tensor, " P"]:
    """The damped step of theta within the bounds [SI]."""
    columns = rows.columns.flatten(0, 1)
    low, high = room(simulator, theta)
    return bounded_least_squares(columns.T @ columns, columns.T @ rows.residual.flatten(), low, high, damping)
