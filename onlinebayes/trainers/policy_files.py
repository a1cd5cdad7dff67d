"""Leaves the policy and the belief of a run in its folder after each step, for use without the trainer.

| file                         | what it holds                                                        |
|------------------------------|----------------------------------------------------------------------|
| ``policy.safetensors``       | the network and its card; ``onlinebayes.load_policy(folder)``        |
| ``policy.md``                | the card for a reader                                                |
| ``belief.safetensors``       | the belief; ``onlinebayes.inference.saving.load(path)``              |
| ``best/``                    | the policy of the step with the highest return, where it is judged   |
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from onlinebayes.inference.saving import save
from onlinebayes.objectives import Objective, save_policy
from onlinebayes.policies import Channels, Origin
from onlinebayes.runs import BadInput, DiskFull
from onlinebayes.trainers.env_problem import EnvProblem
from onlinebayes.trainers.problem import Problem, Worlds
from onlinebayes.trainers.state import OnlineState


@dataclass
class PolicyFiles:
    """Is told of every step.

    Args:
        folder: of the run.
        recipe: its name.
        objective: its policy is left.
        problem: that the policy learns in.
        worlds: that the policy learns in, in words; those of the belief without it.
    """

    folder: Path
    recipe: str
    objective: Objective
    problem: Worlds
    worlds: str = ""
    _told: set[str] = field(default_factory=set, init=False)

    def __call__(self, state: OnlineState) -> None:
        """Write the files; what cannot be written is said once, in one line.

        Raises:
            DiskFull: there is no room.
        """
        origin = self._origin(state)
        self._attempt("policy.safetensors", lambda: save_policy(self.folder, self.objective.policy, origin))
        if self._is_best(state):
            self._attempt(
                "policy.safetensors", lambda: save_policy(self.folder / "best", self.objective.policy, origin)
            )
        if len(state.belief.space):
            self._attempt("belief.safetensors", lambda: save(state.belief, self.folder / "belief.safetensors"))

    def _attempt(self, name: str, write: Callable[[], None]) -> None:
        try:
            write()
        except DiskFull:
            raise
        except BadInput as error:
            if name not in self._told:
                print(f"no {name} is written: {error}", file=sys.stderr, flush=True)
            self._told.add(name)

    def _origin(self, state: OnlineState) -> Origin:
        problem, name, record = self.problem, type(self.objective).__name__, state.records[-1]
        known = self.worlds or _belief_in_words(state)
        about: tuple[str, Channels, float | None] = type(problem).__name__, {}, None
        if isinstance(problem, Problem):
            about = type(problem.task).__name__, problem.task.channels, problem.simulator.dt
        elif isinstance(problem, EnvProblem):
            about = problem.name or about[0], problem.channels, None
        score = record.figures.get("return")
        return Origin(*about, name, known, record.frames, score, self.recipe)

    @staticmethod
    def _is_best(state: OnlineState) -> bool:
        """Whether the last step's return is the highest so far."""
        scores = [record.figures["return"] for record in state.records if "return" in record.figures]
        return "return" in state.records[-1].figures and scores[-1] == max(scores)


def _belief_in_words(state: OnlineState) -> str:
    """The worlds of the last step's policy: of the belief as that step found it."""
    if not len(state.belief.space):
        return "worlds without unknown parameters"
    if len(state.records) < 2:
        return "worlds of the prior"
    space, told = state.belief.space, []
    for name, (mean, sd) in state.records[-2].belief.items():
        told.append(f"{name} {mean:.4g} ± {sd:.2g} {space[name].unit}".rstrip())
    return f"worlds of the belief: {', '.join(told)}"
