"""Who is asked, while a run learns, whether its model lacks something: criticism of the real trajectories.

    critic = SearchCritic(LoggedRuns(state=...))
    finding = critic(real, problem, interrupt)          # finding.effects: what the model should get

The trajectories are read as a log: observations back to states, actions to commands. The same log gives ``refine`` the
same answer. Only what moves the simulated worlds and predicts the last trajectories is handed on as effects: a fault of
a sensor is said in words. Models that the data cannot tell apart are handed on fitted, with their weights, for later
trajectories to choose among.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism import Criticism, grown, refine, run_scores, unscoped
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.runs import BadInput, Interrupt
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.effects.plain import to_plain
from onlinebayes.trainers.hypotheses import UNMOVED, OpenHypotheses, OpenHypothesis
from onlinebayes.trainers.problem import Problem

UNSURE = ("unexplained", "insufficient_data")
"""Verdicts after which nothing is added: the held-out runs contradict it, or there is too little to tell."""

HELD_OUT = 0.25
"""Of the trajectories, the last ones: they judge what was found."""


@dataclass(frozen=True)
class Finding:
    """The answer of a critic.

    Args:
        effects: that the model should get; none where it may stay as it is.
        words: one line.
        hypotheses: the models among which the trajectories do not choose yet, fitted to them; None where there is no
            choice, or not all of them could be fitted.
    """

    effects: tuple[Effect, ...]
    words: str
    hypotheses: OpenHypotheses | None = None


@runtime_checkable
class Critic(Protocol):
    """Looks for what a model lacks."""

    def __call__(self, real: TensorDict, problem: Problem, interrupt: Interrupt, /) -> Finding:
        """Criticise the problem's simulator by the real trajectories (n, T) so far; ends early where it is asked to."""
        ...


@runtime_checkable
class Weigher(Protocol):
    """A critic that can also say how well each of the models that it left open predicts new trajectories."""

    def scores(self, real: TensorDict, problem: Problem, hypotheses: OpenHypotheses, /) -> Float[Tensor, "n K"]:
        """S of each trajectory under each hypothesis, as for :meth:`.OpenHypotheses.after` [nats].

        Args:
            real: trajectories (n, T) to which no hypothesis was fitted; those too short to be judged may be left out.
            problem: whose simulator the hypotheses add to.
            hypotheses: K of them.
        """
        ...


@dataclass(frozen=True)
class LoggedRuns:
    """Reads real trajectories as runs of a log.

    Args:
        state: observations (M, O) -> states (M,): ``"qpos"`` and ``"qvel"``; an angle may jump by whole turns.
        signals: descriptions of the simulator's signals with their sensors' noise; estimated without them.
    """

    state: Callable[[Tensor], TensorDict]
    signals: Sequence[Signal] = ()

    def __call__(self, real: TensorDict, problem: Problem) -> Measurement:
        """Every trajectory as a run, of its length.

        Args:
            real: batch size (n, T), with its ``"mask"``.
            problem: whose task gives the commands and whose simulator names the signals.

        Raises:
            BadInput: a simulator that names no signals.
        """
        simulator = _criticised(problem)
        runs = {
            f"trajectory {i + 1}": self._columns(one[: int(one["mask"].sum())], problem, simulator)
            for i, one in enumerate(real)
            if int(one["mask"].sum()) > 1
        }
        return Measurement.from_runs(runs).with_signals(self.signals)

    def _columns(self, one: TensorDict, problem: Problem, simulator: Identifiable) -> dict[str, np.ndarray]:
        """Time, commands and signals of one trajectory; the last command is held."""
        one = one.cpu()
        observed = torch.cat([one["observation"], one["next", "observation"][-1:]])
        state = self.state(observed)
        for j, kind in enumerate(simulator.joint_kinds.values()):
            if kind == "hinge":
                state["qpos"][:, j] = torch.from_numpy(np.unwrap(state["qpos"][:, j].numpy()))
        values, command = simulator.read(state), problem.task.command(one["action"]).double()
        columns = {"time": simulator.dt * np.arange(len(observed))}
        columns |= {f"ctrl.{name}": command[:, k].numpy() for k, name in enumerate(simulator.commands)}
        for name, column in zip(simulator.signals, values.T, strict=True):
            columns[name] = column.numpy()
        for name in simulator.commands:
            columns[f"ctrl.{name}"] = np.append(columns[f"ctrl.{name}"], columns[f"ctrl.{name}"][-1])
        return columns


def simple_laws() -> tuple[str, ...]:
    """Every effect of the vocabulary that contains no simpler one and has not the freedom to imitate others.

    Some trajectories of a few seconds tell that a joint rubs, not how its friction changes with speed.
    """
    return tuple(name for name, kind in EFFECTS.items() if not kind.contains and not kind.tried_last)


