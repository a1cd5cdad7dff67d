"""The parts of an experiment: problem, trainer, hidden truth, and the judgement of a run of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

from jaxtyping import Float
from torch import Tensor
from typing_extensions import TypeVar

from onlinebayes.trainers import OnlineState, OnlineTrainer, Player, Policy, Problem, SimulatedPlayer, Worlds
from onlinebayes.trainers.distributed import Workers

P = TypeVar("P", bound=Worlds, default=Problem, covariant=True)


@dataclass(frozen=True)
class Run(Generic[P]):
    """The parts of one run.

    Attributes:
        problem: system, task, prior, sensors.
        trainer: all parts together.
        truth: hidden from the trainer; judges the run.
        player: shows the hidden system; the problem's own without it.
        to_beat: return that the policy has to beat, where the run is about the policy alone.
        figures: gives further figures for the log of each outer step.
        workers: that step the trainer's worlds, to be closed at the end.
        score: (policy, truth) -> return on the real system, where that is another one than the problem's.
    """

    problem: P
    trainer: OnlineTrainer
    truth: Float[Tensor, " P"]
    player: Player | None = None
    to_beat: float | None = None
    figures: Callable[[], dict[str, float]] = dict
    workers: Workers | None = None
    score: Callable[[Policy, Float[Tensor, " P"]], float] | None = None

    def close(self) -> None:
        """End what the run has started."""
        if self.workers is not None:
            self.workers.close()

    def judge(self, state: OnlineState) -> dict[str, float]:
        """Log density of the truth, and the policy's return on the real system."""
        return {
            "return": (self.score or self.problem.score)(self.trainer.objective.policy, self.truth),
            "log density of the truth": float(state.belief.log_prob(self.truth)),
            **self.figures(),
        }

    def seen_by(self) -> Player | None:
        """Return the player that shows the hidden system."""
        if self.player is None and isinstance(self.problem, Problem):
            return SimulatedPlayer(self.problem, self.trainer.objective.policy, self.truth)
        return self.player
