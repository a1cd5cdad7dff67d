"""How large an effect must be: for each rig the medium sizes at which the refitted base model errs 2.8 times too much.

    (e / e0)^2 - 1 ~ s^2,      s <- s sqrt((2.8^2 - 1) / ((e / e0)^2 - 1))

e is the held-out error of the base model, e0 the same on a case with nothing hidden; fewer runs than the rig's own are
enough for both. Each further step takes another seed of the tuning ones, for commands and base parameters differ from
case to case; the result is the geometric mean of the last two proposals, or the first one where the law need not reach
far from what was measured. What is not as linear as that (limits, dead zones) is halved between a size that was too
small and one that was too large. The effects of ties are measured with what the tie fixes fixed; so are numbers of the
model that are off, which are sized alike.

    python -m recipes.studies.blind_rigs.sizes --rigs swing thrown_ball          prints what to write into envs/rigs
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

from envs.rigs import RIGS, HiddenEffect, OffNumber, Rig, Tie, sized_case
from onlinebayes.experiments import status
from onlinebayes.runs import BadInput
from recipes.studies.blind_rigs.judging import loaded
from recipes.studies.blind_rigs.truth import base_error

MEDIUM = 2.8
FARTHEST = 8.0  # factor of one step
NEAR = 2.0  # ratio up to which the law is trusted, from either side
SEED = 900
FIT, HELD = 4, 3  # runs


@dataclass(frozen=True)
class Calibration:
    """What to calibrate.

    Args:
        rigs: which.
        effects: keys, or none for all of a rig.
        steps: cases an effect at most; the last two decide.
    """

    rigs: tuple[str, ...] = tuple(RIGS)
    effects: tuple[str, ...] = ()
    steps: int = 2


@dataclass(frozen=True)
class Sized:
    """An effect with its new size.

    Args:
        effect: as it stands, or a number that is off.
        scale: by which its medium size must be multiplied.
        ratios: that the steps measured, the first one at the size as it stands.
    """

    effect: HiddenEffect | OffNumber
    scale: float
    ratios: tuple[float, ...]

    @property
    def text(self) -> str:
        """The sizes to write into the rig, two digits."""
        resized = self.effect.resized(self.scale)
        if isinstance(resized, OffNumber):
            return f"{resized.key} {resized.size:.2g}"
        sizes = {name: float(f"{value:.2g}") for name, value in resized.size.items()}
        return f"{resized.key} {sizes}"


def calibrate(rig: Rig, effects: tuple[HiddenEffect | OffNumber, ...], steps: int) -> Iterator[Sized]:
    """The new sizes of a rig's effects, one after the other."""
    rig = replace(rig, protocol=replace(rig.protocol, fit=FIT, held=HELD))
    quiet = cache(lambda k: error_at(rig, None, 1.0, SEED + k))
    for effect in effects:
        tried: list[tuple[float, float]] = []
        proposals = [1.0]
        for k in range(steps):
            scale = proposals[-1]
            tried.append((scale, error_at(rig, effect, scale, SEED + k) / quiet(k)))
            proposals.append(next_scale(tried))
            if MEDIUM / NEAR <= tried[-1][1] <= MEDIUM * NEAR:
                break
        last = proposals[1:][-2:]
        yield Sized(effect, math.prod(last) ** (1 / len(last)), tuple(ratio for _, ratio in tried))


def error_at(rig: Rig, effect: HiddenEffect | OffNumber | None, scale: float, seed: int) -> float:
    """Held-out error of the base model, fitted to a case with that effect [floors]; infinite where it diverges."""
    try:
        return base_error(loaded(sized_case(rig, effect, scale, seed)))
    except BadInput:
        return math.inf


def next_scale(tried: Sequence[tuple[float, float]]) -> float:
    """The scale at which the ratio should be medium, from the pairs (scale, ratio) so far."""
    scale, ratio = tried[-1]
    excess = max(ratio**2 - 1, 0.05)  # a size that shows nothing says only that it is far too small
    factor = math.sqrt((MEDIUM**2 - 1) / excess) if math.isfinite(excess) else 1 / FARTHEST
    proposed = scale * min(max(factor, 1 / FARTHEST), FARTHEST)
    low = max((s for s, r in tried if r < MEDIUM), default=0.0)
    high = min((s for s, r in tried if r >= MEDIUM), default=math.inf)
    return proposed if low <= proposed <= high else math.sqrt(low * high)


def tied(rig: Rig, asked: Tie | OffNumber) -> Rig:
    """The rig as the cases of a tie, or of a number that is off, have it: what would look alike is not free."""
    return replace(rig, free={name: bound for name, bound in rig.free.items() if name not in asked.fixed})


def questions(rig: Rig, keys: Sequence[str]) -> Iterator[tuple[Rig, tuple[HiddenEffect | OffNumber, ...]]]:
    """The rig with all that may hide in it, or with these keys of it, ties and numbers each on its own."""
    known: tuple[tuple[Rig, tuple[HiddenEffect | OffNumber, ...]], ...] = (
        (rig, (*rig.effects, *rig.last, *rig.by_name, *rig.outside)),
        *((tied(rig, tie), (tie.hidden,)) for tie in rig.ties),
        *((tied(rig, off), (off,)) for off in (*rig.surplus, *rig.own)),
    )
    for posed, effects in known:
        if wanted := tuple(effect for effect in effects if not keys or effect.key in keys):
            yield posed, wanted


def main(calibration: Calibration) -> None:
    """Print rig, effect, measured ratios and the new sizes."""
    for name in calibration.rigs:
        began = time.monotonic()
        for rig, effects in questions(RIGS[name], calibration.effects):
            for sized in calibrate(rig, effects, calibration.steps):
                ratios = " ".join(f"{ratio:.2f}" for ratio in sized.ratios)
                print(f"{name} {sized.text}   ({ratios}) [{time.monotonic() - began:.0f} s]", flush=True)


if __name__ == "__main__":
    sys.exit(status(main, Calibration, __doc__))
