"""How much better one fitted model predicts left-out blocks than another: the log score and the error.

    d_b = (Delta / tau) sum over test block b of [log t(r_candidate) - log t(r_current)],    gain = sum_b d_b
    se  = sqrt(B) sd_b(d_b)

Everything is refitted on the other blocks, scale and degrees of freedom of the Student-t from them too, parameters at
their mode; what only the left-out run can tell is lent from one half of it to the other. Delta / tau turns correlated
bins into independent ones, and leaves the residual unwhitened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.noise import correlation_time, log_t, student_t
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import Blocks, held_out_rows, leave_one_out
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.per_run_values import lent
from onlinebayes.identification.fitting.projection import Projected, project
from onlinebayes.identification.replaying.scoped import ScopedSimulator

STANDARD_ERRORS = 2.0
"""A gain is clear, and two models are parted, from so many standard errors on."""

SIGN_LEVEL = 0.01
"""A gain in all blocks is clear where that comes about by chance with no larger probability."""

SHORT_TAU = 5.0
"""Two models may be parted bin by bin where the better one's residual is correlated over at most so many bins."""

ROW_Z = 4.0
"""Two models are parted by their bins' densities from so many standard errors on."""

SHORT_WINDOWS = 3
"""Each long window is cut into so many short ones: H_s = H / 3."""


@dataclass(frozen=True)
class CrossValidated:
    """A fit judged on the blocks it did not see.

    Args:
        log_density: sum over each test block and all signals of log t, in noise units [nats].
        rms_long, rms_short: cross-validated RMS over all signals, in noise units, at H and H_s.
        signal_rms: the same at H, per signal [noise units].
        square: sum of squares of each test block at H [noise units^2].
        count: observed bins of each test block.
        row_density: log t of every bin when its block is left out, summed over signals [nats].
        tested: which bins were observed.
        tau: correlation time of the fit's residual [s].
    """

    log_density: Float[Tensor, " B"]
    rms_long: float
    rms_short: float
    signal_rms: Float[Tensor, " S"]
    square: Float[Tensor, " B"]
    count: Float[Tensor, " B"]
    row_density: Float[Tensor, "W n"]
    tested: Bool[Tensor, "W n"]
    tau: float


@dataclass(frozen=True)
class Gain:
    """Score gain of one model over another, with its standard error, over B blocks [nats].

    Args:
        gain, se: the sum over blocks, and its standard error.
        blocks: B.
        better: of them, where the model predicts better.
    """

    gain: float
    se: float
    blocks: int
    better: int

    @property
    def clear(self) -> bool:
        """Whether it is two standard errors, or every one of enough blocks has gained.

        One block that shows most of it makes the standard error large, however surely all others show it too. Were
        gains and losses alike likely, all B would be gains with probability 2^-B (the sign test; Arbuthnott 1710).
        """
        return self.gain >= STANDARD_ERRORS * self.se or (self.better == self.blocks and self.chance <= SIGN_LEVEL)

    @property
    def chance(self) -> float:
        """Probability that all blocks gain where gains and losses are alike likely."""
        return 0.5**self.blocks

    def sign_p(self, tried: int) -> float:
        """Of the best of ``tried`` models: C 2^-B where all blocks gain (Bonferroni), else 1."""
        return min(1.0, tried * self.chance) if self.better == self.blocks else 1.0


def cross_validate(fitted: Fit, windows: Windows, blocks: Blocks) -> CrossValidated:
    """Leave each block out in turn (see :mod:`onlinebayes.identification.fitting.blocks`)."""
    without = leave_one_out(fitted, blocks)
    long = project(windows, fitted.lin)
    short = project(windows, fitted.lin, pieces=SHORT_WINDOWS)
    rows = _judged_rows(long, fitted, windows, blocks, without)
    seen = long.seen()
    test = (blocks.of[None] == torch.arange(blocks.count, device=seen.device)[:, None])[..., None, None] & seen
    train = blocks.train[..., None, None] & seen
    density = rows.new_zeros(rows.shape[:-1])
    for s in range(rows.shape[-1]):
        r, known = rows[..., s].flatten(1), train[..., s].flatten(1)
        scale, nu = student_t(r, known.to(r))
        # Of a signal that moves in the left-out block alone nothing says how wide its errors are: it does not count.
        counts = test[..., s] & known.any(1)[:, None, None]
        density += torch.where(counts, log_t(r, scale[:, None], nu[:, None]).view_as(density), 0.0)
    short_rows = _judged_rows(short, fitted, windows, blocks, without)
    short_of = blocks.of.repeat_interleave(SHORT_WINDOWS)
    short_test = (short_of[None] == torch.arange(blocks.count, device=seen.device)[:, None])[..., None, None]
    square = torch.where(test, rows, 0.0).square()
    return CrossValidated(
        density.sum((1, 2)),
        _rms(rows, test),
        _rms(short_rows, short_test & short.seen()),
        (square.sum((0, 1, 2)) / test.sum((0, 1, 2)).clamp_min(1)).sqrt(),
        square.sum((1, 2, 3)),
        test.sum((1, 2, 3)).to(square),
        density.sum(0),
        seen.any(-1),
        correlation_time(long.measured_rows(long.residual), seen, windows.bin_step),
    )


def _judged_rows(
    projected: Projected, fitted: Fit, windows: Windows, blocks: Blocks, without: Float[Tensor, "B P"]
) -> Float[Tensor, "B V n S"]:
    """Every window's residual under theta_-b, a left-out run's own values lent from half to half.

    See :mod:`.fitting.per_run_values`.
    """
    if not isinstance(fitted.simulator, ScopedSimulator):
        return projected.measured_rows(held_out_rows(projected, fitted.theta, without))
    both, half = lent(fitted, windows, blocks, without)
    half = half.repeat_interleave(len(projected.residual) // len(half))
    first, second = (held_out_rows(projected, fitted.theta, theta) for theta in both)
    return projected.measured_rows(torch.where(half[None, :, None] == 0, first, second))


def score_gain(candidate: CrossValidated, current: CrossValidated, bin_step: float) -> Gain:
    """What ``candidate`` gains over ``current``, with the current model's tau."""
    d = (bin_step / max(current.tau, bin_step)) * (candidate.log_density - current.log_density)
    B = len(d)
    return Gain(float(d.sum()), math.sqrt(B) * float(d.std()) if B > 1 else float("inf"), B, int((d > 0).sum()))


def parted(a: CrossValidated, b: CrossValidated, bin_step: float) -> bool:
    """Whether the data tell which of two models predicts better.

    By blocks, ``abs(sum_b d_b) > 2 se``; or by bins, where the better one's residual is short-lived (tau of at most 5
    bins): a z of the bins' differences with that tau exceeds 4. Few blocks, one of which shows most, decide little.
    """
    difference = score_gain(a, b, bin_step)
    if abs(difference.gain) > STANDARD_ERRORS * difference.se:
        return True
    better = a if difference.gain > 0 else b
    if better.tau > SHORT_TAU * bin_step:
        return False
    rows = (a.row_density - b.row_density)[a.tested]
    spread = float(rows.std()) * math.sqrt(len(rows) * max(better.tau / bin_step, 1.0))
    return abs(float(rows.sum())) > ROW_Z * spread


def _rms(rows: Tensor, mask: Tensor) -> float:
    return float((torch.where(mask, rows, 0.0).square().sum() / mask.sum().clamp_min(1)).sqrt())
