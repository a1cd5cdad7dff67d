"""What is asked of new logs: each number that may have changed, as one direction.

The parameters of the refined model first, then those of the model's own numbers that wear, loads and repairs change,
then effects that a machine can come to have: a sensor's zero, friction, a payload, a steady load, a weaker drive. Of
directions that do the same the first one stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.checking.held import Held, columns_of
from onlinebayes.criticism.hypotheses.additions import AddedEffect, FreedNumber
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.judging.hypothesis import Addition
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

NUMBERS = (".mass", ".damping", ".frictionloss", ".stiffness", ".gear[0]", ".kp", ".kv")
"""Ends of the addresses of the model's own numbers that are asked."""

EFFECTS = ("sensor_bias", "dry_friction", "viscous_friction", "payload", "constant_load", "actuator_gain")
"""Effects that are asked, at every target."""

SCALES_HORIZON = 2.0
"""Seconds of the windows from which effects take their bounds."""

SAME = 0.995
"""Cosine above which two directions do the same."""

SILENT = 1e-3
"""Of what is left, by which a change of the largest size moves the rows at most: it moves nothing."""


@dataclass(frozen=True)
class MayChange:
    """One number that may have changed.

    Args:
        key: its name: an address, or ``name@target.parameter``.
        unit: SI unit.
        value: in the refined model [unit].
        low, high: bounds [unit].
        addition: what brings it in; None for a parameter of the refined model.
        alike: keys of others that do the same in these logs.
    """

    key: str
    unit: str
    value: float
    low: float
    high: float
    addition: Addition | None = None
    alike: tuple[str, ...] = ()


def additions_to(simulator: Identifiable, measurement: Measurement) -> list[Addition]:
    """The numbers and effects that are asked beside the parameters."""
    numbers = [
        FreedNumber(address, bounds)
        for address, bounds in simulator.own_numbers.items()
        if address.endswith(NUMBERS) and bounds.low < bounds.high
    ]
    windows = make_windows(simulator, measurement, SCALES_HORIZON)
    known = {**simulator.parameters}
    effects = [one for one in propose(simulator, windows, list(EFFECTS)) if not _free_already(one.key, known)]
    return [*numbers, *(AddedEffect(effect) for effect in effects)]


def _free_already(effect: str, parameters: Mapping[str, object]) -> bool:
    """Check whether a parameter of the model is this effect's number under the model's own name."""
    name, _, target = effect.partition("@")
    own = {"viscous_friction": f"joint.{target}.damping", "dry_friction": f"joint.{target}.frictionloss"}
    return own.get(name) in parameters


def directions(held: Held, additions: Sequence[Addition]) -> tuple[list[MayChange], Float[Tensor, "W m C"]]:
    """Everything that may change, and what each would do to the windows.

    Args:
        held: the reference.
        additions: beside the parameters.
    """
    space, theta = held.simulator.parameters, held.lin.theta
    found = [
        MayChange(name, space[name].unit, float(theta[k]), space[name].low, space[name].high)
        for k, name in enumerate(space)
    ]
    moved, kept = columns_of(held, additions)
    for addition in kept:
        start = addition.starts(addition.joined(held.simulator, held.windows.runs), {})[0]
        ends = (start.neutral + start.low * start.reach, start.neutral + start.high * start.reach)
        (name,) = start.sized
        joined = addition.joined(held.simulator, held.windows.runs).parameters
        found.append(MayChange(name, joined[name].unit, start.neutral, min(ends), max(ends), addition))
    columns = torch.cat([held.rows.columns, moved], -1)
    return _told_apart(held, found, columns, len(space))


def _told_apart(
    held: Held, found: list[MayChange], columns: Float[Tensor, "W m A"], fitted: int
) -> tuple[list[MayChange], Float[Tensor, "W m C"]]:
    """Without those that nothing shows, and each of those that do the same once; all fitted parameters stay."""
    flat = columns.flatten(0, 1)
    left, norm = float(held.rows.residual.norm()), flat.norm(dim=0)
    cosine = (flat.T @ flat / (norm[:, None] * norm).clamp_min(1e-300)).abs()
    kept: list[int] = []
    alike: dict[int, list[str]] = {}
    for i, one in enumerate(found):
        same = [j for j in kept if float(cosine[i, j]) > SAME]
        farthest = max(one.high - one.value, one.value - one.low)
        if i >= fitted and same:
            alike.setdefault(same[0], []).append(one.key)
        elif i < fitted or float(norm[i]) * farthest > SILENT * left:
            kept.append(i)
    changes = [MayChange(**{**vars(found[i]), "alike": tuple(alike.get(i, ()))}) for i in kept]
    return changes, columns[..., kept]
