"""Candidates that could stand in an accepted effect's place, though its round had no reason to refit them.

A round refits the few that are most significant while the misfit is gross. At the final model

    e = replay with the effect - replay without it,   left_k = min over a, b of |e~ - F~ a - c~_k b|^2

(~: starts projected out; F the other fitted parameters, c_k a candidate's trial). A candidate looks alike where it
would leave sqrt(1 + left_k / misfit) < 1.5 times the final error, with a size on its own side of neutral.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates import trials
from onlinebayes.criticism.fit import Fit
from onlinebayes.criticism.projection import Projected, noise_rows
from onlinebayes.criticism.scoped import effect_entries
from onlinebayes.criticism.screening import CONFOUNDED, orthonormal
from onlinebayes.criticism.sensitivities import columns
from onlinebayes.criticism.survey import starting_values, trial_columns
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.effects import Effect

NEAR = 1.5  # times the final error
MOST = 3


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
    moved = _without(final, windows, effect)
    tried = trials(others)
    raw = trial_columns(final, windows, others, tried)
    left, size = _unexplained(final.projected, windows, _others_columns(final, effect), moved, raw)
    most = (NEAR**2 - 1) * final.projected.objective
    near: dict[int, tuple[float, dict[str, float]]] = {}
    for i in left.argsort().tolist():
        trial = tried[i]
        if float(left[i]) >= most or len(near) == MOST:
            break
        if trial.candidate not in near and (trial.two_sided or float(size[i]) > 0):
            values = starting_values(others[trial.candidate], trial, float(size[i]))
            near[trial.candidate] = (float(left[i]), values)
    return [(others[k], values) for k, (_, values) in near.items()]


def _without(final: Fit, windows: Windows, effect: Effect) -> Float[Tensor, "W n S"]:
    """How the effect moves the replay: with it minus without it."""
    theta = final.theta.clone()
    for address, name in effect_entries(final.simulator, effect).items():
        theta[final.simulator.parameters.index(address)] = effect.neutral[name]
    raw, valid = columns(final.simulator, windows, final.theta, theta[None], final.lin.starts)
    return -raw[0] * valid[0]


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
) -> tuple[Float[Tensor, " C"], Float[Tensor, " C"]]:
    """left_k and the size b of every trial; a trial that the other parameters do as well explains nothing."""
    Q = orthonormal(fitted.flatten(0, 1))
    rows = projected.project(noise_rows(windows, torch.cat([moved[None], raw]).movedim(0, -1))).flatten(0, 1)
    free = rows - Q @ (Q.T @ rows)
    e, c = free[:, 0], free[:, 1:]
    norm = c.square().sum(0)
    known = norm > CONFOUNDED * rows[:, 1:].square().sum(0).clamp_min(1e-300)
    size = torch.where(known, c.T @ e / norm.clamp_min(1e-300), torch.zeros_like(norm))
    return e.square().sum() - size.square() * norm, size
