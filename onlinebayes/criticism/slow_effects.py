"""What is too slow to show within one horizon, such as the drag of a free swing: windows as long as the data allow.

    H' = min(10 H, shortest fit run, T / 8, the time in which an error of a start grows e-fold),    at least 2 H

A window's start is fitted, and takes up what acts slowly. Where nothing but noise is left over H, the model is replayed
over H' as well; where more is left there, every question is asked once more over H'. That answer stands where it adds
to the first one, and leaves noise or at most half of the squared error above it; and where it leaves noise over both,
however many effects it takes: two false laws may pass over H for a true one that H' tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.judging.verdict import halved, left_over
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.searching.stage import leaves_noise
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.fitting.descent import LEAST_GAIN, bounded_step
from onlinebayes.identification.fitting.fit import Fit, improve, unfitted
from onlinebayes.identification.fitting.horizon import steady
from onlinebayes.identification.fitting.numerics import Grounds, check
from onlinebayes.identification.replaying.ladder import affordable
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.runs import UNWATCHED, BadInput, Watch
from onlinebayes.simulators.identifiable import Identifiable

MOST = 10.0  # times H
LEAST = 2.0
WINDOWS = 8  # in the fit runs' whole time T: seven blocks, and something to spare


def slower(
    simulator: Identifiable,
    measurement: Measurement,
    selection: Selection,
    found: SearchResult,
    watch: Watch = UNWATCHED,
) -> Selection | None:
    """The selection with the longer windows in which more than noise is left; None where none is, or none fit.

    Args:
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how effects were judged; a horizon that the user asked for stands.
        found: what was found over the selection's horizon.
        watch: takes one line of progress.
    """
    final = found.final
    if not found.enough or found.widened is not None:
        return None
    if selection.fixed_horizon or _most(left_over(final)) > selection.tolerance:
        return None
    durations = measurement.durations
    longest = min(MOST * selection.horizon_s, min(durations), sum(durations) / WINDOWS)
    if longest < LEAST * selection.horizon_s or not affordable(final.fitted.simulator, final.rung.timestep, longest):
        return None
    watch.say("looking over longer windows")
    try:
        wanted = steady(simulator, measurement, replace(selection, horizon_s=float(f"{longest:.2g}")))
        if wanted.horizon_s < LEAST * selection.horizon_s:
            return None
        long = _refitted(final, measurement, wanted)
    except BadInput:  # it diverges over so long a time
        return None
    if long is None or not long.numerics.sufficient:
        return None
    return wanted if _most(left_over(long)) > selection.tolerance else None


def _refitted(final: Grounds, measurement: Measurement, wanted: Selection) -> Grounds | None:
    """The accepted model fitted over longer windows on the same rung; None where that leaves noise, or creeps.

    One that creeps though it promises more says nothing: contacts make long windows rugged, and steps there cost much.
    So does one whose integration errs too much over so long a time: finer rungs would cost more than the search did.
    """
    model, (windows, begun) = final.fitted.simulator, _begun(final, measurement, wanted.horizon_s, final)
    if leaves_noise(begun, windows, wanted.tolerance):
        return None
    fitted = improve(begun, windows, hopeless=0.0)
    _, promised = bounded_step(model, fitted.projected, fitted.theta, 0.0)
    ended = fitted.converged or promised <= LEAST_GAIN * fitted.projected.objective
    if not ended or leaves_noise(fitted, windows, wanted.tolerance):
        return None
    numerics, shift = check(model, measurement, windows, fitted)
    return Grounds(windows, fitted, numerics, final.rung, shift, final.as_run)


def _begun(model: Grounds, measurement: Measurement, horizon: float, known: Grounds) -> tuple[Windows, Fit]:
    """Windows of another ``horizon`` [s], and where the model's fit to them begins, from the starts that are known."""
    simulator = model.fitted.simulator
    windows = make_windows(simulator, measurement, horizon, MEMORY * horizon, model.windows.noise)
    return windows, unfitted(simulator, windows, model.fitted.theta, starts=_known_starts(windows, known))


