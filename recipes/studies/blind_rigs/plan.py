"""Cases that are judged, and their order: all kinds and rigs advance together, so that a part is a sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import count, islice
from typing import final

from envs.rigs import KINDS, hidden_in, kinds

REPORTED = 7900
"""Seed of a rig's first reported case of a kind; with those below the search was tuned, or they were looked at."""
QUICK = (
    *("thrown_ball", "swing", "position_servo", "slide_drive"),
    *("cart_pole", "two_link_arm", "pushed_block", "six_joint_arm"),
)


@final
@dataclass(frozen=True)
class Job:
    """A blind case by name.

    Args:
        rig: of ``envs/rigs``, or another machine that a study knows.
        kind: of the case.
        seed: which one of that kind.
    """

    rig: str
    kind: str
    seed: int

    @property
    def name(self) -> str:
        """``rig-kind-seed``."""
        return f"{self.rig}-{self.kind}-{self.seed}"


def jobs(counts: Mapping[str, int], rigs: Iterable[str], first: int) -> list[Job]:
    """The cases of a study.

    Args:
        counts: kind -> cases a rig.
        rigs: which; the quick ones go first.
        first: seed of each rig's first case of each kind.
    """
    chosen = [rig for rig in QUICK if rig in set(rigs)]
    order = [
        ((k + 0.5) / counts[kind], chosen.index(rig), KINDS.index(kind), Job(rig, kind, first + k))
        for rig in chosen
        for kind in kinds(rig)
        for k in range(counts.get(kind, 0))
    ]
    return [job for *_, job in sorted(order, key=lambda item: item[:3])]


def pair_jobs(each: int, rigs: Iterable[str], first: int) -> list[Job]:
    """For each rig the first ``each`` cases from seed ``first`` on that hide two effects; all rigs advance together."""
    chosen = [rig for rig in QUICK if rig in set(rigs)]
    seeds = {rig: _hiding_two(rig, each, first) for rig in chosen}
    return [Job(rig, "effect", seeds[rig][k]) for k in range(each) for rig in chosen]


def _hiding_two(rig: str, each: int, first: int) -> list[int]:
    return list(islice((seed for seed in count(first) if len(hidden_in(rig, seed)) == 2), each))
