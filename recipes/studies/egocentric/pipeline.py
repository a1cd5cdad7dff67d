"""Our own pipeline: sequences -> motion predictor -> actor-critic and reference, in two splits.

| split       | test seconds                                                                                 |
|-------------|----------------------------------------------------------------------------------------------|
| by sequence | every sequence once, in five folds; nothing of a test sequence is ever seen                  |
| leaky       | as published: 16 sequences whole, of each other one 3-s block, the rest of which is learnt from |

Motion predictions are out of fold everywhere, for the seconds that policies learn from too. The camera is emulated: in
each second it is right with the rate of the recorded rows of the activity, 792 in all, and no other recording exists.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from tensordict import TensorDictBase
from torch import Tensor

from envs.egocentric import Sequences, Stretches, cross_fitted, fit_motion, gain
from onlinebayes.runs import Progress, atomic_path
from recipes.sensor_choice import Training, attachment, folds, leaning, learn, stretches
from recipes.studies.egocentric.reference import fit_outcomes, outcomes

FOLDS, BLOCK, WHOLE = 5, 3, 16
STRETCHES = ("features", "motion_right", "vision_rate", "length", "sequence")
PARTS = ("learning", "reference", "looking")
TRADE_OFFS = (0.0, 0.1, 0.2, 0.3, 0.4)


@dataclass
class Seen:
    """Results of a split, all test stretches together.

    Attributes:
        test: the stretches.
        policy, reference: what ranks their seconds.
        chosen: name of the chooser -> lambda -> where it asks the camera at no cost.
        leaning: log odds of the camera at lambda = .2.
        learning: (episodes, mean reward, share of the camera) of each batch of the first training.
        seconds: of processor time, by :data:`PARTS`.
    """

    test: Stretches
    policy: Float[Tensor, "E T"]
    reference: Float[Tensor, "E T"]
    chosen: dict[str, dict[float, Tensor]]
    leaning: Float[Tensor, "E T"]
    learning: list[tuple[int, float, float]] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)


def leaky(sequences: Sequences, generator: torch.Generator) -> Int[Tensor, "S T"]:
    """Folds of 3-s blocks; fold 0 is the test: one block of most sequences, all of some."""
    number, steps = sequences.signals.shape[:2]
    blocks = -(-steps // BLOCK)
    fold = torch.stack([torch.randperm(blocks, generator=generator) for _ in range(number)])
    fold[torch.randperm(number, generator=generator)[:WHOLE]] = 0
    return fold.repeat_interleave(BLOCK, 1)[:, :steps]


def motion_predictions(
    sequences: Sequences, fold: Int[Tensor, "S T"], tests: range, place: Path, seed: int
) -> list[Float[Tensor, "S T 20"]]:
    """Out-of-fold predictions for each test fold; kept in ``place``, as they take a minute."""
    made = []
    generator = torch.Generator().manual_seed(seed)
    files = [place / f"motion-{seed}-{k}.npy" for k in tests]
    if all(file.exists() for file in files):
        return [torch.from_numpy(np.load(file)) for file in files]
    with Progress("motion predictors", len(tests)) as progress:
        for k, told in enumerate(
            cross_fitted(sequences, fold, tests, lambda signals, label: fit_motion(signals, label, generator))
        ):
            made.append(told)
            progress.update(k + 1)
    for file, told in zip(files, made, strict=True):
        with atomic_path(file) as temporary, temporary.open("wb") as stream:
            np.save(stream, told.numpy())
    return made


def split(
    name: str, sequences: Sequences, rate: Float[Tensor, " 20"], training: Training, place: Path, seed: int
) -> Seen:
    """Train and look, in one of the two splits."""
    generator = torch.Generator().manual_seed(seed)
    fold = leaky(sequences, generator) if name == "leaky" else folds(sequences, FOLDS, generator)
    tests = range(1 if name == "leaky" else FOLDS)
    predicted = motion_predictions(sequences, fold, tests, place / name.replace(" ", "-"), seed)
    parts = []
    for k, told in zip(tests, predicted, strict=True):
        file = place / name.replace(" ", "-") / f"seen-{seed}-{k}-{training.batches}.npz"
        if not file.exists():
            learnt, test = (stretches(sequences, told, rate, there) for there in (fold != k, fold == k))
            keep(file, _one(learnt, test, training, seed + k))
        parts.append(kept(file))
    return _together(parts)


def _one(learnt: Stretches, test: Stretches, training: Training, seed: int) -> Seen:
    began, learning = time.process_time(), list[tuple[int, float, float]]()

    def watch(batch: TensorDictBase) -> None:
        reward, used = batch["next", "reward"].mean(), batch["action"].float().mean()
        learning.append((training.worlds * (len(learning) + 1), float(reward), float(used)))

    policy = learn(learnt, training, seed, watch)
    learnt_at = time.process_time()
    probability = outcomes(fit_outcomes(learnt, seed), test)
    fitted_at = time.process_time()
    chosen = {
        "actor-critic": {trade: leaning(policy, test, trade, 0.0) > 0 for trade in TRADE_OFFS},
        "reference": {trade: gain(probability, trade) > 0 for trade in TRADE_OFFS},
    }
    ranked = attachment(policy, test)
    seen = Seen(test, ranked, gain(probability, 1.0), chosen, leaning(policy, test, 0.2, 0.0), learning)
    spent = (learnt_at - began, fitted_at - learnt_at, time.process_time() - fitted_at)
    seen.seconds = dict(zip(PARTS, spent, strict=True))
    return seen


def keep(file: Path, seen: Seen) -> None:
    """Write what came of a fold, so that a study that was stopped goes on behind it."""
    arrays = {f"test.{name}": getattr(seen.test, name) for name in STRETCHES}
    arrays |= {name: getattr(seen, name) for name in ("policy", "reference", "leaning")}
    arrays |= {f"chosen.{who}": torch.stack(list(chosen.values())) for who, chosen in seen.chosen.items()}
    arrays["learning"] = torch.tensor(seen.learning, dtype=torch.float64)
    arrays["seconds"] = torch.tensor([seen.seconds[part] for part in PARTS], dtype=torch.float64)
    with atomic_path(file) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **{name: values.numpy() for name, values in arrays.items()})


def kept(file: Path) -> Seen:
    """Read the results that :func:`keep` wrote."""
    with np.load(file, allow_pickle=False) as stream:
        arrays = {name: torch.from_numpy(stream[name]) for name in stream.files}
    test = Stretches(*(arrays[f"test.{name}"] for name in STRETCHES))
    chosen = {
        who: dict(zip(TRADE_OFFS, arrays[f"chosen.{who}"].unbind(0), strict=True))
        for who in ("actor-critic", "reference")
    }
    learning = [(int(episodes), reward, used) for episodes, reward, used in arrays["learning"].tolist()]
    seconds = dict(zip(PARTS, arrays["seconds"].tolist(), strict=True))
    return Seen(test, arrays["policy"], arrays["reference"], chosen, arrays["leaning"], learning, seconds)


def _together(parts: list[Seen]) -> Seen:
    """The test stretches of all folds as one."""
    test = Stretches(*(torch.cat([getattr(part.test, name) for part in parts]) for name in STRETCHES))
    chosen = {
        who: {trade: torch.cat([part.chosen[who][trade] for part in parts]) for trade in TRADE_OFFS}
        for who in parts[0].chosen
    }
    policy, reference, leans = (
        torch.cat([getattr(part, name) for part in parts]) for name in ("policy", "reference", "leaning")
    )
    seconds = {name: sum(part.seconds[name] for part in parts) for name in parts[0].seconds}
    return Seen(test, policy, reference, chosen, leans, parts[0].learning, seconds)
