"""A hypothesis fitted, and judged by what it predicts of data that were left out; every evaluation is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.hypotheses.discretisation import cheapest, fine_enough
from onlinebayes.criticism.hypotheses.fitting import LEAST_GAIN, Fitted, best_theta, fit
from onlinebayes.criticism.hypotheses.hypothesis import Hypothesis, build, theta_of, values_of
from onlinebayes.criticism.hypotheses.scoring import Gain, LeftOut, LinearModel, gain, left_out, partitions
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.ladder import Rung
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Evaluation:
    """A hypothesis, its fit, and the squares of what was left out, for each way of leaving data out."""

    hypothesis: Hypothesis
    fitted: Fitted
    left: tuple[LeftOut, ...]

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters by name [SI]."""
        return values_of(self.fitted.simulator, self.fitted.theta)

    def gains(self, other: Evaluation) -> tuple[Gain, ...]:
        """Over another hypothesis, for each way of leaving data out."""
        return tuple(gain(a, b) for a, b in zip(self.left, other.left, strict=True))


@dataclass
class Evaluator:
    """Fits hypotheses to one set of windows, integrated in one way.

    Args:
        given: the base model at its own step.
        windows: the data.
        runs: names of the fit runs.
        rung: how models are integrated.
        watch: told what is being done.
    """

    given: Identifiable
    windows: Windows
    runs: tuple[str, ...]
    rung: Rung
    watch: Callable[[str], None] = lambda _: None
    known: dict[frozenset[str], Evaluation | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.partitions: tuple[Int[Tensor, " W"], ...] = partitions(self.windows)

    def evaluate(
        self,
        hypothesis: Hypothesis,
        begun: Sequence[Mapping[str, float]],
        starts: Float[Tensor, "W J2"] | None = None,
    ) -> Evaluation | None:
        """The hypothesis fitted from the best of some values; None where the simulator cannot carry or follow it.

        Args:
            hypothesis: what is fitted.
            begun: values by name from which the fit may begin, nominal ones for those that are missing [SI].
            starts: where the windows' starts begin; the smoothed ones when None.
        """
        key = frozenset(hypothesis.keys)
        if key not in self.known:
            self.known[key] = self._fitted(hypothesis, begun, starts)
        return self.known[key]

    def again(
        self, known: Evaluation, values: Mapping[str, float], starts: Float[Tensor, "W J2"] | None = None
    ) -> Evaluation:
        """A hypothesis fitted once more, from elsewhere; as it is known where that is no better."""
        found = self._fitted(known.hypothesis, [values], starts)
        if found is None or found.fitted.score > known.fitted.score - LEAST_GAIN:
            return known
        self.known[frozenset(known.hypothesis.keys)] = found
        return found

    def _fitted(
        self, hypothesis: Hypothesis, begun: Sequence[Mapping[str, float]], starts: Float[Tensor, "W J2"] | None
    ) -> Evaluation | None:
        self.watch(f"fitting {hypothesis}")
        try:
            simulator = build(self.rung.of(self.given), hypothesis, self.runs)
            thetas = torch.stack([theta_of(simulator, values) for values in begun])
            fitted = fit(simulator, self.windows, best_theta(simulator, self.windows, thetas, starts), starts)
            model = LinearModel.of(fitted, self.windows)
            left = tuple(left_out(model, self.windows, folds) for folds in self.partitions)
            return Evaluation(hypothesis, fitted, left)
        except Stopped:
            raise
        except BadInput:
            return None

    def refined(self, here: Evaluation) -> Evaluator:
        """Itself where a fit may be judged as it was integrated, else one that integrates finely enough for it."""
        given = build(self.given, here.hypothesis, self.runs)
        if fine_enough(here.fitted, given, self.windows):
            return self
        rung = cheapest(here.fitted, given, self.windows)
        if rung == self.rung:
            return self
        self.watch(f"integrating by {rung.method} in steps of {rung.timestep:g} s")
        return replace(self, rung=rung, known={})
