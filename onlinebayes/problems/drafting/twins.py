"""A servo's command as the twin of what was measured: two columns that differ by one word, of which the longer is told.

    dof_pos[1], wish_dof_pos[1]  ->  qpos and ctrl of the second joint

The word is one that nobody knows here, and the same for every servo that has no command yet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.problems.drafting.actuator_inputs import Input
from onlinebayes.problems.drafting.column_units import UNIT_WORDS
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.drafting.words import said_by, words

CHANGED = {
    *("filtered", "filt", "smooth", "smoothed", "fitted", "interp", "interpolated", "corrected", "calibrated", "norm"),
    *("normalised", "normalized", "prev", "previous", "last", "next", "old", "new", "init", "initial", "start", "zero"),
    *(
        "default",
        "rel",
        "relative",
        "abs",
        "absolute",
        "sim",
        "simulated",
        "model",
        "predicted",
        "pred",
        "true",
        "noisy",
    ),
    *("delta", "diff", "mean", "avg", "unwrapped", "wrapped", "left", "right", "motor", "link", "load", "output"),
    *("second", "secondary", "backup", "raw", "counts", "ticks", "adc", "lsb", "grad", "gon"),
}
"""Words for the same quantity treated or taken otherwise."""


def twins(
    found: Sequence[Match], left: Sequence[str], columns: Sequence[str], inputs: Mapping[str, Input]
) -> tuple[Match, ...]:
    """Commands for all position servos that have none, or for none of them.

    Args:
        found: what was matched.
        left: names without a column.
        columns: that nothing takes.
        inputs: see :func:`~onlinebayes.problems.drafting.actuator_inputs.actuator_inputs`.
    """
    measured = {one.name: one for one in found if one.name.startswith("qpos.")}
    servos = [name for name in left if name in inputs and inputs[name].told == "qpos"]
    pairs: list[Match] = []
    extra: set[str] = set()
    for name in servos:
        own = measured.get(f"qpos.{inputs[name].joint}")
        longer = {column: _more(own.column, column) for column in columns} if own else {}
        longer = {column: word for column, word in longer.items() if word}
        if own is None or len(longer) != 1:
            return ()
        ((column, word),) = longer.items()
        extra.add(word)
        why = f"a guess, it differs from what was measured by the word '{word}' alone"
        pairs.append(Match(name, column, own.unit, why))
    return tuple(pairs) if len(extra) == 1 and len({one.column for one in pairs}) == len(pairs) else ()


def _more(column: str, longer: str) -> str:
    """The one word that a longer column has more; empty where it has others, or one that says something else."""
    short, long = words(column), words(longer)
    if len(long) != len(short) + 1:
        return ""
    for k, word in enumerate(long):
        if [*long[:k], *long[k + 1 :]] == short:
            is_free = said_by([word], UNIT_WORDS).unknown and not word.isdigit() and word not in CHANGED
            return word if is_free and not said_by([word]).foreign else ""
    return ""
