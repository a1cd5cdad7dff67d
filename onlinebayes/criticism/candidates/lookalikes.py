"""Candidates that could stand in an accepted effect's place, though its round had no reason to refit them.

A round refits the few that are most significant while the misfit is gross. At the final model

    e = replay with the effect - replay without it,   c_k = replay with a candidate's trial instead - replay without
    left_k = min over a, b of |e~ - F~ a - c~_k b|^2

(~: starts projected out; F the other fitted parameters). A candidate looks alike where it would leave less than three
times the final error, sqrt(1 + left_k / misfit) < 3, with a size on its own side of neutral. Trials are as large as
what they replace, |c~_k| = |e~|: beside a contact a hundredth of its friction is another motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import Trial, trials
from onlinebayes.criticism.candidates.survey import starting_values, trial_columns
from onlinebayes.criticism.judging.screening import CONFOUNDED, orthonormal
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import Projected, noise_rows
from onlinebayes.identification.fitting.sensitivities import columns
from onlinebayes.identification.replaying.scoped import effect_entries, with_effect_values
from onlinebayes.simulators.effects import Effect

ALIKE = 3.0  # times the final error; beside kinks a straight line is off by as much, and a refit tells
MOST = 3
ROUNDS = 4  # of enlarging a trial: a small one may overstate what a larger one does, or understate it


def lookalikes(
    final: Fit, windows: Windows, effect: Effect, others: Sequence[Effect]
) -> list[tuple[Effect, dict[str, float]]]:
    """The candidates that look most like ``effect``, at most three, with the values at which a refit begins.

    Args:
        final, windows: the model that holds the effect, and what it was fitted on.
        effect: the accepted one.
        others: candidates that the model does not hold.
    """
    if not others:
        return []
    without = _without(final, effect)
    away, valid = columns(final.simulator, windows, without.theta, final.theta[None], final.lin.starts)
    moved, rest = away[0] * valid[0], _others_columns(final, effect)
    tried = trials(others)
    for k in range(ROUNDS):
        raw = trial_columns(without, windows, others, tried)
        left, size, larger = _unexplained(final.projected, windows, rest, moved, raw)
        if k < ROUNDS - 1:
            known = zip(tried, size.tolist(), larger.tolist(), strict=True)
            tried = tuple(_resized(others[trial.candidate], trial, b, factor) for trial, b, factor in known)
    most = (ALIKE**2 - 1) * final.projected.objective
    near: dict[int, dict[str, float]] = {}
    for i in left.argsort().tolist():
        trial = tried[i]
        if float(left[i]) >= most or len(near) == MOST:
            break
        if trial.candidate not in near and (trial.two_sided or float(size[i]) > 0):
            near[trial.candidate] = starting_values(others[trial.candidate], trial, float(size[i]))
    return [(others[k], values) for k, values in near.items()]


def _resized(effect: Effect, trial: Trial, size: float, factor: float) -> Trial:
    """The trial as large as what moves the replay as the effect does, in the same direction; finite starts stay."""
    if not size or trial.values in effect.starts:
        return trial
    first = effect.magnitude
    bounds, neutral = effect.parameters[first], effect.neutral[first]
    towards = math.copysign(1.0, size) if trial.two_sided else 1.0
    value = min(max(neutral + towards * factor * trial.reach, bounds.low), bounds.high)
    return replace(trial, values={**trial.values, first: value}, reach=value - neutral)


def _without(final: Fit, effect: Effect) -> Fit:
    """The final model with the effect neutral and all else as it is: where the effect and its rivals set out from."""
    theta = with_effect_values(final.simulator, final.theta, effect, effect.neutral)
    return replace(final, lin=replace(final.lin, theta=theta))


def _others_columns(final: Fit, effect: Effect) -> Float[Tensor, "V m P"]:
    """Projected columns of the parameters that are not the effect's."""
    own = set(effect_entries(final.simulator, effect))
    keep = [i for i, name in enumerate(final.simulator.parameters) if name not in own]
    return final.projected.columns[..., keep]


def _unexplained(
    projected: Projected,
    windows: Windows,
    fitted: Float[Tensor, "V m P"],
    moved: Float[Tensor, "W n S"],
    raw: Float[Tensor, "C W n S"],
) -> tuple[Float[Tensor, " C"], Float[Tensor, " C"], Float[Tensor, " C"]]:
    """left_k, the size b and |e~| / |c~| of every trial; one that the other parameters do as well explains nothing."""
    Q = orthonormal(fitted.flatten(0, 1))
    rows = projected.project(noise_rows(windows, torch.cat([moved[None], raw]).movedim(0, -1))).flatten(0, 1)
    free = rows - Q @ (Q.T @ rows)
    e, c = free[:, 0], free[:, 1:]
    norm = c.square().sum(0)
    known = norm > CONFOUNDED * rows[:, 1:].square().sum(0).clamp_min(1e-300)
    size = torch.where(known, c.T @ e / norm.clamp_min(1e-300), torch.zeros_like(norm))
    whole = e.square().sum()
    return whole - size.square() * norm, size, (whole / norm.clamp_min(1e-300)).sqrt()
