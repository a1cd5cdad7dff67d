"""``onlinebayes demo``: plays the recipe ``demo``, wherever it is installed.

The library imports no recipe: this one is looked for by name, in ``onlinebayes.recipes`` of a wheel or in ``recipes``
of a clone (docs/decisions/0060).
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from onlinebayes.cli.outputs import writable
from onlinebayes.runs import BadInput

PLACES = ("onlinebayes.recipes", "recipes")


def demo(out: Path, seed: int, short: bool) -> int:
    """Play it; returns the exit status.

    Args:
        out: folder for all files.
        seed: another machine, other noise, other networks.
        short: tiny budgets.

    Raises:
        BadInput: the recipes are not installed, or the folder cannot be written.
    """
    place = next((place for place in PLACES if find_spec(place) is not None), None)
    if place is None:
        raise BadInput(
            "the recipes are not installed", "install onlinebayes from its wheel, or run make demo in a clone"
        )
    with writable(out, ("demo.json", "demo.png")) as folder:
        return int(import_module(f"{place}.demo.__main__").play(folder, seed, short))
