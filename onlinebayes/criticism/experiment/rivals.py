"""The hypotheses that the next recording must separate: each possible truth, and the models that could mimic it.

    effects accepted    what was found, and the same with one addition swapped for one that it cannot be told from, or
                        where there is none for the next by score: each against each
    nothing accepted    the base model with one addition, as large as the data leave possible, its other parameters
                        adapted to the present data beside it (:mod:`.adapted`), against the base model

They are evaluations of the search that a criticism made, or are fitted by its evaluator, to the windows of the search:
it will choose such windows again when the recording is there.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.experiment.adapted import adapted
from onlinebayes.criticism.experiment.play import FixedModel
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import contains, laws
from onlinebayes.criticism.hypotheses.ranking import rivals as equals_of
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.criticism.hypotheses.weighing import in_its_place
from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import residual_correlation_time
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.rows import band_counts, band_of, band_squares
from onlinebayes.identification.fitting.theta import theta_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import Addition, build
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.runs import BadInput

MOST_RIVALS = 4
"""Models that are played, each against each."""

NEXT_BY_SCORE = 2
"""So many candidates are rivals of what was found where nothing is tied with it."""

MOST_EXCLUDED = 6
"""So many effects are tried against a model that lacks none."""

CARED_FOR = 0.1
"""Of its largest size: the size of an effect about which the data say nothing."""

AS_IT_IS = "the model as it is"


@dataclass(frozen=True)
class AdaptableModel:
    """A fitted model that may adapt its parameters to what another one would do.

    Args:
        hypothesis: the model at its mode.
        fitted: its fit to the present data.
        windows: of these.
        tau: correlation time of its residual [s].
    """

    hypothesis: FixedModel
    fitted: Fitted
    windows: Windows
    tau: float

    @property
    def left(self) -> Float[Tensor, "W n S"]:
        """Residual in the present data [noise]."""
        return self.fitted.rows.in_noise(self.fitted.rows.residual)

    @property
    def noise(self) -> Float[Tensor, "n S"]:
        """Mean square of what a new recording's bins will differ by for reasons that it does not know [noise^2]."""
        squares, counts = band_squares(self.windows, self.left).sum(0), band_counts(self.windows).sum(0)
        return (squares / counts.clamp_min(1)).clamp_min(1.0)[band_of(self.left.shape[1], squares.device)]


@dataclass(frozen=True)
class Pair:
    """If ``truth`` is true, is ``other`` ruled out?

    Args:
        truth: what is true.
        other: what is to be ruled out.
        added: where ``truth`` is ``other`` with one addition more, which must then be accepted: its size; else None.
    """

    truth: FixedModel
    other: AdaptableModel
    added: Size | None = None


@dataclass(frozen=True)
class Size:
    """Value of an addition's first parameter and the one at which it does nothing [``unit``]."""

    value: float
    neutral: float
    unit: str


@dataclass(frozen=True)
class Rivals:
    """The pairs, and the windows of the present data that all fits share."""

    pairs: tuple[Pair, ...]
    windows: Windows

    @property
    def hypotheses(self) -> tuple[FixedModel, ...]:
        """The hypotheses that may be true, each once, the present model first."""
        every = [h for pair in self.pairs for h in (pair.truth, pair.other.hypothesis)]
        once = {hypothesis.name: hypothesis for hypothesis in every}
        return tuple(sorted(once.values(), key=lambda hypothesis: hypothesis.name != AS_IT_IS))

    @property
    def names(self) -> tuple[tuple[str, str], ...]:
        """Unordered pairs of names, in order of appearance."""
        return tuple(dict.fromkeys(_sorted(pair) for pair in self.pairs))

    def of(self, names: tuple[str, str]) -> tuple[int, ...]:
        """The pairs of these two, one or both ways round."""
        return tuple(k for k, pair in enumerate(self.pairs) if _sorted(pair) == names)


def _sorted(pair: Pair) -> tuple[str, str]:
    first, second = sorted((pair.truth.name, pair.other.hypothesis.name))
    return (second, first) if first == AS_IT_IS else (first, second)


def find_rivals(result: Criticism) -> Rivals:
    """The rivals that a criticism leaves.

    Args:
        result: of ``diagnose`` or ``refine``.

    Raises:
        BadInput: the data have a fault, no candidate is left that could be a rival, or a parameter differs between the
            runs.
    """
    if result.wiring:
        mended = " ".join(result.wiring.lines.split())
        raise BadInput(f"the data have a fault: {result.wiring.fault}", f"put it right first: {mended}")
    explanation = result.explanation
    if explanation is None:
        raise BadInput("the criticism was read from a file", "plan with what diagnose or refine returns")
    if isinstance(explanation.found.fitted.simulator, ScopedSimulator):
        own = ", ".join(explanation.found.fitted.simulator.scope.own)
        raise BadInput(
            f"{own} differs between the runs, and an experiment for such parameters is not planned by this version",
            "plan with runs in which it is the same, or record again",
        )
    searched = explanation.shorter or explanation
    pairs = _swaps(result, explanation, searched) if result.accepted else _excluded(result, searched)
    if not pairs:
        raise BadInput("no other effect is a rival of what was found", "there is nothing to decide: use the model")
    return Rivals(pairs, searched.windows)


