"""The belief of a run whose machine may change: which trajectories are still its own.

    p_t(theta) = sum over r of p(r | x_1:t) q(theta | x_t-r+1:t)                        see ``ChangingBelief``

q is fitted to simulations of the whole prior in every step. A proposal that has narrowed about the old machine makes
nothing that the new one does: an estimator trained there puts the new theta at the edge of its box, or leaves it out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from tensordict import TensorDict

from onlinebayes.inference import (
    Alarm,
    Alarming,
    Belief,
    BoxUniform,
    Change,
    ChangingBelief,
    FitReport,
    Hazard,
    History,
    PosteriorEstimator,
    RunLengths,
    TrajectoryKeys,
    TruncatedMixture,
)
from onlinebayes.inference.run_length import Run
from onlinebayes.inference.saving import from_state, to_state
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput

COMPARED = 200
"""Simulations of the newest policy that trajectories are compared with."""


@dataclass(frozen=True, eq=False)
class Learnt:
    """An estimator and that which it has learnt from.

    Args:
        estimator: fitted.
        report: on the fit.
        simulated: trajectories (B, T), those of the newest policy last.
        groups: held-out groups (G, n, T).
    """

    estimator: PosteriorEstimator
    report: FitReport
    simulated: TensorDict
    groups: TensorDict

    @cached_property
    def alarm(self) -> Alarm | None:
        """Over the newest simulations; None where the estimator has none, or too few simulations for one."""
        estimator = self.estimator
        if not isinstance(estimator, Alarming):
            return None
        try:
            return estimator.alarm(self.simulated[-COMPARED:])
        except BadInput:
            return None


@dataclass(frozen=True)
class Follower:
    """Follows the machine of a run.

    Args:
        prior: of the run; uniform.
        hazard: how machines change.
        keys: where trajectories lie.

    Raises:
        BadInput: another prior.
    """

    prior: Belief
    hazard: Hazard
    keys: TrajectoryKeys | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.prior, BoxUniform):
            raise BadInput(
                f"a {type(self.prior).__name__} for the prior of a machine that may change",
                "give a BoxUniform, or leave the hazard out",
            )

    def belief(
        self, learnt: Learnt, history: History | None, real: TensorDict | None
    ) -> tuple[TruncatedMixture | BoxUniform, History]:
        """Infer the machine as it is now from all real trajectories (n, T); return the belief and its history."""
        known = 0 if history is None else history.lengths.number
        seen = None if real is None or not known else real[:known]
        belief = ChangingBelief(
            learnt.estimator, self.hazard, alarm=learnt.alarm, keys=self.keys, history=history, seen=seen
        )
        if real is not None:
            belief = belief.update(real[known:])
        return belief.distribution, belief.history


def news(before: History | None, after: History) -> list[str]:
    """Describe what the last trajectories added to the history; nothing where the machine is the same as before."""
    old = () if before is None else before.changes
    lines = [str(change) for change in after.changes if change not in old]
    return [after.in_words()] if after.unexplained else lines


def to_plain(history: History | None) -> dict[str, Any] | None:
    """A history as plain values, for a checkpoint."""
    if history is None:
        return None
    lengths = history.lengths
    return {
        "hazard": asdict(lengths.hazard),
        "number": lengths.number,
        "runs": [
            {
                "since": run.since,
                "log_weight": run.log_weight,
                "start": None if run.start is None else to_state(run.start),
                "unread": run.unread,
            }
            for run in lengths.runs
        ],
        "changes": [asdict(change) for change in history.changes],
        "novelty": list(history.novelty),
    }


def from_plain(space: ParameterSpace, plain: Mapping[str, Any] | None) -> History | None:
    """The history that :func:`to_plain` wrote down."""
    if plain is None:
        return None
    runs = tuple(
        Run(**{**run, "start": None if run["start"] is None else from_state(space, run["start"])})
        for run in plain["runs"]
    )
    lengths = RunLengths(Hazard(**plain["hazard"]), plain["number"], runs)
    return History(lengths, tuple(Change(**change) for change in plain["changes"]), tuple(plain["novelty"]))
