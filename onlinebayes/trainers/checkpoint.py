"""The complete state of a run, which goes on as if never stopped, to the last bit on the same machine and threads.

Of worlds that cannot say where they stand, what can be told is kept, see ``env_state``: a run that was stopped while
its policy learnt goes on from fresh episodes.

| part          | what it holds                                                                        |
|---------------|--------------------------------------------------------------------------------------|
| ``online``    | belief, proposal, real trajectories, their policies, records, effects, what is open  |
| ``objective`` | networks, optimisers, replay memory                                                  |
| ``collector`` | the worlds that the policy learns in, and the step each of them stands at            |
| ``simulations``, ``held_out``, ``real`` | worlds and sensors of the simulations, and of the system, if it can tell |
| ``generator``, ``random`` | every random number's state                                              |
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import torch
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, TransformedEnv

from onlinebayes.runs import BadInput, Checkpoints, Stateful, one_line, random_state, restore_part, set_random_state
from onlinebayes.trainers.env_state import collector_state, load_collector_state, stands
from onlinebayes.trainers.growing import GrowingTrainer
from onlinebayes.trainers.improve import Batches
from onlinebayes.trainers.online import OnlineTrainer
from onlinebayes.trainers.state import OnlineState


class Saver:
    """Saves a run wherever its trainer says that it could go on from.

    Args:
        trainer: whose parts are saved.
        checkpoints: where they go.
        every: least time between two saves in the middle of a step [s].
    """

    def __init__(
        self, trainer: OnlineTrainer | GrowingTrainer, checkpoints: Checkpoints, *, every: float = 30.0
    ) -> None:
        self.trainer, self.checkpoints, self.every = trainer, checkpoints, every
        self._last = time.monotonic()

    def __call__(self, state: OnlineState, now: bool) -> None:
        """Save now, or if it is time again."""
        if now or time.monotonic() - self._last >= self.every:
            self.checkpoints.save(run_state(self.trainer, state))
            self._last = time.monotonic()

    def resume(self, state: OnlineState) -> bool:
        """Bring state and trainer to the newest whole checkpoint; False where there is none.

        Raises:
            BadInput: no checkpoint is whole, or they are of other networks, worlds or parameters.
        """
        found = self.checkpoints.load(None if torch.cuda.is_available() else "cpu")
        if found is None:
            return False
        try:
            load_run_state(self.trainer, state, found.state)
        except BadInput:
            raise
        except (RuntimeError, KeyError, ValueError) as error:
            raise BadInput(
                f"the checkpoint does not fit this run: {one_line(str(error))[:300]}",
                "go on with the settings that began it, or choose another folder",
                where=str(found.path),
            ) from error
        return True


def fresh_episodes(trainer: OnlineTrainer | GrowingTrainer) -> str | None:
    """One line, where a run that goes on is not the same to the last bit; None where it is."""
    collector = (trainer.trainer if isinstance(trainer, GrowingTrainer) else trainer).collector
    env = getattr(collector, "env", None)
    if not isinstance(env, EnvBase) or stands(env):
        return None
    kind = type(env.base_env if isinstance(env, TransformedEnv) else env).__mro__
    name = next(each.__name__ for each in kind if not each.__module__.startswith("onlinebayes"))
    return (
        f"worlds of a {name} cannot say where they stand in an episode: stopped while its policy learns, this run goes"
        " on from fresh episodes, not to the same last bit"
    )


def run_state(trainer: OnlineTrainer | GrowingTrainer, state: OnlineState) -> dict[str, Any]:
    """See the module."""
    if isinstance(trainer, GrowingTrainer):
        trainer = trainer.trainer
    collector = trainer.collector
    return {
        "online": state.state_dict(),
        "objective": trainer.objective.state_dict(),
        "collector": _collector_state(collector),
        "simulations": trainer.simulations.state_dict(),
        "held_out": trainer.held_out.state_dict(),
        "real": trainer.real.state_dict() if isinstance(trainer.real, Stateful) else None,
        "generator": trainer.generator.get_state(),
        "random": random_state(),
    }


def load_run_state(trainer: OnlineTrainer | GrowingTrainer, state: OnlineState, saved: Mapping[str, Any]) -> None:
    """Bring a trainer and a state that were built anew to where the run stood, with the effects that it had added."""
    if isinstance(trainer, GrowingTrainer):
        trainer.regrow(state, saved["online"])
        trainer = trainer.trainer
    restore_part("objective", trainer.objective, saved["objective"])
    state.load_state_dict(saved["online"])
    if saved["collector"] is None:
        pass  # a collector of one's own that could not tell
    elif isinstance(trainer.collector, Collector):
        state.anew = not load_collector_state(trainer.collector, saved["collector"])
    elif isinstance(trainer.collector, Stateful):
        restore_part("collector", trainer.collector, saved["collector"])
    trainer.simulations.load_state_dict(saved["simulations"])
    trainer.held_out.load_state_dict(saved["held_out"])
    if saved["real"] is not None and isinstance(trainer.real, Stateful):
        restore_part("real", trainer.real, saved["real"])
    trainer.generator.set_state(saved["generator"].cpu())
    set_random_state(saved["random"])


def _collector_state(collector: Batches) -> dict[str, Any] | None:
    """Return the state of a collector; None if it has none to give."""
    if isinstance(collector, Collector):
        return collector_state(collector)
    return collector.state_dict() if isinstance(collector, Stateful) else None
