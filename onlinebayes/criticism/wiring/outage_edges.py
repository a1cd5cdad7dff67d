"""The first and the last row of each outage.

    c_r = sum over windows w of run r of log(1 + e_w^2)      e_w: RMS of w's replay with the actuators off [floors],
                                                             from its smoothed or its fitted start, the lesser

The edges of all runs are moved at once, on a grid and then by fewer and fewer rows, and each run keeps what suits it
best; c_r has more than one minimum, where the command passes through zero. A logarithm, for the window in which a load
fell errs a hundred times as much as its neighbour, whose edge is to be found too. Between two passes theta and the
windows' starts are fitted to the table as these edges have it. Those starts make up for edges that are wrong still, the
smoothed ones for none. A stretch that halves no window's error in the end is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.wiring.replay_rms import replay_rms
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.simulators.identifiable import Identifiable

GRID = 0.08  # of a window: the first moves
REACH = 8  # of them
PASSES = 6
STRUCK_SHARE = 0.5

Stretch = tuple[int, int, int]
"""A run, and the rows of its grid from which and to which an actuator is off."""


@dataclass(frozen=True)
class _Trial:
    """The data on which stretches are tried: actuators (their places among the commands), theta and fitted starts.

    ``windows`` are all of them, those of the ``struck`` runs are replayed.
    """

    columns: Sequence[int]
    simulator: Identifiable
    windows: Windows
    struck: Int[Tensor, " V"]
    theta: Float[Tensor, " P"]
    starts: Float[Tensor, "W J2"]

    def rms(self, stretches: Sequence[Stretch]) -> Float[Tensor, " V"]:
        """e_w of the windows in struck runs."""
        off = disabled(self.windows.select(self.struck), self.columns, stretches)
        both = (off, replace(off, start=self.starts[self.struck]))
        found = [replay_rms(self.simulator, one, self.theta[None], off.noise)[0] for one in both]
        return torch.minimum(*found)

    def by_run(self, stretches: Sequence[Stretch]) -> Float[Tensor, " R"]:
        """c_r of every run; nothing of those that are not struck."""
        rms = self.rms(stretches)
        return rms.new_zeros(len(self.windows.runs)).index_add(0, self.windows.run[self.struck], rms.square().log1p())

    def fitted(self, stretches: Sequence[Stretch]) -> _Trial:
        """The same beside the theta and the starts that fit these stretches."""
        found = fit(self.simulator, disabled(self.windows, self.columns, stretches), self.theta)
        return replace(self, theta=found.theta, starts=found.lin.starts)


def settled(
    stretches: Sequence[Stretch],
    columns: Sequence[int],
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
) -> list[Stretch]:
    """The stretches with their edges in place.

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
    struck = torch.nonzero(torch.isin(windows.run, windows.run.new_tensor([run for run, *_ in current])))[:, 0]
    trial = _Trial(columns, simulator, windows, struck, theta, windows.start)
    for _ in range(PASSES):
        before, current = current, _moved(current, trial)
        trial = trial.fitted(current)
        if current == before:
            break
    return _needed(current, trial)


def disabled(windows: Windows, columns: Sequence[int], stretches: Sequence[Stretch]) -> Windows:
    """The windows with these actuators off in these stretches."""
    at = windows.first[:, None] + torch.arange(windows.rows, device=windows.run.device)
    off = torch.zeros_like(at, dtype=torch.bool)
    for run, begin, end in stretches:
        off |= (windows.run == run)[:, None] & (at >= begin) & (at < end)
    enable = windows.enable.clone()
    enable[..., list(columns)] *= 1.0 - off[..., None].to(enable)
    return replace(windows, enable=enable)


def _moved(stretches: list[Stretch], trial: _Trial) -> list[Stretch]:
    """One pass: the edges of each run moved to where that run errs least, then row by row to where it errs less."""
    by = max(1, round(GRID * trial.windows.rows))
    far = [by * k for k in range(-REACH, REACH + 1) if k]
    best = trial.by_run(stretches)
    stretches, best = _best(stretches, best, [(move, 0) for move in far], trial)
    stretches, best = _best(stretches, best, [(0, move) for move in far], trial)
    while by := by // 2:
        improved = True
        while improved:
            before = best
            for move in ((-by, 0), (by, 0), (0, -by), (0, by)):
                stretches, best = _best(stretches, best, [move], trial)
            improved = bool((best < before).any())
    return stretches


def _best(
    stretches: list[Stretch], errors: Float[Tensor, " R"], moves: Sequence[tuple[int, int]], trial: _Trial
) -> tuple[list[Stretch], Float[Tensor, " R"]]:
    """Each run's stretches moved as suits it best, if any move does, and c_r there; ``errors``: c_r as they are."""
    tried = [[_moved_by(stretch, move) for stretch in stretches] for move in moves]
    found = torch.stack([errors, *(trial.by_run(moved) for moved in tried)])
    which = found.argmin(0).tolist()
    chosen = [(stretches, *tried)[which[stretch[0]]][k] for k, stretch in enumerate(stretches)]
    return chosen, found.amin(0)


def _moved_by(stretch: Stretch, move: tuple[int, int]) -> Stretch:
    """The same where its end would not lie beyond its beginning."""
    (run, begin, end), (first, last) = stretch, move
    return (run, begin + first, end + last) if end + last > begin + first else stretch


def _needed(stretches: Sequence[Stretch], trial: _Trial) -> list[Stretch]:
    """The stretches without which some window errs twice as much."""
    own = trial.rms(stretches)
    rest = ([*stretches[:k], *stretches[k + 1 :]] for k in range(len(stretches)))
    return [
        one for one, without in zip(stretches, rest, strict=True) if (own < STRUCK_SHARE * trial.rms(without)).any()
    ]
