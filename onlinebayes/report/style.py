"""The look of the report's pages, from the file beside this one."""

from __future__ import annotations

from importlib.resources import files


def stylesheet() -> str:
    """The CSS of a report: colours for light and dark, then rules."""
    return files(__package__).joinpath("style.css").read_text(encoding="utf-8")
