"""A hypothesis fitted, and judged by what it predicts of data that were left out.

    evaluation = f(hypothesis, where its fit may begin; model, windows, integration)

An evaluation is a value: it depends on nothing that was evaluated before, so that many run side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.discretisation import Discretisation, cheapest, fine_enough
from onlinebayes.identification.fitting.gauss_newton import MOST_STEPS, SETTLED, Fitted, best_theta, fit, weighed
from onlinebayes.identification.fitting.sensitivities import Linearisation
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.judging.hypothesis import Hypothesis, build
from onlinebayes.identification.judging.rule import refusal
from onlinebayes.identification.judging.scoring import Folds, Gain, LeftOut, LinearModel, gain, left_out, partitions
from onlinebayes.runs import BadInput, Kept, Memo, NoMemo, Stopped, remembered, side_by_side
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


@dataclass(frozen=True, eq=False)
class FitRequest:
    """A request for a fit: the hypothesis, and the values from which the fit begins.

    Args:
        hypothesis: what is fitted.
        begun: values by name from which the fit may begin, nominal ones for those that are missing [SI].
        starts: where the windows' starts begin; the smoothed ones when None.
        models: values of simpler models, each of which may stand beside ``begun`` [SI].
        most: steps of the fit; 0 to judge it where it begins.
        wanted: a score; a fit that would not come down to it is given up.
    """

    hypothesis: Hypothesis
    begun: Sequence[Mapping[str, float]]
    starts: Float[Tensor, "W J2"] | None = None
    models: Sequence[Mapping[str, float]] = ({},)
    most: int = MOST_STEPS
    wanted: float = math.inf


def better(new: Evaluation | None, known: Evaluation | None) -> Evaluation | None:
    """The better one of two fits of a hypothesis; the known one where they are alike."""
    if new is None or known is None:
        return known if new is None else new
    return new if new.fitted.score < known.fitted.score - SETTLED else known


def refused(new: Evaluation, old: Evaluation, base: Evaluation) -> str | None:
    """Say why the rule does not prefer a hypothesis to a simpler one; None where it does.

    Args:
        new, old: the two.
        base: the base model, over which the old one has gained something already.
    """
    return refusal(new.gains(old), old.gains(base)[0], noise_left=at_noise_floor(new))


def at_noise_floor(here: Evaluation) -> bool:
    """Check whether no more than noise is left."""
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
        original_integrator: whether the log follows the model's own step: no finer one is looked for then.
        memo: keeps fits for the next command.
        parted: the windows that are parted into folds, where ``windows`` are those of them that another table has.
    """

    given: Identifiable
    windows: Windows
    runs: tuple[str, ...]
    discretisation: Discretisation
    watch: Callable[[str], None] = lambda _: None
    original_integrator: bool = False
    parted: Windows | None = None
    memo: Memo = field(default_factory=NoMemo)

    def __post_init__(self) -> None:
        own = partitions(self.windows if self.parted is None else self.parted)
        self.partitions: tuple[Folds, ...] = tuple(folds.over(self.windows) for folds in own)

    def of_table(self, given: Identifiable, windows: Windows) -> Evaluator:
        """One for another table of the same runs; what it says can be compared, for it leaves the same data out.

        Args:
            given: the model of that table.
            windows: of that table, among this one's.
        """
        return replace(self, given=given, windows=windows, parted=self.parted or self.windows)

    def evaluate(self, wanted: FitRequest) -> Evaluation | None:
        """A fit and what it predicts; None where the simulator cannot carry or follow it."""
        self.watch(f"fitting {wanted.hypothesis}")
        ways = self.discretisation
        try:
            simulator, rough = (
                build(way.of(self.given), wanted.hypothesis, self.runs) for way in (ways.values, ways.derivatives)
            )
        except BadInput:
            return None
        fitted = remembered(
            self.memo,
            ("fit", *self.context, *vars(wanted).values()),
            partial(self._fitted, simulator, rough, wanted),
            lambda found: Kept({}) if found is None else found.lin.kept,
            lambda kept: weighed(simulator, rough, self.windows, Linearisation.of(kept)) if kept.tensors else None,
        )
        if fitted is None:
            return None
        model = LinearModel.of(fitted)
        left = tuple(left_out(model, self.windows, one) for one in self.partitions)
        return Evaluation(wanted.hypothesis, fitted, left)

    @property
    def context(self) -> tuple[object, ...]:
        """Everything that its fits depend on besides the request."""
        return self.given, self.windows, self.runs, self.discretisation

    def evaluate_all(self, fits: Sequence[FitRequest]) -> list[Evaluation | None]:
        """The same of several, side by side."""
        return side_by_side([partial(self.evaluate, one) for one in fits])

    def _fitted(self, simulator: Identifiable, rough: Identifiable, wanted: FitRequest) -> Fitted | None:
        try:
            each = [[theta_of(simulator, {**one, **values}) for one in wanted.models] for values in wanted.begun]
            thetas = torch.stack([torch.stack(group) for group in each])
            theta = best_theta(simulator, rough, self.windows, thetas, wanted.starts)
            return fit(
                simulator, self.windows, theta, wanted.starts, rough=rough, most=wanted.most, wanted=wanted.wanted
            )
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
        self.watch(f"integrating by {way.told} in steps of {way.timestep:g} s")
        return replace(self, discretisation=discretisation)

    def anew(self, here: Evaluation) -> Evaluation | None:
        """A hypothesis that was integrated otherwise, from where it ended; None as in :meth:`evaluate`."""
        return self.evaluate(FitRequest(here.hypothesis, [here.values], here.fitted.lin.starts))
