"""A hypothesis fitted, and judged by what it predicts of data that were left out; the best fit is kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.discretisation import Discretisation, cheapest, fine_enough
from onlinebayes.identification.fitting.gauss_newton import MOST_STEPS, SETTLED, Fitted, best_theta, fit
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.judging.hypothesis import Hypothesis, build
from onlinebayes.identification.judging.scoring import Folds, Gain, LeftOut, LinearModel, gain, left_out, partitions
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable

FIRST_STEPS = 4
"""Of a fit, after which what gains nothing is given up where many are tried."""

AT_FLOOR = 1.2
"""Floors: no more is left than noise."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A hypothesis, its fit, and the squares of what was left out, for each way of leaving data out."""

    hypothesis: Hypothesis
    fitted: Fitted
    left_out: tuple[LeftOut, ...]

    @property
    def values(self) -> dict[str, float]:
        """The fitted parameters by name [SI]."""
        return values_of(self.fitted.simulator, self.fitted.theta)

    def gains(self, other: Evaluation) -> tuple[Gain, ...]:
        """Over another hypothesis, for each way of leaving data out."""
        return tuple(gain(a, b) for a, b in zip(self.left_out, other.left_out, strict=True))


def at_noise_floor(here: Evaluation) -> bool:
    """Whether no more than noise is left."""
    return float(here.left_out[0].rms.max()) <= AT_FLOOR


@dataclass
class Evaluator:
    """Fits hypotheses to one set of windows, integrated in one way.

    Args:
        given: the base model at its own step.
        windows: the data.
        runs: names of the fit runs.
        discretisation: how models are integrated.
        watch: told what is being done.
        known: evaluations so far.
        original_integrator: whether the log follows the model's own step: no finer one is looked for then.
        parted: the windows that are parted into folds, where ``windows`` are those of them that another table has.
    """

    given: Identifiable
    windows: Windows
    runs: tuple[str, ...]
    discretisation: Discretisation
    watch: Callable[[str], None] = lambda _: None
    known: dict[frozenset[str], Evaluation | None] = field(default_factory=dict)
    original_integrator: bool = False
    parted: Windows | None = None

    def __post_init__(self) -> None:
        own = partitions(self.windows if self.parted is None else self.parted)
        self.partitions: tuple[Folds, ...] = tuple(folds.over(self.windows) for folds in own)

    def of_table(self, given: Identifiable, windows: Windows) -> Evaluator:
        """One for another table of the same runs; what it says can be compared, for it leaves the same data out.

        Args:
            given: the model of that table.
            windows: of that table, among this one's.
        """
        return replace(self, given=given, windows=windows, known={}, parted=self.parted or self.windows)

    def evaluate(
        self,
        hypothesis: Hypothesis,
        begun: Sequence[Mapping[str, float]],
        starts: Float[Tensor, "W J2"] | None = None,
        *,
        models: Sequence[Mapping[str, float]] = ({},),
        most: int = MOST_STEPS,
        wanted: float = math.inf,
    ) -> Evaluation | None:
        """The best fit of the hypothesis so far, after one more from the best of some values.

        Args:
            hypothesis: what is fitted.
            begun: values by name from which the fit may begin, nominal ones for those that are missing [SI].
            models: values of simpler models, each of which may stand beside ``begun`` [SI].
            starts: where the windows' starts begin; the smoothed ones when None.
            most: steps of the fit; 0 to judge it where it begins.
            wanted: a score; a fit that would not come down to it is given up.

        Returns:
            None where the simulator cannot carry or follow it.
        """
        key = frozenset(hypothesis.keys)
        known, found = self.known.get(key), self._fitted(hypothesis, begun, models, starts, most, wanted)
        if known is None or (found is not None and found.fitted.score < known.fitted.score - SETTLED):
            self.known[key] = found
        return self.known[key]

    def _fitted(
        self,
        hypothesis: Hypothesis,
        begun: Sequence[Mapping[str, float]],
        models: Sequence[Mapping[str, float]],
        starts: Float[Tensor, "W J2"] | None,
        most: int,
        wanted: float,
    ) -> Evaluation | None:
        self.watch(f"fitting {hypothesis}")
        try:
            ways = self.discretisation
            simulator = build(ways.values.of(self.given), hypothesis, self.runs)
            rough = build(ways.derivatives.of(self.given), hypothesis, self.runs)
            each = [torch.stack([theta_of(simulator, {**one, **values}) for one in models]) for values in begun]
            theta = best_theta(simulator, rough, self.windows, torch.stack(each), starts)
            fitted = fit(simulator, self.windows, theta, starts, rough=rough, most=most, wanted=wanted)
            model = LinearModel.of(fitted)
            left = tuple(left_out(model, self.windows, folds) for folds in self.partitions)
            return Evaluation(hypothesis, fitted, left)
        except Stopped:
            raise
        except BadInput:
            return None

    def refined(self, here: Evaluation) -> Evaluator:
        """Itself where a fit may be judged as it was integrated, else one that integrates finely enough for it."""
        given = build(self.given, here.hypothesis, self.runs)
        if self.original_integrator or fine_enough(here.fitted, given, self.windows):
            return self
        discretisation = cheapest(here.fitted, given, self.windows)
        if discretisation == self.discretisation:
            return self
        way = discretisation.values
        self.watch(f"integrating by {way.method} in steps of {way.timestep:g} s")
        return replace(self, discretisation=discretisation, known={})

    def anew(self, here: Evaluation) -> Evaluation | None:
        """A hypothesis that was integrated otherwise, from where it ended; None as in :meth:`evaluate`."""
        return self.evaluate(here.hypothesis, [here.values], here.fitted.lin.starts)
