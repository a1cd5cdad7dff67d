"""The one rule: when is a hypothesis preferred to a simpler one, and when are two of them equally good.

A hypothesis with additions is preferred to one without them where its gain in left-out score (see :mod:`.scoring`) is

    gain >= max(0.05, a tenth of what was gained so far)    in one of the signals: it explains a share that matters
    gain >  2 se, or no more than noise is left             and it is no accident of the folds
    worse <= max(1, a fifth of the folds)                   and nearly all folds agree

with data left out by runs, and at least 0.05 wherever else they are left out: it holds where it was not seen.
Two hypotheses are equally good where, in one way of leaving data out, they differ by no more than one standard error of
their difference, or by less than a tenth of what they gain. The one with fewer parameters is preferred then, and the
other is named beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from onlinebayes.identification.judging.scoring import Gain, LeftOut, in_common

LEAST_GAIN = 0.05
"""Nats, the log of a factor: 0.05 is a twentieth of one signal's error."""

SHARE_OF_GAINED = 0.1
"""Beside a gain ten times as large an addition is an imperfection, and no explanation."""

STANDARD_ERRORS = 2.0
"""With one standard error, a false tilt was accepted on a measured machine."""

SHARE_WORSE = 0.2
"""Of the folds, at most, may be predicted worse."""


EXPLAINED = 0.5
"""Share of the squared error above the noise that may be left where it is said that something explains the misfit."""


def explains_half(before: LeftOut, after: LeftOut) -> bool:
    """Check whether half of the squared error above the noise is gone, over what both predict."""
    return half_gone(*(one.rms.tolist() for one in in_common(before, after)))


def half_gone(before: Iterable[float], after: Iterable[float]) -> bool:
    """The same of the RMS of every signal over the same windows [floors]."""
    excess, left = (sum(max(0.0, value**2 - 1) for value in errors) for errors in (before, after))
    return left <= EXPLAINED * excess


def explains_enough(found: Gain, gained: Sequence[float]) -> bool:
    """Check whether a gain is a share of the error that matters, where so much was gained in each signal before it."""
    pairs = zip(found.by_signal, gained, strict=True)
    return found.gain >= LEAST_GAIN and any(won >= max(LEAST_GAIN, SHARE_OF_GAINED * before) for won, before in pairs)


def preferred(found: Sequence[Gain], gained: Gain) -> bool:
    """Check whether an addition with these gains is preferred to going without it; arguments as :func:`refusal`."""
    return refusal(found, gained) is None


def refusal(found: Sequence[Gain], gained: Gain, *, noise_left: bool = False) -> str | None:
    """Why it is not preferred, in words; None where it is.

    Args:
        found: gain of the addition, for each way of leaving data out, by runs first.
        gained: what was gained before it, with data left out by runs.
        noise_left: whether no more than noise is left with it: what acts in few of the runs is not uncertain then.
    """
    first = found[0]
    if not explains_enough(first, gained.by_signal):
        return f"explains too little: gain {first.gain:.3f}"
    if first.gain <= STANDARD_ERRORS * first.se and not noise_left:
        return f"uncertain: gain {first.gain:.3f} with a standard error of {first.se:.3f}"
    if first.worse > max(1, int(SHARE_WORSE * first.folds)):
        return f"{first.worse} of {first.folds} parts of the data are predicted worse"
    least = min(one.gain for one in found)
    return f"does not hold where it was not seen: gain {least:.3f}" if least < LEAST_GAIN else None


def equally_good(differences: Sequence[Gain], gains: Sequence[float]) -> bool:
    """Check whether two hypotheses cannot be told apart.

    Args:
        differences: of the better over the other, for each way of leaving data out [nats].
        gains: what the better one gains [nats].
    """
    pairs = zip(differences, gains, strict=True)
    return any(one.gain <= max(one.se, SHARE_OF_GAINED * max(won, 0.0)) for one, won in pairs)
