"""Online BayesSim: one policy and one belief, learnt in turns, each from what the other has become.

    for t = 1, 2, ...
        worlds:      theta ~ p_{t-1}(theta);  pi learns in them             policy steps
        measure:     x_real ~ the real system under pi
        simulate:    x_i ~ simulator(theta_i, pi),  theta_i ~ proposal, for pi and some of its predecessors
        infer:       maximise sum_i log q(theta_i | x_i)
        condition:   p_t(theta) = q(theta | all x_real so far)              the belief, which is reported; see
                     ``following`` for a machine that may change on the way
        gate:        the next proposal: narrower where the belief holds held-out truths, else wider

Algorithm 1 of R. C. Possas, Reinforcement Learning in the Real World; Possas et al., Online BayesSim for Combined
Simulator Parameter Inference and Policy Improvement (IROS 2020). The proposals are truncated (Deistler, Goncalves and
Macke 2022), so that no round has to be corrected for where the earlier ones led it.

The trainer owns the order of these steps and nothing else: every part is built by the caller and knows no trainer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference import Belief, Decision, FitReport, Gate, History, PosteriorEstimator
from onlinebayes.inference.calibration import LEVELS, credibility_of
from onlinebayes.objectives import Objective, TakesBelief
from onlinebayes.runs import BadInput, Grace, Interrupt, Progress, give_back_freed_memory, giving_up, heed
from onlinebayes.trainers.clock import Clock
from onlinebayes.trainers.following import Follower, Learnt, news
from onlinebayes.trainers.improve import Batches, improve
from onlinebayes.trainers.real import RealSystem, measured, united
from onlinebayes.trainers.repeated import Repeated
from onlinebayes.trainers.schedule import Schedule, spread
from onlinebayes.trainers.simulations import TrajectorySource
from onlinebayes.trainers.state import Inferred, OnlineState, frozen
from onlinebayes.trainers.trajectories import Policy
from onlinebayes.transforms import Distribution, ParameterRandomization

Checkpoint = Callable[[OnlineState, bool], None]
"""(state, whether to save now or when it is time again): called wherever the run could go on from."""
STOPPING = "stopping after the work in hand; Ctrl-C again to stop at once"
PRIOR_LOSS = -0.02
"""A validation loss above it [nats] says that the estimator knows no more than its box: 0 is the uniform density's."""


