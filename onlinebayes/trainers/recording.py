"""A run as a picture of itself: told to the loggers after every step, and left as ``run.rrd`` and ``run.html``.

The episode that moves is played by the hidden system where its parameters are known, and by the simulator at the
belief's mean under the same commands from the same start: where the two part, the belief is still wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.inference import Belief, BoxUniform, plots
from onlinebayes.loggers.page import Curves, Page, write_page
from onlinebayes.loggers.recorder import RunRecorder
from onlinebayes.simulators import Drawable, Shape
from onlinebayes.simulators.drawing import render, scene, view_of
from onlinebayes.trainers.problem import Problem
from onlinebayes.trainers.state import OnlineState, Record
from onlinebayes.trainers.trajectories import Policy

FRAMES = 8  # of the film strip
MOST_POSES = 500  # of an episode


@dataclass(frozen=True)
class Episode:
    """One system along one episode.

    Attributes:
        shapes: of the system.
        poses: (T, S, 7).
    """

    shapes: tuple[Shape, ...]
    poses: Float[Tensor, "T S 7"]


@dataclass
class Recording:
    """Watches a run; see the module.

    Args:
        folder: of the run.
        name: of the recipe.
        problem: system, task, prior.
        policy: that is trained.
        truth: parameters of the hidden system (P,), where they are known.
    """

    folder: Path
    name: str
    problem: Problem
    policy: Policy
    truth: Float[Tensor, " P"] | None = None
    _recorder: RunRecorder = field(init=False)

    def __post_init__(self) -> None:
        seconds = self.problem.simulator.dt * min(self.problem.task.horizon, MOST_POSES)
        self._recorder = RunRecorder(self.folder, self.name, self.problem.space, seconds=seconds, truth=self.truth)

    def __call__(self, state: OnlineState) -> None:
        """Record a complete step, and write the page anew."""
        record, recorder = state.records[-1], self._recorder
        recorder.step(record.step, _scalars(record))
        recorder.belief(record.step, state.belief, state.proposal)
        recorder.summary(record.step, _summary(self.name, state))
        corner = self._corner(state.belief)
        recorder.picture(record.step, "corner", corner)
        played = self._play(state)
        for name, episode in played.items():
            dt = self.problem.simulator.dt
            recorder.episode(record.step, name, episode.shapes, episode.poses, dt, ghost=name == "simulated")
        recorder.flush()
        pictures = {"The belief": corner}
        if played:
            pictures["An episode: the real system, and pale the simulator at the belief's mean"] = _strip(played)
        write_page(_page(self.name, state, self.truth, pictures), self.folder / "run.html")

    def close(self) -> None:
        """Close the recording."""
        self._recorder.close()

    def _corner(self, belief: Belief) -> np.ndarray:
        prior = self.problem.prior
        box = prior if isinstance(prior, BoxUniform) else None
        figure = plots.corner(belief, truth=self.truth, prior=box, title=self.name)
        figure.canvas.draw()
        return np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]

    def _play(self, state: OnlineState) -> dict[str, Episode]:
        """The real system's episode where the truth is known, and the simulator's under the same commands."""
        simulator = self.problem.simulator
        if not isinstance(simulator, Drawable):
            return {}
        mean = torch.tensor([m for m, _ in state.records[-1].belief.values()], dtype=simulator.dtype)
        mean = simulator.parameters.clamp(mean)
        truth = mean if self.truth is None else self.truth
        states, commands = play(self.problem, self.policy, truth)
        systems = (simulator, self.problem.task)
        episodes = {"real": Episode(*scene(systems, truth, states))}
        if self.truth is not None:
            times = simulator.dt * torch.arange(1, len(commands) + 1, dtype=torch.float64)
            inputs = TensorDict({"command": commands[None]}, batch_size=(1, len(commands)))
            again = simulator.rollout(mean[None], states[:1], inputs, times)[0].exclude("valid")
            again = cast(TensorDict, torch.cat([states[:1].select(*again.keys(True, True)), again]))
            if "task" in states:
                again.set("task", states.get("task"))
            episodes["simulated"] = Episode(*scene(systems, mean, again))
        return episodes


@torch.no_grad()
def play(problem: Problem, policy: Policy, theta: Float[Tensor, " P"]) -> tuple[TensorDict, Tensor]:
    """States (T + 1,) and commands (T, U) of one episode under the policy's deterministic action, to its end."""
    simulator, task = problem.simulator.with_worlds(1), problem.task
    theta = theta.to(simulator.dtype)[None]
    start = task.start(theta, torch.Generator().manual_seed(0))
    constant = start.pop("task", None)

    def shown(state: TensorDict) -> TensorDict:
        return state if constant is None else state.clone().set("task", constant)

    states, commands = [shown(simulator.reset(theta, start))], []
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        for _ in range(min(task.horizon, MOST_POSES)):
            seen = task.observe(states[-1])
            values = seen if isinstance(seen, dict) else {"observation": seen}
            action = policy(TensorDict({**values, "theta": theta}, batch_size=(1,)))["action"]
            command = task.command(action).to(simulator.dtype)
            inputs = TensorDict({"command": command}, batch_size=(1,))
            states.append(shown(simulator.step(inputs)))
            commands.append(command[0])
            if bool(task.terminated(states[-1])) or bool(simulator.failed):
                break
    return torch.cat(states), torch.stack(commands)


