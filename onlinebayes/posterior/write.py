"""A log's posterior as files: posterior.json, and for each model a distribution to load and a corner plot.

belief.json, corner.png                 of the model, or the first one
belief-2.json, corner-2.png, ...        of the others that the log leaves open
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import Any

from onlinebayes.inference import BoxUniform, plots, saving
from onlinebayes.inference.distributions.marginal import Marginal
from onlinebayes.posterior import words
from onlinebayes.posterior.results import LogPosterior
from onlinebayes.runs import together, write_atomic
from onlinebayes.runs.results import machine, versions

SCHEMA = 1

MOST_MODELS = 4
"""A refined model and its rivals."""

DPI = 150

MOST_DRAWN = 8
"""Parameters of a corner plot: those that are known least."""


def names_of(models: int) -> tuple[str, ...]:
    """The files of so many models; posterior.json comes last."""
    each = [(f"belief{end}.json", f"corner{end}.png") for end in ("", *(f"-{k}" for k in range(2, models + 1)))]
    return (*(name for pair in each for name in pair), "posterior.json")


@together()
def write_posterior(
    models: Sequence[LogPosterior], out_dir: str | Path, *, title: str = "", pictures: Sequence[bytes] = ()
) -> tuple[str, ...]:
    """Write the files, each atomically; returns their names.

    Args:
        models: the posterior, or one for each model that the log leaves open.
        out_dir: folder; made if it is missing.
        title: what was measured, over the plots.
        pictures: of :func:`corner_plots`, where they are drawn already.

    Raises:
        BadInput: the folder cannot be made or written.
    """
    folder, names = Path(out_dir), names_of(len(models))
    for k, (found, picture) in enumerate(zip(models, pictures or corner_plots(models, title), strict=True)):
        saving.save(found.belief, folder / names[2 * k])
        write_atomic(folder / names[2 * k + 1], picture)
    content = {
        "schema": SCHEMA,
        "versions": versions(),
        "models": [_model(found, names[2 * k]) for k, found in enumerate(models)],
        "machine": machine(),
    }
    # Last, because programs that wait for the result wait for this one.
    write_atomic(folder / "posterior.json", json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    return names


def corner_plots(models: Sequence[LogPosterior], title: str = "") -> list[bytes]:
    """Draw the corner plot of each model as a PNG file."""
    return [_corner(found, title) for found in models]


def _corner(found: LogPosterior, title: str) -> bytes:
    shown = sorted(found.parameters, key=lambda name: -found.parameters[name].of_prior)[:MOST_DRAWN]
    drawn = Marginal(found.belief, [name for name in found.space.names if name in shown])
    heading = ", ".join(part for part in (title, " + ".join(found.accepted)) if part)
    drawing = BytesIO()
    plots.corner(drawn, prior=BoxUniform(drawn.space), title=heading).savefig(drawing, dpi=DPI, format="png")
    return drawing.getvalue()


def _model(found: LogPosterior, belief: str) -> dict[str, Any]:
    space = found.space
    parameters = {
        name: {**asdict(value), "low": space[name].low, "high": space[name].high, "scale": space[name].scale}
        for name, value in found.parameters.items()
    }
    return {
        "weight": found.weight,
        "accepted": found.accepted,
        "parameters": parameters,
        "correlation": found.correlation.tolist(),
        "unknown": found.identifiability.unknown,
        "combinations": [asdict(one) for one in found.identifiability.combinations],
        "reproduction": {signal: asdict(one) for signal, one in found.reproduction.items()},
        "alarm": {"p": found.surprise, "signal": found.strange, "rings": found.surprise < words.RINGS},
        "in_words": [f"{label}: {text}" if label else text for label, text in words.lines(found)],
        "notes": words.notes(found),
        "method": asdict(found.method),
        "belief": belief,
    }
