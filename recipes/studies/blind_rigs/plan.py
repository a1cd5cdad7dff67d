"""Which cases are judged and in which order: all kinds and rigs advance together, so that a part is a sample."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import count, islice

from envs.rigs import KINDS, hidden_in, kinds
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.job import Job

REPORTED = 7900
"""Seed of a rig's first reported case of a kind; with those below the search was tuned, or they were looked at."""
QUICK = (
    *("thrown_ball", "swing", "position_servo", "slide_drive"),
    *("cart_pole", "two_link_arm", "pushed_block", "six_joint_arm"),
)


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


def seconds_to_go(found: Iterable[Judged], todo: Iterable[Job], processes: int) -> float:
    """How long the rest takes [s]: each rig at its own mean so far, one that was not seen yet at the longest."""
    times: dict[str, list[float]] = {}
    for judged in found:
        times.setdefault(judged.rig, []).append(judged.seconds)
    mean = {rig: sum(spent) / len(spent) for rig, spent in times.items()}
    longest = max(mean.values(), default=0.0)
    return sum(mean.get(job.rig, longest) for job in todo) / processes


def in_words(seconds: float) -> str:
    """``3 h 20 min``, ``5 min``."""
    minutes = max(1, round(seconds / 60))
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"
