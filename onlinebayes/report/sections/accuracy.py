"""Error before and after, signal by signal: one picture with the spread over the held-out windows, and the figures."""

from __future__ import annotations

from onlinebayes.criticism import Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import phrases, spread, words
from onlinebayes.report.markup import Html, folded, join, section, table, tag
from onlinebayes.report.sections.summary import legend

SIGNALS_SHOWN = 6


def picture(result: Criticism) -> Html:
    """The spread of the error over the held-out windows; the worst signals first, the others folded away."""
    rows = spread.spread_rows(result)
    if not rows:
        return Html("")
    worst, *_ = rows
    title = f"Held-out error of {len(rows)} signals in multiples of the noise floor; {worst.signal}: {worst.words}"
    windows = {(w.run, w.window) for w in result.detail.windows if w.held_out}
    runs = len(result.held_out_runs)
    over = f"{len(windows)} windows of {runs} held-out run{'s' if runs > 1 else ''}" if windows else "held-out data"
    ticks = "; the ticks are single windows, the bar holds four fifths of them" if windows else ""
    caption = f"A dot is the root mean square over {over}{ticks}. A perfect model would lie in the shaded part."
    more = spread.draw(rows[SIGNALS_SHOWN:], "Held-out error of the other signals in multiples of the noise floor")
    kinds = ("before", "after", "floor")
    return tag(
        "figure",
        legend(result.changed, kinds),
        Html(spread.draw(rows[:SIGNALS_SHOWN], title)),
        tag("figcaption", caption),
        folded(f"{len(rows) - SIGNALS_SHOWN} more signals, with smaller errors", Html(more)) if more else "",
    )


def heldout(result: Criticism) -> Html:
    """The figures of every signal, where there is more than one."""
    errors, rows = result.heldout_error, []
    if len(errors.before) < 2:
        return Html("")
    for signal in words.signals_by_error(result):
        before, after, floor = errors.before[signal], errors.after[signal], errors.noise_floor[signal]
        was, now, noise = quantities.texts((before, after, floor), result.units[signal])
        horizon = quantities.exact(errors.horizon_s[signal], "s")
        values = (was, now, noise, phrases.better(before, after), horizon)
        rows.append((tag("code", signal), *values))
    head = ("signal", "before", "after", "noise floor", "change", "window")
    caption = "Root mean square over the held-out windows"
    more = rows[SIGNALS_SHOWN:]
    return section(
        "Held-out error, signal by signal",
        join(
            table(caption, head, rows[:SIGNALS_SHOWN]),
            folded(f"{len(more)} more signals", table(f"{caption}, the other signals", head, more)) if more else "",
        ),
    )
