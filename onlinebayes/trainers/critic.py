"""Who is asked, while a run learns, whether its model lacks something: criticism of the real trajectories.

    critic = RefiningCritic(LoggedRuns(state=...))
    finding = critic(real, problem, interrupt)          # finding.effects: what the model should get

The trajectories are read as a log: observations back to states, actions to commands. Only what moves the simulated
worlds and predicts the last trajectories is handed on: a fault of a sensor, or a choice between effects that the data
cannot tell apart, is said in words, and asked again with more data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.criticism import Criticism, refine
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.runs import BadInput, Interrupt
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import Effect
from onlinebayes.trainers.problem import Problem

UNMOVED = ("signal", "parameter")
"""What effects act on that change how a world is seen, or when, but not how it moves."""

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


@dataclass(frozen=True)
class RefiningCritic:
    """Asks :func:`~onlinebayes.criticism.refine`.

    Args:
        runs: reads trajectories as a log.
        candidates: effects that are tried, as there.
        budget_s: processor time of one search [s]; None for no end.
        fewest: trajectories below which nothing is asked.
    """

    runs: Callable[[TensorDict, Problem], Measurement]
    candidates: str | Sequence[str | Effect] = "all"
    budget_s: float | None = 60.0
    fewest: int = 2

    def __call__(self, real: TensorDict, problem: Problem, interrupt: Interrupt) -> Finding:
        """See :class:`Critic`."""
        if len(real) < self.fewest:
            return Finding((), f"criticism needs {self.fewest} real trajectories, there are {len(real)}")
        model = problem.simulator
        if not isinstance(model, Identifiable):
            raise BadInput(f"{type(model).__name__} cannot be criticised", "use an Identifiable simulator")
        runs = self.runs(real, problem)
        result = refine(
            model,
            runs,
            holdout=runs.runs[-max(1, int(HELD_OUT * len(runs.runs))) :],
            candidates=self.candidates,
            interrupt=interrupt,
            budget_s=self.budget_s,
        )
        return finding_of(result, model, len(real))


def finding_of(result: Criticism, model: Identifiable, number: int) -> Finding:
    """What of a criticism goes into a model; ``number`` of trajectories it was of."""
    told, found = f"criticism of {number} real trajectories", ", ".join(result.accepted)
    if result.interrupted or result.verdict not in ("missing_effect", "unexplained") or not _predicts(result):
        why = "stopped" if result.interrupted else result.verdict.replace("_", " ")
        wanted = f" ({result.what_to_record})" if result.what_to_record else f" ({found})" if found else ""
        return Finding((), f"{told}: {why}{wanted}; nothing is added")
    have = {effect.key for effect in model.effects}
    new = tuple(effect for effect in result.final.simulator.effects if effect.key not in have)
    if {effect.key for effect in new} != set(result.accepted) or any(effect.target_kind in UNMOVED for effect in new):
        return Finding((), f"{told}: {found}, which is no law of motion; nothing is added")
    sizes = ", ".join(
        f"{name} {estimate.mean:.3g} ± {estimate.sd:.1g} {estimate.unit}".rstrip()
        for name, estimate in result.parameters.items()
        if name.startswith(tuple(f"{key}." for key in result.accepted))
    )
    return Finding(new, f"{told}: the model lacks {found} ({sizes})")


def _predicts(result: Criticism) -> bool:
    """Whether something was found, and it halves the squared error of the runs that were held out."""
    error = result.heldout_error
    before, after = (
        sum((rms[signal] / max(error.noise_floor[signal], 1e-12)) ** 2 for signal in result.signals if signal in rms)
        for rms in (error.before, error.after)
    )
    return bool(result.accepted) and 2 * after <= before
