"""The order of the questions: is it the wiring, is it an effect, is it the wiring after all.

    base model -> faults screened -> (one that is overwhelming: fitted; a late column; a sudden misfit: an outage)
               -> search -> (misfit left: faults fitted, outages looked for)

Faults are screened by replays alone, which costs little. Their fits cost as much as an effect's, so that they wait for
the search: where effects leave nothing but noise, no fault can leave less. A fault whose replay leaves less than half
of the error goes first, for effects that mimic it (a load for a weight that is carried) might reach the noise too. So
does one joint's column that is late by whole rows and leaves nothing but noise, and an outage where few windows err
thirty times as much as the others: no law is that sudden. Sensor delays beside other misfits, and a zero that is off by
a tenth of a radian, are looked at as faults once effects explain them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.judging.localise import in_a_sentence
from onlinebayes.criticism.judging.verdict import left_over
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import SearchResult, ground, search
from onlinebayes.criticism.wiring.faults import Fault, misplaced
from onlinebayes.criticism.wiring.late_columns import is_the_logs, late_column
from onlinebayes.criticism.wiring.shifts import late
from onlinebayes.criticism.wiring.wiring import Leads, Suspicion, fit_faults, outages, screen_faults
from onlinebayes.identification.fitting.first_answer import first_answer
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.replaying.measured_starts import delays
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.runs import UNWATCHED, Watch
from onlinebayes.simulators.effects import ActuatorDelay, SensorBias, SensorDelay
from onlinebayes.simulators.identifiable import Identifiable

MOST_LATE = 4
"""So many signals are tried as late in an actuator's place."""

TWICE_AS_GOOD = 0.5
"""Share of the error of actuators' delays that a late log may leave, as the two are much alike."""


def first_fit(simulator: Identifiable, measurement: Measurement, selection: Selection, watch: Watch) -> Grounds:
    """The base model fitted, the first answer said before; arguments as :func:`suspect`.

    Raises:
        Stopped: it was interrupted before the base model was fitted.
    """
    if first := first_answer(simulator, measurement, selection):
        watch.say(first)
    watch.say("fitting the base model")
    return ground(simulator, measurement, selection)


def suspect(
    base: Grounds,
    simulator: Identifiable,
    measurement: Measurement,
    selection: Selection,
    watch: Watch = UNWATCHED,
) -> Suspicion | None:
    """The wiring fault that explains the base model's misfit, if one does, no effect having been tried.

    Args:
        base: the base model fitted to the measurement as it stands.
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how faults are judged.
        watch: takes one line of progress.
    """
    leads = screen_faults(base, simulator, measurement, selection, watch)
    return leads.explain(selection) if leads is not None else None


def inquire(
    simulator: Identifiable, context: SearchContext, most: int, base: Grounds | None = None
) -> tuple[SearchResult, Suspicion | None]:
    """What the search found, and the wiring fault that explains more than that, if there is one.

    Arguments as :func:`onlinebayes.criticism.searching.search.search`. With a fault nothing is accepted and no
    bound widened: the final model is the base model. A question that is stopped stays without an answer.

    Raises:
        Stopped: it was interrupted before the base model was fitted.
    """
    measurement, selection, watch = context.measurement, context.selection, context.watch
    if base is None:
        with watch.heeded():
            base = first_fit(simulator, measurement, selection, watch)
    wiring = _Wiring(base, simulator, context, None)
    with watch.giving_up():
        if bool(base.windows.observed.any()):
            units = {signal.name: signal.unit for signal in measurement.signals}
            watch.say(in_a_sentence(base.fitted, base.windows, units, left_over(base)))
        wiring = replace(wiring, leads=screen_faults(base, simulator, measurement, selection, watch))
        if (fault := wiring.beyond_doubt) is not None:
            return SearchResult(base, base), fault
    found = search(simulator, context, most, base)
    with watch.giving_up():
        fault, share = wiring.beside(found)
        if fault is not None and fault.beats(found.final, selection, share):
            return replace(found, final=base, accepted=(), widened=None, changes=()), fault
    return replace(found, interrupted=watch.stopped), None


