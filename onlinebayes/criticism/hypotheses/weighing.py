"""The other hypotheses that the data leave open beside what was found, and how far each is to be believed.

An addition had equals when it entered. Whether it still has is asked once more at the end, beside all that came later
and over all windows: the same hypothesis with the equal in its place is fitted, and judged by the one rule.

    w_k = share of draws in which h_k predicts the left-out data best,      folds weighed by u ~ Dir(1, ... 1) in each

This is the Bayesian bootstrap (Rubin 1981) of left-out scores, as in pseudo-Bayesian model averaging (Yao, Vehtari,
Simpson and Gelman 2018). The rule calls hypotheses equally good whose gains differ by less than a tenth: those that lie
so near to the best one share the draw. The weights are means over all ways in which data are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.hypotheses.additions import OwnValues
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import rivals
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.identification.judging.evaluator import Evaluation, FitRequest
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.judging.rule import SHARE_OF_GAINED, equally_good
from onlinebayes.identification.judging.scoring import LeftOut, score_parts
from onlinebayes.runs import side_by_side

DRAWS = 2000
"""The standard error of a weight is about a hundredth."""

LEAST_WEIGHT = 0.01
"""A rival of less is none: the report would call two laws alike and print less than 1 % beside one of them."""

MOST_HYPOTHESES = 3
"""Rivals that are fitted: those that did best."""


@dataclass(frozen=True, eq=False)
class Weighted:
    """A fitted hypothesis and how far it is to be believed, between 0 and 1."""

    evaluation: Evaluation
    weight: float


def settled(explanation: Explanation) -> Explanation:
    """With those rivals of its first addition alone that are still as good beside all else.

    The first addition explains most, and the verdict is about it; rivals of later ones are named in the report.
    """
    hypothesis = explanation.found.hypothesis
    first = next((one for one in hypothesis.additions if not isinstance(one, OwnValues)), None)
    rounds, open_ = list(explanation.rounds), list[Evaluation]()
    for k, found in enumerate(rounds):
        if first is None or found.added is None or found.added.addition != first:
            continue
        asked = rivals(found)[:MOST_HYPOTHESES]
        fitted = side_by_side([partial(in_its_place, explanation, found, rival) for rival in asked])
        left = believed(explanation.found, explanation.base, {r.key: one for r, one in zip(asked, fitted, strict=True)})
        gone = {rival.key for rival in asked} - {*left}
        open_ += left.values()
        equal = tuple(trial for trial in found.equal if trial.addition.key not in gone)
        alike = tuple(one for one in found.alike if one.key not in gone)
        rounds[k] = replace(found, equal=equal, alike=alike)
    return replace(explanation, rounds=tuple(rounds), rivals=tuple(open_))


def weighted(explanation: Explanation) -> tuple[Weighted, ...]:
    """Weigh what was found, which comes first, and its rivals."""
    evaluations = [explanation.found, *explanation.rivals]
    return tuple(map(Weighted, evaluations, _weights(evaluations, explanation.base)))


def _weights(evaluations: Sequence[Evaluation], base: Evaluation) -> list[float]:
    """Means over all ways in which data are left out."""
    ways = zip(*(one.left_out for one in evaluations), strict=True)
    each = [weights_of(left, of_base) for left, of_base in zip(ways, base.left_out, strict=True)]
    return [float(weight) for weight in torch.stack(each).mean(0)]


def weights_of(left: Sequence[LeftOut], base: LeftOut) -> Float[Tensor, " K"]:
    """Weights of K hypotheses that gain something over the base model."""
    if len(left) == 1:
        return torch.ones(1, dtype=torch.float64)
    draw = torch.Generator().manual_seed(0)
    folds = len(base.folds)
    u = torch.distributions.Exponential(1.0).icdf(torch.rand(DRAWS, folds, generator=draw, dtype=torch.float64))
    score = torch.stack([_scores(one, u) for one in (base, *left)])
    gains = score[0] - score[1:]
    best = gains.max(0).values
    near = (gains >= best - SHARE_OF_GAINED * best.clamp_min(0)).to(u)
    return (near / near.sum(0)).mean(1)


def _scores(left: LeftOut, u: Float[Tensor, "D F"]) -> Float[Tensor, " D"]:
    """S with the folds weighed so."""
    squares, counts = (torch.einsum("df,fbs->dbs", u, one.to(u)) for one in left.of_folds)
    return score_parts(squares, counts).sum(-1)


def in_its_place(explanation: Explanation, found: Round, rival: Addition) -> Evaluation | None:
    """Fit what was found with a rival in the place of what a round added; None where it cannot be followed.

    Args:
        explanation: whose evaluator fits it.
        found: a round that added something which is kept.
        rival: one that this round screened.
    """
    assert found.added is not None
    tried = {trial.addition.key: trial.evaluation.values for trial in found.tried}
    screened = {one.addition.key: one.begun for one in found.screened}
    values, first = explanation.found.values, found.added.addition
    starts = [tried[rival.key]] if rival.key in tried else [{**values, **one} for one in screened[rival.key]]
    hypothesis = explanation.found.hypothesis
    other = Hypothesis(tuple(rival if addition == first else addition for addition in hypothesis.additions))
    return explanation.evaluator.evaluate(FitRequest(other, [*starts, values]))


def believed(found: Evaluation, base: Evaluation, fitted: Mapping[str, Evaluation | None]) -> dict[str, Evaluation]:
    """Those rivals that the rule calls as good as what was found, and that keep a weight beside it.

    Args:
        found, base: what was found, and the model without it.
        fitted: key of a rival -> the same with it in its place; None where that cannot be followed.
    """
    won = [one.gain for one in found.gains(base)]
    good = {key: one for key, one in fitted.items() if one and equally_good(found.gains(one), won)}
    _, *weights = _weights([found, *good.values()], base)
    return {key: one for (key, one), weight in zip(good.items(), weights, strict=True) if weight >= LEAST_WEIGHT}
