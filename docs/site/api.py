"""Pages of the API reference: one for each public room, of the docstrings of the names in its ``__all__``.

A name that several rooms offer is described once, by the room that it is defined in; the others refer to it.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import onlinebayes

SUBROOMS = (
    "onlinebayes.control.testing",
    "onlinebayes.inference.testing",
    "onlinebayes.objectives.testing",
    "onlinebayes.simulators.abilities",
    "onlinebayes.simulators.effects",
    "onlinebayes.simulators.mujoco",
    "onlinebayes.simulators.testing",
    "onlinebayes.trainers.distributed",
    "onlinebayes.transforms.testing",
)
"""Rooms within rooms that are imported from by their own names."""


def rooms() -> list[str]:
    """Names of all modules that have a page."""
    inside = [module.name for module in pkgutil.iter_modules(onlinebayes.__path__, "onlinebayes.") if module.ispkg]
    offering = [name for name in inside if hasattr(importlib.import_module(name), "__all__")]
    return sorted(["onlinebayes", "onlinebayes.parameters", *offering, *SUBROOMS])


def names(room: str) -> list[str]:
    """Names that a room offers: its ``__all__``, or what is defined there."""
    module = importlib.import_module(room)
    here = [name for name, value in vars(module).items() if getattr(value, "__module__", "") == room and name[0] != "_"]
    return list(getattr(module, "__all__", here))


def owners() -> dict[int, str]:
    """Id of an object that has a module -> the room that describes it: the innermost one around it, or the first."""
    found: dict[int, str] = {}
    for room in rooms():
        for name in names(room):
            value = getattr(importlib.import_module(room), name)
            home = getattr(value, "__module__", None)
            if home is not None and (id(value) not in found or f"{home}.".startswith(f"{room}.")):
                found[id(value)] = room
    return found


def page(room: str, owners: dict[int, str]) -> str:
    """Markdown of the page of one room."""
    module = importlib.import_module(room)
    described, elsewhere = [], []
    for name in names(room):
        owner = owners.get(id(getattr(module, name)), room)
        (described if owner == room else elsewhere).append((name, owner))
    index = ", ".join(f":py:obj:`{name} <{room}.{name}>`" for name, _ in sorted(described))
    members = ", ".join(name for name, _ in described) or "__doc__"
    lines = [
        f"# {room}",
        "",
        "```{eval-rst}",
        index,
        "",
        f".. automodule:: {room}",
        f"   :members: {members}",
        "```",
        "",
    ]
    if elsewhere:
        lines += ["Also offered here: " + ", ".join(f"[`{name}`]({owner}.md)" for name, owner in elsewhere) + ".", ""]
    return "\n".join(lines)


def write(folder: Path) -> None:
    """Write all pages; one that is unchanged keeps its date, so that Sphinx does not read it again."""
    folder.mkdir(exist_ok=True)
    described_by = owners()
    pages = {f"{room}.md": page(room, described_by) for room in rooms()}
    for old in folder.glob("*.md"):
        if old.name not in pages:
            old.unlink()
    for name, text in pages.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")
