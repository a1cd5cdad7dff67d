"""Peer (a): sparse identification (pysindy's STLSQ and FROLS) of the force that the engineer's model lacks.

    F = sum_p dtheta_p F_p + sum_k xi_k phi_k(q, v, drives),     xi sparse

The library holds the true term wherever an instantaneous law can be one (see ``library``); parameters that are free
anyway are regressed beside it and never thresholded. Smoothing, optimizer and threshold are those with the smallest
open-loop error, cross-validated over the fit runs. Then terms are taken away as long as that error does not rise by
more than 1 %: a term whose removal raises it is claimed. Brunton, Proctor and Kutz 2016; discrepancies: de Silva,
Higdon, Brunton and Kutz 2020.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pysindy
from jaxtyping import Bool, Float
from numpy import ndarray
from torch import Tensor

from onlinebayes.identification import Windows
from recipes.studies.peers.library import Library, base_theta, library
from recipes.studies.peers.motion import cross_validated, folds, forces, motion
from recipes.studies.peers.task import Claim, Fitted, Task, open_loop_error
from recipes.studies.peers.worlds import Course, simulate

SMOOTHING = (0.04, 0.08, 0.12, 0.2)
THRESHOLDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
RIDGE = 1e-6
MOST = 6  # terms that FROLS adds
CONFOUNDED = 0.03  # share of a term that the free parameters leave of it
ROWS = 3000
TIE = 1.01  # errors closer than this are equal, as in criticism


@final
@dataclass(frozen=True)
class Law(Fitted):
    """The base model with moved parameters and the terms that were kept.

    Args:
        made: the library.
        theta: of its simulator.
        xi: coefficient of each term.
        claims: see :class:`Fitted`.
    """

    made: Library
    theta: Float[ndarray, " P"]
    xi: Float[ndarray, " T"]
    claims: tuple[Claim, ...]

    def predict(self, windows: Windows) -> Float[Tensor, "W K S"]:
        """See :class:`Fitted`."""
        copies = windows.count
        theta, xi = (np.tile(part, (copies, 1)) for part in (self.theta, self.xi))
        return _rollout(self.made, theta, xi, windows, self.made.course(windows))


@final
@dataclass(frozen=True)
class Regression:
    """Rows of the stacked regression at one length of smoothing.

    Args:
        columns: F_p, then phi_k, at each row and joint in units of that joint's residual.
        target: F likewise.
        window: the window that each row belongs to.
        parameters: number P of the F_p.
        free: how many of them, the first, are never thresholded.
    """

    columns: Float[ndarray, "n C"]
    target: Float[ndarray, " n"]
    window: ndarray
    parameters: int
    free: int

    def of(self, rows: Bool[ndarray, " n"]) -> Regression:
        """Some rows."""
        return replace(self, columns=self.columns[rows], target=self.target[rows], window=self.window[rows])

    def supports(self) -> Bool[ndarray, "A C"]:
        """The supports that pysindy's optimizers leave: STLSQ at every threshold, and each step of FROLS.

        Thresholds are relative to the target's size. The free parameters' columns are projected out beforehand, for
        pysindy 2.1's ``sparse_ind``, which would exempt them, mixes its indices up.
        """
        base = self.columns[:, : self.free]
        basis = np.linalg.qr(base / np.linalg.norm(base, axis=0).clip(1e-12))[0]
        terms, target = (part - basis @ (basis.T @ part) for part in (self.columns[:, self.free :], self.target))
        norm = np.linalg.norm(terms, axis=0)
        usable = np.flatnonzero(norm > CONFOUNDED * np.linalg.norm(self.columns[:, self.free :], axis=0).clip(1e-12))
        x, y = terms[:, usable] / norm[usable], target[:, None] / np.linalg.norm(target)
        coefficients = [np.zeros(len(usable))]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that a threshold leaves nothing is an answer
            for threshold in THRESHOLDS:
                stlsq = pysindy.STLSQ(threshold=threshold, alpha=RIDGE, unbias=False).fit(x, y)
                coefficients.append(np.ravel(stlsq.coef_))
            frols = pysindy.FROLS(max_iter=min(MOST, len(usable)), alpha=RIDGE).fit(x, y)
            coefficients += [np.ravel(step) for step in frols.history_]
        found = np.zeros((len(coefficients), self.columns.shape[1]), dtype=bool)
        found[:, : self.free] = True
        found[:, self.free + usable] = np.stack(coefficients) != 0
        return np.unique(found, axis=0)

    def on(self, support: Bool[ndarray, " C"]) -> Float[ndarray, " C"]:
        """Least squares on a support."""
        found = np.zeros(len(support))
        norm = np.linalg.norm(self.columns[:, support], axis=0).clip(1e-12)
        found[support] = np.linalg.lstsq(self.columns[:, support] / norm, self.target, rcond=1e-8)[0] / norm
        return found


def fit(task: Task) -> Law:
    """Tune, fit, prune and name."""
    made = library(task)
    driven = made.course(task.fit_windows)
    found = []
    for seconds in SMOOTHING:
        regression = _regression(task, made, driven, seconds)
        supports = regression.supports()
        errors = _errors(task, made, driven, regression, supports)
        best = int(errors.argmin())
        found.append((float(errors[best]), regression, supports[best]))
    error, regression, support = min(found, key=lambda item: item[0])
    support, needed = _pruned(task, made, driven, regression, support, error)
    theta, xi = _parts(task, made, regression, regression.on(support)[None])
    return Law(made, theta[0], xi[0], _claims(made, regression, needed))


def _regression(task: Task, made: Library, driven: Course, seconds: float) -> Regression:
    """The rows of all joints under one another, each joint in units of its residual."""
    moved, now = motion(task, seconds, ROWS), driven.centred()
    known = forces(made.simulator, base_theta(made, task), moved, now.command)
    q, v = (part.reshape(-1, part.shape[2]) for part in (moved.q, moved.v))
    phi = made.evaluate(q, v, now.flat())
    phi = moved.smoothed(phi.reshape(*moved.q.shape[:2], *phi.shape[1:]))
    columns = np.concatenate([known.sensitivity, phi], 1)
    weight = 1 / np.sqrt((known.residual**2).mean(0)).clip(1e-12)
    J, free = columns.shape[2], len(task.base_theta)
    stacked = np.concatenate([weight[j] * columns[:, :, j] for j in range(J)])
    target = np.concatenate([weight[j] * known.residual[:, j] for j in range(J)])
    return Regression(stacked, target, np.tile(moved.window, J), known.sensitivity.shape[1], free)


def _errors(task: Task, made: Library, driven: Course, regression: Regression, supports: ndarray) -> ndarray:
    """Cross-validated open-loop error of each support (C,): every window by the fit without its fold."""
    windows = task.fit_windows
    fold = folds(windows)
    theta, xi = [], []
    for support in supports:
        of_fold = [regression.of(fold[regression.window] != f).on(support) for f in range(fold.max() + 1)]
        own = _parts(task, made, regression, np.stack(of_fold)[fold])
        theta.append(own[0])
        xi.append(own[1])
    signals = _rollout(made, np.concatenate(theta), np.concatenate(xi), windows, driven.tiled(len(supports)))
    squares = open_loop_error(windows, signals.unflatten(0, (len(supports), windows.count)))
    return cross_validated(windows, squares.numpy(), task.noise.numpy())


def _pruned(
    task: Task, made: Library, driven: Course, regression: Regression, support: ndarray, error: float
) -> tuple[ndarray, ndarray]:
    """The support without terms that nothing needs, and which of its terms raise the error when they go."""
    while (terms := np.flatnonzero(support & (np.arange(len(support)) >= regression.free))).size:
        without = np.repeat(support[None], len(terms), 0)
        without[np.arange(len(terms)), terms] = False
        errors = _errors(task, made, driven, regression, without)
        least = int(errors.argmin())
        if not errors[least] <= TIE * error:
            break
        support, error = without[least], min(error, float(errors[least]))
    return support, support & (np.arange(len(support)) >= regression.free)


def _parts(task: Task, made: Library, regression: Regression, found: ndarray) -> tuple[ndarray, ndarray]:
    """(theta, xi) of coefficient rows, theta within its bounds."""
    space, P = made.simulator.parameters, regression.parameters
    theta = base_theta(made, task) + found[:, :P]
    return np.clip(theta, space.low.numpy(), space.high.numpy()), found[:, P:]


def _rollout(made: Library, theta: ndarray, xi: ndarray, windows: Windows, driven: Course) -> Tensor:
    def force(q: ndarray, v: ndarray, now: Course) -> ndarray:
        return np.einsum("nt,ntj->nj", xi, made.evaluate(q, v, now))

    used = np.flatnonzero((xi != 0).any(0))
    made = replace(made, terms=tuple(made.terms[k] for k in used))
    xi = xi[:, used]
    return simulate(made.simulator, theta, windows, force if len(used) else _nothing, driven)


def _nothing(q: ndarray, v: ndarray, now: Course) -> ndarray:
    del v, now
    return np.zeros_like(q)


def _claims(made: Library, regression: Regression, needed: Bool[ndarray, " C"]) -> tuple[Claim, ...]:
    """What the needed terms claim; a spring's constant is its rest position's."""
    P, added = regression.parameters, tuple(made.added.values())
    claims: Sequence[Claim] = [added[k - regression.free] for k in np.flatnonzero(needed[:P])]
    claims = [*claims, *(made.terms[k].claim for k in np.flatnonzero(needed[P:]))]
    sprung = {key.partition("@")[2] for claim in claims for key in claim if "stiffness@" in key}
    loads = {frozenset({f"constant_load@{joint}"}) for joint in sprung}
    return tuple(dict.fromkeys(claim for claim in claims if claim not in loads))
