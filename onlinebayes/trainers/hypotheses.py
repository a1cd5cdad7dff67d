"""The models that a critic leaves open, with a weight each, and how a new real trajectory changes the weights.

    w_k <- w_k exp(-S_k(x)) / sum_j w_j exp(-S_j(x))        for every trajectory x that no model was fitted to

S_k is the score by which criticism judges what was left out: half the log of the mean square error plus one, in units
of the sensors' noise, added over the signals. A trajectory counts as one observation, however many rows it has, for
their errors hang together; an error that is halved in one signal doubles a weight, and below the noise nothing counts.
That is a Bayesian update with a loss in the place of the log likelihood (Bissiri, Holmes and Walker 2016), of
predictions made before the trajectory was seen (Dawid 1984). The first weights are those of the critic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators import Simulator
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.effects.plain import from_plain

UNMOVED = ("signal", "parameter")
"""Kinds of target whose effects change how a world is seen, or when, but not how it moves."""

CLEAR = 10.0
"""Times the weight of the next one that the heaviest hypothesis has where it is clear."""

LEAST = 1e-3
"""A weight does not fall lower, so that later trajectories can take back what earlier ones said."""


@dataclass(frozen=True)
class OpenHypothesis:
    """One model that is open.

    Args:
        effects: that it adds to the first model, as plain values.
        values: fitted parameters by name, old and new [SI].
        weight: how far it is to be believed, between 0 and 1.
    """

    effects: tuple[Mapping[str, Any], ...]
    values: Mapping[str, float]
    weight: float

    @property
    def keys(self) -> tuple[str, ...]:
        """``name@target`` of what it adds."""
        return tuple(f"{effect['name']}@{effect['target']}" for effect in self.effects)

    def added_to(self, simulator: Simulator) -> tuple[Effect, ...]:
        """Its effects, by the vocabulary and the simulator's own laws."""
        own = simulator.own_effects if isinstance(simulator, Extensible) else {}
        return tuple(from_plain(effect, {**EFFECTS, **own}) for effect in self.effects)

    def moves(self, simulator: Simulator) -> bool:
        """Check whether the hypothesis changes the motion of worlds; else it changes only sensors and moments."""
        return all(effect.target_kind not in UNMOVED for effect in self.added_to(simulator))


@dataclass(frozen=True)
class OpenHypotheses:
    """Two or more of them; their weights add up to 1.

    Args:
        each: the hypotheses.
        noise: floor of each signal in the log that they were fitted to [its unit].
        horizon: length of that log's windows [s].
    """

    each: tuple[OpenHypothesis, ...]
    noise: Mapping[str, float]
    horizon: float

    @property
    def weights(self) -> dict[str, float]:
        """The weight of each hypothesis, by the keys that it adds, joined by ``" + "``."""
        return {" + ".join(one.keys): one.weight for one in self.each}

    @property
    def words(self) -> str:
        """The weights in a line, the heaviest first."""
        ordered = sorted(self.weights.items(), key=lambda one: -one[1])
        return ", ".join(f"{name} {weight:.2f}" for name, weight in ordered)

    @property
    def clear(self) -> OpenHypothesis | None:
        """The heaviest, where it weighs :data:`CLEAR` times as much as any other."""
        first, second, *_ = sorted(self.each, key=lambda one: -one.weight)
        return first if first.weight >= CLEAR * second.weight else None

    def after(self, scores: Float[Tensor, "n K"]) -> OpenHypotheses:
        """With weights that know n more trajectories.

        Args:
            scores: S of each trajectory under each hypothesis [nats]; inf where its replay diverges, and a trajectory
                that none can replay tells nothing.
        """
        told = scores[scores.isfinite().any(1)]
        weight = torch.tensor([one.weight for one in self.each], dtype=torch.float64).clamp_min(LEAST)
        for row in told:
            weight = torch.softmax(weight.log() - row.to(weight), dim=0).clamp_min(LEAST)
        weight = weight / weight.sum()
        each = (replace(one, weight=w) for one, w in zip(self.each, weight.tolist(), strict=True))
        return replace(self, each=tuple(each))

    def to_plain(self) -> dict[str, Any]:
        """As plain values, for a checkpoint."""
        return asdict(self)


def open_from_plain(values: Mapping[str, Any] | None) -> OpenHypotheses | None:
    """Restore the hypotheses that :meth:`OpenHypotheses.to_plain` wrote down; None where nothing was open."""
    if values is None:
        return None
    each: Sequence[Mapping[str, Any]] = values["each"]
    made = (OpenHypothesis(tuple(one["effects"]), dict(one["values"]), one["weight"]) for one in each)
    return OpenHypotheses(tuple(made), dict(values["noise"]), values["horizon"])