@dataclass(frozen=True)
class SearchCritic:
    """Asks :func:`~onlinebayes.criticism.refine`, but for faults of the log, as the table is our own.

    Args:
        runs: reads trajectories as a log.
        candidates: effects that are tried, as in :func:`~onlinebayes.criticism.refine`.
        budget_s: processor time of one search [s]; None for no end.
        fewest: trajectories below which nothing is asked.
    """

    runs: Callable[[TensorDict, Problem], Measurement]
    candidates: str | Sequence[str | Effect] = field(default_factory=simple_laws)
    budget_s: float | None = 60.0
    fewest: int = 3

    def __call__(self, real: TensorDict, problem: Problem, interrupt: Interrupt) -> Finding:
        """See :class:`Critic`."""
        told = f"criticism of {len(real)} real trajectories"
        if len(real) < self.fewest:
            return Finding((), f"{told}: too few, it asks for {self.fewest}")
        model, log = _criticised(problem), self.runs(real, problem)
        held_out = log.runs[-max(1, int(HELD_OUT * len(log.runs))) :]
        result = refine(
            model,
            log,
            holdout=held_out,
            candidates=self.candidates,
            interrupt=interrupt,
            budget_s=self.budget_s,
            faults=False,
        )
        return finding_of(result, model, told)

    def scores(self, real: TensorDict, problem: Problem, hypotheses: OpenHypotheses) -> Float[Tensor, "n K"]:
        """See :class:`Weigher`; by the score of criticism, every window from its best start."""
        model, log = _criticised(problem), self.runs(real, problem)
        each = ((grown(model, one.added_to(model)), one.values) for one in hypotheses.each)
        columns = [run_scores(*one, log, hypotheses.noise, hypotheses.horizon) for one in each]
        return torch.stack(columns, dim=1)


def finding_of(result: Criticism, model: Identifiable, told: str) -> Finding:
    """Choose the effects that a criticism adds to a model; ``told`` begins the words of the finding."""
    named = ", ".join(result.accepted)
    told = "; ".join((told, *result.failed))
    if not named:
        return Finding((), f"{told}: nothing is preferred to the model as it is")
    if rivals := [key for one in result.candidates if one.accepted for key in one.indistinguishable_from]:
        left = left_open(result, model, rivals)
        until = "nothing is added yet" if left is None else f"nothing is added until one is clear ({left.words})"
        return Finding((), f"{told}: {named}, or as well {', '.join(rivals)}; {until}", left)
    if result.verdict in UNSURE:
        why = result.what_to_record or ". ".join(result.notes[:1]) or "half of the error is left"
        return Finding((), f"{told}: {named} is not relied on: {why}; nothing is added")
    have = {effect.key for effect in model.effects}
    new = tuple(effect for effect in unscoped(result.final.simulator).effects if effect.key not in have)
    if {effect.key for effect in new} != set(result.accepted) or any(one.target_kind in UNMOVED for one in new):
        return Finding((), f"{told}: {named}, which is no law of motion; nothing is added")
    sizes = ", ".join(
        f"{name} = {one.mean:.3g}" for name, one in result.parameters.items() if name not in model.parameters
    )
    return Finding(new, f"{told}: the model lacks {named} ({sizes})")


def left_open(result: Criticism, model: Identifiable, rivals: Sequence[str]) -> OpenHypotheses | None:
    """The models that a result leaves open, with its weights.

    None where the held-out runs contradict them, where a rival was named and not fitted, or where one is more than
    effects with one size for all trajectories.

    Args:
        result: of criticism.
        model: that was criticised.
        rivals: keys of what does as well as what was accepted.
    """
    have, each = {effect.key for effect in model.effects}, list[OpenHypothesis]()
    for one in result.hypotheses:
        fitted = one.model
        new = [effect for effect in unscoped(fitted.simulator).effects if effect.key not in have]
        if {effect.key for effect in new} != set(one.accepted):
            return None
        values = dict(zip(fitted.simulator.parameters.names, fitted.theta.tolist(), strict=True))
        each.append(OpenHypothesis(tuple(map(to_plain, new)), values, one.weight))
    named = {key for one in each for key in one.keys}
    if len(each) < 2 or result.explanation is None or result.verdict in UNSURE or not set(rivals) <= named:
        return None
    return OpenHypotheses(tuple(each), dict(result.sensor_sd), result.explanation.windows.horizon)


def _criticised(problem: Problem) -> Identifiable:
    if not isinstance(problem.simulator, Identifiable):
        raise BadInput(f"{type(problem.simulator).__name__} cannot be criticised", "use an Identifiable simulator")
    return problem.simulator
