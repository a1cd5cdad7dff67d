"""A run whose model grows: at stated moments criticism looks at the real trajectories, and what it finds is added.

    for t = 1, 2, ...
        after steps m in moments:   f = critic(x_real)                       effects, or nothing
            simulator <- the first simulator with f,   theta <- (theta, phi)
            p(theta, phi) = p(theta) u(phi)                                  the belief, until it is inferred anew:
            p(theta, phi) = q(theta, phi | all x_real so far)                from simulations of the whole prior
        where f leaves a choice, h_1 ... h_K with weights w_k, and x are real trajectories since:
            w_k ~ w_k p(x | h_k)                                             see ``hypotheses``
            simulator <- the first simulator with h_k, and so on as above,   where w_k is clear of the others
        one outer step of the trainer                                        Algorithm 1, see ``online``

Knowledge is kept as real trajectories, which tell the grown model of old and new parameters alike. The old proposal is
not kept: a model that lacked the effect has cut it, and bent the old parameters to make up for what was missing. The
policy learns on as it stands, and the real system goes on.

The critic is always asked about the first model: more data may say that it was another effect, which then takes the
place of the one before. Where it finds nothing, what was added stays. Where it finds several models that do as well,
their weights are a part of what is known of the machine: each new trajectory changes them, between the moments too,
and the model changes when one is clear.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from onlinebayes.inference import extended
from onlinebayes.runs import BadInput, Interrupt, one_line
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.effects.plain import from_plain, to_plain
from onlinebayes.trainers.critic import Critic, Finding, Weigher
from onlinebayes.trainers.online import STOPPING, Checkpoint, OnlineTrainer
from onlinebayes.trainers.problem import Problem
from onlinebayes.trainers.state import OnlineState


class GrowingTrainer:
    """An :class:`OnlineTrainer` over a problem that grows.

    Args:
        problem: as it is thought to be when the run begins.
        build: problem -> the trainer over it; each call has to give it the same objective and the same real system.
        critic: is asked for what the model lacks; one that is a :class:`.Weigher` also weighs what it left open.
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
            if self._news(state) and state.step < steps:
                if not self._weigh(state):
                    state.interrupted = True
                    return state
                if checkpoint is not None:
                    checkpoint(state, True)
            if state.step in self.moments and state.step < steps and state.criticised < state.step:
                if not self._ask(state):
                    state.interrupted = True
                    return state
                if checkpoint is not None:
                    checkpoint(state, True)
            until = min((moment for moment in self.moments if moment > state.step), default=steps)
            until = until if state.hypotheses is None else state.step + 1
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
        own = simulator.own_effects if isinstance(simulator, Extensible) else {}
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
        if finding.effects or finding.hypotheses is not None:
            state.hypotheses, state.weighed = finding.hypotheses, 0 if state.real is None else len(state.real)
        return self._become(state, finding.effects) if finding.effects else True

    def _become(self, state: OnlineState, effects: Sequence[Effect]) -> bool:
        """Grow where the model has not just these effects, and infer anew; False where Ctrl-C ended it."""
        found = [to_plain(effect) for effect in effects]
        if _keys(found) == _keys(state.effects):
            return True
        began = time.monotonic()
        self.grow(effects)
        state.effects, state.history = found, None  # which speaks of the old parameters
        old, space = state.belief, self.problem.space
        grows = space.names[: len(old.space)] == old.space.names
        state.belief, state.proposal = extended(old, space) if grows else self.problem.prior, self.problem.prior
        state.notes.append(f"the model grew: {', '.join(sorted(_keys(found)))}")
        whole = self.trainer.infer(state)
        state.aside["growing"] = time.monotonic() - began
        return whole

    def _news(self, state: OnlineState) -> bool:
        """Check whether there are real trajectories that the weights of the open hypotheses do not know."""
        open_ = state.hypotheses is not None and isinstance(self.critic, Weigher)
        return open_ and state.real is not None and state.weighed < len(state.real)

    def _weigh(self, state: OnlineState) -> bool:
        """Let new real trajectories change the weights, and the model where one is clear; False after Ctrl-C."""
        assert state.hypotheses is not None
        assert state.real is not None
        assert isinstance(self.critic, Weigher)
        new, began = state.real[state.weighed :], time.monotonic()
        now, told = state.hypotheses, ""
        with Interrupt(STOPPING) as interrupt:
            try:
                with interrupt.giving_up():
                    now = state.hypotheses.after(self.critic.scores(new, self.first, state.hypotheses))
                told = f"weights after {len(new)} new real trajectories: {now.words}"
            except BadInput as error:
                told = one_line(f"{len(new)} new real trajectories cannot be weighed ({error}); {now.words} as before")
            if interrupt.requested:
                return False
        state.hypotheses, state.weighed, state.aside["weighing"] = now, len(state.real), time.monotonic() - began
        state.notes.append(told)
        clear = now.clear
        if clear is None:
            return True
        if not clear.moves(self.first.simulator):
            state.notes.append(f"{' + '.join(clear.keys)} is no law of motion; the model stays as it was")
            return True
        return self._become(state, clear.added_to(self.first.simulator))

    def _finding(self, state: OnlineState, interrupt: Interrupt) -> Finding:
        """Ask the critic for its finding; one that cannot use the trajectories says why."""
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
