"""Whether a signal's lag grows along a run, from what the base model leaves, without a fit: then a clock is tried.

    r~ = C~ d - a v~ - b (t - t0)~ v~,      r~ = measured - simulated, v = d simulated / dt, starts taken out of all

r over v is the local lag; a is what it is at t0 and b what it grows by, beside what theta can do (d). The sd of b is
that of windows which err independently of each other (White 1980). t is the measurements' own clock, t0 its first
instant, as for the effect :mod:`~onlinebayes.simulators.effects.sensor_clock`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.rows import taken_out
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.identification.replaying.timed import instants

CERTAIN = 3.0
"""Standard deviations from which on a lag grows: where nothing else is wrong, chance says so of one signal in 400.
Other misfits may look so, too; then a clock is tried, and refused by the rule."""

SMALLEST = 1e-9
"""Of the largest eigenvalue, below which a direction of the least squares is taken as flat."""


@dataclass(frozen=True)
class LagGrowth:
    """What a signal's lag grows by.

    Args:
        signal: its name.
        rate, sd: of the growth [s/s].
        span: from the first instant to the last [s].
        seconds: that the windows last together.
    """

    signal: str
    rate: float
    sd: float
    span: float
    seconds: float

    @property
    def certain(self) -> bool:
        """True if it grows, or shrinks, by more than chance."""
        return abs(self.rate) > CERTAIN * self.sd

    def sd_after(self, seconds: float) -> float:
        """Sd of the rate from one run of such motion [s/s]: it falls with the span and the root of the readings.

        Args:
            seconds: that it lasts.
        """
        return self.sd * (self.span / seconds) * (self.seconds / seconds) ** 0.5


def lag_growths(fitted: Fitted, windows: Windows) -> Iterator[LagGrowth]:
    """The growth of every signal's lag that the windows tell of.

    Args:
        fitted: the base model.
        windows: to which it was fitted.
    """
    shown, valid = replay_binned(fitted.rough, windows, fitted.theta[None], fitted.lin.starts[None])
    if not bool(valid.all()) or windows.bins < 3 or windows.count < 3:
        return
    begin, end = (instant.to(shown) for instant in instants(windows))
    middle = windows.bin_step * (torch.arange(windows.bins, device=shown.device) + 0.5)
    since = begin[:, None] + middle - begin.min()
    (velocity,) = torch.gradient(shown[0], spacing=windows.bin_step, dim=1)
    seconds = float(windows.inside.sum()) * windows.step
    for s, column in enumerate(windows.columns):
        late = torch.zeros_like(velocity)
        late[..., s] = -velocity[..., s]
        found = _growth(fitted, taken_out(windows, fitted.rows, torch.stack([late, since[..., None] * late], -1)))
        if found is not None:
            name = fitted.simulator.signals[column]
            yield LagGrowth(name, *found, float(end.max() - begin.min()), seconds)


def _growth(fitted: Fitted, lags: Float[Tensor, "W m 2"]) -> tuple[float, float] | None:
    """The last column's factor and its sd; None where the windows say nothing of it."""
    columns = torch.cat([fitted.rows.columns, lags], dim=-1)
    size = columns.flatten(0, 1).norm(dim=0)
    if not float(size[-1]) > 0:
        return None
    columns = columns / size.clamp_min(1e-300)
    inverse = torch.linalg.pinv(torch.einsum("wmi,wmj->ij", columns, columns), rtol=SMALLEST, hermitian=True)
    factors = inverse @ torch.einsum("wmi,wm->i", columns, fitted.rows.residual)
    left = fitted.rows.residual - columns @ factors
    each = torch.einsum("wmi,wm->wi", columns, left) @ inverse
    sd = each[:, -1].square().sum().sqrt() / size[-1]
    return (float(factors[-1] / size[-1]), float(sd)) if float(sd) > 0 else None
