"""Rates measured in alternating pairs, so that a machine that slows down slows both sides of a ratio."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

PAIRS = 7


@dataclass(frozen=True)
class Pairs:
    """Rates [1/s] of two ways to do the same, measured one right after the other.

    Args:
        ours, reference: one rate a pair.
    """

    ours: list[float]
    reference: list[float]

    @property
    def ratios(self) -> list[float]:
        """Ours over the reference's, pair by pair."""
        return [a / b for a, b in zip(self.ours, self.reference, strict=True)]


def alternate(ours: Callable[[], float], reference: Callable[[], float], pairs: int = PAIRS) -> Pairs:
    """Measure the two in turn; each gives a rate [1/s]. One pair before the first is thrown away."""
    rates = [(ours(), reference()) for _ in range(pairs + 1)][1:]
    return Pairs([a for a, _ in rates], [b for _, b in rates])


def rate(advance: Callable[[], int], seconds: float) -> float:
    """Frames a second of ``advance``, which returns how many frames it made, over at least ``seconds`` [s]."""
    frames, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        frames += advance()
    return frames / elapsed


def spread(values: list[float], digits: int = 4) -> str:
    """Smallest to largest."""
    return f"{min(values):.{digits}g} to {max(values):.{digits}g}"


median = statistics.median
