"""Has a parameter one value in all runs? A score test of one value a run, calibrated by flipping parts of the runs.

    c~_r  the parameter's sensitivity in run r alone, off the starts and all fitted parameters, its shared one included
    g = sum_b g_b,   g_b = sum over part b of C~ r,   T = g' V^-1 g / s^2,   V = C~' C~       (Rao's score test, R - 1)
    under the flips F = diag(+-1 per part):   T_F with g_F = sum_b +-g_b and V_F = C~' F (I - P) F C~
    p = share of the flips whose largest T_F, over all parameters and horizons, reaches T

Each run is cut into parts of max(H, 4 tau) at least, two where it is long enough for them and some 24 in all runs
together: what speaks for a value of its own is that the parts of one run agree. A run of one part says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.judging.score import SHORT_WINDOWS
from onlinebayes.criticism.judging.screening import Scores, block_scores, flips
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import BLOCK_CORRELATION_TIMES, MOST_GROUPS
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import project
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.simulators.identifiable import Identifiable

AT_ONCE = 512  # flips
RIDGE = 1e-6


def contrast_p_values(current: Fit, windows: Windows, addresses: Sequence[str], tau: float) -> dict[str, float]:
    """p of the maximum test for each of the addresses; empty where the windows belong to a single run.

    Args:
        current: the model as it stands, with these parameters shared by all runs.
        windows: what it was fitted to.
        addresses: of free parameters.
        tau: correlation time of its residual [s].
    """
    owner = owners(current.simulator, windows)
    masks = [owner == who for who in torch.unique(owner[owner >= 0])]
    if len(masks) < 2 or not addresses:
        return {}
    parts = parts_of_runs(windows, owner, tau)
    signs = flips(int(parts.max()) + 1, current.theta)
    own = torch.stack(masks, -1).to(current.theta)
    found = signs.new_zeros(len(addresses), len(signs))
    for pieces in (1, SHORT_WINDOWS):
        projected = project(windows, current.lin, current.projected.weight, pieces)
        for k, address in enumerate(addresses):
            column = projected.columns[..., current.simulator.parameters.index(address)]
            columns = column[..., None] * own.repeat_interleave(pieces, 0)[:, None, :]
            scores = block_scores(projected, columns, parts.repeat_interleave(pieces), int(parts.max()) + 1)
            found[k] = torch.maximum(found[k], _statistic(scores, signs))
    largest, observed = found.amax(0), found[:, :1]
    p = (largest[None] >= observed * (1 - 1e-9)).to(found).mean(1)
    return dict(zip(addresses, p.tolist(), strict=True))


def owners(simulator: Identifiable, windows: Windows) -> Int[Tensor, " W"]:
    """Number of the run, or of the group of runs, that each window belongs to; -1 for those of no group or run."""
    return simulator.owner_of(windows) if isinstance(simulator, ScopedSimulator) else windows.run


def parts_of_runs(windows: Windows, owner: Int[Tensor, " W"], tau: float) -> Int[Tensor, " W"]:
    """Number of the part of a run that each window belongs to, counted from 0.

    Args:
        windows: in the order of time within each run.
        owner: whose windows they are.
        tau: correlation time of the residual [s].
    """
    moving = windows.moving
    together = max(1, math.ceil(BLOCK_CORRELATION_TIMES * tau / windows.horizon - 1e-9))
    parts, first = torch.zeros_like(owner), 0
    for who in torch.unique(owner):
        mine = owner == who
        moved = int((mine & moving).sum())
        wanted = max(2, round(MOST_GROUPS * moved / max(int(moving.sum()), 1)))
        count = max(1, min(wanted, moved // together))
        order = (moving[mine].cumsum(0) - moving[mine].long()) * count // max(moved, 1)
        parts[mine] = first + order.clamp_max(count - 1)
        first += count
    return parts


def _statistic(scores: Scores, signs: Float[Tensor, "X B"]) -> Float[Tensor, " X"]:
    """T under every flip; one run's column is left out, as the shared value makes it up from the others."""
    whole = scores.norm / scores.share.clamp_min(1e-300)
    kept = (whole > 1e-12 * whole.max().clamp_min(1e-300)).nonzero()[:-1, 0]
    if not len(kept):
        return signs.new_zeros(len(signs))
    g, h, loads = scores.g[:, kept], scores.h[..., kept], scores.loads[:, kept]
    gram = torch.diag((1 + RIDGE) * whole[kept]) - loads.mT @ loads
    found = []
    for some in signs.split(AT_ONCE):
        total, mixed = some @ g, torch.einsum("xb,bqc->xqc", some, h)
        variance = gram - mixed.mT @ mixed
        found.append((total * torch.linalg.solve(variance, total)).sum(1))
    return torch.cat(found) / max(scores.scale, 1e-300) ** 2
