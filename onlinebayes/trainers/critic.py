"""Who is asked, while a run learns, whether its model lacks something: criticism of the real trajectories.

    critic = SearchCritic(LoggedRuns(state=...))
    finding = critic(real, problem, interrupt)          # finding.effects: what the model should get

The trajectories are read as a log: observations back to states, actions to commands. The same log gives ``refine`` the
same answer. Only what moves the simulated
worlds and predicts the last trajectories is handed on: a fault of a sensor, or a choice between effects that the data
cannot tell apart, is said in words, and asked again with more data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism import Criticism, refine, unscoped
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.runs import BadInput, Interrupt
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.trainers.problem import Problem

UNMOVED = ("signal", "parameter")
"""What effects act on that change how a world is seen, or when, but not how it moves."""

UNSURE = ("unexplained", "insufficient_data")
"""Verdicts after which nothing is added: the held-out runs contradict it, or there is too little to tell."""

HELD_OUT = 0.25
"""Of the trajectories, the last ones: they judge what was found."""


@dataclass(frozen=True)
class Finding:
    """What a critic says.

    Args:
        effects: that the model should get; none where it may stay as it is.
        words: one line.
    """

    effects: tuple[Effect, ...]
    words: str


@runtime_checkable
class Critic(Protocol):
    """Looks for what a model lacks."""

    def __call__(self, real: TensorDict, problem: Problem, interrupt: Interrupt, /) -> Finding:
        """What the real trajectories (n, T) so far say of the problem's simulator; ends early where it is asked to."""
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
        simulator = problem.simulator
        if not isinstance(simulator, Identifiable):
            raise BadInput(f"{type(simulator).__name__} cannot be criticised", "use an Identifiable simulator")
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
        model = problem.simulator
        if not isinstance(model, Identifiable):
            raise BadInput(f"{type(model).__name__} cannot be criticised", "use an Identifiable simulator")
        log = self.runs(real, problem)
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


def finding_of(result: Criticism, model: Identifiable, told: str) -> Finding:
    """What of a criticism goes into a model; ``told`` begins its words."""
    named = ", ".join(result.accepted)
    told = "; ".join((told, *result.failed))
    if not named:
        return Finding((), f"{told}: nothing is preferred to the model as it is")
    if rivals := [key for one in result.candidates if one.accepted for key in one.indistinguishable_from]:
        return Finding((), f"{told}: {named}, or as well {', '.join(rivals)}; nothing is added yet")
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