def adaptable(evaluation: Evaluation, windows: Windows) -> AdaptableModel:
    """An evaluation as a model that may adapt; its name is what was added."""
    fitted = evaluation.fitted
    name = " + ".join(laws(evaluation.hypothesis)) or AS_IT_IS
    model = FixedModel(name, fitted.simulator, fitted.theta)
    return AdaptableModel(model, fitted, windows, residual_correlation_time(windows, fitted.lin))


def _swaps(result: Criticism, explanation: Explanation, searched: Explanation) -> tuple[Pair, ...]:
    """Pair the found hypothesis and its rivals, each against each.

    Args:
        result, explanation: which rivals are open.
        searched: by whose windows they are fitted.
    """
    kept = searched.found.hypothesis.additions
    entered = [one for one in explanation.rounds if one.added is not None and one.added.addition in kept]
    tied = [one for found in entered for one in _in_place(searched, found, equals_of(found))]
    if not tied and entered:
        tied = _in_place(searched, entered[0], _next_by_score(result, entered[0]))
    models = [adaptable(one, searched.windows) for one in (searched.found, *tied[: MOST_RIVALS - 1])]
    return tuple(Pair(a.hypothesis, b) for a, b in itertools.permutations(models, 2))


def _in_place(explanation: Explanation, found: Round, rivals: tuple[Addition, ...]) -> list[Evaluation]:
    fitted = (in_its_place(explanation, found, rival) for rival in rivals)
    return [one for one in fitted if one is not None and not isinstance(one.fitted.simulator, ScopedSimulator)]


def _next_by_score(result: Criticism, found: Round) -> tuple[Addition, ...]:
    """The candidates that come next; what contains another one could only do as well as that one."""
    assert found.added is not None
    screened = {one.addition.key: one.addition for one in found.screened}
    tried = [screened[row.effect] for row in result.candidates if row.effect in screened]
    free = {row.effect for row in result.candidates if row.rank is not None and not row.accepted}
    every = [*tried, found.added.addition]
    simple = [one for one in tried if one.key in free and not any(contains(one, other) for other in every)]
    return tuple(simple[:NEXT_BY_SCORE])


def _excluded(result: Criticism, searched: Explanation) -> tuple[Pair, ...]:
    """The base model against each addition at the size that the data leave possible."""
    base, evaluator = adaptable(searched.base, searched.windows), searched.evaluator
    screened = {one.addition.key: one.addition for found in searched.rounds for one in found.screened}
    rows = [row for row in result.candidates if row.effect in screened and not row.confounded_with]
    pairs = []
    for row in rows[:MOST_EXCLUDED]:
        pair = _possible(base, searched.base, evaluator, screened[row.effect], row)
        pairs += [] if pair is None else [pair]
    return tuple(pairs)


def _possible(
    base: AdaptableModel, evaluation: Evaluation, evaluator: Evaluator, addition: Addition, row: Candidate
) -> Pair | None:
    """The base model with an addition at its exclusion limit; at a tenth of what its bounds allow where there is none.

    None where it has a size in every run.
    """
    way = evaluator.discretisation.values.of(evaluator.given)
    model = build(way, evaluation.hypothesis.plus(addition), evaluator.runs)
    known = evaluation.values
    start = addition.starts(model, known)[0]
    if isinstance(model, ScopedSimulator) or len(start.sized) > 1:
        return None
    reach = start.reach * (start.high if start.high > 0 else start.low)
    limit = row.exclusion_limit
    size = CARED_FOR * abs(reach) if limit is None or not math.isfinite(limit) else min(limit, abs(reach))
    (entry,) = start.sized
    value = start.neutral + math.copysign(size, reach)
    values = {**start.values, entry: value}
    begin = theta_of(model, {**known, **values})
    free = torch.tensor([name not in values for name in model.parameters.names])
    theta = adapted(model, base.windows, begin, free, base.fitted)
    added = Size(value, start.neutral, model.parameters[entry].unit)
    name = f"{addition.key} = {added.value:.3g} {added.unit}".rstrip()
    return Pair(FixedModel(name, model, theta), base, added)
