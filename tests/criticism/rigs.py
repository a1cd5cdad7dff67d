"""A small slide whose truth is known, and what a noisy sensor reads off it."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDict

from onlinebayes.criticism import held_out_errors, prepare
from onlinebayes.criticism.hypotheses import Explanation, explanation_of, run_search, start_search
from onlinebayes.criticism.hypotheses.search import MOST_ADDITIONS
from onlinebayes.identification.judging.evaluator import Evaluation
from onlinebayes.identification.splitting import split
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import MujocoSimulator

SLIDE = """
<mujoco><option timestep="0.01" integrator="RK4" gravity="0 0 -9.81"/><worldbody><body name="cart">
  <joint name="rail" type="slide" axis="1 0 0" damping="1"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
</body></worldbody><actuator><motor name="motor" joint="rail"/></actuator></mujoco>"""

FREE = ParameterSpace(
    {"body.cart.mass": Parameter(0.5, 8.0, "kg"), "joint.rail.damping": Parameter(0.0, 10.0, "N s/m")}
)
TRUTH = (2.5, 1.4)
NOISE = 1e-4


def model(parameters: ParameterSpace = FREE) -> MujocoSimulator:
    return MujocoSimulator(SLIDE, parameters, threads=1)


def commands(runs: int, rows: int, step: float, seed: int) -> torch.Tensor:
    """Three tones a run, other ones in each (runs, rows, 1) [N]."""
    draw = torch.Generator().manual_seed(seed)
    t = torch.arange(rows, dtype=torch.float64) * step
    frequency = 0.3 + 1.7 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    phase = 6.3 * torch.rand(runs, 3, 1, generator=draw, dtype=torch.float64)
    return 4.0 * torch.sin(6.2832 * frequency * t + phase).sum(1)[..., None]


def measure(
    effects: dict[Effect, tuple[float, ...]] | None = None,
    *,
    runs: int = 9,
    seconds: float = 3.0,
    noise: float = NOISE,
    seed: int = 0,
    truth: tuple[float, ...] = TRUTH,
    parameters: ParameterSpace = FREE,
    finer: int = 1,
    simulator: MujocoSimulator | None = None,
    off: tuple[float, float] | None = None,
) -> Measurement:
    """Runs of the slide with these effects hidden in it; each from rest at 0; integrated with steps so much finer.

    The motor gives no force from ``off[0]`` to ``off[1]`` [s], and the table commands as ever.
    """
    step, rows = 0.01, round(seconds / 0.01) + 1
    simulator, theta = (simulator or model(parameters)).with_timestep(0.01 / finer), list(truth)
    for effect, values in (effects or {}).items():
        simulator, theta = simulator.with_effect(effect), theta + list(values)
    command = commands(runs, rows, step, seed)
    zero = torch.zeros(runs, 1, dtype=torch.float64)
    times = torch.arange(1, rows, dtype=torch.float64) * step
    given = command.clone()
    if off is not None:
        given[:, round(off[0] / step) : round(off[1] / step)] = 0.0
    path = simulator.rollout(
        torch.tensor(theta, dtype=torch.float64).expand(runs, -1),
        TensorDict({"qpos": zero, "qvel": zero}, batch_size=(runs,)),
        TensorDict({"command": given[:, :-1]}, batch_size=(runs, rows - 1)),
        times,
    )
    angle = torch.cat([zero, path["qpos"][..., 0]], 1)
    angle = angle + noise * torch.randn(
        angle.shape, generator=torch.Generator().manual_seed(seed + 1), dtype=angle.dtype
    )
    time = torch.arange(rows, dtype=torch.float64) * step
    table = {
        f"run{r}": {"time": time.numpy(), "ctrl.motor": command[r, :, 0].numpy(), "qpos.rail": angle[r].numpy()}
        for r in range(runs)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=noise)], commands=["motor"])


def explain(
    simulator: MujocoSimulator,
    measurement: Measurement,
    holdout: Sequence[str],
    candidates: str | Sequence[str | Effect] = "all",
) -> Explanation:
    """The search alone, on the runs that are there to fit."""
    task = prepare(simulator, measurement, holdout, None, None)
    search = run_search(start_search(task.simulator, task.fit_runs), task.fit_runs, candidates, most=MOST_ADDITIONS)
    return explanation_of(search)


def held_out_error(
    explanation: Explanation, evaluation: Evaluation, measurement: Measurement, holdout: Sequence[str]
) -> float:
    """RMS of the position over the held-out runs [m]."""
    runs = split(measurement.seen(), holdout)[1]
    return held_out_errors(explanation.evaluator, evaluation, runs, explanation.windows.horizon)["qpos.rail"]
