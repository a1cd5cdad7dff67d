"""Does the alarm ring where a hidden effect misleads the posterior, and only there?

    theta ~ prior, size ~ U(0, largest);  x: with the effect,  x': without it, same theta, same random numbers
    away = max_p | mean(theta_p | x) - mean(theta_p | x') | / sd(theta_p | x')

Effects that another value of the parameters imitates exactly (a weaker motor is a heavier pendulum) cannot be seen by
any alarm, and are not among these.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.inference import Alarm, BoxUniform
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, Effect, QuadraticDrag
from onlinebayes.trainers import Listed
from recipes.studies.one_round import OneRound, begun, mixture

MEASUREMENTS, SIMULATIONS, DRAWS = 100, 1000, 1000

SIZES: dict[str, tuple[Effect, ...]] = {
    "pendulum": (
        DryFriction("hinge", Parameter(0.0, 0.5, "N m")),
        ActuatorDelay("motor", Parameter(0.0, 0.15, "s")),
        QuadraticDrag("hinge", Parameter(0.0, 0.05, "N m s2")),
    ),
    "cartpole": (
        DryFriction("cart", Parameter(0.0, 3.0, "N")),
        ActuatorDelay("motor", Parameter(0.0, 0.06, "s")),
        QuadraticDrag("cart", Parameter(0.0, 3.0, "N s2/m2")),
    ),
}
"""Hidden effects of each system, with sizes up to a part of the motor's force and a few steps."""


def way(task: str, seed: int, noise: float) -> dict[str, Any]:
    """For each measurement: by how many standard deviations the effect moves the posterior, and whether it rings."""
    draw = begun(seed)
    one = OneRound.of(task, seed, noise)
    simulated = one.simulated(SIMULATIONS)
    estimator = mixture(one, one.filtered())
    estimator.fit(simulated, generator=draw)
    alarm = Alarm(estimator.loss.embedding, simulated)
    result: dict[str, Any] = {"clean": [], "rings": [], "away": [], "effect": []}
    for which, effect in enumerate(SIZES[task]):
        theta = one.problem.prior.sample((MEASUREMENTS,), draw)
        size = torch.rand(MEASUREMENTS, 1, generator=draw, dtype=theta.dtype)
        clean = measured(one, effect, theta, 0 * size, 20 + which)
        strange = measured(one, effect, theta, size, 20 + which)
        result["clean"] += [bool(surprise) for surprise in alarm.each(clean)]
        result["rings"] += [bool(surprise) for surprise in alarm.each(strange)]
        before, after = (estimator.each(x[:, None]).sample((DRAWS,), draw) for x in (clean, strange))
        result["away"] += ((after.mean(0) - before.mean(0)).abs() / before.std(0)).amax(-1).tolist()
        result["effect"] += [effect.key] * MEASUREMENTS
    return result


def measured(
    one: OneRound, effect: Effect, theta: Float[Tensor, "B P"], size: Float[Tensor, "B 1"], which: int
) -> TensorDict:
    """Trajectories of worlds that have the effect, its size a share of its largest; without their theta."""
    grown = one.problem.simulator.with_effect(effect)
    (bounds,) = effect.parameters.values()
    values = torch.cat([theta, bounds.low + size * (bounds.high - bounds.low)], dim=1)
    problem = replace(one.problem, simulator=grown, prior=BoxUniform(grown.parameters))
    worlds = replace(one, problem=problem).worlds(len(theta), which)
    torch.manual_seed(one.seed + which)
    return worlds.draw([one.policy], Listed(values)).exclude("theta")
