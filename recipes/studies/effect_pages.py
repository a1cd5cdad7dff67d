"""The computed part of the pages in docs/effects: fingerprints, bounds, which effects look alike, for each effect.

On the standard machine (:mod:`.effect_pages_machine`) one specimen of every effect is recorded, the model that lacks it
is refitted, and what is left is drawn (:mod:`.effect_pages_picture`); the three effects that come nearest are named
with their cosines (:mod:`.effect_pages_likeness`). The rest of a page is written by hand and stays as it is.

    python -m recipes.studies.effect_pages                            every page, docs/results/effect-pages.json
    python -m recipes.studies.effect_pages --only dry_friction        one page
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import status
from onlinebayes.identification import quantities
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, Progress, ResultTable, write_atomic
from onlinebayes.simulators.effects import EFFECTS, Effect
from recipes.studies.effect_pages_likeness import Likeness, Trace, nearest, traces
from recipes.studies.effect_pages_machine import (
    SPECIMENS,
    machine,
    record,
    specimen_effects,
    windows_of,
)
from recipes.studies.effect_pages_picture import draw, fingerprint

BEGIN, END = "<!-- printed by make effect-pages -->", "<!-- end of what is printed -->"


@dataclass(frozen=True)
class Study:
    """Options of the pages.

    Args:
        only: names of effects; all when empty.
        seed: of commands and noise.
        pages: folder of the pages.
        results: folder of the result table; it is written when all effects are made.
    """

    only: tuple[str, ...] = ()
    seed: int = 0
    pages: Path = Path("docs/effects")
    results: Path = Path("docs/results")


@dataclass(frozen=True)
class Card:
    """Contents of an effect's page.

    Args:
        effect: with the bounds that it has on the standard machine.
        specimen: its values there [SI].
        held: whether the free parameters can do what it does, so that the picture is drawn with them known.
        left: what a refitted model without it errs by, over the noise.
        alike: the nearest effects.
        picture: SVG.
    """

    effect: Effect
    specimen: Mapping[str, float]
    held: bool
    left: float
    alike: tuple[Likeness, ...]
    picture: str


def make(study: Study) -> list[Card]:
    """One card for each effect, in the order of the vocabulary."""
    if unknown := [name for name in study.only if name not in _names()]:
        raise BadInput(f"no specimen of {', '.join(unknown)}", f"choose among {', '.join(_names())}")
    bare = windows_of(record(seed=study.seed))
    effects = specimen_effects(bare)
    simulator = machine()
    found = traces(simulator, bare, simulator.nominal, effects, SPECIMENS)
    keys = [key for key in SPECIMENS if not study.only or name_of(key) in study.only]
    cards = []
    with Progress("effect pages", len(keys)) as progress:
        for key in keys:
            cards.append(_card(effects[key], found, study.seed))
            progress.update(len(cards), key)
    return cards


def block(card: Card) -> str:
    """The printed part of a page, between its two marks."""
    name = card.effect.name
    held = " (and its mass and damping known, for they can do the same)" if card.held else ""
    alike = [f"[{name_of(one.other)}]({name_of(one.other)}.md) ({one.cosine:.4f})" for one in card.alike]
    richer = [f"[{other}]({other}.md)" for other, kind in EFFECTS.items() if name in kind.contains]
    contained = f" It is contained in {_listed(richer)}." if richer else ""
    return "\n".join(
        [
            BEGIN,
            f"On the [standard machine](README.md#the-standard-machine) with {shown(card.effect, card.specimen)}{held} "
            f"the model without it errs by {quantities.significant(card.left)} times the noise.",
            "",
            f"![What a model without {name} gets wrong](images/{name}.svg)",
            "",
            f"It looks like {_listed(alike)}.{contained}",
            END,
        ]
    )


def shown(effect: Effect, specimen: Mapping[str, float]) -> str:
    """The values of the effect in the picture."""
    return _listed(
        [f"`{name}` {quantities.text(specimen[name], bounds.unit)}" for name, bounds in effect.parameters.items()]
    )


def written(page: str, content: str, where: str) -> str:
    """The page with what stands between its marks replaced.

    Raises:
        BadInput: the page lacks the marks.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise BadInput("the page has no place for what is printed", f"put {BEGIN} and {END} into it", where=where)
    return before + content + after


def table(cards: list[Card], seed: int) -> ResultTable:
    """Every figure of the pages."""
    results = ResultTable("effect-pages", "make effect-pages", [seed])
    for card in cards:
        held = "mass and damping known" if card.held else "mass and damping refitted"
        results.add(f"{card.effect.key}: error without it", card.left, unit="times the noise", spread=held)
        for one in card.alike:
            results.add(f"{one.effect} looks like {one.other}", one.cosine, unit="cosine")
    return results


def name_of(key: str) -> str:
    """``dry_friction`` of ``dry_friction@hinge``."""
    return key.partition("@")[0]


def main(study: Study) -> None:
    """Make the pages and print their figures."""
    cards = make(study)
    for card in cards:
        name = card.effect.name
        page = study.pages / f"{name}.md"
        if not page.is_file():
            raise BadInput("there is no such page", "write it first; see docs/effects/README.md", where=str(page))
        write_atomic(study.pages / "images" / f"{name}.svg", card.picture)
        write_atomic(page, written(page.read_text(encoding="utf-8"), block(card), str(page)))
    results = table(cards, study.seed)
    if not study.only:
        results.write(study.results)
    print(results.to_markdown())


def _card(effect: Effect, found: Mapping[str, Trace], seed: int) -> Card:
    values, held = SPECIMENS[effect.key], found[effect.key].confounded
    recording = record(effect, values, seed)
    windows = windows_of(recording)
    lacking = machine(ParameterSpace()) if held else machine()
    seen = fingerprint(lacking, windows, recording)
    picture = draw(seen, f"What a model without {effect.name} gets wrong")
    return Card(effect, values, held, seen.left, nearest(effect.key, found), picture)


def _names() -> tuple[str, ...]:
    return tuple(name_of(key) for key in SPECIMENS)


def _listed(texts: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(texts[:-1]), texts[-1])))


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
