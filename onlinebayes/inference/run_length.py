"""Since when has the machine been the one that it is? The probability of each answer, trajectory by trajectory.

    p(r_t, x_1:t) = sum over r_t-1 of  p(r_t | r_t-1) p(x_t | r_t-1, x_1:t-1) p(r_t-1, x_1:t-1)

r_t is the run length, the number of trajectories that the present theta has made (Adams and MacKay 2007, Bayesian
online changepoint detection). With hazard h a new theta begins at t; a share s of the new ones is a small step away
from the old one, the others are drawn from the prior:

| theta         | probability | what is known of it before x_t                          |
|---------------|-------------|---------------------------------------------------------|
| stays         | 1 - h       | q(theta | x_since ... x_t-1)                            |
| takes a step  | h s         | the whole belief at t - 1, plus N(0, step^2)            |
| is drawn anew | h (1 - s)   | the prior                                               |

The evidence p(x_t | ...) / p(x_t) = integral of q(theta | before) q(theta | x_t) / p(theta) is an overlap of two
posteriors (see ``distributions.algebra``): any estimator of mixtures gives it, and no likelihood is asked for. The
prior is uniform on the parameters' bounds. An estimator of a smaller box is thought to have been asked about a
trajectory that nothing outside of it makes. Hypotheses that hardly count are left out, so that the work does not grow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from onlinebayes.inference.distributions import TruncatedMixture
from onlinebayes.inference.distributions.algebra import (
    doubled,
    heaviest,
    in_box,
    log_overlap,
    product,
    stepped,
    weighed,
)
from onlinebayes.runs import BadInput

NEGLIGIBLE = 1e-6
"""Probability below which a hypothesis is left out: a machine that came back would have to be begun anew."""

COMPONENTS = 16
"""Of what is known before a step, and of a product: those left out are lighter by far."""

Told = Mapping[int, TruncatedMixture]
"""Number of a trajectory, from 0 -> the posterior given it and all that came after it."""


@dataclass(frozen=True)
class Hazard:
    """Model of the machine's changes, and limits of the memory.

    Args:
        rate: h, the probability that theta changes between two trajectories.
        small: s, the share of changes that are small.
        step: standard deviation of a small one in each parameter [widths of its bounds].
        keep: hypotheses that are kept, at most.
        together: trajectories of one machine that the estimator reads at once; what it said of older ones is kept as a
            density, and multiplied. Bounds time and memory of a run without end; 1 for the fastest update.

    Raises:
        BadInput: a probability outside (0, 1), a step that is not positive, or too few hypotheses or trajectories.
    """

    rate: float = 0.003
    small: float = 0.5
    step: float = 0.15
    keep: int = 8
    together: int = 60

    def __post_init__(self) -> None:
        sound = 0 < self.rate < 1 and 0 < self.small < 1 and self.step > 0
        if not sound or self.keep < 3 or self.together < 1:
            raise BadInput(f"{self}", "needs 0 < rate < 1, 0 < small < 1, step > 0, keep >= 3 and together >= 1")


@dataclass(frozen=True, eq=False)
class Run:
    """One hypothesis: the present theta has made all trajectories since one of them.

    Args:
        since: number of its first trajectory, from 0.
        log_weight: log of its probability.
        start: what is known of theta without the trajectories that are yet to be read; None for the prior.
        unread: number of the first trajectory that ``start`` does not know of.
    """

    since: int
    log_weight: float
    start: TruncatedMixture | None = None
    unread: int = 0

    def posterior(self, told: Told) -> TruncatedMixture:
        """Return the posterior if this holds; ``told`` may lack :attr:`unread` where there is no trajectory yet."""
        new = told.get(self.unread)
        if new is None:
            assert self.start is not None
            return self.start
        return doubled(new) if self.start is None else product([in_box(self.start, new.box), new], keep=COMPONENTS)


@dataclass(frozen=True, eq=False)
class RunLengths:
    """The hypotheses after some trajectories, likeliest first; a frozen value.

    Args:
        hazard: how machines change.
        number: of trajectories so far.
        runs: the hypotheses; their probabilities sum to one.
    """

    hazard: Hazard
    number: int = 0
    runs: tuple[Run, ...] = (Run(0, 0.0),)

    @property
    def begins(self) -> tuple[int, ...]:
        """Numbers of the trajectories from which on somebody has to read."""
        return tuple(sorted({run.unread for run in self.runs if run.unread < self.number}))

    @property
    def since(self) -> int:
        """Number of the likeliest first trajectory of the present machine, from 0."""
        return max(range(self.number + 1), key=lambda k: self.changed(k) - self.changed(k + 1))

    def changed(self, after: int) -> float:
        """Probability that the present machine has made none of the first ``after`` trajectories."""
        return sum(math.exp(run.log_weight) for run in self.runs if run.since >= after)

    def belief(self, told: Told) -> TruncatedMixture:
        """The mixture over all hypotheses; ``told`` has :attr:`begins`."""
        found = [run.posterior(told) for run in self.runs]
        box = next((one.box for one in told.values()), found[0].box)
        return weighed([in_box(one, box) for one in found], [run.log_weight for run in self.runs])

    def advanced(self, before: Told, now: Told) -> RunLengths:
        """The hypotheses after one more trajectory.

        Args:
            before: posteriors without it, for all of :attr:`begins`; not read where it is the first.
            now: those with it, and the one given it alone.
        """
        found = self._weighed(before, now[self.number]) if self.number else self.runs
        kept = _kept(found, self.hazard.keep)
        return replace(self, number=self.number + 1, runs=tuple(self._folded(run, now) for run in kept))

    def _weighed(self, before: Told, alone: TruncatedMixture) -> list[Run]:
        """List the hypotheses after the trajectory number t, with the logs of their weights."""
        t, h = self.number, self.hazard
        known = [run.posterior(before) for run in self.runs]
        inside = [in_box(one, alone.box) for one in known]
        start = stepped(heaviest(weighed(inside, [run.log_weight for run in self.runs]), COMPONENTS), h.step)
        return [
            *(
                replace(run, log_weight=run.log_weight + math.log1p(-h.rate) + _evidence(one, alone))
                for run, one in zip(self.runs, known, strict=True)
            ),
            Run(t, math.log(h.rate * h.small) + _evidence(start, alone), start, t),
            Run(t, math.log(h.rate) + math.log1p(-h.small), None, t),
        ]

    def _folded(self, run: Run, now: Told) -> Run:
        """The run with all that was read made a part of its start, where it has become long."""
        if self.number + 1 - run.unread < self.hazard.together:
            return run
        return replace(run, start=run.posterior(now), unread=self.number + 1)


def _evidence(before: TruncatedMixture, alone: TruncatedMixture) -> float:
    """Log of the integral of q(u | before) q(u | x) over the unit cube; the second is zero outside its box."""
    inside, box = in_box(before, alone.box), alone.box
    share = inside.log_normaliser - before.log_normaliser
    return float(log_overlap(inside, alone) + share) - box.log_volume


def _kept(runs: Sequence[Run], keep: int) -> tuple[Run, ...]:
    """The likeliest ones, likeliest first, their probabilities made to sum to one."""
    weights = torch.log_softmax(torch.tensor([run.log_weight for run in runs], dtype=torch.float64), 0)
    order = [i for i in weights.argsort(descending=True)[:keep].tolist() if weights[i] >= math.log(NEGLIGIBLE)]
    kept = torch.log_softmax(weights[order], 0).tolist()
    return tuple(replace(runs[i], log_weight=weight) for i, weight in zip(order, kept, strict=True))
