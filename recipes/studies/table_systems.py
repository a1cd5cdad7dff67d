"""The rows of the thesis's Table 4.1: systems, truths, priors; ten rollouts of 50 steps a world, under random actions.

Sensor noise is a share of each observed value's range, as in the recipes.

Each row asks for one parameter; in CartPole both are unknown, in Acrobot one at a time. The pendulum's unknown is the
timestep of Gymnasium's integrator, no parameter of a simulator here, so that it is written out below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Protocol

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
from onlinebayes.inference import Box, BoxUniform, LikelihoodEstimator, filter_of
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Task, TorchSimulator
from onlinebayes.trainers import Listed, Problem
from recipes import acrobot, cartpole, mountain_car, pendulum

ROLLOUTS, STEPS = 10, 50


class Simulate(Protocol):
    """Rollouts of given parameters."""

    def __call__(
        self,
        theta: Float[Tensor, "G P"],
        generator: torch.Generator,
        *,
        rollouts: int = ROLLOUTS,
        noise: float = 0.0,
    ) -> TensorDict:
        """Theta (G, P) -> sets of rollouts (G, n, T), with sensor noise as a share of each range."""
        ...


@dataclass(frozen=True)
class System:
    """One system and what of it is unknown.

    Args:
        space: the unknown parameters and their bounds.
        truth: their true values.
        rows: parameter -> (the thesis's best log density, the least that is asked for here).
        simulate: see :class:`Simulate`.
        filtered: a fresh embedding by the filter through the simulator, where the library has one.
        exact: a fresh exact posterior, where the library has the simulator.
    """

    space: ParameterSpace
    truth: dict[str, float]
    rows: dict[str, tuple[float, float]]
    simulate: Simulate
    filtered: Callable[[], FilteredEmbedding] | None = None
    exact: Callable[[], LikelihoodEstimator] | None = None


class RandomActions(TensorDictModuleBase):
    """Actions drawn from the environment's specification."""

    def __init__(self, env: EnvBase) -> None:
        super().__init__()
        self.in_keys, self.out_keys = ["observation"], ["action"]
        self._draw = env.rand_action

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Writes the action."""
        return self._draw(tensordict)


def by_simulator(simulator: TorchSimulator, task: Task, width: Float[Tensor, " O"]) -> Simulate:
    """Rollouts of one of the library's systems under random actions; ``width`` is each observed value's range."""

    def simulate(
        theta: Float[Tensor, "G P"], generator: torch.Generator, *, rollouts: int = ROLLOUTS, noise: float = 0.0
    ) -> TensorDict:
        seed = int(torch.randint(2**31, (), generator=generator))
        problem = Problem(simulator, task, BoxUniform(simulator.parameters), noise * width if noise else None)
        worlds = problem.simulations(len(theta), STEPS, seed)
        policy = RandomActions(worlds.env)
        torch.manual_seed(seed)
        rows = [worlds.draw([policy], Listed(theta)) for _ in range(rollouts)]
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


def exact_by(
    simulator: TorchSimulator, task: Task, state: Callable[[Tensor], TensorDict]
) -> Callable[[], LikelihoodEstimator]:
    """The exact posterior of one of the library's systems."""

    def estimator() -> LikelihoodEstimator:
        box = Box.whole(simulator.parameters)
        return LikelihoodEstimator(filter_of(simulator, task, box, state=state), box, task.action_spec.shape[-1])

    return estimator


def pendulum_steps(
    theta: Float[Tensor, "G 1"], generator: torch.Generator, *, rollouts: int = ROLLOUTS, noise: float = 0.0
) -> TensorDict:
    """Gymnasium's Pendulum-v1 with a timestep of its own in each world: g = 10, l = m = 1.

    w+ = clip(w + h (15 sin phi + 3 u), 8),   phi+ = phi + h w+,   u ~ U(-2, 2)
    """
    size = (len(theta), rollouts)
    h = theta.double().expand(size)

    def uniform(*shape: int) -> Tensor:
        return 2 * torch.rand(*size, *shape, dtype=torch.float64, generator=generator) - 1

    phi, w, u = torch.pi * uniform(), uniform(), 2 * uniform(STEPS)
    path = swung(h, phi, w, u)
    if noise:
        path = path + noise * pendulum.RANGE * torch.randn(path.shape, dtype=path.dtype, generator=generator)
    path = path.float()
    told = {"observation": path[:, :, :-1], "action": u.float()[..., None], "next": {"observation": path[:, :, 1:]}}
    rows = theta[:, None, None].expand(*size, STEPS, -1)
    return TensorDict({**told, "theta": rows}, batch_size=[*size, STEPS])


def swung(
    h: Float[Tensor, "*size"], phi: Float[Tensor, "*size"], w: Float[Tensor, "*size"], u: Float[Tensor, "*size T"]
) -> Float[Tensor, "*size T1 3"]:
    """Simulate the pendulum's sensors without noise: (cos phi, sin phi, w) at 0, h, ... T h.

    Args:
        h: timestep [s].
        phi, w: where it begins [rad, rad/s].
        u: torques [N m].
    """
    seen = [torch.stack([phi.cos(), phi.sin(), w], dim=-1)]
    for t in range(u.shape[-1]):
        w = (w + h * (15 * phi.sin() + 3 * u[..., t])).clamp(-8, 8)
        phi = phi + h * w
        seen.append(torch.stack([phi.cos(), phi.sin(), w], dim=-1))
    return torch.stack(seen, dim=-2)


def _system(
    simulator: TorchSimulator,
    task: Task,
    recipe: ModuleType,
    truth: dict[str, float],
    rows: dict[str, tuple[float, float]],
) -> System:
    """One of the library's systems, with the sensors of a recipe."""
    return System(
        simulator.parameters,
        truth,
        rows,
        by_simulator(simulator, task, recipe.RANGE),
        filter_by(simulator, task, recipe.state),
        exact_by(simulator, task, recipe.state),
    )


def _acrobot(name: str, bounds: tuple[float, float], unit: str, truth: float, thesis: float, least: float) -> System:
    simulator = Acrobot(ParameterSpace({name: Parameter(*bounds, unit)}))
    return _system(simulator, AcrobotTask(), acrobot, {name: truth}, {name: (thesis, least)})


CARTPOLE = ParameterSpace({"length": Parameter(0.1, 2.0, "m"), "mass": Parameter(0.1, 2.0, "kg")})
ENGINE = ParameterSpace({"power": Parameter(0.0005, 0.1, "length/step2")})

SYSTEMS: dict[str, System] = {
    "Pendulum": System(
        ParameterSpace({"dt": Parameter(0.01, 0.3, "s")}), {"dt": 0.2}, {"dt": (3.199, 4.0)}, pendulum_steps
    ),
    "Mountain Car": _system(
        MountainCarContinuous(ENGINE),
        MountainCarContinuousTask(),
        mountain_car,
        {"power": 0.03},
        {"power": (3.901, 5.0)},
    ),
    "CartPole": _system(
        CartPole(CARTPOLE),
        CartPoleTask(),
        cartpole,
        {"length": 0.7, "mass": 1.3},
        {"length": (-0.211, 2.5), "mass": (0.973, 2.5)},
    ),
    "Acrobot m1": _acrobot("mass1", (0.5, 2.0), "kg", 0.9, 2.046, 2.05),
    "Acrobot m2": _acrobot("mass2", (0.5, 2.0), "kg", 1.2, 2.237, 2.5),
    "Acrobot L1": _acrobot("length1", (0.1, 1.5), "m", 0.9, 2.421, 3.0),
    "Acrobot L2": _acrobot("length2", (0.5, 1.5), "m", 1.4, -0.148, -0.05),
}
