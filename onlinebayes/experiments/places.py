"""The place of a run's folder, and the line that names it at the end of a run."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.experiments.options import Options
from onlinebayes.experiments.settings import Settings


def place_of(name: str, settings: Options) -> Path:
    """A run's folder, below ``settings.out``."""
    return Path(settings.out) / folder_of(name, settings)


def folder_of(name: str, settings: Options) -> str:
    """Name of a run's folder: experiment, kind of run where there are several, seed; of several runs' common one."""
    kind = [settings.kind] if isinstance(settings, Settings) else []
    seeds = "seeds" if isinstance(settings, Settings) and settings.seeds else str(settings.seed)
    return "-".join([name, *kind, seeds, *["short"] * settings.short])


def closing_line(place: Path) -> str:
    """Return the last line of an experiment: where its files lie, and how they are opened."""
    return f"written: {place}   open it with: onlinebayes show {place}   or {place / 'run.html'} in a browser"
