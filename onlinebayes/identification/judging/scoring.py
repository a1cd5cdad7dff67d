"""The score of a fitted hypothesis on data that it did not see, and its gain over another hypothesis.

    S = sum over signals of the mean over bands of 1/2 log(mean left-out square + 1)       squares in units of noise^2

A signal counts by the share of its error: halving an error of 75 noise floors counts as much as halving one of 20, and
below the noise nothing counts. Squares are pooled over the folds before the logarithm, or quiet folds would rule.

Data are left out in several ways, and a law has to hold in all of them (:func:`partitions`): by runs, or stretches of
the data where there are fewer than four, or groups of runs where there are more than twelve; and, for each signal, by
where the windows lie on it, so that what is left out lies beyond what was seen. A spring that follows the runs it was
fitted to may be useless where no run went.
What is left out is predicted by theta without it, one step of least squares within the bounds, no new fit; its starts
and its own values are estimated inside it.

    t = mean_f d_f / (sd_f d_f / sqrt F),    d_f = S_f(other) - S_f(this)      paired, fold by fold (Diebold and Mariano
    se = gain / t                                                              1995), so that gain / se is certainty

Folds pooled and left out in turn (a jackknife) would call uncertain what every fold confirms, where one fold errs most.

Two hypotheses are compared over the windows that both predict. A fault of the log may leave windows without a measured
value: it gains nothing by that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Span, Windows
from onlinebayes.identification.fitting.blocks import MOST_BLOCKS
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.rows import Rows, band_counts, band_squares
from onlinebayes.identification.fitting.theta import room
from onlinebayes.identification.replaying.bounded import bounded_least_squares

FEWEST_RUNS = 4
"""So many runs are folds of their own."""

STRETCHES = 6
"""Fewer runs are cut into so many folds."""

REGIONS = 4
"""Windows are sorted by each signal into so many folds: the outer two ask for extrapolation."""


@dataclass(frozen=True, eq=False)
class Folds:
    """One way of leaving data out of W windows.

    Args:
        of: number of each window's fold.
        spans: which windows these are, see :attr:`.Windows.spans`.
    """

    of: Int[Tensor, " W"]
    spans: tuple[Span, ...]

    def __len__(self) -> int:
        return int(self.of.max()) + 1

    def over(self, windows: Windows) -> Folds:
        """The same for windows that are among these."""
        place = {span: w for w, span in enumerate(self.spans)}
        return Folds(self.of[[place[span] for span in windows.spans]], windows.spans)


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Left-out squares of one hypothesis.

    Args:
        squares, counts: sum of squares [noise^2] and number of bins, of every window, band and signal.
        folds: how they were left out.
    """

    squares: Float[Tensor, "W B S"]
    counts: Float[Tensor, "W B S"]
    folds: Folds

    @property
    def by_signal(self) -> Float[Tensor, " S"]:
        """Each signal's part of the score S."""
        return score_parts(self.squares.sum(0), self.counts.sum(0))

    @property
    def of_folds(self) -> tuple[Float[Tensor, "F B S"], Float[Tensor, "F B S"]]:
        """Sums of squares and numbers of bins of every fold."""
        squares, counts = (
            one.new_zeros(len(self.folds), *one.shape[1:]).index_add(0, self.folds.of, one)
            for one in (self.squares, self.counts)
        )
        return squares, counts

    @property
    def fold_scores(self) -> Float[Tensor, " F"]:
        """S of every fold alone."""
        return score_parts(*self.of_folds).sum(-1)

    @property
    def rms(self) -> Float[Tensor, " S"]:
        """Left-out RMS of every signal [noise floors]."""
        return (self.squares.sum((0, 1)) / self.counts.sum((0, 1)).clamp_min(1)).sqrt()


@dataclass(frozen=True)
class Gain:
    """By how much a hypothesis predicts left-out data better than another, in nats, over F folds.

    Args:
        by_signal: S of the other minus S of this, in each signal.
        se: standard error of their sum; as large as it where the folds, each by itself, do not gain on average.
        folds, worse: F, and those of them that it predicts worse.
    """

    by_signal: tuple[float, ...]
    se: float
    folds: int
    worse: int

    @property
    def gain(self) -> float:
        """Of all signals."""
        return sum(self.by_signal)


def in_common(one: LeftOut, other: LeftOut) -> tuple[LeftOut, LeftOut]:
    """Both over what both predict: the windows, bands and signals that both have measured values of.

    Raises:
        ValueError: they share no window, or leave different data out.
    """
    mine, theirs = ({span: w for w, span in enumerate(each.folds.spans)} for each in (one, other))
    shared = [span for span in mine if span in theirs]
    if not shared:
        raise ValueError("no window in common: evaluate both over windows of the same runs and the same length")
    here, there = [mine[span] for span in shared], [theirs[span] for span in shared]
    if not torch.equal(one.folds.of[here], other.folds.of[there]):
        raise ValueError("different folds: give both evaluators the same partition")
    folds = Folds(one.folds.of[here].unique(return_inverse=True)[1], tuple(shared))
    both = (one.counts[here] > 0) & (other.counts[there] > 0)
    a = LeftOut(one.squares[here] * both, one.counts[here] * both, folds)
    return a, LeftOut(other.squares[there] * both, other.counts[there] * both, folds)


