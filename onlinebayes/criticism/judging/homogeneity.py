"""Is an effect one law, or a patch: its size refitted in parts of the data, with its shape and everything else fixed.

    alpha_g = 1 + sum_g c~ r / sum_g c~^2,      se_g = s sqrt(tau / Delta) / |c~_g|,     g a block or a half of the data

c~ is the sensitivity to scaling the whole effect, starts projected out; alpha may become negative, whatever the
effect's bounds. Homogeneous: among the parts with se < half the mean size, 80 % share the mean's sign, and the sd
between parts (DerSimonian and Laird 1986) is at most half the mean. The parts are the blocks, and besides v > 0 and
v < 0, abs(v) and q above and below their medians, these at the short horizon, where a row's error comes from its own
neighbourhood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.criticism.judging.score import SHORT_WINDOWS
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.identification.fitting.blocks import Blocks
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import project
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.simulators.effects import Effect

SAME_SIGN_SHARE = 0.8
"""One law has the mean's sign in this share of the parts at least."""

MOST_SPREAD = 0.5
"""The sizes of one law differ between parts by an sd of this share of their mean at most."""


def homogeneous(fitted: Fit, windows: Windows, blocks: Blocks, effect: Effect, tau: float) -> bool:
    """Whether ``effect``, a part of the fitted model, has the same size everywhere."""
    first = effect.magnitude
    columns = first_columns(fitted, effect)
    size = fitted.theta[columns] - effect.neutral[first]
    if not bool(size.any()):
        return False
    joint = effect.target if effect.target_kind == "joint" else None
    return one_law(fitted, windows, columns, size, blocks.of, tau, joint)


def one_law(
    fitted: Fit,
    windows: Windows,
    columns: Sequence[int],
    size: Float[Tensor, " C"],
    parts: Int[Tensor, " W"],
    tau: float,
    joint: str | None = None,
) -> bool:
    """Whether the data ask for the same size of some parameters' deviations in every part and every half of the motion.

    Args:
        fitted, windows: the model and what it was fitted to.
        columns: the parameters' places in theta.
        size: by which they deviate from where they would be nothing [SI].
        parts: number of the part of the data that each window belongs to, for the long horizon.
        tau: correlation time of the residual [s].
        joint: by whose motion the short windows are halved; see :func:`motion_halves`.
    """
    spread = math.sqrt(max(tau / windows.bin_step, 1.0))
    long = project(windows, fitted.lin)
    rows, r = (size * long.columns[..., columns]).sum(-1), long.residual
    scale = float((r.square().sum() / (long.row_weight > 0).sum()).sqrt()) * spread
    empty = rows.new_zeros(int(parts.max()) + 1)
    cross, square = (empty.index_add(0, parts, x.sum(1)) for x in (rows * r, rows.square()))
    if not agree(cross, square, scale):
        return False
    short = project(windows, fitted.lin, pieces=SHORT_WINDOWS)
    rows = short.measured_rows((size * short.columns[..., columns]).sum(-1))
    r = short.measured_rows(short.residual)
    scale = float((r.square().sum() / short.seen().sum()).sqrt()) * spread
    for half in motion_halves(fitted, windows, joint):
        masks = torch.stack([half, ~half]) & short.seen()
        cross, square = ((x * masks).sum((1, 2, 3)) for x in (rows * r, rows.square()))
        if not agree(cross, square, scale):
            return False
    return True


def first_columns(fitted: Fit, effect: Effect) -> list[int]:
    """Where the effect's first parameter stands in theta: one place, or one a run."""
    first, entries = effect.magnitude, effect_entries(fitted.simulator, effect)
    return [fitted.simulator.parameters.index(entry) for entry, name in entries.items() if name == first]


def agree(cross: Float[Tensor, " G"], square: Float[Tensor, " G"], scale: float) -> bool:
    """The rule for one partition.

    Args:
        cross: sum of c~ r in each part.
        square: sum of c~^2 in each part.
        scale: s sqrt(tau / Delta).
    """
    known = square > 0
    alpha, se = 1 + cross[known] / square[known], scale / square[known].sqrt()
    w = 1 / se.square().clamp_min(1e-300)
    mean = float((w * alpha).sum() / w.sum())
    sharp = se < 0.5 * abs(mean)
    if int(sharp.sum()) < 2:
        return True
    alpha, w = alpha[sharp], w[sharp]
    mean = float((w * alpha).sum() / w.sum())
    share = float(((alpha > 0) == (mean > 0)).to(alpha).mean())
    return share >= SAME_SIGN_SHARE and between_sd(alpha, w) <= MOST_SPREAD * abs(mean)


def between_sd(alpha: Float[Tensor, " G"], w: Float[Tensor, " G"]) -> float:
    """DerSimonian and Laird's sd between parts, from estimates and their inverse variances."""
    mean = (w * alpha).sum() / w.sum()
    q = float((w * (alpha - mean).square()).sum())
    c = float(w.sum() - w.square().sum() / w.sum())
    return math.sqrt(max(0.0, (q - (len(alpha) - 1)) / c)) if c > 0 else 0.0


def motion_halves(fitted: Fit, windows: Windows, joint: str | None = None) -> list[Bool[Tensor, "V n S"]]:
    """The three ways to halve the short windows' bins: by the sign of v, by abs(v), by q.

    An effect at a joint is halved by that ``joint``'s motion, one at an actuator by each signal's own joint. What was
    not measured halves nothing: a joint that is seen by its velocity alone is halved by abs(v) twice.
    """
    names = joint_names(fitted.simulator)
    signals = [fitted.simulator.signals[c] for c in windows.columns]
    n = windows.bins // SHORT_WINDOWS
    motion = windows.bin(windows.value)
    found: list[list[Tensor]] = [[], [], []]
    for name in signals:
        moving = joint or name.partition(".")[2]
        by = seen_by(moving if moving in names else names[0], signals)
        v, seen = by.velocity(motion, windows.bin_step), windows.seen[..., by.column]
        q = motion[..., by.column] if by.position else v.abs()
        fast = v.abs() > v.abs()[seen].median() if bool(seen.any()) else seen
        far = q > q[seen].median() if bool(seen.any()) else seen
        for part, mask in zip(found, (v > 0, fast, far), strict=True):
            part.append(mask[:, : n * SHORT_WINDOWS].unflatten(1, (SHORT_WINDOWS, n)).flatten(0, 1))
    return [torch.stack(part, -1) for part in found]
