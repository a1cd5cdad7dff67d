"""Drives of the skid-steered robot, and an estimator for beliefs that are learnt on the way.

A drive is the real loop, step by step: pose, its sensors, plan, wheels; the robot's parameters may change in it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from envs.skid_steer import MAX_WHEEL_SPEED, CircleTask, SkidSteerKinematics
from onlinebayes.control import Knots
from onlinebayes.embeddings import FilteredEmbedding
from onlinebayes.embeddings.likeliest import STRAIGHT
from onlinebayes.inference import BoxUniform, Windowed, filter_of, fit
from onlinebayes.inference.neural import mixture_of
from onlinebayes.trainers import Problem, Repeated
from recipes.skid_steer import SENSORS, SPACE, planner, state

STEPS = 200  # of a drive, 20 s
WINDOW = 5  # steps between two beliefs in a loop, half a second


@dataclass(frozen=True)
class Drive:
    """Costs, poses and times of a drive.

    Args:
        cost: of every step, by world (N, T).
        pose: x, y, yaw after every step [m, rad].
        seconds: processor time of every call of the policy (T,) [s].
        wall: the same by the clock.
    """

    cost: Float[Tensor, "N T"]
    pose: Float[Tensor, "N T 3"]
    seconds: Float[Tensor, " T"]
    wall: Float[Tensor, " T"]


@torch.no_grad()
def drive(policy: TensorDictModuleBase, thetas: Sequence[Tensor], seed: int, worlds: int = 1) -> Drive:
    """Drive a robot whose parameters (P,) are those of each stretch of :data:`STEPS` in turn."""
    task, random = CircleTask(), torch.Generator().manual_seed(seed)
    robot, rows, times = SkidSteerKinematics(SPACE, worlds), list[TensorDict](), list[tuple[float, float]]()
    now: TensorDict = task.start(thetas[0].expand(worlds, -1), random)
    for k in range(STEPS * len(thetas)):
        if k % STEPS == 0:
            now = robot.reset(thetas[k // STEPS].expand(worlds, -1), now)
        noise = torch.randn(worlds, 3, generator=random) * SENSORS
        began = torch.full((worlds, 1), k == 0)
        seen = TensorDict({"observation": task.observe(now) + noise, "is_init": began}, [worlds])
        begun = time.process_time(), time.perf_counter()
        action = policy(seen)["action"]
        times.append((time.process_time() - begun[0], time.perf_counter() - begun[1]))
        now = robot.step(TensorDict({"command": action}, [worlds]))
        rows.append(now)
    path, spent = TensorDict.stack(rows, dim=1), torch.tensor(times)
    return Drive(task.cost(path), path["qpos"], spent[:, 0], spent[:, 1])


def planned_for(belief: object, seed: int) -> TensorDictModuleBase:
    """The recipe's planner, told a belief."""
    plans = planner(CircleTask(), seed)
    plans.set_belief(belief)  # type: ignore[arg-type]
    return plans


def estimator_for_loops(seed: int, simulations: int = 300) -> Windowed:
    """An estimator that knows windows of half a second of any commands, from one to those of 20 s at once."""
    task, prior, random = CircleTask(), BoxUniform(SPACE), torch.Generator().manual_seed(seed)
    problem = Problem(SkidSteerKinematics(SPACE), task, prior, SENSORS, planner(task, seed).transforms)
    knots = torch.randn(simulations, 12, 2, generator=random).double()
    smooth = torch.einsum("hn,bnu->bhu", Knots(1.0, 12).factor(STEPS), knots)
    commands = (1.5 + 1.5 * smooth).clamp(-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED).float()
    mask = torch.ones(simulations, STEPS, dtype=torch.bool)
    repeated = Repeated(TensorDict({"action": commands, "mask": mask}, [simulations, STEPS]))
    sets = problem.simulations(simulations, STEPS, seed).draw([repeated], prior)
    train = partial(fit, epochs=25, batch_size=50, learning_rate=2e-3)
    embedding = FilteredEmbedding(filter_of(problem.simulator, task, prior.box, state=state), 2, STRAIGHT)
    made = Windowed(mixture_of(embedding, prior, train), WINDOW)
    made.fit(sets, generator=random)
    return made
