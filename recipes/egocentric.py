"""Choice of a sensor on an energy budget: chapter 3 of the thesis, and the battery that its end asks for.

    python -m recipes.egocentric [--seed S] [--recorded] [--short]      a minute or two

A phone knows what its owner does from its motion sensors, which cost little and often err, or from its camera. A
recurrent actor-critic learns when to ask which. How fast the battery empties is hidden: a posterior from its log says,
and the policy spends what the battery pays for. Without ``--recorded`` the activities are made up;
with it they are read from ``$ONLINEBAYES_DATA/egocentric``.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import torch

from envs.egocentric import (
    Recorded,
    Sequences,
    cross_fitted,
    fit_motion,
    made_up,
    made_up_predictions,
    read_predictions,
    read_sequences,
)
from envs.egocentric.battery_log import read_battery_log, write_battery_log
from onlinebayes.experiments import Options, place_of, status
from onlinebayes.runs import BadInput, seed_everything
from recipes.sensor_budget import (
    LOG_STEP,
    LOG_STEPS,
    choices,
    day,
    hidden_log,
    log_estimator,
    log_problem,
)
from recipes.sensor_choice import Training, accuracy_at, attachment, folds, leaning, learn, mixed, stretches
from recipes.sensor_recording import record

USES = (0.2, 0.4, 0.6, 0.8)
TRUTH = torch.tensor([300.0, 600.0], dtype=torch.float64)  # a hot phone draws twice what it should [mA]


@dataclass(frozen=True)
class Settings(Options):
    """One run."""

    recorded: bool = False
    """recorded activities in the place of made-up ones"""


def activities(settings: Settings, generator: torch.Generator) -> tuple[Sequences, Recorded]:
    """Sequences, and predictions of vision for each activity."""
    if not settings.recorded:
        return made_up(100, generator), made_up_predictions(generator=generator)
    if not (data := os.environ.get("ONLINEBAYES_DATA")):
        raise BadInput(
            "ONLINEBAYES_DATA is not set", "set it to the folder that holds egocentric/, or leave out --recorded"
        )
    folder = Path(data) / "egocentric"
    return read_sequences(folder / "sensors.csv"), read_predictions(folder / "predictions.csv")


def main(settings: Settings) -> int:
    """Learn to choose, learn what the battery does, spend what it pays for; returns the exit status."""
    seed_everything(settings.seed)
    generator, short = torch.Generator().manual_seed(settings.seed), settings.short
    place = place_of("egocentric", settings)
    sequences, recorded = activities(settings, generator)

    # --- the cheap sensor, as it is in sequences that it never saw -----------
    fold = folds(sequences, 3 if short else 5, generator)
    epochs = 12 if short else 30
    told = next(cross_fitted(sequences, fold, [0], lambda x, y: fit_motion(x, y, generator, epochs=epochs)))
    rate = recorded.vision_rate()
    learnt, test = (stretches(sequences, told, rate, there) for there in (fold != 0, fold == 0))

    # --- when to ask the camera -----------
    objective = learn(learnt, Training(batches=50, learning_rate=1e-2) if short else Training(), settings.seed)
    holds = attachment(objective, test)
    reached, mix = accuracy_at(test, holds, USES), mixed(test, USES)
    for use, ours, theirs in zip(USES, reached.tolist(), mix.tolist(), strict=True):
        print(f"vision in {use:.0%} of the seconds: accuracy {ours:.3f}, of a random mix {theirs:.3f}")

    # --- what the battery does, from a log with gaps -----------
    problem = log_problem()
    log = hidden_log(problem, TRUTH, settings.seed + 1)
    write_battery_log(place / "battery.csv", log[0], LOG_STEP, torch.arange(LOG_STEPS) % 13 == 12)
    estimator = log_estimator(problem, *((60, 4) if short else (200, 15)), settings.seed)
    belief = estimator.condition(read_battery_log(place / "battery.csv", LOG_STEP))
    gain = float(belief.log_prob(TRUTH) - problem.prior.log_prob(TRUTH))
    believed = belief.sample((1000,), generator).mean(0)
    print(f"currents {believed.round().tolist()} mA, truth {TRUTH.tolist()}: {gain:.1f} nats better than the prior")

    # --- a day on a battery -----------
    chosen, days = choices(holds, test), {}
    for name, theta in (("as built", problem.simulator.nominal), ("believed", believed), ("true", TRUTH)):
        days[name] = day(chosen, TRUTH, theta, share=0.3, seed=settings.seed)
        mean = {key: float(getattr(days[name], key).mean()) for key in ("accuracy", "use", "lasted")}
        print(f"currents {name}: " + ", ".join(f"{key} {value:.3f}" for key, value in mean.items()))
    better = float((days["believed"].accuracy - days["as built"].accuracy).mean())
    print(f"knowing the battery is worth {100 * better:.1f} points of accuracy")
    print(f"one episode: {record(place, sequences, test, leaning(objective, test, 0.2, 0.0), TRUTH)}")
    return 0 if bool((reached > mix).all()) and gain > 0 and better > 0 else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