def _scalars(record: Record) -> dict[str, float]:
    values = {f"figures/{name}": value for name, value in record.figures.items()}
    values |= {f"losses/{name}": value for name, value in record.losses.items()}
    values |= {f"seconds/{name}": value for name, value in record.seconds.items()}
    values["frames"] = float(record.frames)
    if record.fit is not None and record.fit.validation:
        values["fit/validation loss"] = min(record.fit.validation)
    if record.coverage is not None:
        values["fit/coverage of the 95 % region"] = record.coverage
    return values


def _summary(name: str, state: OnlineState) -> str:
    record = state.records[-1]
    figures = "".join(f"\n| {key} | {value:.4g} |" for key, value in record.figures.items())
    belief = "".join(f"\n| {key} | {mean:.4g} ± {sd:.2g} |" for key, (mean, sd) in record.belief.items())
    notes = "".join(f"\n- {note}" for note in record.notes)
    return f"# {name}, step {record.step}\n\n| | |\n|---|---|\n| frames | {record.frames} |{figures}{belief}\n{notes}\n"


def _strip(played: Mapping[str, Episode]) -> np.ndarray:
    """The episode in a few frames side by side, the simulated system pale behind the real one."""
    real, simulated = played["real"], played.get("simulated")
    places = torch.linspace(0, len(real.poses) - 1, FRAMES).round().long().tolist()
    view = view_of(real.shapes, real.poses)
    tall = (view.high[1] - view.low[1]) / (view.high[0] - view.low[0])
    size = (round(240 * min(1.0, tall)), 240)
    frames = []
    for k in places:
        behind = None if simulated is None else (simulated.shapes, simulated.poses[min(k, len(simulated.poses) - 1)])
        frames.append(render(real.shapes, real.poses[k], size=size, view=view, ghost=behind))
    half = FRAMES // 2
    return np.concatenate([np.concatenate(row, axis=1) for row in (frames[:half], frames[half:])])


def _page(name: str, state: OnlineState, truth: Tensor | None, pictures: Mapping[str, np.ndarray]) -> Page:
    records, last = state.records, state.records[-1]
    steps = [record.step for record in records]
    rows = []
    for i, (parameter, (mean, sd)) in enumerate(last.belief.items()):
        unit = state.belief.space[parameter].unit
        true = [] if truth is None else [f"{float(truth[i]):.4g}"]
        rows.append([parameter, unit, f"{mean:.4g}", f"{sd:.2g}", *true])
    charts = []
    for i, parameter in enumerate(last.belief):
        means, sds = (np.array([record.belief[parameter][k] for record in records]) for k in (0, 1))
        band = {"belief": ((means - sds).tolist(), (means + sds).tolist())}
        level = {} if truth is None else {"truth": float(truth[i])}
        charts.append(Curves(parameter, ("step", steps), {"belief": means.tolist()}, band, level))
    for figure in last.figures:
        values = [record.figures.get(figure, float("nan")) for record in records]
        charts.append(Curves(figure, ("simulated frames", [r.frames for r in records]), {figure: values}, {}, {}))
    seconds: dict[str, float] = {}
    for record in records:
        for part, value in record.seconds.items():
            seconds[part] = seconds.get(part, 0.0) + value
    lead = f"{last.step} steps, {last.frames} simulated frames for the policy, {last.simulated} for the belief"
    notes = [f"step {record.step}: {note}" for record in records for note in record.notes]
    head = ["parameter", "unit", "mean", "sd", *([] if truth is None else ["truth"])]
    return Page(name, lead, head, rows, charts, pictures, seconds, notes)
