"""Intervals by sequence: sequences are drawn anew with all of their seconds (Efron 1979), as their seconds are alike.

d_b = statistic(stretches of S sequences drawn with replacement),    interval = quantiles of d_1 ... d_B
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from envs.egocentric import Stretches

DRAWS = 200


def draws(seen: Stretches, generator: torch.Generator) -> list[Int[Tensor, " R"]]:
    """Rows of the stretches of each draw."""
    names = seen.sequence.unique()
    rows = [(seen.sequence == name).nonzero().squeeze(-1) for name in names]
    picks = torch.randint(len(names), (DRAWS, len(names)), generator=generator)
    return [torch.cat([rows[k] for k in pick.tolist()]) for pick in picks]


def of_rows(seen: Stretches, rows: Int[Tensor, " R"]) -> Stretches:
    """Some of the stretches."""
    names = ("features", "motion_right", "vision_rate", "length", "sequence")
    return replace(seen, **{name: getattr(seen, name)[rows] for name in names})


def interval(
    seen: Stretches, statistic: Callable[[Stretches, Int[Tensor, " R"]], Float[Tensor, " U"]], seed: int
) -> tuple[Float[Tensor, " U"], Float[Tensor, " U"]]:
    """5 and 95 % quantiles of a statistic of (stretches, their rows)."""
    generator = torch.Generator().manual_seed(seed)
    values = torch.stack([statistic(of_rows(seen, rows), rows) for rows in draws(seen, generator)])
    low, high = torch.quantile(values, torch.tensor([0.05, 0.95]).to(values), dim=0)
    return low, high
