"""One experiment with several seeds: a run for each in a folder of its own, and a page of what they have in common.

    --seeds 0..4    ->    out/NAME-KIND-seeds/  NAME-KIND-0 .. NAME-KIND-4,  run.html, seeds.csv

A curve is the median over seeds at each step, its band goes from the lower quartile to the upper one.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from onlinebayes.loggers import Curves, Page, write_page
from onlinebayes.runs import BadInput, write_atomic

FIGURE = "figure/"

Log = list[dict[str, str]]


def seeds_of(text: str) -> list[int]:
    """Seeds as a command line gives them: ``0..4``, ``0,3,7`` or both.

    Raises:
        BadInput: something else, or a seed twice.
    """
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)(?:\.\.(\d+))?\s*", part)
        if match is None or (match[2] is not None and int(match[2]) < int(match[1])):
            raise BadInput(f"--seeds {text}", "write 0..4, or 0,3,7")
        found += range(int(match[1]), int(match[2] or match[1]) + 1)
    if len(set(found)) < len(found):
        raise BadInput(f"--seeds {text} names a seed twice", "name each once")
    return found


def write_seeds(place: Path, name: str, folders: Mapping[int, Path]) -> str:
    """Write page and table of some runs; returns a line on their returns.

    Args:
        place: where they go.
        name: of the experiment.
        folders: seed -> folder of its run.
    """
    logs = {seed: _log(folder) for seed, folder in folders.items()}
    steps = min(len(log) for log in logs.values())
    frames = [float(row["frames"]) for row in next(iter(logs.values()))[:steps]]
    each = list(logs.values())
    figures = {figure: _values(each, figure, steps) for figure in _figures(each)}
    rows = [[str(seed), *(f"{values[k, -1]:.4g}" for values in figures.values())] for k, seed in enumerate(logs)]
    charts, told = list[Curves](), [dict[str, float]() for _ in range(steps)]
    for figure, values in figures.items():
        low, middle, high = _quartiles(values)
        line, band = {"median": middle.tolist()}, {"median": (low.tolist(), high.tolist())}
        charts.append(Curves(figure, ("simulated frames", frames), line, band))
        for k, row in enumerate(told):
            row[f"{figure}/lower quartile"], row[f"{figure}/median"] = low[k], middle[k]
            row[f"{figure}/upper quartile"] = high[k]
    lead = f"{len(logs)} seeds, {steps} steps; curves are medians, bands go from the lower quartile to the upper one"
    page = Page(name, lead, ["seed", *(f"{figure}, last" for figure in figures)], rows, charts, {}, {}, [])
    write_page(page, place / "run.html")
    write_atomic(place / "seeds.csv", _table(frames, told))
    if "return" not in figures:
        return lead
    low, middle, high = _quartiles(figures["return"])[:, -1]
    return f"return, median of {len(logs)} seeds: {middle:.4g} (quartiles {low:.4g} and {high:.4g})"


def _log(folder: Path) -> Log:
    with (folder / "log.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _figures(logs: Sequence[Log]) -> list[str]:
    """Names of the figures that every run has."""
    each = [[key.removeprefix(FIGURE) for key in log[0] if key.startswith(FIGURE)] for log in logs]
    return [figure for figure in each[0] if all(figure in others for others in each)]


def _values(logs: Iterable[Log], figure: str, steps: int) -> np.ndarray:
    """A figure of every run at every step (S, T); what a step lacks is nan."""
    return np.array([[float(row[FIGURE + figure] or "nan") for row in log[:steps]] for log in logs])


def _quartiles(values: np.ndarray) -> np.ndarray:
    """Lower quartile, median and upper quartile over runs (3, T); nan where a run has no finite number."""
    with np.errstate(invalid="ignore"):
        found = np.quantile(values, (0.25, 0.5, 0.75), axis=0)
    return np.where(np.isfinite(found), found, np.nan)


def _table(frames: Sequence[float], rows: Sequence[Mapping[str, float]]) -> str:
    file = io.StringIO()
    writer = csv.DictWriter(file, ["step", "frames", *rows[0]])
    writer.writeheader()
    for k, row in enumerate(rows):
        writer.writerow({"step": k + 1, "frames": round(frames[k]), **row})
    return file.getvalue()
