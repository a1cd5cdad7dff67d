"""Where outages begin and end, to the row.

    c_r = sum over windows w of run r of log(1 + e_w^2)      e_w: RMS of w's replay with the actuators off [floors],
                                                             from its smoothed or its fitted start, the lesser

The edges of all runs are moved by fewer and fewer rows, and each run keeps the move where its c_r falls. A logarithm,
for the window in which a load fell errs a hundred times as much as its neighbour, whose edge is to be found too.
Between two passes theta and the windows' starts are fitted to the table as these edges have it. Those starts make up
for edges that are wrong still, the smoothed ones for none. A stretch that halves no window's error in the end is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.bench import replay_rms
from onlinebayes.criticism.fit import fit
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator

FARTHEST = 0.32  # of a window: the first move
PASSES = 6
HALF = 0.5

Stretch = tuple[int, int, int]
"""A run, and the rows of its grid from which and to which an actuator is off."""


@dataclass(frozen=True)
class _Trial:
    """What stretches are tried on: actuators (their places among the commands), windows, theta and fitted starts."""

    columns: Sequence[int]
    simulator: Simulator
    windows: Windows
    theta: Float[Tensor, " P"]
    starts: Float[Tensor, "W J2"]

    def rms(self, stretches: Sequence[Stretch]) -> Float[Tensor, " W"]:
        """e_w of every window."""
        off = disabled(self.windows, self.columns, stretches)
        both = (off, replace(off, start=self.starts))
        found = [replay_rms(self.simulator, one, self.theta[None], off.noise)[0] for one in both]
        return torch.minimum(*found)

    def by_run(self, stretches: Sequence[Stretch]) -> Float[Tensor, " R"]:
        """c_r of every run."""
        rms = self.rms(stretches)
        return rms.new_zeros(len(self.windows.runs)).index_add(0, self.windows.run, rms.square().log1p())

    def fitted(self, stretches: Sequence[Stretch]) -> _Trial:
        """The same beside the theta and the starts that fit these stretches."""
        found = fit(self.simulator, disabled(self.windows, self.columns, stretches), self.theta)
        return replace(self, theta=found.theta, starts=found.lin.starts)


def settled(
    stretches: Sequence[Stretch],
    columns: Sequence[int],
    simulator: Simulator,
    windows: Windows,
    theta: Float[Tensor, " P"],
) -> tuple[list[Stretch], Float[Tensor, " P"]]:
    """The stretches with their edges in place, and theta fitted beside them.

    Args:
        stretches: where the actuators seem to have been off.
        columns: the actuators' places among the commands.
        simulator: the base model.
        windows: the fit windows of the table as it stands.
        theta: where to begin [SI].

    Raises:
        BadInput: the model diverges.
    """
    current = list(stretches)
    trial = _Trial(columns, simulator, windows, theta, windows.start)
    for _ in range(PASSES):
        before, current = current, _moved(current, trial)
        trial = trial.fitted(current)
        if current == before:
            break
    return _needed(current, trial), trial.theta


def disabled(windows: Windows, columns: Sequence[int], stretches: Sequence[Stretch]) -> Windows:
    """The windows with these actuators off in these stretches."""
    at = windows.first[:, None] + torch.arange(windows.rows)
    off = torch.zeros_like(at, dtype=torch.bool)
    for run, begin, end in stretches:
        off |= (windows.run == run)[:, None] & (at >= begin) & (at < end)
    enable = windows.enable.clone()
    enable[..., list(columns)] *= 1.0 - off[..., None].to(enable)
    return replace(windows, enable=enable)


def _moved(stretches: list[Stretch], trial: _Trial) -> list[Stretch]:
    """One pass: the edges of each run moved to where that run errs less."""
    best = trial.by_run(stretches)
    by = max(1, round(FARTHEST * trial.windows.rows))
    while by:
        improved = False
        for begin, end in ((-by, 0), (by, 0), (0, -by), (0, by)):
            tried = [(run, a + begin, b + end) if b + end > a + begin else (run, a, b) for run, a, b in stretches]
            errors = trial.by_run(tried)
            better = errors < best
            improved |= bool(better.any())
            stretches = [new if better[new[0]] else old for new, old in zip(tried, stretches, strict=True)]
            best = torch.minimum(best, errors)
        by = by if improved else by // 2
    return stretches


def _needed(stretches: Sequence[Stretch], trial: _Trial) -> list[Stretch]:
    """The stretches without which some window errs twice as much."""
    own = trial.rms(stretches)
    rest = ([*stretches[:k], *stretches[k + 1 :]] for k in range(len(stretches)))
    return [one for one, without in zip(stretches, rest, strict=True) if (own < HALF * trial.rms(without)).any()]
