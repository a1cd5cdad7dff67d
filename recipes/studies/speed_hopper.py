"""Speed at which MuJoCo's worlds are stepped: the Hopper half of ``make bench``.

1024 hoppers with twenty parameters each, random commands, four timesteps a command, worlds that fall start anew with
fresh parameters, against the shortest loop over ``mujoco.batch`` that keeps as many hoppers going: the same model, the
same fields per world, the same threads, its fallen worlds put back by writing their state.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import mujoco.batch
import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.envs import TransformedEnv

from envs.hopper import PHYSICAL, HopperTask, hopper
from envs.hopper.task import FALLEN, TILTED
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.timing import Pairs, alternate, median, rate, spread

GOAL_STEP, GOAL_COLLECTOR = 0.9, 0.65


@dataclass(frozen=True)
class Bench:
    """Options of the measurements.

    Args:
        worlds: number of hoppers.
        threads: that step them.
        seconds: of each measurement [s].
        seed: of parameters, starts and commands.
    """

    worlds: int = 1024
    threads: int = 2
    seconds: float = 2.0
    seed: int = 0


class UniformPhysics:
    """Uniform on the unit cube of the hopper's parameters."""

    def sample(self, shape: tuple[int, ...]) -> Tensor:
        """Draws (*shape, 20) [SI]."""
        return PHYSICAL.from_unit(torch.rand(*shape, len(PHYSICAL), dtype=torch.float64))


def raw(bench: Bench) -> Callable[[], float]:
    """A measurement: command steps/s of a bare ``mujoco.batch`` loop."""
    simulator = hopper(threads=1)
    batch = mujoco.batch.Batch(simulator.model, bench.worlds, bench.threads)
    theta = UniformPhysics().sample((bench.worlds,)).numpy()
    for name, values in simulator.fields(theta).items():
        batch.expand(name)[...] = values.reshape(batch.expand(name).shape)
    batch.set_const()
    state, qpos, ctrl = batch.state, batch.bind("qpos"), batch.bind("ctrl")
    rest, generator = state[0].copy(), np.random.default_rng(bench.seed)
    substeps = round(simulator.dt / simulator.timestep)

    def advance() -> int:
        ctrl[...] = generator.uniform(-1.0, 1.0, ctrl.shape)
        batch.step(nstep=substeps)
        fallen = (qpos[:, 1] < FALLEN) | (np.abs(qpos[:, 2]) > TILTED)
        state[fallen] = rest
        return bench.worlds

    return lambda: rate(advance, bench.seconds)


def stepped(bench: Bench) -> Callable[[], float]:
    """A measurement: command steps/s of ``MujocoSimulator.step``, with fresh parameters for worlds that fell."""
    simulator, task, prior = hopper(worlds=bench.worlds, threads=bench.threads), HopperTask(), UniformPhysics()
    generator = torch.Generator().manual_seed(bench.seed)
    start = TensorDict({k: torch.zeros(bench.worlds, 6).double() for k in ("qpos", "qvel")}, batch_size=[bench.worlds])
    simulator.reset(prior.sample((bench.worlds,)), start)

    # Drawn beforehand: who draws parameters, and how, is not the simulator's.
    drawn = itertools.cycle(prior.sample((64 * bench.worlds,)).split(bench.worlds))

    def advance() -> int:
        command = 2 * torch.rand(bench.worlds, 3, generator=generator, dtype=torch.float64) - 1
        state = simulator.step(TensorDict({"command": command}, batch_size=[bench.worlds]))
        over = task.terminated(state) | simulator.failed
        simulator.reset(next(drawn), start, over)
        return bench.worlds

    return lambda: rate(advance, bench.seconds)


def collected(bench: Bench) -> Callable[[], float]:
    """A measurement: frames/s of a Collector with a random policy."""
    simulator = hopper(worlds=bench.worlds, threads=bench.threads)
    env = TransformedEnv(
        SimulatorEnv(simulator, HopperTask(), seed=bench.seed), ParameterRandomization(UniformPhysics())
    )
    batch = bench.worlds * 16
    collector = Collector(env, None, frames_per_batch=batch, total_frames=-1, trust_policy=True, track_traj_ids=False)
    batches = iter(collector)

    def advance() -> int:
        data = next(batches)
        assert data["next", "reward"].numel() == batch
        return batch

    return lambda: rate(advance, bench.seconds)


def hopper_rows(table: ResultTable, bench: Bench) -> None:
    """Measure and add the Hopper's rows."""
    seed_everything(bench.seed)
    cases = (("simulator.step", stepped, GOAL_STEP), ("Collector, random policy", collected, GOAL_COLLECTOR))
    for k, (name, make, goal) in enumerate(cases):
        pairs = alternate(make(bench), raw(bench))
        if k == 0:
            _add(table, f"Hopper, {bench.worlds} worlds, raw mujoco.batch", pairs.reference)
        _add(table, f"Hopper, {bench.worlds} worlds, {name}", pairs.ours)
        _add_ratio(table, f"Hopper, {name} over raw", pairs, goal)


def _add(table: ResultTable, name: str, rates: list[float]) -> None:
    table.add(name, median(rates), spread=spread(rates), unit="steps/s of 8 ms")


def _add_ratio(table: ResultTable, name: str, pairs: Pairs, goal: float) -> None:
    ratio = median(pairs.ratios)
    table.add(name, ratio, spread=spread(pairs.ratios, 3), unit="times", goal=f">= {goal:g}", holds=ratio >= goal)
