"""A summary t of a log for the inference of theta, in at most P numbers, and its spread under noise alone.

    C = d r / d u = -U S V',     t(theta) = U' r(theta),     t(theta*) = U' e ~ Student's t_nu(0, Sigma)

r are the fit's rows (measured - simulated, weighed, every window's start taken out), u the unit cube's coordinates of
theta. U' r is the score of the fit, whitened: compressing data to the score loses nothing to first order (Alsing and
Wandelt 2018), and a posterior given it is right however coarse it is. r(theta) comes from a replay; e is what the
machine has and the model lacks, noise or not, and its part in t does not depend on theta.

Sigma is not read off the number of samples, for a residual is never white: see :mod:`.spread`.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification import (
    Evaluation,
    Evaluator,
    Fitted,
    ScopedSimulator,
    Windows,
    left_of,
    replay_binned,
    residual_correlation_time,
)
from onlinebayes.parameters import ParameterSpace
from onlinebayes.posterior.spread import Parts, Spread, spread_of

NOTHING = 1e-9
"""Of the largest singular value: a direction in which no measured signal moves."""

HELD = 40_000_000
"""Numbers of rows that are held at once."""


@dataclass(frozen=True, eq=False)
class Score:
    """A fit's score, and its error.

    Args:
        fitted, windows: the fit, and its data.
        basis: U, window by window.
        slope: S V', by which t falls where u rises.
        spread: Sigma, nu, and what they are estimated from.
        correlation_s: tau [s].
    """

    fitted: Fitted
    windows: Windows
    basis: Float[Tensor, "W m K"]
    slope: Float[Tensor, "K P"]
    spread: Spread
    correlation_s: float

    @property
    def here(self) -> Float[Tensor, " K"]:
        """t at the fit: zero, but where bounds hold it."""
        return self.of(self.fitted.rows.residual)

    def of(self, rows: Float[Tensor, "*batch W m"]) -> Float[Tensor, "*batch K"]:
        """T of rows."""
        return torch.einsum("...wm,wmk->...k", rows, self.basis)

    def without(self, rows: Float[Tensor, "*batch W m"]) -> Float[Tensor, "*batch W m"]:
        """Return the part of rows that a fit of theta, to first order, would leave."""
        return rows - torch.einsum("...k,wmk->...wm", self.of(rows), self.basis)

    def log_likelihood(self, t: Float[Tensor, "N K"]) -> Float[Tensor, " N"]:
        """Log of Student's density, up to a constant."""
        K, freedom = t.shape[1], self.spread.freedom
        standard = torch.linalg.solve_triangular(torch.linalg.cholesky(self.spread.scale), t.T, upper=False)
        return -0.5 * (freedom + K) * torch.log1p(standard.square().sum(0) / freedom)

    def rows_at(self, theta: Float[Tensor, "N P"]) -> tuple[Float[Tensor, "N W m"], Bool[Tensor, " N"]]:
        """The rows of other thetas, and whether all worlds stayed finite.

        Windows begin where they do in the fit, and what other starts could make up for is taken out to first order: a
        start that were moved along would lead those windows astray in which friction sticks. Differences of replays
        are taken, with the integrator that is good enough for derivatives.
        """
        lin, windows = self.fitted.lin, self.windows
        every = torch.cat([lin.theta[None], theta])
        binned, valid = replay_binned(
            self.fitted.rough, windows, every, lin.starts.expand(len(every), *lin.starts.shape)
        )
        residual = lin.residual - (binned[1:] - binned[0])
        return left_of(windows, self.fitted.rows, residual, lin.starts), valid[1:].all(-1)

    @property
    def at_once(self) -> int:
        """Thetas whose rows are held at once."""
        return max(1, HELD // self.fitted.rows.residual.numel())


def score_of(evaluation: Evaluation, evaluator: Evaluator, folds: int | None = None) -> Score:
    """The score of a fitted hypothesis.

    Args:
        evaluation, evaluator: the hypothesis, and by what it was fitted.
        folds: number of blocks asked for.
    """
    fitted, windows = evaluation.fitted, evaluator.windows
    rows, space = fitted.rows, fitted.simulator.parameters
    columns = rows.columns * unit_slope(space, fitted.theta)
    U, S, Vh = torch.linalg.svd(columns.flatten(0, 1), full_matrices=False)
    kept = torch.gt(S, NOTHING * float(S[:1].sum()))
    basis, slope = U[:, kept].unflatten(0, columns.shape[:2]), S[kept, None] * Vh[kept]
    tau = residual_correlation_time(windows, evaluation.fitted.lin)
    white = torch.einsum("wmk,wm,wml->kl", basis, rows.residual.square(), basis) * _lost(windows, len(space))
    parts = Parts(torch.einsum("wm,wmk->wk", rows.residual, basis), basis.mT @ basis)
    runs_differ = isinstance(fitted.simulator, ScopedSimulator)
    spread = spread_of(parts, max(tau / windows.bin_step, 1.0) * white, windows, tau, folds, runs_differ)
    return Score(fitted, windows, basis, slope, spread, tau)


def unit_slope(space: ParameterSpace, theta: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """D theta / d u [SI]."""
    log = torch.tensor([parameter.scale == "log" for parameter in space.values()], device=theta.device)
    low, high = space.low.to(theta), space.high.to(theta)
    ratio = torch.where(log, high / torch.where(log, low, 1.0), torch.ones_like(high))
    return torch.where(log, theta * torch.log(ratio), high - low)


def _lost(windows: Windows, parameters: int) -> float:
    """By how much the squares of a residual are too small because starts and theta were fitted."""
    seen, fitted = int(windows.seen.sum()), int(windows.free_starts[windows.moving].sum()) + parameters
    return seen / max(seen - fitted, seen // 10, 1)