@dataclass(frozen=True)
class _Wiring:
    """The questions about the wiring, each asked at most once.

    Args:
        base: the base model fitted to the measurement as it stands.
        simulator, context: as in :func:`inquire`.
        leads: faults that were screened in; None where the base model errs by too little.
    """

    base: Grounds
    simulator: Identifiable
    context: SearchContext
    leads: Leads | None

    @cached_property
    def fault(self) -> Suspicion | None:
        """The screened fault that explains the misfit."""
        return None if self.leads is None else self.leads.explain(self.context.selection)

    @cached_property
    def late(self) -> Suspicion | None:
        """One joint's signals that were logged late."""
        lead = None if self.leads is None else late_column(self.leads.bench)
        if self.leads is None or lead is None:
            return None
        found = self._explained([lead])
        if found is None or not found.certain:
            return None
        finer = replace(self.leads.bench, rung=found.grounds.rung)
        return found if is_the_logs(finer, lead[0], found.grounds.fitted.theta) else None

    @cached_property
    def outage(self) -> Suspicion | None:
        """Actuators that were off for parts of runs."""
        context = self.context
        return outages(self.base, self.simulator, context.measurement, context.selection, context.watch)

    @property
    def beyond_doubt(self) -> Suspicion | None:
        """A fault that leaves so little that no effect needs to be tried."""
        if self.leads is None:
            return None
        if self.leads.overwhelming and self.fault is not None and self.fault.certain:
            return self.fault
        if self.late is not None:
            return self.late
        return self.outage if self.leads.sudden and self.outage is not None and self.outage.decisive else None

    def beside(self, found: SearchResult) -> tuple[Suspicion | None, float]:
        """The fault that may explain more than what was found, and what share of its error it must not exceed."""
        room = self.leads is not None and not found.interrupted
        structured = room and _structured(found.final, self.context.selection)
        # A gear beyond its bounds may be a command in another unit, and that needs no bound to be wrong.
        asked = structured or (room and found.widened is not None)
        fault = self.fault if asked or (self.leads is not None and self.leads.overwhelming) else None
        log, share = self._of_the_log(found) if fault is None else (None, 1.0)
        certain = next((one for one in (fault, log) if one is not None and one.certain), None)
        if structured and certain is None:  # an outage takes longest to find
            either = [one for one in (fault, self.outage) if one is not None]
            fault = min(either, key=lambda one: one.after, default=None)
        return (fault, 1.0) if fault is not None else (log, share)

    def _of_the_log(self, found: SearchResult) -> tuple[Suspicion | None, float]:
        """What the log may have done where effects explain it, and what share of their error it must not exceed."""
        context = self.context
        log, share = _faults_of_the_log(self.simulator, found, context.measurement, context.selection)
        if not log:
            return None, 1.0
        return self._explained([(fault, self.base.fitted.theta) for fault in log]), share

    def _explained(self, leads: Sequence[tuple[Fault, Float[Tensor, " P"]]]) -> Suspicion | None:
        """What the best of these faults explains, each begun at its theta [SI]."""
        return fit_faults(leads, self.base, self.simulator, self.context.measurement, self.context.selection)


def _faults_of_the_log(
    simulator: Identifiable, found: SearchResult, measurement: Measurement, selection: Selection
) -> tuple[list[Fault], float]:
    """What the accepted effects may be if the log is to blame, and what share of their error it must not exceed.

    Signals that are some rows late, or a misplaced zero. Delays of actuators that leave more than noise may be the log
    of a joint at which most is left; as the two are much alike, the log has to do twice as well.
    """
    left = left_over(found.final)
    worst = sorted((name for name in left if left[name] > selection.tolerance), key=lambda name: -left[name])
    tried: list[Fault | None] = [misplaced(_zeros(simulator, found, measurement, selection))]
    share = 1.0
    if late_by := _delays(found, SensorDelay):
        tried.append(late(measurement, late_by, bool(worst)))
    elif late_by := _delays(found, ActuatorDelay):
        tried += [late(measurement, {name: max(late_by.values())}, loosely=True) for name in worst[:MOST_LATE]]
        share = TWICE_AS_GOOD
    return list(dict.fromkeys(fault for fault in tried if fault is not None)), share


def _delays(found: SearchResult, kind: type[SensorDelay] | type[ActuatorDelay]) -> dict[str, float]:
    """Target -> the delay [s] that was accepted for it; nothing where any effect of another kind was accepted too."""
    if not all(isinstance(judged.effect, kind) for _, judged in found.accepted):
        return {}
    return delays(found.final.fitted.simulator, found.final.fitted.theta, kind)


def _zeros(
    simulator: Identifiable, found: SearchResult, measurement: Measurement, selection: Selection
) -> dict[str, float]:
    """Position of a hinge -> the offset [rad] by which one effect, the only one accepted or its rival, reads it.

    As fitted on the final model's rung: where it was judged, a cheaper method may have left it some floors off.
    """
    if len(found.accepted) != 1:
        return {}
    ((stage, first),) = found.accepted
    offsets = {}
    for judged in stage.judged:
        address = f"{judged.effect.key}.bias"
        told = isinstance(judged.effect, SensorBias) and (judged.admissible or judged is first)
        if (
            not told
            or judged.effect.parameters["bias"].unit != "rad"
            or address not in judged.fitted.simulator.parameters
        ):
            continue
        final, fitted = found.final, judged.fitted
        if judged is first:
            fitted = final.fitted
        elif stage.windows is not final.windows:
            model, noise = simulator.with_effect(judged.effect), final.windows.noise
            fitted = settle(model, measurement, selection.horizon_s, noise, fitted.theta, before=final).fitted
        offsets[judged.effect.target] = float(fitted.theta[fitted.simulator.parameters.index(address)])
    return offsets


def _structured(final: Grounds, selection: Selection) -> bool:
    """Whether more than noise is left."""
    return max(left_over(final).values(), default=0.0) > selection.tolerance
