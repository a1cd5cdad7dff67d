"""A record without any effect is refined; effects of 1.5 times its limits are put into it, one by one, and looked for.

Only effects of one size, which is the parameter that the limit is about; not limits, which shrink as the effect grows,
nor thermal derating, whose size is counted in a reference force of the library's own choice.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
import torch

from envs.rigs import RIGS, BlindCase, HiddenEffect, Rig, sized_case
from onlinebayes.cli.problem import Problem
from onlinebayes.criticism import Criticism, propose
from onlinebayes.identification import make_windows, split
from onlinebayes.simulators.effects import EFFECTS
from recipes.studies.blind_rigs.judging import loaded, refined, why_not
from recipes.studies.blind_rigs.names import spelt
from recipes.studies.exclusion_limits.record import TIMES, Probe, Record
from recipes.studies.job import Job

OF_ANOTHER_UNIT = {"thermal_derating"}


@final
@dataclass(frozen=True)
class Prober:
    """What probes a record in a process of its own.

    Args:
        each: effects a record at most.
        code: the mark that the results get.
    """

    each: int
    code: str = ""

    def __call__(self, job: Job) -> Record:
        """Refine the record without any effect, and once more with each of some.

        Raises:
            BadInput: the library refuses the record.
        """
        torch.set_num_threads(1)
        rig = RIGS[job.rig]
        problem = loaded(sized_case(rig, None, 1.0, job.seed))
        null, _ = _refined(problem)
        limits = {c.effect: c.exclusion_limit for c in null.candidates if c.exclusion_limit is not None}
        asked = of_one_size(rig, job.seed * self.each)
        scales = [_scale(effect, problem, limits) for effect in asked]
        known = [(effect, scale) for effect, scale in zip(asked, scales, strict=True) if scale is not None]
        return Record(
            rig=job.rig,
            seed=job.seed,
            verdict=null.verdict,
            limited=len(known),
            unlimited=tuple(_name(effect) for effect, scale in zip(asked, scales, strict=True) if scale is None),
            probes=tuple(
                self._probe(sized_case(rig, effect, scale, job.seed), limits[_name(effect)])
                for effect, scale in known[: self.each]
            ),
        )

    def _probe(self, made: BlindCase, limit: float) -> Probe:
        """The record with the effect in it, refined."""
        effect = spelt(made.hidden[0], made.truth)
        result, seconds = _refined(loaded(made))
        first = next((candidate for candidate in result.candidates if candidate.rank == 1), None)
        equal = next((c.indistinguishable_from for c in result.candidates if c.effect in result.accepted[:1]), ())
        return Probe(
            rig=made.rig,
            seed=made.seed,
            effect=effect,
            limit=limit,
            verdict=result.verdict,
            accepted=result.accepted,
            first=first.effect if first else "",
            equal=equal,
            refused=why_not(result.candidates, [effect]).get(effect, ""),
            seconds=seconds,
            code=self.code,
        )


def of_one_size(rig: Rig, begin: int) -> list[HiddenEffect]:
    """The rig's effects whose size one value tells, shuffled once for the rig, and turned to begin with this one."""
    single = [
        effect
        for effect in (*rig.effects, *rig.last)
        if len(effect.size) == 1 and not effect.shrinks and effect.key.split("@")[0] in {*EFFECTS} - OF_ANOTHER_UNIT
    ]
    order = np.random.default_rng(zlib.crc32(f"{rig.name} limits".encode())).permutation(len(single))
    return [single[k] for k in np.roll(order, -begin)]


def _name(effect: HiddenEffect) -> str:
    return spelt(effect.key, effect.values(1.0))


def _scale(effect: HiddenEffect, problem: Problem, limits: Mapping[str, float]) -> float | None:
    """By what the effect's medium size must be multiplied; None where no limit is given, or too large a one."""
    key = _name(effect)
    if key not in limits:
        return None
    runs, _ = split(problem.measurement, problem.holdout)
    (proposed,) = propose(problem.simulator, make_windows(problem.simulator, runs, problem.selection.horizon_s), [key])
    bounds, neutral = proposed.parameters[proposed.magnitude], proposed.neutral[proposed.magnitude]
    medium, size = effect.size.get(proposed.magnitude), TIMES * limits[key]
    if medium is None or size > max(bounds.high - neutral, neutral - bounds.low):
        return None
    return size / abs(medium)


def _refined(problem: Problem) -> tuple[Criticism, float]:
    """What refine says, and its processor time [s]."""
    began = time.process_time()
    result = refined(problem)
    return result, time.process_time() - began
