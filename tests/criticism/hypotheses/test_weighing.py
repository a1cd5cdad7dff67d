"""Weights of hypotheses: equal for equal predictions, all for what predicts every fold better."""

from __future__ import annotations

import torch

from onlinebayes.criticism.hypotheses.weighing import believed, weights_of
from onlinebayes.identification.judging.evaluator import Evaluation
from onlinebayes.identification.judging.scoring import Folds, Gain, LeftOut

FOLDS, BANDS = 8, 3


def predicting(rms: torch.Tensor) -> LeftOut:
    """Left-out squares of a hypothesis with this RMS in each fold [floors]."""
    counts = torch.full((FOLDS, BANDS, 1), 50.0, dtype=torch.float64)
    folds = Folds(torch.arange(FOLDS), tuple((f"run{r}", 0.0, 1.0) for r in range(FOLDS)))
    return LeftOut(counts * rms.double().square()[:, None, None], counts, folds)


BASE = predicting(torch.full((FOLDS,), 10.0))


def test_equal_predictions_share_the_belief() -> None:
    same = predicting(torch.linspace(1, 2, FOLDS))
    torch.testing.assert_close(weights_of([same, same], BASE), torch.tensor([0.5, 0.5], dtype=torch.float64))


def test_what_predicts_every_fold_better_is_believed_alone() -> None:
    good, poor = predicting(torch.full((FOLDS,), 1.0)), predicting(torch.full((FOLDS,), 5.0))
    assert weights_of([good, poor], BASE).tolist() == [1.0, 0.0]


def test_what_predicts_half_of_the_folds_better_is_believed_by_half() -> None:
    rms = torch.tensor([1.0, 6.0]).repeat(FOLDS // 2)
    weights = weights_of([predicting(rms), predicting(rms.flip(0))], BASE)
    assert float(weights.sum()) == 1.0
    assert float((weights - 0.5).abs().max()) < 0.05


def test_one_hypothesis_has_all_the_weight() -> None:
    assert weights_of([BASE], BASE).tolist() == [1.0]


class Fitted(Evaluation):
    """A hypothesis with what the rule and the weights look at; its gains are as uncertain as is said."""

    def __init__(self, left_out: LeftOut, score: float, se: float = 0.0) -> None:
        for name, value in (("left_out", (left_out,)), ("told", score), ("se", se)):
            object.__setattr__(self, name, value)

    def gains(self, other: Fitted) -> list[Gain]:
        """How much better it is than another one."""
        return [Gain((other.told - self.told,), self.se, FOLDS, 0)]


def test_a_rival_that_every_draw_passes_over_is_none_however_uncertain_its_gain_is_called() -> None:
    base = Fitted(BASE, 3.0)
    found = Fitted(predicting(torch.full((FOLDS,), 1.0)), 1.0, se=5.0)
    as_good = Fitted(predicting(torch.full((FOLDS,), 1.01)), 1.01)
    worse = Fitted(predicting(torch.full((FOLDS,), 2.0)), 1.5)
    kept = believed(found, base, {"as good": as_good, "worse": worse, "diverges": None})
    assert [*kept] == ["as good"]
