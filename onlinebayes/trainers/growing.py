"""A run whose model grows: at stated moments criticism looks at the real trajectories, and what it finds is added.

    for t = 1, 2, ...
        after steps m in moments:   f = critic(x_real)                       effects, or nothing
            simulator <- the first simulator with f,   theta <- (theta, phi)
            p(theta, phi) = p(theta) u(phi)                                  the belief, until it is inferred anew:
            p(theta, phi) = q(theta, phi | all x_real so far)                from simulations of the whole prior
        one outer step of the trainer                                        Algorithm 1, see ``online``

Knowledge is kept as real trajectories, which tell the grown model of old and new parameters alike. The old proposal is
not kept: a model that lacked the effect has cut it, and bent the old parameters to make up for what was missing. The
policy learns on as it stands, and the real system goes on.

The critic is always asked about the first model: more data may say that it was another effect, which then takes the
place of the one before. Where it finds nothing, what was added stays.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from onlinebayes.inference import extended
from onlinebayes.runs import BadInput, Interrupt, one_line
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.effects.plain import from_plain, to_plain
from onlinebayes.trainers.critic import Critic, Finding
from onlinebayes.trainers.online import STOPPING, Checkpoint, OnlineTrainer
from onlinebayes.trainers.problem import Problem
from onlinebayes.trainers.state import OnlineState


class GrowingTrainer:
    """An :class:`OnlineTrainer` over a problem that grows.

    Args:
        problem: as it is thought to be when the run begins.
        build: problem -> the trainer over it; each call has to give it the same objective and the same real system.
        critic: is asked for what the model lacks.
        moments: numbers of complete outer steps after which it is asked.

    Attributes:
        first: the problem when the run began.
        problem: as it is now.
        trainer: over it.

    Raises:
        BadInput: a moment before the first step.
    """

    def __init__(
        self,
        problem: Problem,
        build: Callable[[Problem], OnlineTrainer],
        critic: Critic,
        moments: Collection[int],
    ) -> None:
        if any(moment < 1 for moment in moments):
            raise BadInput(
                f"moments {sorted(moments)}", "criticism needs a complete outer step: give numbers from 1 on"
            )
        self.first = self.problem = problem
        self.trainer = build(problem)
        self.critic, self.moments = critic, sorted(moments)
        self._build = build

    def run(
        self,
        state: OnlineState,
        *,
        on_step: Callable[[OnlineState], None] | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> OnlineState:
        """As :meth:`OnlineTrainer.run`; what the critic says stands in the notes of the step that follows."""
        steps = len(self.trainer.schedule.turns)
        while True:
            if state.step in self.moments and state.step < steps and state.criticised < state.step:
                if not self._ask(state):
                    state.interrupted = True
                    return state
                if checkpoint is not None:
                    checkpoint(state, True)
            until = min((moment for moment in self.moments if moment > state.step), default=steps)
            self.trainer.run(state, on_step=on_step, checkpoint=checkpoint, until=until)
            if state.interrupted or state.step >= steps:
                return state

    def grow(self, effects: Sequence[Effect]) -> None:
        """Let the problem be the first one with these effects, and build the trainer over it anew."""
        simulator = self.first.simulator
        for effect in effects:
            simulator = simulator.with_effect(effect)
        self.problem = replace(self.first, simulator=simulator, prior=extended(self.first.prior, simulator.parameters))
        self.trainer = self._build(self.problem)

    def regrow(self, state: OnlineState, saved: Mapping[str, Any]) -> None:
        """Add what a saved run had added, so that the rest of it fits; ``saved`` is the state as plain values."""
        simulator = self.first.simulator
        own = simulator.own_effects if isinstance(simulator, Identifiable) else {}
        effects = [from_plain(effect, {**EFFECTS, **own}) for effect in saved.get("effects", ())]
        if effects:
            self.grow(effects)
            state.belief = state.proposal = self.problem.prior

    def _ask(self, state: OnlineState) -> bool:
        """Let the critic look, and grow where it finds something new; False where Ctrl-C ended it."""
        began = time.monotonic()
        with Interrupt(STOPPING) as interrupt:
            finding = self._finding(state, interrupt)
            if interrupt.requested:
                return False
        state.criticised, state.aside["criticism"] = state.step, time.monotonic() - began
        state.notes.append(finding.words)
        found = [to_plain(effect) for effect in finding.effects]
        if not found or _keys(found) == _keys(state.effects):
            return True
        began = time.monotonic()
        self.grow(finding.effects)
        state.effects, state.history = found, None  # which speaks of the old parameters
        old, space = state.belief, self.problem.space
        grows = space.names[: len(old.space)] == old.space.names
        state.belief, state.proposal = extended(old, space) if grows else self.problem.prior, self.problem.prior
        state.notes.append(f"the model grew: {', '.join(sorted(_keys(found)))}")
        whole = self.trainer.infer(state)
        state.aside["growing"] = time.monotonic() - began
        return whole

    def _finding(self, state: OnlineState, interrupt: Interrupt) -> Finding:
        """What the critic says; one that cannot use the trajectories says why."""
        if state.real is None:
            return Finding((), "there is no real trajectory to criticise yet")
        try:
            with interrupt.giving_up():
                return self.critic(state.real, self.first, interrupt)
        except BadInput as error:
            told = one_line(f"the trajectories cannot be criticised ({error}); the model stays as it was")
            return Finding((), told)
        return Finding((), "criticism was stopped; the model stays as it was")


def _keys(effects: Sequence[Mapping[str, Any]]) -> set[str]:
    """``name@target`` of effects as plain values."""
    return {f"{effect['name']}@{effect['target']}" for effect in effects}
