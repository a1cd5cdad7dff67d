"""TorchRL's own planner on the skid-steered robot: one environment at known parameters, as its users write it."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.modules import MPPIPlanner
from torchrl.objectives.value import TDLambdaEstimator

from envs.skid_steer import MAX_WHEEL_SPEED

RADIUS, AXIAL, X_ICR, DT, SPEED = 0.0625, 0.475, 0.2, 0.1, 0.15


class CircleEnv(EnvBase):
    """The kinematics and the cost of ``envs/skid_steer``, in float32, for any batch size."""

    def __init__(self) -> None:
        super().__init__(batch_size=[])
        self._batch_locked = False
        self.observation_spec = Composite(observation=Unbounded((3,)))
        self.action_spec = Bounded(-MAX_WHEEL_SPEED, MAX_WHEEL_SPEED, (2,))
        self.reward_spec = Unbounded((1,))

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        off = torch.zeros(1, dtype=torch.bool)
        return TensorDict({"observation": torch.tensor([1.0, 0.0, 1.57]), "done": off, "terminated": off.clone()}, [])

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        x, y, yaw = tensordict["observation"].unbind(-1)
        right, left = tensordict["action"].unbind(-1)
        forward, rate = RADIUS * (right + left) / 2, RADIUS * (right - left) / AXIAL
        x = x + DT * (forward * yaw.cos() + X_ICR * rate * yaw.sin())
        y = y + DT * (forward * yaw.sin() - X_ICR * rate * yaw.cos())
        cost = 10 * ((torch.hypot(x, y) - 1).square() + (forward - SPEED).square())
        off = torch.zeros(*tensordict.batch_size, 1, dtype=torch.bool)
        seen = torch.stack((x, y, yaw + DT * rate), dim=-1)
        parts = {"observation": seen, "reward": -cost[..., None], "done": off, "terminated": off.clone()}
        return TensorDict(parts, tensordict.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        pass


def torchrl_planner(horizon: int, samples: int) -> MPPIPlanner:
    """TorchRL's planner, one search a step, its returns the sums of rewards."""

    def nothing(observation: Tensor) -> Tensor:
        return torch.zeros_like(observation[..., :1])

    value = TensorDictModule(nothing, in_keys=["observation"], out_keys=["state_value"])
    sums = TDLambdaEstimator(gamma=1.0, lmbda=1.0, value_network=value)
    return MPPIPlanner(
        CircleEnv(),
        sums,
        temperature=1.0,
        planning_horizon=horizon,
        optim_steps=1,
        num_candidates=samples,
        top_k=samples // 4,
    )
