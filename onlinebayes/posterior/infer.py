"""The posterior over a model's free parameters given the runs of a log that are there to fit.

    p(theta | log) prop. to  1[theta in bounds]  t_nu(t(theta); 0, Sigma)        prior: uniform, see ParameterSpace

t and Sigma: :mod:`.score`. Fitted first, by least squares, as ``compare`` does; then theta is drawn near the fit, each
draw is replayed over all windows, and the draws are weighed (:mod:`onlinebayes.inference.importance`). What rests on
moments of inertia that nobody measured is widened by these (:mod:`.unmeasured`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import Explanation, PreparedLog, begun_as_read, explanation_of, kept_fit, prepare
from onlinebayes.identification import Scope, Selection
from onlinebayes.inference import Box, TruncatedMixture, WeightedDraws, identifiability, importance
from onlinebayes.measurements import Measurement
from onlinebayes.posterior.likeness import surprise
from onlinebayes.posterior.linear import linear_posterior
from onlinebayes.posterior.results import LogPosterior, Method
from onlinebayes.posterior.score import Score, score_of
from onlinebayes.posterior.summaries import correlation, each_parameter, mean_squares, reproductions
from onlinebayes.posterior.unmeasured import with_unmeasured_moments
from onlinebayes.runs import BadInput, Interrupt, Memo, Watch, one_torch_thread
from onlinebayes.simulators.identifiable import Identifiable

FEWEST = 50.0
"""Equal draws: with fewer an sd errs by a tenth, and the linear model is taken instead."""

DRAWN = 4000
"""Draws of the linear model's posterior, which cost nothing."""


def posterior_of_log(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    selection: Selection | None = None,
    scope: Scope | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    interrupt: Interrupt | None = None,
    memo: Memo | None = None,
) -> LogPosterior:
    """Infer the posterior of a model's parameters from a log.

    Args:
        simulator: the model; its parameters' bounds are the prior.
        measurement: runs of commands and signals; every joint needs its position or its velocity.
        holdout: runs that are left out; None for the last third of the runs, or of the only run's time.
        selection, scope: as for :func:`~onlinebayes.criticism.compare`.
        seed: decides all draws.
        progress: takes one line of text between stages.
        interrupt: ends the work at its next replay.
        memo: keeps fits, so that commands on the same model and log share them; None for none.

    Raises:
        BadInput: the measurement does not suit the simulator, nothing is free, or the simulation diverges.
        Stopped: it was interrupted.
    """
    if not len(simulator.parameters):
        raise BadInput("the model has no free parameter", "name some under [parameters]: what has a posterior is free")
    watch = Watch(progress, interrupt) if progress is not None else Watch(interrupt=interrupt)
    with one_torch_thread(), watch.heeded():
        watch.say("making model and log ready")
        task = prepare(simulator, measurement, holdout, selection, scope)
        found = kept_fit(task.simulator, task.fit_runs, memo) if memo is not None else None
        if found is None:
            task, search = begun_as_read(task, watch, memo)
            found = explanation_of(search)
            watch.say("fitting to all windows")
            found = found.on_all_windows(task.fit_runs)
        return _inferred(task, found, torch.Generator().manual_seed(seed), watch)


def _inferred(task: PreparedLog, found: Explanation, generator: torch.Generator, watch: Watch) -> LogPosterior:
    """The posterior around a fit."""
    score = score_of(found.found, found.evaluator, task.selection.folds)
    replays = _Replays(score, watch)
    drawn = importance(replays, linear_posterior(score), generator=generator)
    watch.say("comparing what is left with what noise would leave")
    p, strange = surprise(score, generator)
    linear = drawn.effective < FEWEST
    with_own_moments = linear_posterior(score) if linear else drawn.smoothed()
    belief = with_unmeasured_moments(with_own_moments, score)
    theta, weight = _weighted(belief, drawn, linear or belief is not with_own_moments, generator)
    units = {signal.name: signal.unit for signal in task.fit_runs.signals}
    space = score.fitted.simulator.parameters
    known = identifiability(belief, Box.whole(space))
    return LogPosterior(
        belief=belief,
        accepted=tuple(effect.key for effect in task.simulator.effects),
        parameters=each_parameter(theta, weight, score.fitted.theta, known, space),
        correlation=correlation(theta, weight),
        identifiability=known,
        reproduction=reproductions(score.windows, replays.squares(drawn), drawn.weight, units),
        surprise=p,
        strange=tuple(units)[strange],
        method=Method(
            draws=drawn.made,
            effective=drawn.effective,
            linear=linear,
            windows=score.windows.count,
            horizon_s=score.windows.horizon,
            blocks=score.spread.blocks,
            correlation_s=score.correlation_s,
            freedom=score.spread.freedom,
            runs=task.fit_runs.runs,
        ),
        notes=task.notes,
    )


@dataclass
class _Replays:
    """Log likelihood of theta by replays, which are counted, and whose misfits are kept.

    Args:
        score: of the fit.
        watch: told how many there were.
        misfits: mean squares of each signal in every replay so far [SI].
        made: how many there were.
    """

    score: Score
    watch: Watch
    misfits: list[Float[Tensor, "n S"]] = field(default_factory=list)
    made: int = 0

    def __call__(self, theta: Float[Tensor, "N P"]) -> Float[Tensor, " N"]:
        """Of each theta; -inf where a world diverges."""
        found = []
        for part in theta.split(self.score.at_once):
            self.watch.say(f"replaying draws of theta, {self.made} done")
            rows, valid = self.score.rows_at(part.to(self.score.fitted.theta))
            likelihood = self.score.log_likelihood(self.score.of(rows)).double()
            found.append(torch.where(valid & torch.isfinite(likelihood), likelihood, -math.inf))
            self.misfits.append(mean_squares(self.score, rows))
            self.made += len(part)
        return torch.cat(found)

    def squares(self, drawn: WeightedDraws) -> Float[Tensor, "N S"]:
        """Misfits of those replays that count."""
        return torch.cat(self.misfits)[drawn.number]


def _weighted(
    belief: TruncatedMixture, drawn: WeightedDraws, anew: bool, generator: torch.Generator
) -> tuple[Float[Tensor, "N P"], Float[Tensor, " N"]]:
    """Draws of theta [SI] with weights that sum to one."""
    if anew:
        theta = belief.sample((DRAWN,), generator)
        return theta, torch.full((DRAWN,), 1 / DRAWN, dtype=torch.float64, device=theta.device)
    return drawn.box.from_frame(drawn.z), drawn.weight
