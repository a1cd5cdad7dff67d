"""Options of every experiment: a seed, a small budget, the place of its folder."""

from __future__ import annotations

from dataclasses import dataclass

from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Options:
    """Options of an experiment.

    Raises:
        BadInput: a negative seed.
    """

    seed: int = 0
    """of networks, worlds and draws"""
    short: bool = False
    """a small budget: shows that the pieces connect, and judges nothing"""
    out: str = "out"
    """the run's folder goes here"""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise BadInput(f"seed {self.seed}", "needs seed >= 0")
