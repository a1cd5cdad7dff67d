"""The hypotheses that the next recording must separate: each possible truth, and the models that could mimic it.

    effects accepted    the final model, and the same with an accepted effect swapped for one that it cannot be told
                        from, or where there is none for the next by score: each against each
    nothing accepted    the base model with one effect, as large as the data leave possible, its other parameters
                        adapted to the present data beside it (:mod:`.adapted`), against the base model

What the present data say about a model's parameters goes with it:

    I = (Delta / tau) C~' C~,     C~ the start-projected sensitivities of the present fit, in units of its residual
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import grown, propose, trials
from onlinebayes.criticism.experiment.adapted import adapted
from onlinebayes.criticism.experiment.play import FixedModel
from onlinebayes.criticism.results import Candidate, Criticism
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit, fit, residual_correlation_time
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.fitting.projection import Projected, project, signal_rms
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.replaying.clock import in_step
from onlinebayes.identification.replaying.scoped import with_effect_values
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

MOST_RIVALS = 4
MOST_EXCLUDED = 6
CARED_FOR = 0.1  # of the largest force in play: the size of an effect about which the data say nothing
AS_IT_IS = "the model as it is"


@dataclass(frozen=True)
class AdaptableModel:
    """A fitted model that may adapt its parameters to what another one would do.

    Args:
        hypothesis: the model at its mode.
        fitted: its fit to the present data.
        information: what those say about theta, I [1 / SI^2].
        tau: correlation time of its residual [s].
    """

    hypothesis: FixedModel
    fitted: Fit
    information: Float[Tensor, "P P"]
    tau: float

    @property
    def weight(self) -> Float[Tensor, " S"]:
        """Noise over the residual of each signal, at most 1."""
        return self.fitted.projected.weight


@dataclass(frozen=True)
class Pair:
    """If ``truth`` is true, is ``other`` ruled out?

    Args:
        truth: what is true.
        other: what is to be ruled out.
        added: where ``truth`` is ``other`` with one effect more, which must then be accepted: its size; else None.
    """

    truth: FixedModel
    other: AdaptableModel
    added: Size | None = None


@dataclass(frozen=True)
class Size:
    """Value of an effect's first parameter and the one at which it does nothing [``unit``]."""

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
        """All that may be true, each once, the present model first."""
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


def find_rivals(
    result: Criticism,
    simulator: Identifiable,
    measurement: Measurement,
    candidates: str | Sequence[str | Effect],
) -> Rivals:
    """The rivals that a criticism leaves.

    Args:
        result: of ``diagnose`` or ``refine``.
        simulator: the base model that was criticised.
        measurement: the runs that it was fitted on.
        candidates: which effects were tried.

    Raises:
        BadInput: the data have a fault, no effect is left that could be a rival, or a parameter differs between the
            runs.
    """
    if result.wiring:
        mended = " ".join(result.wiring.lines.split())
        raise BadInput(f"the data have a fault: {result.wiring.fault}", f"put it right first: {mended}")
    if result.changes:
        raise BadInput(
            f"{', '.join(change.parameter for change in result.changes)} differs between the runs, and an experiment "
            "for such parameters is not planned by this version",
            "plan with runs in which it is the same, or record again",
        )
    simulator = in_step(simulator, measurement)
    for name, wide in result.widened.items():
        low, high = wide.after
        simulator = simulator.with_bounds(name, replace(simulator.parameters[name], low=low, high=high))
    accepted = [effect for effect in result.final.simulator.effects if effect.key in result.accepted]
    model = grown(simulator, accepted)
    noise = torch.tensor([result.sensor_sd[signal] for signal in result.signals]).to(result.final.theta)
    begin = theta_of(model, values_of(result.final.simulator, result.final.theta))
    grounds = settle(model, measurement, result.selection.horizon_s, noise, begin)
    stepped = grounds.rung.of(simulator)
    found = {effect.key: effect for effect in propose(stepped, grounds.windows, candidates)}
    # Zeros of sensors are tried in an effect's place without being candidates.
    tied = {key for row in result.candidates if row.accepted for key in row.indistinguishable_from} - set(found)
    found |= {effect.key: effect for effect in propose(stepped, grounds.windows, sorted(tied))} if tied else {}
    name = " + ".join(result.accepted) or AS_IT_IS
    final = explanation(name, grounds.fitted, grounds.windows)
    pairs = (
        _swaps(result, simulator, grounds, final, accepted, found)
        if accepted
        else _excluded(result, grounds, final, found)
    )
    if not pairs:
        raise BadInput("no other effect is a rival of what was found", "there is nothing to decide: use the model")
    return Rivals(pairs, grounds.windows)