def gain(better: LeftOut, other: LeftOut) -> Gain:
    """Compute the gain of ``better`` over ``other``, over what both predict."""
    better, other = in_common(better, other)
    by_signal = (other.by_signal - better.by_signal).tolist()
    own = other.fold_scores - better.fold_scores
    return Gain(tuple(by_signal), _standard_error(sum(by_signal), own), len(own), int((own < -1e-12).sum()))


def _standard_error(gain: float, own: Float[Tensor, " F"]) -> float:
    """gain / t, t of the folds' own gains; the gain itself where these do not say the same."""
    if len(own) < 2 or gain * float(own.mean()) <= 0:
        return abs(gain)
    return gain / float(own.mean()) * float(own.std()) / math.sqrt(len(own))


def folds_of(windows: Windows) -> Int[Tensor, " W"]:
    """Number of each window's fold."""
    runs, of = torch.unique(windows.run, return_inverse=True)
    if len(runs) >= FEWEST_RUNS:
        # Many short runs: those that follow each other together, for one alone is mostly chance.
        return of if len(runs) <= MOST_BLOCKS else of * MOST_BLOCKS // len(runs)
    moving = windows.moving.long()
    before = moving.cumsum(0) - moving
    return (before * STRETCHES // max(int(moving.sum()), 1)).clamp_max(STRETCHES - 1)


def partitions(windows: Windows) -> tuple[Folds, ...]:
    """Every way in which data are left out: by runs first, then by each signal."""
    seen = windows.observed
    count = seen.sum(1).clamp_min(1)
    mean = torch.where(seen, windows.value, torch.zeros_like(windows.value)).sum(1) / count
    ranks = mean.argsort(0).argsort(0)
    ways = (folds_of(windows), *(rank * REGIONS // len(rank) for rank in ranks.unbind(1)))
    return tuple(Folds(way, windows.spans) for way in ways)


@dataclass(frozen=True)
class LinearModel:
    """A fit's rows to first order in theta, or in theta and a candidate's size.

    Args:
        rows: start-projected, at the mode.
        columns: by which they fall where a parameter rises.
        low, high: bounds of the parameters' steps.
    """

    rows: Rows
    columns: Float[Tensor, "W m P"]
    low: Float[Tensor, " P"]
    high: Float[Tensor, " P"]

    @classmethod
    def of(cls, fitted: Fitted) -> LinearModel:
        """Return the linear model of a fit."""
        return cls(fitted.rows, fitted.rows.columns, *room(fitted.simulator, fitted.theta))

    def grown(
        self, columns: Float[Tensor, "W m K"], low: Float[Tensor, " K"], high: Float[Tensor, " K"]
    ) -> LinearModel:
        """With further parameters."""
        return replace(
            self,
            columns=torch.cat([self.columns, columns], dim=-1),
            low=torch.cat([self.low, low]),
            high=torch.cat([self.high, high]),
        )

    def whole(self) -> Float[Tensor, " P"]:
        """The step that all data ask for."""
        C, r = self.columns.flatten(0, 1), self.rows.residual.flatten()
        return bounded_least_squares(C.T @ C, C.T @ r, self.low, self.high)

    def without(self, fold: Bool[Tensor, " W"], normal: Float[Tensor, "W P P"], right: Float[Tensor, "W P"]) -> Tensor:
        """The step that the data without a fold ask for; what only the fold can tell is fitted inside it.

        Args:
            fold: the windows that are left out.
            normal, right: C'C and C'r of every window.
        """
        outside, inside = normal[~fold].sum(0), normal[fold].sum(0)
        step = bounded_least_squares(outside, right[~fold].sum(0), self.low, self.high)
        own = (outside.diagonal() <= 0) & (inside.diagonal() > 0)
        if bool(own.any()):
            left = right[fold].sum(0) - inside[:, ~own] @ step[~own]
            step[own] = bounded_least_squares(inside[own][:, own], left[own], self.low[own], self.high[own])
        return step


def left_out(model: LinearModel, windows: Windows, folds: Folds) -> LeftOut:
    """Every fold predicted by the parameters that the others ask for."""
    rows = model.rows
    normal = model.columns.mT @ model.columns
    right = (model.columns.mT @ rows.residual[..., None])[..., 0]
    predicted = rows.residual.clone()
    for f in range(len(folds)):
        here = folds.of == f
        step = model.without(here, normal, right)
        predicted[here] -= torch.einsum("wmp,p->wm", model.columns[here], step)
    return LeftOut(band_squares(windows, rows.in_noise(predicted)), band_counts(windows), folds)


def score_parts(squares: Float[Tensor, "*batch B S"], counts: Float[Tensor, "*batch B S"]) -> Float[Tensor, "*batch S"]:
    """Each signal's part of the score S, from sums of squares and numbers of bins."""
    seen = counts > 0
    each = torch.where(seen, 0.5 * torch.log1p(squares / counts.clamp_min(1)), torch.zeros_like(squares))
    return each.sum(-2) / seen.sum(-2).clamp_min(1)
