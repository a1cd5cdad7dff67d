"""next.html: the chosen input, what each rival predicts under it, and the inputs that were compared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from torch import Tensor

from onlinebayes.criticism import Plan
from onlinebayes.report import plan_words
from onlinebayes.report.html import PAGE
from onlinebayes.report.markup import Html, section, table, tag, text
from onlinebayes.report.style import stylesheet
from onlinebayes.report.svg import Array, Curve, Panel, chart

LISTED = 20
INKS: Final = ("ink", "before", "after", "gain", "floor", "soft")
"""Colours of the page's style sheet, one a rival; a seventh begins anew."""


def to_page(plan: Plan, *, title: str = "") -> str:
    """The whole page.

    Args:
        plan: what is proposed.
        title: what was criticised, e.g. the name of the problem file.
    """
    style = stylesheet()
    colours = "".join(
        f".curve.rival{k} {{ stroke: var(--{ink}); }} .key.rival{k}::before {{ background: var(--{ink}); }}\n"
        for k, ink in enumerate(INKS)
    )
    parts = [
        tag("p", "onlinebayes next", f" · {title}" if title else "", kind="source"),
        tag("h1", plan_words.headline(plan)),
        tag("p", f"From {plan_words.beginning(plan)}: {plan_words.instructions(plan)}.", kind="lead"),
        _rivalries(plan),
        _picture(plan),
        _tried(plan),
    ]
    head = text(f"{title or 'onlinebayes'}: {plan_words.headline(plan)}")
    return PAGE.format(title=head, style=style + colours, body=Html("\n".join(parts)))


def _rivalries(plan: Plan) -> Html:
    rows = [
        [
            f"{number}. {' or '.join(rivalry.names)}",
            f"{rivalry.sigma:.3g}",
            f"{rivalry.best:.3g}",
            plan_words.acceptance(rivalry),
            plan_words.remedy(rivalry) if rivalry.structural else "",
        ]
        for number, rivalry in enumerate(plan.rivalries, 1)
    ]
    note = (
        "How surely a recording rules out one model if the other is true, its parameters and the windows' starts "
        "having adapted. Below 4 under every input the two are structurally alike. A model is preferred only where it "
        "predicts the present runs and the new ones better by enough, too."
    )
    return section(
        "What is open",
        table(
            "Rivals, and how surely a recording parts them",
            ("rivals", "sigma, this input", "sigma, best input", "what that gains", "what would part them"),
            rows,
        ),
        note=note,
    )


def _picture(plan: Plan) -> Html:
    time = _array(plan.time)
    panels = [
        Panel([Curve(time, _array(plan.command[:, k]), "after", name)], f"ctrl.{name}", 90)
        for k, name in enumerate(plan.commands)
    ]
    first = next(iter(plan.tracks.values()))
    apart = {name: track - first for name, track in plan.tracks.items()}
    for s, signal in enumerate(plan.signals):
        unit = f" [{plan.units[signal]}]" if plan.units[signal] else ""
        panels.append(Panel(_curves(time, plan.tracks, s), f"{signal}{unit}", 120))
        panels.append(Panel(_curves(time, apart, s), f"difference{unit}", 90))
    keys = [tag("span", name, kind=f"key rival{k % len(INKS)}") for k, name in enumerate(plan.tracks)]
    picture = Html(chart(panels, "time [s]", title="the chosen input and the predicted signals"))
    note = "Differences are from the first rival, as the models stand: before any of them adapts."
    return section("The input and what each rival predicts", tag("p", *keys, kind="legend"), picture, note=note)


def _curves(time: Array, tracks: Mapping[str, Tensor], signal: int) -> list[Curve]:
    return [
        Curve(time, _array(track[:, signal]), f"rival{k % len(INKS)}", name)
        for k, (name, track) in enumerate(tracks.items())
    ]


def _tried(plan: Plan) -> Html:
    rows = [
        [
            plan_words.described(tried),
            f"{100 * tried.scale:.0f} %",
            *(f"{sigma:.3g}" for sigma in tried.sigma),
            "refitted" if tried.refitted else "first order",
        ]
        for tried in plan.tried[:LISTED]
    ]
    pairs = (f"sigma, pair {number}" for number in range(1, len(plan.rivalries) + 1))
    head = ("input", "of the largest command", *pairs, "how")
    left_out = len(plan.tried) - len(rows)
    note = f"{plan.refused} further inputs left the limits at any size." if plan.refused else ""
    note += f" {left_out} more stand in next.json." if left_out > 0 else ""
    return section("Inputs compared", table("Inputs compared, the best first", head, rows), note=note.strip())


def _array(values: Tensor) -> Array:
    return values.detach().cpu().double().numpy()