@dataclass(frozen=True, eq=False)
class OnlineTrainer:
    """Algorithm 1 over built parts.

    Args:
        objective: the policy and the way it learns.
        collector: gives the policy's batches (N, T), from worlds that ``randomization`` draws.
        randomization: the transform of the collector's environment.
        simulations: gives the trajectories of a fit.
        held_out: gives the groups by which the belief is judged.
        estimator: proposal -> a fresh estimator in the proposal's box.
        gate: decides on the next proposal.
        real: the system in question.
        schedule: how much of each step, and in which order.
        generator: of the fits and the gate.
        worlds: where the policy's worlds come from; the belief without it.
        repeats: whether simulations repeat the commands of real trajectories, in the place of the policies that gave
            them: for a policy that takes its time, as a planner does. See ``repeated``.
        follower: follows a machine that may change; without it one machine is thought to make all trajectories.

    Raises:
        BadInput: a gate that narrows beside a follower.
    """

    objective: Objective
    collector: Batches
    randomization: ParameterRandomization
    simulations: TrajectorySource
    held_out: TrajectorySource
    estimator: Callable[[Belief], PosteriorEstimator]
    gate: Gate
    real: RealSystem
    schedule: Schedule
    generator: torch.Generator
    worlds: Distribution | None = None
    repeats: bool = False
    follower: Follower | None = None

    def __post_init__(self) -> None:
        if self.follower is not None and self.gate.narrows:
            raise BadInput(
                "a gate that narrows the proposal of a machine that may change",
                "the next machine may lie anywhere: give Gate(narrows=False), or leave the gate out",
            )

    def makers(self, state: OnlineState, numbers: Sequence[int]) -> list[Policy]:
        """The policies with these numbers that made real trajectories, or what repeats their commands."""
        kind = Repeated() if self.repeats else self.objective.policy
        found = {number: frozen(kind, state.policies[number]) for number in set(numbers)}
        return [found[number] for number in numbers]

    def run(
        self,
        state: OnlineState,
        *,
        on_step: Callable[[OnlineState], None] | None = None,
        checkpoint: Checkpoint | None = None,
        until: int | None = None,
    ) -> OnlineState:
        """Take outer steps until the schedule's number is complete or Ctrl-C asks for a stop.

        Args:
            state: ``OnlineState.begin(prior)``, or where an earlier run stood.
            on_step: called after each complete outer step; only a caller who knows the truth can judge here.
            checkpoint: called wherever the run could go on from.
            until: outer steps after which to pause; all of the schedule's without it.

        Returns:
            ``state``, brought forward. A step that Ctrl-C cut short leaves the policy as far as it got, what was
            measured, and the belief of the step before. What ends within two seconds ends by itself; a longer batch,
            measurement or ``on_step`` is given up, and the run goes on from the checkpoint before it.
        """
        save = checkpoint if checkpoint is not None else _keep_nothing
        turns = self.schedule.turns
        until = len(turns) if until is None else min(until, len(turns))
        with Interrupt(STOPPING) as interrupt, Progress("online", len(turns)) as progress:
            told = True
            while told and state.step < until and not interrupt.requested:
                completed = self._step(state, interrupt, progress, save)
                give_back_freed_memory()
                if completed and (told := self._told(state, on_step, interrupt)):
                    save(state, True)
            state.interrupted = state.step < until or not told
            if state.interrupted:
                progress.update(state.step, f"stopped; kept: {state.kept()}")
        return state

    def infer(self, state: OnlineState) -> bool:
        """Let the belief learn anew from the real trajectories so far; False where Ctrl-C ended it before."""
        with Interrupt(STOPPING) as interrupt, Progress("online", len(self.schedule.turns)) as progress:
            return self._infer(state, Clock(), interrupt, progress) is not None

    def _step(self, state: OnlineState, interrupt: Interrupt, progress: Progress, save: Checkpoint) -> bool:
        """One outer step; False where it was cut short."""
        turn, clock = self.schedule.turns[state.step], Clock()
        self._tell(state)
        if state.batches < turn.policy_batches:
            with clock("policy"):
                if not self._improve(state, turn.policy_batches, interrupt, progress, save):
                    return False
            save(state, True)
        if interrupt.requested:
            return False
        inferred: Inferred | None = None
        if turn.infers:
            if not state.measured:
                with clock("real"):
                    progress.update(state.step, "measuring")
                    if not self._measure(state, interrupt):
                        return False
                save(state, True)
            if state.real is not None and not interrupt.requested:
                inferred = self._infer(state, clock, interrupt, progress)
            if interrupt.requested:
                return False
        state.complete(dict(clock.seconds), inferred)
        return True

    def _tell(self, state: OnlineState) -> None:
        """Tell the objective the belief, only where a step begins: a run that resumes inside one was told before."""
        if isinstance(self.objective, TakesBelief) and not state.batches and not state.measured:
            self.objective.set_belief(self.worlds if self.worlds is not None else state.belief)

    def _improve(
        self, state: OnlineState, batches: int, interrupt: Interrupt, progress: Progress, save: Checkpoint
    ) -> bool:
        """Policy steps in worlds of the present belief; False where a batch was given up in its middle."""
        self.randomization.set_distribution(self.worlds if self.worlds is not None else state.belief)

        def after(done: int, frames: int, losses: dict[str, float]) -> bool:
            state.batches, state.losses, state.anew = done, losses, False
            state.frames += frames
            progress.update(state.step + 0.5 * done / batches, f"policy {done}/{batches}", frames=state.frames)
            if done < batches and not interrupt.requested:
                save(state, False)
            return not interrupt.requested

        with giving_up(Grace(interrupt)):
            state.notes += improve(self.objective, self.collector, batches, after, begin=state.batches, anew=state.anew)
            return True
        return False

    def _measure(self, state: OnlineState, interrupt: Interrupt) -> bool:
        """Ask the real system for trajectories under the present policy; False where that was given up."""
        policy, asked = frozen(self.objective.policy), False
        with giving_up(Grace(interrupt)):
            found, note = measured(self.real, policy, self.schedule.real_steps, self.simulations.form, state.real)
            asked = True
        if not asked:
            return False
        if found is not None:
            state.real = found if state.real is None else united([state.real, found])
            made = Repeated(found) if self.repeats else policy
            state.policies.append(dict(made.state_dict()))
            state.made_by += [len(state.policies) - 1] * len(found)
        state.notes += [note] if note else []
        state.measured = True
        return True

    def _told(self, state: OnlineState, on_step: Callable[[OnlineState], None] | None, interrupt: Interrupt) -> bool:
        """Let the caller look at a complete step; False where that was given up, and the step is to be made again."""
        if on_step is None:
            return True
        with giving_up(Grace(interrupt)):
            on_step(state)
            return True
        return False

    def _infer(self, state: OnlineState, clock: Clock, interrupt: Interrupt, progress: Progress) -> Inferred | None:
        """Simulate, fit, condition, decide where to simulate next; the state changes at the end, unless stopped."""
        found: tuple[Learnt, _Concluded] | None = None
        with interrupt.giving_up():
            learnt = self._learnt(state, clock, progress)
            found = learnt, self._concluded(state, learnt, clock)
        if found is None or interrupt.requested:
            return None
        learnt, now = found
        notes = [] if now.history is None else news(state.history, now.history)
        state.belief, state.proposal, state.history = now.belief, now.decision.proposal, now.history
        state.simulated += learnt.simulated.numel() + learnt.groups.numel()
        state.notes += [*_doubts(learnt.report), *notes, now.decision.reason]
        calibration = tuple(float((now.alpha <= level).double().mean()) for level in LEVELS)
        return Inferred(learnt.report, now.decision.coverage, calibration)

    def _concluded(self, state: OnlineState, learnt: Learnt, clock: Clock) -> _Concluded:
        """Condition on the real trajectories, and decide where to simulate next."""
        follower = self.follower
        with clock("gate" if follower is None else "change"):
            if follower is None:
                belief, history = learnt.estimator.condition(state.real), None
            else:
                belief, history = follower.belief(learnt, state.history, state.real)
        with clock("gate"):
            theta = learnt.groups.get(self.held_out.form.theta)[:, 0, 0]
            alpha = credibility_of(learnt.estimator.each(learnt.groups), theta, generator=self.generator)
            decision = self.gate.decide(belief, state.proposal, alpha, generator=self.generator)
        return _Concluded(belief, history, alpha, decision)

    def _learnt(self, state: OnlineState, clock: Clock, progress: Progress) -> Learnt:
        """Simulate and fit."""
        with clock("simulate"):
            progress.update(state.step, "simulating")
            makers = self.makers(state, spread(len(state.policies), self.schedule.behaviours))
            simulated = self.simulations.draw(makers, state.proposal)
            made_by = [state.made_by[i] for i in spread(len(state.made_by), self.schedule.group)]
            members = self.makers(state, made_by)
            groups = self.held_out.groups(members, state.proposal)
        heed()
        with clock("fit"):
            progress.update(state.step, "fitting")
            estimator = self.estimator(state.proposal)
            report = estimator.fit(simulated, groups, generator=self.generator)
        return Learnt(estimator, report, simulated, groups)


class _Concluded(NamedTuple):
    """The conclusion of a step: belief, history of a machine that may change, alpha of the groups, next proposal."""

    belief: Belief
    history: History | None
    alpha: Float[Tensor, " G"]
    decision: Decision


def _doubts(report: FitReport) -> list[str]:
    """Return a warning if a fit learnt nothing, else nothing."""
    if not report.validation or min(report.validation) <= PRIOR_LOSS:
        return []
    return [
        f"the estimator learnt nothing (validation loss {min(report.validation):.2f} nats, 0 for the uniform density):"
        " the fit was too short, the embedding collapsed, or the trajectories do not depend on theta"
    ]


def _keep_nothing(_state: OnlineState, _now: bool) -> None:
    """Without a run folder there is nothing to save to."""
