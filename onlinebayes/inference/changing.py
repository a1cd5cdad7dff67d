"""A belief over the parameters of a machine that may change: it notices, says so, and follows.

    belief = ChangingBelief(estimator)                   # a fitted estimator of mixtures; nothing is known yet
    belief = belief.update(trajectories)                 # (n, T), in the order in which they were made; and so on
    belief.sample((64,)), belief.log_prob(theta)         # of the machine as it is now
    print(belief.in_words())                             # "the machine changed after trajectory 3 (probability 0.998)"

The belief is a mixture over the hypotheses of ``run_length``: since when the machine has been the same. Where it has
not changed, that is the posterior given all trajectories; after a change, the posterior given those that came after.
An update returns a new belief and leaves the old one as it is. It asks the estimator once for all hypotheses
(one call of ``NeuralEstimator.tails``); a planner that updates many times a second gives ``Hazard(together=1)``, which
reads each trajectory once and multiplies, at the price of an overconfident product (see ``neural``).

Where an :class:`~onlinebayes.inference.Alarm` is given, each trajectory is also compared with simulations of all
machines that the prior holds. A machine that changed gives trajectories that some other theta explains; one with an
effect that the model lacks gives trajectories that none does:

| trajectories that ring at 5 %        | changes | in words                                                |
|--------------------------------------|---------|---------------------------------------------------------|
| as many as chance has                | none    | one machine made all                                    |
| as many as chance has                | some    | the machine changed after trajectory k                  |
| more (binomial, probability < 1 %)   | none    | the model lacks an effect                               |
| more                                 | some    | either the model lacks an effect, or the machine changed |
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import torch
from jaxtyping import Float
from scipy.stats import binom
from tensordict import TensorDictBase, pad
from torch import Tensor

from onlinebayes.inference.alarm import Alarm
from onlinebayes.inference.base import Belief, PosteriorEstimator, Tailed
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.distributions.algebra import doubled
from onlinebayes.inference.distributions.kernels import smoothed
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.run_length import Hazard, RunLengths
from onlinebayes.inference.trajectories import TrajectoryKeys
from onlinebayes.runs import BadInput, heed

SURE = 0.95
"""Probability at which a change is said."""

RINGS, CHANCE = 0.05, 0.01
"""p at which a trajectory rings, and probability below which so many rings are no chance."""

DRAWS = 300
"""Draws that stand for a posterior that is no mixture."""


@dataclass(frozen=True)
class Change:
    """The machine changed.

    Args:
        after: number of trajectories that were made before it changed.
        probability: that it had changed, when that was said.
        within: the next trajectory fits neither the machine before nor the one after: it changed while that was made.
    """

    after: int
    probability: float
    within: bool = False

    @property
    def since(self) -> int:
        """Number of the first trajectory of the machine after the change, from 0."""
        return self.after + self.within

    def __str__(self) -> str:
        told = f"(probability {min(self.probability, 0.999):.3f})"
        if self.within:
            return f"the machine changed in trajectory {self.after + 1} {told}, which fits neither side"
        return f"the machine changed after trajectory {self.after} {told}"


@dataclass(frozen=True, eq=False)
class History:
    """Summary of the trajectories so far; a belief can be taken up again with it.

    Args:
        lengths: the hypotheses.
        changes: that were said.
        novelty: the alarm's p of each trajectory that it was asked about.
    """

    lengths: RunLengths
    changes: tuple[Change, ...] = ()
    novelty: tuple[float, ...] = ()

    @property
    def unexplained(self) -> bool:
        """True if more trajectories ring than chance has."""
        return bool(binom.sf(self._rings - 1, len(self.novelty), RINGS) < CHANCE)

    @property
    def _rings(self) -> int:
        return sum(p <= RINGS for p in self.novelty)

    def in_words(self) -> str:
        """One line: the same machine, a changed one, an effect that the model lacks, or either of the last two."""
        number, said = self.lengths.number, "; ".join(map(str, self.changes))
        if not number:
            return "no trajectory yet"
        if not self.unexplained:
            same = 1 - self.lengths.changed(1)
            return said or f"one machine made all {number} trajectories (probability {min(same, 0.999):.3f})"
        lacks = f"{self._rings} of {len(self.novelty)} trajectories are like none of the model's, at any parameters"
        if not said:
            return f"{lacks}: the model lacks an effect"
        return f"{lacks}: either the model lacks an effect, or {said}"

    def after(self, lengths: RunLengths, novelty: tuple[float, ...]) -> History:
        """The history with one more trajectory."""
        changes, before = self.changes, self.changes[-1].since if self.changes else 0
        probability, since = lengths.changed(before + 1), lengths.since
        if probability >= SURE and since > before:
            # A machine that made one trajectory only: that one lies across the change.
            within = bool(changes) and since == before + 1 and not changes[-1].within
            changes = (
                (*changes[:-1], replace(changes[-1], within=True)) if within else (*changes, Change(since, probability))
            )
        return History(lengths, changes, (*self.novelty, *novelty))


class ChangingBelief:
    """See the module.

    Args:
        estimator: fitted over the whole prior; its densities are mixtures, or have draws that are smoothed into one.
        hazard: how machines change.
        alarm: over simulations of the whole prior; without it an effect that the model lacks is not told from a change.
        keys: where trajectories lie in a TensorDict.
        history: of a belief that is taken up again, by another estimator perhaps.
        seen: the trajectories (n, T) of that history, the newest at least.

    Attributes:
        space: the parameters.
        history: what was made of the trajectories.
        seen: the trajectories that are still needed.
        distribution: the mixture over all hypotheses; the uniform one on the estimator's box before any trajectory.

    Raises:
        BadInput: a history without its trajectories.
    """

    def __init__(
        self,
        estimator: PosteriorEstimator,
        hazard: Hazard | None = None,
        *,
        alarm: Alarm | None = None,
        keys: TrajectoryKeys | None = None,
        history: History | None = None,
        seen: TensorDictBase | None = None,
    ) -> None:
        self.space = estimator.space
        self.history = history if history is not None else History(RunLengths(hazard if hazard else Hazard()))
        self._estimator, self._alarm, self._keys = estimator, alarm, keys if keys is not None else TrajectoryKeys()
        lengths, have = self.history.lengths, 0 if seen is None else len(seen)
        if lengths.begins and lengths.number - have > lengths.begins[0]:
            raise BadInput(
                f"a history of {lengths.number} trajectories beside {have} of them",
                f"give the newest {lengths.number - lengths.begins[0]} at least",
            )
        self.seen, self._told = seen, dict[int, TruncatedMixture]()
        if lengths.begins:
            self._told = self._tails(cast(TensorDictBase, seen), lengths.number - have, lengths.begins)
        self.distribution: TruncatedMixture | BoxUniform = (
            lengths.belief(self._told) if lengths.number else BoxUniform(self.space, estimator.box)
        )

    def update(self, trajectories: TensorDictBase) -> ChangingBelief:
        """The belief after more trajectories (n, T) of the machine, in the order in which they were made.

        Raises:
            BadInput: what the estimator refuses; this belief stays as it is.
        """
        belief = self
        for i in range(len(trajectories)):
            heed()
            belief = belief._after(trajectories[i : i + 1])
        return belief

    @property
    def changes(self) -> tuple[Change, ...]:
        """The changes so far that were said, each with a probability of :data:`SURE` at least."""
        return self.history.changes

    @property
    def box(self) -> Box:
        """The box outside of which the density is zero."""
        return self.distribution.box

    def in_words(self) -> str:
        """One line; see the module."""
        return self.history.in_words()

    def sample(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*shape P"]:
        """Theta (*shape, P) of the present machine [units], float64."""
        return self.distribution.sample(shape, generator)

    def log_prob(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """Natural log of the density on the original scale [1 / units]; -inf outside the box."""
        return self.distribution.log_prob(theta)

    def _after(self, new: TensorDictBase) -> ChangingBelief:
        """After one more trajectory (1, T)."""
        lengths = self.history.lengths
        seen = new if self.seen is None else _behind(self.seen, new, self._keys)
        now = self._tails(seen, lengths.number + 1 - len(seen), (*lengths.begins, lengths.number))
        after = lengths.advanced(self._told, now)
        novelty = () if self._alarm is None else tuple(surprise.p for surprise in self._alarm.each(new))
        result = copy.copy(self)
        result.history = self.history.after(after, novelty)
        needed = after.number - (after.begins[0] if after.begins else after.number)
        result.seen = seen[len(seen) - needed :]
        result._told = {begin: now[begin] for begin in after.begins}
        result.distribution = after.belief(result._told)
        return result

    def _tails(self, seen: TensorDictBase, first: int, begins: Sequence[int]) -> dict[int, TruncatedMixture]:
        """Return the posterior given the trajectories from each number on; the first seen has the number ``first``."""
        rows, estimator = [begin - first for begin in begins], self._estimator
        if isinstance(estimator, Tailed):
            found = estimator.tails(seen, rows)
        else:
            found = [estimator.condition(seen[row:]) for row in rows]
        return {begin: _mixture(belief) for begin, belief in zip(begins, found, strict=True)}


def _mixture(belief: Belief) -> TruncatedMixture:
    """A belief as a mixture, in double precision."""
    if isinstance(belief, Posterior):
        belief = belief.distribution
    if isinstance(belief, TruncatedMixture):
        return doubled(belief)
    draws = belief.sample((DRAWS,), torch.Generator().manual_seed(0))
    return smoothed(belief.box.to_frame(draws), torch.full((DRAWS,), 1 / DRAWS, dtype=torch.float64), belief.box)


def _behind(seen: TensorDictBase, new: TensorDictBase, keys: TrajectoryKeys) -> TensorDictBase:
    """Trajectories with another one behind them, padded to the longer of the two."""
    if not len(seen):
        return new
    longest, wanted = max(seen.shape[1], new.shape[1]), [keys.observation, keys.action, keys.following]
    parts = []
    for part in (seen, new):
        whole = part.select(*wanted)
        whole.set(keys.mask, keys.mask_of(part))
        parts.append(pad(whole, [0, 0, 0, longest - part.shape[1]]))
    return torch.cat(parts)
