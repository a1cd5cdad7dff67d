"""The rows of the thesis's Table 4.1: systems, truths, priors; ten rollouts of 50 steps a world, under random actions.

Each row asks for one parameter; in CartPole both are unknown, in Acrobot one at a time. The pendulum's unknown is the
timestep of Gymnasium's integrator, no parameter of a simulator here, so that it is written out below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import EnvBase

from envs.acrobot import Acrobot, AcrobotTask
from envs.cartpole import CartPole, CartPoleTask
from envs.mountain_car import MountainCarContinuous, MountainCarContinuousTask
from onlinebayes.embeddings import FilteredEmbedding
from onlinebayes.inference import Box, BoxUniform, filter_of
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Task, TorchSimulator
from onlinebayes.trainers import Listed, Problem
from recipes import acrobot, cartpole, mountain_car

ROLLOUTS, STEPS = 10, 50


@dataclass(frozen=True)
class System:
    """One system and what of it is unknown.

    Args:
        space: the unknown parameters and their bounds.
        truth: their true values.
        rows: parameter -> (the thesis's best log density, the least that is asked for here).
        simulate: theta (G, P) -> sets of rollouts (G, n, T).
        filtered: a fresh embedding by the filter through the simulator, where the library has one.
    """

    space: ParameterSpace
    truth: dict[str, float]
    rows: dict[str, tuple[float, float]]
    simulate: Callable[[Float[Tensor, "G P"], torch.Generator], TensorDict]
    filtered: Callable[[], FilteredEmbedding] | None = None


class RandomActions(TensorDictModuleBase):
    """Actions drawn from the environment's specification."""

    def __init__(self, env: EnvBase) -> None:
        super().__init__()
        self.in_keys, self.out_keys = ["observation"], ["action"]
        self._draw = env.rand_action

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Writes the action."""
        return self._draw(tensordict)


def by_simulator(
    simulator: TorchSimulator, task: Task
) -> Callable[[Float[Tensor, "G P"], torch.Generator], TensorDict]:
    """Rollouts of one of the library's systems under random actions."""

    def simulate(theta: Float[Tensor, "G P"], generator: torch.Generator) -> TensorDict:
        seed = int(torch.randint(2**31, (), generator=generator))
        problem = Problem(simulator, task, BoxUniform(simulator.parameters))
        worlds = problem.simulations(len(theta), STEPS, seed)
        policy = RandomActions(worlds.env)
        torch.manual_seed(seed)
        rows = [worlds.draw([policy], Listed(theta)) for _ in range(ROLLOUTS)]
        return torch.stack(rows, dim=1)

    return simulate


def filter_by(
    simulator: TorchSimulator, task: Task, state: Callable[[Tensor], TensorDict]
) -> Callable[[], FilteredEmbedding]:
    """The filter of one of the library's systems."""

    def embedding() -> FilteredEmbedding:
        model = filter_of(simulator, task, Box.whole(simulator.parameters), state=state)
        return FilteredEmbedding(model, task.action_spec.shape[-1])

    return embedding


def pendulum_steps(theta: Float[Tensor, "G 1"], generator: torch.Generator) -> TensorDict:
    """Gymnasium's Pendulum-v1 with a timestep of its own in each world: g = 10, l = m = 1.

    w+ = clip(w + h (15 sin phi + 3 u), 8),   phi+ = phi + h w+,   u ~ U(-2, 2)
    """
    size = (len(theta), ROLLOUTS)
    h = theta.double().expand(size)

    def uniform(*shape: int) -> Tensor:
        return 2 * torch.rand(*size, *shape, dtype=torch.float64, generator=generator) - 1

    phi, w, u = torch.pi * uniform(), uniform(), 2 * uniform(STEPS)
    seen = [torch.stack([phi.cos(), phi.sin(), w], dim=-1)]
    for t in range(STEPS):
        w = (w + h * (15 * phi.sin() + 3 * u[..., t])).clamp(-8, 8)
        phi = phi + h * w
        seen.append(torch.stack([phi.cos(), phi.sin(), w], dim=-1))
    path = torch.stack(seen, dim=2).float()
    told = {"observation": path[:, :, :-1], "action": u.float()[..., None], "next": {"observation": path[:, :, 1:]}}
    rows = theta[:, None, None].expand(*size, STEPS, -1)
    return TensorDict({**told, "theta": rows}, batch_size=[*size, STEPS])


def _system(
    simulator: TorchSimulator,
    task: Task,
    state: Callable[[Tensor], TensorDict],
    truth: dict[str, float],
    rows: dict[str, tuple[float, float]],
) -> System:
    """One of the library's systems."""
    return System(simulator.parameters, truth, rows, by_simulator(simulator, task), filter_by(simulator, task, state))


def _acrobot(name: str, bounds: tuple[float, float], unit: str, truth: float, thesis: float, least: float) -> System:
    simulator = Acrobot(ParameterSpace({name: Parameter(*bounds, unit)}))
    return _system(simulator, AcrobotTask(), acrobot.state, {name: truth}, {name: (thesis, least)})


CARTPOLE = ParameterSpace({"length": Parameter(0.1, 2.0, "m"), "mass": Parameter(0.1, 2.0, "kg")})
ENGINE = ParameterSpace({"power": Parameter(0.0005, 0.1, "length/step2")})

SYSTEMS: dict[str, System] = {
    "Pendulum": System(
        ParameterSpace({"dt": Parameter(0.01, 0.3, "s")}), {"dt": 0.2}, {"dt": (3.199, 4.0)}, pendulum_steps
    ),
    "Mountain Car": _system(
        MountainCarContinuous(ENGINE),
        MountainCarContinuousTask(),
        mountain_car.state,
        {"power": 0.03},
        {"power": (3.901, 5.0)},
    ),
    "CartPole": _system(
        CartPole(CARTPOLE),
        CartPoleTask(),
        cartpole.state,
        {"length": 0.7, "mass": 1.3},
        {"length": (-0.211, 2.5), "mass": (0.973, 2.5)},
    ),
    "Acrobot m1": _acrobot("mass1", (0.5, 2.0), "kg", 0.9, 2.046, 2.05),
    "Acrobot m2": _acrobot("mass2", (0.5, 2.0), "kg", 1.2, 2.237, 2.5),
    "Acrobot L1": _acrobot("length1", (0.1, 1.5), "m", 0.9, 2.421, 3.0),
    "Acrobot L2": _acrobot("length2", (0.5, 1.5), "m", 1.4, -0.148, -0.05),
}
