"""The names in the table for those who know sbi exist, there and here."""

from __future__ import annotations

import importlib
import inspect
import re
import warnings
from pathlib import Path
from types import ModuleType

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "coming-from-sbi.md"
ROWS = re.findall(r"^\| (.*?`.*?) \| (.*?) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def names(column: int) -> set[str]:
    return {name for row in ROWS for name in re.findall(r"`(\w+)`", row[column])}


def known(*modules: str) -> set[str]:
    """Public names of modules, of their classes, and the arguments of both."""
    found: set[str] = set()
    for module in map(importlib.import_module, modules):
        values = {name: getattr(module, name) for name in dir(module) if not name.startswith("_")}
        found |= set(values)
        for value in values.values():
            found |= members(value)
    return found


def members(value: object) -> set[str]:
    if isinstance(value, ModuleType) or not callable(value):
        return set()
    parts = [value, *(inspect.getmembers(value, inspect.isfunction) if inspect.isclass(value) else [])]
    found = {part[0] for part in parts[1:]}
    for part in (value, *(part[1] for part in parts[1:])):
        try:
            found |= set(inspect.signature(part).parameters)
        except (TypeError, ValueError):
            continue
    return found


def test_the_names_of_sbi() -> None:
    pytest.importorskip("sbi", reason="sbi is one of the peers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        there = known(
            *(f"sbi.{part}" for part in ("inference", "utils", "diagnostics", "analysis", "neural_nets")),
            "sbi.neural_nets.embedding_nets",
        )
        import sbi.inference

        with pytest.warns(FutureWarning, match="deprecated"):
            assert sbi.inference.SNPE is sbi.inference.NPE_C
    assert names(0) - there - {"SNPE"} == set()


def test_our_names() -> None:
    here = known(
        "onlinebayes.inference",
        "onlinebayes.inference.calibration",
        "onlinebayes.inference.plots",
        "onlinebayes.inference.proposals",
        "onlinebayes.inference.trust",
        "onlinebayes.embeddings",
        "onlinebayes.trainers",
    )
    assert names(1) - here == set()
    assert len(ROWS) > 20
