"""Online BayesSim: policy and posterior learnt in turns, each from what the other has become.

    for t = 1, 2, ...
        worlds:      theta ~ p_{t-1}(theta);  pi learns in them             policy steps
        simulate:    x_i ~ simulator(theta_i, pi),  theta_i ~ proposal, for pi and its last few predecessors
        infer:       maximise sum_i log q(theta_i | embedding(x_i))         embedding and mixture together
        measure:     x_real ~ the real system under pi
        condition:   p_t(theta) = q(theta | x_real's)
        narrow:      proposal = last proposal cut to the region of p_t

Algorithm 1 of R. C. Possas, Reinforcement Learning in the Real World; Possas et al., Online BayesSim for Combined
Simulator Parameter Inference and Policy Improvement (IROS 2020). The proposals are truncated (Deistler, Goncalves and
Macke 2022), so that no round has to be corrected for where the earlier ones led it.

The trainer owns the order of these steps and nothing else: every part is built by the caller and knows no trainer.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import torch
from tensordict import TensorDict, TensorDictBase

from onlinebayes.inference import Box, FitReport, NeuralPosteriorLoss, Posterior
from onlinebayes.objectives import Objective
from onlinebayes.runs import Interrupt, Progress
from onlinebayes.trainers.trajectories import Policy, RealSystem
from onlinebayes.transforms import Distribution, ParameterRandomization


@runtime_checkable
class Proposal(Distribution, Protocol):
    """Where parameters are drawn for simulations, and a box around it."""

    box: Box


@runtime_checkable
class Batches(Protocol):
    """Fresh data without end, as a TorchRL ``Collector`` gives it."""

    def reset(self) -> None:
        """Begin a new episode in every world."""

    def next(self) -> TensorDictBase | None:
        """The next batch (N, T)."""


@dataclass(frozen=True)
class Schedule:
    """How much of each step.

    Args:
        steps: outer steps, each with one real trajectory.
        policy_batches: collector batches that the policy learns from in an outer step.
        real_steps: length of a real trajectory.
        remember: real trajectories that the posterior is conditioned on, the latest ones. Each is read by an estimator
            that has seen simulations under the very policy that made it, so as many policies are remembered.
    """

    steps: int = 6
    policy_batches: int = 12
    real_steps: int = 50
    remember: int = 3


@dataclass(frozen=True)
class Record:
    """One outer step, for tables and plots.

    Attributes:
        step: counted from 1.
        frames: simulated frames that the policy has learnt from so far.
        seconds: spent in this step [s].
        losses: means of the policy's losses in the last batch.
        fit: how the training of embedding and estimator went.
    """

    step: int
    frames: int
    seconds: float
    losses: dict[str, float]
    fit: FitReport


@dataclass
class OnlineState:
    """Where a run stands; with the objective's ``state_dict`` it is all that a later session needs to go on.

    Attributes:
        proposal: where the next simulations are drawn; the prior at first.
        posterior: p_t, None before the first outer step is complete.
        real: the real trajectories (n, T), None before the first.
        policies: the policies that made the latest of them, frozen.
        records: one for each complete outer step.
        frames: simulated frames that the policy has learnt from.
        interrupted: whether the run was stopped before its last step.
    """

    proposal: Proposal
    posterior: Posterior | None = None
    real: TensorDict | None = None
    policies: list[Policy] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)
    frames: int = 0
    interrupted: bool = False

    @property
    def step(self) -> int:
        """Number of complete outer steps."""
        return len(self.records)

    def kept(self) -> str:
        """What the run has, in words."""
        trajectories = 0 if self.real is None else len(self.real)
        posterior = f"the posterior of {trajectories} real trajectories" if self.posterior else "no posterior yet"
        return f"{self.step} outer steps, {posterior}, a policy after {self.frames} frames"


@dataclass(frozen=True, eq=False)
class OnlineTrainer:
    """Algorithm 1 over built parts.

    Args:
        objective: the policy and the way it learns.
        collector: gives the policy's batches (N, T), from worlds that ``randomization`` draws.
        randomization: the transform of the collector's environment.
        simulate: (policy, proposal) -> trajectories (M, T) with their theta.
        estimator: proposal -> a fresh loss (embedding and mixture) in the proposal's box.
        fit: trains the loss on trajectories.
        narrow: (posterior, the proposal it was trained on) -> the next proposal.
        real: the system in question.
        schedule: how much of each step.
    """

    objective: Objective
    collector: Batches
    randomization: ParameterRandomization
    simulate: Callable[[Policy, Proposal], TensorDict]
    estimator: Callable[[Proposal], NeuralPosteriorLoss]
    fit: Callable[[NeuralPosteriorLoss, TensorDictBase], FitReport]
    narrow: Callable[[Posterior, Proposal], Proposal]
    real: RealSystem
    schedule: Schedule

    def run(self, state: OnlineState, on_step: Callable[[OnlineState], None] | None = None) -> OnlineState:
        """Take outer steps until the schedule's number is complete or Ctrl-C asks for a stop.

        Args:
            state: ``OnlineState(prior)``, or where an earlier run stood.
            on_step: called after each complete outer step; only a caller who knows the truth can judge here.

        Returns:
            ``state``, brought forward. A step that Ctrl-C cut short leaves the policy as far as it got and everything
            else as it was after the step before.
        """
        with Interrupt() as interrupt, Progress("online", self.schedule.steps) as progress:
            while state.step < self.schedule.steps and not interrupt.requested:
                self._step(state, interrupt, progress)
                if on_step is not None and not interrupt.requested:
                    on_step(state)
            state.interrupted = state.step < self.schedule.steps
            if state.interrupted:
                progress.update(state.step, f"stopped; kept: {state.kept()}")
        return state

    def _step(self, state: OnlineState, interrupt: Interrupt, progress: Progress) -> None:
        start, remember = time.monotonic(), self.schedule.remember
        losses = self._improve(state, interrupt, progress)
        if interrupt.requested:
            return
        progress.update(state.step, "simulating and fitting")
        policy = copy.deepcopy(self.objective.policy).requires_grad_(False)
        policies = [*state.policies, policy][-remember:]
        loss = self.estimator(state.proposal)
        report = self.fit(loss, torch.cat([self.simulate(each, state.proposal) for each in policies]))
        if interrupt.requested:
            return
        measured = self.real.run(policy, self.schedule.real_steps)
        real = measured if state.real is None else torch.cat([state.real, measured])
        posterior = Posterior(loss).condition(real[-remember:])
        state.proposal, state.posterior = self.narrow(posterior, state.proposal), posterior
        state.real, state.policies = real, policies
        state.records.append(Record(state.step + 1, state.frames, time.monotonic() - start, losses, report))
        progress.update(state.step, f"posterior mean {[round(x, 3) for x in posterior.mean().tolist()]}")

    def _improve(self, state: OnlineState, interrupt: Interrupt, progress: Progress) -> dict[str, float]:
        """Policy steps in worlds of the present posterior."""
        self.randomization.set_distribution(state.posterior or state.proposal)

        def after(batch: int, frames: int) -> bool:
            state.frames += frames
            progress.update(state.step, f"policy {batch}/{self.schedule.policy_batches}")
            return not interrupt.requested

        return improve(self.objective, self.collector, self.schedule.policy_batches, after)


def improve(
    objective: Objective,
    collector: Batches,
    batches: int,
    after: Callable[[int, int], bool] | None = None,
) -> dict[str, float]:
    """Let a policy learn from fresh episodes in the collector's worlds; returns the last batch's losses.

    Args:
        objective: the policy that the collector runs, and its learning.
        collector: gives batches (N, T).
        batches: how many to learn from.
        after: told the number of batches so far and the frames of the last one; False ends it early.
    """
    collector.reset()
    losses: dict[str, float] = {}
    for batch in range(1, batches + 1):
        data = collector.next()
        if data is None:
            raise ValueError(f"the collector ended after {batch - 1} of {batches} batches; give it total_frames=-1")
        losses = objective.update(data)
        if after is not None and not after(batch, data.numel()):
            break
    return losses
