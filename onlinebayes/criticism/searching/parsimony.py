"""Fewer laws that explain as much: an equal of an accepted one that makes another one needless.

    delay, constant load, centre of mass lower   ->   delay, spring with a rest position

A law is chosen from those that the data do not part by its number of parameters, one at a time. A load and a lower
centre of mass are a parameter each; the spring that does the same has two, and is found only where all are looked at
together. In the end each accepted law is therefore exchanged for its equals of that round, without one of the others:
what leaves noise, has no more parameters and predicts as well (the rules of :mod:`.backward_elimination`) is the
simpler account.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import Judged, contained
from onlinebayes.criticism.judging.score import cross_validate, parted
from onlinebayes.criticism.searching.backward_elimination import needed
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import Added, Stage, blocks_for, leaves_noise
from onlinebayes.criticism.searching.working_model import WorkingModel, carry_theta
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.runs import BadInput

MOST_EQUALS = 2  # of an effect, by gain
HOPELESS = 2.0  # times the squared error of the model as it stands, which leaves noise


def simplify(working: WorkingModel, context: SearchContext) -> WorkingModel:
    """The model with fewer effects that explains as much; itself where there is none.

    Args:
        working: a model that leaves noise.
        context: of the search; its watch is looked at between the fits, and the model as it is then stands.
    """
    while len(working.accepted) > 1:
        leaner = _with_one_less(working, context)
        if leaner is None:
            break
        working = leaner
    return working


def _with_one_less(working: WorkingModel, context: SearchContext) -> WorkingModel | None:
    selection = context.selection
    current, windows = working.grounds, working.grounds.windows
    blocks = blocks_for(current.fitted, windows, selection.folds)
    present = cross_validate(current.fitted, windows, blocks)
    for kept, (stage, rival) in _accounts(working):
        if context.watch.stopped:
            break
        context.watch.say(f"looking whether {rival.effect.key} explains more than one of the effects")
        fitted = _fitted(working, kept, rival)
        if fitted is None or not leaves_noise(fitted, windows, selection.tolerance):
            continue
        if needed(present, cross_validate(fitted, windows, blocks), windows.bin_step):
            continue
        model = grown(working.simulator, [*(judged.effect for _, judged in kept), rival.effect])
        grounds = settle(model, context.measurement, selection.horizon_s, windows.noise, fitted.theta, current, fitted)
        return replace(working, grounds=grounds, accepted=(*kept, (stage, rival)))
    return None


def _accounts(working: WorkingModel) -> Iterator[tuple[Sequence[Added], Added]]:
    """What would be left, and what would take the place of two."""
    accepted = working.accepted
    for k, (stage, judged) in enumerate(accepted):
        others = [*accepted[:k], *accepted[k + 1 :]]
        for rival in _equals(working, stage, judged):
            for j in range(len(others)):
                yield [*others[:j], *others[j + 1 :]], (stage, rival)


def _equals(working: WorkingModel, stage: Stage, judged: Judged) -> list[Judged]:
    """The best of its round that might have been accepted in an effect's place."""
    step = stage.windows.bin_step
    present = {effect.key for effect in working.effects}
    found = [
        rival
        for rival in stage.judged
        if rival.admissible and not {rival.effect.key, *contained(rival.effect)} & present
        if not parted(judged.scores, rival.scores, step)
    ]
    return sorted(found, key=lambda rival: -rival.gain.gain)[:MOST_EQUALS]


def _fitted(working: WorkingModel, kept: Sequence[Added], rival: Judged) -> Fit | None:
    """The model with what is kept and the rival; None where it has more parameters, or diverges."""
    current = working.grounds
    model = current.rung.of(grown(working.simulator, [*(judged.effect for _, judged in kept), rival.effect]))
    if len(model.parameters) > len(current.fitted.theta):
        return None
    theta = carry_theta(current.fitted.simulator, current.fitted.theta, model)
    own = dict(zip(rival.fitted.simulator.parameters, rival.fitted.theta.unbind(), strict=True))
    for name in effect_entries(model, rival.effect).keys() & own.keys():
        theta[model.parameters.index(name)] = own[name]
    hopeless = HOPELESS * current.fitted.projected.objective
    try:
        return fit(model, current.windows, theta, starts=current.fitted.lin.starts, hopeless=hopeless)
    except BadInput:
        return None
