"""The length of the windows, found by doubling: the longest over which the model still says something.

    longer while   windows >= 15,   growth of a start's error < 5,
                   base error < .15 spread in every signal (.5 spread after windows that show no more than noise)

A window in which the model has gone astray says nothing about what is missing; a short one hides what is slow. Windows
that exceed the budget are thinned, evenly over the runs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import MEMORY, Windows, joint_names, make_windows
from onlinebayes.identification.fitting.discretisation import Discretisation, cheapest, cost_of
from onlinebayes.identification.fitting.gauss_newton import Fitted, fit, weighed
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.sensitivities import Linearisation
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Kept, Memo, NoMemo, Stopped, remembered
from onlinebayes.simulators.identifiable import Identifiable

SHORTEST_ROWS = 20
"""Rows of the first windows that are tried: their starts leave enough to compare."""

FEWEST_WINDOWS = 15
"""Fewer windows make no folds that differ."""

MOST_ROWS = 10_000
"""Rows in all windows of one replay: enough to tell shares of an error of a twentieth."""

MOST_EVALUATIONS = 32_000
"""Evaluations of the forces in these; a search takes some thousand replays."""

FEW = 30
"""Windows that are looked at on the way: the length that they ask for is known to a factor of two anyway."""

FIRST_STEPS = 4
"""Steps of the fits on the way: they need not be good, for the next one goes on from there."""

LOST = 0.15
"""Of a signal's spread in its windows: beyond, the replay is too far from the machine for a linear prediction of what
would mend it."""

FAR = 0.5
"""The same where the windows before show no more than noise: beyond, the replay has lost the machine."""

INSIDE_NOISE = 2.0
"""Floors: a smaller error is no sign of having lost anything, however little a signal moves."""

LARGEST_GROWTH = 5.0
"""Times that an error of a start may grow."""


@dataclass(frozen=True)
class BaseFit:
    """The base model on the longest windows that it can follow.

    Args:
        windows: on which it was fitted.
        discretisation: the way in which it was integrated over them.
        fitted: the model.
        lost: whether longer ones were refused because it errs too much over them; else the runs hold no more.
    """

    windows: Windows
    discretisation: Discretisation
    fitted: Fitted
    lost: bool = False

    @property
    def kept(self) -> Kept:
        """For a memo."""
        ways = {name: vars(way) for name, way in vars(self.discretisation).items()}
        text = json.dumps({"horizon": self.windows.horizon, "lost": self.lost, **ways})
        return replace(self.fitted.lin.kept, text=text)


def fit_base(
    given: Identifiable,
    measurement: Measurement,
    noise: Float[Tensor, " S"],
    memo: Memo | None = None,
    begun: Mapping[str, float] = MappingProxyType({}),
) -> BaseFit:
    """The base model on the longest windows that it can follow.

    Args:
        given: the base model at its own step.
        measurement: the fit runs.
        noise: floor of each signal [SI].
        memo: keeps the answer for the next command.
        begun: values by name from which the first fit begins [SI]; nominal ones for those that are missing.

    Raises:
        BadInput: no window can be replayed.
    """
    return remembered(
        memo or NoMemo(),
        ("base", given, measurement, noise, dict(begun)),
        partial(_fit_base, given, measurement, noise, begun),
        lambda found: found.kept,
        partial(_kept_base, given, measurement, noise),
    )


def _kept_base(given: Identifiable, measurement: Measurement, noise: Float[Tensor, " S"], kept: Kept) -> BaseFit:
    """Restore the base fit that a memo kept."""
    told = json.loads(kept.text)
    horizon, values, derivatives = (told[name] for name in ("horizon", "values", "derivatives"))
    way = Discretisation(Integration(**values), Integration(**derivatives))
    windows = windows_of(given, measurement, horizon, noise, way.values)
    simulator, rough = way.values.of(given), way.derivatives.of(given)
    return BaseFit(windows, way, weighed(simulator, rough, windows, Linearisation.of(kept)), told["lost"])


def _fit_base(
    given: Identifiable, measurement: Measurement, noise: Float[Tensor, " S"], begun: Mapping[str, float]
) -> BaseFit:
    row = max(given.timestep, float(torch.diff(measurement.data["time"][0]).median()))
    horizon = SHORTEST_ROWS * row
    own = Integration(given.timestep)
    first = _fitted(given, measurement, noise, horizon, Discretisation(own, own), begun)
    best = _fitted(given, measurement, noise, horizon, cheapest(first.fitted, given, first.windows), begun)
    lost = False
    while horizon < max(measurement.durations) and not lost:
        horizon *= 2
        try:
            longer = _fitted(given, measurement, noise, horizon, best)
        except Stopped:
            raise
        except BadInput:
            lost = True
            break
        if longer.windows.count < FEWEST_WINDOWS or longer.windows.rows <= best.windows.rows:
            break
        lost = not follows(longer, FAR if shows_nothing(best) else LOST)
        best = best if lost else longer
    fitted, way = best.fitted, best.discretisation.values
    windows = windows_of(given, measurement, best.windows.horizon, noise, way)
    anew = fit(fitted.simulator, windows, fitted.theta, rough=fitted.rough)
    return BaseFit(windows, best.discretisation, anew, lost)


def _fitted(
    given: Identifiable,
    measurement: Measurement,
    noise: Float[Tensor, " S"],
    horizon: float,
    before: BaseFit | Discretisation,
    begun: Mapping[str, float] = MappingProxyType({}),
) -> BaseFit:
    """The model on few windows of one length, fitted roughly from where it was fitted before."""
    discretisation = before.discretisation if isinstance(before, BaseFit) else before
    values = values_of(before.fitted.simulator, before.fitted.theta) if isinstance(before, BaseFit) else begun
    windows = thinned(windows_of(given, measurement, horizon, noise, discretisation.values), FEW)
    simulator, rough = discretisation.values.of(given), discretisation.derivatives.of(given)
    fitted = fit(simulator, windows, theta_of(simulator, values), rough=rough, most=FIRST_STEPS)
    return BaseFit(windows, discretisation, fitted)


def windows_of(
    given: Identifiable,
    measurement: Measurement,
    horizon: float,
    noise: Float[Tensor, " S"],
    discretisation: Integration,
) -> Windows:
    """Windows of one length, thinned to the budget of evaluations."""
    windows = all_windows(given, measurement, horizon, noise)
    rows = min(MOST_ROWS, MOST_EVALUATIONS / cost_of(given, windows.step)(discretisation))
    return thinned(windows, max(1, int(rows / windows.rows)))


def all_windows(given: Identifiable, measurement: Measurement, horizon: float, noise: Float[Tensor, " S"]) -> Windows:
    """All windows of one length in which something moves."""
    windows = make_windows(given, measurement, horizon, MEMORY * horizon, noise)
    moving = windows.moving.nonzero()[:, 0]
    return windows.select(moving) if len(moving) else windows


def thinned(windows: Windows, most: int) -> Windows:
    """At most so many of the windows, evenly spread."""
    if windows.count <= most:
        return windows
    return windows.select(torch.linspace(0, windows.count - 1, most, device=windows.run.device).round().long())


def follows(found: BaseFit, lost: float) -> bool:
    """Check whether the replay stays with the measurement over these windows.

    Args:
        found: the model on them.
        lost: share of a signal's spread that its error may reach.
    """
    windows = found.windows
    seen, count = windows.seen, windows.seen.sum(1, keepdim=True).clamp_min(1)
    value = torch.where(seen, windows.bin(windows.value) * per_noise(windows), torch.zeros_like(windows.bin_noise))
    centred = torch.where(seen, value - value.sum(1, keepdim=True) / count, torch.zeros_like(value))
    spread = (centred.square().sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)).sqrt()
    error = _errors(found)
    gone = (error > lost * spread) & (error > INSIDE_NOISE)
    return not bool(gone.any()) and growth(windows, found.fitted) < LARGEST_GROWTH


def shows_nothing(found: BaseFit) -> bool:
    """Check whether no more than noise is left over these windows: what is wrong shows in longer ones alone."""
    return not bool((_errors(found) > INSIDE_NOISE).any())


def _errors(found: BaseFit) -> Float[Tensor, " S"]:
    """RMS of what is left of each signal [floors]."""
    rows, seen = found.fitted.rows, found.windows.seen
    left = torch.where(seen, rows.in_noise(rows.residual), torch.zeros_like(found.windows.bin_noise))
    return (left.square().sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)).sqrt()


def growth(windows: Windows, fitted: Fitted) -> float:
    """By how much an error of a joint's start has grown at most in its own position, in the median window."""
    simulator = fitted.simulator
    shown = [simulator.signals[column] for column in windows.columns]
    most = fitted.lin.by_start.new_zeros(windows.count)
    for j, joint in enumerate(joint_names(simulator)):
        if (name := f"qpos.{joint}") in shown:
            moved = fitted.lin.by_start[:, :, shown.index(name), j].abs().amax(1)
            most = torch.maximum(most, moved * windows.free[:, j])
    return float(most.median())
