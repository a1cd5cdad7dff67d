"""How far each of the hypotheses that the data cannot tell apart is to be believed.

    w_k = share of draws in which h_k predicts the left-out data best,      folds weighed by u ~ Dir(1, ... 1) in each

This is the Bayesian bootstrap (Rubin 1981) of left-out scores, as in pseudo-Bayesian model averaging (Yao, Vehtari,
Simpson and Gelman 2018). The rule calls hypotheses equally good whose gains differ by less than a tenth: those that lie
so near to the best one share the draw. The weights are means over all ways in which data are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.hypotheses.additions import Addition, OwnValues
from onlinebayes.criticism.hypotheses.evaluating import Evaluation
from onlinebayes.criticism.hypotheses.explaining import Explanation
from onlinebayes.criticism.hypotheses.hypothesis import Hypothesis
from onlinebayes.criticism.hypotheses.ranking import rivals
from onlinebayes.criticism.hypotheses.rule import SHARE_OF_GAINED
from onlinebayes.criticism.hypotheses.scoring import LeftOut

DRAWS = 2000
"""The standard error of a weight is about a hundredth."""

MOST = 3
"""Rivals that are fitted: those that did best."""


@dataclass(frozen=True, eq=False)
class Weighted:
    """A fitted hypothesis and how far it is to be believed, between 0 and 1."""

    evaluation: Evaluation
    weight: float


def weighted(explanation: Explanation) -> tuple[Weighted, ...]:
    """What was found, first, and the same with its first addition replaced by one that cannot be told from it.

    The first addition explains most, and the verdict is about it; rivals of later ones are named in the report.
    """
    evaluations = [explanation.found, *_others(explanation)]
    ways = zip(*(one.left for one in evaluations), strict=True)
    weights = torch.stack(
        [weights_of(left, base) for left, base in zip(ways, explanation.base.left, strict=True)]
    ).mean(0)
    return tuple(Weighted(*pair) for pair in zip(evaluations, weights.tolist(), strict=True))


def weights_of(left: Sequence[LeftOut], base: LeftOut) -> Float[Tensor, " K"]:
    """Weights of K hypotheses that gain something over the base model."""
    if len(left) == 1:
        return torch.ones(1, dtype=torch.float64)
    draw = torch.Generator().manual_seed(0)
    folds = len(base.squares)
    u = torch.distributions.Exponential(1.0).icdf(torch.rand(DRAWS, folds, generator=draw, dtype=torch.float64))
    score = torch.stack([_scores(one, u) for one in (base, *left)])
    gains = score[0] - score[1:]
    best = gains.max(0).values
    near = (gains >= best - SHARE_OF_GAINED * best.clamp_min(0)).to(u)
    return (near / near.sum(0)).mean(1)


def _scores(left: LeftOut, u: Float[Tensor, "D F"]) -> Float[Tensor, " D"]:
    """S with the folds weighed so."""
    squares, counts = (torch.einsum("df,fbs->dbs", u, one.to(u)) for one in (left.squares, left.counts))
    return LeftOut(squares, counts).fold_scores


def _others(explanation: Explanation) -> Iterator[Evaluation]:
    hypothesis, evaluator = explanation.found.hypothesis, explanation.evaluator
    first = next((one for one in hypothesis.additions if not isinstance(one, OwnValues)), None)
    for found in explanation.rounds:
        if first is None or found.added is None or found.added.addition != first:
            continue
        known = {trial.addition.key: trial.evaluation.values for trial in found.tried}
        begun = {one.addition.key: one.begun for one in found.screened}
        for other in rivals(found)[:MOST]:
            values = explanation.found.values
            starts = [known[other.key]] if other.key in known else [{**values, **one} for one in begun[other.key]]
            evaluation = evaluator.evaluate(_replaced(hypothesis, first, other), [*starts, values])
            if evaluation is not None:
                yield evaluation


def _replaced(hypothesis: Hypothesis, one: Addition, other: Addition) -> Hypothesis:
    return Hypothesis(tuple(other if addition == one else addition for addition in hypothesis.additions))
