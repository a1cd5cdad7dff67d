"""The zeros of position sensors, which nobody sets exactly: rivals of every effect that a small zero error looks like.

    y = q + b,   abs(b) <= 20 floors of the signal          (5.8 counts of an encoder: 20 / sqrt(12))

Where gravity or a spring tells the position, a zero error of half a milliradian acts as a constant load does. Before
an effect is added, the bias of each position signal that promises a third of what the effect gives is refitted and
judged in its place, among the candidates or not. What predicts best enters, as everywhere; what is not parted from it
is a tie.
A zero error that would have to be larger than the bound is none, and its rival stands alone.
"""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import Stage, judged_stage
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.identification.results import Numerics
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import SensorBias

LARGEST_ZERO_FLOORS = 20.0
"""A zero error is at most so many floors of its signal, as much as a window's start may be off its smoothed one."""

LEAST_SHARE_OF_FALL = 0.3
"""A zero error that promises this share of what the effect gives is refitted."""

AT_BOUND = 1e-3
"""A value within this share of the bound lies on it."""


def judge_zero_errors(stage: Stage, best: Judged, numerics: Numerics, context: SearchContext) -> Stage:
    """The round with the zero errors judged that could stand in the place of its best effect.

    Args:
        stage: the round.
        best: its admissible effect that would be added.
        numerics, context: as of that round.
    """
    known = {judged.effect.key for judged in stage.judged}
    biases = [bias for bias in zero_errors(stage.current, stage.windows) if bias.key not in known]
    if best.effect.name == SensorBias.name or not biases:
        return stage
    found = survey(stage.current, stage.windows, biases, context.selection.folds)
    rivals = [s for s in found.screened if s.p_value is not None and s.promise >= LEAST_SHARE_OF_FALL * best.falls[0]]
    # All of them: the effect would enter before a rival that was left out.
    judged = judged_stage(found, rivals, numerics, context.selection, context.watch.unstoppable).judged
    return replace(stage, judged=(*stage.judged, *(one for one in judged if _inside(one))))


def zero_errors(current: Fit, windows: Windows) -> list[SensorBias]:
    """A bias within the bound for each measured position that has none in the model."""
    present = {effect.key for effect in current.simulator.effects}
    targets = set(current.simulator.targets("signal"))
    found = []
    for column, floor in zip(windows.columns, windows.noise.tolist(), strict=True):
        name = current.simulator.signals[column]
        unit = "m" if current.simulator.joint_kinds.get(name.partition(".")[2]) == "slide" else "rad"
        bias = SensorBias(name, Parameter(-LARGEST_ZERO_FLOORS * floor, LARGEST_ZERO_FLOORS * floor, unit))
        if name.startswith("qpos.") and name in targets and bias.key not in present:
            found.append(bias)
    return found


def _inside(judged: Judged) -> bool:
    """Whether the zero error that the data ask for, in each run that has its own, is smaller than the bound."""
    space, bound = judged.fitted.simulator.parameters, judged.effect.parameters["bias"].high
    entries = effect_entries(judged.fitted.simulator, judged.effect)
    return all(abs(float(judged.fitted.theta[space.index(entry)])) < (1 - AT_BOUND) * bound for entry in entries)