def _known_starts(windows: Windows, grounds: Grounds) -> Float[Tensor, "W J2"]:
    """The starts [SI] of windows that begin where another one did, as fitted there; else as smoothed.

    What a smoothed start is off by grows with time, and beside friction that lets go at another instant a fit may not
    find back: it would end above the noise though nothing is missing.
    """
    known = grounds.windows
    place = {at: k for k, at in enumerate(zip(known.run.tolist(), known.first.tolist(), strict=True))}
    starts = windows.start.clone()
    for k, at in enumerate(zip(windows.run.tolist(), windows.first.tolist(), strict=True)):
        if at in place:
            starts[k] = grounds.fitted.lin.starts[place[at]]
    return starts


def adds_to(again: SearchResult, first: SearchResult, measurement: Measurement, asked: Selection) -> bool:
    """Whether what was found over longer windows explains their misfit, and says more than what was found before.

    It says more where it names more; and, however little it names, where it leaves noise over both.

    Args:
        again, first: what was found over the longer windows, and before that over the usual ones.
        measurement: the fit runs.
        asked: how effects are judged, over the usual windows.
    """
    if again.interrupted or again.widened is not None:
        return False
    before, after = left_over(again.base), left_over(again.final)
    noise = _most(after) <= asked.tolerance
    if _named(again) > _named(first):
        return noise or halved(before, after)
    return noise and _named(again) > 0 and _leaves_noise_over(asked, again.final, first.final, measurement)


def _named(found: SearchResult) -> int:
    """Number of effects and of changes between runs."""
    return len(found.accepted) + len(found.changes)


def _leaves_noise_over(asked: Selection, final: Grounds, shorter: Grounds, measurement: Measurement) -> bool:
    """Whether a model that was found over longer windows leaves noise over the usual ones as well, fitted to them."""
    try:
        windows, fitted = _begun(final, measurement, asked.horizon_s, shorter)
        if not leaves_noise(fitted, windows, asked.tolerance):
            fitted = improve(fitted, windows, hopeless=0.0)
    except BadInput:  # it diverges
        return False
    return leaves_noise(fitted, windows, asked.tolerance)


def lengthened(asked: Selection, used: Selection, dropped: Sequence[str] = ()) -> tuple[str, ...]:
    """What to tell a user whose windows are longer than the usual ones; nothing where they are not.

    Args:
        asked, used: the usual windows, and the longer ones.
        dropped: effects that were found over the usual ones, and that the longer ones leave no place for.
    """
    if used.horizon_s <= asked.horizon_s:
        return ()
    if dropped:
        return (
            f"windows last {used.horizon_s:g} s, not {asked.horizon_s:g} s: over {asked.horizon_s:g} s "
            f"{' and '.join(dropped)} would pass for what is missing, over longer times that leaves more than noise",
        )
    return (
        f"windows last {used.horizon_s:g} s, not {asked.horizon_s:g} s: over {asked.horizon_s:g} s nothing more than "
        "noise is left, and what is wrong shows over longer times only",
    )


def dropped_by(again: SearchResult, first: SearchResult) -> list[str]:
    """The effects that were found first and are not found again."""
    kept = {judged.effect.key for _, judged in again.accepted}
    return [judged.effect.key for _, judged in first.accepted if judged.effect.key not in kept]


def unexplained_when_slow(asked: Selection, longer: Selection, again: SearchResult | None) -> str:
    """What to tell a user whose model errs over longer windows, where what was found there does not stand.

    Args:
        asked: the usual windows.
        longer: the longer ones.
        again: what was found over those; None where that was stopped.
    """
    if again is None or again.interrupted:
        why = "and the search for its cause was stopped"
    elif again.accepted and _most(left_over(again.final)) <= longer.tolerance:
        found = " and ".join(judged.effect.key for _, judged in again.accepted)
        why = f"and {found}, which would explain that, leaves more than noise over {asked.horizon_s:g} s"
    else:
        why = "which nothing that was tried explains"
    return (
        f"over windows of {longer.horizon_s:g} s more than noise is left, {why}: trust the model "
        f"over {asked.horizon_s:g} s"
    )


def _most(left: dict[str, float]) -> float:
    return max(left.values(), default=0.0)
