"""Limits on the files that an MJCF file may reach and on its model's size, checked before MuJoCo opens anything.

A problem file is passed from hand to hand with its model. So a model read for one must not read files outside the
folder that was handed over (includes, meshes, textures, links that lead out), must not define entities, and must not
ask for more elements or pixels than a machine can hold. Source of the attributes:
https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element, ParseError, XMLPullParser

from onlinebayes.runs import BadInput

LARGEST = 64 * 2**20
"""Bytes of one XML file."""

MOST_FILES = 1000
MOST_COPIES = 100_000
"""Elements that ``replicate``, ``composite`` and ``flexcomp`` may make, nested ones multiplied."""

MOST_PIXELS = 100_000_000
MOST_MEMORY = 4 * 2**30
FOLDERS = ("meshdir", "texturedir", "assetdir")
_SUFFIX = {"k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40, "p": 2**50, "e": 2**60}


def check_files(model: Path, root: Path | None = None) -> None:
    """Raise :class:`BadInput` when a model reaches outside a folder or asks for far too much.

    Args:
        model: an MJCF file that exists.
        root: the folder that must hold every file the model names, links followed; anywhere when None.
    """
    _check_inside(model, model, root)
    checked: set[Path] = set()
    waiting = [model]
    while waiting:
        path = waiting.pop()
        if (real := path.resolve()) in checked:
            continue
        if len(checked) == MOST_FILES:
            raise BadInput(f"more than {MOST_FILES} files are included", "put them into fewer files", where=str(model))
        checked.add(real)
        waiting += _check_one(path, model, root)


def _check_one(path: Path, model: Path, root: Path | None) -> list[Path]:
    """Check one XML file; returns those that it includes."""
    folders, named = {""}, list[tuple[str, str]]()
    for element in _elements(path):
        _check_size(element, path)
        folders |= {element.attrib[key] for key in FOLDERS if key in element.attrib}
        named += [(element.tag, value) for key, value in element.attrib.items() if key.startswith("file")]
    for _, name in named if root is not None else []:
        for base in (model.parent, path.parent):
            for folder in folders:
                _check_inside(base / folder / name, path, root)
    found = [base / name for tag, name in named if tag in ("include", "model") for base in {model.parent, path.parent}]
    return [file for file in found if _is_file(file)]


def _check_inside(file: Path, path: Path, root: Path | None) -> None:
    if root is None or not _is_file(file):
        return
    if not file.resolve().is_relative_to(root.resolve()):
        problem = f"the model reads '{file.resolve()}', outside the folder '{root}'"
        raise BadInput(problem, "put the file beside the model", where=str(path))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name too long, a loop of links: MuJoCo will not open it either
        return False


def _elements(path: Path) -> Iterator[Element]:
    """Every element as it begins, the copies that its ancestors make of it checked."""
    copies: list[float] = []
    for event, element in _events(_text(path)):
        if element.tag in ("replicate", "composite", "flexcomp"):
            copies = [*copies, _product(element.get("count", "1"))] if event == "start" else copies[:-1]
            if (made := math.prod(copies)) > MOST_COPIES:
                raise BadInput(f"{element.tag} makes {made:.3g} copies", f"make at most {MOST_COPIES}", where=str(path))
        if event == "start":
            yield element


def _text(path: Path) -> bytes:
    size = path.stat().st_size
    if size > LARGEST:
        raise BadInput(f"has {size} bytes", f"a model may have {LARGEST}", where=str(path))
    text = path.read_bytes()
    if b"\0" in text:
        raise BadInput("has NUL bytes: no XML in UTF-8", "save it as UTF-8", where=str(path))
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise BadInput("declares a document type or entities", "MJCF has neither: remove them", where=str(path))
    return text


def _events(text: bytes) -> Iterator[tuple[str, Element]]:
    """Begins and ends of elements, up to the first fault of the XML: MuJoCo's own message says more of it."""
    parser: XMLPullParser = XMLPullParser(("start", "end"))
    with suppress(ParseError, ValueError, LookupError):
        parser.feed(text)
        parser.close()
    with suppress(ParseError):
        yield from cast(Iterator[tuple[str, Element]], parser.read_events())


def _check_size(element: Element, path: Path) -> None:
    for one, other in (("width", "height"), ("nrow", "ncol")):
        if (pixels := _product(f"{element.get(one, '1')} {element.get(other, '1')}")) > MOST_PIXELS:
            problem = f"{element.tag} has {pixels:.3g} values ({one} x {other})"
            raise BadInput(problem, f"give at most {MOST_PIXELS}", where=str(path))
    if element.tag != "size":
        return
    for key, value in element.attrib.items():
        text = value.strip().lower()
        factor = _SUFFIX.get(text[-1:], 1)
        if _product(text[:-1] if factor > 1 else text) * factor > MOST_MEMORY:
            raise BadInput(f"size {key}='{value[:40]}'", f"ask for at most {MOST_MEMORY} bytes", where=str(path))


def _product(numbers: str) -> float:
    """Product of the numbers in an attribute; 1 where they are none, which MuJoCo will say."""
    try:
        return math.prod(abs(float(number)) for number in numbers.split())
    except ValueError:
        return 1.0