def explanation(name: str, fitted: Fit, windows: Windows) -> AdaptableModel:
    """A fit with what it knows, each signal weighed by its residual."""
    weight = _refreshed_weight(windows, fitted)
    fitted = fit(fitted.simulator, windows, fitted.theta, weight, fitted.lin.starts)
    long = fitted.projected
    correlation = residual_correlation_time(fitted, windows)
    share = windows.bin_step / correlation
    C = long.columns.flatten(0, 1)
    return AdaptableModel(FixedModel(name, fitted.simulator, fitted.theta), fitted, share * (C.T @ C), correlation)


def _swaps(
    result: Criticism,
    simulator: Identifiable,
    grounds: Grounds,
    final: AdaptableModel,
    accepted: Sequence[Effect],
    found: dict[str, Effect],
) -> tuple[Pair, ...]:
    rows = {candidate.effect: candidate for candidate in result.candidates}
    swaps = [(k, other) for k, effect in enumerate(accepted) for other in rows[effect.key].indistinguishable_from]
    if not swaps:
        # What contains another candidate could only do as well as that one.
        others = [
            c.effect
            for c in result.candidates
            if c.rank is not None
            and not c.accepted
            and not (c.effect in found and _contained(found[c.effect]) & set(rows))
        ]
        swaps = [(0, other) for other in others[:2]]
    models = [final]
    for k, other in swaps[: MOST_RIVALS - 1]:
        if other not in found:
            continue
        kept = [effect for effect in accepted if effect is not accepted[k]]
        fitted = _fitted(simulator, grounds, final, kept, found[other])
        if fitted is not None:
            names = [found[other].key if j == k else effect.key for j, effect in enumerate(accepted)]
            models.append(explanation(" + ".join(names), fitted, grounds.windows))
    return tuple(Pair(a.hypothesis, b) for a, b in itertools.permutations(models, 2))


def _contained(effect: Effect) -> set[str]:
    """Keys of the simpler effects that this one becomes for some of its values."""
    return {f"{name}@{effect.element}" for name in effect.contains}


def _fitted(
    simulator: Identifiable, grounds: Grounds, final: AdaptableModel, kept: Sequence[Effect], effect: Effect
) -> Fit | None:
    """The best of the fits from each point where screening would try the effect; None where all diverge."""
    model = grounds.rung.of(grown(simulator, [*kept, effect]))
    theta = theta_of(model, values_of(final.hypothesis.simulator, final.hypothesis.theta))
    fits = []
    for trial in trials([effect]):
        begin = with_effect_values(model, theta, effect, trial.values)
        try:
            fits.append(fit(model, grounds.windows, begin, final.weight, final.fitted.lin.starts))
        except BadInput:
            continue
    return min(fits, key=lambda fitted: fitted.projected.objective, default=None)


def _excluded(result: Criticism, grounds: Grounds, base: AdaptableModel, found: dict[str, Effect]) -> tuple[Pair, ...]:
    """The base model against each effect at the size that the data leave possible."""
    open_ = [c for c in result.candidates if c.effect in found and not c.confounded_with]
    pairs = []
    for candidate in open_[:MOST_EXCLUDED]:
        effect = found[candidate.effect]
        values = _possible(effect, candidate)
        model = grown(grounds.fitted.simulator, [effect])
        begin = torch.cat([base.hypothesis.theta, base.hypothesis.theta.new_tensor(values)])
        free = len(base.hypothesis.theta)
        theta = adapted(model, grounds.windows, begin, free, base.fitted.lin.starts, base.weight)
        added = Size(values[0], effect.neutral[effect.magnitude], effect.parameters[effect.magnitude].unit)
        name = f"{effect.key} = {added.value:.3g} {added.unit}".rstrip()
        pairs.append(Pair(FixedModel(name, model, theta), base, added))
    return tuple(pairs)


def _possible(effect: Effect, candidate: Candidate) -> list[float]:
    """The effect's parameters at its exclusion limit; at a tenth of what its bounds allow where there is none."""
    first = effect.magnitude
    bounds, neutral = effect.parameters[first], effect.neutral[first]
    reach = bounds.high - neutral if bounds.high > neutral else bounds.low - neutral
    limit = candidate.exclusion_limit
    size = CARED_FOR * abs(reach) if limit is None or not math.isfinite(limit) else min(limit, abs(reach))
    values = {**effect.neutral, **(effect.starts[0] if effect.starts else {})}
    values[first] = neutral + math.copysign(size, reach)
    return [values[name] for name in effect.parameters]


def rows_of(projected: Projected, index: Tensor) -> tuple[Tensor, Tensor]:
    """Residual and columns of some windows as one vector and one matrix."""
    return projected.residual[index].flatten(), projected.columns[index].flatten(0, 1)


def _refreshed_weight(windows: Windows, fitted: Fit) -> Float[Tensor, " S"]:
    """Each signal's weight for the next fit: noise / max(RMS of the current residual, noise)."""
    return 1 / signal_rms(project(windows, fitted.lin)).clamp_min(1.0)
