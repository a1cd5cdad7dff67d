"""Remedies for two rivals that no admissible motion parts: a signal not measured yet, or a mass on a body.

Tried under the inputs that come closest: each signal that the simulator has and the tables lack, read to a thousandth
of its largest value, and half of each body's mass fixed to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.experiment.deciding import PARTED
from onlinebayes.criticism.experiment.inputs import Inputs
from onlinebayes.criticism.experiment.limits import Limits, Payload
from onlinebayes.criticism.experiment.plan import Remedy
from onlinebayes.criticism.experiment.play import FixedModel, admissible, play
from onlinebayes.criticism.experiment.rivals import Pair
from onlinebayes.criticism.experiment.separation import separations
from onlinebayes.measurements import Signal
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.mujoco import MujocoSimulator

ACCURACY = 1e-3
MOST_BODIES = 8


def remedies(pairs: Sequence[Pair], inputs: Inputs, limits: Limits, signals: Sequence[Signal]) -> tuple[Remedy, ...]:
    """List the remedies that would part the two by 4 sigma, best first.

    Args:
        pairs: the two rivals, one or both ways round.
        inputs: the few that come closest.
        limits: of the motion.
        signals: what is measured.
    """
    found = [*_sensors(pairs, inputs, signals), *_payloads(pairs, inputs, limits, signals)]
    return tuple(sorted((r for r in found if r.sigma >= PARTED), key=lambda r: -r.sigma))


def loaded(hypothesis: FixedModel, payload: Payload | None) -> FixedModel:
    """The same with the payload fixed to it; its parameters keep their values."""
    if payload is None:
        return hypothesis
    return replace(hypothesis, simulator=hypothesis.simulator.with_payload(payload.body, payload.mass))


def loaded_pair(pair: Pair, payload: Payload | None) -> Pair:
    """Both rivals with the payload; what the present data say was measured without it, and stays."""
    other = replace(pair.other, hypothesis=loaded(pair.other.hypothesis, payload))
    return replace(pair, truth=loaded(pair.truth, payload), other=other)


def weakest(
    pairs: Sequence[Pair], inputs: Inputs, signals: Sequence[Signal], noise: Tensor | None = None
) -> Float[Tensor, " N"]:
    """The smaller of both ways round, under each input."""
    return torch.stack([separations(pair, inputs, signals, noise).sigma for pair in pairs]).amin(0)


def _sensors(pairs: Sequence[Pair], inputs: Inputs, signals: Sequence[Signal]) -> list[Remedy]:
    simulator, known = pairs[0].truth.simulator, {signal.name for signal in signals}
    read = simulator.read(play(pairs[0].truth, inputs)).abs().amax((0, 1))
    found = []
    for column, name in enumerate(simulator.signals):
        if name in known or float(read[column]) <= 0:
            continue
        sd = ACCURACY * float(read[column])
        present = pairs[0].other.windows
        noise = torch.cat([present.noise, present.noise.new_tensor([sd])])
        sigma = weakest(pairs, inputs, [*signals, Signal(name, sd=sd)], noise)
        found.append(Remedy(f"a sensor of {name} with sd {sd:.2g}", float(sigma.max())))
    return found


def _payloads(pairs: Sequence[Pair], inputs: Inputs, limits: Limits, signals: Sequence[Signal]) -> list[Remedy]:
    found = []
    for payload in _half_masses(pairs[0].truth.simulator):
        heavier = [loaded_pair(pair, payload) for pair in pairs]
        safe = admissible([h for pair in heavier for h in (pair.truth, pair.other.hypothesis)], inputs, limits)
        if safe.count:
            sigma = float(weakest(heavier, safe, signals).max())
            found.append(Remedy(f"a payload of {payload.mass:.3g} kg at body '{payload.body}'", sigma))
    return found


def _half_masses(simulator: Simulator) -> list[Payload]:
    if not isinstance(simulator, MujocoSimulator):
        return []
    model = simulator.model
    moving = [k for k in range(1, model.nbody) if model.body_weldid[k] == k and model.body_mass[k] > 0]
    return [Payload(model.body(k).name, 0.5 * float(model.body_mass[k])) for k in moving[:MOST_BODIES]]
