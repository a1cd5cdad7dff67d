"""Results of other kinds of run with the same settings, for the pages of this one."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from typing import get_args

from onlinebayes.experiments.places import place_of
from onlinebayes.experiments.settings import Kind, Settings, recorded_settings


def baselines(name: str, settings: Settings) -> dict[str, float]:
    """Last returns of the other kinds of run with the same settings, as far as they lie in the same folder."""
    found = {}
    for kind in get_args(Kind):
        other = replace(settings, kind=kind)
        log, about = (place_of(name, other) / file for file in ("log.csv", "run.json"))
        if kind == settings.kind or not (log.exists() and about.exists()):
            continue
        if json.loads(about.read_text(encoding="utf-8"))["settings"] == json.loads(
            json.dumps(recorded_settings(other), default=str)
        ):
            with log.open(encoding="utf-8") as file:
                found[kind] = float(list(csv.DictReader(file))[-1]["figure/return"])
    return found
